// The functions of the cxx bridge. Only glue.cpp sees both cxx and the plain C++ of core.h.
#pragma once

#include "core.h"
#include "rust/cxx.h"

namespace solidmap::cgal_tetgen {

struct Outcome;
struct Mesh;
struct RefinementSizes;

using Coordinates = rust::Slice<const double>;
using Indices = rust::Slice<const std::uint32_t>;

Outcome check_tetgen();
Outcome tetgen_mesh(Coordinates xyz, Indices triangles, double radius_edge_ratio, double min_dihedral,
                    double max_volume, Mesh& out);
Outcome mesh3_mesh(Coordinates xyz, Indices triangles, const RefinementSizes& sizes, Mesh& out);
Outcome wrap_surface(Coordinates xyz, Indices triangles, double alpha, double offset, Mesh& out);
Outcome remesh_surface(Coordinates xyz, Indices triangles, double edge_length, double feature_angle, Mesh& out);
Outcome intersecting_pairs(Coordinates xyz, Indices triangles, double max_tested, rust::Vec<std::uint32_t>& pairs);
std::unique_ptr<DistanceField> new_distance_field(Coordinates xyz, Indices triangles, Outcome& outcome);
Outcome closest_points(const DistanceField& field, Coordinates points, rust::Slice<double> closest);
Outcome enclosed_volume(const DistanceField& field, double& volume);
Outcome points_inside(const DistanceField& field, Coordinates points, rust::Slice<std::uint8_t> inside);

}  // namespace solidmap::cgal_tetgen

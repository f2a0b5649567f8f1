// Conversions between plain arrays and CGAL's types.
#pragma once

#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Surface_mesh.h>

#include <array>
#include <vector>

#include "core.h"

namespace solidmap::cgal_tetgen {

using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using Point = Kernel::Point_3;
using SurfaceMesh = CGAL::Surface_mesh<Point>;

inline std::vector<Point> points_of(const SurfaceView& surface) {
  std::vector<Point> points;
  points.reserve(surface.vertices);
  for (std::size_t v = 0; v < surface.vertices; ++v)
    points.emplace_back(surface.xyz[3 * v], surface.xyz[3 * v + 1], surface.xyz[3 * v + 2]);
  return points;
}

/// The triangles with an area; CGAL's orientation predicates fail on others.
inline std::vector<std::array<std::size_t, 3>> nondegenerate_triangles(const SurfaceView& surface,
                                                                const std::vector<Point>& points) {
  std::vector<std::array<std::size_t, 3>> triangles;
  triangles.reserve(surface.triangles);
  for (std::size_t t = 0; t < surface.triangles; ++t) {
    const std::uint32_t* c = surface.corners + 3 * t;
    if (!CGAL::collinear(points[c[0]], points[c[1]], points[c[2]])) triangles.push_back({c[0], c[1], c[2]});
  }
  return triangles;
}

inline Arrays arrays_of(const SurfaceMesh& mesh) {
  Arrays out;
  std::vector<std::uint32_t> number(mesh.num_vertices() + mesh.number_of_removed_vertices());
  std::uint32_t next = 0;
  for (auto v : mesh.vertices()) {
    const Point& p = mesh.point(v);
    out.xyz.insert(out.xyz.end(), {p.x(), p.y(), p.z()});
    number[v] = next++;
  }
  for (auto f : mesh.faces())
    for (auto v : CGAL::vertices_around_face(mesh.halfedge(f), mesh)) out.corners.push_back(number[v]);
  return out;
}

}  // namespace solidmap::cgal_tetgen

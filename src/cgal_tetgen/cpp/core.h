// The operations in plain C++: no cxx, no CGAL, no TetGen. The translation units with CGAL and TetGen include only this
// header, so that a change of the Rust side does not recompile them.
//
// A surface is any list of triangles with indices in range and finite coordinates; further preconditions are stated at
// each operation, and the Rust side checks them. Failures are thrown; glue.cpp catches them all.
#pragma once

#include <cstddef>
#include <cstdint>
#include <exception>
#include <memory>
#include <string>
#include <vector>

namespace solidmap::cgal_tetgen {

/// A borrowed triangle surface: `3 * vertices` coordinates, `3 * triangles` indices.
struct SurfaceView {
  const double* xyz;
  std::size_t vertices;
  const std::uint32_t* corners;
  std::size_t triangles;
};

/// An owned mesh: three coordinates per vertex; three indices per triangle or four per tetrahedron.
struct Arrays {
  std::vector<double> xyz;
  std::vector<std::uint32_t> corners;
};

/// Read by src/cgal_tetgen/error.rs. 1 to 10 are TetGen's own codes.
enum FailureCode : int {
  kDone = 0,
  kOutOfMemory = 1,
  kTetgenInternal = 2,
  kSelfIntersection = 3,
  kSmallFeature = 4,
  kCloseFacets = 5,
  kTetgenInput = 10,
  kTetgenUsage = 100,
  kCgal = 101,
  kNotInterposed = 102,
  kUnknown = 103,
  kStopped = 104,
  kCrowded = 105,
};

class Failure : public std::exception {
 public:
  Failure(int code, std::string message) : code(code), message(std::move(message)) {}
  const char* what() const noexcept override { return message.c_str(); }

  const int code;
  const std::string message;
};

/// Throws `kNotInterposed` unless libtet reports its errors through tetgen.cpp.
void check_interposition();

struct TetgenOptions {
  /// 0 for no quality refinement.
  double radius_edge_ratio;
  /// Degrees; used with a radius-edge ratio only.
  double min_dihedral;
  /// 0 for no bound.
  double max_volume;
};

/// Tetrahedra of everything inside the outermost triangles, cavities included; input triangles are not split.
/// Needs a closed surface without zero-area triangles, not flat.
Arrays tetgen(SurfaceView surface, const TetgenOptions& options);

/// CGAL's mesh criteria. Lengths are in units of the coordinates, angles in degrees.
struct Mesh3Options {
  double edge_size;
  double facet_size;
  double facet_angle;
  double facet_distance;
  double cell_size;
  double cell_radius_edge_ratio;
  /// Edges whose triangles' normals differ by more than this are kept.
  double feature_angle;
  /// Time limit, after which `kStopped` is thrown.
  double seconds;
};

/// Delaunay refinement of what lies inside an odd number of the shells. Needs a closed surface with two triangles at
/// every edge and no self-intersection.
Arrays mesh3(SurfaceView surface, const Mesh3Options& options);

/// A closed manifold surface at a distance of about `offset` outside `surface`.
Arrays wrap(SurfaceView surface, double alpha, double offset);

/// One pass of isotropic remeshing towards `edge_length`. Needs a closed manifold surface. Edges with a larger angle between
/// the normals beside them than `feature_angle`, in degrees, are split and collapsed, but stay where they are; none does if it is 0.
Arrays remesh(SurfaceView surface, double edge_length, double feature_angle);

/// Two triangle indices per pair, the lower first, in ascending order. A triangle without area is paired with itself
/// and with no other. Throws `kCrowded` when more than `max_tested` pairs of boxes overlap, or ten million pairs of
/// triangles intersect.
std::vector<std::uint32_t> self_intersections(SurfaceView surface, double max_tested);

/// Closest points of a surface and inside tests. Immutable after construction, so threads may share it.
class DistanceField {
 public:
  /// Needs at least one triangle with an area.
  explicit DistanceField(SurfaceView surface);
  ~DistanceField();
  DistanceField(const DistanceField&) = delete;
  DistanceField& operator=(const DistanceField&) = delete;

  /// Writes the closest point of each of `count` points.
  void closest(const double* points, std::size_t count, double* closest) const;
  /// Writes 1 for points inside, 0 for points outside or on the surface. Needs a closed surface.
  void inside(const double* points, std::size_t count, std::uint8_t* inside) const;
  /// Signed volume that the triangles enclose, positive when they face outward. Needs a closed surface.
  double volume() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace solidmap::cgal_tetgen

/// \file
/// One-to-one maps of solids, linear over tetrahedra.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "solidmap/harmonic_map.hpp"
#include "solidmap/mesh.hpp"
#include "solidmap/progress.hpp"
#include "solidmap/span.hpp"

namespace solidmap {

namespace detail {
struct BijectiveMapImpl;
}  // namespace detail

/// How a bijective map is made.
struct BijectiveOptions {
  /// Largest distance of the boundary map from the linear one over the triangles of the mesh's boundary, as a fraction of
  /// the target's diagonal: triangles are divided where it bends more.
  double tolerance = 1e-3;
  /// Largest number of tetrahedra that splitting may add where nodes are stuck; 0 for no splitting. A third of those that
  /// the mesh has, and 5000, where there is no value.
  std::optional<std::size_t> most_added;
  /// Work after which the repair ends although cells stay inverted: iterations of descent for each cell in the mean.
  double effort = 2000;
  /// Bytes that the run may take, estimated before they are taken: more throws Error (memory). 0: no limit.
  std::uint64_t memory = 0;
};

/// How a bijective map was made. Distances are fractions of the target's diagonal.
struct BijectiveReport {
  std::size_t tets = 0, nodes = 0, boundary_nodes = 0;
  /// Tetrahedra that the harmonic map inverts, and those that splitting added.
  std::size_t inverted_as_mapped = 0, cells_added = 0;
  /// Least scaled Jacobian in the target.
  double min_scaled_jacobian = 0;
  /// Distance between the two maps at the nodes and centroids of the mesh: root mean square, the largest, and where in the
  /// domain that is.
  double difference_rms = 0, difference_max = 0;
  Point difference_place = {};
  /// Largest distance of the target's surface from the image of the mesh.
  double gap = 0;
  /// Whether the boundaries are proved not to meet themselves; without CGAL that is not looked for.
  bool boundary_one_to_one = false;
};

/// A one-to-one map: linear over the tetrahedra of a mesh, none of which is inverted, decided exactly. Immutable; copies
/// share their data and cost nothing; all functions may be called from any number of threads at once.
///
/// Points outside of the mesh have the image of the closest point.
class BijectiveMap {
 public:
  /// Makes the tetrahedra of `mesh`, a mesh of the map's domain (tetrahedralise() makes one), one to one: inner nodes are
  /// moved, and tetrahedra split, until none is inverted; nodes on the boundary stay where the boundary map sends them.
  /// Throws Error: numerical where tetrahedra stay inverted or the boundary of the image meets itself, invalid_input,
  /// unsupported (a map without boundary map), memory, cancelled.
  static BijectiveMap make(const HarmonicMap& map, const CellMesh& mesh, const BijectiveOptions& options = {},
                           const ProgressCallback& progress = {});
  /// The bijective map that the file of `map` holds, if it has one.
  static std::optional<BijectiveMap> of(const HarmonicMap& map);
  /// Writes a map file with both maps. Throws Error (io).
  void save(const HarmonicMap& map, const std::filesystem::path& path) const;

  /// Images of the points, in order; about a microsecond for each.
  std::vector<Point> evaluate(Span<const Point> points) const;
  void evaluate(Span<const Point> points, Span<Point> images) const;
  /// Jacobians at the points, `∂f_i/∂x_k` at `3 i + k`: constant in each tetrahedron.
  std::vector<Matrix3> jacobian(Span<const Point> points) const;
  void jacobian(Span<const Point> points, Span<Matrix3> jacobians) const;
  /// Preimages of the points, in order, exact to rounding: `ok`, `outside` or `not_finite`.
  std::vector<Preimage> preimages(Span<const Point> points) const;

  BijectiveReport report() const;
  /// The mesh of the domain, and its image.
  CellMesh domain() const;
  CellMesh target() const;

 private:
  friend struct detail::Access;
  explicit BijectiveMap(std::shared_ptr<const detail::BijectiveMapImpl> impl) : impl_(std::move(impl)) {}
  std::shared_ptr<const detail::BijectiveMapImpl> impl_;
};

}  // namespace solidmap

/// \file
/// Maps of boundary surfaces.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "solidmap/mesh.hpp"
#include "solidmap/progress.hpp"
#include "solidmap/span.hpp"

namespace solidmap {

namespace detail {
struct BoundaryMapImpl;
}

/// A point of a surface: a triangle, and weights of its corners that add up to 1. Weights are taken as they are.
struct SurfacePoint {
  std::uint32_t triangle = 0;
  std::array<double, 3> barycentric = {1.0 / 3, 1.0 / 3, 1.0 / 3};
};

/// What a map to the sphere keeps.
enum class SphereEnergy {
  /// Angles, with areas kept in bounds.
  balanced,
  /// Angles alone: limbs shrink to specks.
  conformal,
};

/// How BoundaryMap::pair() works.
struct PairOptions {
  /// Vertices of the domain that go to vertices of the target.
  std::vector<std::array<std::uint32_t, 2>> landmarks;
  /// Conformal maps to the sphere, as in the paper, instead of closest points.
  bool conformal = false;
  /// Whether the map is made to distort less once it is there.
  bool improve = true;
};

/// How far a map of a pair distorts, and what is odd about it.
struct PairReport {
  /// σ₁/σ₂, 1 where angles are kept, and max(σ₁σ₂, 1/σ₁σ₂), 1 where areas are: half of the area has the median or less.
  double angle_median = 0, angle_p99 = 0, area_median = 0, area_p99 = 0;
  double seconds = 0;
  std::vector<std::string> warnings;
};

/// Where every point of a domain's surface goes. Immutable; copies share their data and cost nothing.
///
/// Given by the images of the vertices it is linear over the triangles. Composed of spherical embeddings (to_sphere(), pair()) it is a
/// bijection, decided exactly, and points between vertices go onto the target's surface, not onto chords.
class BoundaryMap {
 public:
  /// Vertex v of `domain` goes to `images[v]`; any genus.
  /// Throws Error (invalid_input) when the counts differ, or an image is not finite.
  BoundaryMap(const Surface& domain, Span<const Point> images);
  /// The same with the vertices of another surface of the same connectivity; throws Error (invalid_input) otherwise.
  /// Triangles count as the same when they have the same corners: those of `domain` say which side is out.
  static BoundaryMap between(const Surface& domain, const Surface& image);
  /// A bijection of a surface of genus 0 with the unit sphere about the origin. About 5 s for 134 000 vertices on two
  /// cores. Throws Error (invalid_input, numerical, cancelled).
  static BoundaryMap to_sphere(const Surface& domain, SphereEnergy energy = SphereEnergy::balanced,
                               const ProgressCallback& progress = {});
  /// A bijection between two surfaces of genus 0 of which no correspondence is known. About 20 s for 15 000 vertices on
  /// two cores. The callback is asked some ten times in a second.
  /// Throws Error (invalid_input: other genus, landmarks that cannot be met; cancelled).
  static BoundaryMap pair(const Surface& domain, const Surface& target, const PairOptions& options = {},
                          const ProgressCallback& progress = {}, PairReport* report = nullptr);

  /// Boundary files of `solidmap boundary`: the whole map, not its vertices alone. Throws Error (io, not_found, ...).
  static BoundaryMap load(const std::filesystem::path& path);
  void save(const std::filesystem::path& path) const;

  /// The surface that is mapped; copies it, linear in its size.
  Surface domain() const;
  /// The surface that it goes to, outward: the target's own triangles, where it has any, or the domain's over the images.
  Surface target() const;
  /// The image of each vertex; a view, valid as long as this object or a copy lives; of a temporary, a copy.
  Span<const Point> images() const&;
  std::vector<Point> images() &&;
  /// Volume of the target, negative when the map turns the solid inside out, and diagonal of its bounding box.
  double target_volume() const;
  double target_diagonal() const;

  /// Images of points of the domain's surface. Compositions of spherical embeddings take some microseconds each, on all cores.
  /// Throws Error (invalid_input) for a triangle that is not there.
  std::vector<Point> evaluate(Span<const SurfacePoint> points) const;

  /// The way back. Throws Error (unsupported) unless the map was made by pair().
  BoundaryMap inverse() const;

 private:
  friend struct detail::Access;
  explicit BoundaryMap(std::shared_ptr<const detail::BoundaryMapImpl> impl) : impl_(std::move(impl)) {}
  std::shared_ptr<const detail::BoundaryMapImpl> impl_;
};

}  // namespace solidmap

/// \file
/// Maps of boundary surfaces.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <limits>
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

/// A point of a surface: a triangle, and weights of its corners that add up to 1, which is not checked.
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
  /// Whether the surfaces are matched by conformal maps to the sphere, as in Li et al. 2007, instead of by shape.
  bool conformal = false;
  /// 0: landmarks are met exactly. Otherwise they are soft: one that is a tenth of the root of the target's area off costs as
  /// much as a mean distortion that is higher by this many percent.
  double landmarks_weight = 0;
  /// For solids with handles: loops of the domain, as vertices of which the last one is joined to the first, and those of the target that
  /// they are to go to, up to a deformation along the surface. They decide which handle goes to which, in which direction, and how
  /// often it is twisted. With several handles, give one around the hole of each, none of which meets itself or
  /// another.
  std::vector<std::array<std::vector<std::uint32_t>, 2>> loops;
  /// Components and cavities of the domain that go to given ones of the target, by their places in CheckReport::components. Those that
  /// are not named find their partners by what they lie in, their handles, place and size.
  std::vector<std::array<std::uint32_t, 2>> components;
  /// Directions of the domain and of the target that correspond roughly, within 60°; both zero: not known.
  Point domain_up = {0, 0, 0}, target_up = {0, 0, 0};
  /// Share of the domain's area above which the map looks wrong when it is stretched or compressed over 10 times there; of the
  /// target's area four times as much.
  double most_stretched = 0.0075;
  /// Whether the solids lie in the same place, with the same size and pose, so that no alignment is sought. `conformal` seeks
  /// none by shape anyway.
  bool aligned = false;
  /// Whether the distortion of the map is lowered once it is found.
  bool improve = true;
};

/// How far a map made by BoundaryMap::pair() distorts, and warnings.
struct PairReport {
  /// Quantiles over the area of σ₁/σ₂, 1 where angles are kept, and of max(σ₁σ₂, 1/σ₁σ₂), 1 where areas are kept;
  /// σ₁ ≥ σ₂ are the singular values of the Jacobian from surface to surface.
  double angle_median = 0, angle_p99 = 0, area_median = 0, area_p99 = 0;
  /// Share of the domain's area that is stretched or compressed over 10 times.
  double stretched = 0;
  /// Share of the target's area, by the inverse of the map.
  double target_stretched = 0;
  /// Whether the map is probably wrong, a limb in the wrong place: too much is stretched, or a correspondence by intrinsic shape is
  /// clearly nearer to an isometry and lies elsewhere.
  bool looks_wrong = false;
  /// How far the map is from an isometry: ‖CᵀC − I‖² / 20 of the functional map C of 20 eigenfunctions, 0 for an isometry. NaN
  /// where it is not known: for solids with handles, with conformal maps, and where solids lie in the same place.
  double isometry_defect = std::numeric_limits<double>::quiet_NaN();
  /// The largest distance of the image of a landmark from where it is to be, as a fraction of the target's diagonal.
  double landmark_error = 0;
  /// Where there are several components and cavities: for each of the domain the one of the target that it goes to.
  std::vector<std::uint32_t> components;
  /// Wall-clock seconds.
  double seconds = 0;
  std::vector<std::string> warnings;
};

/// How BoundaryMap::improved() works.
struct ImproveOptions {
  /// How much the distortion of the surface, and of each component and cavity, may grow: its symmetric Dirichlet energy, in the mean
  /// and at 99.9 % of the area, over those at the start. At least 1.
  double max_distortion = 1.5;
  /// Rounds at most; each fits a harmonic map.
  std::size_t rounds = 30;
  /// Boundary error that the fits are to reach (99 % of the area, over the target's diagonal).
  double tolerance = 2e-3;
};

/// What BoundaryMap::improved() did.
struct ImproveReport {
  /// Harmonic energy of the map between the solids scaled to unit volume, at the start and after every round that lowered it.
  std::vector<double> energies;
  /// Rounds, also those in vain.
  std::size_t rounds = 0;
  /// Why there were no more.
  enum class End {
    /// More would distort the surface beyond the bound.
    distortion,
    /// No step lowered the energy.
    converged,
    /// There were as many as allowed.
    rounds,
  } end = End::rounds;
  /// Symmetric Dirichlet energy of the surface at 99.9 % of the area.
  double distortion_before = 0, distortion_after = 0;
  /// Boundary errors of the fits (99 % of the area, over the target's diagonal).
  double boundary_error_before = 0, boundary_error_after = 0;
  std::vector<std::string> warnings;
};

/// Where every point of a domain's surface goes. Immutable; copies share their data and cost nothing.
///
/// Given by the images of the vertices, it is linear over the triangles. Composed of embeddings in the sphere or a flat
/// torus (to_sphere(), pair()), it is a bijection, decided exactly, and points between vertices go onto the target's surface, not onto
/// chords.
class BoundaryMap {
 public:
  /// Vertex v of `domain` goes to `images[v]`; any genus.
  /// Throws Error (invalid_input) when the counts differ, or an image is not finite.
  BoundaryMap(const Surface& domain, Span<const Point> images);
  /// The same with the vertices of another surface of the same connectivity; throws Error (invalid_input) otherwise.
  /// Triangles may differ in the order of their corners: the orientation is that of `domain`.
  static BoundaryMap between(const Surface& domain, const Surface& image);
  /// A bijection of a surface of genus 0 with the unit sphere about the origin. About 5 s for 134 000 vertices on two
  /// cores. Throws Error (invalid_input, numerical, cancelled).
  static BoundaryMap to_sphere(const Surface& domain, SphereEnergy energy = SphereEnergy::balanced,
                               const ProgressCallback& progress = {});
  /// A bijection of a surface of genus 1 with the torus of revolution that keeps its angles best, which is target(): about the z
  /// axis, its centre at the origin, with the volume of the solid. About 10 s for 10 000 vertices on two cores. Throws Error
  /// (invalid_input: other genus, a surface that passes through itself, a knotted hole; cancelled).
  static BoundaryMap to_torus(const Surface& domain, const ProgressCallback& progress = {});
  /// A bijection between two surfaces of the same genus (with handles: without landmarks), and no known correspondence; of solids
  /// with as many components and cavities each is mapped by itself. About 20 s for 15 000 vertices on two cores. The callback is called about ten times per second.
  /// Throws Error (invalid_input: other genus, components or cavities that do not match, landmarks that cannot be met; cancelled).
  static BoundaryMap pair(const Surface& domain, const Surface& target, const PairOptions& options = {},
                          const ProgressCallback& progress = {}, PairReport* report = nullptr);

  /// Reads and writes boundary files, as `solidmap boundary` does: the whole map, not only images of vertices. Throws
  /// Error (not_found, io, invalid_input for a damaged file, unsupported for a newer format).
  static BoundaryMap load(const std::filesystem::path& path);
  void save(const std::filesystem::path& path) const;

  /// The surface that is mapped; copies it, linear in its size.
  Surface domain() const;
  /// The surface that the domain is mapped onto, facing outward: the target given to pair(), or the domain's triangles
  /// over the images.
  Surface target() const;
  /// The image of each vertex: a view, valid as long as this object or a copy lives; of a temporary, a copy.
  Span<const Point> images() const&;
  std::vector<Point> images() &&;
  /// Volume of the target, negative when the map turns the solid inside out, and diagonal of its bounding box.
  double target_volume() const;
  double target_diagonal() const;

  /// Images of points of the domain's surface, evaluated on all cores: some microseconds per point for a composition of
  /// embeddings. Throws Error (invalid_input) for a triangle out of range.
  std::vector<Point> evaluate(Span<const SurfacePoint> points) const;

  /// The inverse map. Throws Error (unsupported) unless the map was made by pair(), or loaded from a file of such a one.
  BoundaryMap inverse() const;

  /// The images moved on the target such that the harmonic energy of the inside falls, one to one all the way. Some 2 s per
  /// round for 10 000 vertices on two cores.
  /// Throws Error (invalid_input: a map given by images of vertices, which cannot slide; options out of range; cancelled).
  BoundaryMap improved(const ImproveOptions& options = {}, const ProgressCallback& progress = {},
                       ImproveReport* report = nullptr) const;

 private:
  friend struct detail::Access;
  explicit BoundaryMap(std::shared_ptr<const detail::BoundaryMapImpl> impl) : impl_(std::move(impl)) {}
  std::shared_ptr<const detail::BoundaryMapImpl> impl_;
};

}  // namespace solidmap

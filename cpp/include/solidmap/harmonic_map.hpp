/// \file
/// Fitted maps: values, derivatives, inverses and energies.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "solidmap/boundary_map.hpp"
#include "solidmap/mesh.hpp"
#include "solidmap/progress.hpp"
#include "solidmap/span.hpp"
#include "solidmap/worst_place.hpp"

namespace solidmap {

namespace detail {
struct HarmonicMapImpl;
struct InverseImpl;
}  // namespace detail

/// Distances between map and boundary map at boundary points that the fit has not seen, as fractions of the target's
/// diagonal. By the maximum principle the map is nowhere inside the domain farther from the exact harmonic one than on
/// the boundary.
struct BoundaryError {
  /// Root mean square over the area, 99 % quantile by area, and maximum.
  double rms = 0, p99 = 0, max = 0;
};

/// Boundary errors as multiples of the spacing of the image's vertices around. Where it is above 1, what is that fine in
/// the image, such as a squeezed limb, is lost or folded, however small the error is beside the diagonal.
struct LocalError {
  /// 99 % quantile by area, and maximum; NaN for a map whose file does not say.
  double p99 = 0, max = 0;
};

/// What became of free sources.
struct FreeSourcesReport {
  /// Rounds that moved the sources, and why there were no more: `"converged"`, `"rounds"` (as many as are made), or
  /// `"concluded"` (by the progress callback).
  std::size_t rounds = 0;
  std::string end;
  /// Root mean square misfit at the collocation points, over the area, as a fraction of the target's diagonal.
  double residual_before = 0, residual_after = 0;
  /// With the sources where they were placed.
  BoundaryError boundary_error_before;
  /// Whether the map has the moved sources: not if its boundary error would be larger.
  bool kept = false;
};

/// What a fit did, and how well it meets its boundary map.
struct FitReport {
  std::size_t vertices = 0, triangles = 0;
  /// Sources placed, and boundary points where equations are posed.
  std::size_t sources = 0, collocation = 0;
  /// `"schwarz"`, `"dense-qr"` or `"dense-svd"`.
  std::string method;
  std::size_t iterations = 0;
  /// Rounds of refinement, and why they ended: `"tolerance"` (it is met), `"off"`, `"fixed"` (the solver has none),
  /// `"max_sources"`, `"max_source_ratio"`, `"memory"`, `"in_vain"` (more sources did not help), `"no_room"` (for finer
  /// sources outside the domain); empty where no tolerance was set. `boundary_error` tells whether it is met.
  std::size_t refinements = 0;
  std::string refinement_end;
  /// What became of free sources, where they were asked for.
  std::optional<FreeSourcesReport> free_sources;
  BoundaryError boundary_error;
  LocalError local_error;
  /// Residual at the collocation points: root mean square as a fraction of the target's diagonal, and the C-Error of Li
  /// et al. 2007.
  double residual_rms = 0, c_error = 0;
  /// Wall-clock seconds; 0 for a map from a file.
  double seconds = 0, seconds_sampling = 0, seconds_factor = 0, seconds_solve = 0, seconds_check = 0;
  /// What was repaired or left out.
  std::vector<std::string> warnings;
};

/// A harmonic map between two solids, `f(x) = A (1, x) + Σ_s w_s / (4π |x - Q_s|)`. Immutable; copies share their data
/// and cost nothing; all functions may be called from any number of threads at once.
///
/// Values outside the domain are meaningless; at a source they are not finite.
class HarmonicMap {
 public:
  /// Reads a map file, as `solidmap fit` writes them too. Throws Error (not_found, io, invalid_input, or unsupported
  /// for a newer format).
  static HarmonicMap load(const std::filesystem::path& path);
  /// Writes a map file, as a whole or not at all; the same map gives the same bytes. Throws Error (io).
  void save(const std::filesystem::path& path) const;

  /// Images of the points, in order. Evaluate many points in one call, on all cores: a million points with 100 000
  /// sources take about a second, while a point by itself costs a sum over all sources.
  std::vector<Point> evaluate(Span<const Point> points) const;
  /// The same into `images`, of the same size; throws Error (invalid_input) otherwise. `images` may overlap `points`,
  /// which are copied then.
  void evaluate(Span<const Point> points, Span<Point> images) const;
  /// The image of one point: costs a sum over all sources.
  Point operator()(const Point& point) const;

  /// Jacobians at the points, `∂f_i/∂x_k` at `3 i + k`.
  std::vector<Matrix3> jacobian(Span<const Point> points) const;
  void jacobian(Span<const Point> points, Span<Matrix3> jacobians) const;
  /// Both, in little more time than the Jacobians alone. The two ranges of results must not overlap.
  void evaluate_with_jacobian(Span<const Point> points, Span<Point> images, Span<Matrix3> jacobians) const;

  /// The boundary map that was fitted, its domain repaired. Throws Error (unsupported) when the file has none.
  BoundaryMap boundary() const;
  /// How the map was made and how good it is. Throws Error (unsupported) when its file has no report.
  FitReport report() const;
  BoundaryError boundary_error() const { return report().boundary_error; }
  /// The metadata of its map file: format, generator, inputs, report; one line of JSON.
  std::string metadata() const;

  /// Positions `Q` of the sources, their coefficients `w`, and the coefficients of the functions 1, x, y, z (four rows,
  /// `A`). Views, valid as long as this object or a copy lives; of a temporary, copies.
  Span<const Point> sources() const&;
  Span<const Point> coefficients() const&;
  Span<const Point> affine() const&;
  std::vector<Point> sources() &&;
  std::vector<Point> coefficients() &&;
  std::vector<Point> affine() &&;

 private:
  friend struct detail::Access;
  explicit HarmonicMap(std::shared_ptr<const detail::HarmonicMapImpl> impl) : impl_(std::move(impl)) {}
  std::shared_ptr<const detail::HarmonicMapImpl> impl_;
};

/// How preimages are searched for.
struct InverseOptions {
  /// Largest `|f(x) - y|` of a preimage, as a fraction of the target's diagonal; at most 1e-3.
  double tolerance = 1e-10;
  /// Nodes of the mesh that the search starts from, at most a million: folds smaller than its cells may be missed.
  std::size_t seed_nodes = 30'000;
  /// Largest number of steps of Newton's method.
  std::size_t iterations = 60;
};

/// What was found for a point of the target.
struct Preimage {
  enum class Status {
    /// One preimage.
    ok,
    /// Several, of which the one with the largest `det J` is given; or one where the map inverts orientation; or one
    /// that cannot be the only one.
    folded,
    /// Not in the target, and without a preimage.
    outside,
    /// In the target, but no preimage was found.
    not_converged,
    /// A coordinate is NaN or infinite.
    not_finite,
  };
  Status status = Status::not_converged;
  /// The preimage; without one, a point of the domain whose image is near, or NaN.
  Point point = {};
  /// `|f(x) - y|` over the target's diagonal; infinite without a preimage.
  double round_trip = 0;
  /// Number of different preimages that were found.
  std::size_t preimages = 0;
  /// Whether the preimage lies outside the domain, by no more than the boundary error explains.
  bool beyond_boundary = false;
};

/// The inverse of a map, made once for many points. Immutable; copies are free; may be called from several threads at
/// once.
class Inverse {
 public:
  /// Maps the mesh that searches start from, which takes about a second on two cores. Throws Error (invalid_input;
  /// unsupported without a boundary map).
  explicit Inverse(const HarmonicMap& map, const InverseOptions& options = {});

  /// Preimages of the points, in order. Search for many in one call, on all cores: about 10 µs per point and core. Throws
  /// Error (cancelled).
  std::vector<Preimage> operator()(Span<const Point> points, const ProgressCallback& progress = {}) const;

 private:
  std::shared_ptr<const detail::InverseImpl> impl_;
};

/// How energies are measured.
struct EnergyOptions {
  /// Grid cells along the longest side of the domain, clipped by its surface; they are divided where the densities vary.
  std::size_t cells = 48;
  /// Largest error of the energies by integration, as a fraction of them; infinity to divide no cells.
  double tolerance = 0.01;
  /// Scale both solids to unit volume first, so that energies of different solids compare; the identity then has
  /// harmonic energy 3.
  bool normalize = true;
  /// Lamé's constants of the deformation energy.
  double lambda = 0.0335, mu = 0.0224;
};

/// Quantiles over the volume of the domain.
struct Distribution {
  double min = 0, median = 0, p99 = 0, max = 0;
};

/// Integrals over the domain, and how the densities are distributed.
struct EnergyReport {
  /// Integral of the Jacobian's squared Frobenius norm.
  double harmonic = 0;
  /// Integral of the elastic energy ½ σ : ε by Hooke's law, with Green's strain ε = JᵀJ − I.
  double deformation = 0;
  /// Estimated errors of both by integration; NaN for integrals over a mesh.
  double harmonic_error = 0, deformation_error = 0;
  /// Volumes of the domain and of the target, model units.
  double volume = 0, target_volume = 0;
  Distribution harmonic_density, deformation_density;
  /// Determinant of the Jacobian, in model units also when energies are normalised.
  Distribution det_jacobian;
  /// Points of the quadrature where the map is folded (`det J` is zero or has not the sign of the target's orientation),
  /// the fraction of the domain's volume that they stand for, and the estimated error of that; NaN for integrals over a
  /// mesh. certify() proves bounds of it.
  std::size_t folded_points = 0;
  double folded_fraction = 0, folded_error = 0;
  /// Where the map is folded, the largest place first, then where its harmonic energy density is largest; at most five.
  std::vector<WorstPlace> worst_places;
};

/// Energies of a map, integrated on a grid, or over the cells of a mesh, which must be a mesh of the domain: that is not
/// checked. Tetrahedra get four points each, hexahedra eight, the Gauss points of their trilinear map. Throws Error
/// (invalid_input: no volume, no cells, no tolerance; numerical: a Jacobian that is not finite; unsupported: no
/// boundary map; cancelled).
EnergyReport energies(const HarmonicMap& map, const EnergyOptions& options = {}, const ProgressCallback& progress = {});
EnergyReport energies(const HarmonicMap& map, const CellMesh& mesh, const EnergyOptions& options = {},
                      const ProgressCallback& progress = {});

/// Densities of the two energies, and the determinant of the map's Jacobian in model units, one for each point.
struct EnergyDensities {
  std::vector<double> harmonic, deformation, det_jacobian;
};

/// Energy densities at any points of the domain, such as those of a PlaneSection; not finite where the Jacobian is not.
/// `options.cells` is not used. Throws Error (invalid_input; unsupported: no boundary map).
EnergyDensities energy_densities(const HarmonicMap& map, Span<const Point> points, const EnergyOptions& options = {});

/// How far cells are divided to prove where a map folds.
struct CertificateOptions {
  /// Cells along the longest side of the domain at the finest level; rounded up to a power of two, 2 to 2²⁰.
  std::size_t finest = 4096;
  /// Largest number of cells, of 2 KB each while they may be divided.
  std::size_t max_cells = 1'000'000;
  /// Stops when at most this fraction of the volume is undecided.
  double undecided = 0;
};

/// The cells with one verdict: how many, in how many connected groups, their volume, and that as a fraction of the
/// domain's.
struct VerdictTotals {
  std::size_t cells = 0, places = 0;
  double volume = 0, fraction = 0;
};

/// What is proved of the sign of `det J` over a domain.
struct CertificateReport {
  /// Cells where the map is proved to be locally one to one, proved to be folded, and all others. Groups of positive cells
  /// are not counted.
  VerdictTotals positive, folded, undecided;
  /// Fraction of the volume in undecided cells with `det J` negative at their centre.
  double undecided_negative = 0;
  /// The smallest singular value is at least this over 99 % of the volume; NaN where less is proved.
  double sigma_min_99 = 0;
  /// Whether the map is proved to be locally one to one everywhere.
  bool locally_one_to_one = false;
  /// Parts of the domain that the map turns inside out as a whole, and how many parts there are (0 where they were not
  /// looked for, since nothing is folded).
  std::size_t mirrored_parts = 0, parts = 0;
  /// Where it folds, then where it is undecided, the largest place of each first; at most five.
  std::vector<WorstPlace> worst_places;
};

/// Proves where a map is locally one to one, and where it folds, by bounds of its Jacobian over the cells of an octree.
/// Some 20 µs for each cell. Throws Error (invalid_input; unsupported: no boundary map; cancelled).
CertificateReport certify(const HarmonicMap& map, const CertificateOptions& options = {},
                          const ProgressCallback& progress = {});

/// Where the map misses its boundary map most: groups of triangles of the domain, the largest error first. Throws Error
/// (unsupported: no boundary map).
std::vector<WorstPlace> worst_boundary_errors(const HarmonicMap& map, std::size_t most = 5);

/// Means of the metrics of Cherchi & Livesu, VOLMAP (2023), over the volume where the map is regular.
struct Distortion {
  /// A rigid motion has 1, 3, 6, 0 and 1. NaN when the map is regular nowhere.
  double conformal = 0, dirichlet = 0, symmetric_dirichlet = 0, arap = 0, mips = 0;
};

struct DistortionReport {
  /// Means for the map as it is, and with the target scaled to the volume of the domain.
  Distortion mean, mean_normalized;
  /// Points where the map is folded or not finite, and the fraction of the volume that the means leave out.
  std::size_t folded_points = 0;
  double left_out_fraction = 0;
};

/// Distortion of a map, integrated on a grid of `cells` cells along the longest side, or over the cells of a mesh. Throws
/// Error as energies().
DistortionReport distortion(const HarmonicMap& map, std::size_t cells = 48, const ProgressCallback& progress = {});
DistortionReport distortion(const HarmonicMap& map, const CellMesh& mesh, const ProgressCallback& progress = {});

}  // namespace solidmap

/// \file
/// From boundary maps to harmonic maps.
#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "solidmap/boundary_map.hpp"
#include "solidmap/harmonic_map.hpp"
#include "solidmap/mesh.hpp"
#include "solidmap/progress.hpp"
#include "solidmap/span.hpp"

namespace solidmap {

namespace detail {
struct FactorImpl;
struct FrameEvaluatorImpl;
}

/// Where the sources are placed.
struct Placement {
  enum class Kind {
    /// Along the vertex normals, at `value` times the local spacing of the sources; 1 to 1.5 is usual.
    adaptive,
    /// On an offset surface at `value` times the domain's diagonal; 0.02 to 0.2 is usual. Needs CGAL (has_native()).
    offset,
    /// On a sphere around the domain, of radius `value` times its diagonal; more than 0.5.
    sphere,
  };
  Kind kind = Kind::adaptive;
  double value = 1.0;
};

/// How the least-squares system is solved.
enum class Solver {
  /// Iterations with a Schwarz preconditioner: time and memory are linear in the number of sources. Adaptive placement
  /// only.
  schwarz,
  /// Dense decompositions, for a few thousand sources: time grows with the cube of their number. FitOptions::dense()
  /// sets such a limit.
  qr,
  svd,
};

/// Settings of a fit. The defaults suit almost every case; set `tolerance`.
struct FitOptions {
  /// Boundary error to reach on 99 % of the area, as a fraction of the target's diagonal.
  double tolerance = 1e-3;
  /// Largest boundary error to reach anywhere, as a multiple of the tolerance. Infinity: no such limit.
  double max_error_ratio = 20;
  /// Largest boundary error to reach anywhere, as a multiple of the spacing of the image's vertices around (LocalError).
  /// Infinity: no such limit.
  double max_local_error = std::numeric_limits<double>::infinity();
  /// Whether fit() adds sources where the error exceeds the tolerance. Solver::schwarz only.
  bool refine = true;
  /// Whether fit() and Factor::refined_for() move the sources, from where they are placed to where the residual is least: for
  /// maps of few sources. Solver::qr or svd, at most 1000 sources, and at least two collocation points for each, better 16
  /// (`collocation_ratio` over `source_ratio`). Takes some hundred times as long as with fixed ones. FitOptions::with_free_sources() sets it.
  bool free_sources = false;
  /// Largest number of sources, refinement included.
  std::size_t max_sources = 2'000'000;
  /// Largest number of sources after refinement, per boundary vertex; 50 000 are allowed in any case. Infinity: no limit.
  double max_source_ratio = 16;
  /// Bytes that a fit may need, estimated before they are taken: more throws Error (memory), and refinement ends there.
  /// std::nullopt: nine tenths of what is available at the start.
  std::optional<std::uint64_t> memory;
  Placement placement;
  /// Sources per boundary vertex; at most 1 with adaptive placement.
  double source_ratio = 1.0;
  /// Collocation points per boundary vertex; at least `source_ratio`.
  double collocation_ratio = 3.0;
  /// Whether affine functions are in the basis, so that affine maps are reproduced exactly; not so in Li et al. 2007.
  bool affine = true;
  Solver solver = Solver::schwarz;
  /// Largest number of iterations of Solver::schwarz, in each round of refinement.
  std::size_t max_iterations = 20;
  /// Dense solvers: singular values or pivots below this fraction of the largest count as zero.
  double truncation = 1e-10;
  /// Number of held-out boundary points at which the boundary error is measured.
  std::size_t held_out = 20'000;
  /// Seed of all random choices.
  std::uint64_t seed = 1;

  /// The same as FitOptions().
  static FitOptions adaptive();
  /// A dense decomposition with at most 5000 sources.
  static FitOptions dense();
  /// As dense(), with free sources and 16 collocation points for each. Set `max_sources`, unless the domain has few vertices.
  static FitOptions with_free_sources();
  /// The settings of Li et al. 2007, but with the affine functions: sources on an offset surface, 0.6 for each vertex,
  /// a collocation point at each vertex, singular value decomposition, at most 3000 sources. Needs CGAL (has_native()).
  static FitOptions paper();
};

/// Fits the harmonic map that carries the boundary of the domain as `boundary` does. About 4 s and 0.7 GB for 100 000
/// vertices on two cores. When the tolerance is not met within the limits the best map is returned: see
/// HarmonicMap::boundary_error().
///
/// The same input gives the same bits with the same number of threads; with another, images differ by some 1e-8 of the
/// diagonal. All cores are used; the environment variable RAYON_NUM_THREADS, read at the first call, sets the number.
///
/// Throws Error: invalid_input (a domain that bounds no solid, an option out of range), memory, numerical, cancelled,
/// unsupported (Placement::Kind::offset without CGAL).
HarmonicMap fit(const BoundaryMap& boundary, const FitOptions& options = {}, const ProgressCallback& progress = {});

/// A domain with its sources placed and its system factored, for any number of boundary maps. A further map takes about
/// a third of the time of the first fit. Immutable; copies are free; all functions may be called from several threads.
class Factor {
 public:
  /// As many sources as `source_ratio` asks for, without refinement. Throws Error as fit().
  explicit Factor(const Surface& domain, const FitOptions& options = {}, const ProgressCallback& progress = {});
  /// Refined until the tolerance is met for this boundary map, as by fit(): for a sequence of similar maps. The map
  /// itself is stored in `first`, if given.
  static Factor refined_for(const BoundaryMap& boundary, const FitOptions& options = {},
                            const ProgressCallback& progress = {}, std::optional<HarmonicMap>* first = nullptr);

  /// The domain as it was given; copies it.
  Surface domain() const;

  /// The map for other images of the domain's vertices, or for another boundary map of it. No sources are added: check
  /// the map's boundary_error(). Throws Error (invalid_input: another domain, wrong counts; numerical; cancelled).
  HarmonicMap solve(Span<const Point> images, const ProgressCallback& progress = {}) const;
  HarmonicMap solve(const BoundaryMap& boundary, const ProgressCallback& progress = {}) const;

  /// The maps for many frames together, which share all kernel values: a fifth of the time of solving one by one when
  /// frames move alike. `frames` are the images of all vertices, frame after frame. Takes about 240 bytes per frame for
  /// each source and collocation point. Throws Error as solve(), and memory.
  std::vector<HarmonicMap> solve_many(Span<const Point> frames, const ProgressCallback& progress = {}) const;
  std::vector<HarmonicMap> solve_many(Span<const BoundaryMap> boundaries, const ProgressCallback& progress = {}) const;

 private:
  friend struct detail::Access;
  explicit Factor(std::shared_ptr<const detail::FactorImpl> impl) : impl_(std::move(impl)) {}
  std::shared_ptr<const detail::FactorImpl> impl_;
};

/// The images of fixed points in one frame, and how far they can be trusted.
struct FrameImages {
  /// Where the points go: an image for each, in the same order.
  std::vector<Point> images;
  /// Root mean square of the map's distance from the frame at held-out points of the boundary, over the diagonal of the
  /// frame's bounding box: at most that.
  double boundary_rms = 0;
  /// The largest distance between the frame and what was solved for in its place, over the same diagonal. By the maximum
  /// principle, it changes no image inside by more.
  double left_out = 0;
  /// Modes that were solved for, up to three; with none, the frame was a combination of earlier ones.
  std::size_t solved = 0;
};

/// Images of fixed points inside a domain for one frame after the other. What frames have in common is solved for once: the
/// first cost as much as Factor::solve(), those that move as combinations of earlier ones some milliseconds for 20 000 points.
/// Keeps 8 bytes per mode for each vertex, point and held-out point. Copies share their modes; all functions may be called from
/// several threads, which wait for each other.
class FrameEvaluator {
 public:
  /// For points inside the domain. At most `most_modes` modes are kept, or the four affine functions; frames that need
  /// others are solved for one by one.
  FrameEvaluator(const Factor& factor, Span<const Point> points, std::size_t most_modes = 300);

  /// The images of the points under the map that carries the domain's vertices to `images`. Throws Error as Factor::solve().
  FrameImages evaluate(Span<const Point> images, const ProgressCallback& progress = {}) const;

  /// How many modes are kept.
  std::size_t modes() const;

 private:
  friend struct detail::Access;
  std::shared_ptr<const detail::FrameEvaluatorImpl> impl_;
};

}  // namespace solidmap

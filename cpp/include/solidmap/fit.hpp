/// \file
/// From boundary maps to harmonic maps.
#pragma once

#include <cstddef>
#include <cstdint>
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
}

/// Where the sources stand.
struct Placement {
  enum class Kind {
    /// Along the vertex normals, at `value` times the local spacing of the sources; 1 to 1.5 is good.
    adaptive,
    /// On an offset surface at `value` times the domain's diagonal; 0.02 to 0.2. Needs CGAL (has_native()).
    offset,
    /// On a sphere of `value` times the domain's diagonal; more than 0.5.
    sphere,
  };
  Kind kind = Kind::adaptive;
  double value = 1.0;
};

/// How the least-squares system is solved.
enum class Solver {
  /// Iterations preconditioned by local solves: time and memory grow with the number of sources. Adaptive placement only.
  schwarz,
  /// Dense decompositions, for a few thousand sources: time grows with the cube of their number.
  qr,
  svd,
};

/// Settings of a fit. The defaults are right for almost everything; `tolerance` is what to set.
struct FitOptions {
  /// Boundary error to reach on 99 % of the area, as a fraction of the target's diagonal.
  double tolerance = 1e-3;
  /// Whether fit() adds sources where the error is larger than that. Solver::schwarz only.
  bool refine = true;
  /// Sources at most, also of refinement.
  std::size_t max_sources = 2'000'000;
  /// Bytes that a fit may need, estimated before they are taken: more throws Error (memory), and refinement ends there.
  /// None: nine tenths of what is available at the start.
  std::optional<std::uint64_t> memory;
  Placement placement;
  /// Sources per boundary vertex; at most 1 with adaptive placement.
  double source_ratio = 1.0;
  /// Boundary points with equations per boundary vertex; at least `source_ratio`.
  double collocation_ratio = 3.0;
  /// Whether affine functions are in the basis, so that affine maps come out exactly; off, it is the paper's.
  bool affine = true;
  Solver solver = Solver::schwarz;
  /// Iterations of Solver::schwarz at most, in each round.
  std::size_t max_iterations = 20;
  /// Singular values or pivots below this fraction of the largest are cut off by dense solvers.
  double truncation = 1e-10;
  /// Boundary points that the error is averaged over.
  std::size_t held_out = 20'000;
  /// Seed of everything random.
  std::uint64_t seed = 1;

  /// What FitOptions() is.
  static FitOptions adaptive();
  /// A dense decomposition with at most 5000 sources.
  static FitOptions dense();
  /// The settings of Li et al. 2007: offset surface, no overdetermination, singular values. Needs CGAL (has_native()).
  static FitOptions paper();
};

/// Fits the harmonic map that carries the boundary of the domain as `boundary` does. About 4 s and 0.7 GB for 100 000
/// vertices on two cores. When the tolerance is not met within the limits the best map is returned: see
/// HarmonicMap::boundary_error().
///
/// Results do not depend on the order of evaluation; they may differ in the last digits between numbers of threads. All
/// cores are used; the environment variable RAYON_NUM_THREADS, read at the first call, sets another number.
///
/// Throws Error: invalid_input (a domain that bounds no solid, an option out of range), memory, numerical, cancelled,
/// unsupported (Placement::Kind::offset without CGAL).
HarmonicMap fit(const BoundaryMap& boundary, const FitOptions& options = {}, const ProgressCallback& progress = {});

/// A domain made ready: sources placed and the system factored, for any number of boundary maps of it. A further map takes
/// about a third of the time of a first fit. Immutable; copies are free; all functions may be called from several threads.
class Factor {
 public:
  /// One level of sources, as fine as the domain's vertices. Throws Error as fit().
  explicit Factor(const Surface& domain, const FitOptions& options = {}, const ProgressCallback& progress = {});
  /// Refined until this boundary map meets the tolerance, as fit() does: for a sequence of similar maps. The map itself is
  /// in `first`, if given.
  static Factor refined_for(const BoundaryMap& boundary, const FitOptions& options = {},
                            const ProgressCallback& progress = {}, std::optional<HarmonicMap>* first = nullptr);

  /// The domain as it was given; copies it.
  Surface domain() const;

  /// The map for other images of the domain's vertices, or for another boundary map of it. Adds no sources: look at its
  /// boundary_error(). Throws Error (invalid_input: another domain, counts; numerical; cancelled).
  HarmonicMap solve(Span<const Point> images, const ProgressCallback& progress = {}) const;
  HarmonicMap solve(const BoundaryMap& boundary, const ProgressCallback& progress = {}) const;

  /// The maps for many at once, which share all kernel values: a fifth of the time of one by one for frames that move
  /// alike. `frames` are the images of all vertices, frame after frame. Needs some 240 bytes for each frame and point.
  std::vector<HarmonicMap> solve_many(Span<const Point> frames, const ProgressCallback& progress = {}) const;
  std::vector<HarmonicMap> solve_many(Span<const BoundaryMap> boundaries, const ProgressCallback& progress = {}) const;

 private:
  friend struct detail::Access;
  explicit Factor(std::shared_ptr<const detail::FactorImpl> impl) : impl_(std::move(impl)) {}
  std::shared_ptr<const detail::FactorImpl> impl_;
};

}  // namespace solidmap

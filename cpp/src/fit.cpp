#include "solidmap/fit.hpp"

#include "access.hpp"

namespace solidmap {

using namespace detail;

ffi::FitOptions detail::for_rust(const FitOptions& options) {
  if (options.memory == std::uint64_t{0}) {
    throw Error(Category::invalid_input,
                "memory is 0 bytes, but must be positive, or std::nullopt for nine tenths of the available memory");
  }
  require_one_of("placement.kind", options.placement.kind, Placement::Kind::sphere);
  require_one_of("solver", options.solver, Solver::svd);
  ffi::FitOptions to = {};
  to.placement = static_cast<std::uint8_t>(options.placement.kind);
  to.placement_value = options.placement.value;
  to.source_ratio = options.source_ratio;
  to.collocation_ratio = options.collocation_ratio;
  to.max_sources = options.max_sources;
  to.max_source_ratio = options.max_source_ratio;
  to.affine = options.affine;
  to.solver = static_cast<std::uint8_t>(options.solver);
  to.most_iterations = options.max_iterations;
  to.truncation = options.truncation;
  to.tolerance = options.tolerance;
  to.max_error_ratio = options.max_error_ratio;
  to.max_local_error = options.max_local_error;
  to.refine = options.refine;
  to.free_sources = options.free_sources;
  to.memory = options.memory.value_or(0);
  to.held_out = options.held_out;
  to.seed = options.seed;
  return to;
}

FitOptions detail::converted(const ffi::FitOptions& from) {
  FitOptions options;
  options.placement.kind = static_cast<Placement::Kind>(from.placement);
  options.placement.value = from.placement_value;
  options.source_ratio = from.source_ratio;
  options.collocation_ratio = from.collocation_ratio;
  options.max_sources = from.max_sources;
  options.max_source_ratio = from.max_source_ratio;
  options.affine = from.affine;
  options.solver = static_cast<Solver>(from.solver);
  options.max_iterations = from.most_iterations;
  options.truncation = from.truncation;
  options.tolerance = from.tolerance;
  options.max_error_ratio = from.max_error_ratio;
  options.max_local_error = from.max_local_error;
  options.refine = from.refine;
  options.free_sources = from.free_sources;
  if (from.memory > 0) options.memory = from.memory;
  options.held_out = from.held_out;
  options.seed = from.seed;
  return options;
}

namespace {

Factor make_factor(rust::Box<ffi::Factored> box) { return Access::make<Factor, FactorImpl>(std::move(box)); }

std::vector<HarmonicMap> taken(rust::Box<ffi::Maps> maps) {
  std::vector<HarmonicMap> taken;
  taken.reserve(maps->len());
  for (std::size_t i = 0; i < maps->len(); ++i) taken.push_back(make_map(maps->take(i)));
  return taken;
}

}  // namespace

FitOptions FitOptions::adaptive() { return converted(ffi::fit_defaults(0)); }
FitOptions FitOptions::dense() { return converted(ffi::fit_defaults(1)); }
FitOptions FitOptions::paper() { return converted(ffi::fit_defaults(2)); }
FitOptions FitOptions::with_free_sources() { return converted(ffi::fit_defaults(3)); }

HarmonicMap fit(const BoundaryMap& boundary, const FitOptions& options, const ProgressCallback& progress) {
  return watched(progress, [&](const Watcher& watcher) {
    return make_map(ffi::fit(Access::of(boundary), for_rust(options), watcher));
  });
}

Factor::Factor(const Surface& domain, const FitOptions& options, const ProgressCallback& progress)
    : Factor(watched(progress, [&](const Watcher& watcher) {
        return make_factor(ffi::factor_new(Access::of(domain), for_rust(options), watcher));
      })) {}

Factor Factor::refined_for(const BoundaryMap& boundary, const FitOptions& options, const ProgressCallback& progress,
                           std::optional<HarmonicMap>* first) {
  return watched(progress, [&](const Watcher& watcher) {
    Factor factor = make_factor(ffi::factor_refined(Access::of(boundary), for_rust(options), watcher));
    if (first != nullptr) *first = make_map(Access::of(factor).first());
    return factor;
  });
}

Surface Factor::domain() const {
  return guarded([&] { return make_surface(Access::of(*this).domain()); });
}

HarmonicMap Factor::solve(Span<const Point> images, const ProgressCallback& progress) const {
  return watched(progress, [&](const Watcher& watcher) {
    return make_map(Access::of(*this).solve_images(flat(images), watcher));
  });
}

HarmonicMap Factor::solve(const BoundaryMap& boundary, const ProgressCallback& progress) const {
  return watched(progress, [&](const Watcher& watcher) {
    return make_map(Access::of(*this).solve(Access::of(boundary), watcher));
  });
}

std::vector<HarmonicMap> Factor::solve_many(Span<const Point> frames, const ProgressCallback& progress) const {
  return watched(progress, [&](const Watcher& watcher) {
    return taken(Access::of(*this).solve_many_images(flat(frames), watcher));
  });
}

std::vector<HarmonicMap> Factor::solve_many(Span<const BoundaryMap> boundaries, const ProgressCallback& progress) const {
  return watched(progress, [&](const Watcher& watcher) {
    rust::Box<ffi::Boundaries> all = ffi::no_boundaries();
    for (const BoundaryMap& boundary : boundaries) all->push(Access::of(boundary));
    return taken(Access::of(*this).solve_many(*all, watcher));
  });
}

FrameEvaluator::FrameEvaluator(const Factor& factor, Span<const Point> points, std::size_t most_modes)
    : impl_(guarded([&] {
        return Access::held<FrameEvaluatorImpl>(ffi::frames_new(Access::of(factor), flat(points), most_modes));
      })) {}

FrameImages FrameEvaluator::evaluate(Span<const Point> images, const ProgressCallback& progress) const {
  const ffi::FrameImages found = watched(progress, [&](const Watcher& watcher) {
    return Access::of(*this).evaluate(flat(images), watcher);
  });
  FrameImages frame;
  frame.images.resize(found.images.size() / 3);
  for (std::size_t i = 0; i < found.images.size(); ++i) frame.images[i / 3][i % 3] = found.images[i];
  frame.boundary_rms = found.boundary_rms;
  frame.left_out = found.left_out;
  frame.solved = found.solved;
  return frame;
}

std::size_t FrameEvaluator::modes() const {
  return guarded([&] { return Access::of(*this).modes(); });
}

}  // namespace solidmap

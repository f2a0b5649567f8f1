#include "solidmap/bijective_map.hpp"

#include <limits>

#include "access.hpp"

namespace solidmap {

using namespace detail;

namespace {

BijectiveMap make_bijective(rust::Box<ffi::Bijective> box) {
  return Access::make<BijectiveMap, BijectiveMapImpl>(std::move(box));
}

}  // namespace

BijectiveMap BijectiveMap::make(const HarmonicMap& map, const CellMesh& mesh, const BijectiveOptions& options,
                                const ProgressCallback& progress) {
  const std::size_t most_added = options.most_added.value_or(std::numeric_limits<std::size_t>::max());
  return watched(progress, [&](const Watcher& watcher) {
    return make_bijective(ffi::bijective_new(Access::of(map), Access::of(mesh), options.tolerance, most_added,
                                             options.effort, options.memory, watcher));
  });
}

std::optional<BijectiveMap> BijectiveMap::of(const HarmonicMap& map) {
  return guarded([&]() -> std::optional<BijectiveMap> {
    if (!Access::of(map).has_bijective()) return std::nullopt;
    return make_bijective(ffi::bijective_of(Access::of(map)));
  });
}

void BijectiveMap::save(const HarmonicMap& map, const std::filesystem::path& path) const {
  guarded([&] { Access::of(*this).save(Access::of(map), PathBytes(path)); });
}

std::vector<Point> BijectiveMap::evaluate(Span<const Point> points) const {
  std::vector<Point> images(points.size());
  evaluate(points, images);
  return images;
}

void BijectiveMap::evaluate(Span<const Point> points, Span<Point> images) const {
  const Unaliased given(points, images);
  guarded([&] { Access::of(*this).evaluate(flat(given.view()), flat(images)); });
}

std::vector<Matrix3> BijectiveMap::jacobian(Span<const Point> points) const {
  std::vector<Matrix3> jacobians(points.size());
  jacobian(points, jacobians);
  return jacobians;
}

void BijectiveMap::jacobian(Span<const Point> points, Span<Matrix3> jacobians) const {
  const Unaliased given(points, jacobians);
  guarded([&] { Access::of(*this).jacobian(flat(given.view()), flat(jacobians)); });
}

std::vector<Preimage> BijectiveMap::preimages(Span<const Point> points) const {
  return guarded([&] { return detail::converted(Access::of(*this).preimages(flat(points))); });
}

BijectiveReport BijectiveMap::report() const {
  const ffi::BijectiveReport found = guarded([&] { return Access::of(*this).report(); });
  BijectiveReport report;
  report.tets = found.tets;
  report.nodes = found.nodes;
  report.boundary_nodes = found.boundary_nodes;
  report.inverted_as_mapped = found.inverted_as_mapped;
  report.cells_added = found.cells_added;
  report.min_scaled_jacobian = found.min_scaled_jacobian;
  report.difference_rms = found.difference_rms;
  report.difference_max = found.difference_max;
  report.difference_place = found.difference_place;
  report.gap = found.gap;
  report.boundary_one_to_one = found.boundary_one_to_one;
  return report;
}

CellMesh BijectiveMap::domain() const {
  return guarded([&] { return make_cells(Access::of(*this).domain()); });
}

CellMesh BijectiveMap::target() const {
  return guarded([&] { return make_cells(Access::of(*this).target()); });
}

}  // namespace solidmap

#include "solidmap/boundary_map.hpp"

#include <utility>

#include "access.hpp"

namespace solidmap {

using namespace detail;

BoundaryMap::BoundaryMap(const Surface& domain, Span<const Point> images)
    : BoundaryMap(guarded([&] { return make_boundary(ffi::boundary_new(Access::of(domain), flat(images))); })) {}

BoundaryMap BoundaryMap::between(const Surface& domain, const Surface& image) {
  return guarded([&] { return make_boundary(ffi::boundary_between(Access::of(domain), Access::of(image))); });
}

BoundaryMap BoundaryMap::to_sphere(const Surface& domain, SphereEnergy energy, const ProgressCallback& progress) {
  require_one_of("energy", energy, SphereEnergy::conformal);
  const bool conformal = energy == SphereEnergy::conformal;
  return watched(progress, [&](const Watcher& watcher) {
    return make_boundary(ffi::boundary_to_sphere(Access::of(domain), conformal, watcher));
  });
}

BoundaryMap BoundaryMap::to_torus(const Surface& domain, const ProgressCallback& progress) {
  return watched(progress, [&](const Watcher& watcher) {
    return make_boundary(ffi::boundary_to_torus(Access::of(domain), watcher));
  });
}

BoundaryMap BoundaryMap::pair(const Surface& domain, const Surface& target, const PairOptions& options,
                              const ProgressCallback& progress, PairReport* report) {
  ffi::PairReport found = {};
  BoundaryMap map = watched(progress, [&](const Watcher& watcher) {
    const Span<const std::array<std::uint32_t, 2>> landmarks(options.landmarks), components(options.components);
    rust::Vec<std::uint32_t> loop_vertices, loop_lengths;
    for (const auto& pair : options.loops)
      for (const std::vector<std::uint32_t>& loop : pair) {
        loop_lengths.push_back(static_cast<std::uint32_t>(loop.size()));
        for (const std::uint32_t vertex : loop) loop_vertices.push_back(vertex);
      }
    const ffi::PairOptions how = {options.conformal, options.landmarks_weight, options.domain_up, options.target_up,
                                  options.most_stretched, options.aligned, options.improve,
                                  std::move(loop_vertices), std::move(loop_lengths)};
    return make_boundary(
        ffi::boundary_pair(Access::of(domain), Access::of(target), flat(landmarks), flat(components), how, watcher, found));
  });
  if (report != nullptr) {
    report->angle_median = found.angle_median;
    report->angle_p99 = found.angle_p99;
    report->area_median = found.area_median;
    report->area_p99 = found.area_p99;
    report->stretched = found.stretched;
    report->target_stretched = found.target_stretched;
    report->looks_wrong = found.looks_wrong;
    report->isometry_defect = found.isometry_defect;
    report->landmark_error = found.landmark_error;
    report->components.assign(found.components.begin(), found.components.end());
    report->seconds = found.seconds;
    report->warnings = copied(found.warnings);
  }
  return map;
}

BoundaryMap BoundaryMap::improved(const ImproveOptions& options, const ProgressCallback& progress,
                                  ImproveReport* report) const {
  ffi::ImproveReport found = {};
  BoundaryMap map = watched(progress, [&](const Watcher& watcher) {
    const ffi::ImproveOptions how = {options.max_distortion, options.rounds, options.tolerance};
    return make_boundary(Access::of(*this).improved(how, watcher, found));
  });
  if (report != nullptr) {
    report->energies.assign(found.energies.begin(), found.energies.end());
    report->rounds = found.rounds;
    report->end = static_cast<ImproveReport::End>(found.end);
    report->distortion_before = found.distortion_before;
    report->distortion_after = found.distortion_after;
    report->boundary_error_before = found.boundary_error_before;
    report->boundary_error_after = found.boundary_error_after;
    report->warnings = copied(found.warnings);
  }
  return map;
}

BoundaryMap BoundaryMap::load(const std::filesystem::path& path) {
  return guarded([&] { return make_boundary(ffi::boundary_load(PathBytes(path))); });
}

void BoundaryMap::save(const std::filesystem::path& path) const {
  guarded([&] { Access::of(*this).save(PathBytes(path)); });
}

Surface BoundaryMap::domain() const {
  return guarded([&] { return make_surface(Access::of(*this).domain()); });
}

Surface BoundaryMap::target() const {
  return guarded([&] { return make_surface(Access::of(*this).target()); });
}

Span<const Point> BoundaryMap::images() const& { return rows<Point>(Access::of(*this).images()); }
std::vector<Point> BoundaryMap::images() && { return kept(static_cast<const BoundaryMap&>(*this).images()); }

double BoundaryMap::target_volume() const {
  return guarded([&] { return Access::of(*this).target_volume(); });
}

double BoundaryMap::target_diagonal() const {
  return guarded([&] { return Access::of(*this).target_diagonal(); });
}

std::vector<Point> BoundaryMap::evaluate(Span<const SurfacePoint> points) const {
  std::vector<std::uint32_t> triangles(points.size());
  std::vector<Point> barycentric(points.size());
  std::vector<Point> images(points.size());
  for (std::size_t i = 0; i < points.size(); ++i) {
    triangles[i] = points[i].triangle;
    barycentric[i] = points[i].barycentric;
  }
  guarded([&] {
    Access::of(*this).evaluate(slice(Span<const std::uint32_t>(triangles)), flat(Span<const Point>(barycentric)),
                               flat(Span<Point>(images)));
  });
  return images;
}

BoundaryMap BoundaryMap::inverse() const {
  return guarded([&] { return make_boundary(Access::of(*this).inverse()); });
}

}  // namespace solidmap

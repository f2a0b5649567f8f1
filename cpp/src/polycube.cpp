#include "solidmap/polycube.hpp"

#include "access.hpp"

namespace solidmap {

using namespace detail;

ffi::PolycubeOptions detail::for_rust(const PolycubeOptions& options) {
  return {options.smoothness,     options.feature_angle,
          options.most_added,     options.attempts,
          options.effort,         options.lattice_along,
          options.lattice_length, static_cast<std::uint8_t>(options.orientation)};
}

PolycubeOptions detail::converted(const ffi::PolycubeOptions& from) {
  return {from.smoothness,    from.feature_angle,  from.most_added,
          from.attempts,      from.effort,         from.lattice_along,
          from.lattice_length, static_cast<Orientation>(from.orientation)};
}

SurfaceDistortion detail::converted(const ffi::SurfaceDistortion& found) {
  return {found.angle_median, found.angle_p99, found.area_median, found.area_p99};
}

PolycubeMap detail::converted(const ffi::PolycubeMap& made) {
  const ffi::PolycubeReport found = made.report();
  PolycubeReport report;
  report.labels = static_cast<LabelSource>(found.labels);
  report.smoothness = found.smoothness;
  if (found.features[0] > 0) report.features = {found.features[0], found.features[1], found.features[2]};
  report.attempts = found.attempts;
  if (found.turn.size() == 9) {
    std::array<std::array<double, 3>, 3>& turn = report.turn.emplace();
    for (std::size_t i = 0; i < 9; ++i) turn[i / 3][i % 3] = found.turn[i];
  }
  report.charts = found.charts;
  report.corners = found.corners;
  report.planes = found.planes;
  if (found.lattice > 0) report.lattice = found.lattice;
  report.tets_given = found.tets_given;
  report.tets = found.tets;
  report.inverted_at_start = found.inverted_at_start;
  report.inverted_after_descent = found.inverted_after_descent;
  report.energy = found.energy;
  report.distortion = converted(found.distortion);
  const rust::Slice<const std::uint8_t> labels = made.labels();
  const rust::Vec<std::uint8_t> given_labels = made.given_labels();
  const rust::Vec<std::uint32_t> corners = made.given_boundary();
  std::vector<Triangle> given_boundary(corners.size() / 3);
  for (std::size_t i = 0; i < 3 * given_boundary.size(); ++i) given_boundary[i / 3][i % 3] = corners[i];
  return {make_cells(made.model()),
          make_cells(made.polycube()),
          kept(rows<Triangle>(made.boundary())),
          std::vector<std::uint8_t>(labels.begin(), labels.end()),
          std::move(given_boundary),
          std::vector<std::uint8_t>(given_labels.begin(), given_labels.end()),
          make_surface(made.polycube_surface()),
          make_surface(made.model_surface()),
          report};
}

PolycubeOptions PolycubeOptions::standard() { return converted(ffi::polycube_defaults()); }

PolycubeMap make_polycube(const CellMesh& model, const PolycubeOptions& options, const ProgressCallback& progress) {
  return watched(progress, [&](const Watcher& watcher) {
    return converted(*ffi::make_polycube(Access::of(model), for_rust(options), watcher));
  });
}

PolycubeMap make_polycube_with_labels(const CellMesh& model, Span<const Triangle> triangles,
                                      Span<const std::uint8_t> labels, const PolycubeOptions& options,
                                      const ProgressCallback& progress) {
  return watched(progress, [&](const Watcher& watcher) {
    return converted(*ffi::make_polycube_with_labels(
        Access::of(model), flat(triangles), rust::Slice<const std::uint8_t>(labels.data(), labels.size()),
        for_rust(options), watcher));
  });
}

}  // namespace solidmap

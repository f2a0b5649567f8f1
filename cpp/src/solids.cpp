#include "solidmap/solids.hpp"

#include <limits>

#include "access.hpp"

namespace solidmap {

using namespace detail;

CellMesh tetrahedralise(const Surface& surface, const TetOptions& options, const ProgressCallback& progress) {
  require_one_of("mesher", options.mesher, TetOptions::Mesher::cgal);
  ffi::TetOptions to = {};
  to.cgal = options.mesher == TetOptions::Mesher::cgal;
  to.radius_edge_ratio = options.radius_edge_ratio;
  to.min_dihedral = options.min_dihedral;
  to.max_volume = options.max_volume;
  to.cell_size = options.cell_size;
  to.facet_distance = options.facet_distance;
  to.feature_angle = options.feature_angle;
  to.time_limit = options.time_limit;
  to.memory = options.memory;
  return watched(progress, [&](const Watcher& watcher) {
    return make_cells(ffi::tetrahedralise(Access::of(surface), to, watcher));
  });
}

OffsetSurface offset_surface(const Surface& surface, double distance, const OffsetOptions& options,
                             const ProgressCallback& progress) {
  ffi::OffsetOptions to = {};
  to.alpha = options.alpha;
  to.rounds = options.rounds;
  to.retries = options.retries;
  to.min_fraction = options.min_fraction;
  to.max_triangles = options.max_triangles;
  ffi::OffsetReport found = {};
  Surface made = watched(progress, [&](const Watcher& watcher) {
    return make_surface(ffi::offset_surface(Access::of(surface), distance, to, watcher, found));
  });
  return {std::move(made), found.vertex_error, found.centroid_error, found.min_distance,
          found.genus,     found.components,   found.alpha,          found.raw_wrap};
}

ffi::RemeshOptions detail::for_rust(const RemeshOptions& options) {
  return {options.repair,
          options.slide,
          options.keep_boundary_map,
          options.polish,
          options.polish_valid,
          options.most_added.value_or(std::numeric_limits<std::size_t>::max()),
          options.effort,
          options.memory};
}

RemeshOptions detail::converted(const ffi::RemeshOptions& from) {
  RemeshOptions options;
  options.repair = from.repair;
  options.slide = from.slide;
  options.keep_boundary_map = from.keep_boundary_map;
  options.polish = from.polish;
  options.polish_valid = from.polish_valid;
  if (from.most_added != std::numeric_limits<std::size_t>::max()) options.most_added = from.most_added;
  options.effort = from.effort;
  options.memory = from.memory;
  return options;
}

Remeshed detail::converted(const ffi::RemeshResult& remeshed) {
  const ffi::RemeshReport found = remeshed.report();
  RemeshReport report;
  report.nodes = found.nodes;
  report.boundary_nodes = found.boundary_nodes;
  if (found.boundary_quads > 0) report.padding = Padding{found.padded_quads, found.boundary_quads};
  report.quality_as_mapped = quality_of(found.quality_as_mapped);
  report.inverted_as_mapped = report.quality_as_mapped.inverted;
  report.quality = quality_of(found.quality);
  report.polish = static_cast<PolishOutcome>(found.polish);
  report.mesh_to_target_max = found.mesh_to_target_max;
  report.mesh_to_target_mean = found.mesh_to_target_mean;
  report.target_to_mesh_max = found.target_to_mesh_max;
  report.target_to_mesh_mean = found.target_to_mesh_mean;
  report.volume = found.volume;
  report.target_volume = found.target_volume;
  if (found.other_boundary) {
    report.other_boundary = OtherBoundary{found.other_boundary_mean, found.other_boundary_largest};
  }
  report.largest_shift = found.largest_shift;
  report.slid_nodes = found.slid_nodes;
  report.largest_slide = found.largest_slide;
  report.cells_added = found.cells_added;
  report.boundary_edges_split = found.boundary_edges_split;
  report.boundary_cells_added = found.boundary_cells_added;
  report.from_finite_elements = found.from_finite_elements;
  report.seconds = found.seconds;
  report.worst_places = detail::converted(found.worst_places);
  return {make_cells(remeshed.mesh()), make_cells(remeshed.domain_mesh()), report};
}

Remeshed remesh(const HarmonicMap& map, const RegularMesh& cells, const RemeshOptions& options,
                const ProgressCallback& progress) {
  require_one_of("kind", cells.kind, CellKind::hexes);
  return watched(progress, [&](const Watcher& watcher) {
    return converted(*ffi::remesh_regular(Access::of(map), cells.kind == CellKind::hexes, cells.along,
                                         cells.length, cells.max_cells, for_rust(options), watcher));
  });
}

Remeshed remesh(const HarmonicMap& map, const CellMesh& mesh, const RemeshOptions& options,
                const ProgressCallback& progress) {
  return watched(progress, [&](const Watcher& watcher) {
    return converted(*ffi::remesh_given(Access::of(map), Access::of(mesh), for_rust(options), watcher));
  });
}

}  // namespace solidmap

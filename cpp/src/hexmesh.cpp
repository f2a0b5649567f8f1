#include "solidmap/hexmesh.hpp"

#include <utility>

#include "access.hpp"

namespace solidmap {

using namespace detail;

namespace {

ffi::HexmeshOptions for_rust(const HexmeshOptions& options) {
  require_one_of("kind", options.kind, CellKind::hexes);
  require_one_of("polycube_kind", options.polycube_kind, PolycubeKind::voxels);
  return {options.kind == CellKind::hexes,
          options.along,
          options.length,
          options.max_cells,
          options.max_distance,
          options.max_vertices,
          static_cast<std::uint8_t>(options.polycube_kind),
          detail::for_rust(options.polycube),
          detail::for_rust(options.fit),
          detail::for_rust(options.remesh)};
}

Hexmesh converted(rust::Box<ffi::Hexmesh> made) {
  Remeshed remeshed = detail::converted(made->remeshed());
  return {std::move(remeshed.mesh), std::move(remeshed.domain_mesh), make_map(made->map()),
          std::move(remeshed.report), made->crossings(),             detail::converted(made->take_polycube())};
}

}  // namespace

HexmeshOptions HexmeshOptions::standard() {
  const ffi::HexmeshOptions from = ffi::hexmesh_defaults();
  HexmeshOptions options;
  options.kind = from.hexes ? CellKind::hexes : CellKind::tets;
  options.along = from.along;
  options.length = from.length;
  options.max_cells = from.most_cells;
  options.max_distance = from.max_distance;
  options.max_vertices = from.most_vertices;
  options.polycube_kind = static_cast<PolycubeKind>(from.polycube_kind);
  options.polycube = detail::converted(from.polycube);
  options.fit = detail::converted(from.fit);
  options.remesh = detail::converted(from.remesh);
  return options;
}

FitOptions HexmeshOptions::standard_fit() { return detail::converted(ffi::hexmesh_defaults().fit); }

Hexmesh make_hexmesh(const CellMesh& model, const HexmeshOptions& options, const ProgressCallback& progress) {
  return watched(progress, [&](const Watcher& watcher) {
    return converted(ffi::make_hexmesh(Access::of(model), for_rust(options), watcher));
  });
}

}  // namespace solidmap

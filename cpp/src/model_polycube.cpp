#include "solidmap/model_polycube.hpp"

#include <utility>

#include "access.hpp"

namespace solidmap {

using namespace detail;

namespace {

ffi::ModelPolycubeOptions for_rust(const ModelPolycubeOptions& options) {
  require_one_of("kind", options.kind, PolycubeKind::voxels);
  return {static_cast<std::uint8_t>(options.kind), options.max_vertices, detail::for_rust(options.deformation)};
}

SimplifiedReport converted(const ffi::SimplifiedReport& found) {
  return {found.vertices, found.of, detail::converted(found.distortion)};
}

VoxelReport converted(const ffi::VoxelReport& found) {
  return {found.voxels, found.size, found.cells, found.missed, found.tried, detail::converted(found.distortion)};
}

}  // namespace

ModelPolycube detail::converted(rust::Box<ffi::ModelPolycube> made) {
  const rust::Slice<const std::uint8_t> labels = made->labels();
  ModelPolycube polycube = {make_boundary(made->boundary()), std::vector<std::uint8_t>(labels.begin(), labels.end()),
                            std::nullopt, std::nullopt, std::nullopt};
  if (made->is_deformed()) {
    polycube.deformed = detail::converted(*made->take_deformed());
    if (made->is_simplified()) polycube.simplified = solidmap::converted(made->simplified());
  } else {
    polycube.voxels = solidmap::converted(made->voxels());
  }
  return polycube;
}

ModelPolycubeOptions ModelPolycubeOptions::standard() {
  const ffi::ModelPolycubeOptions from = ffi::model_polycube_defaults();
  ModelPolycubeOptions options;
  options.kind = static_cast<PolycubeKind>(from.kind);
  options.max_vertices = from.most_vertices;
  options.deformation = detail::converted(from.deformation);
  return options;
}

ModelPolycube make_model_polycube(const CellMesh& model, const ModelPolycubeOptions& options,
                                  const ProgressCallback& progress) {
  return watched(progress, [&](const Watcher& watcher) {
    return detail::converted(ffi::make_model_polycube(Access::of(model), for_rust(options), watcher));
  });
}

}  // namespace solidmap

#include "glue.h"

#include <new>

#include "solidmap/src/cgal_tetgen/bridge.rs.h"

namespace solidmap::cgal_tetgen {

namespace {

Outcome outcome(int code, const std::string& message) {
  return Outcome{code, rust::String::lossy(message)};
}

/// Runs `body` and turns anything it throws into an outcome: cxx catches only `std::exception`, and anything else would
/// end the process.
template <class Body>
Outcome guarded(Body body) noexcept {
  try {
    body();
    return outcome(kDone, "");
  } catch (const Failure& failure) {
    return outcome(failure.code, failure.message);
  } catch (const std::bad_alloc&) {
    return outcome(kOutOfMemory, "out of memory");
  } catch (const std::exception& error) {
    return outcome(kCgal, error.what());
  } catch (int code) {
    return outcome(kUnknown, "the number " + std::to_string(code) + " was thrown");
  } catch (...) {
    return outcome(kUnknown, "an unknown exception was thrown");
  }
}

SurfaceView view(Coordinates xyz, Indices triangles) {
  return {xyz.data(), xyz.size() / 3, triangles.data(), triangles.size() / 3};
}

template <class T>
void copy(const std::vector<T>& from, rust::Vec<T>& to) {
  to.clear();
  to.reserve(from.size());
  for (const T& value : from) to.push_back(value);
}

void copy(const Arrays& from, Mesh& to) {
  copy(from.xyz, to.xyz);
  copy(from.corners, to.corners);
}

}  // namespace

Outcome check_tetgen() {
  return guarded([] { check_interposition(); });
}

Outcome tetgen_mesh(Coordinates xyz, Indices triangles, double radius_edge_ratio, double min_dihedral,
                    double max_volume, Mesh& out) {
  return guarded(
      [&] { copy(tetgen(view(xyz, triangles), {radius_edge_ratio, min_dihedral, max_volume}), out); });
}

Outcome mesh3_mesh(Coordinates xyz, Indices triangles, const RefinementSizes& sizes, Mesh& out) {
  return guarded([&] {
    const Mesh3Options options{sizes.edge_size, sizes.facet_size, sizes.facet_angle, sizes.facet_distance,
                               sizes.cell_size, sizes.cell_radius_edge_ratio, sizes.feature_angle, sizes.seconds};
    copy(mesh3(view(xyz, triangles), options), out);
  });
}

Outcome wrap_surface(Coordinates xyz, Indices triangles, double alpha, double offset, Mesh& out) {
  return guarded([&] { copy(wrap(view(xyz, triangles), alpha, offset), out); });
}

Outcome remesh_surface(Coordinates xyz, Indices triangles, double edge_length, double feature_angle, Mesh& out) {
  return guarded([&] { copy(remesh(view(xyz, triangles), edge_length, feature_angle), out); });
}

Outcome intersecting_pairs(Coordinates xyz, Indices triangles, double max_tested, rust::Vec<std::uint32_t>& pairs) {
  return guarded([&] { copy(self_intersections(view(xyz, triangles), max_tested), pairs); });
}

std::unique_ptr<DistanceField> new_distance_field(Coordinates xyz, Indices triangles, Outcome& result) {
  std::unique_ptr<DistanceField> field;
  result = guarded([&] { field = std::make_unique<DistanceField>(view(xyz, triangles)); });
  return field;
}

Outcome closest_points(const DistanceField& field, Coordinates points, rust::Slice<double> closest) {
  return guarded([&] {
    if (closest.size() != points.size()) throw Failure(kUnknown, "buffers of different lengths");
    field.closest(points.data(), points.size() / 3, closest.data());
  });
}

Outcome enclosed_volume(const DistanceField& field, double& volume) {
  return guarded([&] { volume = field.volume(); });
}

Outcome points_inside(const DistanceField& field, Coordinates points, rust::Slice<std::uint8_t> inside) {
  return guarded([&] {
    if (3 * inside.size() != points.size()) throw Failure(kUnknown, "buffers of different lengths");
    field.inside(points.data(), points.size() / 3, inside.data());
  });
}

}  // namespace solidmap::cgal_tetgen

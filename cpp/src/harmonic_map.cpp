#include "solidmap/harmonic_map.hpp"

#include <utility>

#include "access.hpp"

namespace solidmap {

using namespace detail;

HarmonicMap HarmonicMap::load(const std::filesystem::path& path) {
  return guarded([&] { return make_map(ffi::map_load(PathBytes(path))); });
}

void HarmonicMap::save(const std::filesystem::path& path) const {
  guarded([&] { Access::of(*this).save(PathBytes(path)); });
}

std::vector<Point> HarmonicMap::evaluate(Span<const Point> points) const {
  std::vector<Point> images(points.size());
  evaluate(points, images);
  return images;
}

void HarmonicMap::evaluate(Span<const Point> points, Span<Point> images) const {
  const Unaliased given(points, images);
  guarded([&] { Access::of(*this).evaluate(flat(given.view()), flat(images)); });
}

Point HarmonicMap::operator()(const Point& point) const {
  Point image = {};
  evaluate({&point, 1}, {&image, 1});
  return image;
}

std::vector<Matrix3> HarmonicMap::jacobian(Span<const Point> points) const {
  std::vector<Matrix3> jacobians(points.size());
  jacobian(points, jacobians);
  return jacobians;
}

void HarmonicMap::jacobian(Span<const Point> points, Span<Matrix3> jacobians) const {
  const Unaliased given(points, jacobians);
  guarded([&] { Access::of(*this).jacobian(flat(given.view()), flat(jacobians)); });
}

void HarmonicMap::evaluate_with_jacobian(Span<const Point> points, Span<Point> images,
                                         Span<Matrix3> jacobians) const {
  const Unaliased apart_from_images(points, images);
  const Unaliased given(apart_from_images.view(), jacobians);
  guarded([&] { Access::of(*this).evaluate_with_jacobian(flat(given.view()), flat(images), flat(jacobians)); });
}

BoundaryMap HarmonicMap::boundary() const {
  return guarded([&] { return make_boundary(Access::of(*this).boundary()); });
}

FitReport HarmonicMap::report() const {
  const ffi::FitReport found = guarded([&] { return Access::of(*this).report(); });
  FitReport report;
  report.vertices = found.vertices;
  report.triangles = found.triangles;
  report.sources = found.sources;
  report.collocation = found.collocation;
  report.method = std::string(found.method);
  report.iterations = found.iterations;
  report.refinements = found.refinements;
  report.refinement_end = std::string(found.refinement_end);
  if (found.has_free_sources) {
    FreeSourcesReport free;
    free.rounds = found.free_rounds;
    free.end = std::string(found.free_end);
    free.residual_before = found.free_residual_before;
    free.residual_after = found.free_residual_after;
    free.boundary_error_before = {found.free_rms_before, found.free_p99_before, found.free_max_before};
    free.kept = found.free_kept;
    report.free_sources = std::move(free);
  }
  report.boundary_error = {found.rms, found.p99, found.max};
  report.local_error = {found.local_p99, found.local_max};
  report.residual_rms = found.residual_rms;
  report.c_error = found.c_error;
  report.seconds = found.seconds_total;
  report.seconds_sampling = found.seconds_sampling;
  report.seconds_factor = found.seconds_factor;
  report.seconds_solve = found.seconds_solve;
  report.seconds_check = found.seconds_check;
  report.warnings = copied(found.warnings);
  return report;
}

std::string HarmonicMap::metadata() const {
  return guarded([&] { return std::string(Access::of(*this).metadata()); });
}

Span<const Point> HarmonicMap::sources() const& { return rows<Point>(Access::of(*this).sources()); }
Span<const Point> HarmonicMap::coefficients() const& { return rows<Point>(Access::of(*this).coefficients()); }
Span<const Point> HarmonicMap::affine() const& { return rows<Point>(Access::of(*this).affine()); }
std::vector<Point> HarmonicMap::sources() && { return kept(static_cast<const HarmonicMap&>(*this).sources()); }
std::vector<Point> HarmonicMap::coefficients() && { return kept(static_cast<const HarmonicMap&>(*this).coefficients()); }
std::vector<Point> HarmonicMap::affine() && { return kept(static_cast<const HarmonicMap&>(*this).affine()); }

Inverse::Inverse(const HarmonicMap& map, const InverseOptions& options)
    : impl_(guarded([&] {
        return Access::held<InverseImpl>(
            ffi::inverse_new(Access::of(map), options.tolerance, options.seed_nodes, options.iterations));
      })) {}

std::vector<Preimage> Inverse::operator()(Span<const Point> points, const ProgressCallback& progress) const {
  const auto found = watched(
      progress, [&](const Watcher& watcher) { return Access::inside(impl_).preimages(flat(points), watcher); });
  return detail::converted(found);
}

std::vector<Preimage> detail::converted(const rust::Vec<ffi::Preimage>& found) {
  std::vector<Preimage> preimages(found.size());
  for (std::size_t i = 0; i < found.size(); ++i) {
    preimages[i].status = static_cast<Preimage::Status>(found[i].status);
    preimages[i].point = found[i].point;
    preimages[i].round_trip = found[i].round_trip;
    preimages[i].preimages = found[i].preimages;
    preimages[i].beyond_boundary = found[i].beyond_boundary;
  }
  return preimages;
}

namespace {

Distribution converted(const ffi::Distribution& found) { return {found.min, found.median, found.p99, found.max}; }

EnergyReport converted(const ffi::EnergyReport& found) {
  EnergyReport report;
  report.harmonic = found.harmonic;
  report.deformation = found.deformation;
  report.harmonic_error = found.harmonic_error;
  report.deformation_error = found.deformation_error;
  report.volume = found.volume;
  report.target_volume = found.target_volume;
  report.harmonic_density = converted(found.harmonic_density);
  report.deformation_density = converted(found.deformation_density);
  report.det_jacobian = converted(found.det_jacobian);
  report.folded_points = found.folded_points;
  report.folded_fraction = found.folded_fraction;
  report.folded_error = found.folded_error;
  report.worst_places = detail::converted(found.worst_places);
  return report;
}

VerdictTotals converted(const ffi::VerdictTotals& found) {
  return {found.cells, found.places, found.volume, found.fraction};
}

Distortion converted(const ffi::Distortion& found) {
  return {found.conformal, found.dirichlet, found.symmetric_dirichlet, found.arap, found.mips};
}

DistortionReport converted(const ffi::DistortionReport& found) {
  return {converted(found.mean), converted(found.mean_normalized), found.folded_points, found.left_out_fraction};
}

}  // namespace

EnergyReport energies(const HarmonicMap& map, const EnergyOptions& options, const ProgressCallback& progress) {
  return watched(progress, [&](const Watcher& watcher) {
    return converted(ffi::energies_on_grid(Access::of(map), options.cells, options.tolerance, options.normalize,
                                           options.lambda, options.mu, watcher));
  });
}

EnergyReport energies(const HarmonicMap& map, const CellMesh& mesh, const EnergyOptions& options,
                      const ProgressCallback& progress) {
  return watched(progress, [&](const Watcher& watcher) {
    return converted(ffi::energies_in_cells(Access::of(map), Access::of(mesh), options.normalize, options.lambda,
                                            options.mu, watcher));
  });
}

EnergyDensities energy_densities(const HarmonicMap& map, Span<const Point> points, const EnergyOptions& options) {
  return guarded([&] {
    const ffi::EnergyDensities found =
        ffi::energy_densities(Access::of(map), flat(points), options.normalize, options.lambda, options.mu);
    return EnergyDensities{copied(found.harmonic), copied(found.deformation), copied(found.det_jacobian)};
  });
}

CertificateReport certify(const HarmonicMap& map, const CertificateOptions& options,
                          const ProgressCallback& progress) {
  return watched(progress, [&](const Watcher& watcher) {
    const ffi::CertificateReport found =
        ffi::certified(Access::of(map), options.finest, options.max_cells, options.undecided, watcher);
    CertificateReport report;
    report.positive = converted(found.positive);
    report.folded = converted(found.folded);
    report.undecided = converted(found.undecided);
    report.undecided_negative = found.undecided_negative;
    report.sigma_min_99 = found.sigma_min_99;
    report.locally_one_to_one = found.locally_one_to_one;
    report.mirrored_parts = found.mirrored_parts;
    report.parts = found.parts;
    report.worst_places = detail::converted(found.worst_places);
    return report;
  });
}

std::vector<WorstPlace> worst_boundary_errors(const HarmonicMap& map, std::size_t most) {
  return guarded([&] { return detail::converted(ffi::worst_boundary_errors(Access::of(map), most)); });
}

DistortionReport distortion(const HarmonicMap& map, std::size_t cells, const ProgressCallback& progress) {
  return watched(progress, [&](const Watcher& watcher) {
    return converted(ffi::distortion_on_grid(Access::of(map), cells, watcher));
  });
}

DistortionReport distortion(const HarmonicMap& map, const CellMesh& mesh, const ProgressCallback& progress) {
  return watched(progress, [&](const Watcher& watcher) {
    return converted(ffi::distortion_in_cells(Access::of(map), Access::of(mesh), watcher));
  });
}

}  // namespace solidmap

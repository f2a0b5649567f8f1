#include <optional>
#include <stdexcept>

#include "testing.hpp"

using namespace solidmap;
using namespace testing;

namespace {

/// The image of a point by the formula in harmonic_map.hpp.
Point summed(const HarmonicMap& map, const Point& x) {
  const auto a = map.affine();
  Point f = a[0];
  for (int i = 0; i < 3; ++i) {
    for (int k = 0; k < 3; ++k) f[i] += a[k + 1][i] * x[k];
  }
  const auto sources = map.sources();
  const auto coefficients = map.coefficients();
  for (std::size_t s = 0; s < sources.size(); ++s) {
    const double potential = 1.0 / (4.0 * std::acos(-1.0) * distance(x, sources[s]));
    for (int i = 0; i < 3; ++i) f[i] += potential * coefficients[s][i];
  }
  return f;
}

}  // namespace

TEST_CASE("the defaults in the header are those of the library") {
  check_same(FitOptions(), FitOptions::adaptive());
  CHECK((FitOptions::dense().solver == Solver::qr));
  CHECK(FitOptions::dense().max_sources == 5000);
  CHECK((FitOptions::paper().placement.kind == Placement::Kind::offset));
  CHECK((FitOptions::paper().solver == Solver::svd));
  CHECK((FitOptions::with_free_sources().free_sources && FitOptions::with_free_sources().solver == Solver::qr));
  CHECK(!FitOptions::dense().free_sources);
}

TEST_CASE("free sources lower the residual of as many fixed ones") {
  FitOptions options = FitOptions::with_free_sources();
  options.max_sources = 60;
  const HarmonicMap free = fit(twisted_ball(), options);
  options.free_sources = false;
  const HarmonicMap fixed = fit(twisted_ball(), options);
  const FitReport report = free.report();
  REQUIRE(report.free_sources);
  CHECK(report.free_sources->rounds > 0);
  CHECK(report.free_sources->kept);
  CHECK(!report.free_sources->end.empty());
  CHECK(report.free_sources->residual_after < report.free_sources->residual_before);
  CHECK(report.free_sources->boundary_error_before.p99 == fixed.boundary_error().p99);
  CHECK(report.boundary_error.p99 < fixed.boundary_error().p99);
  CHECK(free.sources().size() == fixed.sources().size());
  CHECK(!fixed.report().free_sources);
  options.free_sources = true;
  options.max_sources = 10'000;
  options.source_ratio = 1;
  CHECK(thrown_by([&] { fit(BoundaryMap(shapes::sphere(1.0, 5), shapes::sphere(1.0, 5).vertices()), options); }) ==
        "invalid_input");
}

TEST_CASE("an affine map is reproduced inside") {
  const Surface ball = shapes::sphere(2.0, 3);
  const auto affine = [](const Point& p) { return Point{1 + 2 * p[0], p[1] - p[2], p[2] + 0.5 * p[0]}; };
  const HarmonicMap map = fit(BoundaryMap(ball, mapped(ball.vertices(), affine)));
  const auto points = points_in_ball(100, 1.9);
  CHECK(farthest(map.evaluate(points), mapped(points, affine)) < 1e-8);
  CHECK(map.boundary_error().p99 < 1e-9);
  for (const Matrix3& j : map.jacobian(points)) {
    CHECK(j[0] == doctest::Approx(2.0));
    CHECK(j[5] == doctest::Approx(-1.0));
    CHECK(j[6] == doctest::Approx(0.5));
  }
}

TEST_CASE("a fit meets its tolerance and says how") {
  const BoundaryMap boundary = twisted_ball();
  const HarmonicMap map = fit(boundary);
  const FitReport report = map.report();
  CHECK(report.vertices == 642);
  CHECK(report.triangles == 1280);
  CHECK(report.sources == map.sources().size());
  CHECK(report.method == "schwarz");
  CHECK(report.refinement_end == "tolerance");
  CHECK(report.boundary_error.p99 <= 1e-3);
  CHECK(report.boundary_error.rms > 0);
  CHECK(report.local_error.p99 > 0);
  CHECK(report.local_error.max >= report.local_error.p99);
  CHECK(report.seconds > 0);
  const auto vertices = boundary.domain().vertices();
  CHECK(farthest(map.evaluate(vertices), boundary.images()) < 1e-2);
  CHECK(map.boundary().target_volume() == doctest::Approx(boundary.target_volume()));
  CHECK(map.metadata().find("format_version") != std::string::npos);
}

TEST_CASE("values are the formula's, derivatives those of the values") {
  const HarmonicMap map = fit(twisted_ball());
  const auto points = points_in_ball(40, 0.9);
  const auto images = map.evaluate(points);
  const auto jacobians = map.jacobian(points);
  std::vector<Point> again(points.size());
  std::vector<Matrix3> derivatives(points.size());
  map.evaluate_with_jacobian(points, again, derivatives);
  CHECK(farthest(images, again) < 1e-12);
  const double h = 1e-5;
  for (std::size_t i = 0; i < points.size(); ++i) {
    CHECK(distance(images[i], summed(map, points[i])) < 1e-10);
    CHECK(distance(images[i], map(points[i])) < 1e-12);
    for (int k = 0; k < 3; ++k) {
      Point ahead = points[i], behind = points[i];
      ahead[k] += h;
      behind[k] -= h;
      const Point up = map(ahead), down = map(behind);
      for (int row = 0; row < 3; ++row) {
        CHECK(std::abs((up[row] - down[row]) / (2 * h) - jacobians[i][3 * row + k]) < 1e-6);
        CHECK(std::abs(derivatives[i][3 * row + k] - jacobians[i][3 * row + k]) < 1e-10);
      }
    }
  }
  CHECK(map.evaluate(Span<const Point>()).empty());
  CHECK(thrown_by([&] { map.evaluate(points, Span<Point>(again.data(), 3)); }) == "invalid_input");
  CHECK(thrown_by([&] { map.jacobian(points, Span<Matrix3>(derivatives.data(), 3)); }) == "invalid_input");
  // A refused call writes nothing, and results may overwrite the arguments.
  std::vector<Point> kept(points.size());
  CHECK(thrown_by([&] { map.evaluate_with_jacobian(points, kept, Span<Matrix3>(derivatives.data(), 3)); }) ==
        "invalid_input");
  CHECK(kept == std::vector<Point>(points.size()));
  std::vector<Point> in_place = points;
  map.evaluate(in_place, in_place);
  CHECK(in_place == images);
}

TEST_CASE("maps and boundary maps come back from files bit for bit") {
  const Folder folder;
  const HarmonicMap map = fit(twisted_ball());
  map.save(folder / "a.map");
  const HarmonicMap read = HarmonicMap::load(folder / "a.map");
  CHECK(farthest(read.coefficients(), map.coefficients()) == 0.0);
  CHECK(farthest(read.boundary().images(), map.boundary().images()) == 0.0);
  CHECK(read.boundary_error().max == map.boundary_error().max);
  read.save(folder / "b.map");
  CHECK(content(folder / "a.map") == content(folder / "b.map"));
  map.boundary().save(folder / "a.boundary");
  CHECK(farthest(BoundaryMap::load(folder / "a.boundary").images(), map.boundary().images()) == 0.0);
  CHECK(thrown_by([&] { HarmonicMap::load(folder / "a.boundary"); }) == "invalid_input");
  CHECK(thrown_by([&] { HarmonicMap::load(folder / "none.map"); }) == "not_found");
  CHECK(thrown_by([&] { map.save("/proc/a.map"); }) == "io");
}

TEST_CASE("what cannot be fitted is an error with a category") {
  FitOptions odd;
  odd.solver = static_cast<Solver>(9);
  CHECK(thrown_by([&] { fit(twisted_ball(), odd); }) == "invalid_input");
  odd = {};
  odd.placement.kind = static_cast<Placement::Kind>(256);
  CHECK(thrown_by([&] { fit(twisted_ball(), odd); }) == "invalid_input");
  const BoundaryMap boundary = twisted_ball(2);
  const auto with = [](auto change) {
    FitOptions options;
    change(options);
    return options;
  };
  const auto category = [&](auto change) { return thrown_by([&] { fit(boundary, with(change)); }); };
  CHECK(category([](FitOptions& o) { o.tolerance = -1; }) == "invalid_input");
  CHECK(category([](FitOptions& o) { o.tolerance = std::nan(""); }) == "invalid_input");
  CHECK(category([](FitOptions& o) { o.memory = 0; }) == "invalid_input");
  CHECK(category([](FitOptions& o) { o.memory = 1000; }) == "memory");
  CHECK(category([](FitOptions& o) { o.placement = {Placement::Kind::sphere, 1.0}; }) == "invalid_input");
  const Surface ball = boundary.domain();
  const Surface open(ball.vertices(), {ball.triangles().data() + 1, ball.triangles().size() - 1});
  CHECK(thrown_by([&] { fit(BoundaryMap(open, ball.vertices())); }) == "invalid_input");
  CHECK(thrown_by([&] { BoundaryMap(ball, {ball.vertices().data(), 3}); }) == "invalid_input");
  if (!has_native()) CHECK(thrown_by([&] { fit(boundary, FitOptions::paper()); }) == "unsupported");
}

TEST_CASE("a callback sees the steps, and ends the work at any of them") {
  const BoundaryMap boundary = twisted_ball();
  std::vector<std::string> steps;
  fit(boundary, {}, [&](const Progress& progress) {
    if (progress.fraction) CHECK((*progress.fraction >= 0 && *progress.fraction <= 1));
    if (steps.empty() || steps.back() != progress.step) steps.push_back(progress.step);
    return true;
  });
  CHECK(steps.front() == "checking");
  for (const std::string& last : steps) {
    int calls_after = -1;
    const auto until = [&](const Progress& progress) {
      if (calls_after >= 0) ++calls_after;
      if (progress.step == last && calls_after < 0) calls_after = 0;
      return calls_after < 0;
    };
    CHECK(thrown_by([&] { fit(boundary, {}, until); }) == "cancelled");
    CHECK(calls_after == 0);
  }
}

TEST_CASE("exceptions of a callback arrive as they are") {
  const BoundaryMap boundary = twisted_ball(2);
  CHECK_THROWS_WITH_AS(fit(boundary, {}, [](const Progress&) -> bool { throw std::out_of_range("mine"); }), "mine",
                       std::out_of_range);
  try {
    Factor(boundary.domain(), {}, [](const Progress&) -> bool { throw 42; });
    FAIL("nothing was thrown");
  } catch (int number) {
    CHECK(number == 42);
  }
  CHECK(fit(boundary).boundary_error().rms < 1e-2);
}

TEST_CASE("a kept factor answers one frame, many frames and boundary maps alike") {
  const Surface ball = shapes::sphere(1.0, 3);
  const Factor factor(ball);
  const auto points = points_in_ball(50, 0.9);
  std::vector<Point> frames;
  std::vector<BoundaryMap> boundaries;
  for (const double strength : {0.1, 0.3, 0.6}) {
    const auto images = mapped(ball.vertices(), [&](const Point& p) { return twisted(p, strength); });
    frames.insert(frames.end(), images.begin(), images.end());
    boundaries.emplace_back(ball, images);
  }
  const auto together = factor.solve_many(Span<const Point>(frames));
  const auto by_boundary = factor.solve_many(Span<const BoundaryMap>(boundaries));
  REQUIRE(together.size() == 3);
  for (std::size_t f = 0; f < 3; ++f) {
    const Span<const Point> images(frames.data() + f * ball.vertices().size(), ball.vertices().size());
    const HarmonicMap alone = factor.solve(images);
    CHECK(alone.boundary_error().rms < 2e-3);
    CHECK(farthest(alone.evaluate(points), together[f].evaluate(points)) < 1e-3);
    CHECK(farthest(factor.solve(boundaries[f]).evaluate(points), alone.evaluate(points)) < 1e-12);
    CHECK(farthest(by_boundary[f].evaluate(points), together[f].evaluate(points)) < 1e-12);
  }
  CHECK(farthest(factor.domain().vertices(), ball.vertices()) == 0.0);
  CHECK(factor.solve_many(Span<const BoundaryMap>()).empty());
  CHECK(thrown_by([&] { factor.solve(points); }) == "invalid_input");
  CHECK(thrown_by([&] { factor.solve_many(points); }) == "invalid_input");
  CHECK(thrown_by([&] { factor.solve(twisted_ball(2)); }) == "invalid_input");
  CHECK(thrown_by([&] { factor.solve(boundaries[0], [](const Progress&) { return false; }); }) == "cancelled");

  std::optional<HarmonicMap> first;
  const Factor refined = Factor::refined_for(boundaries[2], {}, {}, &first);
  REQUIRE(first);
  CHECK(first->boundary_error().p99 <= 1e-3);
  CHECK(refined.solve(boundaries[2]).boundary_error().p99 <= 1.1e-3);
}

TEST_CASE("frames at fixed points are those of their maps, and cost a solution only once") {
  const Surface ball = shapes::sphere(1.0, 3);
  const Factor factor(ball);
  const auto points = points_in_ball(50, 0.9);
  const FrameEvaluator frames(factor, points);
  CHECK(frames.modes() == 4);
  const auto images = mapped(ball.vertices(), [&](const Point& p) { return twisted(p, 0.3); });
  const FrameImages first = frames.evaluate(images);
  CHECK(first.solved > 0);
  CHECK(frames.modes() == 4 + first.solved);
  const HarmonicMap alone = factor.solve(images);
  CHECK(farthest(first.images, alone.evaluate(points)) < 1e-3);
  CHECK(first.boundary_rms < 2e-3);
  const FrameEvaluator shared = frames;
  const auto larger = mapped(images, [](const Point& p) { return Point{2 * p[0], 2 * p[1] + 1, 2 * p[2]}; });
  const FrameImages second = shared.evaluate(larger);
  CHECK(second.solved == 0);
  CHECK(second.left_out < 1e-9);
  const auto expected = mapped(first.images, [](const Point& p) { return Point{2 * p[0], 2 * p[1] + 1, 2 * p[2]}; });
  CHECK(farthest(second.images, expected) < 1e-9);
  CHECK(thrown_by([&] { frames.evaluate(points); }) == "invalid_input");
  CHECK(thrown_by([&] {
          frames.evaluate(mapped(ball.vertices(), [&](const Point& p) { return twisted(p, 0.9); }),
                          [](const Progress&) { return false; });
        }) == "cancelled");
}

TEST_CASE("the inverse undoes the map") {
  const HarmonicMap map = fit(twisted_ball());
  const auto points = points_in_ball(60, 0.95);
  const Inverse inverse(map);
  const auto found = inverse(map.evaluate(points));
  for (std::size_t i = 0; i < points.size(); ++i) {
    CHECK((found[i].status == Preimage::Status::ok));
    CHECK(distance(found[i].point, points[i]) < 1e-8);
    CHECK(found[i].preimages == 1);
  }
  const std::vector<Point> odd = {{10, 0, 0}, {std::nan(""), 0, 0}};
  CHECK((inverse(odd)[0].status == Preimage::Status::outside));
  CHECK((inverse(odd)[1].status == Preimage::Status::not_finite));
  CHECK(thrown_by([&] { inverse(odd, [](const Progress&) { return false; }); }) == "cancelled");
  InverseOptions loose;
  loose.tolerance = 1;
  CHECK(thrown_by([&] { Inverse(map, loose); }) == "invalid_input");
}

TEST_CASE("the identity has its energies, a twist has more") {
  const Surface ball = shapes::sphere(1.0, 3);
  const EnergyReport identity = energies(fit(BoundaryMap(ball, ball.vertices())));
  CHECK(identity.harmonic == doctest::Approx(3.0));
  CHECK(identity.deformation == doctest::Approx(0.0));
  CHECK(identity.volume == doctest::Approx(ball.volume()));
  CHECK(identity.det_jacobian.median == doctest::Approx(1.0));
  CHECK(identity.folded_points == 0);
  CHECK(identity.folded_error == 0.0);
  CHECK(identity.worst_places.size() <= 5);
  const HarmonicMap twisted = fit(twisted_ball());
  const EnergyReport found = energies(twisted);
  CHECK(found.harmonic > 3.001);
  CHECK((found.harmonic_error > 0.0 && found.harmonic_error < 0.01 * found.harmonic));
  CHECK((found.deformation_error > 0.0 && found.deformation_error < 0.01 * found.deformation));
  CHECK(distortion(twisted, 24).mean.conformal > 1.0);
  CHECK(distortion(fit(BoundaryMap(ball, ball.vertices())), 24).mean.symmetric_dirichlet == doctest::Approx(6.0));
  const ProgressCallback refuse = [](const Progress&) { return false; };
  CHECK(thrown_by([&] { energies(twisted, {}, refuse); }) == "cancelled");
  CHECK(thrown_by([&] { distortion(twisted, 24, refuse); }) == "cancelled");
  CHECK(thrown_by([&] { certify(twisted, {}, refuse); }) == "cancelled");
  std::size_t calls = 0;
  CHECK_THROWS_AS(energies(twisted, {}, [&](const Progress&) -> bool { if (++calls > 0) throw 7; return true; }), int);
  CHECK(energies(twisted, {}, [&](const Progress& p) { return p.step == "integrating"; }).harmonic == found.harmonic);
  EnergyOptions none;
  none.cells = 0;
  CHECK(thrown_by([&] { energies(twisted, none); }) == "invalid_input");
  EnergyOptions exact;
  exact.tolerance = 0;
  CHECK(thrown_by([&] { energies(twisted, exact); }) == "invalid_input");
}

TEST_CASE("a fold has a place, a volume within proved bounds, and a value") {
  const Surface cube = shapes::cube(1.0, 8);
  const auto pushed = [](const Point& p) { return Point{4 * p[0] * p[0] * p[0] - 0.2 * p[0], p[1], p[2]}; };
  FitOptions loose;
  loose.tolerance = 0.05;
  const HarmonicMap map = fit(BoundaryMap(cube, mapped(cube.vertices(), pushed)), loose);
  CertificateOptions options;
  options.finest = 64;
  const CertificateReport proved = certify(map, options);
  const EnergyReport energy = energies(map);
  CHECK(!proved.locally_one_to_one);
  CHECK(proved.folded.fraction > 0.02);
  CHECK(proved.folded.places >= 1);
  REQUIRE(!proved.worst_places.empty());
  const WorstPlace& worst = proved.worst_places.front();
  CHECK((worst.kind == WorstPlace::Kind::folded));
  CHECK(worst.value < 0);
  for (int k = 0; k < 3; ++k) CHECK((worst.low[k] <= worst.point[k] && worst.point[k] <= worst.high[k]));
  CHECK(energy.folded_fraction + energy.folded_error >= proved.folded.fraction);
  CHECK(energy.folded_fraction - energy.folded_error <= proved.folded.fraction + proved.undecided.fraction);
  REQUIRE(!energy.worst_places.empty());
  CHECK((energy.worst_places.front().kind == WorstPlace::Kind::folded));
  const auto misses = worst_boundary_errors(map, 2);
  CHECK(misses.size() <= 2);
  for (const WorstPlace& miss : misses) CHECK((miss.kind == WorstPlace::Kind::boundary_error));
  options.finest = 1;
  CHECK(thrown_by([&] { certify(map, options); }) == "invalid_input");
}

TEST_CASE("a section shows the energy densities of a map") {
  const Surface ball = shapes::sphere(1.0, 4);
  const PlaneSection section = plane_section(ball, Axis::x, 0.6, 100);
  CHECK(section.area == doctest::Approx(0.64 * 3.14159).epsilon(0.01));
  CHECK(section.points.size() == section.pixels.size());
  double covered = 0;
  for (std::size_t i = 0; i < section.points.size(); ++i) {
    CHECK(section.points[i][0] == 0.6);
    CHECK(section.pixels[i][0] < section.size[0]);
    covered += section.coverage[i];
  }
  CHECK(covered * section.pixel * section.pixel == doctest::Approx(section.area).epsilon(0.01));
  const HarmonicMap identity = fit(BoundaryMap(ball, ball.vertices()));
  const EnergyDensities densities = energy_densities(identity, section.points);
  CHECK(densities.harmonic.size() == section.points.size());
  CHECK(densities.harmonic.front() == doctest::Approx(3.0));
  CHECK(densities.deformation.front() == doctest::Approx(0.0));
  CHECK(densities.det_jacobian.front() == doctest::Approx(1.0));
  CHECK(thrown_by([&] { plane_section(ball, Axis::z, 2.0); }) == "invalid_input");
}

TEST_CASE("maps to the sphere have no inverse, maps of pairs have one") {
  const Surface cube = shapes::cube(2.0, 6);
  const BoundaryMap sphere = BoundaryMap::to_sphere(cube);
  for (const Point& p : sphere.images()) CHECK(distance(p, {0, 0, 0}) == doctest::Approx(1.0));
  const std::vector<SurfacePoint> places = {{3, {0.2, 0.3, 0.5}}, {7, {1.0, 0.0, 0.0}}};
  CHECK(distance(sphere.evaluate(places)[0], {0, 0, 0}) == doctest::Approx(1.0));
  const std::vector<SurfacePoint> beyond = {{1'000'000, {0.2, 0.3, 0.5}}};
  CHECK(thrown_by([&] { sphere.evaluate(beyond); }) == "invalid_input");
  CHECK(thrown_by([&] { sphere.inverse(); }) == "unsupported");

  PairReport report;
  std::size_t calls = 0;
  const BoundaryMap pair = BoundaryMap::pair(cube, shapes::sphere(1.0, 2), {},
                                             [&](const Progress&) { return ++calls > 0; }, &report);
  CHECK(calls > 3);
  CHECK(report.angle_median >= 1.0);
  CHECK(report.stretched < 0.0075);
  CHECK(report.target_stretched < 0.03);
  CHECK_FALSE(report.looks_wrong);
  PairOptions soft;
  soft.landmarks = {{0, 5}, {3, 60}};
  soft.landmarks_weight = 10.0;
  soft.domain_up = {0, 0, 1};
  soft.target_up = {0, 1, 0};
  BoundaryMap::pair(cube, shapes::sphere(1.0, 2), soft, {}, &report);
  CHECK(report.landmark_error > 0.0);
  soft.landmarks_weight = -1.0;
  CHECK(thrown_by([&] { BoundaryMap::pair(cube, shapes::sphere(1.0, 2), soft); }) == "invalid_input");
  CHECK(pair.target().vertices().size() == 162);

  // A solid with a cavity: each shell by itself.
  const Surface ball = shapes::sphere(1.0, 2);
  std::vector<Point> vertices(ball.vertices().begin(), ball.vertices().end());
  std::vector<Triangle> triangles(ball.triangles().begin(), ball.triangles().end());
  for (const Point& p : ball.vertices()) vertices.push_back({0.3 * p[0] + 0.2, 0.3 * p[1], 0.3 * p[2]});
  for (const Triangle& t : ball.triangles()) triangles.push_back({t[0] + 162, t[2] + 162, t[1] + 162});
  const Surface hollow(vertices, triangles);
  const BoundaryMap shells = BoundaryMap::pair(hollow, hollow);
  CHECK(shells.inverse().inverse().images().size() == 324);
  CHECK(distance(shells.images()[200], hollow.vertices()[200]) < 0.7);
  CHECK(thrown_by([&] { BoundaryMap::pair(hollow, ball); }) == "invalid_input");
  PairOptions told;
  told.components = {{1, 1}};
  BoundaryMap::pair(hollow, hollow, told, {}, &report);
  CHECK(report.components == std::vector<std::uint32_t>{0, 1});
  told.components = {{0, 1}};
  CHECK(thrown_by([&] { BoundaryMap::pair(hollow, hollow, told); }) == "invalid_input");
  CHECK(pair.inverse().domain().vertices().size() == 162);
  CHECK(thrown_by([&] { BoundaryMap::to_sphere(shapes::torus(1.0, 0.3, 12, 8)); }) == "invalid_input");
  CHECK(thrown_by([&] { BoundaryMap::to_torus(cube); }) == "invalid_input");
  const Surface ring = shapes::torus(3.0, 1.0, 24, 12);
  // Along the handle the other way, which turns the loop around it, too.
  PairOptions back;
  back.loops.emplace_back();
  for (std::uint32_t k = 0; k < 24; ++k) {
    back.loops[0][0].push_back(12 * k);
    back.loops[0][1].push_back(12 * (23 - k));
  }
  const BoundaryMap turned = BoundaryMap::pair(ring, ring, back);
  double area = 0;
  for (std::uint32_t k = 0; k < 24; ++k) {
    const Point &p = turned.images()[12 * k], &q = turned.images()[12 * ((k + 1) % 24)];
    area += p[0] * q[1] - p[1] * q[0];
  }
  CHECK(area < 0);
  back.loops[0][1] = {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11};
  CHECK(thrown_by([&] { BoundaryMap::pair(ring, ring, back); }) == "invalid_input");
  const BoundaryMap round = BoundaryMap::to_torus(ring);
  CHECK(std::abs(round.target_volume() / ring.volume() - 1.0) < 0.1);
}

TEST_CASE("the energy of the inside falls as the images of a map to the sphere are moved") {
  const std::vector<std::array<std::int32_t, 3>> cubes = {{0, 0, 0}, {1, 0, 0}};
  const Surface bar = shapes::polycube(cubes, 4);
  const BoundaryMap map = BoundaryMap::to_sphere(bar);
  ImproveOptions options;
  options.rounds = 4;
  ImproveReport report;
  const BoundaryMap improved = map.improved(options, {}, &report);
  REQUIRE(report.energies.size() >= 2);
  for (std::size_t i = 1; i < report.energies.size(); ++i) CHECK(report.energies[i] < report.energies[i - 1]);
  CHECK(report.rounds <= 4);
  CHECK(report.distortion_after <= 1.5 * report.distortion_before);
  CHECK(improved.images().size() == map.images().size());
  for (const Point& p : improved.images()) CHECK(distance(p, {0, 0, 0}) == doctest::Approx(1.0));
  options.max_distortion = 0.5;
  CHECK(thrown_by([&] { map.improved(options); }) == "invalid_input");
  const std::vector<Point> same(bar.vertices().begin(), bar.vertices().end());
  CHECK(thrown_by([&] { BoundaryMap(bar, same).improved(); }) == "invalid_input");
  CHECK(thrown_by([&] { map.improved({}, [](const Progress& now) { return now.step != "lowering the energy"; }); }) ==
        "cancelled");
}

TEST_CASE("one refusal ends a pair and a map to the sphere, whenever it comes") {
  const Surface ball = shapes::sphere(1.0, 2), cube = shapes::cube(2.0, 4);
  const auto ends = [](const auto& work) {
    int calls = 0;
    work([&](const Progress&) { return ++calls > 0; });
    CHECK(calls > 3);
    for (int last = 1; last <= calls; last += 1 + calls / 10) {
      int count = 0;
      const std::string thrown = thrown_by([&] { work([&](const Progress&) { return ++count != last; }); });
      // Work that is nearly done may end before the callback has been called that often.
      if (count >= last) CHECK(thrown == "cancelled");
      CHECK(count <= last);
    }
  };
  ends([&](const ProgressCallback& callback) { BoundaryMap::pair(ball, cube, {}, callback); });
  ends([&](const ProgressCallback& callback) { BoundaryMap::to_sphere(cube, SphereEnergy::balanced, callback); });
  PairOptions conformal;
  conformal.conformal = true;
  ends([&](const ProgressCallback& callback) { BoundaryMap::pair(ball, cube, conformal, callback); });
}

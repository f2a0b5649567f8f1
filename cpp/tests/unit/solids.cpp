#include <array>
#include <cmath>

#include "testing.hpp"

using namespace solidmap;
using namespace testing;

namespace {

/// The map that bends an L of cubes.
HarmonicMap bent_polycube() {
  const std::vector<std::array<std::int32_t, 3>> cubes = {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}};
  const Surface polycube = shapes::polycube(cubes, 6);
  const auto bent = [](const Point& p) {
    const double angle = 0.4 * p[0];
    return Point{std::cos(angle) * (p[0] + 2) - std::sin(angle) * p[1], std::sin(angle) * (p[0] + 2) + p[1], p[2]};
  };
  return fit(BoundaryMap(polycube, mapped(polycube.vertices(), bent)));
}

}  // namespace

TEST_CASE("a polycube's grid is carried without an inverted cell") {
  const HarmonicMap map = bent_polycube();
  for (const CellKind kind : {CellKind::tets, CellKind::hexes}) {
    RegularMesh regular;
    regular.kind = kind;
    regular.along = 8;
    std::string steps;
    const Remeshed remeshed = remesh(map, regular, {}, [&](const Progress& progress) {
      if (steps.find(progress.step) == std::string::npos) steps += progress.step + " ";
      return true;
    });
    CHECK(steps == "meshing mapping repairing verifying ");
    CHECK((remeshed.mesh.kind() == kind));
    CHECK(remeshed.mesh.size() == remeshed.report.quality.cells);
    CHECK(remeshed.report.quality.inverted == 0);
    CHECK(remeshed.report.padding.has_value() == (kind == CellKind::hexes));
    CHECK(remeshed.mesh.inverted().empty());
    CHECK(remeshed.report.quality.min_scaled_jacobian > 0);
    CHECK(remeshed.report.volume == doctest::Approx(remeshed.report.target_volume).epsilon(0.01));
    CHECK(remeshed.domain_mesh.nodes().size() == remeshed.mesh.nodes().size());
    if (kind == CellKind::tets) {
      const Remeshed again = remesh(map, remeshed.domain_mesh);
      CHECK(again.report.quality.inverted == 0);
      CHECK((again.report.polish == PolishOutcome::nothing_inverted));
      CHECK(again.report.quality.min_scaled_jacobian == again.report.quality_as_mapped.min_scaled_jacobian);
      RemeshOptions polished;
      polished.polish_valid = true;
      const RemeshReport asked = remesh(map, remeshed.domain_mesh, polished).report;
      CHECK((asked.polish == PolishOutcome::kept || asked.polish == PolishOutcome::undone));
      CHECK(asked.quality.min_scaled_jacobian >= asked.quality_as_mapped.min_scaled_jacobian);
      CHECK(asked.quality.p01_scaled_jacobian >= asked.quality_as_mapped.p01_scaled_jacobian);
    }
    CHECK(remeshed.domain_mesh.check().valid);
    CHECK(remeshed.domain_mesh.boundary().surface.volume() == doctest::Approx(3.0));
    CHECK(energies(map, remeshed.domain_mesh).volume == doctest::Approx(3.0));
    CHECK(std::isnan(energies(map, remeshed.domain_mesh).harmonic_error));
    CHECK(distortion(map, remeshed.domain_mesh).folded_points == 0);
    CHECK(thrown_by([&] { remesh(map, regular, {}, [](const Progress& p) { return p.step != "repairing"; }); }) ==
          "cancelled");
  }
  // The length of sides takes precedence over their number, which has a default.
  RegularMesh sized;
  sized.length = 0.5;
  CHECK(remesh(map, sized).mesh.size() < 1500);
  sized.length = -1;
  CHECK(thrown_by([&] { remesh(map, sized); }) == "invalid_input");
  CHECK_THROWS_AS(remesh(map, RegularMesh(), {}, [](const Progress&) -> bool { throw 1; }), int);
  RegularMesh fine;
  fine.along = 100'000;
  CHECK(thrown_by([&] { remesh(map, fine); }) == "memory");
  RemeshOptions frugal;
  frugal.memory = 1'000'000;
  CHECK(thrown_by([&] { remesh(map, RegularMesh(), frugal); }) == "memory");
  CHECK(thrown_by([&] { remesh(fit(twisted_ball()), RegularMesh()); }) == "invalid_input");
}

TEST_CASE("solids are filled and wrapped, or the error says what the build lacks") {
  const Surface cube = shapes::cube(2.0, 4);
  TetOptions by_cgal;
  by_cgal.mesher = TetOptions::Mesher::cgal;
  if (!has_native()) {
    CHECK(thrown_by([&] { tetrahedralise(cube); }) == "unsupported");
    CHECK(thrown_by([&] { offset_surface(cube, 0.1); }) == "unsupported");
    CHECK(thrown_by([&] { cube.check(true); }) == "unsupported");
    return;
  }
  const CellMesh tets = tetrahedralise(cube);
  CHECK(tets.quality().inverted == 0);
  CHECK(tets.boundary().surface.volume() == doctest::Approx(8.0));
  CHECK(farthest({tets.nodes().data(), cube.vertices().size()}, cube.vertices()) == 0.0);
  CHECK(tetrahedralise(cube, by_cgal).boundary().surface.volume() == doctest::Approx(8.0).epsilon(0.01));
  const ProgressCallback refuse = [](const Progress&) { return false; };
  CHECK(thrown_by([&] { tetrahedralise(cube, {}, refuse); }) == "cancelled");
  CHECK(thrown_by([&] { tetrahedralise(cube, by_cgal, refuse); }) == "cancelled");
  CHECK(thrown_by([&] { offset_surface(cube, 0.2, {}, refuse); }) == "cancelled");
  const OffsetSurface around = offset_surface(cube, 0.2);
  CHECK(around.min_distance > 0.1);
  CHECK(around.genus == 0);
  CHECK(around.surface.volume() > 8.0);
  CHECK(cube.check(true).self_intersections == 0);

  TetOptions frugal;
  frugal.memory = 1'000'000;
  CHECK(thrown_by([&] { tetrahedralise(cube, frugal); }) == "memory");

  const Surface open(cube.vertices(), {cube.triangles().data() + 1, cube.triangles().size() - 1});
  CHECK(thrown_by([&] { tetrahedralise(open); }) == "invalid_input");
  CHECK(thrown_by([&] { offset_surface(cube, -1.0); }) == "invalid_input");
  OffsetOptions fine;
  fine.alpha = 1e-5;
  CHECK(thrown_by([&] { offset_surface(cube, 0.2, fine); }) == "memory");
  // Triangles through one another: TetGen's error, not the end of the process.
  std::vector<Point> vertices(cube.vertices().begin(), cube.vertices().end());
  std::vector<Triangle> triangles(cube.triangles().begin(), cube.triangles().end());
  const auto count = static_cast<std::uint32_t>(vertices.size());
  for (const Point& p : cube.vertices()) vertices.push_back({p[0] + 0.7, p[1] + 0.6, p[2] + 0.5});
  for (const Triangle& t : cube.triangles()) triangles.push_back({t[0] + count, t[1] + count, t[2] + count});
  CHECK(thrown_by([&] { tetrahedralise(Surface(vertices, triangles)); }) == "invalid_input");
  CHECK(fit(twisted_ball(2), FitOptions::paper()).report().method == "dense-svd");
}

#include <array>
#include <cmath>

#include "testing.hpp"

using namespace solidmap;
using namespace testing;

namespace {

/// A twisted L of cubes, and tetrahedra of the L.
struct Twisted {
  HarmonicMap map;
  CellMesh mesh;
};

Twisted twisted_polycube() {
  const std::vector<std::array<std::int32_t, 3>> cubes = {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}};
  const Surface polycube = shapes::polycube(cubes, 4);
  const auto twist = [](const Point& p) { return twisted(p, 0.8); };
  const HarmonicMap map = fit(BoundaryMap(polycube, mapped(polycube.vertices(), twist)));
  RegularMesh regular;
  regular.kind = CellKind::tets;
  regular.along = 8;
  return {map, remesh(map, regular).domain_mesh};
}

}  // namespace

TEST_CASE("a bijective map goes there and back within rounding, and is kept in the file") {
  const auto [map, mesh] = twisted_polycube();
  CHECK(!BijectiveMap::of(map).has_value());
  const BijectiveMap bijective = BijectiveMap::make(map, mesh);
  const BijectiveReport report = bijective.report();
  CHECK(report.tets == bijective.domain().size());
  CHECK(report.tets >= mesh.size());
  CHECK(bijective.target().inverted().empty());
  CHECK(bijective.target().nodes().size() == report.nodes);
  CHECK(report.boundary_one_to_one == has_native());
  CHECK(report.difference_rms > 0);
  CHECK(report.difference_max < 0.05);

  std::vector<Point> points;
  for (const Point& p : points_in_ball(500, 0.45)) points.push_back({p[0] + 0.5, p[1] + 0.5, p[2] + 0.5});
  const std::vector<Point> images = bijective.evaluate(points);
  const std::vector<Preimage> found = bijective.preimages(images);
  for (std::size_t i = 0; i < points.size(); ++i) {
    REQUIRE((found[i].status == Preimage::Status::ok));
    CHECK(distance(found[i].point, points[i]) < 1e-12);
    CHECK(found[i].round_trip < 1e-12);
  }
  const double far = 1e3;
  const double nan = std::nan("");
  const std::vector<Point> others = {{far, far, far}, {nan, 0, 0}};
  CHECK((bijective.preimages(others)[0].status == Preimage::Status::outside));
  CHECK((bijective.preimages(others)[1].status == Preimage::Status::not_finite));

  // The Jacobian is that of the tetrahedron, found by differences that stay in it with few exceptions.
  const std::vector<Matrix3> jacobians = bijective.jacobian(points);
  std::size_t same = 0;
  const double h = 1e-7;
  for (std::size_t i = 0; i < points.size(); ++i) {
    Point ahead = points[i];
    ahead[1] += h;
    const Point image = bijective.evaluate(Span<const Point>(&ahead, 1))[0];
    double off = 0;
    for (int row = 0; row < 3; ++row) {
      off = std::max(off, std::abs((image[row] - images[i][row]) / h - jacobians[i][3 * row + 1]));
    }
    same += off < 1e-6;
  }
  CHECK(same > 490);

  const Folder folder;
  bijective.save(map, folder / "both.map");
  const HarmonicMap loaded = HarmonicMap::load(folder / "both.map");
  const auto again = BijectiveMap::of(loaded);
  REQUIRE(again.has_value());
  CHECK(again->evaluate(points) == images);
  CHECK(farthest(loaded.evaluate(points), map.evaluate(points)) < 1e-9);
}

TEST_CASE("what cannot become one to one throws, and work can be cancelled") {
  const auto [map, mesh] = twisted_polycube();
  const auto mirror = [](const Point& p) { return Point{-p[0], p[1], p[2]}; };
  const Surface domain = map.boundary().domain();
  const HarmonicMap mirrored = fit(BoundaryMap(domain, mapped(domain.vertices(), mirror)));
  CHECK(thrown_by([&, &mesh = mesh] { BijectiveMap::make(mirrored, mesh); }) == "invalid_input");
  CHECK(thrown_by([&, &map = map, &mesh = mesh] {
          BijectiveMap::make(map, mesh, {}, [](const Progress&) { return false; });
        }) == "cancelled");
  BijectiveOptions options;
  options.tolerance = 0;
  CHECK(thrown_by([&, &map = map, &mesh = mesh] { BijectiveMap::make(map, mesh, options); }) == "invalid_input");
  RegularMesh hexes;
  hexes.along = 4;
  const CellMesh cells = remesh(map, hexes).domain_mesh;
  CHECK(thrown_by([&, &map = map] { BijectiveMap::make(map, cells); }) == "invalid_input");
}

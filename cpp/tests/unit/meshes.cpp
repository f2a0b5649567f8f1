#include <array>
#include <deque>
#include <type_traits>

#include "testing.hpp"

using namespace solidmap;
using namespace testing;

static_assert(std::is_convertible_v<std::vector<Point>&, Span<const Point>>);
static_assert(std::is_convertible_v<std::vector<Point>, Span<const Point>>);
static_assert(std::is_convertible_v<Span<Point>, Span<const Point>>);
static_assert(!std::is_convertible_v<const std::vector<Point>&, Span<Point>>);
static_assert(!std::is_convertible_v<std::vector<Point>, Span<Point>>, "a writable view of a temporary");
static_assert(!std::is_convertible_v<std::vector<float>&, Span<const double>>);
static_assert(!std::is_convertible_v<std::deque<double>&, Span<const double>>);
static_assert(std::is_nothrow_move_constructible_v<Surface> && std::is_copy_assignable_v<Surface>);

TEST_CASE("the library says what it is") {
  CHECK(version() == EXPECTED_VERSION);
  CHECK(has_native() == bool(EXPECTED_NATIVE));
  CHECK((licence().find("AGPL") != std::string::npos) == has_native());
}

TEST_CASE("spans view arrays without copies") {
  const double xyz[] = {1, 2, 3, 4, 5, 6};
  const Span<const Point> points = as_points(Span<const double>(xyz));
  CHECK(points.size() == 2);
  CHECK(points[1][2] == 6);
  CHECK(as_numbers(points).data() == xyz);
  std::array<Point, 2> out = {};
  CHECK(Span<Point>(out).size() == 2);
  CHECK(Span<const Point>().empty());
}

TEST_CASE("a polycube is the union of its cubes, also of one named twice") {
  const std::vector<std::array<int, 3>> cubes = {{0, 0, 0}, {1, 0, 0}, {0, 0, 0}};
  const Surface surface = shapes::polycube(cubes, 3);
  CHECK(surface.volume() == doctest::Approx(2.0));
  CHECK(surface.triangles().size() == 2 * 9 * 10);
  CHECK(surface.check().solvable);
}

TEST_CASE("surfaces keep their arrays, also through files") {
  const Surface cube = shapes::cube(2.0, 4);
  CHECK(cube.volume() == doctest::Approx(8.0));
  CHECK(cube.area() == doctest::Approx(24.0));
  CHECK(cube.diagonal() == doctest::Approx(std::sqrt(12.0)));
  CHECK(cube.bounding_box()[0] == Point{-1, -1, -1});
  const Surface copy(cube.vertices(), cube.triangles());
  const Folder folder;
  for (const char* name : {"a.obj", "a.ply", "a.off", "a.vtu"}) {
    copy.save(folder / name);
    const Surface read = Surface::load(folder / name);
    CHECK(farthest(read.vertices(), cube.vertices()) == 0.0);
    CHECK(read.triangles().size() == cube.triangles().size());
    CHECK(read.triangles()[7] == cube.triangles()[7]);
  }
}

TEST_CASE("what cannot be a surface is an error with a category") {
  const std::vector<Point> corners = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}};
  const std::vector<Triangle> beyond = {{0, 1, 3}};
  CHECK(thrown_by([&] { Surface(corners, beyond); }) == "invalid_input");
  CHECK(thrown_by([] { Surface::load("/nowhere/a.obj"); }) == "not_found");
  CHECK(thrown_by([] { Surface::load("/tmp/a.xyz"); }) == "unsupported");
  CHECK(thrown_by([] { Surface::load("/"); }) == "unsupported");
  CHECK(thrown_by([] { shapes::cube(1.0, 2).save("/proc/a.obj"); }) == "io");
  CHECK(thrown_by([] { shapes::cube(1.0, 0); }) == "invalid_input");
  CHECK(thrown_by([] { shapes::sphere(std::nan(""), 2); }) == "invalid_input");
  CHECK(thrown_by([] { shapes::torus(1.0, 1.0, 10, 10); }) == "invalid_input");
  std::vector<std::array<int, 3>> apart(500);
  for (int i = 0; i < 500; ++i) apart[static_cast<std::size_t>(i)] = {2 * i, 0, 0};
  CHECK(thrown_by([&] { shapes::polycube(apart, 200); }) == "memory");
  const Folder folder;
  std::ofstream(folder / "cut.off") << "OFF\n8 12 0\n0 0";
  CHECK(thrown_by([&] { Surface::load(folder / "cut.off"); }) == "invalid_input");
  const Surface empty(Span<const Point>{}, Span<const Triangle>{});
  CHECK(empty.volume() == 0.0);
  CHECK(!empty.check().solvable);
}

TEST_CASE("the check finds a hole, and it is closed") {
  const Surface cube = shapes::cube(2.0, 8);
  CHECK(cube.check().solvable);
  CHECK(cube.check().components.at(0).genus == 0);
  CHECK(shapes::torus(1.0, 0.3, 24, 12).check().components.at(0).genus == 1);
  const Surface open(cube.vertices(), {cube.triangles().data() + 1, cube.triangles().size() - 1});
  const CheckReport report = open.check();
  CHECK(!report.solvable);
  CHECK(!report.closed);
  REQUIRE(!report.findings.empty());
  CHECK(report.findings[0].kind == "open_edges");
  CHECK(report.findings[0].severity == Severity::error);
  CHECK(report.findings[0].count == 3);
  CHECK(report.findings[0].edges.size() == 3);
  CHECK(report.text.find("Not solvable") != std::string::npos);
  std::size_t closed = 0;
  CHECK(open.with_holes_closed(100, &closed).check().solvable);
  CHECK(closed == 1);
  CHECK(thrown_by([&] { open.with_holes_closed(2); }) == "invalid_input");

  std::vector<Triangle> turned(cube.triangles().begin(), cube.triangles().end());
  for (Triangle& t : turned) std::swap(t[1], t[2]);
  std::vector<std::string> done;
  CHECK(Surface(cube.vertices(), turned).repaired(&done).volume() == doctest::Approx(8.0));
  CHECK(done.size() == 1);
}

TEST_CASE("cells keep regions, find their boundary and what is inverted") {
  const std::vector<Point> nodes = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}, {1, 1, 1}};
  const std::vector<Tet> tets = {{0, 1, 2, 3}, {1, 2, 3, 4}};
  const std::vector<std::int32_t> regions = {5, 6};
  const CellMesh mesh(nodes, tets, regions);
  CHECK(mesh.kind() == CellKind::tets);
  CHECK(mesh.size() == 2);
  CHECK(mesh.hexes().empty());
  CHECK(mesh.inverted().empty());
  const CellMesh::Boundary boundary = mesh.boundary();
  CHECK(boundary.surface.triangles().size() == 6);
  CHECK(boundary.surface.volume() == doctest::Approx(0.5));
  CHECK(boundary.nodes.size() == 5);
  const Folder folder;
  mesh.save(folder / "a.mesh");
  const CellMesh read = CellMesh::load(folder / "a.mesh");
  CHECK(farthest(read.nodes(), nodes) == 0.0);
  CHECK(read.regions()[1] == 6);
  mesh.save(folder / "a.msh");
  mesh.save(folder / "a.vtu");
  CHECK(CellMesh::load(folder / "a.vtu").tets()[1] == tets[1]);

  std::vector<Point> mirrored = nodes;
  for (Point& p : mirrored) p[0] = -p[0];
  CHECK(mesh.with_nodes(mirrored).inverted() == std::vector<std::uint32_t>{0, 1});
  CHECK(mesh.with_nodes(mirrored).quality().inverted == 2);
  CHECK(thrown_by([&] { mesh.with_nodes({nodes.data(), 4}); }) == "invalid_input");
  CHECK(CellMesh::load(folder / "a.msh").regions()[0] == 5);
  CHECK(thrown_by([&] { CellMesh(nodes, tets, Span<const std::int32_t>(regions.data(), 1)); }) == "invalid_input");
}

TEST_CASE("hexahedra have a boundary, and the check finds those that are inverted") {
  const std::vector<Point> nodes = {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}, {0, 0, 1}, {1, 0, 1},
                                    {1, 1, 1}, {0, 1, 1}, {0, 0, 2}, {1, 0, 2}, {1, 1, 2}, {0, 1, 2}};
  const std::vector<Hex> hexes = {{0, 1, 2, 3, 4, 5, 6, 7}, {4, 5, 6, 7, 8, 9, 10, 11}};
  const CellMesh mesh(nodes, hexes);
  CHECK(mesh.boundary().surface.triangles().size() == 20);
  CHECK(mesh.boundary().surface.volume() == doctest::Approx(2.0));
  const CellReport sound = mesh.check();
  CHECK(sound.valid);
  CHECK(sound.findings.empty());
  REQUIRE(sound.bodies.size() == 1);
  CHECK(sound.bodies[0].cells == 2);
  CHECK(sound.bodies[0].volume == doctest::Approx(2.0));

  std::vector<Point> folded = nodes;
  for (std::size_t i = 8; i < 12; ++i) folded[i][2] = 0.5;
  const CellReport report = mesh.with_nodes(folded).check();
  CHECK(!report.valid);
  CHECK(report.inverted == 1);
  REQUIRE(!report.findings.empty());
  CHECK(report.findings[0].kind == "inverted_cells");
  CHECK(report.findings[0].severity == Severity::error);
  CHECK(report.findings[0].cells == std::vector<std::uint32_t>{1});
  CHECK(report.findings[0].places.at(0)[2] == doctest::Approx(0.75));
  CHECK(report.text.find("NOT VALID") != std::string::npos);
}

TEST_CASE("copies share, and objects that were moved from throw") {
  Surface cube = shapes::cube(1.0, 2);
  const Surface copy = cube;
  CHECK(copy.vertices().data() == cube.vertices().data());
  const Surface moved = std::move(cube);
  CHECK(moved.vertices().data() == copy.vertices().data());
  CHECK(thrown_by([&] { cube.volume(); }) == "invalid_input");  // NOLINT(bugprone-use-after-move)
  cube = copy;
  CHECK(cube.volume() == doctest::Approx(1.0));
}

// make_polycube and make_hexmesh, checked from the positions of nodes alone.
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <stdexcept>

#include "testing.hpp"

using namespace solidmap;
using namespace testing;

namespace {

using Cubes = std::vector<std::array<int, 3>>;

const Cubes an_l = {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}};
const Cubes a_ring = {{0, 0, 0}, {1, 0, 0}, {2, 0, 0}, {0, 1, 0}, {2, 1, 0}, {0, 2, 0}, {1, 2, 0}, {2, 2, 0}};

/// Unit cubes as tetrahedra: each of `divisions`³ boxes in a cube is six around its diagonal.
CellMesh boxes(const Cubes& cubes, int divisions) {
  std::map<std::array<int, 3>, std::uint32_t> numbers;
  std::vector<Point> nodes;
  const auto number = [&](const std::array<int, 3>& at) {
    const auto [place, is_new] = numbers.emplace(at, static_cast<std::uint32_t>(nodes.size()));
    if (is_new) {
      Point p;
      for (int k = 0; k < 3; ++k) p[k] = static_cast<double>(at[k]) / divisions;
      nodes.push_back(p);
    }
    return place->second;
  };
  std::vector<Tet> tets;
  for (const auto& cube : cubes) {
    for (int box = 0; box < divisions * divisions * divisions; ++box) {
      const std::array<int, 3> low = {cube[0] * divisions + box % divisions,
                                      cube[1] * divisions + box / divisions % divisions,
                                      cube[2] * divisions + box / divisions / divisions};
      std::array<int, 3> axes = {0, 1, 2};
      do {
        std::array<int, 3> at = low;
        Tet tet = {number(at)};
        for (int k = 0; k < 3; ++k) {
          ++at[axes[k]];
          tet[k + 1] = number(at);
        }
        // The order of the axes is even for 012, 120 and 201.
        if (axes[1] != (axes[0] + 1) % 3) std::swap(tet[1], tet[2]);
        tets.push_back(tet);
      } while (std::next_permutation(axes.begin(), axes.end()));
    }
  }
  return {nodes, tets};
}

Point minus(const Point& a, const Point& b) { return {a[0] - b[0], a[1] - b[1], a[2] - b[2]}; }

Point cross(const Point& a, const Point& b) {
  return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}

double dot(const Point& a, const Point& b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

double volume(Span<const Point> nodes, const Tet& tet) {
  const Point& at = nodes[tet[0]];
  return dot(cross(minus(nodes[tet[1]], at), minus(nodes[tet[2]], at)), minus(nodes[tet[3]], at)) / 6;
}

/// By six tetrahedra around the diagonal from its first corner.
double volume(Span<const Point> nodes, const Hex& hex) {
  const int around[] = {1, 2, 3, 7, 4, 5, 1};
  double sum = 0;
  for (int k = 0; k < 6; ++k) sum += volume(nodes, Tet{hex[0], hex[around[k]], hex[around[k + 1]], hex[6]});
  return sum;
}

/// The least scaled determinant at the eight corners.
double scaled_jacobian(Span<const Point> nodes, const Hex& hex) {
  const int neighbours[8][3] = {{1, 3, 4}, {2, 0, 5}, {3, 1, 6}, {0, 2, 7}, {7, 5, 0}, {4, 6, 1}, {5, 7, 2}, {6, 4, 3}};
  double least = 1;
  for (int corner = 0; corner < 8; ++corner) {
    Point edges[3];
    double lengths = 1;
    for (int k = 0; k < 3; ++k) {
      edges[k] = minus(nodes[hex[neighbours[corner][k]]], nodes[hex[corner]]);
      lengths *= std::sqrt(dot(edges[k], edges[k]));
    }
    least = std::min(least, dot(cross(edges[0], edges[1]), edges[2]) / lengths);
  }
  return least;
}

/// The least volume of a cell, and the sum of all.
template <class Cell>
std::array<double, 2> volumes(const CellMesh& mesh, Span<const Cell> cells) {
  double least = std::numeric_limits<double>::infinity(), sum = 0;
  for (const Cell& cell : cells) {
    least = std::min(least, volume(mesh.nodes(), cell));
    sum += volume(mesh.nodes(), cell);
  }
  return {least, sum};
}

/// What is promised of every polycube.
void check_promises(const PolycubeMap& found, const CellMesh& given) {
  REQUIRE(found.model.size() == found.polycube.size());
  const Span<const Tet> tets = found.model.tets();
  CHECK(std::equal(tets.begin(), tets.end(), found.polycube.tets().begin()));
  CHECK(farthest({found.model.nodes().data(), given.nodes().size()}, given.nodes()) == 0.0);
  CHECK(volumes(found.model, tets)[0] > 0);
  CHECK(volumes(found.polycube, tets)[0] > 0);
  CHECK(found.report.tets_given == given.size());
  CHECK(found.report.tets == found.model.size());
  REQUIRE(found.labels.size() == found.boundary.size());
  const Span<const Point> nodes = found.polycube.nodes();
  bool are_flat = true, face_along = true;
  for (std::size_t t = 0; t < found.boundary.size(); ++t) {
    const auto& [a, b, c] = found.boundary[t];
    const int axis = found.labels[t] / 2;
    are_flat = are_flat && nodes[a][axis] == nodes[b][axis] && nodes[b][axis] == nodes[c][axis];
    const double area = cross(minus(nodes[b], nodes[a]), minus(nodes[c], nodes[a]))[axis];
    face_along = face_along && (found.labels[t] % 2 == 1 ? area > 0 : area < 0);
  }
  CHECK(are_flat);
  CHECK(face_along);
  CHECK(found.polycube_surface.triangles().size() == found.boundary.size());
  CHECK(found.polycube_surface.volume() == doctest::Approx(volumes(found.polycube, tets)[1]));
  CHECK(found.model_surface.volume() == doctest::Approx(volumes(found.model, tets)[1]));
  CHECK(BoundaryMap::between(found.polycube_surface, found.model_surface).target_volume() ==
        doctest::Approx(found.model_surface.volume()));
}

/// The steps of some work, in order; a refusal at any of them ends it without another call.
template <class Work>
std::string steps_that_cancel(const Work& work) {
  std::vector<std::string> steps;
  work([&](const Progress& progress) {
    if (std::find(steps.begin(), steps.end(), progress.step) == steps.end()) steps.push_back(progress.step);
    return true;
  });
  std::string all;
  for (const std::string& last : steps) {
    all += last + " ";
    int calls_after = -1;
    const auto until = [&](const Progress& progress) {
      if (calls_after >= 0) ++calls_after;
      if (progress.step == last && calls_after < 0) calls_after = 0;
      return calls_after < 0;
    };
    const std::string thrown = thrown_by([&] { work(until); });
    // What other threads do is asked for ten times in a second: a short step is not seen in every run.
    if (calls_after >= 0) CHECK(thrown == "cancelled");
    CHECK(calls_after <= 0);
  }
  return all;
}

}  // namespace

TEST_CASE("the defaults of polycubes and hexahedra in the headers are those of the library") {
  const auto check_polycubes = [](const PolycubeOptions& a, const PolycubeOptions& b) {
    CHECK(a.smoothness == b.smoothness);
    CHECK(a.feature_angle == b.feature_angle);
    CHECK(a.most_added == b.most_added);
    CHECK(a.attempts == b.attempts);
    CHECK(a.effort == b.effort);
    CHECK(a.lattice_along == b.lattice_along);
    CHECK(a.lattice_length == b.lattice_length);
    CHECK((a.orientation == b.orientation));
  };
  check_polycubes(PolycubeOptions(), PolycubeOptions::standard());
  const HexmeshOptions a, b = HexmeshOptions::standard();
  CHECK((a.kind == b.kind && a.polycube_kind == b.polycube_kind));
  CHECK(a.along == b.along);
  CHECK(a.length == b.length);
  CHECK(a.max_cells == b.max_cells);
  CHECK(a.max_distance == b.max_distance);
  check_polycubes(a.polycube, b.polycube);
  check_same(a.fit, b.fit);
  FitOptions fit;
  fit.tolerance = 0.002;
  check_same(a.fit, fit);
  CHECK(a.remesh.repair == b.remesh.repair);
  CHECK(a.remesh.slide == b.remesh.slide);
  CHECK(a.remesh.keep_boundary_map == b.remesh.keep_boundary_map);
  CHECK(a.remesh.polish == b.remesh.polish);
  CHECK(a.remesh.polish_valid == b.remesh.polish_valid);
  CHECK(a.remesh.most_added == b.remesh.most_added);
  CHECK(a.remesh.effort == b.remesh.effort);
  CHECK(a.remesh.memory == b.remesh.memory);
}

TEST_CASE("an L and a ring of boxes are their own polycubes") {
  const struct {
    Cubes cubes;
    std::size_t charts, corners;
    std::array<std::size_t, 3> planes;
  } cases[] = {{an_l, 8, 12, {3, 3, 2}}, {a_ring, 10, 16, {4, 4, 2}}};
  for (const auto& [cubes, charts, corners, planes] : cases) {
    const CellMesh model = boxes(cubes, 3);
    CHECK(volumes(model, model.tets())[1] == doctest::Approx(cubes.size()));
    const PolycubeMap found = make_polycube(model);
    check_promises(found, model);
    const PolycubeReport& report = found.report;
    CHECK(report.charts == charts);
    CHECK(report.corners == corners);
    CHECK(report.planes == planes);
    CHECK(report.attempts == 1);
    CHECK((report.labels == LabelSource::cut));
    CHECK(!report.features.has_value());
    CHECK(report.smoothness == PolycubeOptions().smoothness);
    CHECK(!report.lattice.has_value());
    CHECK(report.energy == doctest::Approx(7.0).epsilon(1e-6));
    CHECK(report.distortion.angle_p99 == doctest::Approx(1.0).epsilon(1e-3));
    CHECK(report.distortion.area_median == doctest::Approx(1.0).epsilon(1e-3));
    CHECK(volumes(found.polycube, found.polycube.tets())[1] == doctest::Approx(cubes.size()).epsilon(1e-3));
  }
}

TEST_CASE("labels of a polycube make it again, and labels of no polycube are refused") {
  const CellMesh given = boxes(an_l, 2);
  PolycubeOptions options;
  options.orientation = Orientation::principal;
  const PolycubeMap found = make_polycube(given, options);
  // The normals of an L are along the axes as they are.
  CHECK_FALSE(found.report.turn.has_value());
  REQUIRE(found.given_boundary.size() == found.given_labels.size());
  const PolycubeMap again = make_polycube_with_labels(given, found.given_boundary, found.given_labels);
  CHECK((again.report.labels == LabelSource::given));
  CHECK(farthest(again.polycube.nodes(), found.polycube.nodes()) == 0.0);
  CHECK(again.labels == found.labels);
  std::vector<std::uint8_t> labels = found.given_labels;
  labels[0] ^= 1;
  CHECK(thrown_by([&] { make_polycube_with_labels(given, found.given_boundary, labels); }) == "invalid_input");
  labels.pop_back();
  CHECK(thrown_by([&] { make_polycube_with_labels(given, found.given_boundary, labels); }) == "invalid_input");
}

TEST_CASE("a turned L is turned back") {
  const CellMesh given = boxes(an_l, 2);
  std::vector<Point> turned(given.nodes().begin(), given.nodes().end());
  for (Point& p : turned) p = {0.8 * p[0] - 0.6 * p[1], 0.6 * p[0] + 0.8 * p[1], p[2]};
  PolycubeOptions options;
  options.orientation = Orientation::principal;
  const PolycubeMap found = make_polycube({turned, std::vector<Tet>(given.tets().begin(), given.tets().end())}, options);
  CHECK(found.report.energy == doctest::Approx(7.0).epsilon(1e-6));
  REQUIRE(found.report.turn.has_value());
  CHECK(std::abs((*found.report.turn)[2][2] - 1) < 1e-9);
}

TEST_CASE("the planes of a polycube are put on a lattice") {
  const CellMesh model = boxes(an_l, 3);
  PolycubeOptions options;
  options.lattice_along = 7;
  CHECK(make_polycube(model, options).report.lattice == doctest::Approx(2.0 / 7).epsilon(1e-3));
  // The length takes precedence.
  options.lattice_length = 0.23;
  // No limit: nothing overflows.
  options.most_added = std::numeric_limits<double>::infinity();
  const PolycubeMap found = make_polycube(model, options);
  check_promises(found, model);
  REQUIRE(found.report.lattice.has_value());
  CHECK(*found.report.lattice == doctest::Approx(0.23));
  double farthest_off = 0;
  for (std::size_t t = 0; t < found.boundary.size(); ++t) {
    const double height = found.polycube.nodes()[found.boundary[t][0]][found.labels[t] / 2] / *found.report.lattice;
    farthest_off = std::max(farthest_off, std::abs(height - std::round(height)));
  }
  CHECK(farthest_off < 1e-9);
}

TEST_CASE("what has no polycube or hexahedra is an error with a category, and work can be cancelled") {
  const CellMesh model = boxes({{0, 0, 0}}, 2);
  const auto polycube = [&](auto change) {
    PolycubeOptions options;
    change(options);
    return thrown_by([&] { make_polycube(model, options); });
  };
  const double nan = std::nan("");
  CHECK(polycube([](PolycubeOptions& o) { o.smoothness = 0; }) == "invalid_input");
  CHECK(polycube([&](PolycubeOptions& o) { o.smoothness = nan; }) == "invalid_input");
  CHECK(polycube([&](PolycubeOptions& o) { o.feature_angle = nan; }) == "invalid_input");
  CHECK(polycube([&](PolycubeOptions& o) { o.feature_angle = 180; }) == "invalid_input");
  CHECK(polycube([](PolycubeOptions& o) { o.lattice_length = -1; }) == "invalid_input");
  CHECK(polycube([&](PolycubeOptions& o) { o.lattice_length = nan; }) == "invalid_input");
  CHECK(polycube([](PolycubeOptions& o) { o.attempts = 0; }) == "numerical");

  const auto hexmesh = [&](auto change) {
    HexmeshOptions options;
    change(options);
    return thrown_by([&] { make_hexmesh(model, options); });
  };
  CHECK(hexmesh([](HexmeshOptions& o) { o.along = 0; }) == "invalid_input");
  CHECK(hexmesh([](HexmeshOptions& o) { o.length = -1; }) == "invalid_input");
  CHECK(hexmesh([&](HexmeshOptions& o) { o.length = nan; }) == "invalid_input");
  CHECK(hexmesh([](HexmeshOptions& o) { o.max_distance = 0; }) == "invalid_input");
  CHECK(hexmesh([&](HexmeshOptions& o) { o.max_distance = nan; }) == "invalid_input");
  CHECK(hexmesh([](HexmeshOptions& o) { o.max_cells = 10; }) == "memory");
  CHECK(hexmesh([](HexmeshOptions& o) { o.fit.tolerance = -1; }) == "invalid_input");
  CHECK(hexmesh([](HexmeshOptions& o) { o.fit.memory = 0; }) == "invalid_input");
  CHECK(hexmesh([](HexmeshOptions& o) { o.polycube.smoothness = -1; }) == "invalid_input");
  CHECK(hexmesh([](HexmeshOptions& o) { o.kind = static_cast<CellKind>(7); }) == "invalid_input");
  CHECK(hexmesh([](HexmeshOptions& o) { o.polycube_kind = static_cast<PolycubeKind>(3); }) == "invalid_input");

  const auto model_polycube = [&](auto change) {
    ModelPolycubeOptions options;
    change(options);
    return thrown_by([&] { make_model_polycube(model, options); });
  };
  CHECK(model_polycube([](ModelPolycubeOptions& o) { o.kind = static_cast<PolycubeKind>(3); }) == "invalid_input");
  CHECK(model_polycube([](ModelPolycubeOptions& o) { o.deformation.smoothness = -1; }) == "invalid_input");
  CHECK(model_polycube([](ModelPolycubeOptions& o) {
          o.kind = PolycubeKind::deformed;
          o.deformation.attempts = 0;
        }) == "numerical");
  CHECK(hexmesh([](HexmeshOptions& o) {
          o.polycube_kind = PolycubeKind::deformed;
          o.polycube.attempts = 0;
        }) == "numerical");

  HexmeshOptions voxels;
  voxels.polycube_kind = PolycubeKind::voxels;
  const auto refused = [&](const CellMesh& mesh) {
    CHECK(thrown_by([&] { make_polycube(mesh); }) == "invalid_input");
    CHECK(thrown_by([&] { make_hexmesh(mesh); }) == "invalid_input");
    CHECK(thrown_by([&] { make_hexmesh(mesh, voxels); }) == "invalid_input");
  };
  // Hexahedra; nothing; a node that is not finite.
  const std::vector<Point> box = {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}, {0, 0, 1}, {1, 0, 1}, {1, 1, 1}, {0, 1, 1}};
  refused(CellMesh(box, std::vector<Hex>{{0, 1, 2, 3, 4, 5, 6, 7}}));
  refused(CellMesh(std::vector<Point>(), std::vector<Tet>()));
  std::vector<Point> odd(model.nodes().begin(), model.nodes().end());
  odd[0][1] = nan;
  refused(model.with_nodes(odd));
  // Flat cells.
  for (Point& p : odd) p[1] = 0;
  CHECK(thrown_by([&] { make_polycube(model.with_nodes(odd)); }) == "invalid_input");
  // Two tetrahedra with an edge in common, and no more.
  const std::vector<Point> pinched = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}, {-1, 0, 0}, {0, -1, 0}};
  refused(CellMesh(pinched, std::vector<Tet>{{0, 1, 2, 3}, {0, 4, 5, 3}}));

  const auto throws = [](const Progress&) -> bool { throw std::out_of_range("mine"); };
  CHECK_THROWS_WITH_AS(make_polycube(model, {}, throws), "mine", std::out_of_range);
  CHECK_THROWS_WITH_AS(make_hexmesh(model, {}, throws), "mine", std::out_of_range);
  PolycubeOptions lattice;
  lattice.lattice_along = 5;
  const CellMesh larger = boxes(an_l, 3);
  CHECK(steps_that_cancel([&](const ProgressCallback& callback) { make_polycube(larger, lattice, callback); }) ==
        "attempting labelling deforming snapping ");
}

TEST_CASE("an L of boxes is cut into hexahedra or tetrahedra by its polycube and a map that evaluates") {
  const CellMesh model = boxes(an_l, 3);
  for (const CellKind kind : {CellKind::hexes, CellKind::tets}) {
    HexmeshOptions options;
    options.kind = kind;
    options.along = 10;
    const Hexmesh made = make_hexmesh(model, options);
    CHECK(made.valid());
    CHECK(made.report.quality.inverted == 0);
    CHECK(made.mesh.inverted().empty());
    CHECK(made.crossings == 0);
    CHECK((made.mesh.kind() == kind && made.domain_mesh.kind() == kind));
    const auto [least, sum] = kind == CellKind::hexes ? volumes(made.mesh, made.mesh.hexes())
                                                      : volumes(made.mesh, made.mesh.tets());
    CHECK(least > 0);
    CHECK(sum == doctest::Approx(3.0).epsilon(1e-3));
    CHECK(made.report.volume == doctest::Approx(sum).epsilon(1e-3));
    CHECK(made.report.target_volume == doctest::Approx(3.0));
    CHECK(made.report.target_to_mesh_max < 1e-2);

    const CellMesh::Boundary boundary = made.mesh.boundary();
    CHECK(boundary.nodes.size() == made.report.boundary_nodes);
    CHECK(boundary.surface.check().solvable);
    if (kind == CellKind::hexes) {
      // Boxes need no padding, and stay boxes.
      REQUIRE(made.report.padding.has_value());
      CHECK(made.report.padding->quads == 0);
      CHECK(made.report.padding->of > 0);
      double worst = 1;
      for (const Hex& hex : made.mesh.hexes()) worst = std::min(worst, scaled_jacobian(made.mesh.nodes(), hex));
      CHECK(worst > 0.98);
      CHECK(worst == doctest::Approx(made.report.quality.min_scaled_jacobian));
    }

    REQUIRE(made.polycube.deformed.has_value());
    CHECK(!made.polycube.voxels.has_value());
    check_promises(*made.polycube.deformed, model);
    CHECK(made.polycube.deformed->report.lattice.has_value());
    // The map carries the cells from the polycube to the model, up to the boundary error and the repair.
    const double diagonal = made.map.boundary().target_diagonal();
    const double allowed = made.map.boundary_error().max + made.report.largest_shift + made.report.largest_slide;
    CHECK(farthest(made.map.evaluate(made.domain_mesh.nodes()), made.mesh.nodes()) <= 1.1 * allowed * diagonal + 1e-3);
    CHECK(made.map.boundary().domain().volume() == doctest::Approx(made.polycube.deformed->polycube_surface.volume()));
    double least_determinant = 1;
    for (const Matrix3& j : made.map.jacobian(made.domain_mesh.nodes())) {
      const double determinant = dot(cross({j[0], j[1], j[2]}, {j[3], j[4], j[5]}), {j[6], j[7], j[8]});
      least_determinant = std::min(least_determinant, determinant);
    }
    CHECK(least_determinant > 0);
  }
}

TEST_CASE("a step of any kind cancels the making of hexahedra, and voxels make them too") {
  const CellMesh model = boxes(an_l, 3);
  HexmeshOptions options;
  options.along = 8;
  const std::string deformed =
      steps_that_cancel([&](const ProgressCallback& callback) { make_hexmesh(model, options, callback); });
  CHECK(deformed.find("attempting labelling deforming snapping checking ") == 0);
  CHECK(deformed.find("meshing mapping repairing verifying ") != std::string::npos);

  options.polycube_kind = PolycubeKind::voxels;
  options.along = 4;
  std::string paired;
  const Hexmesh made = make_hexmesh(model, options, [&](const Progress& progress) {
    if (paired.find(progress.step) == std::string::npos) paired += progress.step + " ";
    return true;
  });
  CHECK(paired.find("attempting") == std::string::npos);
  CHECK(paired.find("aligning") != std::string::npos);
  CHECK(thrown_by([&] {
          make_hexmesh(model, options, [](const Progress& progress) { return progress.step != "aligning"; });
        }) == "cancelled");
  CHECK(!made.polycube.deformed.has_value());
  REQUIRE(made.polycube.voxels.has_value());
  CHECK(made.polycube.voxels->voxels == 24);
  CHECK(made.polycube.voxels->size == doctest::Approx(0.5));
  CHECK(made.polycube.voxels->cells == 1);
  CHECK(made.polycube.voxels->missed == 0);
  CHECK(made.polycube.voxels->tried == 1);
  CHECK(made.polycube.voxels->distortion.angle_median >= 1.0);
  CHECK(made.valid());
  CHECK(made.domain_mesh.boundary().surface.volume() == doctest::Approx(24 * 0.125));
  const auto [least, sum] = volumes(made.mesh, made.mesh.hexes());
  CHECK(least > 0);
  CHECK(sum == doctest::Approx(3.0).epsilon(0.05));
}

TEST_CASE("a polycube of a model comes with the map from its boundary, whether deformed or of voxels") {
  const CellMesh model = boxes(an_l, 3);
  for (const PolycubeKind kind : {PolycubeKind::automatic, PolycubeKind::voxels}) {
    ModelPolycubeOptions options;
    options.kind = kind;
    options.deformation.lattice_length = 0.5;
    const ModelPolycube made = make_model_polycube(model, options);
    CHECK(made.deformed.has_value() == (kind == PolycubeKind::automatic));
    CHECK(made.voxels.has_value() == (kind == PolycubeKind::voxels));
    CHECK(!made.simplified.has_value());
    const Surface polycube = made.boundary.domain();
    const auto triangles = polycube.triangles();
    const auto vertices = polycube.vertices();
    REQUIRE(made.labels.size() == triangles.size());
    for (std::size_t t = 0; t < triangles.size(); ++t) {
      const std::size_t axis = made.labels[t] / 2;
      const auto at = [&](int k) { return vertices[triangles[t][k]][axis]; };
      CHECK((at(0) == at(1) && at(1) == at(2)));
    }
    CHECK(made.boundary.target_volume() == doctest::Approx(3.0));
    if (made.deformed) check_promises(*made.deformed, model);
  }
}

TEST_CASE("two rings joined have hexahedra by voxels, with both holes") {
  Cubes two_rings = a_ring;
  two_rings.insert(two_rings.end(), {{3, 0, 0}, {4, 0, 0}, {4, 1, 0}, {3, 2, 0}, {4, 2, 0}});
  HexmeshOptions options;
  options.polycube_kind = PolycubeKind::voxels;
  options.along = 10;
  const Hexmesh made = make_hexmesh(boxes(two_rings, 2), options);
  REQUIRE(made.polycube.voxels.has_value());
  CHECK(made.valid());
  const auto surface = made.mesh.boundary().surface;
  const auto vertices = static_cast<long>(surface.vertices().size());
  const auto triangles = static_cast<long>(surface.triangles().size());
  CHECK(vertices - triangles / 2 == 2 - 2 * 2);
  const auto [least, sum] = volumes(made.mesh, made.mesh.hexes());
  CHECK(least > 0);
  CHECK(sum == doctest::Approx(13.0).epsilon(0.05));
}

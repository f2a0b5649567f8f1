#include "solidmap/mesh.hpp"

#include <cmath>

#include "access.hpp"

namespace solidmap {

using namespace detail;

Surface::Surface(Span<const Point> vertices, Span<const Triangle> triangles)
    : Surface(guarded([&] { return make_surface(ffi::surface_new(flat(vertices), flat(triangles))); })) {}

Surface Surface::load(const std::filesystem::path& path) {
  return guarded([&] { return make_surface(ffi::surface_load(PathBytes(path))); });
}

void Surface::save(const std::filesystem::path& path) const {
  guarded([&] { Access::of(*this).save(PathBytes(path)); });
}

Span<const Point> Surface::vertices() const& { return rows<Point>(Access::of(*this).vertices()); }
Span<const Triangle> Surface::triangles() const& { return rows<Triangle>(Access::of(*this).triangles()); }
std::vector<Point> Surface::vertices() && { return kept(static_cast<const Surface&>(*this).vertices()); }
std::vector<Triangle> Surface::triangles() && { return kept(static_cast<const Surface&>(*this).triangles()); }
double Surface::area() const { return Access::of(*this).area(); }
double Surface::volume() const { return Access::of(*this).volume(); }

std::array<Point, 2> Surface::bounding_box() const {
  const std::array<double, 6> box = Access::of(*this).bounding_box();
  return {Point{box[0], box[1], box[2]}, Point{box[3], box[4], box[5]}};
}

double Surface::diagonal() const {
  const auto [low, high] = bounding_box();
  return std::hypot(high[0] - low[0], high[1] - low[1], high[2] - low[2]);
}

CheckReport Surface::check(bool self_intersections) const {
  const ffi::CheckReport found = guarded([&] { return Access::of(*this).check(self_intersections); });
  CheckReport report;
  report.solvable = found.solvable;
  report.closed = found.closed;
  report.edge_manifold = found.edge_manifold;
  report.vertex_manifold = found.vertex_manifold;
  report.oriented = found.oriented;
  report.outward = found.outward;
  report.self_intersections = found.self_intersections;
  report.area = found.area;
  report.volume = found.volume;
  for (const ffi::Component& from : found.components) {
    Component& component = report.components.emplace_back();
    component.triangles = from.triangles;
    component.vertices = from.vertices;
    component.genus = from.genus;
    component.area = from.area;
    component.volume = from.volume;
    component.shell = from.shell;
    component.cavity = from.cavity;
  }
  for (const ffi::Finding& from : found.findings) {
    Finding& finding = report.findings.emplace_back();
    finding.kind = std::string(from.kind);
    finding.severity = static_cast<Severity>(from.severity);
    finding.count = from.count;
    finding.vertices = copied(from.vertices);
    for (std::size_t i = 0; i + 1 < from.edges.size(); i += 2) {
      finding.edges.push_back({from.edges[i], from.edges[i + 1]});
    }
    finding.triangles = copied(from.triangles);
    finding.message = std::string(from.message);
    finding.advice = std::string(from.advice);
  }
  report.text = std::string(found.text);
  return report;
}

Surface Surface::repaired(std::vector<std::string>* done) const {
  rust::Vec<rust::String> converted;
  Surface repaired = guarded([&] { return make_surface(Access::of(*this).repaired(converted)); });
  if (done != nullptr) {
    for (std::string& what : copied(converted)) done->push_back(std::move(what));
  }
  return repaired;
}

Surface Surface::with_holes_closed(std::size_t most_edges, std::size_t* closed) const {
  std::size_t count = 0;
  Surface surface = guarded([&] { return make_surface(Access::of(*this).with_holes_closed(most_edges, count)); });
  if (closed != nullptr) *closed = count;
  return surface;
}

PlaneSection plane_section(const Surface& surface, Axis axis, double position, std::size_t pixels, Axis up) {
  const ffi::PlaneSection found = guarded([&] {
    return ffi::plane_section(Access::of(surface), static_cast<std::uint8_t>(axis), position,
                              static_cast<std::uint8_t>(up), pixels);
  });
  PlaneSection section;
  section.size = found.size;
  section.pixel = found.pixel;
  section.area = found.area;
  section.coverage = copied(found.coverage);
  for (std::size_t i = 0; i < section.coverage.size(); ++i) {
    section.points.push_back({found.points[3 * i], found.points[3 * i + 1], found.points[3 * i + 2]});
    section.pixels.push_back({found.pixels[2 * i], found.pixels[2 * i + 1]});
  }
  return section;
}

namespace shapes {

Surface sphere(double radius, unsigned levels) {
  return guarded([&] { return make_surface(ffi::surface_sphere(radius, levels)); });
}

Surface cube(double size, std::size_t divisions) {
  return guarded([&] { return make_surface(ffi::surface_cube(size, divisions)); });
}

Surface polycube(Span<const std::array<std::int32_t, 3>> cubes, std::size_t divisions) {
  return guarded([&] { return make_surface(ffi::surface_polycube(flat(cubes), divisions)); });
}

Surface torus(double major, double minor, std::size_t around, std::size_t across) {
  return guarded([&] { return make_surface(ffi::surface_torus(major, minor, around, across)); });
}

}  // namespace shapes

namespace {

template <class Cell>
CellMesh made(Span<const Point> nodes, Span<const Cell> cells, Span<const std::int32_t> regions) {
  std::vector<std::int32_t> none;
  if (regions.empty()) {
    none.assign(cells.size(), 0);
    regions = none;
  }
  return guarded([&] {
    if constexpr (std::is_same_v<Cell, Tet>) {
      return make_cells(ffi::cells_tets(flat(nodes), flat(cells), slice(regions)));
    } else {
      return make_cells(ffi::cells_hexes(flat(nodes), flat(cells), slice(regions)));
    }
  });
}

}  // namespace

CellMesh::CellMesh(Span<const Point> nodes, Span<const Tet> tets, Span<const std::int32_t> regions)
    : CellMesh(made(nodes, tets, regions)) {}
CellMesh::CellMesh(Span<const Point> nodes, Span<const Hex> hexes, Span<const std::int32_t> regions)
    : CellMesh(made(nodes, hexes, regions)) {}

CellMesh CellMesh::load(const std::filesystem::path& path) {
  return guarded([&] { return make_cells(ffi::cells_load(PathBytes(path))); });
}

void CellMesh::save(const std::filesystem::path& path) const {
  guarded([&] { Access::of(*this).save(PathBytes(path)); });
}

CellKind CellMesh::kind() const { return Access::of(*this).are_hexes() ? CellKind::hexes : CellKind::tets; }
std::size_t CellMesh::size() const { return Access::of(*this).regions().size(); }
Span<const Point> CellMesh::nodes() const& { return rows<Point>(Access::of(*this).nodes()); }

Span<const Tet> CellMesh::tets() const& {
  const ffi::VolumeMesh& cells = Access::of(*this);
  return cells.are_hexes() ? Span<const Tet>() : rows<Tet>(cells.corners());
}

Span<const Hex> CellMesh::hexes() const& {
  const ffi::VolumeMesh& cells = Access::of(*this);
  return cells.are_hexes() ? rows<Hex>(cells.corners()) : Span<const Hex>();
}

Span<const std::int32_t> CellMesh::regions() const& {
  const auto regions = Access::of(*this).regions();
  return {regions.data(), regions.size()};
}
std::vector<Point> CellMesh::nodes() && { return kept(static_cast<const CellMesh&>(*this).nodes()); }
std::vector<Tet> CellMesh::tets() && { return kept(static_cast<const CellMesh&>(*this).tets()); }
std::vector<Hex> CellMesh::hexes() && { return kept(static_cast<const CellMesh&>(*this).hexes()); }
std::vector<std::int32_t> CellMesh::regions() && { return kept(static_cast<const CellMesh&>(*this).regions()); }

CellMesh CellMesh::with_nodes(Span<const Point> nodes) const {
  return guarded([&] { return make_cells(Access::of(*this).with_nodes(flat(nodes))); });
}

CellMesh::Boundary CellMesh::boundary() const {
  rust::Vec<std::uint32_t> nodes;
  Surface surface = guarded([&] { return make_surface(Access::of(*this).boundary(nodes)); });
  return {std::move(surface), copied(nodes)};
}

CellReport CellMesh::check() const {
  const ffi::CellReport found = guarded([&] { return Access::of(*this).check(); });
  CellReport report;
  report.valid = found.valid;
  report.inverted = found.inverted;
  report.flat = found.flat;
  report.slivers = found.slivers;
  for (std::size_t i = 0; i < found.body_cells.size(); ++i) {
    report.bodies.push_back({found.body_cells[i], found.body_volumes[i]});
  }
  for (const ffi::CellFinding& from : found.findings) {
    CellFinding& finding = report.findings.emplace_back();
    finding.kind = std::string(from.kind);
    finding.severity = static_cast<Severity>(from.severity);
    finding.count = from.count;
    finding.cells = copied(from.cells);
    finding.vertices = copied(from.vertices);
    for (std::size_t i = 0; i + 2 < from.places.size(); i += 3) {
      finding.places.push_back({from.places[i], from.places[i + 1], from.places[i + 2]});
    }
    finding.message = std::string(from.message);
    finding.advice = std::string(from.advice);
  }
  report.text = std::string(found.text);
  return report;
}

std::vector<std::uint32_t> CellMesh::inverted() const {
  return guarded([&] { return copied(Access::of(*this).inverted()); });
}

CellQuality CellMesh::quality() const {
  return guarded([&] { return quality_of(Access::of(*this).quality()); });
}

CellQuality detail::quality_of(const ffi::CellQuality& found) {
  CellQuality quality;
  quality.cells = found.cells;
  quality.inverted = found.inverted;
  quality.min_scaled_jacobian = found.min_scaled_jacobian;
  quality.p01_scaled_jacobian = found.p01_scaled_jacobian;
  quality.mean_scaled_jacobian = found.mean_scaled_jacobian;
  quality.min_dihedral = found.min_dihedral;
  quality.max_dihedral = found.max_dihedral;
  return quality;
}

}  // namespace solidmap

/// \file
/// Surfaces that bound solids, what is wrong with them, and solids cut into cells.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <limits>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "solidmap/span.hpp"

namespace solidmap {

namespace detail {
struct Access;
struct SurfaceImpl;
struct CellMeshImpl;
}  // namespace detail

/// How bad a finding is: whether it prevents a fit; a note is no defect.
enum class Severity { error, warning, note };

/// One thing that is wrong with a surface.
struct Finding {
  /// The kind of defect, such as `"open_edges"`, `"non_manifold_edges"`, `"self_intersections"`,
  /// `"duplicate_vertices"`.
  std::string kind;
  /// Errors prevent a fit, warnings do not; many of these are repaired by Surface::repaired().
  Severity severity = Severity::error;
  /// How many of them there are.
  std::size_t count = 0;
  /// The first vertices, edges and triangles concerned, at most 20 of each.
  std::vector<std::uint32_t> vertices;
  std::vector<std::array<std::uint32_t, 2>> edges;
  std::vector<std::uint32_t> triangles;
  /// What was found and where, and how to repair it.
  std::string message;
  std::string advice;
};

/// A part of a surface that is connected across edges.
struct Component {
  std::size_t triangles = 0;
  std::size_t vertices = 0;
  /// Number of handles; -1 unless it is a closed manifold.
  std::int64_t genus = -1;
  double area = 0;
  /// Volume that it encloses, positive when it faces outward; NaN when it encloses none.
  double volume = std::numeric_limits<double>::quiet_NaN();
  /// Whether it bounds a volume, and whether that volume is a cavity of another component.
  bool shell = false;
  bool cavity = false;
};

/// What Surface::check() found.
struct CheckReport {
  /// Whether the surface, once repaired, bounds a solid: no finding is an error. fit() repairs by itself.
  bool solvable = false;
  /// Every edge has at least two triangles; no edge has more than two; the triangles at each vertex form one fan.
  bool closed = false;
  bool edge_manifold = false;
  bool vertex_manifold = false;
  /// Neighbours are oriented consistently; solids face outward, and cavities into the cavity.
  bool oriented = false;
  bool outward = false;
  /// Number of pairs of triangles that intersect; -1 when they were not looked for.
  std::int64_t self_intersections = -1;
  double area = 0;
  /// Volume of the solid, cavities taken out, once repaired; NaN when there is none.
  double volume = std::numeric_limits<double>::quiet_NaN();
  std::vector<Component> components;
  /// Errors first.
  std::vector<Finding> findings;
  /// All of it in words, several lines.
  std::string text;
};

/// A triangle surface, the boundary of a solid when it is closed. Immutable; copies share their data and cost nothing.
///
/// Only indices are checked. Coordinates may be infinite and the surface open: check() tells.
class Surface {
 public:
  /// Copies the arrays; n vertices in model units, m triangles.
  /// Throws Error (invalid_input) when an index is out of range.
  Surface(Span<const Point> vertices, Span<const Triangle> triangles);

  /// Reads .obj, .ply, .off, .stl, .mesh, .msh, .vtk or .vtu. Vertices keep their order; polygons become triangles.
  /// Throws Error (not_found, io, unsupported, or invalid_input for a damaged file).
  static Surface load(const std::filesystem::path& path);
  /// Writes .obj, .ply, .off, .mesh, .msh, .vtk or .vtu, whose coordinates read back to the same bits, or .stl (single
  /// precision). The file is replaced as a
  /// whole or not at all. Throws Error (io, unsupported).
  void save(const std::filesystem::path& path) const;

  /// Views, valid as long as this object or a copy of it lives; of a temporary, copies.
  Span<const Point> vertices() const&;
  Span<const Triangle> triangles() const&;
  std::vector<Point> vertices() &&;
  std::vector<Triangle> triangles() &&;

  double area() const;
  /// Enclosed volume: positive when closed and outward. Cavities, oriented into the cavity, count negatively.
  double volume() const;
  /// Lowest and highest corner of the box of all triangles; zeros without any.
  std::array<Point, 2> bounding_box() const;
  /// Length of the bounding box's diagonal, of which reported errors are fractions.
  double diagonal() const;

  /// What is wrong, where, and how to repair it. Linear in the size but for nested components.
  /// `self_intersections` needs a build with CGAL; throws Error (unsupported) without.
  CheckReport check(bool self_intersections = false) const;
  /// The same surface with triangles reversed so that neighbours agree, solids face outward and cavities into the
  /// cavity; vertices and triangles keep their indices. What was done is added to `done`, in words.
  Surface repaired(std::vector<std::string>* done = nullptr) const;
  /// The same surface with holes of up to `most_edges` edges (at most 1000) closed by triangles over the vertices of
  /// their rims, appended; costs the cube of a hole's edges. `closed` gets the number of holes. Throws Error
  /// (invalid_input), and closes none, when a hole is larger, or all together are more than a hundredth of the area.
  Surface with_holes_closed(std::size_t most_edges = 100, std::size_t* closed = nullptr) const;

 private:
  friend struct detail::Access;
  explicit Surface(std::shared_ptr<const detail::SurfaceImpl> impl) : impl_(std::move(impl)) {}
  std::shared_ptr<const detail::SurfaceImpl> impl_;
};

/// Built-in solids, for trials and tests. All throw Error (invalid_input) for sizes that make no solid.
namespace shapes {

/// A sphere about the origin, an icosahedron subdivided `levels` times (0 to 9): `10 * 4^levels + 2` vertices.
Surface sphere(double radius, unsigned levels);
/// The cube [-size/2, size/2]^3, each side in `divisions`^2 squares of two triangles.
Surface cube(double size, std::size_t divisions);
/// The union of unit cubes with their lowest corners at integer positions, each outer face in `divisions`^2 squares.
Surface polycube(Span<const std::array<std::int32_t, 3>> cubes, std::size_t divisions);
/// A torus about the z axis: `around` divisions of the circle of radius `major`, `across` of the tube.
Surface torus(double major, double minor, std::size_t around, std::size_t across);

}  // namespace shapes

/// A coordinate axis.
enum class Axis : std::uint8_t { x, y, z };

/// Where a plane perpendicular to a coordinate axis cuts a solid: a point of the solid for each pixel of a picture of
/// it. The picture frames the whole solid as seen along the axis.
struct PlaneSection {
  /// Width and height of the picture in pixels, and the side of a pixel in model units.
  std::array<std::size_t, 2> size = {};
  double pixel = 0;
  /// Area of the section in squared model units.
  double area = 0;
  /// One point for each pixel that the section covers: fields are evaluated here.
  std::vector<Point> points;
  /// Column and row (the first at the top) of each point's pixel, and the part of it that is covered, up to 1.
  std::vector<std::array<std::uint32_t, 2>> pixels;
  std::vector<float> coverage;
};

/// The section of the solid at `position` along `axis`, `pixels` (16 to 8192) along the longer side of the picture,
/// with `up` pointing up in it; where `up` is `axis`, the later of the two other axes. Throws Error (invalid_input)
/// when the plane cuts nothing, or the surface is open there.
PlaneSection plane_section(const Surface& surface, Axis axis, double position, std::size_t pixels = 512,
                           Axis up = Axis::z);

/// What the cells of a CellMesh are.
enum class CellKind { tets, hexes };

/// How good cells are. Values are NaN for a mesh without cells.
struct CellQuality {
  std::size_t cells = 0;
  /// Cells that are inverted or flat: tetrahedra by exact predicates, hexahedra at their corners, and by bounds inside.
  std::size_t inverted = 0;
  /// Minimum, 1 % quantile and mean over the cells of the scaled Jacobian, the least value in each cell: 1 for a
  /// regular tetrahedron or a cube.
  double min_scaled_jacobian = 0;
  double p01_scaled_jacobian = 0;
  double mean_scaled_jacobian = 0;
  /// Smallest and largest dihedral angle, degrees.
  double min_dihedral = 0;
  double max_dihedral = 0;
};

/// Something found in a mesh of cells.
struct CellFinding {
  /// What was found, such as `"inverted_cells"`, `"flat_cells"`, `"crowded_faces"`, `"duplicate_cells"`,
  /// `"hanging_nodes"`, `"mismatched_faces"`, `"slivers"`, `"several_bodies"`.
  std::string kind;
  /// An error where the mesh is not valid; else a note.
  Severity severity = Severity::error;
  std::size_t count = 0;
  /// The first cells and vertices concerned, at most 20 of each, and where they are: the positions of `vertices`, or else
  /// the means of the corners of `cells`.
  std::vector<std::uint32_t> cells;
  std::vector<std::uint32_t> vertices;
  std::vector<Point> places;
  /// What was found and where, and what to do about it.
  std::string message;
  std::string advice;
};

/// Cells that are connected across faces.
struct Body {
  std::size_t cells = 0;
  /// Sum of their volumes, inverted ones negative.
  double volume = 0;
};

/// What CellMesh::check() found.
struct CellReport {
  /// No finding is an error: all cells are right side out, have a volume, and fit together.
  bool valid = false;
  /// Cells that are inverted; exactly flat; neither, but with a scaled Jacobian below 0.05.
  std::size_t inverted = 0, flat = 0, slivers = 0;
  std::vector<Body> bodies;
  /// Errors first.
  std::vector<CellFinding> findings;
  /// All of it in words, several lines.
  std::string text;
};

/// A solid cut into tetrahedra or hexahedra. Immutable; copies share their data and cost nothing.
class CellMesh {
 public:
  /// Copies the arrays. `regions` has the region of each cell; empty: all are 0. Cells of either orientation are kept.
  /// Throws Error (invalid_input) when an index is out of range or the counts do not fit.
  CellMesh(Span<const Point> nodes, Span<const Tet> tets, Span<const std::int32_t> regions = {});
  CellMesh(Span<const Point> nodes, Span<const Hex> hexes, Span<const std::int32_t> regions = {});

  /// Reads .mesh, .msh, .vtk or .vtu; regions are the references of .mesh files and the physical groups of .msh files in
  /// format 2.2. Throws Error as Surface::load().
  static CellMesh load(const std::filesystem::path& path);
  /// Writes .mesh and .msh (Gmsh 2.2) with regions, .vtk and .vtu without; as a whole or not at all. Throws Error (io,
  /// unsupported).
  void save(const std::filesystem::path& path) const;

  CellKind kind() const;
  /// Number of cells.
  std::size_t size() const;
  /// Views, valid as long as this object or a copy of it lives; of a temporary, copies. tets() is empty for hexahedra,
  /// hexes() for tetrahedra.
  Span<const Point> nodes() const&;
  Span<const Tet> tets() const&;
  Span<const Hex> hexes() const&;
  Span<const std::int32_t> regions() const&;
  std::vector<Point> nodes() &&;
  std::vector<Tet> tets() &&;
  std::vector<Hex> hexes() &&;
  std::vector<std::int32_t> regions() &&;

  /// The same cells with other positions of the nodes, such as their images by a map.
  /// Throws Error (invalid_input) when their count differs.
  CellMesh with_nodes(Span<const Point> nodes) const;

  /// The faces that belong to one cell only, as triangles that face outward. `nodes[v]` is the mesh's node of vertex v. A
  /// quad of a hexahedron is split by the diagonal from its first corner, as everywhere in solidmap.
  struct Boundary {
    Surface surface;
    std::vector<std::uint32_t> nodes;
  };
  Boundary boundary() const;

  /// Which cells are inverted, flat or slivers, and whether the cells fit together. Orientation is decided exactly. A cell
  /// counts as inverted when its neighbours, oriented consistently across their faces, have the other sign: all cells may
  /// be listed left-handed. The boundary is a surface with a check of its own.
  CellReport check() const;

  /// Indices of the cells that are inverted or flat, ascending; decided as CellQuality::inverted.
  std::vector<std::uint32_t> inverted() const;
  CellQuality quality() const;

 private:
  friend struct detail::Access;
  explicit CellMesh(std::shared_ptr<const detail::CellMeshImpl> impl) : impl_(std::move(impl)) {}
  std::shared_ptr<const detail::CellMeshImpl> impl_;
};

}  // namespace solidmap

/// \file
/// Tetrahedra by TetGen or CGAL, offset surfaces, and meshes carried by maps with inverted cells repaired.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "solidmap/harmonic_map.hpp"
#include "solidmap/mesh.hpp"
#include "solidmap/progress.hpp"
#include "solidmap/worst_place.hpp"

namespace solidmap {

/// How tetrahedralise() works.
struct TetOptions {
  enum class Mesher {
    /// Keeps the boundary's vertices and triangles as they are.
    tetgen,
    /// CGAL's Mesh_3, which makes boundary triangles of its own.
    cgal,
  };
  Mesher mesher = Mesher::tetgen;
  /// tetgen: largest ratio of circumradius to shortest edge, at least 1.1; 0: no refinement inside.
  double radius_edge_ratio = 1.414;
  /// tetgen: smallest dihedral angle aimed for, degrees, 0 to 20. Needs `radius_edge_ratio`.
  double min_dihedral = 0;
  /// tetgen: volume of a tetrahedron to aim for; 0: none.
  double max_volume = 0;
  /// cgal: largest circumradius of a tetrahedron; 0: a twentieth of the bounding box's diagonal.
  double cell_size = 0;
  /// cgal: largest distance of the mesh's boundary from the surface; 0: a twentieth of `cell_size`.
  double facet_distance = 0;
  /// cgal: edges whose triangles' normals differ by more than this many degrees are kept.
  double feature_angle = 60;
  /// cgal: seconds after which Error (native) is thrown.
  double time_limit = 300;
  /// Bytes that the run may take, estimated before they are taken: more throws Error (memory). 0: no limit.
  std::uint64_t memory = 0;
};

/// Tetrahedra that fill the solid inside `surface`. With tetgen the first nodes are the surface's vertices, bit for
/// bit. TetGen runs once at a time in a process; other calls wait. Throws Error: unsupported without CGAL and TetGen
/// (has_native()), invalid_input (open, degenerate, intersecting itself), memory, native, cancelled. Neither mesher can be
/// interrupted: a cancelled call returns at once, but its thread and memory are free only when the mesher has ended.
CellMesh tetrahedralise(const Surface& surface, const TetOptions& options = {}, const ProgressCallback& progress = {});

/// How offset_surface() works.
struct OffsetOptions {
  /// Alpha of CGAL's alpha wrapping, about the edge length: gaps narrower than twice this are filled. 0: half of the
  /// distance.
  double alpha = 0;
  /// Rounds of remeshing and projection; 0 returns the wrap, whose distance is about 1 % off.
  std::size_t rounds = 3;
  /// How often alpha may be halved when a surface does not pass its checks.
  std::size_t retries = 2;
  /// Smallest distance to the model that the surface may have, as a fraction of the distance asked for.
  double min_fraction = 0.5;
  /// Largest number of triangles.
  std::size_t max_triangles = 2'000'000;
};

/// A closed surface around a model, clear of it, without self-intersections.
struct OffsetSurface {
  Surface surface;
  /// Largest errors of the distance at vertices and at the centroids of triangles, and the smallest distance, all in
  /// model units.
  double vertex_error = 0, centroid_error = 0, min_distance = 0;
  /// Number of handles, and of components: parts of the model closer than twice the distance share one.
  std::size_t genus = 0, components = 0;
  /// The wrap's parameter alpha, in model units.
  double alpha = 0;
  /// Whether this is the wrap itself, since no projected surface passed its checks.
  bool raw_wrap = false;
};

/// The surface at `distance` (model units) outside a closed one, which may intersect itself; cavities get none. Throws
/// Error as tetrahedralise().
OffsetSurface offset_surface(const Surface& surface, double distance, const OffsetOptions& options = {},
                             const ProgressCallback& progress = {});

/// A regular mesh of a polycube.
struct RegularMesh {
  CellKind kind = CellKind::hexes;
  /// Cells along the longest side of the domain. Between neighbouring planes of the polycube their number is rounded up,
  /// of tetrahedra to an even one; hexahedra get an additional layer along the boundary.
  std::size_t along = 16;
  /// Side of a cell, in model units; replaces `along` unless it is 0.
  double length = 0;
  /// Largest number of cells: more throw Error (memory) before any is made.
  std::size_t max_cells = 20'000'000;
};

/// How remesh() repairs.
struct RemeshOptions {
  /// Whether inner nodes are moved until no cell is inverted.
  bool repair = true;
  /// Whether boundary nodes may slide along the target where inner nodes alone cannot help.
  bool slide = true;
  /// Whether a regular mesh stays on the map's boundary map. Otherwise, where it cannot be repaired under that, a boundary map of
  /// less distortion is sought, as BoundaryMap::pair() finds it, and taken if the mesh is better under it.
  bool keep_boundary_map = false;
  /// Iterations at most that improve the shapes of cells after the repair; 0 for none. They never lower the least scaled
  /// Jacobian nor its 1 % quantile.
  std::size_t polish = 200;
  /// Whether a mesh is polished, too, in which nothing is inverted as mapped.
  bool polish_valid = false;
  /// Largest number of tetrahedra that splitting may add where moving nodes does not suffice; 0 for no splitting. A third
  /// of those that the mesh has, and 5000, where there is no value.
  std::optional<std::size_t> most_added;
  /// Work after which a repair ends although cells stay inverted: iterations of descent for each cell in the mean.
  double effort = 2000;
  /// Bytes that the run may take, estimated before they are taken: more throws Error (memory). 0: no limit.
  std::uint64_t memory = 0;
};

/// What became of the polish: none was asked for; none was made, since nothing was inverted as mapped or cells stay
/// inverted; no node had a better place; shapes are better; or it would have lowered the least scaled Jacobian or its 1 %
/// quantile, and was undone.
enum class PolishOutcome : std::uint8_t { not_asked, nothing_inverted, cells_inverted, no_gain, kept, undone };

/// How far the boundary map of a mesh is from the one that was given, at the nodes on the boundary as mapped.
struct OtherBoundary {
  double mean_shift = 0, largest_shift = 0;
};

/// Where regular hexahedra have a padding layer: the quads of the grid's boundary with one of its hexahedra below them, and all.
struct Padding {
  std::size_t quads = 0, of = 0;
};

/// The report on a carried mesh. Distances, shifts and slides are fractions of the target's diagonal.
struct RemeshReport {
  std::size_t nodes = 0, boundary_nodes = 0;
  /// Below those faces of the polycube where it makes angles better; there for regular hexahedra alone.
  std::optional<Padding> padding;
  /// Inverted cells before the repair; those left are in `quality`.
  std::size_t inverted_as_mapped = 0;
  /// The cells as mapped, and as they are now.
  CellQuality quality_as_mapped, quality;
  PolishOutcome polish = PolishOutcome::not_asked;
  /// Largest at points half as far apart as the boundary's edges are long in the mean, and means over the area.
  double mesh_to_target_max = 0, mesh_to_target_mean = 0, target_to_mesh_max = 0, target_to_mesh_mean = 0;
  /// Volumes of the mesh and of the target.
  double volume = 0, target_volume = 0;
  /// There where a regular mesh could not be repaired under the given boundary map, and another one was taken.
  std::optional<OtherBoundary> other_boundary;
  /// How far the repair moved inner nodes, and boundary nodes along the target.
  double largest_shift = 0;
  std::size_t slid_nodes = 0;
  double largest_slide = 0;
  /// Tetrahedra that splitting added where nodes were stuck. Nodes that it added follow all others.
  std::size_t cells_added = 0;
  /// Edges of the boundary of a regular mesh that were split where it passed through itself, and the tetrahedra that this
  /// added.
  std::size_t boundary_edges_split = 0, boundary_cells_added = 0;
  /// Whether the repair began with the inner nodes by finite elements on the cells of the mesh: of tetrahedra where that
  /// inverted fewer than the map, and of any cells under another boundary map.
  bool from_finite_elements = false;
  double seconds = 0;
  /// Where cells stay inverted, in the target: at most five groups, the largest first.
  std::vector<WorstPlace> worst_places;
};

/// A mesh of the target, and the mesh of the domain that it was carried from.
struct Remeshed {
  CellMesh mesh;
  CellMesh domain_mesh;
  RemeshReport report;
};

/// A regular mesh of the map's domain, which has to be a polycube, or a given mesh of it, carried into the target and
/// repaired. About 4 s for 100 000 tetrahedra and 30 s for 100 000 hexahedra on two cores. Cells that stay inverted are
/// not an error: they are counted in the report. Throws Error: invalid_input (not a polycube, a mesh of another solid),
/// unsupported (a map without boundary map), memory (more cells or bytes than allowed), cancelled.
Remeshed remesh(const HarmonicMap& map, const RegularMesh& cells, const RemeshOptions& options = {},
                const ProgressCallback& progress = {});
Remeshed remesh(const HarmonicMap& map, const CellMesh& mesh, const RemeshOptions& options = {},
                const ProgressCallback& progress = {});

}  // namespace solidmap

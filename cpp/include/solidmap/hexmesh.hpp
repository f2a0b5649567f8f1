/// \file
/// From a model to its hexahedra, by a polycube.
#pragma once

#include <cstddef>

#include "solidmap/fit.hpp"
#include "solidmap/harmonic_map.hpp"
#include "solidmap/mesh.hpp"
#include "solidmap/model_polycube.hpp"
#include "solidmap/polycube.hpp"
#include "solidmap/progress.hpp"
#include "solidmap/solids.hpp"

namespace solidmap {

/// How make_hexmesh() works.
struct HexmeshOptions {
  CellKind kind = CellKind::hexes;
  /// Cells along the longest side of the polycube, which is about as large as the model.
  std::size_t along = 32;
  /// Side of a cell in the polycube, in model units; replaces `along` unless it is 0.
  double length = 0;
  /// Largest number of cells: more throw Error (memory) before any is made.
  std::size_t max_cells = 20'000'000;
  /// How far the model may be from the mesh, or the mesh's boundary from the model, as a fraction of the model's diagonal,
  /// before another polycube is tried; positive.
  double max_distance = 0.05;
  /// As ModelPolycubeOptions::max_vertices. The mesh's boundary is on the model itself.
  std::size_t max_vertices = 6000;
  /// With PolycubeKind::automatic, voxels are also tried where the deformed model leads to a poor mesh, and the better mesh is returned.
  PolycubeKind polycube_kind = PolycubeKind::automatic;
  /// How the model is deformed. The lattice is chosen by the size of the cells.
  PolycubeOptions polycube;
  /// How the map is fitted.
  FitOptions fit = standard_fit();
  /// How the cells are repaired and polished.
  RemeshOptions remesh;

  /// The same as HexmeshOptions().
  static HexmeshOptions standard();
  /// FitOptions() with a tolerance of 0.002: boundary nodes are where the boundary map puts them, not the fitted one.
  static FitOptions standard_fit();
};

/// A model's mesh of hexahedra or tetrahedra, and what it was made by.
struct Hexmesh {
  /// The mesh. `mesh.boundary()` has its boundary triangles and nodes, which lie on the model's surface.
  CellMesh mesh;
  /// The same cells, with the same nodes, in the polycube.
  CellMesh domain_mesh;
  /// The harmonic map from the polycube to the model; its boundary() has both surfaces. The nodes of `mesh` are their
  /// images by it only up to the boundary error and the repair.
  HarmonicMap map;
  /// Cells that are inverted as mapped and now, their shapes (least, 1 % and mean scaled Jacobian in `quality`),
  /// distances from the model to the mesh and back. The target is the model.
  RemeshReport report;
  /// Pairs of boundary triangles that pass through each other, quads as two triangles.
  std::size_t crossings = 0;
  /// The polycube. Its boundary map is that of `map`.
  ModelPolycube polycube;

  /// Whether no cell is inverted or flat, and no boundary triangles pass through each other.
  bool valid() const { return report.quality.inverted == 0 && crossings == 0; }
};

/// Meshes a solid, given as tetrahedra, with hexahedra or regular tetrahedra: a polycube of it with its faces on a
/// lattice, the harmonic map from the polycube, and the lattice's cells carried by it, repaired and polished. All cells
/// but those in the layer of hexahedra along the boundary have one size in the polycube.
///
/// Several polycubes may be tried (PolycubeKind). The first mesh is returned that is valid and within `max_distance` of
/// the model, else the one with the fewest faults: cells that stay inverted are not an error, see Hexmesh::valid() and
/// the report.
///
/// A model of 50 000 tetrahedra takes 15 s to a minute on two cores. The steps are those of make_model_polycube(), fit() and
/// remesh(); with a second polycube they begin again.
///
/// Throws Error: numerical (no polycube was found), invalid_input (hexahedra, a model or option that cannot be used),
/// memory (more cells or bytes than allowed), cancelled, and else as fit() and
/// remesh().
Hexmesh make_hexmesh(const CellMesh& model, const HexmeshOptions& options = {}, const ProgressCallback& progress = {});

}  // namespace solidmap

/// \file
/// Polycubes of models of any size, with the maps from their boundaries to the models'.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "solidmap/boundary_map.hpp"
#include "solidmap/mesh.hpp"
#include "solidmap/polycube.hpp"
#include "solidmap/progress.hpp"

namespace solidmap {

/// Where a polycube comes from.
enum class PolycubeKind : std::uint8_t {
  /// A deformation of the model if one attempt finds one (with two handles or more: if any attempt does), else voxels.
  automatic,
  /// The model, or a simplified one, deformed, as by make_polycube().
  deformed,
  /// Cubes of one size that fill the model and reach its limbs.
  voxels,
};

/// How make_model_polycube() works.
struct ModelPolycubeOptions {
  PolycubeKind kind = PolycubeKind::automatic;
  /// A model of genus 0 whose surface has more vertices, or one with handles with more than 2.5 times as many, is simplified, and its
  /// polycube is that of the simplified one, mapped to the model itself. Without CGAL it is deformed as it is.
  std::size_t max_vertices = 6000;
  /// How the model is deformed. Voxels are on the same lattice, or one of 32 cells along the longest side of the model.
  PolycubeOptions deformation;

  /// The same as ModelPolycubeOptions().
  static ModelPolycubeOptions standard();
};

/// What is known of a simplified model.
struct SimplifiedReport {
  /// Vertices of its surface, and of the model's.
  std::size_t vertices = 0;
  std::size_t of = 0;
  /// How its surface is distorted to the model's.
  SurfaceDistortion distortion;
};

/// What is known of a polycube of voxels.
struct VoxelReport {
  std::size_t voxels = 0;
  /// Their edge length, in model units, and cells of the lattice (in a mesh: its own) along an edge.
  double size = 0;
  std::size_t cells = 0;
  /// Vertices of the model that are farther than a voxel from the polycube.
  std::size_t missed = 0;
  /// How many such polycubes were tried.
  std::size_t tried = 0;
  /// How the boundary is distorted from the polycube to the model.
  SurfaceDistortion distortion;
};

/// A polycube of a model.
struct ModelPolycube {
  /// The map from the polycube's boundary, `boundary.domain()`, to the model's. Linear over the triangles where the model itself was
  /// deformed; else every point of the polycube's boundary has its point on the model's own surface.
  BoundaryMap boundary;
  /// The direction that each triangle of `boundary.domain()` faces along: 0 to 5 for -x, +x, -y, +y, -z, +z.
  std::vector<std::uint8_t> labels;
  /// The model, or the simplified one, deformed; else the polycube consists of voxels. One of the two has a value.
  std::optional<PolycubeMap> deformed;
  std::optional<VoxelReport> voxels;
  /// The simplified model that was deformed, where it was not the model itself.
  std::optional<SimplifiedReport> simplified;
};

/// A polycube of a solid that is given as tetrahedra: a deformation or voxels (PolycubeKind).
///
/// The steps are those of make_polycube(), BoundaryMap::pair() (for voxels and simplified models), and `"simplifying"`.
///
/// Throws Error: numerical (no polycube was found), invalid_input (hexahedra, a model or option that cannot be used), cancelled.
ModelPolycube make_model_polycube(const CellMesh& model, const ModelPolycubeOptions& options = {},
                                  const ProgressCallback& progress = {});

}  // namespace solidmap

// Meshes a solid with hexahedra, by a polycube of it and the harmonic map from there.
//
//   hexmesh                          a ring with a square profile, twisted, of tetrahedra made here; writes hexes.vtk
//   hexmesh MODEL OUTPUT [ALONG]     a file of tetrahedra, or a surface, which TetGen fills if the library has it; ALONG cells
//                                    along the longest side of the polycube (32). OUTPUT: .vtk, .vtu, .mesh or .msh
#include <array>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <vector>

#include "solidmap/solidmap.hpp"

namespace {

using solidmap::Point;

/// Shows the step; false would end the work.
bool show(const solidmap::Progress& progress) {
  std::fprintf(stderr, "\r%-36s %-60s", progress.step.c_str(), progress.detail.c_str());
  return true;
}

/// A ring about the z axis: a bar of 48 by 4 by 4 boxes, bent until its ends meet, each box cut into six tetrahedra.
solidmap::CellMesh ring() {
  constexpr int around = 48, across = 4;
  std::vector<Point> nodes;
  for (int i = 0; i < around; ++i) {
    const double angle = 2 * std::acos(-1.0) * i / around, tilt = 0.5 * std::sin(angle);
    for (int j = 0; j <= across; ++j) {
      for (int k = 0; k <= across; ++k) {
        const double x = 0.8 * (j - 0.5 * across) / across, z = 0.8 * (k - 0.5 * across) / across;
        const double radius = 1.5 + std::cos(tilt) * x - std::sin(tilt) * z;
        nodes.push_back({radius * std::cos(angle), radius * std::sin(angle), std::sin(tilt) * x + std::cos(tilt) * z});
      }
    }
  }
  const auto node = [](const std::array<int, 3>& at) {
    return static_cast<std::uint32_t>((at[0] % around * (across + 1) + at[1]) * (across + 1) + at[2]);
  };
  // The ways from the lowest corner of a box to the highest, along its edges; each is a tetrahedron.
  const int ways[6][3] = {{0, 1, 2}, {1, 2, 0}, {2, 0, 1}, {0, 2, 1}, {1, 0, 2}, {2, 1, 0}};
  std::vector<solidmap::Tet> tets;
  for (int box = 0; box < around * across * across; ++box) {
    for (const auto& way : ways) {
      std::array<int, 3> at = {box / (across * across), box / across % across, box % across};
      solidmap::Tet tet = {node(at)};
      for (int k = 0; k < 3; ++k) {
        ++at[way[k]];
        tet[k + 1] = node(at);
      }
      // Either orientation is taken, and any mixture of them.
      tets.push_back(tet);
    }
  }
  return {nodes, tets};
}

/// The tetrahedra of a file, or those that fill its surface.
solidmap::CellMesh model_of(const char* path) {
  try {
    return solidmap::CellMesh::load(path);
  } catch (const solidmap::Error& error) {
    using solidmap::Category;
    if (error.category() != Category::unsupported && error.category() != Category::invalid_input) throw;
  }
  return solidmap::tetrahedralise(solidmap::Surface::load(path));
}

void mesh(const solidmap::CellMesh& model, std::size_t along, const char* output) {
  solidmap::HexmeshOptions options;
  options.along = along;
  const solidmap::Hexmesh made = solidmap::make_hexmesh(model, options, show);
  std::fprintf(stderr, "\r%100s\r", "");
  if (made.polycube.deformed) {
    const solidmap::PolycubeReport& report = made.polycube.deformed->report;
    std::printf("polycube: %zu tetrahedra, deformed; %zu charts, %zu corners\n", report.tets, report.charts,
                report.corners);
  } else {
    std::printf("polycube: %zu voxels of %.3g\n", made.polycube.voxels->voxels, made.polycube.voxels->size);
  }
  const solidmap::CellQuality& quality = made.report.quality;
  std::printf("mesh: %zu hexahedra, %zu inverted (%zu as mapped), %zu pairs of boundary triangles cross\n", quality.cells,
              quality.inverted, made.report.inverted_as_mapped, made.crossings);
  std::printf("scaled Jacobian: least %.2f, 1 %% %.2f, mean %.2f; model to mesh at most %.1e of the diagonal\n",
              quality.min_scaled_jacobian, quality.p01_scaled_jacobian, quality.mean_scaled_jacobian,
              made.report.target_to_mesh_max);
  made.mesh.save(output);
  std::printf("written: %s\n", output);
}

}  // namespace

int main(int argc, char** argv) {
  if (argc == 2 || argc > 4) {
    std::fprintf(stderr, "usage: hexmesh [MODEL OUTPUT [ALONG]]\n");
    return 2;
  }
  try {
    if (argc == 1) {
      mesh(ring(), 20, "hexes.vtk");
    } else {
      mesh(model_of(argv[1]), argc == 4 ? std::strtoul(argv[3], nullptr, 10) : 32, argv[2]);
    }
  } catch (const solidmap::Error& error) {
    std::fprintf(stderr, "\rerror (%s): %s\n", solidmap::name(error.category()), error.what());
    return 1;
  }
}

// Carries a tetrahedral mesh along when its boundary is deformed.
//
//   morph_tets                                  a ball that is twisted, its mesh made here; writes morphed.vtu
//   morph_tets DOMAIN IMAGE TETS OUTPUT         files: the boundary, the same mesh deformed, a tet mesh of its inside
#include <cmath>
#include <cstdio>
#include <vector>

#include "solidmap/solidmap.hpp"

namespace {

using solidmap::Point;

/// Tetrahedra of the ball: by TetGen if the library has it, else a regular mesh of a cube, carried to the ball.
solidmap::CellMesh tets_of_ball(const solidmap::Surface& ball) {
  if (solidmap::has_native()) return solidmap::tetrahedralise(ball);
  const solidmap::Surface cube = solidmap::shapes::cube(2.0, 8);
  std::vector<Point> images;
  for (const Point& p : cube.vertices()) {
    const double length = std::hypot(p[0], p[1], p[2]);
    // A little inside the unit sphere, as the ball's triangles are.
    images.push_back({0.95 * p[0] / length, 0.95 * p[1] / length, 0.95 * p[2] / length});
  }
  solidmap::RegularMesh grid;
  grid.kind = solidmap::CellKind::tets;
  return solidmap::remesh(solidmap::fit(solidmap::BoundaryMap(cube, images)), grid).mesh;
}

Point twisted(const Point& p) {
  const double angle = 1.2 * p[2], c = std::cos(angle), s = std::sin(angle);
  return {c * p[0] - s * p[1], s * p[0] + c * p[1], 1.3 * p[2]};
}

void morph(const solidmap::BoundaryMap& boundary, const solidmap::CellMesh& tets, const char* output) {
  const solidmap::HarmonicMap map = solidmap::fit(boundary);
  const solidmap::FitReport report = map.report();
  std::printf("fitted: %zu vertices, %zu sources, boundary error rms %.1e, max %.1e of the target's size, %.2f s\n",
              report.vertices, report.sources, report.boundary_error.rms, report.boundary_error.max, report.seconds);

  solidmap::CellMesh morphed = tets.with_nodes(map.evaluate(tets.nodes()));
  const solidmap::CellQuality before = tets.quality(), after = morphed.quality();
  std::printf("carried: %zu cells with %zu nodes; inverted %zu before, %zu after; mean scaled Jacobian %.2f, %.2f\n",
              tets.size(), tets.nodes().size(), before.inverted, after.inverted, before.mean_scaled_jacobian,
              after.mean_scaled_jacobian);
  if (after.inverted > 0) {
    // Slivers may become inverted where a map is not linear. This carries the mesh again, and moves inner nodes.
    const solidmap::Remeshed repaired = solidmap::remesh(map, tets);
    std::printf("repaired: inverted %zu, mean scaled Jacobian %.2f, nodes moved by at most %.1e of the target's size\n",
                repaired.report.quality.inverted, repaired.report.quality.mean_scaled_jacobian,
                repaired.report.largest_shift);
    morphed = repaired.mesh;
  }
  morphed.save(output);
  std::printf("written: %s\n", output);
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 1 && argc != 5) {
    std::fprintf(stderr, "usage: morph_tets [DOMAIN IMAGE TETS OUTPUT]\n");
    return 2;
  }
  try {
    if (argc == 5) {
      const auto domain = solidmap::Surface::load(argv[1]);
      const auto image = solidmap::Surface::load(argv[2]);
      morph(solidmap::BoundaryMap::between(domain, image), solidmap::CellMesh::load(argv[3]), argv[4]);
    } else {
      const solidmap::Surface ball = solidmap::shapes::sphere(1.0, 3);
      std::vector<Point> images;
      for (const Point& p : ball.vertices()) images.push_back(twisted(p));
      morph(solidmap::BoundaryMap(ball, images), tets_of_ball(ball), "morphed.vtu");
    }
  } catch (const solidmap::Error& error) {
    std::fprintf(stderr, "error (%s): %s\n", solidmap::name(error.category()), error.what());
    return 1;
  }
}

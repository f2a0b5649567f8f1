// CGAL's alpha wrap: Portaneri, Rouxel-Labbe, Hemmer, Cohen-Steiner, Alliez, "Alpha wrapping with an offset", ACM
// Transactions on Graphics 41 (2022).
#include <CGAL/alpha_wrap_3.h>

#include "soup.h"

namespace solidmap::cgal_tetgen {

Arrays wrap(SurfaceView surface, double alpha, double offset) {
  const std::vector<Point> points = points_of(surface);
  const auto triangles = nondegenerate_triangles(surface, points);
  if (triangles.empty()) throw Failure(kCgal, "no triangle has an area");
  SurfaceMesh mesh;
  CGAL::alpha_wrap_3(points, triangles, alpha, offset, mesh);
  return arrays_of(mesh);
}

}  // namespace solidmap::cgal_tetgen

// Triangles of plain arrays as a half-edge mesh.
#pragma once

#include <CGAL/Polygon_mesh_processing/orient_polygon_soup.h>
#include <CGAL/Polygon_mesh_processing/polygon_soup_to_polygon_mesh.h>

#include "soup.h"

namespace solidmap::cgal_tetgen {

/// The non-degenerate triangles, oriented alike. Non-manifold vertices are duplicated in place.
inline SurfaceMesh halfedge_mesh_of(const SurfaceView& surface) {
  namespace PMP = CGAL::Polygon_mesh_processing;
  std::vector<Point> points = points_of(surface);
  auto triangles = nondegenerate_triangles(surface, points);
  PMP::orient_polygon_soup(points, triangles);
  SurfaceMesh mesh;
  PMP::polygon_soup_to_polygon_mesh(points, triangles, mesh);
  return mesh;
}

}  // namespace solidmap::cgal_tetgen

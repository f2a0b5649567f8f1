// Isotropic remeshing of closed manifold surfaces.
#include <CGAL/Polygon_mesh_processing/detect_features.h>
#include <CGAL/Polygon_mesh_processing/remesh.h>

#include "soup.h"

namespace solidmap::cgal_tetgen {

Arrays remesh(SurfaceView surface, double edge_length, double feature_angle) {
  SurfaceMesh mesh;
  for (const Point& p : points_of(surface)) mesh.add_vertex(p);
  for (std::size_t t = 0; t < surface.triangles; ++t) {
    const std::uint32_t* c = surface.corners + 3 * t;
    using Vertex = SurfaceMesh::Vertex_index;
    if (mesh.add_face(Vertex(c[0]), Vertex(c[1]), Vertex(c[2])) == SurfaceMesh::null_face())
      throw Failure(kCgal, "triangle " + std::to_string(t) + " does not fit a manifold surface");
  }
  namespace PMP = CGAL::Polygon_mesh_processing;
  auto stays = mesh.add_property_map<SurfaceMesh::Edge_index, bool>("e:stays", false).first;
  if (feature_angle > 0) PMP::detect_sharp_edges(mesh, feature_angle, stays);
  PMP::isotropic_remeshing(faces(mesh), edge_length, mesh,
                           CGAL::parameters::number_of_iterations(1).edge_is_constrained_map(stays));
  return arrays_of(mesh);
}

}  // namespace solidmap::cgal_tetgen

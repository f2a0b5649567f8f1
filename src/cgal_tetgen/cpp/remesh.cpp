// Isotropic remeshing of closed manifold surfaces.
#include <CGAL/Polygon_mesh_processing/remesh.h>

#include "soup.h"

namespace solidmap::cgal_tetgen {

Arrays remesh(SurfaceView surface, double edge_length) {
  SurfaceMesh mesh;
  for (const Point& p : points_of(surface)) mesh.add_vertex(p);
  for (std::size_t t = 0; t < surface.triangles; ++t) {
    const std::uint32_t* c = surface.corners + 3 * t;
    using Vertex = SurfaceMesh::Vertex_index;
    if (mesh.add_face(Vertex(c[0]), Vertex(c[1]), Vertex(c[2])) == SurfaceMesh::null_face())
      throw Failure(kCgal, "triangle " + std::to_string(t) + " does not fit a manifold surface");
  }
  CGAL::Polygon_mesh_processing::isotropic_remeshing(faces(mesh), edge_length, mesh,
                                                     CGAL::parameters::number_of_iterations(1));
  return arrays_of(mesh);
}

}  // namespace solidmap::cgal_tetgen

// Closest points and inside tests by an AABB tree.
#include <CGAL/AABB_face_graph_triangle_primitive.h>
#include <CGAL/AABB_traits.h>
#include <CGAL/AABB_tree.h>
#include <CGAL/Polygon_mesh_processing/measure.h>
#include <CGAL/Side_of_triangle_mesh.h>

#include "halfedge_mesh.h"

namespace solidmap::cgal_tetgen {

namespace {

using Tree = CGAL::AABB_tree<CGAL::AABB_traits<Kernel, CGAL::AABB_face_graph_triangle_primitive<SurfaceMesh>>>;
using Side = CGAL::Side_of_triangle_mesh<SurfaceMesh, Kernel>;

SurfaceMesh mesh_with_area(const SurfaceView& surface) {
  SurfaceMesh mesh = halfedge_mesh_of(surface);
  if (mesh.number_of_faces() == 0) throw Failure(kCgal, "no triangle has an area");
  return mesh;
}

}  // namespace

struct DistanceField::Impl {
  explicit Impl(const SurfaceView& surface)
      : mesh(mesh_with_area(surface)), tree(faces(mesh).first, faces(mesh).second, mesh) {
    // Everything that CGAL builds lazily, including the k-d tree of the first query: threads would race for it later.
    tree.build();
    tree.accelerate_distance_queries();
    tree.closest_point(mesh.point(*mesh.vertices().begin()));
    side = std::make_unique<Side>(tree);
  }

  SurfaceMesh mesh;
  Tree tree;
  std::unique_ptr<Side> side;
};

DistanceField::DistanceField(SurfaceView surface) : impl_(std::make_unique<Impl>(surface)) {}

DistanceField::~DistanceField() = default;

void DistanceField::closest(const double* points, std::size_t count, double* closest) const {
  for (std::size_t k = 0; k < 3 * count; k += 3) {
    const Point p = impl_->tree.closest_point(Point(points[k], points[k + 1], points[k + 2]));
    closest[k] = p.x();
    closest[k + 1] = p.y();
    closest[k + 2] = p.z();
  }
}

void DistanceField::inside(const double* points, std::size_t count, std::uint8_t* inside) const {
  for (std::size_t k = 0; k < count; ++k) {
    const Point p(points[3 * k], points[3 * k + 1], points[3 * k + 2]);
    inside[k] = (*impl_->side)(p) == CGAL::ON_BOUNDED_SIDE;
  }
}

double DistanceField::volume() const { return CGAL::to_double(CGAL::Polygon_mesh_processing::volume(impl_->mesh)); }

}  // namespace solidmap::cgal_tetgen

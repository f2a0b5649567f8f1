/// \file
/// Conversions between CGAL::Surface_mesh and this library, header only. Needs CGAL 5, whose licence then binds the
/// program; the library itself may be built without it.
#pragma once

#include <CGAL/Surface_mesh.h>
#include <CGAL/number_utils.h>

#include <vector>

#include "solidmap/solidmap.hpp"

namespace solidmap::cgal {

/// A point of any kernel.
template <class CgalPoint>
Point point(const CgalPoint& p) {
  return {CGAL::to_double(p.x()), CGAL::to_double(p.y()), CGAL::to_double(p.z())};
}

/// The points of all vertices except removed ones, in the order of `mesh.vertices()`.
template <class CgalPoint>
std::vector<Point> points(const CGAL::Surface_mesh<CgalPoint>& mesh) {
  std::vector<Point> points;
  points.reserve(mesh.number_of_vertices());
  for (const auto v : mesh.vertices()) points.push_back(point(mesh.point(v)));
  return points;
}

/// The mesh as a surface, its vertices in the order of `mesh.vertices()`. Throws Error (invalid_input) for faces that
/// are not triangles.
template <class CgalPoint>
Surface surface(const CGAL::Surface_mesh<CgalPoint>& mesh) {
  std::vector<std::uint32_t> number(mesh.num_vertices());
  std::uint32_t next = 0;
  for (const auto v : mesh.vertices()) number[static_cast<std::size_t>(v)] = next++;
  std::vector<Triangle> triangles;
  triangles.reserve(mesh.number_of_faces());
  for (const auto face : mesh.faces()) {
    Triangle corners = {};
    std::size_t count = 0;
    for (const auto v : CGAL::vertices_around_face(mesh.halfedge(face), mesh)) {
      if (count < 3) corners[count] = number[static_cast<std::size_t>(v)];
      ++count;
    }
    if (count != 3) {
      throw Error(Category::invalid_input, "a face of the mesh has " + std::to_string(count) +
                                               " corners; triangulate it (CGAL::Polygon_mesh_processing)");
    }
    triangles.push_back(corners);
  }
  return Surface(points(mesh), triangles);
}

/// A surface as a mesh. Throws Error (invalid_input) when it is not a manifold.
template <class Mesh>
Mesh mesh(const Surface& surface) {
  Mesh mesh;
  mesh.reserve(static_cast<typename Mesh::size_type>(surface.vertices().size()),
               static_cast<typename Mesh::size_type>(3 * surface.triangles().size() / 2),
               static_cast<typename Mesh::size_type>(surface.triangles().size()));
  std::vector<typename Mesh::Vertex_index> vertices;
  for (const Point& p : surface.vertices()) vertices.push_back(mesh.add_vertex({p[0], p[1], p[2]}));
  for (const Triangle& t : surface.triangles()) {
    if (mesh.add_face(vertices[t[0]], vertices[t[1]], vertices[t[2]]) == Mesh::null_face()) {
      throw Error(Category::invalid_input, "the surface is not a manifold, as CGAL::Surface_mesh requires");
    }
  }
  return mesh;
}

/// The boundary map that sends each vertex of `domain` to its point in the property map `image`.
template <class CgalPoint, class PropertyMap>
BoundaryMap boundary_map(const CGAL::Surface_mesh<CgalPoint>& domain, const PropertyMap& image) {
  std::vector<Point> images;
  images.reserve(domain.number_of_vertices());
  for (const auto v : domain.vertices()) images.push_back(point(get(image, v)));
  return BoundaryMap(surface(domain), images);
}

/// Moves every vertex of a mesh inside the map's domain to its image.
template <class CgalPoint>
void apply(const HarmonicMap& map, CGAL::Surface_mesh<CgalPoint>& mesh) {
  const std::vector<Point> images = map.evaluate(points(mesh));
  std::size_t i = 0;
  for (const auto v : mesh.vertices()) {
    mesh.point(v) = CgalPoint(images[i][0], images[i][1], images[i][2]);
    ++i;
  }
}

}  // namespace solidmap::cgal

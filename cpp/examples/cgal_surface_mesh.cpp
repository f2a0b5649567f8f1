// For programs that have their geometry in CGAL::Surface_mesh: a deformation of a skin, known at its vertices, is
// carried to a mesh inside it.
//
//   cgal_surface_mesh                              an icosphere that is bent, with a smaller one inside
//   cgal_surface_mesh SKIN DEFORMED INNER OUTPUT   closed triangle meshes that CGAL reads; SKIN and DEFORMED correspond
#include <CGAL/Polygon_mesh_processing/IO/polygon_mesh_io.h>
#include <CGAL/Polygon_mesh_processing/measure.h>
#include <CGAL/Simple_cartesian.h>
#include <CGAL/Surface_mesh.h>
#include <CGAL/boost/graph/generators.h>
#include <CGAL/subdivision_method_3.h>

#include <cmath>
#include <cstdio>

#include "solidmap/cgal.hpp"

namespace {

namespace PMP = CGAL::Polygon_mesh_processing;
using Kernel = CGAL::Simple_cartesian<double>;
using Mesh = CGAL::Surface_mesh<Kernel::Point_3>;

Mesh icosphere(double radius) {
  Mesh mesh;
  CGAL::make_icosahedron(mesh, Kernel::Point_3(0, 0, 0), 1.0);
  CGAL::Subdivision_method_3::Loop_subdivision(mesh, CGAL::parameters::number_of_iterations(3));
  for (const auto v : mesh.vertices()) {
    const Kernel::Vector_3 x = mesh.point(v) - CGAL::ORIGIN;
    mesh.point(v) = CGAL::ORIGIN + x * (radius / std::sqrt(x.squared_length()));
  }
  return mesh;
}

Kernel::Point_3 bent(const Kernel::Point_3& p) {
  const double angle = 0.5 * p.x(), radius = 2.0 - p.z();
  return {radius * std::sin(angle), p.y(), 2.0 - radius * std::cos(angle)};
}

/// Moves `inner` along with the deformation of `skin`, which is given by a property of the skin's vertices.
void carry(const Mesh& skin, const Mesh::Property_map<Mesh::Vertex_index, Kernel::Point_3>& deformed, Mesh& inner) {
  const solidmap::CheckReport report = solidmap::cgal::surface(skin).check();
  std::printf("skin: %zu vertices, volume %.4f, %s\n", static_cast<std::size_t>(skin.number_of_vertices()),
              PMP::volume(skin), report.solvable ? "bounds a solid" : report.text.c_str());
  const solidmap::HarmonicMap map = solidmap::fit(solidmap::cgal::boundary_map(skin, deformed));
  std::printf("map: boundary error 99 %% %.1e of the target's size\n", map.boundary_error().p99);
  const double before = PMP::volume(inner);
  solidmap::cgal::apply(map, inner);
  std::printf("inner: %zu vertices, volume %.4f before and %.4f after\n",
              static_cast<std::size_t>(inner.number_of_vertices()), before, PMP::volume(inner));
}

Mesh read(const char* path) {
  Mesh mesh;
  if (!PMP::IO::read_polygon_mesh(path, mesh)) {
    throw solidmap::Error(solidmap::Category::io, std::string("CGAL cannot read `") + path + "`");
  }
  return mesh;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 1 && argc != 5) {
    std::fprintf(stderr, "usage: cgal_surface_mesh [SKIN DEFORMED INNER OUTPUT]\n");
    return 2;
  }
  try {
    Mesh skin = argc == 5 ? read(argv[1]) : icosphere(1.0);
    Mesh inner = argc == 5 ? read(argv[3]) : icosphere(0.6);
    const auto deformed = skin.add_property_map<Mesh::Vertex_index, Kernel::Point_3>("v:deformed").first;
    if (argc == 5) {
      const Mesh target = read(argv[2]);
      if (target.number_of_vertices() != skin.number_of_vertices()) {
        throw solidmap::Error(solidmap::Category::invalid_input, "the meshes do not have the same vertices");
      }
      for (const auto v : skin.vertices()) deformed[v] = target.point(v);
    } else {
      for (const auto v : skin.vertices()) deformed[v] = bent(skin.point(v));
    }
    carry(skin, deformed, inner);
    const char* output = argc == 5 ? argv[4] : "carried.off";
    if (!CGAL::IO::write_polygon_mesh(output, inner)) {
      throw solidmap::Error(solidmap::Category::io, std::string("CGAL cannot write `") + output + "`");
    }
    std::printf("written: %s\n", output);
  } catch (const solidmap::Error& error) {
    std::fprintf(stderr, "error (%s): %s\n", solidmap::name(error.category()), error.what());
    return 1;
  }
}

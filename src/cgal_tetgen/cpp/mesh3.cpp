// CGAL's Delaunay refinement mesher. Sequential on purpose: the parallel version is slower at these sizes and not
// deterministic.
#include <CGAL/Mesh_complex_3_in_triangulation_3.h>
#include <CGAL/Mesh_criteria_3.h>
#include <CGAL/Mesh_triangulation_3.h>
#include <CGAL/Polygon_mesh_processing/connected_components.h>
#include <CGAL/Polyhedral_mesh_domain_with_features_3.h>
#include <CGAL/exude_mesh_3.h>
#include <CGAL/make_mesh_3.h>
#include <CGAL/perturb_mesh_3.h>
#include <CGAL/refine_mesh_3.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <condition_variable>
#include <mutex>
#include <set>
#include <thread>
#include <unordered_map>

#include "halfedge_mesh.h"

namespace solidmap::cgal_tetgen {

namespace {

using Polyhedron = SurfaceMesh;
using Domain = CGAL::Polyhedral_mesh_domain_with_features_3<Kernel, Polyhedron>;
using Triangulation = CGAL::Mesh_triangulation_3<Domain, CGAL::Default, CGAL::Sequential_tag>::type;
using Complex = CGAL::Mesh_complex_3_in_triangulation_3<Triangulation, Domain::Corner_index, Domain::Curve_index>;
using Criteria = CGAL::Mesh_criteria_3<Triangulation>;

/// Stops refinement that does not terminate before memory runs out.
constexpr std::size_t kMaxVertices = 5'000'000;

/// Raises a flag after some seconds, unless it is destroyed first.
class Deadline {
 public:
  explicit Deadline(double seconds)
      : end_(std::chrono::steady_clock::now() +
             std::chrono::duration_cast<std::chrono::steady_clock::duration>(std::chrono::duration<double>(seconds))),
        thread_([this] {
          std::unique_lock<std::mutex> lock(mutex_);
          passed = !wake_.wait_until(lock, end_, [this] { return done_; });
        }) {}

  ~Deadline() {
    {
      std::lock_guard<std::mutex> lock(mutex_);
      done_ = true;
    }
    wake_.notify_one();
    thread_.join();
  }

  /// Seconds left, always positive: CGAL takes 0 for no limit.
  double left() const {
    return std::max(1e-3, std::chrono::duration<double>(end_ - std::chrono::steady_clock::now()).count());
  }

  std::atomic<bool> passed{false};

 private:
  std::chrono::steady_clock::time_point end_;
  std::mutex mutex_;
  std::condition_variable wake_;
  bool done_ = false;
  std::thread thread_;
};

using Faces = std::vector<Polyhedron::Face_index>;

std::vector<Faces> shells_of(const Polyhedron& polyhedron) {
  std::unordered_map<Polyhedron::Face_index, std::size_t> shell_map;
  const auto shell_of = boost::make_assoc_property_map(shell_map);
  std::vector<Faces> shells(CGAL::Polygon_mesh_processing::connected_components(polyhedron, shell_of));
  for (auto f : polyhedron.faces()) shells[get(shell_of, f)].push_back(f);
  return shells;
}

/// Puts protecting balls along the sharp edges, so that refinement keeps them. CGAL's own call lets balls shrink
/// without bound where edges nearly touch; here they stop at the mesh's distance tolerance.
void protect_edges(Complex& complex, const Domain& domain, const Criteria& criteria, double smallest,
                   CGAL::Mesh_error_code& stop, Deadline& deadline) {
  using EdgeCriteria = Criteria::Edge_criteria;
  using Sizing = CGAL::Mesh_3::internal::Edge_criteria_sizing_field_wrapper<EdgeCriteria>;
  const EdgeCriteria& edges = criteria.edge_criteria_object();
  CGAL::Mesh_3::Protect_edges_sizing_field<Complex, Domain, Sizing> protect(
      complex, domain, Sizing(edges), smallest, kMaxVertices, &stop, &deadline.passed);
  protect(true);
}

/// Inserts `count` points of a shell, at random positions in their faces: regularly placed seeds may be cospherical,
/// which CGAL reports as an error. Points within protecting balls are left out.
void seed(Complex& complex, const Domain& domain, const Faces& shell, std::size_t count, CGAL::Random& random) {
  const Polyhedron& polyhedron = domain.polyhedra().front();
  const auto patch = get(CGAL::face_patch_id_t<int>(), polyhedron);
  auto& triangulation = complex.triangulation();
  const auto weighted = triangulation.geom_traits().construct_weighted_point_3_object();
  for (std::size_t k = 0; k < count; ++k) {
    const auto f = shell[k * shell.size() / count];
    const auto h = polyhedron.halfedge(f);
    const double a = random.get_double(0.2, 0.4), b = random.get_double(0.2, 0.4);
    const Point p = CGAL::barycenter(polyhedron.point(polyhedron.source(h)), a, polyhedron.point(polyhedron.target(h)),
                                     b, polyhedron.point(polyhedron.target(polyhedron.next(h))), 1 - a - b);
    const auto v = triangulation.insert(weighted(p));
    // Null where a protecting ball covers the point.
    if (v == Triangulation::Vertex_handle()) continue;
    complex.set_dimension(v, 2);
    complex.set_index(v, domain.index_from_surface_patch_index(get(patch, f)));
  }
}

/// Whether the mesh has facets of every shell.
bool has_every_shell(const Complex& complex, const Domain& domain, const std::vector<Faces>& shells) {
  std::set<int> met;
  for (auto f = complex.facets_in_complex_begin(); f != complex.facets_in_complex_end(); ++f)
    met.insert(complex.surface_patch_index(*f));
  const auto patch = get(CGAL::face_patch_id_t<int>(), domain.polyhedra().front());
  return std::all_of(shells.begin(), shells.end(), [&](const Faces& shell) {
    return std::any_of(shell.begin(), shell.end(), [&](auto f) { return met.count(get(patch, f)) > 0; });
  });
}

Arrays arrays_of(const Complex& complex) {
  Arrays out;
  std::unordered_map<Complex::Vertex_handle, std::uint32_t> number;
  for (auto cell = complex.cells_in_complex_begin(); cell != complex.cells_in_complex_end(); ++cell) {
    for (int k = 0; k < 4; ++k) {
      const auto v = cell->vertex(k);
      const auto [entry, is_new] = number.try_emplace(v, static_cast<std::uint32_t>(number.size()));
      if (is_new) out.xyz.insert(out.xyz.end(), {v->point().x(), v->point().y(), v->point().z()});
      out.corners.push_back(entry->second);
    }
  }
  return out;
}

}  // namespace

Arrays mesh3(SurfaceView surface, const Mesh3Options& options) {
  namespace params = CGAL::parameters;
  // Warnings would be printed; their causes show in the result.
  CGAL::set_warning_handler([](const char*, const char*, const char*, int, const char*) {});
  // CGAL's default generator keeps its state from one call to the next.
  CGAL::get_default_random() = CGAL::Random(0);
  CGAL::Random random(0);

  Domain domain(halfedge_mesh_of(surface), &random);
  domain.detect_features(options.feature_angle);
  const Criteria criteria(params::edge_size = options.edge_size, params::facet_angle = options.facet_angle,
                          params::facet_size = options.facet_size, params::facet_distance = options.facet_distance,
                          params::cell_radius_edge_ratio = options.cell_radius_edge_ratio,
                          params::cell_size = options.cell_size);

  // By default CGAL starts from rays through the centre of the box, or from sharp edges, and never finds a smooth
  // shell that neither of them meets. Refinement needs a facet of each shell to start from: seeds are added until there
  // is one.
  const std::vector<Faces> shells = shells_of(domain.polyhedra().front());
  std::size_t most = 0;
  for (const Faces& shell : shells) most = std::max(most, shell.size());
  // An unfinished mesh is an error, so that results do not depend on timing.
  Deadline deadline(options.seconds);
  CGAL::Mesh_error_code stop = CGAL::CGAL_MESH_3_NO_ERROR;
  const auto check = [&](bool in_time) {
    if (stop == CGAL::CGAL_MESH_3_MAXIMAL_NUMBER_OF_VERTICES_REACHED)
      throw Failure(kStopped, std::to_string(kMaxVertices) + " vertices were reached");
    if (!in_time || stop != CGAL::CGAL_MESH_3_NO_ERROR) throw Failure(kStopped, "the time limit passed");
  };
  for (std::size_t count = 24;; count *= 4) {
    Complex complex;
    protect_edges(complex, domain, criteria, options.facet_distance, stop, deadline);
    check(true);
    for (const Faces& shell : shells) seed(complex, domain, shell, std::min(count, shell.size()), random);
    // Refinement crashes without cells of dimension 3, and perturbation and exudation without cells in the complex.
    const bool solid = complex.triangulation().dimension() == 3;
    if (solid)
      CGAL::refine_mesh_3(complex, domain, criteria, params::no_perturb(), params::no_exude(),
                            params::mesh_3_options(params::maximal_number_of_vertices = kMaxVertices,
                                                   params::pointer_to_error_code = &stop,
                                                   params::pointer_to_stop_atomic_boolean = &deadline.passed));
    check(true);
    if (solid && complex.number_of_cells_in_complex() > 0 && has_every_shell(complex, domain, shells)) {
      check(CGAL::perturb_mesh_3(complex, domain, params::time_limit = deadline.left()) != CGAL::TIME_LIMIT_REACHED);
      check(CGAL::exude_mesh_3(complex, params::time_limit = deadline.left()) != CGAL::TIME_LIMIT_REACHED);
      return arrays_of(complex);
    }
    if (count >= most) return {};
  }
}

}  // namespace solidmap::cgal_tetgen

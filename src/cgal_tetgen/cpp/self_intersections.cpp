// Intersecting triangles of any triangle soup, by exact predicates. CGAL 5.5 has this only for half-edge meshes, which
// cannot hold non-manifold or inconsistently oriented surfaces.
#include <CGAL/Box_intersection_d/Box_with_info_d.h>
#include <CGAL/box_intersection_d.h>

#include <algorithm>
#include <array>
#include <numeric>
#include <string>
#include <vector>

#include "soup.h"

namespace solidmap::cgal_tetgen {

namespace {

/// Bounds memory to gigabytes.
constexpr std::size_t kMaxPairs = 10'000'000;

using Triangle = Kernel::Triangle_3;
using Segment = Kernel::Segment_3;

/// For each vertex the first one at the same position, so that triangles on both sides of a seam of repeated vertices
/// are neighbours.
std::vector<std::uint32_t> first_at_position(const std::vector<Point>& points) {
  std::vector<std::uint32_t> order(points.size());
  std::iota(order.begin(), order.end(), 0u);
  std::sort(order.begin(), order.end(), [&](std::uint32_t a, std::uint32_t b) {
    const auto by_position = CGAL::compare_lexicographically_xyz(points[a], points[b]);
    return by_position == CGAL::EQUAL ? a < b : by_position == CGAL::SMALLER;
  });
  std::vector<std::uint32_t> first(points.size());
  for (std::size_t k = 0; k < order.size(); ++k)
    first[order[k]] = k > 0 && points[order[k]] == points[order[k - 1]] ? first[order[k - 1]] : order[k];
  return first;
}

struct Soup {
  std::vector<Point> points;
  std::vector<std::array<std::uint32_t, 3>> triangles;

  const Point& at(std::size_t t, int k) const { return points[triangles[t][k % 3]]; }
  Triangle triangle(std::size_t t) const { return Triangle(at(t, 0), at(t, 1), at(t, 2)); }
  /// The side opposite corner `k`.
  Segment side(std::size_t t, int k) const { return Segment(at(t, k + 1), at(t, k + 2)); }
};

/// Whether two triangles with a common side overlap: they are coplanar, and their apexes are on the same side of it.
bool fold_flat(const Soup& soup, std::size_t s, int apex_s, std::size_t t, int apex_t) {
  const Point& a = soup.at(s, apex_s + 1);
  const Point& b = soup.at(s, apex_s + 2);
  const Point& p = soup.at(s, apex_s);
  const Point& q = soup.at(t, apex_t);
  return CGAL::coplanar(a, b, p, q) && CGAL::coplanar_orientation(a, b, p, q) == CGAL::POSITIVE;
}

/// Whether the triangles meet in more than a corner or side that both have.
bool intersect(const Soup& soup, std::size_t s, std::size_t t) {
  int shared = 0;
  bool in_s[3] = {}, in_t[3] = {};
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j)
      if (soup.triangles[s][i] == soup.triangles[t][j]) {
        ++shared;
        in_s[i] = in_t[j] = true;
      }
  // The common corner, or the corner opposite the common side.
  const int i = static_cast<int>(std::find(in_s, in_s + 3, shared == 1) - in_s);
  const int j = static_cast<int>(std::find(in_t, in_t + 3, shared == 1) - in_t);
  switch (shared) {
    case 0:
      return CGAL::do_intersect(soup.triangle(s), soup.triangle(t));
    case 1:
      return CGAL::do_intersect(soup.triangle(s), soup.side(t, j)) ||
             CGAL::do_intersect(soup.triangle(t), soup.side(s, i));
    case 2:
      return fold_flat(soup, s, i, t, j);
    default:
      return true;
  }
}

}  // namespace

std::vector<std::uint32_t> self_intersections(SurfaceView surface, double max_tested) {
  using Box = CGAL::Box_intersection_d::Box_with_info_d<double, 3, std::uint32_t>;

  Soup soup;
  soup.points = points_of(surface);
  const std::vector<std::uint32_t> first = first_at_position(soup.points);
  soup.triangles.reserve(surface.triangles);
  std::vector<Box> boxes;
  boxes.reserve(surface.triangles);
  std::vector<std::array<std::uint32_t, 2>> pairs;
  for (std::size_t t = 0; t < surface.triangles; ++t) {
    const std::uint32_t* c = surface.corners + 3 * t;
    const auto id = static_cast<std::uint32_t>(t);
    soup.triangles.push_back({first[c[0]], first[c[1]], first[c[2]]});
    const Point &p = soup.at(t, 0), &q = soup.at(t, 1), &r = soup.at(t, 2);
    if (CGAL::collinear(p, q, r))
      pairs.push_back({id, id});
    else
      boxes.emplace_back(p.bbox() + q.bbox() + r.bbox(), id);
  }

  // The boxes of triangles around one vertex, as in the fan of a large polygon, all overlap.
  double tested = 0;
  CGAL::box_self_intersection_d(boxes.begin(), boxes.end(), [&](const Box& a, const Box& b) {
    if (++tested > max_tested || pairs.size() > kMaxPairs)
      throw Failure(kCrowded, std::to_string(pairs.size()));
    if (intersect(soup, a.info(), b.info()))
      pairs.push_back({std::min(a.info(), b.info()), std::max(a.info(), b.info())});
  });

  // The order of the pairs depends on addresses.
  std::sort(pairs.begin(), pairs.end());
  std::vector<std::uint32_t> flat;
  flat.reserve(2 * pairs.size());
  for (const auto& pair : pairs) flat.insert(flat.end(), pair.begin(), pair.end());
  return flat;
}

}  // namespace solidmap::cgal_tetgen

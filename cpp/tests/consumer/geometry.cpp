#include "geometry.hpp"

#include <algorithm>
#include <cmath>
#include <solidmap/solidmap.hpp>
#include <vector>

double largest_error() {
  const auto moved = [](const solidmap::Point& p) { return solidmap::Point{-2 * p[1], p[0], 3 * p[2] + 1}; };
  const solidmap::Surface ball = solidmap::shapes::sphere(1.0, 2);
  std::vector<solidmap::Point> images;
  for (const solidmap::Point& p : ball.vertices()) images.push_back(moved(p));
  const solidmap::HarmonicMap map = solidmap::fit(solidmap::BoundaryMap(ball, images));
  const std::vector<solidmap::Point> points = {{0, 0, 0}, {0.5, 0.1, -0.3}, {-0.2, 0.6, 0.4}};
  const std::vector<solidmap::Point> found = map.evaluate(points);
  double error = 0;
  for (std::size_t i = 0; i < points.size(); ++i) {
    const solidmap::Point expected = moved(points[i]);
    for (std::size_t k = 0; k < 3; ++k) error = std::max(error, std::abs(found[i][k] - expected[k]));
  }
  return error;
}

bool refuses_open_surfaces() {
  const solidmap::Surface ball = solidmap::shapes::sphere(1.0, 1);
  const auto triangles = ball.triangles();
  const solidmap::Surface open(ball.vertices(), {triangles.data(), triangles.size() - 1});
  try {
    solidmap::fit(solidmap::BoundaryMap(open, ball.vertices()));
  } catch (const solidmap::Error& error) {
    return error.category() == solidmap::Category::invalid_input;
  }
  return false;
}

long tets_of_ball() {
  if (!solidmap::has_native()) return -1;
  return static_cast<long>(solidmap::tetrahedralise(solidmap::shapes::sphere(1.0, 2)).size());
}

// What the tests share.
#pragma once

#include <doctest/doctest.h>

#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <random>
#include <string>
#include <vector>

#include "solidmap/solidmap.hpp"

namespace testing {

using solidmap::Point;

inline double distance(const Point& a, const Point& b) { return std::hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]); }

inline double farthest(solidmap::Span<const Point> a, solidmap::Span<const Point> b) {
  REQUIRE(a.size() == b.size());
  double most = 0;
  for (std::size_t i = 0; i < a.size(); ++i) most = std::max(most, distance(a[i], b[i]));
  return most;
}

/// Random points in the ball of this radius, the same in every run.
inline std::vector<Point> points_in_ball(std::size_t count, double radius) {
  std::mt19937_64 random(7);
  std::uniform_real_distribution<double> along(-radius, radius);
  std::vector<Point> points;
  while (points.size() < count) {
    const Point p{along(random), along(random), along(random)};
    if (std::hypot(p[0], p[1], p[2]) < radius) points.push_back(p);
  }
  return points;
}

/// A twist with a stretch: smooth, but not harmonic.
inline Point twisted(const Point& p, double strength = 0.5) {
  const double angle = strength * p[2], c = std::cos(angle), s = std::sin(angle);
  return {1.2 * (c * p[0] - s * p[1]), 1.2 * (s * p[0] + c * p[1]), p[2] + 0.1 * p[0] * p[0]};
}

template <class Map>
std::vector<Point> mapped(solidmap::Span<const Point> points, const Map& map) {
  std::vector<Point> images;
  for (const Point& p : points) images.push_back(map(p));
  return images;
}

inline solidmap::BoundaryMap twisted_ball(unsigned levels = 3, double strength = 0.5) {
  const solidmap::Surface ball = solidmap::shapes::sphere(1.0, levels);
  return {ball, mapped(ball.vertices(), [&](const Point& p) { return twisted(p, strength); })};
}

/// A temporary folder, removed at the end.
class Folder {
 public:
  Folder() {
    std::string name = (std::filesystem::temp_directory_path() / "solidmap-XXXXXX").string();
    REQUIRE(mkdtemp(name.data()) != nullptr);
    path_ = name;
  }
  ~Folder() {
    std::error_code ignored;
    std::filesystem::remove_all(path_, ignored);
  }
  Folder(const Folder&) = delete;
  Folder& operator=(const Folder&) = delete;
  std::filesystem::path operator/(const char* file) const { return path_ / file; }

 private:
  std::filesystem::path path_;
};

inline std::string content(const std::filesystem::path& path) {
  std::ifstream in(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

inline void check_same(const solidmap::FitOptions& a, const solidmap::FitOptions& b) {
  CHECK(a.tolerance == b.tolerance);
  CHECK(a.refine == b.refine);
  CHECK(a.max_sources == b.max_sources);
  CHECK(a.max_source_ratio == b.max_source_ratio);
  CHECK(a.max_error_ratio == b.max_error_ratio);
  CHECK(a.max_local_error == b.max_local_error);
  CHECK(a.free_sources == b.free_sources);
  CHECK(a.memory == b.memory);
  CHECK((a.placement.kind == b.placement.kind && a.placement.value == b.placement.value));
  CHECK(a.source_ratio == b.source_ratio);
  CHECK(a.collocation_ratio == b.collocation_ratio);
  CHECK(a.affine == b.affine);
  CHECK((a.solver == b.solver));
  CHECK(a.max_iterations == b.max_iterations);
  CHECK(a.truncation == b.truncation);
  CHECK(a.held_out == b.held_out);
  CHECK(a.seed == b.seed);
}

/// The category of the Error that a call throws.
template <class Call>
std::string thrown_by(const Call& call) {
  try {
    call();
  } catch (const solidmap::Error& error) {
    CHECK(std::string(error.what()).size() > 10);
    return solidmap::name(error.category());
  }
  return "nothing";
}

}  // namespace testing

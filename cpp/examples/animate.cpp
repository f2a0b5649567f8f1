// Moves points inside a solid through the frames of an animation: one factorisation for many frames, with progress;
// Ctrl-C ends it within a second.
//
//   animate                         a bar that bends, 24 frames
//   animate REFERENCE FRAME...      surfaces of one connectivity; the points are on a lattice in the reference's box
#include <atomic>
#include <chrono>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <vector>

#include "solidmap/solidmap.hpp"

namespace {

using solidmap::Point;

std::atomic<bool> interrupted{false};

/// Shows the progress, and ends the work after Ctrl-C.
bool show(const solidmap::Progress& progress) {
  if (progress.fraction) {
    std::fprintf(stderr, "\r%-12s %3.0f %%          ", progress.step.c_str(), 100 * *progress.fraction);
  } else {
    std::fprintf(stderr, "\r%-12s %s          ", progress.step.c_str(), progress.detail.c_str());
  }
  return !interrupted;
}

/// A bar along x, bent by `angle`.
std::vector<Point> bent(solidmap::Span<const Point> vertices, double angle) {
  std::vector<Point> images;
  for (const Point& p : vertices) {
    const double along = angle * (p[0] - 3) / 6, radius = 6 / angle - p[1];
    images.push_back({3 + radius * std::sin(along), 6 / angle - radius * std::cos(along), p[2]});
  }
  return images;
}

std::vector<Point> lattice_inside(const solidmap::Surface& domain) {
  const auto [low, high] = domain.bounding_box();
  std::vector<Point> points;
  for (int i = 1; i < 24; ++i) {
    for (int j = 1; j < 8; ++j) {
      for (int k = 1; k < 8; ++k) {
        const double share[] = {i / 24.0, j / 8.0, k / 8.0};
        Point p;
        for (int a = 0; a < 3; ++a) p[a] = low[a] + share[a] * (high[a] - low[a]);
        points.push_back(p);
      }
    }
  }
  return points;
}

void animate(const solidmap::Surface& reference, const std::vector<std::vector<Point>>& frames) {
  const auto start = std::chrono::steady_clock::now();
  const auto elapsed = [&] {
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  };
  const solidmap::Factor factor(reference, {}, show);
  std::fprintf(stderr, "\r");
  std::printf("factored %zu vertices in %.2f s\n", reference.vertices().size(), elapsed());

  // All frames at once share their work; solved one by one, each could be shown as soon as it is ready (Factor::solve).
  std::vector<Point> all;
  for (const auto& frame : frames) all.insert(all.end(), frame.begin(), frame.end());
  const auto factored = elapsed();
  const auto maps = factor.solve_many(solidmap::Span<const Point>(all), show);
  std::fprintf(stderr, "\r");
  std::printf("solved %zu frames in %.2f s\n", maps.size(), elapsed() - factored);

  const auto points = lattice_inside(reference);
  for (std::size_t f = 0; f < maps.size(); ++f) {
    const auto images = maps[f].evaluate(points);
    double path = 0;
    for (std::size_t i = 0; i < points.size(); ++i) {
      path += std::hypot(images[i][0] - points[i][0], images[i][1] - points[i][1], images[i][2] - points[i][2]);
    }
    std::printf("frame %2zu: boundary error 99 %% %.1e, %zu points moved by %.3f on average\n", f,
                maps[f].boundary_error().p99, points.size(), path / static_cast<double>(points.size()));
  }
}

}  // namespace

int main(int argc, char** argv) {
  std::signal(SIGINT, [](int) { interrupted = true; });
  try {
    if (argc > 2) {
      const auto reference = solidmap::Surface::load(argv[1]);
      std::vector<std::vector<Point>> frames;
      for (int i = 2; i < argc; ++i) {
        const auto frame = solidmap::Surface::load(argv[i]);
        frames.emplace_back(frame.vertices().begin(), frame.vertices().end());
      }
      animate(reference, frames);
    } else if (argc == 1) {
      std::vector<std::array<std::int32_t, 3>> cubes;
      for (int x = 0; x < 6; ++x) cubes.push_back({x, 0, 0});
      const solidmap::Surface bar = solidmap::shapes::polycube(cubes, 10);
      std::vector<std::vector<Point>> frames;
      for (int f = 1; f <= 24; ++f) frames.push_back(bent(bar.vertices(), 0.08 * f));
      animate(bar, frames);
    } else {
      std::fprintf(stderr, "usage: animate [REFERENCE FRAME...]\n");
      return 2;
    }
  } catch (const solidmap::Error& error) {
    std::fprintf(stderr, "\rerror (%s): %s\n", solidmap::name(error.category()), error.what());
    return error.category() == solidmap::Category::cancelled ? 130 : 1;
  }
}

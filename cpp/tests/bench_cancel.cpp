// How long a fit goes on after it was asked to end, at times spread over all of it.  bench_cancel [DIVISIONS] [TRIALS]
#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <thread>
#include <vector>

#include "solidmap/solidmap.hpp"

namespace {

using Clock = std::chrono::steady_clock;

double since(Clock::time_point start) { return std::chrono::duration<double>(Clock::now() - start).count(); }

}  // namespace

int main(int argc, char** argv) {
  std::setvbuf(stdout, nullptr, _IOLBF, 0);
  const unsigned divisions = argc > 1 ? static_cast<unsigned>(std::atoi(argv[1])) : 130;
  const int trials = argc > 2 ? std::atoi(argv[2]) : 12;
  const solidmap::Surface cube = solidmap::shapes::cube(2.0, divisions);
  std::vector<solidmap::Point> images;
  for (const solidmap::Point& p : cube.vertices()) {
    const double length = std::hypot(p[0], p[1], p[2]);
    images.push_back({p[0] / length, p[1] / length, p[2] / length});
  }
  const solidmap::BoundaryMap boundary(cube, images);
  auto start = Clock::now();
  solidmap::fit(boundary);
  const double whole = since(start);
  std::vector<double> waits;
  for (int trial = 0; trial < trials; ++trial) {
    std::atomic<bool> stop{false};
    Clock::time_point asked;
    std::thread other([&] {
      std::this_thread::sleep_for(std::chrono::duration<double>(whole * (trial + 0.5) / trials));
      asked = Clock::now();
      stop = true;
    });
    std::string step;
    bool cancelled = false;
    try {
      solidmap::fit(boundary, {}, [&](const solidmap::Progress& progress) {
        step = progress.step;
        return !stop;
      });
    } catch (const solidmap::Error& error) {
      cancelled = error.category() == solidmap::Category::cancelled;
    }
    const auto ended = Clock::now();
    other.join();
    if (!cancelled) continue;
    waits.push_back(std::chrono::duration<double>(ended - asked).count());
    std::printf("asked at %.2f s of %.2f: ended after %.3f s, in or after %s\n", whole * (trial + 0.5) / trials, whole,
                waits.back(), step.c_str());
  }
  if (waits.empty()) return 1;
  std::sort(waits.begin(), waits.end());
  std::printf("%zu vertices: median %.3f s, longest %.3f s\n", cube.vertices().size(), waits[waits.size() / 2],
              waits.back());
}

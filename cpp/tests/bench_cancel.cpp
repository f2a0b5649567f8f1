// How long a fit of a torus goes on after it was told to end, at moments spread over its whole time.
//
//   bench_cancel [AROUND] [TRIALS]      AROUND: divisions around the axis (400; 100 000 vertices), TRIALS: moments (12)
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
  const std::size_t around = argc > 1 ? std::strtoul(argv[1], nullptr, 10) : 400;
  const int trials = argc > 2 ? std::atoi(argv[2]) : 12;
  const solidmap::Surface torus = solidmap::shapes::torus(1.0, 0.4, around, 5 * around / 8);
  std::vector<solidmap::Point> images;
  for (const solidmap::Point& p : torus.vertices()) {
    images.push_back({p[0], p[1] + 0.3 * std::sin(4 * p[0]), p[2] * (1.2 + std::cos(3 * p[1]))});
  }
  const solidmap::BoundaryMap boundary(torus, images);
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
  std::printf("%zu vertices: median %.3f s, longest %.3f s\n", torus.vertices().size(), waits[waits.size() / 2],
              waits.back());
}

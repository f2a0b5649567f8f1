// CPU seconds (median, after one call to warm up) of evaluating a map file at points in the unit ball's box; the same
// as examples/bench_evaluate.rs.
//
//   bench_evaluate [MAP] [POINTS] [RUNS]      by default map.safetensors, 1 000 000 and 9
#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <vector>

#include "solidmap/solidmap.hpp"

namespace {

template <class Work>
double seconds(const Work& work) {
  const std::clock_t start = std::clock();
  work();
  return static_cast<double>(std::clock() - start) / CLOCKS_PER_SEC;
}

double median(std::vector<double> times) {
  std::sort(times.begin(), times.end());
  return times[times.size() / 2];
}

}  // namespace

int main(int argc, char** argv) {
  try {
    const auto map = solidmap::HarmonicMap::load(argc > 1 ? argv[1] : "map.safetensors");
    const std::size_t count = argc > 2 ? std::strtoul(argv[2], nullptr, 10) : 1'000'000;
    const int runs = argc > 3 ? std::atoi(argv[3]) : 9;
    std::vector<solidmap::Point> points(count);
    // Fractional parts of the multiples of three irrational numbers fill a cube evenly.
    for (std::size_t i = 0; i < count; ++i) {
      const double n = static_cast<double>(i);
      const double steps[] = {0.8191725134, 0.6710436067, 0.5497004779};
      for (int k = 0; k < 3; ++k) {
        const double x = n * steps[k];
        points[i][k] = 0.5 * (2.0 * (x - static_cast<double>(static_cast<long long>(x))) - 1.0);
      }
    }
    std::vector<double> values, into, both;
    std::vector<solidmap::Point> images(count);
    std::vector<solidmap::Matrix3> jacobians(count);
    map.evaluate(points, images);
    for (int run = 0; run < runs; ++run) {
      values.push_back(seconds([&] { images = map.evaluate(points); }));
      into.push_back(seconds([&] { map.evaluate(points, images); }));
      both.push_back(seconds([&] { map.evaluate_with_jacobian(points, images, jacobians); }));
    }
    std::printf("{\"evaluate\": %.4f, \"evaluate_into\": %.4f, \"evaluate_with_jacobian\": %.4f}\n", median(values),
                median(into), median(both));
  } catch (const solidmap::Error& error) {
    std::fprintf(stderr, "error: %s\n", error.what());
    return 2;
  }
}

#include <atomic>
#include <thread>

#include "testing.hpp"

using namespace solidmap;
using namespace testing;

// Many threads use one map, one inverse and one factor, and copy and drop them meanwhile. scripts/test-cpp-memory.sh
// runs this with the C++ side under -fsanitize=thread.
TEST_CASE("8 threads hammer one map") {
  const HarmonicMap map = fit(twisted_ball(2));
  const Factor factor(shapes::sphere(1.0, 2));
  const Inverse inverse(map);
  const auto points = points_in_ball(2000, 0.95);
  const auto images = map.evaluate(points);
  const auto jacobians = map.jacobian(points);
  const auto frame = mapped(factor.domain().vertices(), [](const Point& p) { return twisted(p, 0.2); });
  const auto expected = factor.solve(frame).evaluate(points);

  std::atomic<int> wrong{0};
  std::vector<std::thread> threads;
  for (int t = 0; t < 8; ++t) {
    threads.emplace_back([&, t] {
      for (int round = 0; round < 12; ++round) {
        const HarmonicMap copy = map;
        const std::size_t count = 100 + 200 * static_cast<std::size_t>((t + round) % 8);
        const Span<const Point> some(points.data(), count);
        std::vector<Point> values(count);
        std::vector<Matrix3> derivatives(count);
        copy.evaluate_with_jacobian(some, values, derivatives);
        for (std::size_t i = 0; i < count; ++i) {
          if (distance(values[i], images[i]) > 1e-12) ++wrong;
          if (std::abs(derivatives[i][4] - jacobians[i][4]) > 1e-10) ++wrong;
        }
        if (map.report().vertices != 162) ++wrong;
        if (round % 4 == 0) {
          const Factor own = factor;
          const bool ends = t % 2 == 0;
          try {
            const HarmonicMap solved = own.solve(frame, [&](const Progress&) { return !ends; });
            if (ends || farthest(solved.evaluate(points), expected) > 1e-9) ++wrong;
          } catch (const Error& error) {
            if (!ends || error.category() != Category::cancelled) ++wrong;
          }
          const auto found = inverse({values.data(), 50});
          for (std::size_t i = 0; i < 50; ++i) {
            if (distance(found[i].point, points[i]) > 1e-8) ++wrong;
          }
        }
      }
    });
  }
  for (std::thread& thread : threads) thread.join();
  CHECK(wrong == 0);
}

TEST_CASE("another thread ends a fit") {
  const BoundaryMap boundary = twisted_ball(5);
  std::atomic<bool> started{false}, stop{false};
  std::thread other([&] {
    while (!started) std::this_thread::yield();
    stop = true;
  });
  const std::string category = thrown_by([&] {
    fit(boundary, {}, [&](const Progress& progress) {
      if (progress.step == "factoring") started = true;
      return !stop;
    });
  });
  other.join();
  CHECK(category == "cancelled");
}

/// \file
/// Progress of long calls, and how to end them.
#pragma once

#include <functional>
#include <optional>
#include <string>

namespace solidmap {

/// How far a call is.
struct Progress {
  /// The step, such as `"factoring"`, `"iterating"`, `"refining"`.
  std::string step;
  /// The fraction of this step that is done, 0 to 1, where it is known. Steps take unequal times.
  std::optional<double> fraction;
  /// Details to show, such as `"iteration 3, residual 1.2e-04"`; may be empty.
  std::string detail;
};

/// Called on the calling thread, often: at least once in every iteration of a solver, or ten times in a second. Return false to end the work: the
/// call then throws an Error of Category::cancelled, for 100 000 vertices within a second. What cannot be interrupted (a
/// dense decomposition, CGAL, TetGen) goes on to its end on other threads, and its result is dropped. Exceptions thrown by the callback end the work too and arrive at the caller as they are.
///
/// To cancel from another thread, let the callback read a std::atomic<bool>.
using ProgressCallback = std::function<bool(const Progress&)>;

}  // namespace solidmap

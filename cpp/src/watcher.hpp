// Passes progress from Rust to the user's callback, and keeps the callback's exceptions out of Rust.
#pragma once

#include <exception>

#include "rust/cxx.h"
#include "solidmap/progress.hpp"

namespace solidmap::detail {

class Watcher {
 public:
  explicit Watcher(const ProgressCallback& callback) : callback_(callback) {}

  /// Calls the callback. False when it returns false or throws, and without a call once it has thrown.
  bool goes_on(rust::Str step, double fraction, rust::Str detail) const noexcept;

  /// Rethrows what the callback threw, if anything.
  void rethrow() const;

 private:
  const ProgressCallback& callback_;
  // Needs no lock: all calls come from the thread that made the watcher.
  mutable std::exception_ptr thrown_;
};

}  // namespace solidmap::detail

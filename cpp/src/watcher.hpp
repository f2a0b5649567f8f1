// Passes progress from Rust to the user's callback, and keeps its exceptions from Rust.
#pragma once

#include <exception>

#include "rust/cxx.h"
#include "solidmap/progress.hpp"

namespace solidmap::detail {

class Watcher {
 public:
  explicit Watcher(const ProgressCallback& callback) : callback_(callback) {}

  /// Calls the callback. False once it has returned false or thrown.
  bool goes_on(rust::Str step, double fraction, rust::Str detail) const noexcept;

  /// Throws again what the callback threw.
  void rethrow() const;

 private:
  const ProgressCallback& callback_;
  // Calls come from the thread that the watcher lives on.
  mutable std::exception_ptr thrown_;
};

}  // namespace solidmap::detail

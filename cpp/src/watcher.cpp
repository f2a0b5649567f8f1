#include "watcher.hpp"

#include <cmath>

namespace solidmap::detail {

bool Watcher::goes_on(rust::Str step, double fraction, rust::Str detail) const noexcept {
  if (thrown_) return false;
  if (!callback_) return true;
  try {
    Progress progress;
    progress.step.assign(step.data(), step.size());
    progress.detail.assign(detail.data(), detail.size());
    if (!std::isnan(fraction)) progress.fraction = fraction;
    return callback_(progress);
  } catch (...) {
    thrown_ = std::current_exception();
    return false;
  }
}

void Watcher::rethrow() const {
  if (thrown_) std::rethrow_exception(thrown_);
}

}  // namespace solidmap::detail

#include "solidmap/error.hpp"

#include "access.hpp"

const char solidmap::detail::SOLIDMAP_STANDARD_LIBRARY = 0;

namespace solidmap {

const char* name(Category category) noexcept {
  switch (category) {
    case Category::invalid_input: return "invalid_input";
    case Category::io: return "io";
    case Category::not_found: return "not_found";
    case Category::unsupported: return "unsupported";
    case Category::numerical: return "numerical";
    case Category::memory: return "memory";
    case Category::cancelled: return "cancelled";
    case Category::native: return "native";
    case Category::internal: return "internal";
  }
  return "unknown";
}

std::string version() { return std::string(ffi::version()); }
bool has_native() { return ffi::has_native(); }
std::string licence() { return std::string(ffi::licence()); }

namespace detail {

void throw_decoded(const rust::Error& error) {
  const std::string text = error.what();
  const int digit = text.empty() ? -1 : text[0] - '0';
  if (digit < 0 || digit > static_cast<int>(Category::internal)) throw Error(Category::internal, text);
  throw Error(static_cast<Category>(digit), text.substr(1));
}

}  // namespace detail
}  // namespace solidmap

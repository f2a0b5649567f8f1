/// \file
/// The one type of exception that the library throws.
#pragma once

#include <stdexcept>
#include <string>

#include "solidmap/abi.hpp"

namespace solidmap {

/// What an Error is about, for programs; its message is for people.
enum class Category {
  /// Something given cannot be used: arrays that do not fit, an open surface, an option out of range, a damaged file.
  invalid_input,
  /// The system could not read or write a file; an old file is left as it was.
  io,
  /// There is no such file.
  not_found,
  /// Not in this build (see has_native()), an unknown format, or a file of a newer version.
  unsupported,
  /// The computation failed: a singular system, a map that is not finite.
  numerical,
  /// More memory (`memory` in options) or more elements are needed than allowed, by an estimate made beforehand.
  memory,
  /// A progress callback returned false.
  cancelled,
  /// CGAL or TetGen failed.
  native,
  /// A bug in solidmap itself; please report it.
  internal,
};

/// The name of a category, such as `"invalid_input"`.
const char* name(Category category) noexcept;

/// Why a call failed. Its arguments are unchanged, and all objects can still be used.
///
/// The message (`what()`) says what was found, where, and what to do.
class Error : public std::runtime_error {
 public:
  Error(Category category, const std::string& message) : std::runtime_error(message), category_(category) {}

  Category category() const noexcept { return category_; }

 private:
  Category category_;
};

}  // namespace solidmap

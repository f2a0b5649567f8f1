/// \file
/// A link-time check of the standard library's ABI. A program whose standard library lays out its classes differently
/// from the one that this library was built with (debug mode, _GLIBCXX_DEBUG; the old strings,
/// _GLIBCXX_USE_CXX11_ABI=0; another library altogether) fails to link, with a symbol that names the cause.
#pragma once

#include <cstddef>

#if defined(_LIBCPP_VERSION)
#define SOLIDMAP_STANDARD_LIBRARY built_with_libcxx
#elif defined(_GLIBCXX_DEBUG)
#define SOLIDMAP_STANDARD_LIBRARY built_with_libstdcxx_in_debug_mode
#elif defined(_GLIBCXX_USE_CXX11_ABI) && !_GLIBCXX_USE_CXX11_ABI
#define SOLIDMAP_STANDARD_LIBRARY built_with_old_libstdcxx_strings
#else
#define SOLIDMAP_STANDARD_LIBRARY built_with_this_standard_library
#endif

namespace solidmap::detail {
extern const char SOLIDMAP_STANDARD_LIBRARY;
#if defined(__GNUC__)
[[gnu::used]] inline const char* const standard_library = &SOLIDMAP_STANDARD_LIBRARY;
#endif
}  // namespace solidmap::detail

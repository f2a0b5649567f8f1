// What the public classes hold, and how their functions call Rust. Not installed.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "solidmap/solidmap.hpp"
#include "solidmap-cpp/bridge/bridge.rs.h"
#include "watcher.hpp"

namespace solidmap::detail {

template <class T>
struct Held {
  rust::Box<T> box;
};

struct SurfaceImpl : Held<ffi::Surface> {};
struct CellMeshImpl : Held<ffi::VolumeMesh> {};
struct BoundaryMapImpl : Held<ffi::Boundary> {};
struct HarmonicMapImpl : Held<ffi::Map> {};
struct InverseImpl : Held<ffi::Inverse> {};
struct BijectiveMapImpl : Held<ffi::Bijective> {};
struct FactorImpl : Held<ffi::Factored> {};
struct FrameEvaluatorImpl : Held<ffi::Frames> {};

/// The one friend of the public classes.
struct Access {
  template <class Class, class Impl, class T>
  static Class make(rust::Box<T> box) {
    return Class(held<Impl>(std::move(box)));
  }

  template <class Impl, class T>
  static std::shared_ptr<const Impl> held(rust::Box<T> box) {
    return std::make_shared<const Impl>(Impl{{std::move(box)}});
  }

  template <class Class>
  static const auto& of(const Class& object) {
    return inside(object.impl_);
  }

  template <class Impl>
  static const auto& inside(const std::shared_ptr<const Impl>& impl) {
    if (!impl) throw Error(Category::invalid_input, "the object was moved from; assign to it before using it again");
    return *impl->box;
  }
};

inline std::vector<WorstPlace> converted(const rust::Vec<ffi::WorstPlace>& found) {
  std::vector<WorstPlace> places;
  places.reserve(found.size());
  for (const ffi::WorstPlace& place : found) {
    WorstPlace made;
    made.kind = static_cast<WorstPlace::Kind>(place.kind);
    made.count = place.count;
    made.point = place.point;
    made.centre = place.centre;
    made.low = place.low;
    made.high = place.high;
    made.measure = place.measure;
    made.share = place.share;
    made.value = place.value;
    places.push_back(made);
  }
  return places;
}

inline Surface make_surface(rust::Box<ffi::Surface> box) {
  return Access::make<Surface, SurfaceImpl>(std::move(box));
}
inline CellMesh make_cells(rust::Box<ffi::VolumeMesh> box) { return Access::make<CellMesh, CellMeshImpl>(std::move(box)); }
inline BoundaryMap make_boundary(rust::Box<ffi::Boundary> box) {
  return Access::make<BoundaryMap, BoundaryMapImpl>(std::move(box));
}
inline HarmonicMap make_map(rust::Box<ffi::Map> box) {
  return Access::make<HarmonicMap, HarmonicMapImpl>(std::move(box));
}

/// Throws the error that Rust has written as text: a digit for the category, then the message.
[[noreturn]] void throw_decoded(const rust::Error& error);

/// Calls Rust, and throws its errors as solidmap::Error.
template <class Call>
auto guarded(const Call& call) -> decltype(call()) {
  try {
    return call();
  } catch (const rust::Error& error) {
    throw_decoded(error);
  }
}

/// The same with a callback, whose own exceptions are rethrown as they were.
template <class Call>
auto watched(const ProgressCallback& callback, const Call& call) -> decltype(call(std::declval<const Watcher&>())) {
  const Watcher watcher(callback);
  try {
    return call(watcher);
  } catch (const rust::Error& error) {
    watcher.rethrow();
    throw_decoded(error);
  }
}

/// Throws unless an option of an enumeration type has one of its named values, the last of which is `last`.
template <class Enum>
void require_one_of(const char* option, Enum value, Enum last) {
  const auto number = static_cast<long long>(value);
  if (number < 0 || number > static_cast<long long>(last)) {
    throw Error(Category::invalid_input,
                std::string("`") + option + "` is " + std::to_string(number) + ", which is none of its values");
  }
}

/// The arguments of a call, copied when they overlap the memory for results.
template <class T, class U>
class Unaliased {
 public:
  Unaliased(Span<const T> given, Span<U> results) : view_(given) {
    const auto begin = [](const auto& span) { return reinterpret_cast<std::uintptr_t>(span.data()); };
    const auto end = [&](const auto& span) { return begin(span) + span.size() * sizeof(*span.data()); };
    if (begin(given) < end(results) && begin(results) < end(given)) {
      copy_.assign(given.begin(), given.end());
      view_ = Span<const T>(copy_);
    }
  }
  Span<const T> view() const noexcept { return view_; }

 private:
  std::vector<T> copy_;
  Span<const T> view_;
};

template <class T>
rust::Slice<const T> slice(Span<const T> span) {
  return {span.data(), span.size()};
}
template <class T>
rust::Slice<T> slice(Span<T> span) {
  return {span.data(), span.size()};
}

/// An array of small fixed arrays as a flat array, for Rust.
template <class T, std::size_t n>
rust::Slice<const T> flat(Span<const std::array<T, n>> rows) {
  return {reinterpret_cast<const T*>(rows.data()), n * rows.size()};
}
template <class T, std::size_t n>
rust::Slice<T> flat(Span<std::array<T, n>> rows) {
  return {reinterpret_cast<T*>(rows.data()), n * rows.size()};
}

/// The reverse: a flat array of Rust as an array of small fixed arrays.
template <class Row, class T>
Span<const Row> rows(rust::Slice<const T> flat) {
  return {reinterpret_cast<const Row*>(flat.data()), flat.size() / std::tuple_size_v<Row>};
}

/// A copy, which outlives the object that is viewed.
template <class T>
std::vector<T> kept(Span<const T> view) {
  return std::vector<T>(view.begin(), view.end());
}

/// The bytes of a path in the system's own encoding; on Windows in UTF-8.
class PathBytes {
 public:
  explicit PathBytes(const std::filesystem::path& path)
#ifdef _WIN32
      : bytes_(path.u8string()) {
  }
#else
      : bytes_(path.string()) {
  }
#endif
  operator rust::Slice<const std::uint8_t>() const {
    return {reinterpret_cast<const std::uint8_t*>(bytes_.data()), bytes_.size()};
  }

 private:
  std::string bytes_;
};

template <class T>
std::vector<T> copied(const rust::Vec<T>& from) {
  return std::vector<T>(from.begin(), from.end());
}
inline std::vector<std::string> copied(const rust::Vec<rust::String>& from) {
  std::vector<std::string> strings;
  strings.reserve(from.size());
  for (const rust::String& string : from) strings.emplace_back(string.data(), string.size());
  return strings;
}

std::vector<Preimage> converted(const rust::Vec<ffi::Preimage>& found);

CellQuality quality_of(const ffi::CellQuality& found);

// What is asked for and what was found, between the public types and those of the bridge.
ffi::FitOptions for_rust(const FitOptions& options);
FitOptions converted(const ffi::FitOptions& from);
ffi::RemeshOptions for_rust(const RemeshOptions& options);
RemeshOptions converted(const ffi::RemeshOptions& from);
Remeshed converted(const ffi::RemeshResult& remeshed);
ffi::PolycubeOptions for_rust(const PolycubeOptions& options);
PolycubeOptions converted(const ffi::PolycubeOptions& from);
SurfaceDistortion converted(const ffi::SurfaceDistortion& found);
PolycubeMap converted(const ffi::PolycubeMap& made);
ModelPolycube converted(rust::Box<ffi::ModelPolycube> made);

}  // namespace solidmap::detail

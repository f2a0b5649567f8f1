/// \file
/// Views of arrays, and the small fixed arrays that are their elements.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <iterator>
#include <type_traits>
#include <utility>
#if __cplusplus >= 202002L
#include <ranges>
#endif

namespace solidmap {

/// A point in space, in model units: x, y, z.
using Point = std::array<double, 3>;
/// The corners of a triangle, counted from 0, counter-clockwise seen from outside.
using Triangle = std::array<std::uint32_t, 3>;
/// The corners of a tetrahedron, counted from 0; positively oriented if `det(b-a, c-a, d-a) > 0`.
using Tet = std::array<std::uint32_t, 4>;
/// The corners of a hexahedron, counted from 0: four around the bottom, counter-clockwise from above, then those over
/// them.
using Hex = std::array<std::uint32_t, 8>;
/// A 3 x 3 matrix row by row: a Jacobian has `∂f_i/∂x_k` at `3 * i + k`.
using Matrix3 = std::array<double, 9>;

static_assert(sizeof(Point) == 3 * sizeof(double) && sizeof(Matrix3) == 9 * sizeof(double),
              "arrays of points must be contiguous arrays of doubles");

namespace detail {
/// Whether the elements of a temporary container outlive it.
#if defined(__cpp_lib_ranges)
template <class Container>
constexpr bool is_view = std::ranges::enable_borrowed_range<Container>;
#else
template <class Container>
constexpr bool is_view = false;
#endif
}  // namespace detail

/// A view of `size()` contiguous elements. It owns nothing: what it views must outlive it.
///
/// Made from a pointer and a size, or implicitly from whatever has `data()` and `size()` (std::vector, std::array,
/// another Span) or is a built-in array. `Span<const T>` is read only.
template <class T>
class Span {
  template <class Container>
  using DataOf = std::remove_pointer_t<decltype(std::data(std::declval<Container&>()))>;
  template <class Container>
  using IfViewable = std::enable_if_t<!std::is_same_v<std::decay_t<Container>, Span> &&
                                      std::is_convertible_v<DataOf<Container> (*)[], T (*)[]> &&
                                      (std::is_lvalue_reference_v<Container> || std::is_const_v<T> ||
                                       detail::is_view<std::remove_cv_t<Container>>)>;

 public:
  using value_type = std::remove_cv_t<T>;

  constexpr Span() noexcept = default;
  constexpr Span(T* data, std::size_t size) noexcept : data_(data), size_(size) {}
  template <class Container, class = IfViewable<Container>>
  constexpr Span(Container&& container) noexcept : data_(std::data(container)), size_(std::size(container)) {}

  constexpr T* data() const noexcept { return data_; }
  constexpr std::size_t size() const noexcept { return size_; }
  constexpr bool empty() const noexcept { return size_ == 0; }
  constexpr T* begin() const noexcept { return data_; }
  constexpr T* end() const noexcept { return data_ + size_; }
  constexpr T& operator[](std::size_t i) const noexcept { return data_[i]; }

 private:
  T* data_ = nullptr;
  std::size_t size_ = 0;
};

/// Coordinates `x0 y0 z0 x1 ...` as points; one or two left over at the end are ignored.
inline Span<const Point> as_points(Span<const double> xyz) noexcept {
  return {reinterpret_cast<const Point*>(xyz.data()), xyz.size() / 3};
}
/// The same for results to be written.
inline Span<Point> as_points(Span<double> xyz) noexcept {
  return {reinterpret_cast<Point*>(xyz.data()), xyz.size() / 3};
}
/// Points as coordinates.
inline Span<const double> as_numbers(Span<const Point> points) noexcept {
  return {reinterpret_cast<const double*>(points.data()), 3 * points.size()};
}

}  // namespace solidmap

#if defined(__cpp_lib_ranges)
template <class T>
inline constexpr bool std::ranges::enable_borrowed_range<solidmap::Span<T>> = true;
template <class T>
inline constexpr bool std::ranges::enable_view<solidmap::Span<T>> = true;
#endif

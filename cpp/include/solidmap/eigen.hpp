/// \file
/// Conversions between Eigen's matrices and this library, header only. Points are the rows of an n x 3 matrix, in
/// either storage order, triangles those of an m x 3 matrix of any integers, as in libigl. Needs Eigen 3.3.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <string>
#include <type_traits>
#include <vector>

#include "solidmap/solidmap.hpp"

namespace solidmap::eigen {

/// n x 3, row by row: the layout of this library.
using PointRows = Eigen::Matrix<double, Eigen::Dynamic, 3, Eigen::RowMajor>;
/// n x 3, column by column: as libigl and MatrixXd.
using PointColumns = Eigen::Matrix<double, Eigen::Dynamic, 3>;

namespace detail {
template <class Derived>
void require_three_columns(const Eigen::EigenBase<Derived>& rows, const char* what) {
  if (rows.cols() != 3) {
    throw Error(Category::invalid_input,
                std::string("the matrix of ") + what + " has " + std::to_string(rows.cols()) + " columns instead of 3");
  }
}
}  // namespace detail

/// The rows as points; copies.
template <class Derived>
std::vector<Point> points(const Eigen::MatrixBase<Derived>& rows) {
  detail::require_three_columns(rows, "points");
  std::vector<Point> points(static_cast<std::size_t>(rows.rows()));
  Eigen::Map<PointRows>(points.empty() ? nullptr : points[0].data(), rows.rows(), 3) = rows.template cast<double>();
  return points;
}

/// The rows of a row-major matrix as points, without a copy.
inline Span<const Point> view(const PointRows& rows) {
  return as_points(Span<const double>(rows.data(), static_cast<std::size_t>(rows.size())));
}
inline Span<Point> view(PointRows& rows) {
  return as_points(Span<double>(rows.data(), static_cast<std::size_t>(rows.size())));
}
void view(PointRows&&) = delete;

/// Points as an n x 3 matrix, without a copy: it views what `points` views. A temporary vector is copied.
inline Eigen::Map<const PointRows> matrix(Span<const Point> points) {
  return {points.empty() ? nullptr : points[0].data(), static_cast<Eigen::Index>(points.size()), 3};
}
inline PointRows matrix(std::vector<Point>&& points) { return matrix(Span<const Point>(points)); }

/// A Jacobian as a matrix, `J(i, k) = ∂f_i/∂x_k`, without a copy.
inline Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>> matrix(const Matrix3& jacobian) {
  return Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(jacobian.data());
}

/// The surface with these vertices and triangles, of any integers. Throws Error (invalid_input) as Surface::Surface().
template <class Vertices, class Triangles>
Surface surface(const Eigen::MatrixBase<Vertices>& vertices, const Eigen::MatrixBase<Triangles>& triangles) {
  using Index = typename Triangles::Scalar;
  static_assert(std::is_integral_v<Index>, "corners of triangles are integers");
  detail::require_three_columns(triangles, "triangles");
  std::vector<Triangle> corners(static_cast<std::size_t>(triangles.rows()));
  for (std::size_t t = 0; t < corners.size(); ++t) {
    for (int k = 0; k < 3; ++k) {
      const Index corner = triangles(static_cast<Eigen::Index>(t), k);
      const auto kept = static_cast<std::uint32_t>(corner);
      if (corner < Index(0) || static_cast<std::uintmax_t>(corner) != kept) {
        throw Error(Category::invalid_input, "triangle " + std::to_string(t) + " names vertex " + std::to_string(corner) +
                                                 ", which is not there");
      }
      corners[t][static_cast<std::size_t>(k)] = kept;
    }
  }
  const auto places = points(vertices);
  return Surface(places, corners);
}

/// The triangles of a surface, m x 3.
inline Eigen::Matrix<int, Eigen::Dynamic, 3> triangles(const Surface& surface) {
  const auto from = surface.triangles();
  Eigen::Matrix<int, Eigen::Dynamic, 3> to(static_cast<Eigen::Index>(from.size()), 3);
  for (std::size_t t = 0; t < from.size(); ++t) {
    for (std::size_t k = 0; k < 3; ++k) {
      to(static_cast<Eigen::Index>(t), static_cast<Eigen::Index>(k)) = static_cast<int>(from[t][k]);
    }
  }
  return to;
}

/// Images of the rows, n x 3.
template <class Derived>
PointColumns evaluate(const HarmonicMap& map, const Eigen::MatrixBase<Derived>& rows) {
  const auto images = map.evaluate(points(rows));
  return matrix(Span<const Point>(images));
}

}  // namespace solidmap::eigen

/// \file
/// Where a map is worst: the same for everything that is measured.
#pragma once

#include <cstddef>

#include "solidmap/span.hpp"

namespace solidmap {

/// A connected group of cells or triangles, which share faces or edges, where a map is worst.
struct WorstPlace {
  enum class Kind {
    /// The map is folded; the value is the least `det J` found, negative also for maps that reflect.
    folded,
    /// Neither a fold nor its absence is proved; without a value.
    undecided,
    /// The harmonic energy density is among the largest percent of the volume; the value is the largest.
    energy_density,
    /// Cells of a mesh are inverted; the value is the least scaled Jacobian.
    inverted,
    /// The boundary error is among the largest percent of the area; the value is the largest, as a fraction of the target's
    /// diagonal.
    boundary_error,
  };
  Kind kind = Kind::folded;
  /// How many cells or triangles.
  std::size_t count = 0;
  /// The centre of the worst or largest of them.
  Point point = {};
  /// The mean of their centres, which may lie outside of all.
  Point centre = {};
  /// Lowest and highest corner of the bounding box.
  Point low = {}, high = {};
  /// Volume of the cells or area of the triangles, and that as a fraction of the whole.
  double measure = 0, share = 0;
  /// The worst value; NaN without one.
  double value = 0;
};

}  // namespace solidmap

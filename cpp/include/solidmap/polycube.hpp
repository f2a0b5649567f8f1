/// \file
/// Polycubes: solids deformed until every boundary triangle lies across an axis.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>
#include <vector>

#include "solidmap/mesh.hpp"
#include "solidmap/progress.hpp"
#include "solidmap/span.hpp"

namespace solidmap {

/// Which way up a model is deformed to a polycube: as it is given; turned so that its normals are as close to the axes as
/// possible, and otherwise as little as possible; or every attempt both ways, of which the one with less energy is taken.
enum class Orientation : std::uint8_t { given, principal, best };

/// How make_polycube() works.
struct PolycubeOptions {
  /// How much borders between charts count against the deviation of triangles from the axes; positive. A larger value
  /// gives fewer charts. Where no polycube is found, others are tried.
  double smoothness = 0.02;
  /// Angle in degrees between the normals beside an edge of the model from which borders between charts cost nothing along
  /// it: it becomes an edge of the polycube where the directions of its sides allow it. 0: borders cost less along sharp
  /// edges, but something.
  double feature_angle = 0;
  /// Largest number of tetrahedra that splitting may add, as a multiple of those given; 1000 more are always allowed.
  double most_added = 1;
  /// Largest number of attempts, each with labels of its own; there are no more than 5. With 0 no labels are found.
  std::size_t attempts = 5;
  /// Work after which the deformation of an attempt ends although cells stay inverted: iterations of descent for each
  /// tetrahedron, in the mean. Models of fewer than 20 000 get as much as one of so many.
  double effort = 2e4;
  /// A lattice that the planes of the polycube are put on where that is possible, so that a regular mesh has boxes of
  /// one size everywhere: its cells along the longest side of the polycube; 0: none.
  std::size_t lattice_along = 0;
  /// Side of the lattice's cells, in model units; replaces `lattice_along` unless it is 0.
  double lattice_length = 0;
  /// How the model is turned before labels are sought. The polycube stays turned, the model is returned as it was given.
  Orientation orientation = Orientation::given;

  /// The same as PolycubeOptions().
  static PolycubeOptions standard();
};

/// How a map distorts a surface, over the domain's area: 1 where lengths keep their ratios. σ₁ ≥ σ₂ are the singular
/// values of the Jacobian from surface to surface, with the image scaled to the area of the domain.
struct SurfaceDistortion {
  /// Median and 99 % quantile of σ₁/σ₂, which is 1 where angles are kept; infinite where an image has no area, NaN
  /// where nothing could be measured.
  double angle_median = std::numeric_limits<double>::quiet_NaN(), angle_p99 = angle_median;
  /// The same of max(σ₁σ₂, 1/σ₁σ₂), which is 1 where areas are kept.
  double area_median = angle_median, area_p99 = angle_median;
};

/// Where the directions of the boundary triangles came from: graph cuts; or the map of the boundary to the sphere, with
/// the six faces of a cube around it, and much distortion at limbs; or the caller of make_polycube_with_labels().
enum class LabelSource : std::uint8_t { cut, sphere, given };

/// How much of a model's sharp edges became edges of the polycube. Lengths are in model units.
struct FeatureReport {
  /// From which an edge counts as sharp, in degrees.
  double angle = 0;
  /// Length of the sharp edges, without those that end somewhere, and of those of them that are edges of the polycube.
  double length = 0, on_borders = 0;
};

/// What was done to find a polycube.
struct PolycubeReport {
  LabelSource labels = LabelSource::cut;
  /// The smoothness with which a cut found the labels; 0 for those from the sphere.
  double smoothness = 0;
  /// With PolycubeOptions::feature_angle.
  std::optional<FeatureReport> features;
  /// Attempts made.
  std::size_t attempts = 0;
  /// Rows of the rotation by which the model was turned before it was deformed; without a value if it was not.
  std::optional<std::array<std::array<double, 3>, 3>> turn;
  /// Charts: connected parts of the boundary with one label; and corners, where three or more of them meet.
  std::size_t charts = 0, corners = 0;
  /// Distinct planes of charts across x, y and z.
  std::array<std::size_t, 3> planes = {};
  /// Side of the cells of the lattice that the planes are on, in model units; without a value where none was asked for,
  /// or no polycube was found with its planes there.
  std::optional<double> lattice;
  /// Tetrahedra given, and those of the result, with those that splitting added.
  std::size_t tets_given = 0, tets = 0;
  /// Inverted tetrahedra, and triangles that face against their label, where the descent began, and those that it left
  /// to local repair. There are none in a result.
  std::size_t inverted_at_start = 0, inverted_after_descent = 0;
  /// Energy per volume and area: 7 for a polycube that is its own.
  double energy = 0;
  /// How the boundary is distorted from the model to the polycube.
  SurfaceDistortion distortion;
};

/// A polycube with the model that it was made of. The map that is linear over the tetrahedra, from one to the other, is
/// one to one.
struct PolycubeMap {
  /// The model's tetrahedra, right-handed, with nodes and cells that splitting added: the nodes of the mesh that was
  /// given come first. All regions are 0.
  CellMesh model;
  /// The same tetrahedra in the polycube, about as large as the model.
  CellMesh polycube;
  /// Boundary triangles of both, by their nodes, facing outward.
  std::vector<Triangle> boundary;
  /// The label of each of them, the direction that it faces along in the polycube: 0 to 5 for -x, +x, -y, +y, -z, +z.
  std::vector<std::uint8_t> labels;
  /// The boundary triangles of the mesh that was given, facing outward, and the label of each.
  std::vector<Triangle> given_boundary;
  std::vector<std::uint8_t> given_labels;
  /// The two boundaries, with the same triangles over the boundary nodes alone: `BoundaryMap::between(polycube_surface,
  /// model_surface)` is the boundary map from the polycube to the model.
  Surface polycube_surface;
  Surface model_surface;
  PolycubeReport report;
};

/// A polycube of a solid that is given as tetrahedra, of any genus. Every tetrahedron of it is right-handed and every
/// boundary triangle faces along its label, both decided exactly; the nodes of each chart have one coordinate bit for
/// bit, no boundary triangles pass through each other, and no part of the solid lies within another. The same from run
/// to run, whatever the number of threads.
///
/// An attempt takes about a second for every 10 000 tetrahedra where labels are good, and up to ten times that
/// otherwise. The steps are `"attempting"`, `"labelling"`, `"deforming"` and `"snapping"`.
///
/// Throws Error: numerical (no polycube was found in any attempt), invalid_input (hexahedra, flat tetrahedra, a
/// boundary that touches itself, an option out of range), cancelled.
PolycubeMap make_polycube(const CellMesh& model, const PolycubeOptions& options = {},
                          const ProgressCallback& progress = {});

/// As make_polycube(), with these labels of the model's boundary triangles, in a single attempt in which no label is changed.
/// The triangles are given by their nodes, in any order: `given_boundary` and `given_labels` of a polycube that was found by
/// a cut make it again, bit for bit.
///
/// Throws Error as make_polycube(), and invalid_input for labels that cannot be those of a polycube: the message names the
/// triangle and says why.
PolycubeMap make_polycube_with_labels(const CellMesh& model, Span<const Triangle> triangles,
                                      Span<const std::uint8_t> labels, const PolycubeOptions& options = {},
                                      const ProgressCallback& progress = {});

}  // namespace solidmap

/// \file
/// Harmonic volumetric maps between solids: everything.
///
/// \code
/// const solidmap::Surface domain = solidmap::Surface::load("domain.obj");
/// const solidmap::Surface image = solidmap::Surface::load("image.obj");  // the same mesh, every vertex where it goes
/// const solidmap::HarmonicMap map = solidmap::fit(solidmap::BoundaryMap::between(domain, image));
/// const std::vector<solidmap::Point> images = map.evaluate(points);
/// \endcode
///
/// Lengths are in model units, indices count from 0, triangles are counter-clockwise seen from outside. Errors of maps
/// are fractions of the diagonal of the target's bounding box. Classes are immutable values: copies are free and share
/// their data, and every const function may be called from any number of threads at once. Whatever fails throws
/// solidmap::Error. Nothing is printed and no signal handler is set; there is no global state but a pool of worker
/// threads, made at the first call that uses it. Objects that were moved from may be assigned to and destroyed; other
/// use throws.
#pragma once

#include "solidmap/bijective_map.hpp"
#include "solidmap/boundary_map.hpp"
#include "solidmap/error.hpp"
#include "solidmap/fit.hpp"
#include "solidmap/harmonic_map.hpp"
#include "solidmap/hexmesh.hpp"
#include "solidmap/mesh.hpp"
#include "solidmap/model_polycube.hpp"
#include "solidmap/polycube.hpp"
#include "solidmap/progress.hpp"
#include "solidmap/solids.hpp"
#include "solidmap/span.hpp"
#include "solidmap/worst_place.hpp"

namespace solidmap {

/// `major.minor.patch` of the library that is linked.
std::string version();
/// Whether the library was built with CGAL and TetGen.
bool has_native();
/// The licence of programs that link this library: MIT or Apache-2.0 without CGAL and TetGen, AGPL-3.0 with them.
std::string licence();

}  // namespace solidmap

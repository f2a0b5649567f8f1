// TetGen, made safe to call as a library.
//
// libtet reports errors through `terminatetetgen`, which frees the mesh and throws; unwinding then frees it again and
// the process dies. libtet calls the function through its own linkage table, so the one below, which is found before its
// own, replaces it in the whole process. It must stay in this file: an archive member of its own would not be linked.
//
// A shared library that exports nothing else, such as a Python module, has to define and export the function itself, and
// call `solidmap_tetgen_failed`; the one below is weak for that.
#ifndef TETLIBRARY
#error "Build with -DTETLIBRARY: without it tetgen.h defines a terminatetetgen that ends the process."
#endif

#define terminatetetgen tetgen_h_terminatetetgen
#include <tetgen.h>
#undef terminatetetgen

#include <algorithm>
#include <mutex>
#include <string>

#include "core.h"

namespace {

/// TetGen keeps the static filters of its predicates in globals: two runs at a time abort on an assertion.
std::mutex tetgen_mutex;

/// Set when libtet calls our `terminatetetgen`. Guarded by `tetgen_mutex`.
bool error_was_reported = false;

}  // namespace

/// What `terminatetetgen` is to do.
extern "C" __attribute__((visibility("default"), used)) void solidmap_tetgen_failed(int code) {
  error_was_reported = true;
  throw code;
}

__attribute__((visibility("default"), used, weak)) void terminatetetgen(tetgenmesh*, int code) {
  solidmap_tetgen_failed(code);
}

namespace solidmap::cgal_tetgen {

namespace {

/// Makes libtet fail in the one place that is harmless in an unpatched library too: a memory pool of `2^31` bytes
/// wraps to an impossible request, and the failure is reported without a mesh to free.
void check_interposition_locked() {
  error_was_reported = false;
  try {
    tetgenmesh::memorypool pool;
    pool.poolinit(1 << 16, 1 << 15, 8, 8);
  } catch (int) {
  }
  if (!error_was_reported)
    throw Failure(kNotInterposed,
                  "libtet reports errors to another library's terminatetetgen, which would end the process");
}

void fill(tetgenio& in, const SurfaceView& surface) {
  in.firstnumber = 0;
  in.numberofpoints = static_cast<int>(surface.vertices);
  in.pointlist = new REAL[3 * surface.vertices];
  std::copy_n(surface.xyz, 3 * surface.vertices, in.pointlist);

  in.facetlist = new tetgenio::facet[surface.triangles];
  in.numberoffacets = static_cast<int>(surface.triangles);
  // All of them before the next allocation: the destructor of `in` walks them if it throws.
  for (std::size_t t = 0; t < surface.triangles; ++t) tetgenio::init(&in.facetlist[t]);
  for (std::size_t t = 0; t < surface.triangles; ++t) {
    tetgenio::facet& facet = in.facetlist[t];
    facet.polygonlist = new tetgenio::polygon[1];
    facet.numberofpolygons = 1;
    tetgenio::init(facet.polygonlist);
    facet.polygonlist->vertexlist = new int[3];
    facet.polygonlist->numberofvertices = 3;
    for (int k = 0; k < 3; ++k) facet.polygonlist->vertexlist[k] = static_cast<int>(surface.corners[3 * t + k]);
  }
}

/// The switches: mesh a surface (`p`), keep the boundary (`Y`), indices from 0 (`z`), no output (`Q`).
void set_switches(tetgenbehavior& behavior, const TetgenOptions& options) {
  const bool refine = options.radius_edge_ratio > 0;
  const bool bounded = options.max_volume > 0;
  std::string switches = "pzYQ";
  if (refine) switches += "q";
  if (bounded) switches += "a1";
  if (!behavior.parse_commandline(switches.data())) throw 0;
  // Set directly: the command line parser of 1.5 does not accept exponents everywhere.
  if (refine) {
    behavior.minratio = options.radius_edge_ratio;
    behavior.mindihedral = options.min_dihedral;
  }
  if (bounded) behavior.maxvolume = options.max_volume;
}

Arrays copy_out(const tetgenio& out) {
  Arrays arrays;
  arrays.xyz.assign(out.pointlist, out.pointlist + 3 * static_cast<std::size_t>(out.numberofpoints));
  arrays.corners.reserve(4 * static_cast<std::size_t>(out.numberoftetrahedra));
  for (int t = 0; t < out.numberoftetrahedra; ++t)
    for (int k = 0; k < 4; ++k)
      arrays.corners.push_back(
          static_cast<std::uint32_t>(out.tetrahedronlist[static_cast<std::size_t>(t) * out.numberofcorners + k]));
  return arrays;
}

Failure failure_of(int code) {
  switch (code) {
    case kOutOfMemory:
    case kTetgenInternal:
    case kSelfIntersection:
    case kSmallFeature:
    case kCloseFacets:
    case kTetgenInput:
      return Failure(code, "TetGen stopped with code " + std::to_string(code));
    case 0:
      return Failure(kTetgenUsage, "TetGen did not take its switches");
    default:
      return Failure(kUnknown, "TetGen stopped with the unknown code " + std::to_string(code));
  }
}

}  // namespace

void check_interposition() {
  std::lock_guard<std::mutex> lock(tetgen_mutex);
  check_interposition_locked();
}

Arrays tetgen(SurfaceView surface, const TetgenOptions& options) {
  std::lock_guard<std::mutex> lock(tetgen_mutex);
  static bool checked = false;
  if (!checked) {
    check_interposition_locked();
    checked = true;
  }
  try {
    tetgenbehavior behavior;
    set_switches(behavior, options);
    tetgenio in, out;
    fill(in, surface);
    ::tetrahedralize(&behavior, &in, &out);
    return copy_out(out);
  } catch (int code) {
    throw failure_of(code);
  }
}

}  // namespace solidmap::cgal_tetgen

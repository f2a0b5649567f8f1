//! Self-intersections, where the build has CGAL to look for them.

use solidmap::check::FindSelfIntersections;

/// Finds self-intersections; `None` in a build without CGAL.
#[cfg(feature = "native")]
pub fn finder() -> Option<FindSelfIntersections<'static>> {
    Some(&|mesh| solidmap::cgal_tetgen::self_intersections(mesh).map_err(|error| error.to_string()))
}

/// Finds self-intersections; `None` in a build without CGAL.
#[cfg(not(feature = "native"))]
pub fn finder() -> Option<FindSelfIntersections<'static>> {
    None
}

//! Self-intersections of a solid, where the build has CGAL to look for them.

use crate::check::FindSelfIntersections;
use crate::mesh::SurfaceMesh;

/// Finds self-intersections with CGAL; `None` in a build without it.
#[cfg(feature = "native")]
pub fn self_intersection_finder() -> Option<FindSelfIntersections<'static>> {
    Some(&|mesh| crate::cgal_tetgen::self_intersections(mesh).map_err(|error| error.to_string()))
}

/// Finds self-intersections with CGAL; `None` in a build without it.
#[cfg(not(feature = "native"))]
pub fn self_intersection_finder() -> Option<FindSelfIntersections<'static>> {
    None
}

/// A warning when a solid, called `name`, intersects itself: its boundary is mapped all the same, but the inside is not
/// defined there. `None` also in a build that cannot look for it.
pub fn self_intersection_warning(solid: &SurfaceMesh, name: &str) -> Option<String> {
    match self_intersection_finder()?(solid) {
        Ok(pairs) => pairs.first().map(|[a, b]| {
            let count = match pairs.len() {
                1 => "1 pair".into(),
                count => format!("{count} pairs"),
            };
            format!(
                "`{name}` intersects itself: {count} of triangles, the first {a} and {b}; maps of its inside are wrong there. See \
                 `solidmap check`"
            )
        }),
        Err(error) => Some(format!(
            "self-intersections of `{name}` could not be looked for: {error}"
        )),
    }
}

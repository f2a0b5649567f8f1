//! Self-intersections, where the build has CGAL to look for them.

use std::path::Path;

use solidmap::check::FindSelfIntersections;
use solidmap::mesh::SurfaceMesh;

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

/// A warning when a domain intersects itself. Its boundary is fitted all the same, but the inside is not defined there.
pub fn warning(domain: &SurfaceMesh, path: &Path) -> Option<String> {
    let shown = path.display();
    match finder()?(domain) {
        Ok(pairs) => pairs.first().map(|[a, b]| {
            let count = match pairs.len() {
                1 => "1 pair".into(),
                count => format!("{count} pairs"),
            };
            format!(
                "`{shown}` intersects itself: {count} of triangles, the first {a} and {b}; the map is wrong there. See \
                 `solidmap check`"
            )
        }),
        Err(error) => Some(format!(
            "self-intersections of `{shown}` could not be looked for: {error}"
        )),
    }
}

use super::CgalTetgenError;
use super::input::{check_numbers, intersecting_triangles};
use crate::mesh::SurfaceMesh;

/// Limit of the pairs of triangles with overlapping boxes that are tested: a constant, and so many per triangle. A test
/// takes about 0.1 µs, and an ordinary surface has about twelve per triangle.
const MAX_TESTED: f64 = 2e7;
const TESTED_PER_TRIANGLE: f64 = 200.0;

/// Pairs of triangles of `surface` that meet in more than a corner or side common to both, the lower index first, in
/// ascending order; by exact predicates.
///
/// The surface may be open, non-manifold or inconsistently oriented. Coincident vertices count as one, so a seam of
/// repeated vertices is no intersection, but two triangles with the same three corners are. Triangles without area
/// intersect nothing.
///
/// # Errors
///
/// [`CgalTetgenError::InvalidInput`] when the surface is empty or has coordinates that are not finite;
/// [`CgalTetgenError::Crowded`] when too many triangles lie close together, such as ten thousand around one vertex, to
/// test all pairs within seconds.
pub fn self_intersections(surface: &SurfaceMesh) -> Result<Vec<[u32; 2]>, CgalTetgenError> {
    check_numbers(surface)?;
    let max_tested = MAX_TESTED + TESTED_PER_TRIANGLE * surface.triangles().len() as f64;
    let mut pairs = intersecting_triangles(surface, max_tested)?;
    pairs.retain(|pair| pair[0] != pair[1]);
    Ok(pairs)
}

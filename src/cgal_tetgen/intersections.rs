use super::CgalTetgenError;
use super::input::{check_numbers, meeting_triangles};
use crate::mesh::SurfaceMesh;

/// Pairs whose boxes meet; each takes some 0.1 µs. Of ordinary surfaces each triangle has a dozen.
const MOST_TESTED: f64 = 2e7;
const TESTED_PER_TRIANGLE: f64 = 200.0;

/// Pairs of triangles of `surface` that meet in more than a corner or side common to both, the lower index first, in
/// ascending order; by exact predicates.
///
/// Any triangles will do: open, non-manifold, inconsistently oriented. Corners in the same place are the same corner,
/// so a seam of repeated vertices is no intersection, while two triangles with the same three corners are one.
/// Triangles without area intersect nothing.
///
/// # Errors
///
/// [`CgalTetgenError::InvalidInput`] when the surface is empty or has coordinates that are not finite;
/// [`CgalTetgenError::Crowded`] when too many triangles lie close together, as around a vertex of ten thousand, to look at all
/// pairs of them within seconds.
pub fn self_intersections(surface: &SurfaceMesh) -> Result<Vec<[u32; 2]>, CgalTetgenError> {
    check_numbers(surface)?;
    let most_tested = MOST_TESTED + TESTED_PER_TRIANGLE * surface.triangles().len() as f64;
    let mut pairs = meeting_triangles(surface, most_tested)?;
    pairs.retain(|pair| pair[0] != pair[1]);
    Ok(pairs)
}

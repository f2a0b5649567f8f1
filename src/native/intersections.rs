use super::NativeError;
use super::input::{check_numbers, meeting_triangles};
use crate::mesh::SurfaceMesh;

/// Pairs of triangles of `surface` that meet in more than a corner or side common to both, the lower index first, in
/// ascending order; by exact predicates.
///
/// Any triangles will do: open, non-manifold, inconsistently oriented. Corners in the same place are the same corner,
/// so a seam of repeated vertices is no intersection, while two triangles with the same three corners are one.
/// Triangles without area intersect nothing.
///
/// # Errors
///
/// [`NativeError::InvalidInput`] when the surface is empty or has coordinates that are not finite.
pub fn self_intersections(surface: &SurfaceMesh) -> Result<Vec<[u32; 2]>, NativeError> {
    check_numbers(surface)?;
    let mut pairs = meeting_triangles(surface)?;
    pairs.retain(|pair| pair[0] != pair[1]);
    Ok(pairs)
}

//! The distance field of a solid, and points that lie outside it.

use super::{QueryError, SurfaceQuery};
use crate::Point;
use crate::mesh::SurfaceMesh;

/// Distance of each point from the boundary of a solid, negative outside.
///
/// The surface may overlap itself, as a target does where its boundary map folds: the winding number gives the sign.
///
/// # Errors
///
/// As [`SurfaceQuery::with_winding_sign`].
pub fn distance_field(surface: &SurfaceMesh, points: &[Point]) -> Result<Vec<f64>, QueryError> {
    let query = SurfaceQuery::with_winding_sign(surface)?;
    Ok(query.signed_distances(points).into_iter().map(|d| -d).collect())
}

/// Distance from the solid, as a fraction of its diagonal, beyond which a point counts as outside: rounding moves
/// points of the boundary by less.
const MARGIN: f64 = 1e-6;

/// Whether each point lies outside a solid, by more than a millionth of its diagonal. Points whose coordinates are not
/// finite lie outside.
///
/// # Errors
///
/// As [`SurfaceQuery::new`].
pub fn are_outside(surface: &SurfaceMesh, points: &[Point]) -> Result<Vec<bool>, QueryError> {
    let query = SurfaceQuery::new(surface)?;
    let mut outside: Vec<bool> = query.contains_all(points).into_iter().map(|inside| !inside).collect();
    // Distances take several times longer than inside tests, and few points need one.
    let is_finite = |p: &Point| p.iter().all(|c| c.is_finite());
    let near: Vec<usize> = (0..points.len())
        .filter(|&k| outside[k] && is_finite(&points[k]))
        .collect();
    let margin = MARGIN * surface.diagonal();
    let distances = query.signed_distances(&near.iter().map(|&k| points[k]).collect::<Vec<_>>());
    for (k, distance) in near.into_iter().zip(distances) {
        outside[k] = distance > margin;
    }
    Ok(outside)
}

/// How many points with finite coordinates lie outside a solid, as [`are_outside`].
///
/// # Errors
///
/// As [`SurfaceQuery::new`].
pub fn count_outside(surface: &SurfaceMesh, points: &[Point]) -> Result<usize, QueryError> {
    let outside = are_outside(surface, points)?.into_iter().zip(points);
    Ok(outside
        .filter(|(outside, p)| *outside && p.iter().all(|c| c.is_finite()))
        .count())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::shapes;

    #[test]
    fn distances_are_positive_inside_and_points_outside_are_counted() {
        let cube = shapes::cube(2.0, 2);
        let points = [
            [0.0, 0.0, 0.0],
            [0.5, 0.0, 0.0],
            [1.0 + 1e-9, 0.0, 0.0],
            [0.0, 3.0, 0.0],
        ]
        .map(Point::from);
        let distances = distance_field(&cube, &points).unwrap();
        for (found, exact) in distances.iter().zip([1.0, 0.5, -1e-9, -2.0]) {
            assert!((found - exact).abs() < 1e-12, "{found} {exact}");
        }
        let nowhere = Point::new(f64::NAN, 0.0, 0.0);
        let points = [&points[..], &[nowhere]].concat();
        assert_eq!(are_outside(&cube, &points).unwrap(), [false, false, false, true, true]);
        assert_eq!(count_outside(&cube, &points), Ok(1));
    }
}

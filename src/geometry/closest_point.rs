//! The closest point of a triangle.
//!
//! Ericson, *Real-Time Collision Detection*, 2005, section 5.1.5, decides between face, edges and corners by products
//! of dot products, whose relative errors grow with the inverse square of a needle's height. Here cross products tell
//! on which side of each edge the point lies; their errors grow with the inverse of the height. Then only edges that
//! the point is beyond can hold the closest point.

use crate::{Point, Vector};

/// Which part of a triangle a point lies on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Feature {
    /// The inside.
    Face,
    /// The inside of the side from this corner (0, 1 or 2) to the next.
    Edge(u8),
    /// This corner.
    Corner(u8),
}

/// A point of a triangle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrianglePoint {
    /// Weights of the corners: not negative, with sum 1.
    pub barycentric: [f64; 3],
    /// Which part of the triangle it lies on.
    pub feature: Feature,
    /// From the query to the point.
    pub offset: Vector,
}

/// Ratio of height to longest side `l` below which only the three sides of a triangle are used: its inside is within
/// `1e-8 l` of them, and rounding leaves its plane no better known than that.
const THIN: f64 = 1e-8;

/// The point of the triangle closest to `p`. Triangles without area are taken as segments or points.
#[inline]
pub fn closest_point_on_triangle(p: &Point, corners: &[Point; 3]) -> TrianglePoint {
    let [a, b, c] = corners;
    let (ab, ac, ap) = (b - a, c - a, p - a);
    let normal = ab.cross(&ac);
    let whole = normal.norm_squared();
    let third = normal.dot(&ab.cross(&ap));
    let second = normal.dot(&ap.cross(&ac));
    let first = whole - second - third;
    let thin = is_thin(whole, &ab, &ac);
    if !thin && first > 0.0 && second > 0.0 && third > 0.0 {
        let (v, w) = (second / whole, third / whole);
        return TrianglePoint {
            barycentric: [(1.0 - v - w).max(0.0), v, w],
            feature: Feature::Face,
            offset: ab * v + ac * w - ap,
        };
    }
    let mut best = corner(0, -ap);
    let mut least = best.offset.norm_squared();
    let on_or_beyond = [third <= 0.0, first <= 0.0, second <= 0.0];
    for (side, on_or_beyond) in on_or_beyond.into_iter().enumerate() {
        if thin || on_or_beyond {
            let candidate = closest_point_on_side(p, corners, side);
            let distance = candidate.offset.norm_squared();
            if distance < least {
                (best, least) = (candidate, distance);
            }
        }
    }
    best
}

/// Whether the triangle's plane is too uncertain to be used: its height is below [`THIN`] of its sides.
#[inline]
pub(super) fn is_thin(normal_squared: f64, ab: &Vector, ac: &Vector) -> bool {
    let (ab, ac) = (ab.norm_squared(), ac.norm_squared());
    let longest = if ab > ac { ab } else { ac };
    normal_squared <= THIN * THIN * longest * longest
}

#[inline]
fn closest_point_on_side(p: &Point, corners: &[Point; 3], side: usize) -> TrianglePoint {
    let next = (side + 1) % 3;
    let (start, end) = (&corners[side], &corners[next]);
    let along = end - start;
    let from_start = p - start;
    let t = from_start.dot(&along) / along.norm_squared();
    if t >= 1.0 {
        return corner(next, end - p);
    }
    if t > 0.0 {
        let mut barycentric = [0.0; 3];
        barycentric[side] = 1.0 - t;
        barycentric[next] = t;
        return TrianglePoint {
            barycentric,
            feature: Feature::Edge(side as u8),
            offset: along * t - from_start,
        };
    }
    // Also when the side has no length and `t` is NaN.
    corner(side, -from_start)
}

#[inline]
fn corner(k: usize, offset: Vector) -> TrianglePoint {
    let mut barycentric = [0.0; 3];
    barycentric[k] = 1.0;
    TrianglePoint {
        barycentric,
        feature: Feature::Corner(k as u8),
        offset,
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const TRIANGLE: [Point; 3] = [
        Point::new(0.0, 0.0, 0.0),
        Point::new(4.0, 0.0, 0.0),
        Point::new(0.0, 3.0, 0.0),
    ];

    #[test]
    fn every_region_has_its_closest_point() {
        for (p, closest, feature) in [
            ([1.0, 1.0, 5.0], [1.0, 1.0, 0.0], Feature::Face),
            ([1.0, 1.0, -5.0], [1.0, 1.0, 0.0], Feature::Face),
            ([2.0, -1.0, 1.0], [2.0, 0.0, 0.0], Feature::Edge(0)),
            ([2.0 + 3.0, 1.5 + 4.0, 1.0], [2.0, 1.5, 0.0], Feature::Edge(1)),
            ([-2.0, 1.0, 0.0], [0.0, 1.0, 0.0], Feature::Edge(2)),
            ([-1.0, -1.0, 1.0], [0.0, 0.0, 0.0], Feature::Corner(0)),
            ([9.0, -1.0, 1.0], [4.0, 0.0, 0.0], Feature::Corner(1)),
            ([-1.0, 9.0, 1.0], [0.0, 3.0, 0.0], Feature::Corner(2)),
        ] {
            let p = Point::from(p);
            let found = closest_point_on_triangle(&p, &TRIANGLE);
            assert!((p + found.offset - Point::from(closest)).norm() < 1e-15, "{p}");
            assert_eq!(found.feature, feature, "{p}");
        }
    }

    #[test]
    fn triangles_without_area_are_segments_and_points() {
        let [a, b] = [Point::new(1.0, 0.0, 0.0), Point::new(3.0, 0.0, 0.0)];
        let middle = Point::new(1.7, 0.0, 0.0);
        let p = Point::new(2.0, 2.0, 0.0);
        for corners in [[a, middle, b], [a, b, middle], [a, a, b], [a, b, b], [b, a, b]] {
            let found = closest_point_on_triangle(&p, &corners);
            assert_eq!(found.offset, Vector::new(0.0, -2.0, 0.0));
            assert!(matches!(found.feature, Feature::Edge(_)));
        }
        let found = closest_point_on_triangle(&p, &[a, a, a]);
        assert_eq!(found.offset, a - p);
    }

    proptest! {
        /// The closest point is the only point `c` of a convex set with `(p - c)·(x - c) ≤ 0` for all `x` of the set,
        /// and a linear function has its maximum at a corner.
        #[test]
        fn the_rest_of_the_triangle_lies_behind_the_closest_point(p in point(), a in point(), b in point(), c in point()) {
            let found = closest_point_on_triangle(&p, &[a, b, c]);
            let closest = p + found.offset;
            for corner in [a, b, c] {
                // Sides are of length 3 at most; the height of the triangle enters the rounding once.
                let flatness = (b - a).cross(&(c - a)).norm().max(1e-7);
                prop_assert!(-found.offset.dot(&(corner - closest)) < 1e-14 * 30.0 / flatness);
            }
            let [u, v, w] = found.barycentric;
            prop_assert!((u + v + w - 1.0).abs() < 1e-15 && u >= 0.0 && v >= 0.0 && w >= 0.0);
            prop_assert!((Point::from(a.coords * u + b.coords * v + c.coords * w) - closest).norm() < 1e-14);
        }
    }

    fn point() -> impl Strategy<Value = Point> {
        [-1.0..1.0, -1.0..1.0, -1.0..1.0f64].prop_map(Point::from)
    }
}

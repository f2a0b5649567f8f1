use crate::{Point, Vector};

/// An axis-aligned box.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Aabb {
    /// Lowest corner.
    pub low: Point,
    /// Highest corner.
    pub high: Point,
}

impl Aabb {
    /// The empty box: it contains no point, and its union with any box is that box.
    pub fn empty() -> Self {
        Self {
            low: Point::from(Vector::repeat(f64::INFINITY)),
            high: Point::from(Vector::repeat(f64::NEG_INFINITY)),
        }
    }

    /// The smallest box around `points`. NaN coordinates are passed over.
    pub fn around(points: &[Point]) -> Self {
        points.iter().fold(Self::empty(), |aabb, p| Self {
            low: aabb.low.inf(p),
            high: aabb.high.sup(p),
        })
    }

    /// The smallest box around both.
    pub fn union(&self, other: &Self) -> Self {
        Self {
            low: self.low.inf(&other.low),
            high: self.high.sup(&other.high),
        }
    }

    /// Whether the point is inside or on a side.
    pub fn contains(&self, p: &Point) -> bool {
        (0..3).all(|k| self.low[k] <= p[k] && p[k] <= self.high[k])
    }

    /// Square of the distance from `p` to the box, 0 inside.
    #[inline]
    pub fn distance_squared(&self, p: &Point) -> f64 {
        // Not `f64::max`: its handling of NaN doubles the cost of the step that dominates every traversal.
        let larger = |a: f64, b: f64| if a > b { a } else { b };
        let along = |k: usize| larger(larger(self.low[k] - p[k], p[k] - self.high[k]), 0.0);
        let (x, y, z) = (along(0), along(1), along(2));
        x * x + y * y + z * z
    }

    /// Square of the distance from `p` to the farthest corner.
    pub fn farthest_distance_squared(&self, p: &Point) -> f64 {
        let along = |k: usize| (p[k] - self.low[k]).abs().max((self.high[k] - p[k]).abs());
        (0..3).map(|k| along(k).powi(2)).sum()
    }

    /// Lengths of the sides.
    pub fn extent(&self) -> Vector {
        self.high - self.low
    }

    /// Half the surface area, the measure by which a tree is split; 0 for the empty box.
    pub(super) fn half_area(&self) -> f64 {
        let e = self.extent();
        if e.x < 0.0 {
            return 0.0;
        }
        e.x * e.y + e.y * e.z + e.z * e.x
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distances_are_those_to_the_nearest_and_farthest_corner_or_side() {
        let aabb = Aabb::around(&[Point::new(1.0, 2.0, 3.0), Point::new(0.0, 5.0, 3.5)]);
        assert_eq!(aabb.distance_squared(&Point::new(0.5, 3.0, 3.2)), 0.0);
        assert_eq!(aabb.distance_squared(&Point::new(-2.0, 3.0, 3.2)), 4.0);
        assert_eq!(aabb.distance_squared(&Point::new(3.0, 7.0, 2.0)), 4.0 + 4.0 + 1.0);
        assert_eq!(
            aabb.farthest_distance_squared(&Point::new(0.0, 2.0, 3.0)),
            1.0 + 9.0 + 0.25
        );
        assert!(aabb.contains(&Point::new(1.0, 5.0, 3.0)) && !aabb.contains(&Point::new(1.0, 5.1, 3.0)));
        assert!(!Aabb::empty().contains(&Point::origin()));
        assert_eq!(Aabb::empty().union(&aabb), aabb);
    }
}

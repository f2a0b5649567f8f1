//! The hyperbolic plane as the upper sheet of the hyperboloid `x² + y² − z² = −1`.
//!
//! Straight lines are plane sections through the origin, so that a triangle is counter-clockwise when the determinant of its corners is
//! positive, as on the sphere. The chart at a point is the central (Klein) projection onto the tangent plane there: lines are
//! straight in it, and lengths right to second order.

use crate::{Matrix3, Vector};

/// The Minkowski product: minus the hyperbolic cosine of the distance of two points.
pub(crate) fn product(p: &Vector, q: &Vector) -> f64 {
    p.x * q.x + p.y * q.y - p.z * q.z
}

/// The point of the hyperboloid on the ray to `p`.
pub(crate) fn normalised(p: &Vector) -> Vector {
    p / (-product(p, p)).sqrt()
}

/// The point of the hyperboloid with these first two coordinates.
pub(crate) fn lifted([x, y]: [f64; 2]) -> Vector {
    Vector::new(x, y, (1.0 + x * x + y * y).sqrt())
}

/// The chart at a point.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Chart {
    centre: Vector,
}

impl Chart {
    /// The chart at a point of the hyperboloid.
    pub fn at(centre: Vector) -> Self {
        Self { centre }
    }

    /// The chart at the middle of points of the hyperboloid.
    pub fn around<'a>(points: impl Iterator<Item = &'a Vector>) -> Self {
        Self::at(normalised(&points.sum()))
    }

    /// The place of a point in the chart: `(u, v, 1)`.
    pub fn place(&self, p: &Vector) -> Vector {
        self.place_and_height(p).0
    }

    /// The same, with the hyperbolic cosine of the distance from the centre.
    pub fn place_and_height(&self, p: &Vector) -> (Vector, f64) {
        let q = boosted(p, &self.centre, 1.0);
        (Vector::new(q.x / q.z, q.y / q.z, 1.0), q.z)
    }

    /// The point at a place, which is within the unit circle.
    pub fn point(&self, place: &Vector) -> Vector {
        // Exactly there, so that what has not moved stays as it is.
        if place.x == 0.0 && place.y == 0.0 {
            return self.centre;
        }
        let p = boosted(&normalised(place), &self.centre, -1.0);
        lifted([p.x, p.y])
    }
}

/// The boost that takes `centre` to `(0, 0, 1)`, or with the sign −1 its inverse.
fn boosted(p: &Vector, centre: &Vector, sign: f64) -> Vector {
    let (x, y, c) = (sign * centre.x, sign * centre.y, centre.z);
    let along = p.x * x + p.y * y;
    let share = p.z - along / (1.0 + c);
    Vector::new(p.x - x * share, p.y - y * share, c * p.z - along)
}

/// The rotation about `(0, 0, 1)`.
pub(crate) fn rotation(angle: f64) -> Matrix3 {
    let (sin, cos) = angle.sin_cos();
    Matrix3::new(cos, -sin, 0.0, sin, cos, 0.0, 0.0, 0.0, 1.0)
}

/// The boost along the first axis over a distance with this hyperbolic cosine.
pub(crate) fn boost(cosh: f64) -> Matrix3 {
    let sinh = (cosh * cosh - 1.0).sqrt();
    Matrix3::new(cosh, 0.0, sinh, 0.0, 1.0, 0.0, sinh, 0.0, cosh)
}

/// The inverse of an isometry.
pub(crate) fn inverse(m: &Matrix3) -> Matrix3 {
    let mut inverse = m.transpose();
    for k in 0..2 {
        inverse[(2, k)] = -inverse[(2, k)];
        inverse[(k, 2)] = -inverse[(k, 2)];
    }
    inverse
}

/// Signed area of the triangle of three points.
pub(crate) fn triangle_area([a, b, c]: [&Vector; 3]) -> f64 {
    let chart = Chart::around([a, b, c].into_iter());
    let [p, q, r] = [a, b, c].map(|x| boosted(x, &chart.centre, 1.0));
    let det = p.dot(&(q - p).cross(&(r - p)));
    2.0 * det.atan2(1.0 - product(&p, &q) - product(&q, &r) - product(&r, &p))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn charts_are_undone_and_keep_the_product() {
        let [a, b] = [lifted([0.3, -2.0]), lifted([5.0, 1.0])];
        let chart = Chart::at(a);
        assert!((chart.place(&a) - Vector::z()).norm() < 1e-14);
        assert!((chart.point(&chart.place(&b)) - b).norm() < 1e-12);
        let [p, q] = [&a, &b].map(|x| boosted(x, &lifted([1.0, 0.5]), 1.0));
        assert!((product(&p, &q) - product(&a, &b)).abs() < 1e-12);
    }

    #[test]
    fn the_area_of_a_triangle_is_pi_minus_its_angles() {
        // Equilateral: cosh c = cos α / (1 − cos α), by the law of cosines of hyperbolic triangles.
        for angle in [0.1, 0.5, 1.0] {
            let cosh: f64 = f64::cos(angle) / (1.0 - f64::cos(angle));
            // The distance of the corners from the centre.
            let of_centre = ((2.0 * cosh + 1.0) / 3.0).sqrt();
            let corner = |k: f64| rotation(k * std::f64::consts::TAU / 3.0) * boost(of_centre) * Vector::z();
            let [a, b, c] = [corner(0.0), corner(1.0), corner(2.0)];
            assert!((product(&a, &b) + cosh).abs() < 1e-9 * cosh);
            let expected = std::f64::consts::PI - 3.0 * angle;
            assert!((triangle_area([&a, &b, &c]) - expected).abs() < 1e-9, "{angle}");
            assert!((triangle_area([&b, &a, &c]) + expected).abs() < 1e-9, "{angle}");
        }
    }

    #[test]
    fn isometries_keep_the_product_and_have_inverses() {
        let m = rotation(0.7) * boost(3.0) * rotation(-1.1);
        let [a, b] = [lifted([0.3, -2.0]), lifted([0.5, 1.0])];
        assert!((product(&(m * a), &(m * b)) - product(&a, &b)).abs() < 1e-11);
        assert!((inverse(&m) * m - Matrix3::identity()).norm() < 1e-12);
    }
}

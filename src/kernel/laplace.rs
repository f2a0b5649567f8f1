//! The fundamental solution of the Laplace equation in three dimensions, and its gradient.
//!
//! # References
//!
//! Fairweather & Karageorghis, *The method of fundamental solutions for elliptic boundary value problems*, Adv. Comput.
//! Math. 9 (1998).

use std::f64::consts::PI;

use crate::{Point, Vector};

/// Potential at `x` of a unit source at `y`: `G(x, y) = 1 / (4π |x − y|)`.
///
/// Harmonic everywhere but at `y`, where it is infinite. NaN or infinite coordinates give NaN. Accurate wherever the
/// value can be represented, also where `|x − y|²` cannot.
///
/// ```
/// use solidmap::{Point, kernel::laplace_potential};
///
/// let g = laplace_potential(Point::new(2.0, 0.0, 0.0), Point::origin());
/// assert!((g - 1.0 / (8.0 * std::f64::consts::PI)).abs() < 1e-16);
/// ```
pub fn laplace_potential(x: Point, y: Point) -> f64 {
    1.0 / (4.0 * PI * norm(x - y))
}

/// Gradient of [`laplace_potential`] with respect to `x`: `∇G(x, y) = −(x − y) / (4π |x − y|³)`, the direction towards
/// the source. NaN where `x == y` or a coordinate is not finite.
///
/// ```
/// use solidmap::{Point, Vector, kernel::laplace_gradient};
///
/// let gradient = laplace_gradient(Point::new(2.0, 0.0, 0.0), Point::origin());
/// assert!((gradient - Vector::new(-1.0 / (16.0 * std::f64::consts::PI), 0.0, 0.0)).norm() < 1e-16);
/// ```
pub fn laplace_gradient(x: Point, y: Point) -> Vector {
    let d = x - y;
    let r = norm(d);
    // One division after the other: r³ leaves the range of f64 long before the gradient does.
    -(d / r) / (4.0 * PI * r) / r
}

/// Length of `d` without overflow or underflow of its square; NaN when a component is not finite.
pub(super) fn norm(d: Vector) -> f64 {
    let largest = d.amax();
    if largest == 0.0 {
        // `amax` passes over NaN, a sum does not.
        return d.sum();
    }
    largest * (d / largest).norm()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn point(range: std::ops::Range<f64>) -> impl Strategy<Value = Point> {
        prop::array::uniform3(range).prop_map(Point::from)
    }

    proptest! {
        /// The error of a central difference of step `h` is `h² max|∂³G| / 6`, and `|∂³G| ≤ 6 / 4πr⁴`: here `r ≥ √3`.
        #[test]
        fn gradient_matches_central_differences(x in point(0.0..1.0), y in point(2.0..4.0)) {
            let h = 1e-4_f64;
            let bound = 1.01 * h * h / (4.0 * PI * 9.0) + 1e-12;
            let gradient = laplace_gradient(x, y);
            for axis in 0..3 {
                let (mut ahead, mut behind) = (x, x);
                ahead[axis] += h;
                behind[axis] -= h;
                let slope = (laplace_potential(ahead, y) - laplace_potential(behind, y)) / (2.0 * h);
                prop_assert!((slope - gradient[axis]).abs() < bound);
            }
        }

        #[test]
        fn scaling_lengths_scales_potential_and_gradient(
            x in point(0.0..1.0),
            y in point(2.0..4.0),
            exponent in prop::sample::select(vec![-500, -300, 40, 300, 500]),
        ) {
            // Powers of two: the scaled values are the same to the last bit, up to the rounding of 4π r.
            let s = 2f64.powi(exponent);
            let potential = laplace_potential(x * s, y * s) * s;
            let gradient = laplace_gradient(x * s, y * s) * s * s;
            prop_assert!((potential / laplace_potential(x, y) - 1.0).abs() < 1e-15);
            prop_assert!((gradient - laplace_gradient(x, y)).norm() < 1e-15 * gradient.norm());
        }
    }

    #[test]
    fn is_not_finite_at_the_source_nor_for_coordinates_that_are_not() {
        let y = Point::new(0.1, -0.2, 0.3);
        assert_eq!(laplace_potential(y, y), f64::INFINITY);
        assert!(laplace_gradient(y, y).iter().all(|g| g.is_nan()));
        for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            for x in [Point::new(bad, 0.0, 0.0), Point::new(y.x, y.y, bad)] {
                assert!(laplace_potential(x, y).is_nan());
                assert!(laplace_gradient(x, y).iter().any(|g| g.is_nan()));
            }
        }
    }
}

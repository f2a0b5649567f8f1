//! Where the vector loops can be trusted, and the sums that take their place elsewhere.

use super::Sources;
use crate::kernel::laplace::norm;
use crate::{Matrix3, Point, Vector};

/// A power of two by which lengths are multiplied, and its reciprocal.
#[derive(Debug, Clone, Copy)]
pub(in crate::kernel) struct PowerOfTwoScale {
    pub(in crate::kernel) up: f64,
    pub(in crate::kernel) down: f64,
}

impl PowerOfTwoScale {
    /// Brings the largest finite coordinate to between one and two, or as near as exact powers of two do.
    pub(in crate::kernel) fn of<'a>(points: impl IntoIterator<Item = &'a Point>) -> Self {
        let magnitudes = points.into_iter().flat_map(|p| p.iter()).map(|c| c.abs());
        Self::of_magnitude(magnitudes.filter(|c| c.is_finite()).fold(0.0, f64::max))
    }

    /// Brings a positive value to between one and two likewise; leaves zero and what is not finite.
    pub(in crate::kernel) fn of_magnitude(largest: f64) -> Self {
        if largest == 0.0 || !largest.is_finite() {
            return Self { up: 1.0, down: 1.0 };
        }
        let exponent_bits = (largest.to_bits() >> 52).clamp(23, 2023);
        Self {
            up: f64::from_bits((2046 - exponent_bits) << 52),
            down: f64::from_bits(exponent_bits << 52),
        }
    }
}

/// Whether the sums at a target can be trusted.
///
/// Squared distances overflow only when the target is far outside the sources, and lose bits to underflow only when
/// both points are minute. Other limits of the estimate of `1/r` leave an infinity or NaN in the sum.
pub(super) fn in_range(sources: &Sources, target: Point, sums: &[f64]) -> bool {
    let scaled = target * sources.scale.up;
    let within = scaled.iter().all(|c| c.abs() <= FAR);
    within && !(sources.has_minute && is_minute(scaled)) && sums.iter().all(|v| v.is_finite())
}

/// Largest scaled coordinate of a target for the vector loops, 2⁶⁰: `r²` stays below 2¹²⁴, in the range of `f32`.
const FAR: f64 = (1u64 << 60) as f64;

/// Whether a scaled point is so near the origin (2⁻⁴³⁰) that its squared distance to another such point may underflow.
/// Distances below 2⁻⁴⁸⁵ occur only among such points, since coordinates of `2⁻⁴³⁰` are 2⁻⁴⁸³ apart.
pub(in crate::kernel) fn is_minute(scaled: Point) -> bool {
    const MINUTE: f64 = f64::from_bits((1023 - 430) << 52);
    scaled.coords.amax() < MINUTE
}

pub(super) fn unlimited_potential(sources: &Sources, target: Point) -> [f64; 3] {
    let mut sum = [0.0; 3];
    for &[x, y, z, w0, w1, w2] in &sources.packed {
        let r = norm(target - Point::new(x, y, z) * sources.scale.down);
        for (sum, w) in sum.iter_mut().zip([w0, w1, w2]) {
            *sum += w / r;
        }
    }
    sum
}

pub(super) fn unlimited_jacobian(sources: &Sources, target: Point) -> Matrix3 {
    let mut sum = Matrix3::zeros();
    for &[x, y, z, w0, w1, w2] in &sources.packed {
        let d = target - Point::new(x, y, z) * sources.scale.down;
        let r = norm(d);
        sum -= Vector::new(w0, w1, w2) / r / r * (d / r).transpose();
    }
    sum
}

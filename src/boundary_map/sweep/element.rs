//! The energy of one triangle between two surfaces, and its derivatives.
//!
//! With `s = |J|²` and `c = det J` of the linear map from a triangle of the domain to that between images of its corners, the
//! symmetric Dirichlet energy is `s + s / c²`. Here it is `s + s / (c² + σ s² / 4)`, which stays finite where the image is flat:
//! three points of the target may lie on a line. With `c² + σ` instead, an image that is a point would cost nothing.

use nalgebra::{SMatrix, SVector};

use crate::spherical::{RestShape, det, positive_det};
use crate::{Point, Vector};

/// Weight of the angle distortion in the plane: a barrier against flat triangles there.
const BARRIER: f64 = 1e-3;

/// The three coordinates of the image of a point by `N` others.
pub(crate) type Chain<const N: usize> = SMatrix<f64, 3, N>;

/// First derivatives, and semidefinite ones in place of the second.
#[derive(Debug, Clone)]
pub(crate) struct Derivatives<const N: usize> {
    pub gradient: SVector<f64, N>,
    pub hessian: SMatrix<f64, N, N>,
}

impl<const N: usize> Derivatives<N> {
    pub fn zeros() -> Self {
        Self {
            gradient: SVector::zeros(),
            hessian: SMatrix::zeros(),
        }
    }
}

/// Squared norm and determinant of the Jacobian, and the unit normal of the image.
fn invariants([a, b, c]: [&Point; 3], rest: &RestShape) -> (f64, f64, Vector) {
    let s = rest.dirichlet(&a.coords, &b.coords, &c.coords) / (2.0 * rest.area);
    let cross = (b - a).cross(&(c - a));
    let area = cross.norm();
    let normal = if area > 0.0 { cross / area } else { Vector::zeros() };
    (s, area / (2.0 * rest.area), normal)
}

/// The energy of a triangle with these images of its corners: its area for an isometry, about.
pub(crate) fn image_energy(images: [&Point; 3], rest: &RestShape, softness: f64) -> f64 {
    let (s, c, _) = invariants(images, rest);
    0.25 * rest.area * (s + s / (c * c + 0.25 * softness * s * s).max(f64::MIN_POSITIVE))
}

/// Adds the derivatives of [`image_energy`], from those of the images.
pub(crate) fn add_image_derivatives<const N: usize>(
    images: [&Point; 3],
    chains: [&Chain<N>; 3],
    rest: &RestShape,
    softness: f64,
    sum: &mut Derivatives<N>,
) {
    let (s, c, normal) = invariants(images, rest);
    let [y, a, b] = images;
    let [cy, ca, cb] = rest.cotangents;
    let ds = [
        ca * (y - b) + cb * (y - a),
        cb * (a - y) + cy * (a - b),
        cy * (b - a) + ca * (b - y),
    ];
    let dc = [b - a, y - b, a - y].map(|v| normal.cross(&v) / (2.0 * rest.area));
    let (mut gs, mut gc, mut metric) = (SVector::<f64, N>::zeros(), SVector::<f64, N>::zeros(), SMatrix::zeros());
    for (k, chain) in chains.iter().enumerate() {
        gs += chain.tr_mul(&(ds[k] / rest.area));
        gc += chain.tr_mul(&dc[k]);
        let side = chains[(k + 1) % 3] - chains[(k + 2) % 3];
        metric += side.tr_mul(&side) * (rest.cotangents[k] / rest.area);
    }
    // E = s + s / g, g = c² + σ s² / 4.
    let soft = 0.25 * softness * s * s;
    let g = (c * c + soft).max(f64::MIN_POSITIVE);
    let (g2, g3) = (g * g, g * g * g);
    let rest_of_g = c * c - soft;
    let by_s = 1.0 + rest_of_g / g2;
    let by_c = -2.0 * c * s / g2;
    let by_ss = -0.5 * softness * s * (g + 2.0 * rest_of_g) / g3;
    let by_sc = 2.0 * c / g2 - 4.0 * c * rest_of_g / g3;
    let by_cc = -2.0 * s / g2 + 8.0 * c * c * s / g3;
    // s is half a quadratic form, so that its second derivatives are at least gs gsᵀ / 2s; that part goes with those of E by s
    // and c, whose matrix is made semidefinite. Second derivatives of c are left out.
    let own = by_s.max(0.0);
    let part = own / (2.0 * s).max(f64::MIN_POSITIVE);
    let [p, q, r] = semidefinite([by_ss + part, by_sc, by_cc]);
    let w = 0.25 * rest.area;
    sum.gradient += (gs * by_s + gc * by_c) * w;
    let cross = gs * gc.transpose();
    sum.hessian +=
        (metric * own + gs * gs.transpose() * (p - part) + (cross + cross.transpose()) * q + gc * gc.transpose() * r)
            * w;
}

/// The semidefinite matrix nearest to `[[a, b], [b, c]]`.
fn semidefinite([a, b, c]: [f64; 3]) -> [f64; 3] {
    let (middle, radius) = (0.5 * (a + c), (0.5 * (a - c)).hypot(b));
    let (high, low) = (middle + radius, middle - radius);
    if low >= 0.0 || radius == 0.0 {
        return if low >= 0.0 { [a, b, c] } else { [0.0; 3] };
    }
    if high <= 0.0 {
        return [0.0; 3];
    }
    // The projection onto the eigenvector of the larger eigenvalue, times it.
    let scale = high / (high - low);
    [(a - low) * scale, b * scale, (c - low) * scale]
}

/// The barrier of a triangle with these corners in the plane; `None` unless it is positive.
pub(crate) fn barrier([x, a, b]: [&Vector; 3], rest: &RestShape) -> Option<f64> {
    let d = positive_det(x, a, b)?;
    Some(0.5 * BARRIER * rest.area * rest.dirichlet(x, a, b) / d)
}

/// Derivatives of [`barrier`] by the coordinates of the corners in the plane.
pub(crate) fn barrier_derivatives(corners: [&Vector; 3], rest: &RestShape) -> Derivatives<6> {
    let [x, a, b] = corners;
    let d = det(x, a, b);
    let q = rest.dirichlet(x, a, b);
    let w = 0.5 * BARRIER * rest.area;
    let mut metric = SMatrix::<f64, 6, 6>::zeros();
    let (mut gq, mut gd) = (SVector::<f64, 6>::zeros(), SVector::<f64, 6>::zeros());
    for k in 0..3 {
        let (m, n) = ((k + 1) % 3, (k + 2) % 3);
        let side = corners[n] - corners[m];
        let weight = 2.0 * rest.cotangents[k];
        for axis in 0..2 {
            let (i, j) = (2 * m + axis, 2 * n + axis);
            gq[i] -= weight * side[axis];
            gq[j] += weight * side[axis];
            metric[(i, i)] += weight;
            metric[(j, j)] += weight;
            metric[(i, j)] -= weight;
            metric[(j, i)] -= weight;
        }
        (gd[2 * k], gd[2 * k + 1]) = (-side.y, side.x);
    }
    let cross = gq * gd.transpose();
    Derivatives {
        gradient: (gq / d - gd * (q / (d * d))) * w,
        hessian: (metric / d - (cross + cross.transpose()) / (d * d) + gd * gd.transpose() * (2.0 * q / (d * d * d)))
            * w,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rest() -> RestShape {
        let corners = [[0.0, 0.0, 0.0], [1.1, 0.0, 0.0], [0.3, 0.8, 0.0]].map(Point::from);
        RestShape::of_triangle(corners.each_ref(), 1.0)
    }

    #[test]
    fn an_isometry_has_its_area_as_energy() {
        let corners = [[0.0, 0.0, 0.0], [1.1, 0.0, 0.0], [0.3, 0.8, 0.0]].map(Point::from);
        let energy = image_energy(corners.each_ref(), &rest(), 0.0);
        assert!((energy / rest().area - 1.0).abs() < 1e-12);
    }

    #[test]
    fn gradients_agree_with_differences() {
        let chain = |k: usize| Chain::<9>::from_fn(|i, j| f64::from(u8::from(j == 3 * k + i)));
        let at = |x: &[f64; 9]| [0, 1, 2].map(|k| Point::new(x[3 * k], x[3 * k + 1], x[3 * k + 2]));
        let x = [0.1, -0.2, 0.3, 1.3, 0.2, 0.1, 0.2, 0.4, -0.5];
        for softness in [0.0, 1e-3, 0.02] {
            let mut sum = Derivatives::zeros();
            let chains = [chain(0), chain(1), chain(2)];
            add_image_derivatives(at(&x).each_ref(), chains.each_ref(), &rest(), softness, &mut sum);
            for i in 0..9 {
                let value = |h: f64| {
                    let mut moved = x;
                    moved[i] += h;
                    image_energy(at(&moved).each_ref(), &rest(), softness)
                };
                let slope = (value(1e-6) - value(-1e-6)) / 2e-6;
                assert!(
                    (slope - sum.gradient[i]).abs() < 1e-7,
                    "{i}: {slope} {}",
                    sum.gradient[i]
                );
            }
            let values = sum.hessian.symmetric_eigenvalues();
            assert!(values.min() > -1e-9 * values.max());
        }
        let corners = [[0.1, 0.2, 1.0], [0.9, 0.1, 1.0], [0.4, 0.7, 1.0]].map(Vector::from);
        let found = barrier_derivatives(corners.each_ref(), &rest());
        for i in 0..6 {
            let value = |h: f64| {
                let mut moved = corners;
                moved[i / 2][i % 2] += h;
                barrier(moved.each_ref(), &rest()).unwrap()
            };
            let slope = (value(1e-6) - value(-1e-6)) / 2e-6;
            assert!(
                (slope - found.gradient[i]).abs() < 1e-9,
                "{i}: {slope} {}",
                found.gradient[i]
            );
        }
    }
}

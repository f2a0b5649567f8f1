//! What an expansion of the map proves about its Jacobian over a cell.
//!
//! Lengths are in units of the cell's circumradius, so that the cell is the cube `|x_k| ≤ 1 / √3` and its ball the unit
//! ball. The Jacobian is `J(x) = J₀ + L(x) + H(x)` with `L` linear, of the harmonics of degree 2, and `H` of those of
//! degrees 3 and more and of what the expansion leaves out.

use super::harmonics::{ORDER, TERMS, terms_of};
use crate::{Matrix3, Vector};

/// Half the side of a cube with circumradius 1.
const HALF_SIDE: f64 = 0.577_350_269_189_625_8;
/// Matrices worse conditioned than this are not inverted: rounding of their inverse would have to be looked at.
const WORST_CONDITION: f64 = 1e9;
/// Rounding of the few dozen operations on 3 × 3 matrices that a test takes, relative to the largest of their terms.
const ROUNDING: f64 = 1e-13;

/// What is known of the Jacobian over a cell.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Examined {
    /// `det J` at the centre, as far as the expansion goes.
    pub(super) det: f64,
    /// Lower bounds over the cell, if they are positive.
    pub(super) regular: Option<Regular>,
}

impl Examined {
    /// The same for lengths of the domain in other units.
    pub(super) fn scaled(self, factor: f64) -> Self {
        let regular = self.regular.map(|found| Regular {
            sigma_min: found.sigma_min * factor,
            det: found.det * factor.powi(3),
        });
        Self {
            det: self.det * factor.powi(3),
            regular,
        }
    }
}

/// Lower bounds of what does not vanish in a cell. The sign of the determinant is that at the centre.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Regular {
    /// Of the least singular value.
    pub(super) sigma_min: f64,
    /// Of the absolute determinant.
    pub(super) det: f64,
}

/// Examines the expansion of a map, three times [`TERMS`] coefficients, whose Jacobian is off by no more than
/// `remainder` (spectral norm) anywhere in the ball.
pub(super) fn examine(expansion: &[f64], remainder: f64) -> Examined {
    let centre = at_centre(expansion);
    let det = centre.determinant();
    let slopes = slopes(expansion);
    let grams: [Matrix3; ORDER] = std::array::from_fn(|i| gram(expansion, i + 1));
    let regular = by_inverse(&centre, &slopes, &grams, remainder)
        .or_else(|| by_determinant(&centre, &slopes, &grams, remainder, det));
    Examined { det, regular }
}

/// Frobenius norm of the Jacobian at the centre.
pub(super) fn size_at_centre(expansion: &[f64]) -> f64 {
    at_centre(expansion).norm()
}

/// `J₀`: the harmonics of degree 1 are z, x, y.
fn at_centre(expansion: &[f64]) -> Matrix3 {
    Matrix3::from_fn(|i, k| expansion[i * TERMS + [1, 2, 0][k]])
}

/// The derivatives of `L` along the axes.
fn slopes(expansion: &[f64]) -> [Matrix3; 3] {
    let root = 3f64.sqrt();
    // Hessians of the three coordinates, from those of the five harmonics of degree 2.
    let hessians: [Matrix3; 3] = std::array::from_fn(|i| {
        let a = &expansion[i * TERMS..][terms_of(2)];
        let (xz, yz, xy) = (root * a[1], root * a[2], root * a[4]);
        let (xx, yy, zz) = (root * a[3] - a[0], -root * a[3] - a[0], 2.0 * a[0]);
        Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz)
    });
    std::array::from_fn(|axis| Matrix3::from_fn(|i, k| hessians[i][(k, axis)]))
}

/// `A Aᵀ` of the three rows of coefficients of a degree.
fn gram(expansion: &[f64], degree: usize) -> Matrix3 {
    let rows: [&[f64]; 3] = std::array::from_fn(|i| &expansion[i * TERMS..][terms_of(degree)]);
    let product = |i: usize, k: usize| rows[i].iter().zip(rows[k]).map(|(a, b)| a * b).sum();
    Matrix3::from_fn(product)
}

/// `J₀⁻¹ J(x) = I + X` with a symmetric part of `I + X` that is positive definite over the ball: then `J` is regular,
/// with `σ_min(J) ≥ σ_min(J₀) (1 − s)` and `|det J| ≥ |det J₀| (1 − s)³` (Ostrowski and Taussky) for `s ≥ ‖sym X‖`.
fn by_inverse(centre: &Matrix3, slopes: &[Matrix3; 3], grams: &[Matrix3; ORDER], remainder: f64) -> Option<Regular> {
    let inverse = centre.try_inverse()?;
    let norm = spectral_norm(&inverse);
    let condition = norm * spectral_norm(centre);
    (condition < WORST_CONDITION).then_some(())?;
    let mut bound = norm * remainder + condition * ROUNDING;
    for degree in 3..=ORDER {
        bound += degree as f64 * root_of_largest(&(inverse * grams[degree - 1] * inverse.transpose()));
    }
    (bound < 1.0).then_some(())?;
    let scaled = slopes.map(|slope| {
        let product = inverse * slope;
        (product + product.transpose()) * (0.5 * HALF_SIDE)
    });
    // The norm of a linear function is convex and even: over the cube it is largest at one of these corners.
    let corners = [[1.0, 1.0], [1.0, -1.0], [-1.0, 1.0], [-1.0, -1.0]];
    let linear = corners.map(|[y, z]| spectral_norm(&(scaled[0] + scaled[1] * y + scaled[2] * z)));
    let rest = 1.0 - bound - linear.into_iter().fold(0.0, f64::max);
    (rest > 0.0).then(|| Regular {
        sigma_min: rest / norm,
        det: centre.determinant().abs() * rest.powi(3),
    })
}

/// The determinant of `J₀ + L(x)` is a cubic polynomial, bounded term by term over the cube. `H` adds no more than
/// `e₂ h + e₁ h² + h³` for `h ≥ ‖H‖`, with the elementary symmetric functions of the singular values of `J₀ + L`.
fn by_determinant(
    centre: &Matrix3,
    slopes: &[Matrix3; 3],
    grams: &[Matrix3; ORDER],
    remainder: f64,
    det: f64,
) -> Option<Regular> {
    let higher = |degree: usize| degree as f64 * root_of_largest(&grams[degree - 1]);
    let beyond = remainder + (3..=ORDER).map(higher).sum::<f64>();
    let linear = (0..3).map(|k| spectral_norm(&slopes[k])).sum::<f64>() * HALF_SIDE;
    let squares = (centre.transpose() * centre).symmetric_eigenvalues();
    let [a, b, c] = [0, 1, 2].map(|k| squares[k].max(0.0).sqrt() + linear);
    let change = beyond * (a * b + a * c + b * c + beyond * (a + b + c + beyond));

    let cofactors = cofactors(centre);
    let second = slopes.each_ref().map(self::cofactors);
    let mixed = |k: usize, l: usize| self::cofactors(&(slopes[k] + slopes[l])) - second[k] - second[l];
    let sign = det.signum();
    let (mut first_order, mut second_order, mut third_order) = (0.0, 0.0, 0.0);
    for k in 0..3 {
        first_order += cofactors.dot(&slopes[k]).abs();
        // Squares only add to one side.
        second_order += (-sign * second[k].dot(centre)).max(0.0);
        third_order += slopes[k].determinant().abs();
        for l in (0..3).filter(|&l| l != k) {
            third_order += second[k].dot(&slopes[l]).abs();
        }
    }
    for [k, l] in [[0, 1], [0, 2], [1, 2]] {
        second_order += mixed(k, l).dot(centre).abs();
    }
    third_order += mixed(0, 1).dot(&slopes[2]).abs();
    let change = change + HALF_SIDE * (first_order + HALF_SIDE * (second_order + HALF_SIDE * third_order));
    let largest = a.max(b).max(c) + beyond;
    let rest = det.abs() - change - ROUNDING * largest.powi(3);
    (rest > 0.0).then(|| Regular {
        sigma_min: rest / (largest * largest),
        det: rest,
    })
}

fn cofactors(m: &Matrix3) -> Matrix3 {
    let [a, b, c] = [0, 1, 2].map(|k| Vector::from(m.column(k)));
    Matrix3::from_columns(&[b.cross(&c), c.cross(&a), a.cross(&b)])
}

/// An upper bound of the largest singular value, at most 1.04 times it.
fn spectral_norm(m: &Matrix3) -> f64 {
    root_of_largest(&(m.transpose() * m))
}

/// An upper bound of the root of the largest eigenvalue of a positive semidefinite matrix: `λ¹⁶ ≤ tr G¹⁶ ≤ 3 λ¹⁶`.
fn root_of_largest(gram: &Matrix3) -> f64 {
    let trace = gram.trace();
    if trace == 0.0 {
        return 0.0;
    }
    let mut power = gram / trace;
    for _ in 0..4 {
        power = power * power;
    }
    (trace * power.trace().powf(1.0 / 16.0)).sqrt()
}

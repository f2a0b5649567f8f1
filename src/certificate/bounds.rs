//! Bounds of the Jacobian over a cell, from an expansion of the map.
//!
//! Lengths are in units of the cell's circumradius, so that the cell is the cube `|x_k| ≤ 1 / √3` and its ball the unit
//! ball. The Jacobian is `J(x) = J₀ + L(x) + H(x)` with `L` linear, of the harmonics of degree 2, and `H` of those of
//! degree 3 and higher and of what the expansion omits.

use super::harmonics::{ORDER, TERMS, terms_of};
use crate::{Matrix3, Vector};

/// Half the side of a cube with circumradius 1.
const HALF_SIDE: f64 = 0.577_350_269_189_625_8;
/// Coefficients beyond this, and Jacobians below its reciprocal, prove nothing: their products might overflow or
/// vanish.
const LARGEST: f64 = 1e80;
/// Rounding error of the few dozen operations on 3 × 3 matrices of a test, relative to the largest of their terms.
const ROUNDING: f64 = 1e-13;

/// Result of the test of a cell.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct JacobianTest {
    /// `det J` of the expansion at the centre.
    pub(super) det: f64,
    /// Lower bounds over the cell, if `det J` is proved not to vanish.
    pub(super) regular: Option<RegularityBounds>,
}

impl JacobianTest {
    /// The same with lengths of the domain in other units.
    pub(super) fn scaled(self, factor: f64) -> Self {
        let regular = self.regular.map(|found| RegularityBounds {
            sigma_min: found.sigma_min * factor,
            det: found.det * factor.powi(3),
        });
        Self {
            det: self.det * factor.powi(3),
            regular,
        }
    }
}

/// Lower bounds over a cell in which the sign of the determinant is that at the centre.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct RegularityBounds {
    /// Lower bound of the least singular value.
    pub(super) sigma_min: f64,
    /// Lower bound of the absolute determinant.
    pub(super) det: f64,
}

/// Tests a cell by the expansion of the map in it, three times [`TERMS`] coefficients, whose Jacobian has an error of
/// at most `remainder` (spectral norm) anywhere in the ball.
pub(super) fn test_cell(expansion: &[f64], remainder: f64) -> JacobianTest {
    let centre = at_centre(expansion);
    let det = centre.determinant();
    let within = |x: f64| x.is_finite() && x.abs() < LARGEST;
    if !within(remainder) || !expansion.iter().all(|x| within(*x)) || centre.norm() < 1.0 / LARGEST {
        return JacobianTest { det, regular: None };
    }
    let slopes = slopes(expansion);
    let grams: [Matrix3; ORDER] = std::array::from_fn(|i| gram(expansion, i + 1));
    let regular = by_inverse(&centre, &slopes, &grams, remainder)
        .or_else(|| by_determinant(&centre, &slopes, &grams, remainder, det));
    JacobianTest { det, regular }
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

/// `J₀⁻¹ J(x) = I + X` with a symmetric part of `I + X` that is positive definite over the cell: then `J` is regular,
/// with `σ_min(J) ≥ σ_min(J₀) (1 − s)` and `|det J| ≥ |det J₀| (1 − s)³` (Ostrowski and Taussky) for `s ≥ ‖sym X‖`. The
/// inverse is the adjugate over the determinant, so that both have a rounding error relative to `‖J₀‖³ / |det J₀|`,
/// which may be the square of the condition number.
fn by_inverse(
    centre: &Matrix3,
    slopes: &[Matrix3; 3],
    grams: &[Matrix3; ORDER],
    remainder: f64,
) -> Option<RegularityBounds> {
    let inverse = centre.try_inverse()?;
    let norm = spectral_norm(&inverse);
    let mut bound = norm * remainder + ROUNDING * spectral_norm(centre).powi(3) / centre.determinant().abs();
    for degree in 3..=ORDER {
        bound += degree as f64 * root_of_largest(&(inverse * grams[degree - 1] * inverse.transpose()));
    }
    (bound < 1.0).then_some(())?;
    let scaled = slopes.map(|slope| {
        let product = inverse * slope;
        (product + product.transpose()) * (0.5 * HALF_SIDE)
    });
    // The norm of a linear function is convex and even, so that it is largest at one of these corners of the cube.
    let corners = [[1.0, 1.0], [1.0, -1.0], [-1.0, 1.0], [-1.0, -1.0]];
    let linear = corners.map(|[y, z]| spectral_norm(&(scaled[0] + scaled[1] * y + scaled[2] * z)));
    let [a, b, c, d] = linear;
    let rest = 1.0 - bound - (a.max(b)).max(c.max(d));
    (rest > 0.0).then(|| RegularityBounds {
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
) -> Option<RegularityBounds> {
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
        // The square of a coordinate is not negative: only a coefficient that opposes the sign of `det` counts.
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
    (rest > 0.0).then(|| RegularityBounds {
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

#[cfg(test)]
mod tests {
    use rand::{Rng, SeedableRng, rngs::StdRng};

    use super::*;

    fn affine(j: &Matrix3) -> Vec<f64> {
        let mut expansion = vec![0.0; 3 * TERMS];
        for (i, k) in (0..9).map(|n| (n / 3, n % 3)) {
            expansion[i * TERMS + [1, 2, 0][k]] = j[(i, k)];
        }
        expansion
    }

    /// With entries that are multiples of 2⁻⁴⁰ the determinant is a multiple of 2⁻¹²⁰.
    fn exact_determinant(j: &Matrix3) -> f64 {
        let m = |i: usize, k: usize| (j[(i, k)] * 2f64.powi(40)) as i128;
        let minor = |a: usize, b: usize| m(1, a) * m(2, b) - m(1, b) * m(2, a);
        let det = m(0, 0) * minor(1, 2) - m(0, 1) * minor(0, 2) + m(0, 2) * minor(0, 1);
        det as f64 * 2f64.powi(-120)
    }

    #[test]
    fn nearly_singular_jacobians_are_not_given_a_wrong_sign_or_bound() {
        let mut random = StdRng::seed_from_u64(5);
        let mut rotation = || {
            nalgebra::Rotation3::from_euler_angles(
                random.random_range(-3.0..3.0),
                random.random_range(-1.5..1.5),
                random.random_range(-3.0..3.0),
            )
        };
        for (exponent, some) in [
            (-2, true),
            (-5, true),
            (-6, true),
            (-7, false),
            (-8, false),
            (-9, false),
        ] {
            let small = 10f64.powi(exponent);
            let mut proved = 0;
            for _ in 0..2000 {
                let j =
                    rotation().matrix() * Matrix3::from_diagonal(&Vector::new(1.0, small, small)) * rotation().matrix();
                let j = j.map(|x| (x * 2f64.powi(40)).round() * 2f64.powi(-40));
                let exact = exact_determinant(&j);
                let found = test_cell(&affine(&j), 0.0);
                if let Some(regular) = found.regular {
                    proved += 1;
                    assert_eq!(found.det.signum(), exact.signum(), "{j}");
                    assert!(regular.det <= exact.abs() * (1.0 + 1e-12), "{} {exact:e}", regular.det);
                }
            }
            assert_eq!(proved > 0, some, "10^{exponent}: {proved}");
        }
    }

    #[test]
    fn entries_out_of_range_prove_nothing() {
        for size in [1e103, 1e155, 1e300, 1e-108, 1e-300, 0.0, f64::INFINITY, f64::NAN] {
            assert_eq!(
                test_cell(&affine(&(Matrix3::identity() * size)), 0.0).regular,
                None,
                "{size:e}"
            );
        }
        assert_eq!(test_cell(&affine(&Matrix3::identity()), f64::NAN).regular, None);
        assert!(test_cell(&affine(&Matrix3::identity()), 0.0).regular.is_some());
    }

    /// Random polynomials of all degrees: bounds hold at every sample in the cell.
    #[test]
    fn bounds_hold_at_samples() {
        use super::super::harmonics::{LANES, harmonics};
        let mut random = StdRng::seed_from_u64(6);
        let mut proved = [0; 2];
        for _ in 0..400 {
            let mut expansion =
                affine(&(Matrix3::identity() + Matrix3::from_fn(|_, _| random.random_range(-0.6..0.6))));
            let spread = random.random_range(0.0..0.12);
            for rows in expansion.chunks_mut(TERMS) {
                for degree in 2..=ORDER {
                    let decay = spread / (degree * degree) as f64;
                    rows[terms_of(degree)]
                        .iter_mut()
                        .for_each(|a| *a = decay * random.random_range(-1.0..1.0));
                }
            }
            let Some(regular) = test_cell(&expansion, 0.0).regular else {
                proved[0] += 1;
                continue;
            };
            proved[1] += 1;
            let value = |x: &Vector| -> Vector {
                let mut terms = [[0.0; LANES]; TERMS];
                harmonics(&[0, 1, 2].map(|k| [x[k]; LANES]), &mut terms);
                let sum = |row: &[f64]| row.iter().zip(&terms).map(|(a, t)| a * t[0]).sum();
                Vector::from_fn(|i, _| sum(&expansion[i * TERMS..][..TERMS]))
            };
            for corner in 0..27 {
                let x = Vector::from_fn(|k, _| HALF_SIDE * ((corner / 3usize.pow(k as u32) % 3) as f64 - 1.0));
                let h = 1e-5;
                let columns =
                    [0, 1, 2].map(|k| (value(&(x + Vector::ith(k, h))) - value(&(x - Vector::ith(k, h)))) / (2.0 * h));
                let j = Matrix3::from_columns(&columns);
                assert!(j.determinant().abs() >= regular.det - 1e-8);
                assert!(j.singular_values().min() >= regular.sigma_min - 1e-8);
            }
        }
        assert!(proved[0] > 20 && proved[1] > 20, "{proved:?}");
    }
}

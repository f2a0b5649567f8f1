//! Real solid harmonics, and potentials expanded in them.
//!
//! `R_nm` is the harmonic polynomial of degree `n` in Schmidt's normalisation, in which the addition theorem reads
//! `Σ_m R_nm(x) R_nm(y) = |x|ⁿ |y|ⁿ P_n(cos ∠xy)`. Then
//!
//! ```text
//! 1 / |x − Q| = Σ_nm R_nm(x) R_nm(Q / |Q|²) / |Q|        for |x| < |Q|,
//! Σ_m ∇R_nm ∇R_nmᵀ = |x|²ⁿ⁻² (n² e eᵀ + ½ n (n + 1) (I − e eᵀ)),   e = x / |x|.
//! ```
//!
//! The second line bounds a sum of gradients: `‖Σ_m a_m ∇R_nmᵀ‖ ≤ n |x|ⁿ⁻¹ ‖a‖`, for vectors `a_m` as the columns of a
//! matrix `a` and spectral norms. Degree 0 is omitted everywhere, because its derivative is zero.

use std::f64::consts::PI;

use crate::Vector;

/// Highest degree of an expansion.
pub(super) const ORDER: usize = 8;
/// Harmonics of degrees 1 to [`ORDER`].
pub(super) const TERMS: usize = ORDER * (ORDER + 2);
/// Points per batch, whose harmonics are evaluated together.
pub(super) const LANES: usize = 8;

/// One coordinate of all points of a batch.
pub(super) type Batch = [f64; LANES];

/// Range of the terms of degree `n`: `m = 0`, then cosine and sine for every further `m`.
pub(super) const fn terms_of(n: usize) -> std::ops::Range<usize> {
    n * n - 1..(n + 1) * (n + 1) - 1
}

/// Values of all harmonics at a batch of points.
#[inline(always)]
pub(super) fn harmonics([x, y, z]: &[Batch; 3], out: &mut [Batch; TERMS]) {
    let squared: Batch = std::array::from_fn(|l| x[l] * x[l] + y[l] * y[l] + z[l] * z[l]);
    // First those with the highest m of their degree, then those of higher degree for each m.
    out[1] = *x;
    out[2] = *y;
    for m in 2..=ORDER {
        let scale = ((2 * m - 1) as f64 / (2 * m) as f64).sqrt();
        let [cosine, sine] = [0, 1].map(|part| out[terms_of(m - 1).end - 2 + part]);
        let last = terms_of(m).end - 1;
        for l in 0..LANES {
            out[last - 1][l] = scale * (x[l] * cosine[l] - y[l] * sine[l]);
            out[last][l] = scale * (x[l] * sine[l] + y[l] * cosine[l]);
        }
    }
    for n in 1..=ORDER {
        for m in 0..n {
            let ahead = (2 * n - 1) as f64 / ((n * n - m * m) as f64).sqrt();
            let behind = if n - 1 > m {
                (((n - 1) * (n - 1) - m * m) as f64 / (n * n - m * m) as f64).sqrt()
            } else {
                0.0
            };
            for part in (2 * m).saturating_sub(1)..=2 * m {
                let before = match n {
                    1 => [1.0; LANES],
                    _ => out[terms_of(n - 1).start + part],
                };
                let two_before = match n {
                    1 => [0.0; LANES],
                    2 => [1.0; LANES],
                    _ if n - 1 > m => out[terms_of(n - 2).start + part],
                    _ => [0.0; LANES],
                };
                let value = &mut out[terms_of(n).start + part];
                for l in 0..LANES {
                    value[l] = ahead * z[l] * before[l] - behind * squared[l] * two_before[l];
                }
            }
        }
    }
}

/// The matrix `T`, stored by columns, that expands a polynomial about another centre:
/// `R_k(offset + scale x) = const + Σ_j T[k TERMS + j] R_j(x)`.
///
/// By orthogonality: the mean of `R_j²` over the unit sphere is `1 / (2n + 1)`. The quadrature is exact for polynomials
/// of degree `2 ORDER`, so that only rounding errors remain.
pub(super) fn translation(offset: &Vector, scale: f64) -> Vec<f64> {
    let mut matrix = vec![0.0; TERMS * TERMS];
    for (point, weight) in sphere_rule(2 * ORDER) {
        let moved = offset + point * scale;
        let values = [point, moved].map(|p| {
            let mut out = [[0.0; LANES]; TERMS];
            harmonics(&[[p.x; LANES], [p.y; LANES], [p.z; LANES]], &mut out);
            out.map(|lanes| lanes[0])
        });
        for n in 1..=ORDER {
            for j in terms_of(n) {
                let factor = weight * (2 * n + 1) as f64 * values[0][j];
                // A polynomial of lower degree has no part of a higher one.
                for k in terms_of(n).start..TERMS {
                    matrix[k * TERMS + j] += factor * values[1][k];
                }
            }
        }
    }
    matrix
}

/// Points on the unit sphere and weights with sum 1: a quadrature that is exact for means of polynomials up to this
/// degree.
fn sphere_rule(degree: usize) -> Vec<(Vector, f64)> {
    let around = degree + 1;
    let mut rule = Vec::new();
    for (z, weight) in gauss_legendre(degree / 2 + 1) {
        let radius = (1.0 - z * z).sqrt();
        for step in 0..around {
            let (sine, cosine) = (2.0 * PI * step as f64 / around as f64).sin_cos();
            rule.push((Vector::new(radius * cosine, radius * sine, z), weight / around as f64));
        }
    }
    rule
}

/// Nodes on [−1, 1] and weights that add up to 1, by Newton's method.
fn gauss_legendre(count: usize) -> Vec<(f64, f64)> {
    let node = |i: usize| {
        let mut x = (PI * (i as f64 + 0.75) / (count as f64 + 0.5)).cos();
        let mut slope = 1.0;
        // Convergence is quadratic, and the start has two correct digits.
        for _ in 0..8 {
            let (mut value, mut before) = (1.0, 0.0);
            for n in 1..=count {
                let n = n as f64;
                (value, before) = (((2.0 * n - 1.0) * x * value - (n - 1.0) * before) / n, value);
            }
            slope = count as f64 * (x * value - before) / (x * x - 1.0);
            x -= value / slope;
        }
        (x, 1.0 / ((1.0 - x * x) * slope * slope))
    };
    (0..count).map(node).collect()
}

#[cfg(test)]
mod tests {
    use rand::{Rng, SeedableRng, rngs::StdRng};

    use super::*;

    fn values(p: &Vector) -> [f64; TERMS] {
        let mut out = [[0.0; LANES]; TERMS];
        harmonics(&[[p.x; LANES], [p.y; LANES], [p.z; LANES]], &mut out);
        out.map(|lanes| lanes[LANES - 1])
    }

    fn vector(rng: &mut StdRng) -> Vector {
        Vector::from_fn(|_, _| rng.random_range(-0.7..0.7))
    }

    /// Both sides are sums of at most 17 terms below 1.3⁸ < 10.
    #[test]
    fn harmonics_obey_the_addition_theorem() {
        let mut rng = StdRng::seed_from_u64(3);
        for _ in 0..100 {
            let (x, y) = (vector(&mut rng), vector(&mut rng));
            let (a, b) = (values(&x), values(&y));
            let lengths = x.norm() * y.norm();
            let cosine = x.dot(&y) / lengths;
            let (mut legendre, mut before) = (1.0, 0.0);
            for n in 1..=ORDER {
                let k = n as f64;
                (legendre, before) = (((2.0 * k - 1.0) * cosine * legendre - (k - 1.0) * before) / k, legendre);
                let sum: f64 = terms_of(n).map(|k| a[k] * b[k]).sum();
                assert!((sum - lengths.powi(n as i32) * legendre).abs() < 1e-13, "degree {n}");
            }
        }
    }

    #[test]
    fn translation_expands_the_same_polynomials() {
        let mut rng = StdRng::seed_from_u64(5);
        let (offset, scale) = (Vector::new(0.3, -0.28, 0.29), 0.5);
        let matrix = translation(&offset, scale);
        let constant = values(&offset);
        for _ in 0..20 {
            let x = vector(&mut rng);
            let (here, there) = (values(&x), values(&(offset + x * scale)));
            for k in 0..TERMS {
                let sum: f64 = (0..TERMS).map(|j| matrix[k * TERMS + j] * here[j]).sum();
                assert!((constant[k] + sum - there[k]).abs() < 1e-13);
            }
        }
    }
}

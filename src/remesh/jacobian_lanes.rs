//! The foldover-free energy of several Jacobians at once, one in each lane of a vector: most of the time of a repair goes
//! here.

use super::foldover::LAMBDA;
use crate::simd::Simd;

/// Lanes that arrays have room for: as many as the widest vectors.
pub(super) const LANES: usize = 8;
/// For each entry of a 3 × 3 matrix, by columns, its values in all lanes.
pub(super) type Entries = [[f64; LANES]; 9];

/// The energy of Jacobians of one lane each.
pub(super) struct LaneEnergy<V> {
    pub energy: V,
    pub determinant: V,
    /// The derivative of the energy with respect to the entries of the Jacobian, by columns.
    pub by_jacobian: [V; 9],
}

/// `weight` times the energy of the Jacobians `j`, by columns.
#[inline(always)]
pub(super) fn lane_energy<V: Simd>(token: V::Token, j: &[V; 9], weight: V, epsilon: f64) -> LaneEnergy<V> {
    let [zero, half, one] = [V::splat(token, 0.0), V::splat(token, 0.5), V::splat(token, 1.0)];
    let epsilon_squared = V::splat(token, epsilon * epsilon);
    // By columns: b × c, c × a, a × b.
    let mut cofactors = [zero; 9];
    for k in 0..3 {
        let (b, c) = (3 * ((k + 1) % 3), 3 * ((k + 2) % 3));
        for r in 0..3 {
            let (s, t) = ((r + 1) % 3, (r + 2) % 3);
            cofactors[3 * k + r] = j[b + s] * j[c + t] - j[b + t] * j[c + s];
        }
    }
    let det = j[0] * cofactors[0] + j[1] * cofactors[1] + j[2] * cofactors[2];
    let mut norm = j[0] * j[0];
    for entry in &j[1..] {
        norm = entry.mul_add(*entry, norm);
    }
    let root = (det * det + epsilon_squared).sqrt();
    // The sum would cancel where the determinant is negative.
    let small = half * epsilon_squared / (root - det);
    let chi = det.if_less(zero, small, half * (det + root));
    let inverse = one / chi;
    let slope = chi / root;
    let third = inverse_cube_root::<V>(token, chi);
    let shape = third * third;
    let size = (det * det + one) * inverse;
    let of_shape = V::splat(token, -2.0 / 3.0) * norm * shape * slope;
    let of_size = (det + det - size * slope) * V::splat(token, LAMBDA);
    let by_det = weight * (of_shape + of_size) * inverse;
    let by_norm = (weight + weight) * shape;
    let mut by_jacobian = cofactors;
    for (slope, entry) in by_jacobian.iter_mut().zip(j) {
        *slope = *entry * by_norm + *slope * by_det;
    }
    LaneEnergy {
        energy: weight * (norm * shape + V::splat(token, LAMBDA) * size),
        determinant: det,
        by_jacobian,
    }
}

/// `x^(-1/3)` of positive values, to some 1e-15: a third of the exponent, and two steps of fourth order.
#[inline(always)]
fn inverse_cube_root<V: Simd>(token: V::Token, x: V) -> V {
    /// Makes the first error at most 3.4 %.
    const OFFSET: u64 = 0x553e_f0ef_d7b0_9cc7;
    let mut values = [0.0; LANES];
    x.store(&mut values);
    for value in &mut values[..V::WIDTH] {
        *value = if (f64::MIN_POSITIVE..1e300).contains(value) {
            f64::from_bits(OFFSET - value.to_bits() / 3)
        } else {
            value.cbrt().recip()
        };
    }
    let mut y = V::load(token, &values);
    for _ in 0..2 {
        let error = V::splat(token, 1.0) - x * y * y * y;
        let third = error.mul_add(V::splat(token, 14.0 / 81.0), V::splat(token, 2.0 / 9.0));
        let series = error.mul_add(third, V::splat(token, 1.0 / 3.0));
        y = (y * error).mul_add(series, y);
    }
    y
}

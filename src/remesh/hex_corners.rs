//! The foldover-free energy of the eight corners of hexahedra, in vector instructions: most of the time of a repair of
//! hexahedra goes here.

use super::foldover::{EnergyValue, LAMBDA};
use super::quality::{HEX_AXES, HEX_CORNERS, is_positive};
use crate::simd::{Computation, Simd};
use crate::{Matrix3, Point, Vector};

/// For each entry of a 3 × 3 matrix, by columns, its values at the eight corners.
type Entries = [[f64; 8]; 9];

/// The energy of the corners of one hexahedron, and its gradient.
pub(super) struct HexCorners<'a> {
    pub nodes: &'a [Point; 8],
    /// One over the edge lengths of the reference box.
    pub scale: &'a [f64; 3],
    pub weight: f64,
    pub epsilon: f64,
    /// Gets the gradient with respect to the nodes added.
    pub gradient: &'a mut [Vector],
    pub value: &'a mut EnergyValue,
}

impl Computation for HexCorners<'_> {
    type Output = ();

    #[inline(always)]
    fn run<V: Simd>(self, token: V::Token) {
        let mut jacobians: Entries = [[0.0; 8]; 9];
        for (i, (c, axes)) in HEX_CORNERS.iter().zip(&HEX_AXES).enumerate() {
            let from = &self.nodes[c[0]];
            for k in 0..3 {
                let (to, scale) = (&self.nodes[c[k + 1]], self.scale[axes[k]]);
                for r in 0..3 {
                    jacobians[3 * k + r][i] = (to[r] - from[r]) * scale;
                }
            }
        }
        let (mut determinants, mut energies) = ([0.0; 8], [0.0; 8]);
        let mut slopes: Entries = [[0.0; 8]; 9];
        let splat = [V::splat(token, 0.0), V::splat(token, 0.5), V::splat(token, 1.0)];
        let [zero, half, one] = splat;
        let epsilon_squared = V::splat(token, self.epsilon * self.epsilon);
        let weight = V::splat(token, self.weight);
        for first in (0..8).step_by(V::WIDTH) {
            let mut j = [zero; 9];
            for (entry, values) in j.iter_mut().zip(&jacobians) {
                *entry = V::load(token, &values[first..]);
            }
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
            for (e, values) in slopes.iter_mut().enumerate() {
                (j[e] * by_norm + cofactors[e] * by_det).store(&mut values[first..]);
            }
            det.store(&mut determinants[first..]);
            let energy = weight * (norm * shape + V::splat(token, LAMBDA) * size);
            energy.store(&mut energies[first..]);
        }
        for (i, (c, axes)) in HEX_CORNERS.iter().zip(&HEX_AXES).enumerate() {
            self.value.energy += energies[i];
            self.value.inverted += usize::from(!is_positive(determinants[i]));
            self.value.add_determinant(determinants[i]);
            for k in 0..3 {
                let scale = self.scale[axes[k]];
                for r in 0..3 {
                    let by_edge = slopes[3 * k + r][i] * scale;
                    self.gradient[c[k + 1]][r] += by_edge;
                    self.gradient[c[0]][r] -= by_edge;
                }
            }
        }
    }
}

/// `x^(-1/3)` of positive values, to some 1e-15: a third of the exponent, and two steps of fourth order.
#[inline(always)]
fn inverse_cube_root<V: Simd>(token: V::Token, x: V) -> V {
    /// Makes the first error at most 3.4 %.
    const OFFSET: u64 = 0x553e_f0ef_d7b0_9cc7;
    let mut values = [0.0; 8];
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

/// What corners of hexahedra cost whose scaled Jacobian is low: `weight` times the square of what it lacks to `bound`.
#[derive(Debug, Clone, Copy)]
pub(crate) struct CornerPenalty {
    pub bound: f64,
    pub weight: f64,
}

impl CornerPenalty {
    /// What the scaled Jacobian of a corner lacks, and the derivative of the scaled Jacobian with respect to the edges, or
    /// to multiples of them; `None` for nothing.
    #[inline]
    pub fn shortfall(&self, edges: &Matrix3) -> Option<(f64, Matrix3)> {
        let [a, b, c] = [0, 1, 2].map(|k| edges.column(k).into_owned());
        let cofactors = Matrix3::from_columns(&[b.cross(&c), c.cross(&a), a.cross(&b)]);
        let squares = [a, b, c].map(|edge| edge.norm_squared());
        let product = (squares[0] * squares[1] * squares[2]).sqrt();
        let scaled = a.dot(&cofactors.column(0)) / product;
        // Not where an edge has no length, whose scaled Jacobian is NaN.
        let is_low = scaled < self.bound;
        is_low.then(|| {
            let along = Matrix3::from_columns(&[0, 1, 2].map(|k| edges.column(k) * (scaled / squares[k])));
            (self.bound - scaled, cofactors / product - along)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simd::Instructions;

    #[test]
    fn all_instructions_give_the_same_energy_and_gradient() {
        let corner = |k: usize| Point::new((k >> 1 & 1 ^ k & 1) as f64, (k >> 1 & 1) as f64, (k >> 2) as f64);
        let mut nodes: [Point; 8] = std::array::from_fn(corner);
        nodes[6] = Point::new(-0.2, 0.1, 0.3);
        nodes[1].y += 0.1;
        let evaluate = |instructions: Instructions, epsilon: f64| {
            let (mut value, mut gradient) = (EnergyValue::NONE, [Vector::zeros(); 8]);
            instructions.run(HexCorners {
                nodes: &nodes,
                scale: &[1.1, 0.7, 2.3],
                weight: 0.3,
                epsilon,
                gradient: &mut gradient,
                value: &mut value,
            });
            (value, gradient)
        };
        for epsilon in [1.0, 1e-3, 1e-9] {
            let (expected, slopes) = evaluate(Instructions::PORTABLE, epsilon);
            // As the energy of one Jacobian after the other.
            let mut scalar = EnergyValue::NONE;
            for (c, axes) in HEX_CORNERS.iter().zip(&HEX_AXES) {
                let edge = |k: usize| (nodes[c[k + 1]] - nodes[c[0]]) * [1.1, 0.7, 2.3][axes[k]];
                scalar.add(&Matrix3::from_columns(&[edge(0), edge(1), edge(2)]), 0.3, epsilon);
            }
            assert!((scalar.energy / expected.energy - 1.0).abs() < 1e-11, "{epsilon}");
            for instructions in Instructions::available() {
                let (value, gradient) = evaluate(instructions, epsilon);
                assert!((value.energy / expected.energy - 1.0).abs() < 1e-11);
                assert_eq!(value.inverted, expected.inverted);
                assert!((value.least - expected.least).abs() < 1e-13);
                let size = slopes.iter().map(|s| s.amax()).fold(0.0, f64::max);
                assert!((0..8).all(|v| (gradient[v] - slopes[v]).amax() < 1e-11 * size));
            }
        }
    }
}

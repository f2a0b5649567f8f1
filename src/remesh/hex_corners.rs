//! The foldover-free energy of the eight corners of hexahedra, one in each lane.

use super::foldover::EnergyValue;
use super::jacobian_lanes::{Entries, LANES, lane_energy};
use super::quality::{HEX_AXES, HEX_CORNERS, is_positive};
use crate::simd::{Computation, Simd};
use crate::{Matrix3, Point, Vector};

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
        let mut jacobians: Entries = [[0.0; LANES]; 9];
        for (i, (c, axes)) in HEX_CORNERS.iter().zip(&HEX_AXES).enumerate() {
            let from = &self.nodes[c[0]];
            for k in 0..3 {
                let (to, scale) = (&self.nodes[c[k + 1]], self.scale[axes[k]]);
                for r in 0..3 {
                    jacobians[3 * k + r][i] = (to[r] - from[r]) * scale;
                }
            }
        }
        let (mut determinants, mut energies) = ([0.0; LANES], [0.0; LANES]);
        let mut slopes: Entries = [[0.0; LANES]; 9];
        let weight = V::splat(token, self.weight);
        for first in (0..LANES).step_by(V::WIDTH) {
            let mut j = [weight; 9];
            for (entry, values) in j.iter_mut().zip(&jacobians) {
                *entry = V::load(token, &values[first..]);
            }
            let found = lane_energy(token, &j, weight, self.epsilon);
            for (slope, values) in found.by_jacobian.into_iter().zip(&mut slopes) {
                slope.store(&mut values[first..]);
            }
            found.determinant.store(&mut determinants[first..]);
            found.energy.store(&mut energies[first..]);
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

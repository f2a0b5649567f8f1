//! The foldover-free energy of tetrahedra, several at once.

use super::foldover::{EnergyValue, edges};
use super::jacobian_lanes::{Entries, LANES, lane_energy};
use super::quality::is_positive;
use crate::simd::{Computation, Simd};
use crate::{Matrix3, Point, Vector};

/// Tetrahedra with their reference shapes and weights, in groups of [`LANES`].
#[derive(Debug)]
pub(super) struct TetLanes {
    pub corners: Vec<[u32; 4]>,
    groups: Vec<TetGroup>,
}

/// The inverse matrices of reference edges, and weights; 0 for lanes without a tetrahedron.
#[derive(Debug)]
struct TetGroup {
    rest: Entries,
    weights: [f64; LANES],
}

impl TetLanes {
    /// `rest` are the inverse matrices of the reference edges.
    pub fn new(corners: Vec<[u32; 4]>, rest: &[Matrix3], weights: &[f64]) -> Self {
        let group = |(rest, weights): (&[Matrix3], &[f64])| {
            let mut group = TetGroup {
                rest: [[0.0; LANES]; 9],
                weights: [0.0; LANES],
            };
            for (lane, (rest, weight)) in rest.iter().zip(weights).enumerate() {
                for (entry, values) in rest.iter().zip(&mut group.rest) {
                    values[lane] = *entry;
                }
                group.weights[lane] = *weight;
            }
            group
        };
        let groups = rest.chunks(LANES).zip(weights.chunks(LANES)).map(group);
        Self {
            groups: groups.collect(),
            corners,
        }
    }

    /// The inverse matrix of a tetrahedron's reference edges, and its weight.
    pub fn reference(&self, tet: usize) -> (Matrix3, f64) {
        let (group, lane) = (&self.groups[tet / LANES], tet % LANES);
        (
            Matrix3::from_iterator(group.rest.iter().map(|values| values[lane])),
            group.weights[lane],
        )
    }

    pub fn jacobian(&self, tet: usize, x: &[Point]) -> Matrix3 {
        edges(self.corners[tet].map(|v| x[v as usize])) * self.reference(tet).0
    }
}

/// The energy of tetrahedra from `first` on, a multiple of [`LANES`], and its gradient with respect to their corners, which
/// `parts` get, four for each.
pub(super) struct TetEnergies<'a> {
    pub tets: &'a TetLanes,
    pub first: usize,
    pub x: &'a [Point],
    pub epsilon: f64,
    pub parts: &'a mut [Vector],
}

impl Computation for TetEnergies<'_> {
    type Output = EnergyValue;

    #[inline(always)]
    fn run<V: Simd>(self, token: V::Token) -> EnergyValue {
        let mut value = EnergyValue::NONE;
        let zero = V::splat(token, 0.0);
        let mut edges: Entries = [[0.0; LANES]; 9];
        let mut by_edges: Entries = [[0.0; LANES]; 9];
        let (mut determinants, mut energies) = ([0.0; LANES], [0.0; LANES]);
        let groups = &self.tets.groups[self.first / LANES..];
        let corners = self.tets.corners[self.first..].chunks(LANES);
        for ((parts, corners), group) in self.parts.chunks_mut(4 * LANES).zip(corners).zip(groups) {
            for (lane, t) in corners.iter().enumerate() {
                let [a, b, c, d] = t.map(|v| &self.x[v as usize]);
                for (k, to) in [b, c, d].into_iter().enumerate() {
                    for r in 0..3 {
                        edges[3 * k + r][lane] = to[r] - a[r];
                    }
                }
            }
            for first in (0..LANES).step_by(V::WIDTH) {
                let (mut e, mut rest) = ([zero; 9], [zero; 9]);
                for i in 0..9 {
                    e[i] = V::load(token, &edges[i][first..]);
                    rest[i] = V::load(token, &group.rest[i][first..]);
                }
                // J = E R, and ∂/∂E = ∂/∂J Rᵀ.
                let mut jacobian = [zero; 9];
                for c in 0..3 {
                    for r in 0..3 {
                        let sum = e[r] * rest[3 * c];
                        let sum = e[3 + r].mul_add(rest[3 * c + 1], sum);
                        jacobian[3 * c + r] = e[6 + r].mul_add(rest[3 * c + 2], sum);
                    }
                }
                let weight = V::load(token, &group.weights[first..]);
                let found = lane_energy(token, &jacobian, weight, self.epsilon);
                let slopes = &found.by_jacobian;
                for k in 0..3 {
                    for r in 0..3 {
                        let sum = slopes[r] * rest[k];
                        let sum = slopes[3 + r].mul_add(rest[3 + k], sum);
                        let sum = slopes[6 + r].mul_add(rest[6 + k], sum);
                        sum.store(&mut by_edges[3 * k + r][first..]);
                    }
                }
                found.energy.store(&mut energies[first..]);
                found.determinant.store(&mut determinants[first..]);
            }
            for (lane, part) in parts.chunks_exact_mut(4).enumerate() {
                value.energy += energies[lane];
                value.inverted += usize::from(!is_positive(determinants[lane]));
                value.add_determinant(determinants[lane]);
                let slope = |k: usize| Vector::from_fn(|r, _| by_edges[3 * k + r][lane]);
                let [b, c, d] = [slope(0), slope(1), slope(2)];
                part[0] = -(b + c + d);
                (part[1], part[2], part[3]) = (b, c, d);
            }
        }
        value.inverted_cells = value.inverted;
        value
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simd::Instructions;

    #[test]
    fn all_instructions_give_the_energies_and_gradients_of_one_tetrahedron_after_the_other() {
        // Eleven tetrahedra, some inverted: a group and a part of one.
        let mut x: Vec<Point> = Vec::new();
        for k in 0..14 {
            let at = f64::from(k);
            x.push(Point::new((1.3 * at).sin(), (0.7 * at).cos(), (2.1 * at).sin()));
        }
        let corners: Vec<[u32; 4]> = (0..11).map(|k| [k, k + 1, k + 2, k + 3]).collect();
        let rest = |k: usize| Matrix3::new(1.0, 0.2, 0.1 * k as f64, 0.0, 0.9, 0.3, -0.1, 0.0, 1.2);
        let rest: Vec<Matrix3> = (0..11).map(rest).collect();
        let weights: Vec<f64> = (0..11).map(|k| 0.1 + f64::from(k)).collect();
        let tets = TetLanes::new(corners.clone(), &rest, &weights);
        for epsilon in [1.0, 1e-3, 1e-9] {
            let (mut expected, mut slopes) = (EnergyValue::NONE, Vec::new());
            for (k, t) in corners.iter().enumerate() {
                let jacobian = edges(t.map(|v| x[v as usize])) * rest[k];
                assert!((tets.jacobian(k, &x) - jacobian).norm() < 1e-15);
                let by_edges = expected.add(&jacobian, weights[k], epsilon) * rest[k].transpose();
                let columns = [0, 1, 2].map(|k| by_edges.column(k).into_owned());
                slopes.push(-(columns[0] + columns[1] + columns[2]));
                slopes.extend(columns);
            }
            assert!((1..11).contains(&expected.inverted));
            for instructions in Instructions::available() {
                let mut parts = vec![Vector::zeros(); 44];
                let value = instructions.run(TetEnergies {
                    tets: &tets,
                    first: 0,
                    x: &x,
                    epsilon,
                    parts: &mut parts,
                });
                assert!((value.energy / expected.energy - 1.0).abs() < 1e-11, "{epsilon}");
                assert_eq!(
                    (value.inverted, value.inverted_cells),
                    (expected.inverted, expected.inverted)
                );
                assert!((value.least - expected.least).abs() < 1e-13);
                let size = slopes.iter().map(|s| s.amax()).fold(0.0, f64::max);
                assert!((0..44).all(|v| (parts[v] - slopes[v]).amax() < 1e-11 * size));
            }
        }
    }
}

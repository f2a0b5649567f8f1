//! Descent in which some coordinates of the nodes are fixed, and others equal to one another: the nodes of a plane across
//! an axis.
//!
//! Positions stay in a linear subspace if every direction lies in it, so that gradients are projected onto it: of equal
//! coordinates each gets the mean. That is the descent with one unknown for each set, scaled by the root of its size.

use super::lbfgs::inverse_block;
use crate::{Matrix3, Vector};

/// Constraints on the coordinates of the free nodes, which are counted from 0.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub(crate) struct SharedCoordinates {
    /// A node and which of its coordinates may not change.
    pub fixed: Vec<(u32, usize)>,
    /// A coordinate, and nodes for which it is the same. No node is in two sets for one coordinate.
    pub equal: Vec<(usize, Vec<u32>)>,
}

impl SharedCoordinates {
    /// Constraints that keep all of these coordinates as they are.
    pub fn as_fixed(&self) -> Self {
        let all =
            |(axis, nodes): &(usize, Vec<u32>)| -> Vec<(u32, usize)> { nodes.iter().map(|&v| (v, *axis)).collect() };
        let fixed = self.equal.iter().flat_map(all).chain(self.fixed.iter().copied());
        Self {
            fixed: fixed.collect(),
            equal: vec![],
        }
    }

    /// The orthogonal projection: zero for fixed coordinates, the mean for equal ones. Equal ones are equal bit for bit
    /// afterwards.
    pub fn project(&self, vectors: &mut [Vector]) {
        for (axis, nodes) in &self.equal {
            let sum: f64 = nodes.iter().map(|&v| vectors[v as usize][*axis]).sum();
            let mean = sum / nodes.len().max(1) as f64;
            nodes.iter().for_each(|&v| vectors[v as usize][*axis] = mean);
        }
        for &(v, axis) in &self.fixed {
            vectors[v as usize][axis] = 0.0;
        }
    }

    /// Replaces the inverses of blocks at the nodes with constraints: fixed coordinates have zero, equal ones one over
    /// their mean, uncoupled from the others.
    pub fn restrict(&self, blocks: &[Matrix3], inverse: &mut [Matrix3]) {
        let fixed = self.fixed.iter().map(|&(v, axis)| (v, axis, 0.0));
        let equal = self.equal.iter().flat_map(|(axis, nodes)| {
            let sum: f64 = nodes.iter().map(|&v| blocks[v as usize][(*axis, *axis)]).sum();
            let mean = sum / nodes.len().max(1) as f64;
            let entry = if mean > 0.0 && mean.is_finite() {
                mean.recip()
            } else {
                0.0
            };
            nodes.iter().map(move |&v| (v, *axis, entry))
        });
        let mut constraints: Vec<(u32, usize, f64)> = fixed.chain(equal).collect();
        constraints.sort_unstable_by_key(|&(v, axis, _)| (v, axis));
        for at_node in constraints.chunk_by(|a, b| a.0 == b.0) {
            let v = at_node[0].0 as usize;
            let mut block = blocks[v];
            let trace = block.trace();
            for &(_, axis, _) in at_node {
                block.row_mut(axis).fill(0.0);
                block.column_mut(axis).fill(0.0);
                block[(axis, axis)] = trace;
            }
            let mut inverse_here = inverse_block(&block);
            at_node
                .iter()
                .for_each(|&(_, axis, entry)| inverse_here[(axis, axis)] = entry);
            inverse[v] = inverse_here;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn projection_is_orthogonal_and_equal_coordinates_are_equal_bit_for_bit() {
        let shared = SharedCoordinates {
            fixed: vec![(2, 1), (0, 2)],
            equal: vec![(0, vec![0, 1, 3]), (1, vec![1, 3])],
        };
        let vectors: Vec<Vector> = (0..4)
            .map(|k| Vector::new(0.1, 0.7, -0.3) * f64::from(k).exp())
            .collect();
        let mut projected = vectors.clone();
        shared.project(&mut projected);
        let mut again = projected.clone();
        shared.project(&mut again);
        assert!(projected[0].x.to_bits() == projected[3].x.to_bits() && projected[1].y == projected[3].y);
        assert!(projected[2].y == 0.0 && projected[0].z == 0.0 && projected[2].x == vectors[2].x);
        let product: f64 = (vectors.iter().zip(&projected)).map(|(a, b)| (a - b).dot(b)).sum();
        assert!(product.abs() < 1e-12 && (again[1] - projected[1]).norm() < 1e-15);
    }

    #[test]
    fn blocks_have_no_part_in_fixed_coordinates() {
        let shared = SharedCoordinates {
            fixed: vec![(0, 1)],
            equal: vec![(0, vec![0, 1])],
        };
        let block = Matrix3::new(2.0, 0.5, 0.1, 0.5, 3.0, 0.2, 0.1, 0.2, 4.0);
        let mut inverse = [Matrix3::zeros(); 2];
        shared.restrict(&[block, block * 3.0], &mut inverse);
        assert_eq!(inverse[0][(1, 1)], 0.0);
        assert_eq!(inverse[0][(0, 0)], 0.25);
        assert_eq!(inverse[1][(0, 0)], 0.25);
        assert!((inverse[0][(2, 2)] - 0.25).abs() < 1e-9);
        assert_eq!(inverse[1][(0, 2)], 0.0);
    }
}

//! Sums of the Laplace kernel to a given accuracy in time linear in the number of points.
//!
//! An adaptive kernel-independent fast multipole method over two sets of points: an octree (`tree`), the four kinds
//! of interaction (`lists`), expansions by equivalent sources on cubes, compressed by a singular value decomposition
//! (`operators`), the sweeps over them (`expansions`), and the sums at the targets (`evaluate`).
//!
//! # References
//!
//! Ying, Biros, Zorin, *A kernel-independent adaptive fast multipole algorithm in two and three dimensions*, J. Comput.
//! Phys. 196 (2004); Carrier, Greengard, Rokhlin, *A fast adaptive multipole algorithm for particle simulations*, SIAM
//! J. Sci. Stat. Comput. 9 (1988), for the lists.

use std::collections::BTreeSet;
use std::sync::Arc;

use rayon::prelude::*;

use super::direct::{self, Instructions, MOST_TRIPLED, PowerOfTwoScale, is_minute};
use super::{KernelError, require_length};
use crate::Point;

mod evaluate;
mod expansions;
mod lists;
mod operators;
mod single;
mod tree;
mod weights;

use expansions::Pass;
use lists::{Lists, Thresholds};
use operators::{Operators, RESOLUTIONS, resolution_for};
use tree::{Capacity, NONE, Ordered, Tree};
use weights::PassWeights;

/// Sources and targets sorted into a tree, for any number of sums over them.
#[derive(Debug, Clone)]
pub struct Fmm {
    geometry: Arc<Geometry>,
    resolution: usize,
}

/// What depends on the points alone.
#[derive(Debug)]
struct Geometry {
    tree: Tree,
    lists: Lists,
    sources: Vec<Point>,
    targets: Vec<Point>,
    /// Factor by which coordinates were multiplied.
    up: f64,
    /// Place of each target in the order of the tree; [`NONE`] for those that are not in it.
    places: Vec<u32>,
    /// Targets that are summed term by term: those out of range of the tree.
    outside: Vec<u32>,
    /// Whether some source has a coordinate that is not finite.
    has_bad_source: bool,
}

/// Largest scaled coordinate of a target in the tree; targets farther away are summed term by term.
const FAR: f64 = (1u64 << 30) as f64;

/// Most columns of a pass, to bound the memory of the expansions.
const PASS_COLUMNS: usize = 48;

impl Fmm {
    /// Sorts the points; sums will have about the relative error `accuracy` in the Euclidean norm over all targets.
    ///
    /// `accuracy` is clamped to the range from `1e-10` to `1e-2`; NaN counts as `1e-10`.
    ///
    /// # Errors
    ///
    /// [`KernelError::TooMany`] for more than 2³² − 2 points of a kind.
    pub fn new(sources: &[Point], targets: &[Point], accuracy: f64) -> Result<Self, KernelError> {
        let resolution = resolution_for(accuracy);
        Self::with_capacity(sources, targets, resolution, capacity_for(resolution), THRESHOLDS)
    }

    /// The same points at another accuracy, as [`Self::new`] takes it; shares the tree.
    pub fn with_accuracy(&self, accuracy: f64) -> Self {
        Self {
            geometry: self.geometry.clone(),
            resolution: resolution_for(accuracy),
        }
    }

    /// `Σ_j w_j / (4π |x − y_j|)` for each target `x` and each column of `weights` (`sources × columns`, row-major):
    /// `targets × columns`, row-major.
    ///
    /// Infinite or NaN where a target is not finite itself or coincides with a source. The same to the last bit for any
    /// number of threads.
    ///
    /// # Errors
    ///
    /// [`KernelError::LengthMismatch`] unless `weights` has `sources × columns` entries.
    pub fn potential(&self, weights: &[f64], columns: usize) -> Result<Vec<f64>, KernelError> {
        Ok(self.sums(weights, columns, false)?.0)
    }

    /// Potential as [`Self::potential`] has it, and its gradient: `targets × columns × 3`, row-major.
    ///
    /// The gradient's relative error is up to ten times that of the potential.
    ///
    /// # Errors
    ///
    /// As [`Self::potential`].
    pub fn potential_and_gradient(&self, weights: &[f64], columns: usize) -> Result<(Vec<f64>, Vec<f64>), KernelError> {
        self.sums(weights, columns, true)
    }

    fn with_capacity(
        sources: &[Point],
        targets: &[Point],
        resolution: usize,
        capacity: Capacity,
        thresholds: Thresholds,
    ) -> Result<Self, KernelError> {
        for (what, found) in [("sources", sources.len()), ("targets", targets.len())] {
            if found >= NONE as usize {
                return Err(KernelError::TooMany { what, found });
            }
        }
        let scale = PowerOfTwoScale::of(sources);
        let has_bad_source = !sources.iter().all(is_finite);
        let has_minute = sources.iter().any(|p| is_minute(*p * scale.up));
        let in_tree = |p: &Point| {
            let scaled = *p * scale.up;
            scaled.iter().all(|c| c.abs() <= FAR) && !(has_minute && is_minute(scaled))
        };
        // Sums need no tree where a source is not finite (all are NaN), nor where there are no sources (all are zero).
        let has_tree = !has_bad_source && !sources.is_empty();
        let (inside, outside): (Vec<u32>, Vec<u32>) =
            (0..targets.len() as u32).partition(|&t| has_tree && in_tree(&targets[t as usize]));
        let source_indices = 0..if has_tree { sources.len() as u32 } else { 0 };
        let tree = Tree::new(
            ordered(sources, source_indices.collect(), scale.up),
            ordered(targets, inside, scale.up),
            capacity,
        );
        let mut places = vec![NONE; targets.len()];
        for (place, &target) in tree.targets.original.iter().enumerate() {
            places[target as usize] = place as u32;
        }
        let lists = Lists::new(&tree, thresholds);
        Ok(Self {
            geometry: Arc::new(Geometry {
                tree,
                lists,
                sources: sources.to_vec(),
                targets: targets.to_vec(),
                up: scale.up,
                places,
                outside,
                has_bad_source,
            }),
            resolution,
        })
    }

    fn sums(&self, weights: &[f64], columns: usize, with_gradient: bool) -> Result<(Vec<f64>, Vec<f64>), KernelError> {
        let geometry = &*self.geometry;
        let entries = geometry.sources.len().saturating_mul(columns);
        require_length("weights of sources", weights.len(), entries)?;
        let rows = geometry.places.len() * columns;
        let empty = if geometry.has_bad_source { f64::NAN } else { 0.0 };
        let mut potentials = vec![empty; rows];
        let mut gradients = vec![empty; if with_gradient { 3 * rows } else { 0 }];
        if geometry.has_bad_source || geometry.sources.is_empty() || rows == 0 {
            return Ok((potentials, gradients));
        }
        let operators = Operators::of(self.resolution);
        let in_rows = columns > MOST_TRIPLED && !with_gradient;
        let mut failed = BTreeSet::new();
        for first in (0..columns).step_by(PASS_COLUMNS) {
            let part = first..columns.min(first + PASS_COLUMNS);
            let weights = PassWeights::new(&geometry.tree.sources, weights, columns, part, in_rows);
            let pass = Pass {
                tree: &geometry.tree,
                lists: &geometry.lists,
                operators: &operators,
                instructions: Instructions::detect(),
                weights: &weights,
            };
            let multipoles = pass.multipoles();
            let locals = pass.locals(&multipoles);
            let sums = evaluate::evaluate(&pass, &multipoles, &locals, with_gradient);
            geometry.restore_order(&sums.potentials, &weights.scale, columns, first, 1, &mut potentials);
            if with_gradient {
                geometry.restore_order(&sums.gradients, &weights.scale, columns, first, 3, &mut gradients);
            }
            failed.extend(sums.failed);
        }
        let remaining = geometry.outside.iter().copied().chain(failed);
        geometry.sum_directly(remaining, weights, columns, &mut potentials, &mut gradients)?;
        Ok((potentials, gradients))
    }
}

impl Geometry {
    /// Brings sums of `scale.len()` columns of `values` entries from the order of the tree to that of the caller, in
    /// the caller's units.
    fn restore_order(&self, sums: &[f64], scale: &[f64], columns: usize, first: usize, values: usize, out: &mut [f64]) {
        let len = scale.len() * values;
        let (up, up_again) = (self.up, if values == 1 { 1.0 } else { self.up });
        out.par_chunks_mut(columns * values)
            .zip(&self.places)
            .with_min_len(4096)
            .filter(|(_, place)| **place != NONE)
            .for_each(|(row, &place)| {
                let from = sums[place as usize * len..][..len].chunks(values);
                for ((to, from), scale) in row[first * values..].chunks_mut(values).zip(from).zip(scale) {
                    for (to, from) in to.iter_mut().zip(from) {
                        *to = from * scale * up * up_again;
                    }
                }
            });
    }

    /// Sums term by term at the targets with these indices.
    fn sum_directly(
        &self,
        indices: impl Iterator<Item = u32>,
        weights: &[f64],
        columns: usize,
        potentials: &mut [f64],
        gradients: &mut [f64],
    ) -> Result<(), KernelError> {
        let indices: Vec<usize> = indices.map(|index| index as usize).collect();
        if indices.is_empty() {
            return Ok(());
        }
        let targets: Vec<Point> = indices.iter().map(|&index| self.targets[index]).collect();
        let (own, own_gradients) =
            direct::sum_columns(&self.sources, weights, columns, &targets, !gradients.is_empty())?;
        for (&index, own) in indices.iter().zip(own.chunks(columns)) {
            potentials[index * columns..][..columns].copy_from_slice(own);
        }
        for (&index, own) in indices.iter().zip(own_gradients.chunks(3 * columns)) {
            gradients[3 * index * columns..][..3 * columns].copy_from_slice(own);
        }
        Ok(())
    }
}

fn is_finite(p: &Point) -> bool {
    p.iter().all(|c| c.is_finite())
}

fn ordered(points: &[Point], original: Vec<u32>, up: f64) -> Ordered {
    Ordered {
        positions: original
            .iter()
            .map(|&i| (points[i as usize] * up).coords.into())
            .collect(),
        original,
    }
}

/// Points of a leaf for which near sums and expansions cost about the same.
fn capacity_for(resolution: usize) -> Capacity {
    const SOURCES: [usize; RESOLUTIONS.len()] = [40, 60, 80, 120, 140, 160, 240, 300, 400, 500];
    let sources = SOURCES[resolution];
    Capacity {
        sources,
        targets: 2 * sources,
    }
}

/// A translation in single precision costs about as much as `pairs` evaluations of the kernel, and the evaluation of an
/// expansion at one point as much as `points`.
const THRESHOLDS: Thresholds = Thresholds {
    pairs: 2000,
    points: 200,
};

#[cfg(test)]
mod tests;

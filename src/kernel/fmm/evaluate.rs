//! Sums at the targets of each leaf: near sources one by one, all others through expansions.

use std::borrow::Cow;
use std::ops::Range;

use faer::{MatMut, MatRef};
use rayon::prelude::*;

use super::expansions::Pass;
use super::operators::blocks;
use super::single;
use super::tree::TreeCell;
use crate::kernel::direct::{self, BlockValues, Instructions, LANES, PackedSource, TargetBlock};

/// Sums at all targets in the order of the tree: potentials, `targets × columns`, and gradients, `× 3`.
pub(super) struct TargetSums {
    pub(super) potentials: Vec<f64>,
    pub(super) gradients: Vec<f64>,
    /// Indices, in the caller's order, of targets that coincide with no source, but whose sums are not finite: they
    /// left the range of the inner loops.
    pub(super) failed: Vec<u32>,
}

/// Leaves whose local expansions are evaluated together.
const LEAVES: usize = 16;

/// [`direct::add_potential`] or [`direct::add_gradient`]: adds `N` values at each target for three weights.
type AddSums<const N: usize> = fn(Instructions, &[PackedSource], &[TargetBlock], &mut [[BlockValues; N]]);

/// Potentials, and gradients when asked for, in the units of the tree's coordinates.
pub(super) fn evaluate(pass: &Pass, multipoles: &[f64], locals: &[f64], with_gradient: bool) -> TargetSums {
    let rows = pass.tree.targets.positions.len() * pass.columns();
    let mut sums = TargetSums {
        potentials: vec![0.0; rows],
        gradients: vec![0.0; if with_gradient { 3 * rows } else { 0 }],
        failed: Vec::new(),
    };
    let tasks = tasks(pass, &mut sums, with_gradient);
    let run = |mut task: LeafTask| {
        let weights = task.surface_weights(pass, locals);
        if !pass.weights.rows.is_empty() {
            task.run_by_rows(pass, multipoles, &weights);
        } else if with_gradient {
            task.run_by_triples(pass, &weights, |leaf, triple, weights| {
                let surfaces = weighted_surfaces(pass, leaf, weights, multipoles);
                sum_leaf(pass, leaf, triple, surfaces, direct::add_gradient)
            });
        } else {
            task.run_by_triples(pass, &weights, |leaf, triple, weights| {
                let surfaces = || weighted_surfaces(pass, leaf, weights, multipoles);
                let in_single = pass.operators.has_single_sums;
                let sums = in_single.then(|| single::sum_leaf(pass, leaf, triple, surfaces()));
                let in_double = || sum_leaf(pass, leaf, triple, surfaces(), direct::add_potential);
                sums.flatten().unwrap_or_else(in_double)
            });
        }
        task.failed(pass)
    };
    sums.failed = tasks.into_par_iter().flat_map_iter(run).collect();
    sums
}

/// Consecutive leaves, and the sums at their targets.
struct LeafTask<'a> {
    leaves: Range<usize>,
    potentials: &'a mut [f64],
    gradients: &'a mut [f64],
}

fn tasks<'a>(pass: &Pass, sums: &'a mut TargetSums, with_gradient: bool) -> Vec<LeafTask<'a>> {
    let (mut potentials, mut gradients) = (&mut sums.potentials[..], &mut sums.gradients[..]);
    let leaves = &pass.lists.leaves;
    let mut tasks = Vec::with_capacity(leaves.len().div_ceil(LEAVES));
    for first in (0..leaves.len()).step_by(LEAVES) {
        let range = first..leaves.len().min(first + LEAVES);
        let len = (leaves[range.end - 1].targets.end - leaves[first].targets.start) * pass.columns();
        let (own, rest) = potentials.split_at_mut(len);
        let (own_gradients, other_gradients) = gradients.split_at_mut(if with_gradient { 3 * len } else { 0 });
        (potentials, gradients) = (rest, other_gradients);
        tasks.push(LeafTask {
            leaves: range,
            potentials: own,
            gradients: own_gradients,
        });
    }
    tasks
}

impl LeafTask<'_> {
    /// Weights on the outer surface for each leaf, all columns of a leaf together.
    fn surface_weights(&self, pass: &Pass, locals: &[f64]) -> Vec<f64> {
        let stride = pass.stride();
        let slot = |leaf: usize| pass.lists.target_slot[pass.lists.leaves[leaf].cell as usize] as usize;
        let gathered: Vec<f64> = self
            .leaves
            .clone()
            .flat_map(|leaf| &locals[slot(leaf) * stride..][..stride])
            .copied()
            .collect();
        pass.product(pass.operators.inverse.transpose(), &gathered, 1.0)
    }

    /// `sum` gives the sums of three columns at the targets of a leaf with weights on its outer surface.
    fn run_by_triples<const N: usize>(
        &mut self,
        pass: &Pass,
        weights: &[f64],
        sum: impl Fn(usize, usize, &[f64]) -> Vec<[BlockValues; N]>,
    ) {
        let outer = pass.operators.outer.len() * pass.columns();
        let mut done = 0;
        for (leaf, weights) in self.leaves.clone().zip(weights.chunks(outer)) {
            let len = pass.lists.leaves[leaf].targets.len();
            for triple in 0..pass.weights.triples.len() {
                let sums = sum(leaf, triple, weights);
                self.store(pass, done, len, triple, &sums);
            }
            done += len;
        }
    }

    fn run_by_rows(&mut self, pass: &Pass, multipoles: &[f64], weights: &[f64]) {
        let columns = pass.columns();
        let outer = pass.operators.outer.len() * columns;
        let mut done = 0;
        for (leaf, weights) in self.leaves.clone().zip(weights.chunks(outer)) {
            let len = pass.lists.leaves[leaf].targets.len() * columns;
            let surfaces = weighted_surfaces(pass, leaf, weights, multipoles);
            add_leaf_by_rows(pass, leaf, surfaces, &mut self.potentials[done..][..len]);
            done += len;
        }
    }

    /// Targets whose sums are not finite although all weights are, and no near source coincides with them.
    fn failed(&self, pass: &Pass) -> Vec<u32> {
        if !pass.weights.are_finite {
            return Vec::new();
        }
        let columns = pass.columns();
        let targets = self.leaves.clone().flat_map(|leaf| {
            let targets = pass.lists.leaves[leaf].targets.clone();
            targets.map(move |target| (leaf, target))
        });
        let is_finite = |place: usize| {
            let potentials = &self.potentials[place * columns..][..columns];
            let gradients = self
                .gradients
                .get(3 * place * columns..3 * (place + 1) * columns)
                .unwrap_or(&[]);
            potentials.iter().chain(gradients).all(|v| v.is_finite())
        };
        let coincides = |leaf: usize, target: usize| {
            let position = pass.tree.targets.positions[target];
            let mut near = pass.lists.near.row(leaf).iter();
            near.any(|near| pass.tree.sources.positions[near.clone()].contains(&position))
        };
        targets
            .enumerate()
            .filter(|&(place, (leaf, target))| !is_finite(place) && !coincides(leaf, target))
            .map(|(_, (_, target))| pass.tree.targets.original[target])
            .collect()
    }

    fn store<const N: usize>(
        &mut self,
        pass: &Pass,
        first: usize,
        len: usize,
        triple: usize,
        sums: &[[BlockValues; N]],
    ) {
        let columns = pass.columns();
        for target in 0..len {
            let sum = &sums[target / LANES];
            for (i, column) in (3 * triple..columns.min(3 * triple + 3)).enumerate() {
                let place = (first + target) * columns + column;
                self.potentials[place] = sum[i][target % LANES];
                if N == 12 {
                    for axis in 0..3 {
                        self.gradients[3 * place + axis] = -sum[3 + 3 * i + axis][target % LANES];
                    }
                }
            }
        }
    }
}

/// Points of a surface about a cell, with weights column after column.
pub(super) struct WeightedSurface<'a> {
    pub(super) cell: &'a TreeCell,
    pub(super) points: &'a [[f64; 3]],
    pub(super) weights: Cow<'a, [f64]>,
}

/// The surfaces that stand for the sources that are not near a leaf: that of its local expansion, and those of the
/// multipole expansions of finer cells.
fn weighted_surfaces<'a>(
    pass: &'a Pass,
    leaf: usize,
    local_weights: &'a [f64],
    multipoles: &'a [f64],
) -> impl Iterator<Item = WeightedSurface<'a>> {
    let local = WeightedSurface {
        cell: &pass.tree.cells[pass.lists.leaves[leaf].cell as usize],
        points: &pass.operators.outer,
        weights: Cow::Borrowed(local_weights),
    };
    let finer = pass.lists.finer.row(leaf).iter().map(|&slot| {
        let expansion = &multipoles[slot as usize * pass.stride()..][..pass.stride()];
        WeightedSurface {
            cell: &pass.tree.cells[pass.lists.source_cells[slot as usize] as usize],
            points: &pass.operators.inner,
            weights: Cow::Owned(pass.product(pass.operators.basis.as_ref(), expansion, 1.0)),
        }
    });
    std::iter::once(local).chain(finer)
}

/// Sums of three columns at the targets of a leaf.
fn sum_leaf<'a, const N: usize>(
    pass: &Pass,
    leaf: usize,
    triple: usize,
    surfaces: impl Iterator<Item = WeightedSurface<'a>>,
    add_sums: AddSums<N>,
) -> Vec<[BlockValues; N]> {
    let targets = &pass.tree.targets.positions[pass.lists.leaves[leaf].targets.clone()];
    let near_blocks = blocks(targets);
    let mut sums = vec![[[0.0; LANES]; N]; near_blocks.len()];
    for near in pass.lists.near.row(leaf) {
        let sources = &pass.weights.triples[triple][near.clone()];
        add_sums(pass.instructions, sources, &near_blocks, &mut sums);
    }
    for surface in surfaces {
        let sources = packed(&surface, triple, pass.columns());
        let up = 1.0 / pass.tree.half_width(surface.cell);
        let unit_blocks = unit_blocks(targets, pass.tree.to_unit(surface.cell));
        let mut own = vec![[[0.0; LANES]; N]; unit_blocks.len()];
        add_sums(pass.instructions, &sources, &unit_blocks, &mut own);
        for (sums, own) in sums.iter_mut().zip(&own) {
            for (value, (sums, own)) in sums.iter_mut().zip(own).enumerate() {
                let scale = if value < 3 { up } else { up * up };
                for (sum, own) in sums.iter_mut().zip(own) {
                    *sum += scale * own;
                }
            }
        }
    }
    sums
}

/// Adds all columns at the targets of a leaf to `out`, `targets × columns`.
fn add_leaf_by_rows<'a>(
    pass: &Pass,
    leaf: usize,
    surfaces: impl Iterator<Item = WeightedSurface<'a>>,
    out: &mut [f64],
) {
    let columns = pass.columns();
    let targets = &pass.tree.targets.positions[pass.lists.leaves[leaf].targets.clone()];
    let mut out = MatMut::from_row_major_slice_mut(out, targets.len(), columns);
    let near_blocks = blocks(targets);
    for near in pass.lists.near.row(leaf) {
        let positions = &pass.tree.sources.positions[near.clone()];
        pass.add_products(
            positions,
            pass.weight_rows(near.clone()),
            &near_blocks,
            1.0,
            out.as_mut(),
        );
    }
    for surface in surfaces {
        let up = 1.0 / pass.tree.half_width(surface.cell);
        let weights = MatRef::from_column_major_slice(&surface.weights, surface.points.len(), columns);
        let unit_blocks = unit_blocks(targets, pass.tree.to_unit(surface.cell));
        pass.add_products(surface.points, weights, &unit_blocks, up, out.as_mut());
    }
}

/// Targets that `to_unit` takes to the units of a cell.
pub(super) fn unit_blocks<T: Copy + Default>(
    targets: &[[f64; 3]],
    to_unit: impl Fn([f64; 3]) -> [T; 3],
) -> Vec<TargetBlock<T>> {
    let blocks = targets.chunks(LANES);
    blocks.map(|t| TargetBlock::mapped(t, |&p| to_unit(p))).collect()
}

/// The points of a surface with the weights of three columns, zero beyond the last.
pub(super) fn packed(surface: &WeightedSurface, triple: usize, columns: usize) -> Vec<PackedSource> {
    let weight = |column: usize, point: usize| {
        let column = 3 * triple + column;
        if column < columns {
            surface.weights[column * surface.points.len() + point]
        } else {
            0.0
        }
    };
    let points = surface.points.iter().enumerate();
    points
        .map(|(i, &[x, y, z])| [x, y, z, weight(0, i), weight(1, i), weight(2, i)])
        .collect()
}

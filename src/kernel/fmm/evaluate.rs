//! Sums at the targets of each leaf: near sources one by one, all others through expansions.

use std::ops::Range;

use faer::{MatMut, MatRef};
use rayon::prelude::*;

use super::expansions::Pass;
use super::lists::TargetLeaf;
use super::tree::TreeCell;
use crate::kernel::direct::{self, BlockValues, LANES, PackedSource, TargetBlock};

/// Sums at all targets in the order of the tree: potentials, `targets × columns`, and gradients, `× 3`.
pub(super) struct TargetSums {
    pub(super) potentials: Vec<f64>,
    pub(super) gradients: Vec<f64>,
    /// Targets, as the caller numbers them, whose sums left the range of the inner loops though no source is there.
    pub(super) failed: Vec<u32>,
}

/// Leaves whose local expansions are evaluated together.
const LEAVES: usize = 16;

/// What the inner loops sum: `N` values at each target for three weights.
trait SumKind<const N: usize>: Copy + Sync {
    fn add(self, pass: &Pass, sources: &[PackedSource], targets: &[TargetBlock], sums: &mut [[BlockValues; N]]);
    /// By what a value is multiplied when lengths are divided by `up`.
    fn scale(self, value: usize, up: f64) -> f64;
}

#[derive(Clone, Copy)]
struct Potential;

#[derive(Clone, Copy)]
struct Gradient;

impl SumKind<3> for Potential {
    fn add(self, pass: &Pass, sources: &[PackedSource], targets: &[TargetBlock], sums: &mut [[BlockValues; 3]]) {
        direct::add_potential(pass.instructions, sources, targets, sums);
    }

    fn scale(self, _: usize, up: f64) -> f64 {
        up
    }
}

impl SumKind<12> for Gradient {
    fn add(self, pass: &Pass, sources: &[PackedSource], targets: &[TargetBlock], sums: &mut [[BlockValues; 12]]) {
        direct::add_gradient(pass.instructions, sources, targets, sums);
    }

    fn scale(self, value: usize, up: f64) -> f64 {
        if value < 3 { up } else { up * up }
    }
}

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
            task.run_by_triples(pass, multipoles, &weights, Gradient);
        } else {
            task.run_by_triples(pass, multipoles, &weights, Potential);
        }
        task.failed(pass)
    };
    sums.failed = tasks.into_par_iter().flat_map_iter(run).collect();
    sums
}

/// Leaves that follow one another, and the sums of their targets.
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
        let targets = |leaf: usize| leaves[leaf].targets();
        let len = (targets(range.end - 1).end - targets(first).start) * pass.columns();
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

    fn run_by_triples<const N: usize>(
        &mut self,
        pass: &Pass,
        multipoles: &[f64],
        weights: &[f64],
        kind: impl SumKind<N>,
    ) {
        let outer = pass.operators.outer.len() * pass.columns();
        let mut done = 0;
        for (leaf, weights) in self.leaves.clone().zip(weights.chunks(outer)) {
            let len = pass.lists.leaves[leaf].targets().len();
            for triple in 0..pass.weights.triples.len() {
                let sums = sum_leaf(pass, leaf, triple, weights, multipoles, kind);
                self.store(pass, done, len, triple, &sums);
            }
            done += len;
        }
    }

    fn run_by_rows(&mut self, pass: &Pass, multipoles: &[f64], weights: &[f64]) {
        let columns = pass.columns();
        let mut potentials = &mut self.potentials[..];
        for (leaf, weights) in self
            .leaves
            .clone()
            .zip(weights.chunks(pass.operators.outer.len() * columns))
        {
            let len = pass.lists.leaves[leaf].targets().len() * columns;
            let (own, rest) = std::mem::take(&mut potentials).split_at_mut(len);
            add_leaf_by_rows(pass, leaf, weights, multipoles, own);
            potentials = rest;
        }
    }

    /// Targets whose sums are not finite although all weights are, and no source near them has the same place.
    fn failed(&self, pass: &Pass) -> Vec<u32> {
        if !pass.weights.are_finite {
            return Vec::new();
        }
        let columns = pass.columns();
        let targets = self.leaves.clone().flat_map(|leaf| {
            let targets = pass.lists.leaves[leaf].targets();
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
            near.any(|near| pass.tree.sources.positions[near.start as usize..near.end as usize].contains(&position))
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

/// Sums of three columns at the targets of a leaf.
fn sum_leaf<const N: usize>(
    pass: &Pass,
    leaf: usize,
    triple: usize,
    local_weights: &[f64],
    multipoles: &[f64],
    kind: impl SumKind<N>,
) -> Vec<[BlockValues; N]> {
    let TargetLeaf { cell, .. } = pass.lists.leaves[leaf];
    let cell = &pass.tree.cells[cell as usize];
    let targets = &pass.tree.targets.positions[pass.lists.leaves[leaf].targets()];
    let blocks: Vec<TargetBlock> = targets.chunks(LANES).map(|t| TargetBlock::mapped(t, |t| *t)).collect();
    let mut sums = vec![[[0.0; LANES]; N]; blocks.len()];
    for near in pass.lists.near.row(leaf) {
        kind.add(
            pass,
            &pass.weights.triples[triple][near.start as usize..near.end as usize],
            &blocks,
            &mut sums,
        );
    }
    add_expansion(
        pass,
        cell,
        targets,
        &pass.operators.outer,
        triple,
        local_weights,
        kind,
        &mut sums,
    );
    for &slot in pass.lists.finer.row(leaf) {
        let cell = &pass.tree.cells[pass.lists.source_cells[slot as usize] as usize];
        let expansion = &multipoles[slot as usize * pass.stride()..][..pass.stride()];
        let weights = pass.product(pass.operators.basis.as_ref(), expansion, 1.0);
        add_expansion(
            pass,
            cell,
            targets,
            &pass.operators.inner,
            triple,
            &weights,
            kind,
            &mut sums,
        );
    }
    sums
}

/// Adds all columns at the targets of a leaf to `out`, `targets × columns`.
fn add_leaf_by_rows(pass: &Pass, leaf: usize, local_weights: &[f64], multipoles: &[f64], out: &mut [f64]) {
    let columns = pass.columns();
    let TargetLeaf { cell, .. } = pass.lists.leaves[leaf];
    let cell = &pass.tree.cells[cell as usize];
    let targets = &pass.tree.targets.positions[pass.lists.leaves[leaf].targets()];
    let mut out = MatMut::from_row_major_slice_mut(out, targets.len(), columns);
    let blocks: Vec<TargetBlock> = targets.chunks(LANES).map(|t| TargetBlock::mapped(t, |t| *t)).collect();
    for near in pass.lists.near.row(leaf) {
        let near = near.start as usize..near.end as usize;
        let positions = &pass.tree.sources.positions[near.clone()];
        pass.add_products(positions, pass.weight_rows(near), &blocks, 1.0, out.as_mut());
    }
    let mut add_surface = |cell: &TreeCell, surface: &[[f64; 3]], weights: &[f64]| {
        let up = 1.0 / pass.tree.half_width(cell);
        let weights = MatRef::from_column_major_slice(weights, surface.len(), columns);
        pass.add_products(surface, weights, &unit_blocks(targets, cell, up), up, out.as_mut());
    };
    add_surface(cell, &pass.operators.outer, local_weights);
    for &slot in pass.lists.finer.row(leaf) {
        let cell = &pass.tree.cells[pass.lists.source_cells[slot as usize] as usize];
        let expansion = &multipoles[slot as usize * pass.stride()..][..pass.stride()];
        let weights = pass.product(pass.operators.basis.as_ref(), expansion, 1.0);
        add_surface(cell, &pass.operators.inner, &weights);
    }
}

/// Targets in units of a cell.
fn unit_blocks(targets: &[[f64; 3]], cell: &TreeCell, up: f64) -> Vec<TargetBlock> {
    let unit = |t: &[f64; 3]| std::array::from_fn(|axis| (t[axis] - cell.centre[axis]) * up);
    targets.chunks(LANES).map(|t| TargetBlock::mapped(t, unit)).collect()
}

/// Adds the sums over the points of a surface about `cell`, with weights column after column.
#[expect(clippy::too_many_arguments)]
fn add_expansion<const N: usize>(
    pass: &Pass,
    cell: &TreeCell,
    targets: &[[f64; 3]],
    surface: &[[f64; 3]],
    triple: usize,
    weights: &[f64],
    kind: impl SumKind<N>,
    sums: &mut [[BlockValues; N]],
) {
    let weight = |column: usize, point: usize| {
        let column = 3 * triple + column;
        if column < pass.columns() {
            weights[column * surface.len() + point]
        } else {
            0.0
        }
    };
    let sources: Vec<PackedSource> = surface
        .iter()
        .enumerate()
        .map(|(i, &[x, y, z])| [x, y, z, weight(0, i), weight(1, i), weight(2, i)])
        .collect();
    let up = 1.0 / pass.tree.half_width(cell);
    let blocks = unit_blocks(targets, cell, up);
    let mut own = vec![[[0.0; LANES]; N]; blocks.len()];
    kind.add(pass, &sources, &blocks, &mut own);
    for (sums, own) in sums.iter_mut().zip(&own) {
        for (value, (sums, own)) in sums.iter_mut().zip(own).enumerate() {
            let scale = kind.scale(value, up);
            for (sum, own) in sums.iter_mut().zip(own) {
                *sum += scale * own;
            }
        }
    }
}

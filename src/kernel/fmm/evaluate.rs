//! Sums at the targets of each leaf: near sources one by one, all others through expansions.

use std::ops::Range;

use rayon::prelude::*;

use super::expansions::Pass;
use super::tree::Cell;
use crate::kernel::direct::{Block, LANES, Lane, Source};

/// Sums at all targets in the order of the tree: potentials, `targets × columns`, and gradients, `× 3`.
pub(super) struct Sums {
    pub(super) potentials: Vec<f64>,
    pub(super) gradients: Vec<f64>,
}

/// Leaves whose local expansions are evaluated together.
const LEAVES: usize = 16;

/// How the inner loops sum: `N` values for three weights, a value being the derivative of the potential of some order.
trait Kind<const N: usize>: Copy + Sync {
    /// Values for each weight at each target.
    const VALUES: usize = N / 3;
    fn add(self, pass: &Pass, sources: &[Source], targets: &[Block], sums: &mut [[Lane; N]]);
    /// Factor for a value (the potential's is 0) when lengths are multiplied by `up`.
    fn scale(value: usize, up: f64) -> f64;
}

#[derive(Clone, Copy)]
struct Potential;

#[derive(Clone, Copy)]
struct Gradient;

impl Kind<3> for Potential {
    fn add(self, pass: &Pass, sources: &[Source], targets: &[Block], sums: &mut [[Lane; 3]]) {
        pass.instructions.add_potential(sources, targets, sums);
    }

    fn scale(_: usize, up: f64) -> f64 {
        up
    }
}

impl Kind<12> for Gradient {
    fn add(self, pass: &Pass, sources: &[Source], targets: &[Block], sums: &mut [[Lane; 12]]) {
        pass.instructions.add_gradient(sources, targets, sums);
    }

    fn scale(sum: usize, up: f64) -> f64 {
        if sum < 3 { up } else { up * up }
    }
}

/// Potentials, and gradients when asked for, in the units of the tree's coordinates.
pub(super) fn evaluate(pass: &Pass, multipoles: &[f64], locals: &[f64], with_gradient: bool) -> Sums {
    let rows = pass.tree.targets.positions.len() * pass.columns();
    let mut sums = Sums {
        potentials: vec![0.0; rows],
        gradients: vec![0.0; if with_gradient { 3 * rows } else { 0 }],
    };
    let tasks = tasks(pass, &mut sums, with_gradient);
    tasks.into_par_iter().for_each(|task| {
        if with_gradient {
            task.run(pass, multipoles, locals, Gradient);
        } else {
            task.run(pass, multipoles, locals, Potential);
        }
    });
    sums
}

/// Leaves that follow one another, and the sums of their targets.
struct Task<'a> {
    leaves: Range<usize>,
    potentials: &'a mut [f64],
    gradients: &'a mut [f64],
}

fn tasks<'a>(pass: &Pass, sums: &'a mut Sums, with_gradient: bool) -> Vec<Task<'a>> {
    let (mut potentials, mut gradients) = (&mut sums.potentials[..], &mut sums.gradients[..]);
    let leaves = &pass.lists.leaves;
    let mut tasks = Vec::with_capacity(leaves.len().div_ceil(LEAVES));
    for first in (0..leaves.len()).step_by(LEAVES) {
        let range = first..leaves.len().min(first + LEAVES);
        let targets = |leaf: usize| pass.tree.cells[leaves[leaf] as usize].targets();
        let len = (targets(range.end - 1).end - targets(first).start) * pass.columns();
        let (own, rest) = potentials.split_at_mut(len);
        let (own_gradients, other_gradients) = gradients.split_at_mut(if with_gradient { 3 * len } else { 0 });
        (potentials, gradients) = (rest, other_gradients);
        tasks.push(Task {
            leaves: range,
            potentials: own,
            gradients: own_gradients,
        });
    }
    tasks
}

impl Task<'_> {
    fn run<const N: usize>(mut self, pass: &Pass, multipoles: &[f64], locals: &[f64], kind: impl Kind<N>) {
        let outer = pass.operators.outer.len() * pass.columns();
        let stride = pass.stride();
        let slot = |leaf: usize| pass.lists.target_slot[pass.lists.leaves[leaf] as usize] as usize;
        let gathered: Vec<f64> = self
            .leaves
            .clone()
            .flat_map(|leaf| &locals[slot(leaf) * stride..][..stride])
            .copied()
            .collect();
        let weights = pass.product(pass.operators.inverse.transpose(), &gathered, 1.0);
        let mut done = 0;
        for (leaf, weights) in self.leaves.clone().zip(weights.chunks(outer)) {
            let cell = &pass.tree.cells[pass.lists.leaves[leaf] as usize];
            for triple in 0..pass.weights.triples.len() {
                let sums = sum_leaf(pass, leaf, triple, weights, multipoles, kind);
                self.store(pass, done, cell.targets().len(), triple, &sums);
            }
            done += cell.targets().len();
        }
    }

    fn store<const N: usize>(&mut self, pass: &Pass, first: usize, len: usize, triple: usize, sums: &[[Lane; N]]) {
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
    kind: impl Kind<N>,
) -> Vec<[Lane; N]> {
    let cell = &pass.tree.cells[pass.lists.leaves[leaf] as usize];
    let targets = &pass.tree.targets.positions[cell.targets()];
    let blocks: Vec<Block> = targets.chunks(LANES).map(|t| Block::mapped(t, |t| *t)).collect();
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

/// Adds the sums over the points of a surface about `cell`, with weights column after column.
#[expect(clippy::too_many_arguments)]
fn add_expansion<const N: usize>(
    pass: &Pass,
    cell: &Cell,
    targets: &[[f64; 3]],
    surface: &[[f64; 3]],
    triple: usize,
    weights: &[f64],
    kind: impl Kind<N>,
    sums: &mut [[Lane; N]],
) {
    let weight = |column: usize, point: usize| {
        let column = 3 * triple + column;
        if column < pass.columns() {
            weights[column * surface.len() + point]
        } else {
            0.0
        }
    };
    let sources: Vec<Source> = surface
        .iter()
        .enumerate()
        .map(|(i, &[x, y, z])| [x, y, z, weight(0, i), weight(1, i), weight(2, i)])
        .collect();
    let up = 1.0 / pass.tree.half_width(cell);
    let unit = |t: &[f64; 3]| std::array::from_fn(|axis| (t[axis] - cell.centre[axis]) * up);
    let blocks: Vec<Block> = targets.chunks(LANES).map(|t| Block::mapped(t, unit)).collect();
    let mut own = vec![[[0.0; LANES]; N]; blocks.len()];
    kind.add(pass, &sources, &blocks, &mut own);
    for (sums, own) in sums.iter_mut().zip(&own) {
        for (value, (sums, own)) in sums.iter_mut().zip(own).enumerate() {
            let scale = scale_of(kind, value, up);
            for (sum, own) in sums.iter_mut().zip(own) {
                *sum += scale * own;
            }
        }
    }
}

fn scale_of<const N: usize, K: Kind<N>>(_: K, value: usize, up: f64) -> f64 {
    K::scale(value, up)
}

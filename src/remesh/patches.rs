//! Repair of inverted tetrahedra in patches: only nodes near them move.
//!
//! Where a map squeezes parts of the solid, cells are smaller than others by many orders of magnitude, and an energy of
//! the whole mesh does not see them. Here each patch around inverted cells has an energy of its own, in which all cells
//! count the same, relative to regular ones of the size of the cells around them.

use rayon::prelude::*;

use super::bounded_mesh::BoundedMesh;
use super::cells_at_nodes::CellsAtNodes;
use super::foldover::{FoldoverEnergy, edges, length_or_one, regular_edges};
use super::lbfgs::{DescentEnergy, Lbfgs, StoppingRule};
use super::quality::{invalid_cells, is_right_handed, lesser, tet_scaled_jacobians};
use super::repair::{Best, DescentCounts, next_epsilon};
use crate::mesh::CellList;
use crate::mesh::topology::DisjointSets;
use crate::progress::ProgressSender;
use crate::{Matrix3, Point};

/// How long a patch is worked on.
#[derive(Debug, Clone, Copy)]
pub(super) struct PatchEffort {
    pub round: StoppingRule,
    /// Rounds without fewer inverted cells before giving up.
    pub most_stalled: usize,
    /// Rings of cells around inverted ones whose nodes move, one pass after the other.
    pub rings: &'static [usize],
    /// Part of the inverted cells of a large patch below which it is given up: what is left gets smaller patches in the next
    /// pass.
    pub few: f64,
}

impl PatchEffort {
    pub const FAST: Self = Self {
        round: StoppingRule {
            iterations: 60,
            gain: 1e-5,
            until_positive: true,
        },
        most_stalled: 4,
        rings: &[2, 2, 3],
        few: 0.05,
    };
    pub const SLOW: Self = Self {
        round: StoppingRule {
            iterations: 150,
            gain: 1e-6,
            until_positive: true,
        },
        most_stalled: 8,
        rings: &[2, 3, 4],
        few: 0.0,
    };
}

const MAX_ROUNDS: usize = 40;
/// Cells of a patch that counts as large.
const LARGE: usize = 3000;
/// The descent that raises low cells, and how often it is looked at. With this ε even the flattest cells are on the right
/// side of the barrier.
const EPSILON: f64 = 1e-12;
const RAISING: StoppingRule = StoppingRule {
    iterations: 60,
    gain: 1e-4,
    until_positive: false,
};
const CHECK_EVERY: usize = 10;
/// Passes of averaging the logarithms of volumes over nodes and cells.
const PASSES: usize = 4;
/// Smallest volume that a cell is taken to have, as a fraction of the mean of those at its nodes.
const LEAST_VOLUME: f64 = 1e-3;

/// Nodes that move together, and the cells at them, both ascending.
struct Patch {
    free: Vec<u32>,
    cells: Vec<u32>,
}

/// Moves inner nodes within `rings` rings of cells around those that are inverted. No patch has more inverted cells
/// afterwards.
pub(super) fn repair_patches(
    mesh: &BoundedMesh,
    x: &mut [Point],
    rings: usize,
    effort: &PatchEffort,
    monitor: &ProgressSender<(usize, usize)>,
) -> DescentCounts {
    let CellList::Tets(tets) = &mesh.cells else {
        return DescentCounts::default();
    };
    let bad = invalid_cells(&mesh.cells, x).cells;
    let at_nodes = CellsAtNodes::new(&mesh.cells, mesh.nodes.len());
    let sizes = local_volumes(tets, x);
    // No cell is in two patches.
    let repaired: Vec<(Patch, RepairedPatch)> = patches(mesh, tets, &at_nodes, &bad, rings)
        .into_par_iter()
        .with_max_len(1)
        .map(|patch| {
            let repaired = repair_patch(&LocalPatch::new(tets, x, &patch, &sizes), effort, monitor);
            (patch, repaired)
        })
        .collect();
    let mut counts = DescentCounts::default();
    for (patch, repaired) in repaired {
        patch
            .free
            .iter()
            .zip(repaired.free)
            .for_each(|(&v, to)| x[v as usize] = to);
        counts.add(repaired.rounds, repaired.iterations, patch.cells.len());
    }
    counts
}

/// Moves inner nodes within a ring of cells around the cells `low`, so that the lowest scaled Jacobian of each patch rises:
/// the energy grows without bound as a cell gets flat. Of the positions along the way the last are kept in which no cell is
/// inverted, the patch's least scaled Jacobian is no lower, and no more of its cells are below each of two bounds: then no
/// more of the whole mesh are. No patch takes more than `most_iterations`, in so many `runs`. Returns the iterations made, and
/// those that led to positions that were kept.
///
/// Each run begins with a new preconditioner: the curvature of the energy of a flat cell falls by orders of magnitude as it is
/// raised.
pub(super) fn raise_lowest(
    mesh: &BoundedMesh,
    x: &mut [Point],
    low: &[u32],
    bounds: [f64; 2],
    most_iterations: usize,
    runs: usize,
    monitor: &ProgressSender<(usize, usize)>,
) -> (usize, usize) {
    let CellList::Tets(tets) = &mesh.cells else {
        return (0, 0);
    };
    let at_nodes = CellsAtNodes::new(&mesh.cells, mesh.nodes.len());
    let sizes = local_volumes(tets, x);
    let raise = |patch: &Patch| {
        let local = LocalPatch::new(tets, x, patch, &sizes);
        let mut kept = local.start.clone();
        let (mut least, below) = local.quality(&kept, bounds);
        let (mut kept_iterations, mut moved) = (0, kept.clone());
        let mut keep = |iterations: usize, at: &[Point]| {
            let (least_now, below_now) = local.quality(at, bounds);
            // Written so that NaN is lower.
            if least_now >= least && below_now[0] <= below[0] && below_now[1] <= below[1] && local.all_right_handed(at)
            {
                (kept, kept_iterations, least) = (at.to_vec(), iterations, least_now);
            }
            true
        };
        let mut descent = Lbfgs::new(&local.energy, &local.free, 1.0, monitor);
        descent.has_block_preconditioner = true;
        let rule = StoppingRule {
            iterations: most_iterations.min(RAISING.iterations).div_ceil(runs.max(1)),
            ..RAISING
        };
        let mut iterations = 0;
        for _ in 0..runs {
            let (_, made) = descent.run_watched(&mut moved, EPSILON, &rule, &mut |made, at| {
                (iterations + made) % CHECK_EVERY != 0 || keep(iterations + made, at)
            });
            iterations += made;
            if made == 0 {
                break;
            }
        }
        keep(iterations, &moved);
        (local.free_nodes(&kept), iterations, kept_iterations)
    };
    let patches = patches(mesh, tets, &at_nodes, low, 1);
    let raised: Vec<(Vec<Point>, usize, usize)> = patches.par_iter().with_max_len(1).map(raise).collect();
    let mut totals = (0, 0);
    for (patch, (free, iterations, kept)) in patches.iter().zip(raised) {
        patch.free.iter().zip(free).for_each(|(&v, to)| x[v as usize] = to);
        totals = (totals.0 + iterations, totals.1 + kept);
    }
    totals
}

/// The connected parts of the cells with inner nodes near bad cells.
fn patches(mesh: &BoundedMesh, tets: &[[u32; 4]], at_nodes: &CellsAtNodes, bad: &[u32], rings: usize) -> Vec<Patch> {
    let mut is_near = vec![false; mesh.nodes.len()];
    let mut near: Vec<u32> = Vec::new();
    let mut add = |cell: u32, near: &mut Vec<u32>| {
        for v in tets[cell as usize] {
            if !is_near[v as usize] {
                is_near[v as usize] = true;
                near.push(v);
            }
        }
    };
    bad.iter().for_each(|&cell| add(cell, &mut near));
    let mut first = 0;
    for _ in 0..rings {
        let last = near.len();
        for k in first..last {
            at_nodes.of(near[k]).iter().for_each(|&cell| add(cell, &mut near));
        }
        first = last;
    }
    near.retain(|&v| !mesh.on_boundary[v as usize]);
    near.sort_unstable();
    let position = |v: u32| near.binary_search(&v).ok().map(|k| k as u32);
    let mut cells: Vec<u32> = near.iter().flat_map(|&v| at_nodes.of(v)).copied().collect();
    cells.sort_unstable();
    cells.dedup();
    let mut sets = DisjointSets::new(near.len());
    let free_of = |cell: u32| tets[cell as usize].into_iter().filter_map(position);
    for &cell in &cells {
        let mut free = free_of(cell);
        if let Some(first) = free.next() {
            free.for_each(|other| sets.unite(first, other));
        }
    }
    let mut number = vec![u32::MAX; near.len()];
    let mut patches: Vec<Patch> = Vec::new();
    let mut patch_of = |k: u32, patches: &mut Vec<Patch>| {
        let root = sets.find(k) as usize;
        if number[root] == u32::MAX {
            number[root] = patches.len() as u32;
            patches.push(Patch {
                free: Vec::new(),
                cells: Vec::new(),
            });
        }
        number[root] as usize
    };
    for k in 0..near.len() as u32 {
        let patch = patch_of(k, &mut patches);
        patches[patch].free.push(near[k as usize]);
    }
    for &cell in &cells {
        let first = free_of(cell).next();
        if let Some(k) = first {
            let patch = patch_of(k, &mut patches);
            patches[patch].cells.push(cell);
        }
    }
    patches
}

/// For each cell the mean volume of the cells around it: of logarithms, since sizes differ by orders of magnitude.
pub(crate) fn local_volumes(tets: &[[u32; 4]], x: &[Point]) -> Vec<f64> {
    let volume = |t: &[u32; 4]| (edges(t.map(|v| x[v as usize])).determinant() / 6.0).abs();
    let volumes: Vec<f64> = tets.par_iter().map(volume).collect();
    let means = at_nodes(tets, x.len(), &volumes);
    let logarithm = |(t, volume): (&[u32; 4], &f64)| {
        let around = t.iter().map(|&v| means[v as usize]).fold(f64::INFINITY, f64::min);
        volume.max(LEAST_VOLUME * around).max(f64::MIN_POSITIVE).ln()
    };
    let mut logarithms: Vec<f64> = tets.par_iter().zip(&volumes).map(logarithm).collect();
    for _ in 0..PASSES {
        let nodes = at_nodes(tets, x.len(), &logarithms);
        let mean = |t: &[u32; 4]| t.iter().map(|&v| nodes[v as usize]).sum::<f64>() / 4.0;
        logarithms = tets.par_iter().map(mean).collect();
    }
    logarithms.into_iter().map(f64::exp).collect()
}

/// Means over the cells at each node.
fn at_nodes(tets: &[[u32; 4]], nodes: usize, values: &[f64]) -> Vec<f64> {
    let mut sums = vec![(0.0, 0.0); nodes];
    for (t, value) in tets.iter().zip(values) {
        for &v in t {
            sums[v as usize].0 += value;
            sums[v as usize].1 += 1.0;
        }
    }
    sums.into_iter()
        .map(|(sum, count)| sum / f64::max(count, 1.0))
        .collect()
}

/// New positions of a patch's free nodes.
struct RepairedPatch {
    free: Vec<Point>,
    rounds: usize,
    iterations: usize,
}

/// A patch with numbers of its own for nodes, and its energy.
struct LocalPatch {
    corners: Vec<[u32; 4]>,
    free: Vec<u32>,
    energy: FoldoverEnergy,
    start: Vec<Point>,
}

impl LocalPatch {
    fn new(tets: &[[u32; 4]], x: &[Point], patch: &Patch, sizes: &[f64]) -> Self {
        let mut nodes: Vec<u32> = patch.cells.iter().flat_map(|&cell| tets[cell as usize]).collect();
        nodes.sort_unstable();
        nodes.dedup();
        let number = |v: u32| nodes.binary_search(&v).unwrap_or_default() as u32;
        let corners: Vec<[u32; 4]> = patch.cells.iter().map(|&c| tets[c as usize].map(number)).collect();
        let rest = patch.cells.iter().map(|&cell| {
            let reference = regular_edges() * length_or_one(sizes[cell as usize].cbrt());
            reference.try_inverse().unwrap_or_else(Matrix3::identity)
        });
        Self {
            free: patch.free.iter().map(|&v| number(v)).collect(),
            energy: FoldoverEnergy::of_tets_with(corners.clone(), rest.collect(), nodes.len()),
            start: nodes.iter().map(|&v| x[v as usize]).collect(),
            corners,
        }
    }

    /// The least scaled Jacobian, NaN if one is, and how many are below each bound.
    fn quality(&self, at: &[Point], bounds: [f64; 2]) -> (f64, [usize; 2]) {
        let scaled = tet_scaled_jacobians(&self.corners, at);
        let least = scaled.iter().fold(f64::INFINITY, |least, &s| lesser(least, s));
        (least, bounds.map(|bound| scaled.iter().filter(|s| **s < bound).count()))
    }

    fn all_right_handed(&self, at: &[Point]) -> bool {
        self.corners.iter().all(|t| is_right_handed(at, *t))
    }

    fn free_nodes(&self, at: &[Point]) -> Vec<Point> {
        self.free.iter().map(|&v| at[v as usize]).collect()
    }
}

fn repair_patch(local: &LocalPatch, effort: &PatchEffort, monitor: &ProgressSender<(usize, usize)>) -> RepairedPatch {
    let (mut rounds, mut iterations) = (0, 0);
    let mut own = local.start.clone();
    let start = local.energy.evaluate(&own, 1.0, &[], &mut vec![], &mut []);
    let (mut best, mut least) = (Best::new(start.inverted, &own), start.least);
    let mut descent = Lbfgs::new(&local.energy, &local.free, 1.0, monitor);
    descent.has_block_preconditioner = true;
    let mut epsilon = 1.0;
    for round in 0..MAX_ROUNDS {
        if best.inverted == 0 || best.stalled == effort.most_stalled || !monitor.should_continue() {
            break;
        }
        if round > 0 {
            epsilon = next_epsilon(epsilon, least);
        }
        let (value, made) = descent.run(&mut own, epsilon, &effort.round);
        rounds += 1;
        iterations += made;
        least = value.least;
        best.update(value.inverted, &own);
        let few_are_left = local.corners.len() > LARGE && (best.inverted as f64) < effort.few * start.inverted as f64;
        if few_are_left || !value.energy.is_finite() {
            break;
        }
    }
    RepairedPatch {
        free: local.free_nodes(&best.nodes),
        rounds,
        iterations,
    }
}

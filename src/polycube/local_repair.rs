//! Repair of what a descent of the whole polycube leaves inverted: in patches around inverted cells, in which all cells
//! count the same, while the planes of the charts stay where they are.

use super::PolycubePhase;
use super::axis_of;
use super::descent::STEP;
use super::effort::Effort;
use super::energy::{PolycubeEnergy, References};
use super::solid::Solid;
use crate::Point;
use crate::mesh::topology::DisjointSets;
use crate::progress::ProgressSender;
use crate::remesh::lbfgs::{DescentEnergy, Lbfgs, StoppingRule};
use crate::remesh::{CellsAtNodes, SharedCoordinates, next_epsilon};

const ROUND: StoppingRule = StoppingRule {
    iterations: 150,
    gain: 1e-6,
    until_positive: true,
};
const MOST_ROUNDS: usize = 30;
const MOST_STALLED: usize = 5;
/// Rings of tetrahedra around inverted cells whose nodes move, and what the descent starts from.
const TRIES: [(usize, Averaged); 12] = [
    (2, Averaged::Nothing),
    (2, Averaged::All),
    (2, Averaged::Borders),
    (3, Averaged::All),
    (3, Averaged::Boundary),
    (3, Averaged::Borders),
    (3, Averaged::Nothing),
    (4, Averaged::All),
    (4, Averaged::Borders),
    (4, Averaged::Nothing),
    (6, Averaged::All),
    (6, Averaged::Nothing),
];
/// Sweeps of averages for each ring.
const SWEEPS: usize = 30;

/// Which nodes start from averages over their neighbours, instead of where they are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Averaged {
    Nothing,
    /// Nodes on borders between charts.
    Borders,
    /// Nodes of the boundary.
    Boundary,
    All,
}

/// Nodes that move together, and the cells at them.
struct Patch {
    free: Vec<u32>,
    tets: Vec<u32>,
    faces: Vec<u32>,
}

/// Moves nodes near inverted cells; no patch has more inverted cells afterwards. Returns how many are left.
pub(super) fn repair(
    solid: &mut Solid,
    references: &References,
    effort: &Effort,
    monitor: &ProgressSender<PolycubePhase>,
) -> usize {
    let at_nodes = CellsAtNodes::new(&solid.mesh.cells, solid.x.len());
    let mut faces_at = vec![vec![]; solid.x.len()];
    for (face, corners) in (0..).zip(&solid.mesh.boundary) {
        corners.iter().for_each(|&v| faces_at[v as usize].push(face));
    }
    let borders = border_axes(solid);
    let mut left = solid.inverted().count();
    for (rings, averaged) in TRIES {
        let bad = solid.inverted();
        left = bad.count();
        if left == 0 || effort.is_spent() || !monitor.should_continue() {
            break;
        }
        let _ = monitor.send(PolycubePhase::Deforming { inverted: left });
        for patch in patches(solid, &at_nodes, &faces_at, &bad.nodes(solid), rings) {
            let (moved, iterations) =
                repair_patch(solid, references, &borders, &patch, (averaged, rings * SWEEPS), monitor);
            effort.spend(iterations, patch.tets.len());
            patch
                .free
                .iter()
                .zip(moved)
                .for_each(|(&v, to)| solid.x[v as usize] = to);
        }
        left = solid.inverted().count();
    }
    left
}

/// For each node, which coordinates are those of charts.
fn border_axes(solid: &Solid) -> Vec<[bool; 3]> {
    let mut axes = vec![[false; 3]; solid.x.len()];
    for (corners, label) in solid.mesh.boundary.iter().zip(solid.labels()) {
        corners.iter().for_each(|&v| axes[v as usize][axis_of(label)] = true);
    }
    axes
}

/// Connected parts of the nodes within some rings.
fn patches(solid: &Solid, at_nodes: &CellsAtNodes, faces_at: &[Vec<u32>], bad: &[u32], rings: usize) -> Vec<Patch> {
    let tets = solid.tets();
    let mut is_near = vec![false; solid.x.len()];
    let mut near: Vec<u32> = bad.to_vec();
    near.iter().for_each(|&v| is_near[v as usize] = true);
    let mut first = 0;
    for _ in 0..rings {
        let last = near.len();
        for k in first..last {
            for v in at_nodes.of(near[k]).iter().flat_map(|&t| tets[t as usize]) {
                if !is_near[v as usize] {
                    is_near[v as usize] = true;
                    near.push(v);
                }
            }
        }
        first = last;
    }
    near.sort_unstable();
    let mut sets = DisjointSets::new(near.len());
    let position = |v: u32| near.binary_search(&v).ok().map(|k| k as u32);
    for (k, &v) in (0..).zip(&near) {
        let around = at_nodes.of(v).iter().flat_map(|&t| tets[t as usize]);
        around.filter_map(position).for_each(|other| sets.unite(k, other));
    }
    let mut number = vec![usize::MAX; near.len()];
    let mut patches: Vec<Patch> = vec![];
    for (k, &v) in (0..).zip(&near) {
        let root = sets.find(k) as usize;
        if number[root] == usize::MAX {
            number[root] = patches.len();
            patches.push(Patch {
                free: vec![],
                tets: vec![],
                faces: vec![],
            });
        }
        let patch = &mut patches[number[root]];
        patch.free.push(v);
        patch.tets.extend(at_nodes.of(v));
        patch.faces.extend(&faces_at[v as usize]);
    }
    for patch in &mut patches {
        for cells in [&mut patch.tets, &mut patch.faces] {
            cells.sort_unstable();
            cells.dedup();
        }
    }
    patches
}

/// New positions of a patch's free nodes, and the number of iterations that they took.
fn repair_patch(
    solid: &Solid,
    references: &References,
    borders: &[[bool; 3]],
    patch: &Patch,
    (averaged, sweeps): (Averaged, usize),
    monitor: &ProgressSender<PolycubePhase>,
) -> (Vec<Point>, usize) {
    let of_patch = |cells: &[u32]| -> Vec<usize> { cells.iter().map(|&c| c as usize).collect() };
    let (tets, faces) = (of_patch(&patch.tets), of_patch(&patch.faces));
    let mut nodes: Vec<u32> = tets.iter().flat_map(|&t| solid.tets()[t]).collect();
    nodes.sort_unstable();
    nodes.dedup();
    let number = |v: u32| nodes.binary_search(&v).unwrap_or_default() as u32;
    let labels: Vec<u8> = faces.iter().map(|&f| solid.label(f)).collect();
    let own = References {
        tets: tets.iter().map(|&t| references.tets[t]).collect(),
        faces: faces.iter().map(|&f| references.faces[f]).collect(),
        tet_weights: vec![1.0 / tets.len().max(1) as f64; tets.len()],
        face_weights: vec![1.0 / faces.len().max(1) as f64; faces.len()],
    };
    let corners: Vec<[u32; 4]> = tets.iter().map(|&t| solid.tets()[t].map(number)).collect();
    let triangles: Vec<[u32; 3]> = faces.iter().map(|&f| solid.mesh.boundary[f].map(number)).collect();
    let energy = PolycubeEnergy::new(corners, triangles, &labels, own, nodes.len());
    let free: Vec<u32> = patch.free.iter().map(|&v| number(v)).collect();
    let fixed = (0..).zip(&patch.free).flat_map(|(k, &v)| {
        let axes = borders[v as usize];
        (0..3).filter(move |&axis| axes[axis]).map(move |axis| (k, axis))
    });
    let constraints = SharedCoordinates {
        fixed: fixed.collect(),
        equal: vec![],
    };
    let start: Vec<Point> = nodes.iter().map(|&v| solid.x[v as usize]).collect();
    let mut x = start.clone();
    if averaged != Averaged::Nothing {
        average(solid, borders, patch, &nodes, (averaged, sweeps), &mut x);
    }
    let before = energy.evaluate(&start, 1.0, &[], &mut vec![], &mut []).inverted;
    let (mut best, mut fewest, mut stalled, mut taken) = (start, before, 0, 0);
    let mut descent = Lbfgs::new(&energy, &free, STEP, monitor);
    descent.shared = Some(&constraints);
    descent.has_block_preconditioner = true;
    let mut least = energy.least(&x);
    // A large ε would move nodes past one another again.
    let mut epsilon = if averaged == Averaged::Nothing {
        1.0
    } else {
        next_epsilon(1.0, least)
    };
    for round in 0..MOST_ROUNDS {
        if round > 0 {
            epsilon = next_epsilon(epsilon, least);
        }
        let (value, iterations) = descent.run(&mut x, epsilon, &ROUND);
        taken += iterations;
        least = value.least;
        stalled += 1;
        if value.inverted < fewest {
            (best, fewest, stalled) = (x.clone(), value.inverted, 0);
        }
        if fewest == 0 || stalled == MOST_STALLED || !value.energy.is_finite() || !monitor.should_continue() {
            break;
        }
    }
    (free.iter().map(|&k| best[k as usize]).collect(), taken)
}

/// Averages over neighbours, sweep by sweep: nodes of borders over neighbours with the same planes, those of charts over
/// others in the boundary, inner ones over all. That restores their order along borders.
fn average(
    solid: &Solid,
    borders: &[[bool; 3]],
    patch: &Patch,
    nodes: &[u32],
    (averaged, sweeps): (Averaged, usize),
    x: &mut [Point],
) {
    let number = |v: u32| nodes.binary_search(&v).unwrap_or_default();
    let planes = |v: u32| borders[v as usize].iter().filter(|is| **is).count();
    let mut neighbours: Vec<Vec<u32>> = vec![vec![]; nodes.len()];
    for &t in &patch.tets {
        let corners = solid.tets()[t as usize];
        for a in corners {
            neighbours[number(a)].extend(corners.iter().filter(|&&b| b != a && planes(a) == 0));
        }
    }
    for &f in &patch.faces {
        let corners = solid.mesh.boundary[f as usize];
        for a in corners {
            let is_wanted = |b: &&u32| {
                let shares = (0..3).all(|axis| !borders[a as usize][axis] || borders[**b as usize][axis]);
                **b != a && planes(a) > 0 && shares
            };
            neighbours[number(a)].extend(corners.iter().filter(is_wanted));
        }
    }
    for list in &mut neighbours {
        list.sort_unstable();
        list.dedup();
    }
    let moves = |v: &&u32| match averaged {
        Averaged::Nothing => false,
        Averaged::Borders => planes(**v) > 1,
        Averaged::Boundary => planes(**v) > 0,
        Averaged::All => true,
    };
    for _ in 0..sweeps {
        for &v in patch.free.iter().filter(moves) {
            let k = number(v);
            let around = &neighbours[k];
            if around.is_empty() {
                continue;
            }
            for axis in (0..3).filter(|&axis| !borders[v as usize][axis]) {
                let sum: f64 = around.iter().map(|&b| x[number(b)][axis]).sum();
                x[k][axis] = sum / around.len() as f64;
            }
        }
    }
}

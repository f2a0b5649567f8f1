//! Minimisation of the foldover-free energy of a whole polycube, one unknown for each plane of charts.

use super::PolycubePhase;
use super::effort::Effort;
use super::energy::PolycubeEnergy;
use crate::Point;
use crate::progress::ProgressSender;
use crate::remesh::lbfgs::{Lbfgs, StoppingRule};
use crate::remesh::{SharedCoordinates, next_epsilon};

/// The first ε. With 1, as for a fixed boundary, everything collapses: the energy of a point is 2 / ε.
const FIRST_EPSILON: f64 = 0.1;
const ROUND: StoppingRule = StoppingRule {
    iterations: 300,
    gain: 3e-6,
    until_positive: true,
};
const MOST_ROUNDS: usize = 60;
/// Rounds without clearly fewer inverted cells before giving up, and how many fewer these are.
const MOST_STALLED: usize = 3;
const CLEARLY_FEWER: f64 = 0.8;
/// Rounds after which more cells than can be repaired are inverted for good. Before, this many times as many may be.
const FEW_ROUNDS: usize = 3;
const BEFORE: usize = 10;
/// The descent of a polycube in which nothing is inverted.
const POLISH: StoppingRule = StoppingRule {
    iterations: 300,
    gain: 1e-5,
    until_positive: false,
};
const POLISH_EPSILON: f64 = 1e-9;

/// What a descent ended with.
#[derive(Debug, Clone, Copy)]
pub(super) struct DescentEnd {
    pub energy: f64,
    /// Inverted tetrahedra and triangles.
    pub inverted: usize,
}

/// Minimises the energy for decreasing ε until nothing is inverted, or for a few rounds if more than `most_left` cells are left
/// then; `x` gets the positions with the fewest inverted cells.
pub(super) fn untangle(
    energy: &PolycubeEnergy,
    planes: &SharedCoordinates,
    x: &mut Vec<Point>,
    most_left: Option<usize>,
    effort: &Effort,
    monitor: &ProgressSender<PolycubePhase>,
) -> DescentEnd {
    let free: Vec<u32> = (0..x.len() as u32).collect();
    let mut descent = Lbfgs::new(energy, &free, STEP, monitor);
    descent.shared = Some(planes);
    descent.has_block_preconditioner = true;
    let mut best: Option<(DescentEnd, Vec<Point>)> = None;
    let (mut epsilon, mut stalled, mut least, mut fewest) = (FIRST_EPSILON, 0, 0.0, f64::INFINITY);
    for round in 0..MOST_ROUNDS {
        if round > 0 {
            epsilon = next_epsilon(epsilon, least);
        }
        let (value, iterations) = descent.run(x, epsilon, &ROUND);
        effort.spend(iterations, energy.tet_count());
        least = value.least;
        let end = DescentEnd {
            energy: value.energy,
            inverted: value.inverted,
        };
        stalled += 1;
        if best.as_ref().is_none_or(|(best, _)| end.inverted < best.inverted) {
            best = Some((end, x.clone()));
        }
        let enough = if most_left.is_some() { CLEARLY_FEWER } else { 1.0 };
        if (end.inverted as f64) < enough * fewest {
            (fewest, stalled) = (end.inverted as f64, 0);
        }
        let _ = monitor.send(PolycubePhase::Deforming {
            inverted: value.inverted,
        });
        let bound = |most: usize| {
            if round < FEW_ROUNDS {
                BEFORE.saturating_mul(most)
            } else {
                most
            }
        };
        let is_hopeless = most_left.is_some_and(|most| end.inverted > bound(most));
        if value.inverted == 0
            || is_hopeless
            || stalled == MOST_STALLED
            || effort.is_spent()
            || !value.energy.is_finite()
            || !monitor.should_continue()
        {
            break;
        }
    }
    match best {
        Some((end, positions)) => {
            *x = positions;
            end
        }
        None => DescentEnd {
            energy: f64::NAN,
            inverted: usize::MAX,
        },
    }
}

/// The largest displacement of a node in a first step without a preconditioner, for a model of diagonal 1.
pub(super) const STEP: f64 = 1e-3;

/// Lowers the energy of a polycube in which nothing is inverted; returns it, unless that failed and `x` is as it was.
pub(super) fn polish(
    energy: &PolycubeEnergy,
    planes: &SharedCoordinates,
    x: &mut Vec<Point>,
    monitor: &ProgressSender<PolycubePhase>,
) -> Option<f64> {
    let free: Vec<u32> = (0..x.len() as u32).collect();
    let mut descent = Lbfgs::new(energy, &free, STEP, monitor);
    descent.shared = Some(planes);
    descent.has_block_preconditioner = true;
    let mut moved = x.clone();
    let (value, _) = descent.run(&mut moved, POLISH_EPSILON, &POLISH);
    let is_kept = value.inverted == 0 && value.energy.is_finite();
    is_kept.then(|| {
        *x = moved;
        value.energy
    })
}

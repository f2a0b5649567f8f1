//! Repairs inverted cells by moving inner nodes, with the boundary fixed as long as that suffices, and then improves
//! the shapes of all cells.

use super::foldover::FoldoverEnergy;
use super::lbfgs::{Lbfgs, StoppingRule};
use super::quality::inverted_inside;
use super::slide::{SlideReport, SlidingSurface, slide};
use crate::Point;
use crate::mesh::CellList;
use crate::progress::ProgressMonitor;

/// Smallest ε², reached as the least determinant approaches zero, and ε as a fraction of that determinant.
const LEAST_EPSILON_SQUARED: f64 = 1e-6;
const DETERMINANT_PART: f64 = 0.2;
/// Largest ratio of ε to that of the round before.
const EPSILON_RATIO: f64 = 0.7;
const ROUND: StoppingRule = StoppingRule {
    iterations: 300,
    gain: 3e-5,
    until_positive: true,
};
/// Rounds without fewer inverted corners before giving up.
const MAX_STALLED: usize = 10;
const MAX_ROUNDS: usize = 100;
/// ε of the polish: a step that inverts a sample costs more than any gain.
const POLISH_EPSILON: f64 = 1e-9;

/// Relative decrease of the energy below which the polish stops.
const POLISH_GAIN: f64 = 1e-6;

/// How often hexahedra are checked inside and repaired.
const MAX_INSIDE_CHECKS: usize = 10;

/// What a repair did.
#[derive(Debug, Clone, Copy, PartialEq, Default, serde::Serialize)]
pub struct RepairReport {
    /// Rounds of decreasing ε.
    pub rounds: usize,
    /// Iterations of descent in all rounds.
    pub iterations: usize,
    /// Iterations of the polish.
    pub polish_iterations: usize,
    /// How boundary nodes slid on the target, where fixed ones left inverted cells.
    pub slide: SlideReport,
}

/// ε of the next round, from the least determinant so far.
pub(super) fn next_epsilon(epsilon: f64, least: f64) -> f64 {
    (EPSILON_RATIO * epsilon).min((LEAST_EPSILON_SQUARED + (DETERMINANT_PART * least).powi(2)).sqrt())
}

/// The node positions with the fewest inverted corners so far.
pub(super) struct Best {
    pub inverted: usize,
    pub nodes: Vec<Point>,
    /// Rounds since they were found.
    pub stalled: usize,
}

impl Best {
    pub fn new(inverted: usize, nodes: &[Point]) -> Self {
        Self {
            inverted,
            nodes: nodes.to_vec(),
            stalled: 0,
        }
    }

    /// Counts a round, and keeps its positions if they have fewer inverted corners.
    pub fn update(&mut self, inverted: usize, nodes: &[Point]) {
        self.stalled += 1;
        if inverted < self.inverted {
            *self = Self::new(inverted, nodes);
        }
    }
}

/// What a repair works on.
pub(super) struct Repair<'a> {
    pub cells: &'a CellList,
    /// Inner nodes.
    pub free: &'a [u32],
    /// Largest displacement of a node in a first step.
    pub step: f64,
    /// Iterations of each polish.
    pub polish: usize,
    /// The surface that boundary nodes may slide on, if they may.
    pub sliding_surface: Option<&'a SlidingSurface<'a>>,
    /// Receives rounds and inverted corners; asked in every iteration whether to continue.
    pub monitor: &'a ProgressMonitor<'a, (usize, usize)>,
}

impl Repair<'_> {
    /// Moves nodes until no cell is inverted, or as few as possible; polishes the shapes if none is left.
    pub fn run(&self, energy: &mut FoldoverEnergy, x: &mut Vec<Point>) -> RepairReport {
        let mut report = RepairReport::default();
        if self.free.is_empty() {
            return report;
        }
        let mut left = self.untangle(energy, x, &mut report);
        if let (1.., Some(sliding_surface)) = (left, self.sliding_surface) {
            report.slide = slide(energy, x, self.step, sliding_surface, self.monitor);
            left = energy.inverted(x).len();
        }
        if left > 0 {
            return report;
        }
        self.polish(energy, x, &mut report);
        for _ in 0..MAX_INSIDE_CHECKS {
            if !self.monitor.should_continue() {
                break;
            }
            let bad = inverted_inside(self.cells, x);
            if bad.is_empty() {
                break;
            }
            energy.check_inside(&bad);
            self.untangle(energy, x, &mut report);
            self.polish(energy, x, &mut report);
        }
        report
    }

    /// Minimises the energy for decreasing ε; returns the number of inverted corners that are left.
    fn untangle(&self, energy: &FoldoverEnergy, x: &mut Vec<Point>, report: &mut RepairReport) -> usize {
        let start = energy.evaluate(x, 1.0, &[], &mut vec![], &mut []);
        let (mut least, mut inverted) = (start.least, start.inverted);
        let mut descent = Lbfgs::new(energy, self.free, self.step, self.monitor);
        let mut best = Best::new(inverted, x);
        let mut epsilon = 1.0;
        for round in 0..MAX_ROUNDS {
            if inverted == 0 || best.stalled == MAX_STALLED {
                break;
            }
            if round > 0 {
                epsilon = next_epsilon(epsilon, least);
            }
            let (value, iterations) = descent.run(x, epsilon, &ROUND);
            report.rounds += 1;
            report.iterations += iterations;
            (least, inverted) = (value.least, value.inverted);
            best.update(inverted, x);
            self.monitor.report((report.rounds, inverted));
            if !value.energy.is_finite() || !self.monitor.should_continue() {
                break;
            }
        }
        *x = best.nodes;
        best.inverted
    }

    fn polish(&self, energy: &FoldoverEnergy, x: &mut Vec<Point>, report: &mut RepairReport) {
        let rule = StoppingRule {
            iterations: self.polish,
            gain: POLISH_GAIN,
            until_positive: false,
        };
        let mut descent = Lbfgs::new(energy, self.free, self.step, self.monitor);
        let before = x.clone();
        let (value, iterations) = descent.run(x, POLISH_EPSILON, &rule);
        report.polish_iterations += iterations;
        // A cell so small that it hardly counts may have been inverted in favour of others.
        if value.inverted > 0 {
            *x = before;
        }
    }
}

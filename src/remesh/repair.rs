//! Turns inverted cells back by moving inner nodes, the boundary fixed as long as that helps, and polishes their shapes.

use super::foldover::FoldoverEnergy;
use super::lbfgs::{Lbfgs, StoppingRule};
use super::quality::inverted_inside;
use super::slide::{SlideReport, SlidingSurface, slide};
use crate::Point;
use crate::mesh::CellList;
use crate::progress::ProgressMonitor;

/// ε² where no determinant is negative, and share of the least determinant that ε takes.
const FLOOR: f64 = 1e-6;
const SHARE: f64 = 0.2;
/// Fall of ε from one round to the next, at least.
const FALL: f64 = 0.7;
const ROUND: StoppingRule = StoppingRule {
    iterations: 300,
    gain: 3e-5,
    until_positive: true,
};
/// Rounds without fewer inverted corners after which it is given up.
const STALLED: usize = 10;
const MOST_ROUNDS: usize = 100;
/// ε of the polish: a step that inverts a sample costs more than any gain.
const POLISH_EPSILON: f64 = 1e-9;

/// Fall of the energy over some iterations, as a fraction, below which shapes are as good as they get.
const POLISH_GAIN: f64 = 1e-6;

/// Times that hexahedra are looked into and mended.
const MOST_LOOKS: usize = 10;

/// What a repair did.
#[derive(Debug, Clone, Copy, PartialEq, Default, serde::Serialize)]
pub struct RepairReport {
    /// Rounds of falling ε.
    pub rounds: usize,
    /// Iterations of descent in all rounds.
    pub iterations: usize,
    /// Iterations of the polish.
    pub polish_iterations: usize,
    /// What slid on the target, where fixed boundary nodes left inverted cells.
    pub slide: SlideReport,
}

/// ε of the next round, by the least determinant so far.
pub(super) fn next_epsilon(epsilon: f64, least: f64) -> f64 {
    (FALL * epsilon).min((FLOOR + (SHARE * least).powi(2)).sqrt())
}

/// The positions with the fewest inverted cells so far.
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

    /// Takes the result of a round if it has fewer inverted cells.
    pub fn update(&mut self, inverted: usize, nodes: &[Point]) {
        self.stalled += 1;
        if inverted < self.inverted {
            *self = Self::new(inverted, nodes);
        }
    }
}

/// Turns cells back and polishes them.
pub(super) struct Repair<'a> {
    pub cells: &'a CellList,
    /// Nodes inside.
    pub free: &'a [u32],
    /// Length that a first step moves a node at most.
    pub step: f64,
    /// Iterations of each polish.
    pub polish: usize,
    /// What boundary nodes may slide on.
    pub sliding_surface: Option<&'a SlidingSurface<'a>>,
    /// Gets rounds and inverted corners, and is asked in every iteration.
    pub monitor: &'a ProgressMonitor<'a, (usize, usize)>,
}

impl Repair<'_> {
    /// Moves nodes until no cell is inverted, or as few are as can be reached, and polishes them if there are none.
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
        for _ in 0..MOST_LOOKS {
            if !self.monitor.should_continue() {
                break;
            }
            let bad = inverted_inside(self.cells, x);
            if bad.is_empty() {
                break;
            }
            energy.look_inside(&bad);
            self.untangle(energy, x, &mut report);
            self.polish(energy, x, &mut report);
        }
        report
    }

    /// Rounds of falling ε; returns the inverted corners that are left.
    fn untangle(&self, energy: &FoldoverEnergy, x: &mut Vec<Point>, report: &mut RepairReport) -> usize {
        let start = energy.evaluate(x, 1.0, &[], &mut vec![], &mut []);
        let (mut least, mut inverted) = (start.least, start.inverted);
        let mut descent = Lbfgs::new(energy, self.free, self.step, self.monitor);
        let mut best = Best::new(inverted, x);
        let mut epsilon = 1.0;
        for round in 0..MOST_ROUNDS {
            if inverted == 0 || best.stalled == STALLED {
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
        let limits = StoppingRule {
            iterations: self.polish,
            gain: POLISH_GAIN,
            until_positive: false,
        };
        let mut descent = Lbfgs::new(energy, self.free, self.step, self.monitor);
        let before = x.clone();
        let (value, iterations) = descent.run(x, POLISH_EPSILON, &limits);
        report.polish_iterations += iterations;
        // Where cells are so small that they hardly count, one may have turned over for the good of others.
        if value.inverted > 0 {
            *x = before;
        }
    }
}

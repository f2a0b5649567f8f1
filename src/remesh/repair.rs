//! Repairs inverted cells by moving inner nodes, with the boundary fixed as long as that suffices. The shapes of
//! cells are improved afterwards.

use super::bounded_mesh::BoundedMesh;
use super::foldover::FoldoverEnergy;
use super::lbfgs::{Lbfgs, StoppingRule};
use super::polish::{Polish, PolishOutcome, PolishReport};
use super::quality::{invalid_cells, inverted_inside};
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
/// How often hexahedra are checked inside and repaired.
const MAX_INSIDE_CHECKS: usize = 10;

/// What a repair did.
#[derive(Debug, Clone, Copy, PartialEq, Default, serde::Serialize)]
pub struct RepairReport {
    /// Rounds of decreasing ε.
    pub rounds: usize,
    /// Iterations of descent in all rounds.
    pub iterations: usize,
    /// The improvement of shapes after the repair.
    pub polish: PolishReport,
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
    pub mesh: &'a BoundedMesh,
    /// Inner nodes.
    pub free: &'a [u32],
    /// Signed volume of the image.
    pub volume: f64,
    /// Largest displacement of a node in a first step.
    pub step: f64,
    /// Iterations of the polish.
    pub polish: usize,
    /// Whether meshes are polished in which nothing was inverted.
    pub polish_valid: bool,
    /// The surface that boundary nodes may slide on, if they may.
    pub sliding_surface: Option<&'a SlidingSurface<'a>>,
    /// Receives rounds and inverted cells; asked in every iteration whether to continue.
    pub monitor: &'a ProgressMonitor<'a, (usize, usize)>,
}

impl Repair<'_> {
    /// Moves nodes until no cell is inverted, or as few as possible; polishes the shapes if none is left.
    pub fn run(&self, x: &mut Vec<Point>) -> RepairReport {
        let mut report = RepairReport::default();
        let inverted = invalid_cells(&self.mesh.cells, x).cells.len();
        self.monitor.report((0, inverted));
        let anything_inverted = inverted > 0;
        // Hexahedra that the energy is evaluated inside, too.
        let mut inside = Vec::new();
        let all_repaired = !anything_inverted || self.untangle_all(x, &mut inside, &mut report);
        report.polish = if self.polish == 0 {
            PolishReport::default()
        } else if !all_repaired {
            PolishOutcome::CellsInverted.into()
        } else if !anything_inverted && !self.polish_valid {
            PolishOutcome::NothingInverted.into()
        } else {
            Polish {
                mesh: self.mesh,
                free: self.free,
                inside: &inside,
                of_repair: &|| self.energy_of_all(),
                iterations: self.polish,
                step: self.step,
                monitor: self.monitor,
            }
            .run(x)
        };
        report
    }

    /// Whether no cell is inverted at a corner afterwards.
    fn untangle_all(&self, x: &mut Vec<Point>, inside: &mut Vec<u32>, report: &mut RepairReport) -> bool {
        let mut energy = self.energy_of_all();
        let mut left = self.untangle(&energy, x, report);
        if let (1.., Some(sliding_surface)) = (left, self.sliding_surface) {
            report.slide = slide(&energy, x, self.step, sliding_surface, self.monitor);
            left = energy.inverted(x).len();
        }
        if left > 0 {
            return false;
        }
        for _ in 0..MAX_INSIDE_CHECKS {
            let bad = inverted_inside(&self.mesh.cells, x);
            if bad.is_empty() || !self.monitor.should_continue() {
                break;
            }
            inside.extend(bad);
            energy.check_inside(inside);
            self.untangle(&energy, x, report);
        }
        energy.inverted(x).is_empty()
    }

    /// The energy of the whole mesh: tetrahedra relative to those of the domain where these are well-shaped, corners of
    /// hexahedra relative to those of a cube. It untangles any start, where own sizes may mean nothing.
    fn energy_of_all(&self) -> FoldoverEnergy {
        let nodes = &self.mesh.nodes;
        match &self.mesh.cells {
            CellList::Tets(tets) => FoldoverEnergy::of_tets(tets, nodes, self.volume),
            CellList::Hexes(hexes) => FoldoverEnergy::of_hexes(hexes, nodes.len(), self.volume),
        }
    }

    /// Minimises the energy for decreasing ε; returns the number of inverted corners that are left.
    fn untangle(&self, energy: &FoldoverEnergy, x: &mut Vec<Point>, report: &mut RepairReport) -> usize {
        let start = energy.evaluate(x, 1.0, &[], &mut vec![], &mut []);
        let (mut least, mut inverted) = (start.least, start.inverted);
        let mut descent = Lbfgs::new(energy, self.free, self.step, self.monitor);
        let mut best = Best::new(inverted, x);
        let mut epsilon = 1.0;
        for round in 0..MAX_ROUNDS {
            if inverted == 0 || self.free.is_empty() || best.stalled == MAX_STALLED {
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
            self.monitor.report((report.rounds, value.inverted_cells));
            if !value.energy.is_finite() || !self.monitor.should_continue() {
                break;
            }
        }
        *x = best.nodes;
        best.inverted
    }
}

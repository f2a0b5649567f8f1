//! Repairs inverted cells by moving inner nodes, with the boundary fixed as long as that suffices, and by splitting
//! tetrahedra where it does not. The shapes of cells are improved afterwards.

use std::mem::{replace, swap};

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::boundary_split::{BoundaryImage, BoundaryRefinement, BoundarySplitReport, Unrefined, boundary_at_stuck};
use super::bounded_mesh::BoundedMesh;
use super::crossings::crossing_triangles;
use super::foldover::FoldoverEnergy;
use super::lbfgs::{DescentEnergy, Lbfgs, StoppingRule};
use super::patches::{PatchEffort, repair_patches};
use super::polish::{Polish, PolishOutcome, PolishReport};
use super::quality::{invalid_cells, inverted_inside, scaled_jacobians};
use super::relax::{RelaxReport, Relaxation, RelaxationSurface};
use super::slide::{SlideReport, Sliding, SlidingSurface};
use super::split::{StuckNodes, split, stuck_simplices};
use super::start::better_start;
use crate::mesh::CellList;
use crate::progress::ProgressSender;
use crate::{Point, Vector};

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
/// The descent of hexahedra that are positive at all samples, and not between them; with this ε a step that inverts a sample
/// costs more than any gain.
const RAISING: StoppingRule = StoppingRule {
    iterations: 100,
    gain: 1e-6,
    until_positive: false,
};
const RAISING_EPSILON: f64 = 1e-9;
/// How often hexahedra are checked inside and repaired.
const MAX_INSIDE_CHECKS: usize = 10;

/// How cells are split and moved in turns, one stage after the other: with which effort, and whether the boundary is split,
/// too.
const SPLITTING_STAGES: [(PatchEffort, bool); 3] = [
    (PatchEffort::FAST, false),
    (PatchEffort::SLOW, false),
    (PatchEffort::FAST, true),
];
/// Largest part of the boundary's edges that are split before the boundary is tried unsplit.
const MOST_SPLIT_FIRST: f64 = 0.02;
/// Turns of splitting and moving, by any effort, without fewer inverted cells before giving up.
const MAX_STALLED_TURNS: usize = 3;

/// Scaled Jacobian below which a tetrahedron with all its nodes on the boundary is split although it is not inverted.
const FLAT: f64 = 1e-6;

/// How often the repair of a regular grid begins again, and how far inner nodes are displaced then, as a fraction of the
/// largest first step.
const MAX_RESTARTS: usize = 5;
const SHAKE: f64 = 0.5;
/// More inverted cells than this, and than a five-hundredth of all, are not left by chance.
const MOST_RESTARTED: usize = 20;

/// Where the repair began.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RepairStart {
    /// With the nodes as mapped.
    #[default]
    AsMapped,
    /// With the inner nodes by linear finite elements on these cells: of tetrahedra where that inverted fewer, and of any cells under
    /// another boundary map than the given one.
    FiniteElements,
}

/// How tetrahedra were split where moving nodes did not suffice.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize)]
pub struct SplitReport {
    /// Turns in which cells were split.
    pub turns: usize,
    /// Cells that splitting added.
    pub cells_added: usize,
}

/// What a repair did.
#[derive(Debug, Clone, Copy, PartialEq, Default, serde::Serialize)]
pub struct RepairReport {
    /// Where it began.
    pub start: RepairStart,
    /// Rounds of decreasing ε.
    pub rounds: usize,
    /// Iterations of descent in all rounds.
    pub iterations: usize,
    /// Iterations of descent of rounds, sliding and relaxation, each counted once for every cell that took part.
    pub work: u64,
    /// How often the repair of a regular grid began again, from inner nodes that were shaken, until the result that was
    /// kept; 0 for the first.
    pub restarts: usize,
    /// Whether cells stay inverted because [`RemeshOptions::effort`](super::RemeshOptions::effort) allowed no more work.
    pub exhausted: bool,
    /// How the boundary of a regular mesh of tetrahedra was split where it passed through itself.
    pub boundary_split: BoundarySplitReport,
    /// How tetrahedra were split.
    pub split: SplitReport,
    /// The improvement of shapes after the repair.
    pub polish: PolishReport,
    /// How boundary nodes slid on the target, where fixed ones left inverted cells.
    pub slide: SlideReport,
    /// How boundary nodes were relaxed, where boundary triangles passed through each other or sliding left inverted cells.
    pub relax: RelaxReport,
}

/// Rounds and iterations of descent in several patches, and their work: iterations times cells.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct DescentCounts {
    pub rounds: usize,
    pub iterations: usize,
    pub work: u64,
}

impl DescentCounts {
    pub fn add(&mut self, rounds: usize, iterations: usize, cells: usize) {
        self.rounds += rounds;
        self.iterations += iterations;
        self.work += iterations as u64 * cells as u64;
    }
}

/// ε of the next round, from the least determinant so far.
pub(crate) fn next_epsilon(epsilon: f64, least: f64) -> f64 {
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
    /// Gets the nodes and cells that splitting adds.
    pub mesh: &'a mut BoundedMesh,
    /// Images as mapped; new nodes get theirs, too.
    pub carried: &'a mut Vec<Point>,
    /// Signed volume of the image.
    pub volume: f64,
    /// Largest displacement of a node in a first step.
    pub step: f64,
    /// Largest number of tetrahedra that splitting may add.
    pub most_added: usize,
    /// Work after which a repair ends, successful or not. It is looked at between passes, which a single one exceeds.
    pub most_work: u64,
    /// Iterations of the polish.
    pub polish: usize,
    /// Whether meshes are polished in which nothing was inverted.
    pub polish_valid: bool,
    /// Whether all cells are polished, or only the lowest: of tetrahedra that are given, most are as good as they were.
    pub polish_all: bool,
    /// Images of points on the domain's surface, if edges of the boundary may be split.
    pub boundary_image: Option<BoundaryImage<'a>>,
    /// Whether much splitting at the boundary, too, comes before moving its nodes.
    pub splits_first: bool,
    /// Whether the mesh is a regular grid, whose boundary is relaxed where it passes through itself; a given boundary is no
    /// matter of the grid's.
    pub is_regular: bool,
    /// Seed of the displacements with which inner nodes start, if they are shaken.
    pub shaken: Option<u64>,
    /// The surface that boundary nodes may slide on, if they may.
    pub sliding_surface: Option<&'a SlidingSurface<'a>>,
    /// Receives rounds and inverted cells; asked in every iteration whether to continue.
    pub monitor: &'a ProgressSender<'a, (usize, usize)>,
}

impl Repair<'_> {
    /// Moves nodes from where they are mapped until no cell is inverted, or as few as possible; polishes the shapes if none
    /// is left. Returns the positions of the nodes.
    ///
    /// What is left of a regular grid on a target that is narrower than its cells is a few cells in a local minimum, and
    /// which, is chance: as long as the limit of work allows, the repair begins again from positions a little off.
    pub fn run(&mut self) -> (Vec<Point>, RepairReport) {
        if !self.is_regular || self.sliding_surface.is_none() {
            return self.split_or_not();
        }
        let start = (self.mesh.clone(), self.carried.clone());
        let (mut x, mut report) = self.split_or_not();
        let (mut bad, mut work, limit) = (self.bad(&x), report.work, self.most_work);
        for restart in 1..=MAX_RESTARTS {
            let is_hopeless = bad.0 > MOST_RESTARTED.max(self.mesh.cells.len() / 500);
            if bad == (0, 0) || is_hopeless || work >= limit || !self.monitor.should_continue() {
                break;
            }
            let before = (
                replace(self.mesh, start.0.clone()),
                replace(self.carried, start.1.clone()),
            );
            self.shaken = Some(restart as u64);
            self.most_work = limit - work;
            let (again, found) = self.split_or_not();
            work += found.work;
            let left = self.bad(&again);
            if left < bad {
                (x, report, bad) = (again, found, left);
                report.restarts = restart;
            } else {
                (*self.mesh, *self.carried) = before;
            }
        }
        report.work = work;
        report.exhausted = bad.0 > 0 && work >= limit;
        (x, report)
    }

    /// Repairs once. Where the boundary passes through itself both is tried, to split it and to leave it unsplit, unless the
    /// first is good; the better result stays.
    fn split_or_not(&mut self) -> (Vec<Point>, RepairReport) {
        let (boundary_split, unsplit) = self.refine_boundary();
        let Some(mut other) = unsplit else {
            return self.attempt(boundary_split);
        };
        let (mut first, mut second) = (boundary_split, boundary_split.undone());
        // Splitting that does not suffice, or much of it, is less likely to help than to take long.
        let most = MOST_SPLIT_FIRST * 1.5 * other.0.boundary.len() as f64;
        let is_much = boundary_split.edges as f64 > most && !self.splits_first;
        if boundary_split.crossings_after > 0 || is_much {
            swap(self.mesh, &mut other.0);
            swap(self.carried, &mut other.1);
            swap(&mut first, &mut second);
        }
        let (x, report) = self.attempt(first);
        let bad = self.bad(&x);
        if bad == (0, 0) || !self.monitor.should_continue() {
            return (x, report);
        }
        let attempted = (replace(self.mesh, other.0), replace(self.carried, other.1));
        let (x_again, mut again) = self.attempt(second);
        let work = report.work + again.work;
        if self.bad(&x_again) < bad {
            again.work = work;
            return (x_again, again);
        }
        (*self.mesh, *self.carried) = attempted;
        (x, RepairReport { work, ..report })
    }

    /// Splits the boundary where it passes through itself. Returns the mesh as it was, if anything was split.
    fn refine_boundary(&mut self) -> (BoundarySplitReport, Option<Unrefined>) {
        match self.boundary_refinement(&BoundarySplitReport::default(), &SplitReport::default()) {
            Some(mut refinement) => refinement.run(),
            None => Default::default(),
        }
    }

    fn boundary_refinement(
        &mut self,
        boundary: &BoundarySplitReport,
        inside: &SplitReport,
    ) -> Option<BoundaryRefinement<'_>> {
        Some(BoundaryRefinement {
            image: self.boundary_image?,
            // The rest is for the inside.
            most_added: (self.most_added / 2).min(self.room(boundary, inside) + boundary.cells_added),
            mesh: self.mesh,
            carried: self.carried,
            monitor: self.monitor,
        })
    }

    /// How many cells splitting may still add.
    fn room(&self, boundary: &BoundarySplitReport, inside: &SplitReport) -> usize {
        self.most_added
            .saturating_sub(boundary.cells_added + inside.cells_added)
    }

    /// Inverted cells and pairs of boundary triangles that pass through each other.
    fn bad(&self, x: &[Point]) -> (usize, usize) {
        (self.invalid(x), crossing_triangles(&self.mesh.boundary, x).len())
    }

    /// The repair and the polish, once the boundary does not pass through itself or cannot be helped.
    fn attempt(&mut self, boundary_split: BoundarySplitReport) -> (Vec<Point>, RepairReport) {
        let mut report = RepairReport {
            boundary_split,
            ..RepairReport::default()
        };
        let mut x = self.carried.clone();
        let inverted = self.invalid(&x);
        let _ = self.monitor.send((0, inverted));
        let anything_inverted = inverted > 0;
        let can_be_split = anything_inverted && matches!(self.mesh.cells, CellList::Tets(_));
        let as_mapped = can_be_split.then(|| (self.mesh.clone(), self.carried.clone()));
        let all_repaired = !(anything_inverted || self.faulty_crossings(&x))
            || match self.mesh.cells {
                CellList::Tets(_) => self.untangle_tets(&mut x, &mut report),
                CellList::Hexes(_) => self.untangle_hexes(&mut x, &mut report),
            };
        // Splitting multiplies cells that cannot be repaired.
        if let (false, Some(as_mapped)) = (all_repaired, as_mapped)
            && self.invalid(&x) > inverted
        {
            (*self.mesh, *self.carried) = as_mapped;
            x.clone_from(self.carried);
            report.split = SplitReport::default();
        }
        report.exhausted = !all_repaired && report.work >= self.most_work;
        report.polish = if self.polish == 0 {
            PolishReport::default()
        } else if !all_repaired {
            PolishOutcome::CellsInverted.into()
        } else if !anything_inverted && !self.polish_valid {
            PolishOutcome::NothingInverted.into()
        } else {
            Polish {
                mesh: self.mesh,
                free: &self.inner_nodes(),
                is_regular: self.is_regular,
                all_cells: self.polish_all,
                of_repair: &|| self.energy_of_all(),
                iterations: self.polish,
                step: self.step,
                carried: self.carried,
                sliding_surface: self.sliding_surface,
                monitor: self.monitor,
            }
            .run(&mut x)
        };
        (x, report)
    }

    /// Displaces inner nodes at random, if a seed is set.
    fn shake(&self, x: &mut [Point]) {
        let Some(seed) = self.shaken else { return };
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        for v in self.inner_nodes() {
            x[v as usize] += Vector::from_fn(|_, _| random.random_range(-SHAKE..SHAKE)) * self.step;
        }
    }

    fn inner_nodes(&self) -> Vec<u32> {
        let nodes = 0..self.mesh.nodes.len() as u32;
        nodes.filter(|&v| !self.mesh.on_boundary[v as usize]).collect()
    }

    /// Invalid cells, and pairs of boundary triangles that pass through each other.
    fn faults(&self, x: &[Point]) -> usize {
        self.invalid(x) + crossing_triangles(&self.mesh.boundary, x).len()
    }

    /// Whether neither the caller nor the limit of effort ends the repair.
    fn may_go_on(&self, report: &RepairReport) -> bool {
        self.monitor.should_continue() && report.work < self.most_work
    }

    /// How many cells are invalid, exactly.
    fn invalid(&self, x: &[Point]) -> usize {
        invalid_cells(&self.mesh.cells, x).cells.len()
    }

    /// Whether no cell is inverted afterwards. Nodes near inverted cells move; then boundary nodes slide; then cells are split
    /// where nodes are stuck, in turns with moving them; what is left is relaxed.
    fn untangle_tets(&mut self, x: &mut Vec<Point>, report: &mut RepairReport) -> bool {
        if let Some(better) = better_start(self.mesh, x) {
            *x = better;
            report.start = RepairStart::FiniteElements;
        }
        self.shake(x);
        // Nothing else can help cells without inner nodes, nor make flat ones better.
        self.split_stuck(x, StuckNodes::OnBoundary, report);
        let must_be_simple = self.faulty_crossings(x);
        self.move_patches(x, &PatchEffort::FAST, report);
        // A boundary that was split follows the target, and does not need to slide.
        if report.boundary_split.turns == 0 && self.sliding_surface.is_some() && self.invalid(x) > 0 {
            self.slide(x, report);
            self.move_patches(x, &PatchEffort::FAST, report);
        }
        // Sliding moves nodes less than relaxation does.
        if must_be_simple && (self.invalid(x) > 0 || self.faulty_crossings(x)) {
            self.relax_boundary(x, true, report);
            self.move_patches(x, &PatchEffort::FAST, report);
        }
        self.move_patches(x, &PatchEffort::SLOW, report);
        let all_right = self.split_and_move(x, report);
        if all_right && !self.faulty_crossings(x) {
            return true;
        }
        let helps = self.relax_boundary(x, true, report);
        if helps {
            self.split_and_move(x, report)
        } else {
            all_right
        }
    }

    /// Whether no cell is inverted afterwards. Cells are split where nodes are stuck, in turns with moving them.
    fn split_and_move(&mut self, x: &mut Vec<Point>, report: &mut RepairReport) -> bool {
        let left = self.invalid(x);
        if left == 0 {
            return true;
        }
        let unsplit = (self.mesh.clone(), self.carried.clone(), x.clone(), *report);
        let mut least = left;
        for (effort, splits_boundary) in SPLITTING_STAGES {
            let mut stalled = 0;
            while stalled < MAX_STALLED_TURNS && self.may_go_on(report) {
                let outside = splits_boundary && self.split_boundary_at_stuck(x, report);
                let any_split = self.split_stuck(x, StuckNodes::All, report) || outside;
                self.move_patches(x, &effort, report);
                let inverted = self.invalid(x);
                if inverted == 0 {
                    return true;
                }
                if inverted >= least && !any_split {
                    break;
                }
                stalled = if inverted < least { 0 } else { stalled + 1 };
                least = least.min(inverted);
            }
        }
        if self.invalid(x) >= left {
            let (rounds, iterations, work) = (report.rounds, report.iterations, report.work);
            (*self.mesh, *self.carried, *x, *report) = unsplit;
            (report.rounds, report.iterations, report.work) = (rounds, iterations, work);
        }
        false
    }

    /// Splits boundary triangles of the cells at the inner nodes of inverted cells: images of points between their corners
    /// may leave more room. Whether any was split.
    fn split_boundary_at_stuck(&mut self, x: &mut Vec<Point>, report: &mut RepairReport) -> bool {
        let inverted = invalid_cells(&self.mesh.cells, x).cells;
        let triangles = boundary_at_stuck(self.mesh, &inverted);
        let (mut boundary, inside) = (report.boundary_split, report.split);
        let before = boundary.edges;
        if let Some(mut refinement) = self.boundary_refinement(&boundary, &inside) {
            refinement.split(triangles, &mut boundary);
        }
        report.boundary_split = boundary;
        x.extend(&self.carried[x.len()..]);
        boundary.edges > before
    }

    /// Relaxes the boundary, if it may move, where its triangles pass through each other and, if `cells` says so, near
    /// invalid cells. Returns whether that helped.
    fn relax_boundary(&self, x: &mut Vec<Point>, cells: bool, report: &mut RepairReport) -> bool {
        let Some(sliding_surface) = self.sliding_surface else {
            return false;
        };
        let relaxation = Relaxation {
            mesh: self.mesh,
            anchors: self.carried,
            surface: &RelaxationSurface::new(sliding_surface.target, &sliding_surface.query),
            monitor: self.monitor,
        };
        let room = self.most_work.saturating_sub(report.work);
        let (helped, work) = relaxation.run(x, cells, room, &mut report.relax);
        report.work += work;
        helped
    }

    /// Slides boundary nodes near inverted cells, if they may.
    fn slide(&self, x: &mut Vec<Point>, report: &mut RepairReport) {
        if let Some(sliding_surface) = self.sliding_surface {
            let cells = self.mesh.cells.len() as u64;
            let sliding = Sliding {
                energy: &self.energy_of_all(),
                step: self.step,
                surface: sliding_surface,
                on_boundary: &self.mesh.on_boundary,
                most_iterations: self.most_work.saturating_sub(report.work).div_ceil(cells.max(1)) as usize,
                monitor: self.monitor,
            };
            report.slide = sliding.run(x);
            report.work += report.slide.iterations as u64 * cells;
        }
    }

    /// Whether boundary triangles of a regular grid pass through each other, and may move.
    fn faulty_crossings(&self, x: &[Point]) -> bool {
        self.is_regular && self.sliding_surface.is_some() && !crossing_triangles(&self.mesh.boundary, x).is_empty()
    }

    fn move_patches(&self, x: &mut [Point], effort: &PatchEffort, report: &mut RepairReport) {
        for &rings in effort.rings {
            let left = self.invalid(x);
            let _ = self.monitor.send((report.rounds, left));
            if left == 0 || !self.may_go_on(report) {
                return;
            }
            let counts = repair_patches(self.mesh, x, rings, effort, self.monitor);
            report.rounds += counts.rounds;
            report.iterations += counts.iterations;
            report.work += counts.work;
        }
    }

    /// Whether any cell was split.
    fn split_stuck(&mut self, x: &mut Vec<Point>, stuck: StuckNodes, report: &mut RepairReport) -> bool {
        let mut cells = invalid_cells(&self.mesh.cells, x).cells;
        if stuck == StuckNodes::OnBoundary {
            let scaled = scaled_jacobians(&self.mesh.cells, x);
            cells.extend((0..).zip(scaled).filter(|(_, s)| s.abs() < FLAT).map(|(cell, _)| cell));
        }
        let simplices = stuck_simplices(self.mesh, &cells, stuck);
        let room = self.room(&report.boundary_split, &report.split);
        let added = split(self.mesh, &mut [x, self.carried], simplices, room);
        report.split.turns += usize::from(added > 0);
        report.split.cells_added += added;
        added > 0
    }

    /// Whether no cell is inverted at a corner afterwards.
    fn untangle_hexes(&self, x: &mut Vec<Point>, report: &mut RepairReport) -> bool {
        let free = self.inner_nodes();
        self.shake(x);
        let mut energy = self.energy_of_all();
        let must_be_simple = self.faulty_crossings(x);
        let mut left = self.untangle(&energy, &free, x, report);
        if left > 0 || must_be_simple {
            // Sliding is stiffer, and moves nodes less.
            let untangled = x.clone();
            self.slide(x, report);
            if self.invalid(x) > 0 || self.faulty_crossings(x) {
                self.relax_boundary(x, true, report);
            }
            let faults = self.faults(x);
            if must_be_simple && faults > 0 {
                let mut other = untangled;
                let mut relaxed = RepairReport {
                    slide: SlideReport::default(),
                    relax: RelaxReport::default(),
                    ..*report
                };
                self.relax_boundary(&mut other, true, &mut relaxed);
                if self.faults(&other) < faults {
                    (*x, *report) = (other, relaxed);
                }
            }
            left = energy.inverted(x).len();
        }
        if left > 0 {
            return false;
        }
        // Hexahedra that the energy is evaluated inside, too.
        let mut inside = Vec::new();
        for _ in 0..MAX_INSIDE_CHECKS {
            let bad = inverted_inside(&self.mesh.cells, x);
            if bad.is_empty() || !self.monitor.should_continue() {
                break;
            }
            inside.extend(&bad);
            energy.check_inside(&inside);
            if energy.inverted(x).is_empty() {
                // Positive at all samples, and not between them.
                if !self.raise_hexes(&energy, &free, x, bad.len(), report) {
                    break;
                }
            } else {
                self.untangle(&energy, &free, x, report);
            }
        }
        energy.inverted(x).is_empty()
    }

    /// Lowers the energy of a mesh that is positive at all samples, and keeps that if fewer than `bad` hexahedra are left
    /// that are not positive everywhere. Whether there are.
    fn raise_hexes(
        &self,
        energy: &FoldoverEnergy,
        free: &[u32],
        x: &mut Vec<Point>,
        bad: usize,
        report: &mut RepairReport,
    ) -> bool {
        let mut moved = x.clone();
        let mut descent = Lbfgs::new(energy, free, self.step, self.monitor);
        let (_, iterations) = descent.run(&mut moved, RAISING_EPSILON, &RAISING);
        report.rounds += 1;
        report.iterations += iterations;
        report.work += iterations as u64 * self.mesh.cells.len() as u64;
        let helps = self.invalid(&moved) < bad;
        if helps {
            *x = moved;
        }
        helps
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
    fn untangle(&self, energy: &FoldoverEnergy, free: &[u32], x: &mut Vec<Point>, report: &mut RepairReport) -> usize {
        let start = energy.evaluate(x, 1.0, &[], &mut vec![], &mut []);
        let (mut least, mut inverted) = (start.least, start.inverted);
        let mut descent = Lbfgs::new(energy, free, self.step, self.monitor);
        let mut best = Best::new(inverted, x);
        let mut epsilon = 1.0;
        for round in 0..MAX_ROUNDS {
            if inverted == 0 || free.is_empty() || best.stalled == MAX_STALLED {
                break;
            }
            if round > 0 {
                epsilon = next_epsilon(epsilon, least);
            }
            let (value, iterations) = descent.run(x, epsilon, &ROUND);
            report.rounds += 1;
            report.iterations += iterations;
            report.work += iterations as u64 * self.mesh.cells.len() as u64;
            (least, inverted) = (value.least, value.inverted);
            best.update(inverted, x);
            let _ = self.monitor.send((report.rounds, value.inverted_cells));
            if !value.energy.is_finite() || !self.may_go_on(report) {
                break;
            }
        }
        *x = best.nodes;
        best.inverted
    }
}

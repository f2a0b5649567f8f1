//! Improvement of the shapes of cells, once none is inverted: descent of the energy relative to cells of their own
//! sizes. The energy is not what shapes are judged by, and what lowers it may flatten single cells. Neither the least
//! scaled Jacobian nor its 1 % quantile may fall, so that both are measured along the way. Hexahedra have a polish of their
//! own, in which boundary nodes slide ([`HexPolish`]).

use super::bounded_mesh::BoundedMesh;
use super::foldover::FoldoverEnergy;
use super::hex_polish::HexPolish;
use super::lbfgs::{Lbfgs, StoppingRule};
use super::own_size::{OwnShape, own_size_energy};
use super::patches::raise_lowest;
use super::quality::{invalid_cells, scaled_jacobians};
use super::slide::SlidingSurface;
use crate::Point;
use crate::mesh::CellList;
use crate::progress::ProgressSender;
use crate::statistics::quantiles;

/// ε of the polish: a step that inverts a sample costs more than any gain.
const EPSILON: f64 = 1e-9;
/// Relative decrease of the energy below which the polish stops.
const GAIN: f64 = 1e-6;
/// Iterations between two measurements of the quality.
const CHECK_EVERY: usize = 10;
/// Iterations after which a descent ends that has found nothing more to keep.
const PATIENCE: usize = 60;

/// The least scaled Jacobian of hexahedra that are left as they are, and below which they are polished without regard to feature curves,
/// too.
const GOOD: f64 = 0.99;
const POOR: f64 = 0.1;

/// How often the lowest tetrahedra are raised at most, and the ratio by which one of both measures has to rise for another
/// time.
const MAX_RAISES: usize = 12;
const WORTH_RAISING: f64 = 1.05;
/// In how many runs the descents that raise them are made: if one number does not help any more, the next.
const RAISING_RUNS: [usize; 2] = [3, 1];

/// What became of the polish.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum PolishOutcome {
    /// None was asked for.
    #[default]
    NotAsked,
    /// Nothing was inverted as mapped, and a polish of such meshes was not asked for.
    NothingInverted,
    /// Cells stay inverted.
    CellsInverted,
    /// No node can be moved to a better place.
    NoGain,
    /// The cells' shapes are better.
    Kept,
    /// It would have lowered the least scaled Jacobian or its 1 % quantile, and was undone.
    Undone,
}

/// The polish.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize)]
pub struct PolishReport {
    /// What became of it.
    pub outcome: PolishOutcome,
    /// Iterations of descent.
    pub iterations: usize,
    /// How many of them led to the result; 0 unless it was kept.
    pub kept_iterations: usize,
}

impl From<PolishOutcome> for PolishReport {
    fn from(outcome: PolishOutcome) -> Self {
        Self {
            outcome,
            ..Self::default()
        }
    }
}

/// What a polish may not make worse: the number of invalid cells, the least scaled Jacobian and its 1 % quantile.
#[derive(Debug, Clone, Copy)]
pub(super) struct Floor {
    pub invalid: usize,
    pub least: f64,
    pub p01: f64,
}

impl Floor {
    pub fn of(mesh: &BoundedMesh, x: &[Point]) -> Self {
        let [least, p01] = lowest(mesh, x);
        Self {
            invalid: invalid_cells(&mesh.cells, x).cells.len(),
            least,
            p01,
        }
    }

    /// What of two meshes the better one has more of.
    pub fn rating(&self) -> f64 {
        self.least * self.p01
    }

    /// The measures of a mesh that is no worse.
    pub fn raised(&self, mesh: &BoundedMesh, x: &[Point]) -> Option<Self> {
        let [least, p01] = lowest(mesh, x);
        // Written so that NaN is worse.
        if !(least >= self.least && p01 >= self.p01) {
            return None;
        }
        let invalid = invalid_cells(&mesh.cells, x).cells.len();
        (invalid <= self.invalid).then_some(Self { invalid, least, p01 })
    }
}

/// The least scaled Jacobian and its 1 % quantile; NaN where one is.
fn lowest(mesh: &BoundedMesh, x: &[Point]) -> [f64; 2] {
    let scaled = scaled_jacobians(&mesh.cells, x);
    if scaled.iter().any(|s| s.is_nan()) {
        return [f64::NAN; 2];
    }
    quantiles(&scaled, [0.0, 0.01]).unwrap_or([f64::NAN; 2])
}

/// What a polish works on.
pub(super) struct Polish<'a> {
    pub mesh: &'a BoundedMesh,
    /// Inner nodes.
    pub free: &'a [u32],
    /// Whether it is a regular mesh, whose boundary nodes may slide and whose cells are to be near cubes.
    pub is_regular: bool,
    /// Whether all tetrahedra are polished, or only the lowest.
    pub all_cells: bool,
    /// The energy of the repair.
    pub of_repair: &'a dyn Fn() -> FoldoverEnergy,
    /// Largest number of iterations of each pass.
    pub iterations: usize,
    /// Where the boundary map sends boundary nodes.
    pub carried: &'a [Point],
    /// The surface that boundary nodes of hexahedra slide on, if they may.
    pub sliding_surface: Option<&'a SlidingSurface<'a>>,
    /// Largest displacement of a node in a first step.
    pub step: f64,
    pub monitor: &'a ProgressSender<'a, (usize, usize)>,
}

/// What cells are to be like.
#[derive(Debug, Clone, Copy)]
enum PolishReference {
    /// Cells of their own sizes.
    Own(OwnShape),
    /// Those of the repair, which are as large everywhere as they are in the domain.
    OfRepair,
}

/// In the order in which they are tried. The first leaves a good mesh much as it is; the others are for meshes that the
/// map or the repair has left with sizes that are no good as targets.
const REFERENCES: [PolishReference; 3] = [
    PolishReference::Own(OwnShape::Given),
    PolishReference::OfRepair,
    PolishReference::Own(OwnShape::Regular),
];

impl Polish<'_> {
    /// Polishes all cells, if they are asked for, and then those at the low end of the scaled Jacobian. After each pass the
    /// last positions are kept that are no worse than those before it.
    pub fn run(&self, x: &mut [Point]) -> PolishReport {
        let mut report = PolishReport::default();
        if matches!(self.mesh.cells, CellList::Hexes(_)) {
            self.polish_hexes(x, &mut report);
        } else {
            self.polish_tets(x, &mut report);
        }
        report.outcome = match (report.iterations, report.kept_iterations) {
            (0, _) => PolishOutcome::NoGain,
            (_, 0) => PolishOutcome::Undone,
            _ => PolishOutcome::Kept,
        };
        report
    }

    /// Lets boundary nodes slide, and leaves them where they are if that is no better.
    fn polish_hexes(&self, x: &mut [Point], report: &mut PolishReport) {
        // A given mesh has the shapes that it was made with, such as thin cells along a wall.
        let (shape, surface) = if self.is_regular {
            (OwnShape::Imaged, self.sliding_surface)
        } else {
            (OwnShape::Given, None)
        };
        let polish = |surface| HexPolish::new(self.mesh, self.carried, surface, shape, self.iterations, self.monitor);
        let start = x.to_vec();
        if lowest(self.mesh, x)[0] >= GOOD {
            return;
        }
        let mut with_features = polish(surface);
        with_features.run(x, report);
        // Where feature curves cross the cells, these may be better if nothing draws them there.
        let least = lowest(self.mesh, x)[0];
        if with_features.leave_features() && least < POOR && self.monitor.should_continue() {
            let (mut other, mut of_other) = (start, PolishReport::default());
            with_features.run(&mut other, &mut of_other);
            report.iterations += of_other.iterations;
            if lowest(self.mesh, &other)[0] > least {
                x.copy_from_slice(&other);
                report.kept_iterations = of_other.kept_iterations;
            }
        }
        if report.kept_iterations == 0 && surface.is_some() {
            polish(None).run(x, report);
        }
    }

    fn polish_tets(&self, x: &mut [Point], report: &mut PolishReport) {
        let mut floor = Floor::of(self.mesh, x);
        let references: &[PolishReference] = if self.all_cells { &REFERENCES } else { &[] };
        for reference in references {
            let energy = match reference {
                PolishReference::Own(shape) => own_size_energy(self.mesh, x, *shape, None),
                PolishReference::OfRepair => (self.of_repair)(),
            };
            if self.pass(&energy, self.free, x, &mut floor, report) {
                break;
            }
        }
        self.raise_lowest(x, &mut floor, report);
    }

    /// Raises the tetrahedra below the 1 % quantile in patches of their own, again and again as long as that helps.
    fn raise_lowest(&self, x: &mut [Point], floor: &mut Floor, report: &mut PolishReport) {
        let mut runs = RAISING_RUNS.into_iter();
        let mut next = runs.next();
        for _ in 0..MAX_RAISES {
            let Some(in_runs) = next else { break };
            if !self.monitor.should_continue() {
                break;
            }
            let scaled = scaled_jacobians(&self.mesh.cells, x);
            let low = (0..).zip(&scaled).filter(|(_, s)| **s <= floor.p01);
            let low: Vec<u32> = low.map(|(cell, _)| cell).collect();
            // The quantile is between these two.
            let mut ascending = scaled.clone();
            ascending.sort_unstable_by(f64::total_cmp);
            let rank = low.len().min(ascending.len() - 1);
            let bounds = [ascending[rank.saturating_sub(1)], ascending[rank]];
            let mut raised = x.to_vec();
            let (iterations, kept) = raise_lowest(
                self.mesh,
                &mut raised,
                &low,
                bounds,
                self.iterations,
                in_runs,
                self.monitor,
            );
            report.iterations += iterations;
            let before = *floor;
            if let Some(found) = floor.raised(self.mesh, &raised) {
                report.kept_iterations += kept;
                x.copy_from_slice(&raised);
                *floor = found;
            }
            if !(floor.least > WORTH_RAISING * before.least || floor.p01 > WORTH_RAISING * before.p01) {
                next = runs.next();
            }
        }
    }

    /// One descent; whether most of it was kept.
    fn pass(
        &self,
        energy: &FoldoverEnergy,
        free: &[u32],
        x: &mut [Point],
        floor: &mut Floor,
        report: &mut PolishReport,
    ) -> bool {
        if free.is_empty() || !self.monitor.should_continue() {
            return false;
        }
        let rule = StoppingRule {
            iterations: self.iterations,
            gain: GAIN,
            until_positive: false,
        };
        let (mut moved, start) = (x.to_vec(), *floor);
        let mut kept_iterations = 0;
        let mut keep = |iterations: usize, at: &[Point]| {
            if let Some(found) = start.raised(self.mesh, at) {
                (kept_iterations, *floor) = (iterations, found);
                x.copy_from_slice(at);
            }
            iterations < kept_iterations + PATIENCE
        };
        let mut descent = Lbfgs::new(energy, free, self.step, self.monitor);
        let (_, iterations) = descent.run_watched(&mut moved, EPSILON, &rule, &mut |iterations, at| {
            iterations % CHECK_EVERY != 0 || keep(iterations, at)
        });
        if iterations % CHECK_EVERY != 0 {
            keep(iterations, &moved);
        }
        report.iterations += iterations;
        report.kept_iterations += kept_iterations;
        kept_iterations > iterations / 2
    }
}

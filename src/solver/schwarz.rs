//! Large least-squares systems: flexible Krylov iterations in the space of the data, preconditioned level by level by
//! local least-squares solves.
//!
//! Levels go from coarse to fine. The coarsest has the affine functions and is solved densely; every other level is
//! divided into overlapping [patches](super::patches). An iteration makes one correction by all coarse levels, each on
//! the residual that those before it leave, and then one by each finer level; the residual is minimised over each
//! correction and all before. The sources of all levels are unknowns of the same system and stay in the map. No dense
//! matrix grows with the number of sources: patches have a fixed size, and enough levels keep the coarsest small.

mod corrections;

use std::ops::ControlFlow;

use super::krylov::Gcr;
use super::patches::Patches;
use super::{BasisModes, CollocationSystem, DenseFactor, DenseOptions, SolveError, Values};
use crate::Point;
use crate::kernel::Sums;
use crate::progress::ProgressResponse;

/// Sources of one spacing, and the equations that they are fitted to.
#[derive(Debug, Clone, Default)]
pub struct Level {
    /// Positions outside the solid.
    pub sources: Vec<Point>,
    /// Local spacing of each source.
    pub spacing: Vec<f64>,
    /// Collocation points of this level, as indices into those of the whole system.
    pub rows: Vec<u32>,
    /// For each of `rows`, the source of this level it belongs to, or [`Level::NO_OWNER`].
    pub owner: Vec<u32>,
    /// For each of `rows`, the area it stands for.
    pub weights: Vec<f64>,
}

impl Level {
    /// In `owner`: a row that belongs to no source, as where a source could not be placed. It is in no patch.
    pub const NO_OWNER: u32 = u32::MAX;
}

/// Options of [`SchwarzFactor`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SchwarzOptions {
    /// Sources in the core of a patch.
    pub core: usize,
    /// Reach of a patch beyond its core, in local spacings.
    pub overlap: f64,
    /// Iterations within a coarse correction, on the rows of the coarse level.
    pub coarse_iterations: usize,
    /// The iterations end at a plateau, within a few percent of the least-squares optimum, when the latest correction
    /// by every group of levels leaves more than this fraction of the residual.
    pub plateau: f64,
    /// The same for the latest correction by the finest level alone, from the second iteration on.
    pub finest_plateau: f64,
    /// Maximal number of iterations.
    pub most_iterations: usize,
    /// Relative accuracy of the sums for the first correction, which removes most of the residual.
    pub first_accuracy: f64,
    /// Relative accuracy of the sums for later corrections, which are small.
    pub later_accuracy: f64,
}

impl Default for SchwarzOptions {
    fn default() -> Self {
        Self {
            core: 80,
            overlap: 4.0,
            coarse_iterations: 2,
            plateau: 0.85,
            finest_plateau: 0.93,
            most_iterations: 20,
            first_accuracy: 1e-6,
            later_accuracy: 1e-4,
        }
    }
}

/// Relative accuracy of the reported residual.
const FINAL_ACCURACY: f64 = 0.02;
/// Best accuracy of any sum: residuals of affine data vanish, and would call for any accuracy at any cost.
const BEST_ACCURACY: f64 = 1e-12;
/// Fraction of the residual by which the updated residual may be wrong before it is recomputed.
const DRIFT: f64 = 0.02;

/// Rows times sources up to which a system is polished: sums over them cost a few hundredths of a second.
const POLISHED_PAIRS: usize = 100_000_000;
/// Polishing ends when an iteration leaves more than this fraction of the residual.
const POLISHED: f64 = 0.99;

/// Why the iterations ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum SchwarzStop {
    /// The residual reached the goal.
    Goal,
    /// The residual hardly fell any more: it is within a few percent of the optimum's.
    Plateau,
    /// The number of iterations allowed was used up.
    Iterations,
}

/// The coefficients, and how they were found.
#[derive(Debug, Clone)]
pub struct Solution {
    /// A row per source, level after level, then four rows for the functions 1, x, y, z if the basis has them.
    pub coefficients: Values,
    /// Data minus the map's values, a row per collocation point. Updated from correction to correction: accurate to a
    /// few percent of its norm.
    pub residual: Values,
    /// Number of iterations.
    pub iterations: usize,
    /// Weighted root mean square of the residual over all columns before the first iteration and after each; the last
    /// may have corrected some levels only. Accurate to a percent or so.
    pub history: Vec<f64>,
    /// Why they ended.
    pub stop: SchwarzStop,
}

/// A factored system, for any number of right-hand sides.
pub struct SchwarzFactor {
    collocation: Vec<Point>,
    /// The surface area that each collocation point stands for.
    weights: Vec<f64>,
    levels: Vec<FactoredLevel>,
    /// Levels that are corrected together, as ranges of `levels`.
    groups: Vec<LevelGroup>,
    affine: bool,
    options: SchwarzOptions,
}

struct FactoredLevel {
    sources: usize,
    /// Among all collocation points.
    rows: Vec<u32>,
    weights: Vec<f64>,
    solver: LevelSolver,
}

impl FactoredLevel {
    fn new(level: &Level, solver: LevelSolver) -> Self {
        Self {
            sources: level.sources.len(),
            rows: level.rows.clone(),
            weights: level.weights.clone(),
            solver,
        }
    }
}

enum LevelSolver {
    Dense(Box<DenseFactor>),
    Patches(Patches),
}

/// Levels that are corrected together; all but the first group are one level each.
struct LevelGroup {
    first: usize,
    sources: Vec<Point>,
    /// For each level but the first.
    steps: Vec<CoarseStep>,
    to_collocation: Sums,
}

/// What iterations on the rows of a coarse level need; all coarse levels but the coarsest have one.
struct CoarseStep {
    /// The rows of the next coarser level, as indices into this level's.
    coarser_rows: Vec<u32>,
    from_coarser: Sums,
    from_own: Sums,
}

impl SchwarzFactor {
    /// Factors the levels, coarse to fine; the last has the spacing that the map is to resolve. `weights` are the
    /// surface areas that the collocation points stand for. `progress` is called with the number of patches factored,
    /// and of all.
    ///
    /// # Errors
    ///
    /// When the coarsest level has fewer rows than unknowns, a matrix entry is not finite, or `progress` ends it.
    pub fn new<A: ProgressResponse>(
        collocation: Vec<Point>,
        weights: Vec<f64>,
        levels: &[Level],
        affine: bool,
        options: &SchwarzOptions,
        progress: &dyn Fn(usize, usize) -> A,
    ) -> Result<Self, SolveError> {
        let mut factor = Self {
            collocation,
            weights,
            levels: Vec::new(),
            groups: Vec::new(),
            affine,
            options: *options,
        };
        let coarsest = levels.first().ok_or(SolveError::Underdetermined {
            collocation: factor.collocation.len(),
            unknowns: 0,
            sources: 0,
        })?;
        factor.levels.push(factor.dense_level(coarsest)?);
        for level in &levels[1..] {
            factor.levels.push(factor.patches(level, progress)?);
        }
        let coarse = levels.len().saturating_sub(1).max(1);
        factor.add_group(&levels[..coarse], 0)?;
        if levels.len() > 1 {
            factor.add_group(&levels[coarse..], coarse)?;
        }
        Ok(factor)
    }

    /// Number of matrix entries that the patches of these levels will keep, counted without factoring any.
    pub fn patch_entries(levels: &[Level], options: &SchwarzOptions) -> u64 {
        let entries = |level| Patches::count_entries(level, options.core, options.overlap);
        levels.iter().map(entries).sum()
    }

    /// Adds collocation points and a finer level, whose rows may be among old and new points. Solutions for the levels
    /// before remain valid starts.
    ///
    /// # Errors
    ///
    /// As [`Self::new`].
    pub fn refine<A: ProgressResponse>(
        &mut self,
        collocation: &[Point],
        weights: &[f64],
        level: &Level,
        progress: &dyn Fn(usize, usize) -> A,
    ) -> Result<(), SolveError> {
        let rows = self.collocation.len();
        self.collocation.extend_from_slice(collocation);
        self.weights.extend_from_slice(weights);
        match self.patches(level, progress) {
            Ok(patches) => self.levels.push(patches),
            Err(error) => {
                self.collocation.truncate(rows);
                self.weights.truncate(rows);
                return Err(error);
            }
        }
        for group in &mut self.groups {
            group.to_collocation = sums(&group.sources, &self.collocation, &self.options)?;
        }
        self.add_group(std::slice::from_ref(level), self.levels.len() - 1)
    }

    /// Number of sources of all levels.
    pub fn sources(&self) -> usize {
        self.levels.iter().map(|level| level.sources).sum()
    }

    /// The basis modes of data at the collocation points: see [`BasisModes::of`].
    pub fn modes_of(&self, data: &Values, truncation: f64) -> Option<(Values, BasisModes)> {
        BasisModes::of(data, &self.collocation, &self.weights, self.affine, truncation)
    }

    /// Positions of the collocation points.
    pub fn collocation(&self) -> &[Point] {
        &self.collocation
    }

    /// The surface area that each collocation point stands for.
    pub fn weights(&self) -> &[f64] {
        &self.weights
    }

    /// Number of collocation points.
    pub fn rows(&self) -> usize {
        self.collocation.len()
    }

    /// The coefficients for boundary values `data`, a row per collocation point and any number of columns, which share
    /// every kernel value. Starts at `start` if given, where rows of the latest levels may be missing. Ends when the
    /// root mean square of the residual is below `goal` in every column, or hardly falls any more. `progress` is called
    /// with the number of iterations and the residual, several times in each iteration.
    ///
    /// # Errors
    ///
    /// [`SolveError::DataLength`], [`SolveError::Sum`], and [`SolveError::Cancelled`] when `progress` ends it.
    pub fn solve<A: ProgressResponse>(
        &self,
        data: &Values,
        start: Option<&Values>,
        goal: f64,
        progress: &dyn Fn(usize, f64) -> A,
    ) -> Result<Solution, SolveError> {
        let progress = &|iterations, residual| match progress(iterations, residual).control_flow() {
            ControlFlow::Continue(()) => Ok(()),
            ControlFlow::Break(()) => Err(SolveError::Cancelled),
        };
        if data.rows() != self.collocation.len() {
            return Err(SolveError::DataLength {
                data: data.rows(),
                collocation: self.collocation.len(),
            });
        }
        let (solution, residual) = match start {
            Some(start) => {
                let start = self.extended(start);
                let residual = self.residual(data, &start, self.options.first_accuracy)?;
                (start, residual)
            }
            None => (Values::zeros(self.unknowns(), data.columns()), data.clone()),
        };
        let area: f64 = self.weights.iter().sum();
        let mut gcr = Gcr::new(&self.weights, residual, solution);
        let rms = |squares: &[f64]| (squares.iter().sum::<f64>() / area).sqrt();
        let reached = |squares: &[f64]| squares.iter().all(|s| (s / area).sqrt() <= goal);
        let mut history = vec![rms(&gcr.squares())];
        // Residuals before and after each correction, since the latest restart.
        let mut trace = history.clone();
        let mut refreshed = false;
        let mut next = 0;
        let stop = loop {
            let latest = trace[trace.len() - 1];
            let stop = if reached(&gcr.squares()) {
                Some(SchwarzStop::Goal)
            } else if self.is_plateau(&trace) {
                Some(SchwarzStop::Plateau)
            } else {
                (history.len() > self.options.most_iterations).then_some(SchwarzStop::Iterations)
            };
            if let Some(stop) = stop {
                // The sums are rough, and the updated residual drifts from the true one.
                let drift = self.options.first_accuracy * trace[0]
                    + self.options.later_accuracy * trace[1..].iter().sum::<f64>();
                if drift <= DRIFT * latest || refreshed || stop == SchwarzStop::Iterations {
                    break stop;
                }
                progress(history.len() - 1, latest)?;
                let accuracy = FINAL_ACCURACY * latest / history[0];
                let accuracy = accuracy.clamp(BEST_ACCURACY, self.options.first_accuracy.max(BEST_ACCURACY));
                gcr.restart(self.residual(data, &gcr.solution, accuracy)?);
                refreshed = true;
                trace = vec![rms(&gcr.squares())];
                if trace[0] <= (1.0 + 10.0 * DRIFT) * latest {
                    break stop;
                }
            }
            progress(history.len() - 1, latest)?;
            let group = &self.groups[next];
            let is_first = trace.len() == 1 && history.len() == 1 && start.is_none();
            let accuracy = if is_first {
                self.options.first_accuracy
            } else {
                self.options.later_accuracy
            };
            let step = self.correction(group, &gcr.residual, accuracy)?;
            progress(history.len() - 1, latest)?;
            let image = self.image(group, &step, accuracy)?;
            gcr.advance(step, image);
            trace.push(rms(&gcr.squares()));
            next = (next + 1) % self.groups.len();
            if next == 0 {
                history.push(trace[trace.len() - 1]);
            }
        };
        if next > 0 {
            history.push(trace[trace.len() - 1]);
        }
        let is_small = self.rows() * self.sources() <= POLISHED_PAIRS;
        if stop == SchwarzStop::Plateau && is_small && start.is_none() && self.levels.len() > 1 {
            self.polish(&mut gcr, &rms, &mut history, progress)?;
        }
        Ok(Solution {
            coefficients: gcr.solution,
            residual: gcr.residual,
            iterations: history.len() - 1,
            history,
            stop,
        })
    }

    /// More corrections, from the gradient of the whole residual. Those of the patches vanish a few percent above the
    /// least-squares optimum, as a patch has its own rows only; the gradient vanishes at the optimum alone. Every
    /// iteration takes a transposed sum, so that only small systems are polished.
    fn polish(
        &self,
        gcr: &mut Gcr<'_>,
        rms: &dyn Fn(&[f64]) -> f64,
        history: &mut Vec<f64>,
        progress: &dyn Fn(usize, f64) -> Result<(), SolveError>,
    ) -> Result<(), SolveError> {
        let sources: Vec<Point> = self.groups.iter().flat_map(|group| group.sources.clone()).collect();
        let transposed = sums(&self.collocation, &sources, &self.options)?.with_accuracy(self.options.later_accuracy);
        for _ in 0..self.options.most_iterations {
            let before = history[history.len() - 1];
            progress(history.len() - 1, before)?;
            let gradient = self.gradient(&transposed, &gcr.residual)?;
            for group in &self.groups {
                if let Some(step) = self.gradient_correction(group, &gradient) {
                    let image = self.image(group, &step, self.options.later_accuracy)?;
                    gcr.advance(step, image);
                }
            }
            let now = rms(&gcr.squares());
            history.push(now);
            if now > POLISHED * before {
                break;
            }
        }
        Ok(())
    }

    /// Whether the latest corrections reduced the residual so little that more would hardly help.
    fn is_plateau(&self, trace: &[f64]) -> bool {
        // A single dense level is solved exactly.
        if self.levels.len() == 1 && trace.len() > 1 {
            return true;
        }
        let groups = self.groups.len();
        let gain = |corrections: usize| trace[trace.len() - 1] / trace[trace.len() - 1 - corrections];
        let cycle = trace.len() > groups && gain(groups) > self.options.plateau;
        // Judged by the finest group's latest correction at the end of an iteration that is not the first.
        let finest = trace.len() > 2 * groups && (trace.len() - 1).is_multiple_of(groups);
        cycle || (finest && gain(1) > self.options.finest_plateau)
    }

    fn affine_functions(&self) -> usize {
        if self.affine { 4 } else { 0 }
    }

    fn unknowns(&self) -> usize {
        self.sources() + self.affine_functions()
    }

    /// Coefficients of the first levels, with zeros for the others.
    fn extended(&self, start: &Values) -> Values {
        let columns = start.columns();
        let mut solution = Values::zeros(self.unknowns(), columns);
        let (sources, affine) = start
            .as_slice()
            .split_at((start.rows() - self.affine_functions()) * columns);
        let entries = solution.as_mut_slice();
        let (own, linear) = entries.split_at_mut(self.sources() * columns);
        let known = sources.len().min(own.len());
        own[..known].copy_from_slice(&sources[..known]);
        linear.copy_from_slice(affine);
        solution
    }

    fn dense_level(&self, level: &Level) -> Result<FactoredLevel, SolveError> {
        let area = level.weights.iter().sum::<f64>() / level.weights.len().max(1) as f64;
        let system = CollocationSystem {
            collocation: &self.points(&level.rows),
            row_weights: &level.weights.iter().map(|w| (w / area).sqrt()).collect::<Vec<_>>(),
            sources: &level.sources,
            affine: self.affine,
        };
        let factor = DenseFactor::new(&system, &DenseOptions::default())?;
        Ok(FactoredLevel::new(level, LevelSolver::Dense(Box::new(factor))))
    }

    fn patches<A: ProgressResponse>(
        &self,
        level: &Level,
        progress: &dyn Fn(usize, usize) -> A,
    ) -> Result<FactoredLevel, SolveError> {
        let points = self.points(&level.rows);
        let SchwarzOptions { core, overlap, .. } = self.options;
        let patches = Patches::new(level, points, core, overlap, progress)?;
        Ok(FactoredLevel::new(level, LevelSolver::Patches(patches)))
    }

    fn points(&self, rows: &[u32]) -> Vec<Point> {
        rows.iter().map(|&r| self.collocation[r as usize]).collect()
    }

    fn add_group(&mut self, levels: &[Level], first: usize) -> Result<(), SolveError> {
        let mut sources: Vec<Point> = Vec::new();
        let mut steps = Vec::new();
        for (i, level) in levels.iter().enumerate() {
            if i > 0 {
                let points = self.points(&level.rows);
                steps.push(CoarseStep {
                    coarser_rows: positions_in(&level.rows, &levels[i - 1].rows)?,
                    from_coarser: sums(&sources, &points, &self.options)?,
                    from_own: sums(&level.sources, &points, &self.options)?,
                });
            }
            sources.extend_from_slice(&level.sources);
        }
        let to_collocation = sums(&sources, &self.collocation, &self.options)?;
        self.groups.push(LevelGroup {
            first,
            sources,
            steps,
            to_collocation,
        });
        Ok(())
    }
}

/// The index in `rows` of each of `chosen`.
fn positions_in(rows: &[u32], chosen: &[u32]) -> Result<Vec<u32>, SolveError> {
    let mut place: Vec<u32> = (0..rows.len() as u32).collect();
    place.sort_unstable_by_key(|&i| rows[i as usize]);
    let find = |&row: &u32| match place.binary_search_by_key(&row, |&i| rows[i as usize]) {
        Ok(at) => Ok(place[at]),
        Err(_) => Err(SolveError::RowsNotNested { row }),
    };
    chosen.iter().map(find).collect()
}

fn sums(sources: &[Point], targets: &[Point], options: &SchwarzOptions) -> Result<Sums, SolveError> {
    let (first, later) = (options.first_accuracy, options.later_accuracy);
    Ok(Sums::with_range(sources, targets, first, later)?)
}

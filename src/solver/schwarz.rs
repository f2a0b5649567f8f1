//! Large least-squares systems: flexible Krylov iterations in the space of the data, preconditioned level by level by
//! local least-squares solves.
//!
//! Levels go from coarse to fine. The coarsest holds the affine functions and is solved densely; every other level is cut
//! into overlapping [patches](super::patches). One iteration first corrects by the coarse levels together, each on what
//! those before it leave, and then by each finer level on its own, with the best step length along each correction
//! and all before. All levels' sources are unknowns of the same system and stay in the map. Nothing dense grows with
//! the number of sources: patches are of one size, and there are levels enough to keep the coarsest small.

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
    /// Collocation points that this level sees, as indices into those of the whole system.
    pub rows: Vec<u32>,
    /// For each of `rows`, the source of this level it belongs to, or [`Level::NO_OWNER`].
    pub owner: Vec<u32>,
    /// For each of `rows`, the area it stands for.
    pub weights: Vec<f64>,
}

impl Level {
    /// In `owner`: a row that belongs to no source, as where a source found no place. It is in no local problem.
    pub const NO_OWNER: u32 = u32::MAX;
}

/// Settings of [`SchwarzFactor`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SchwarzOptions {
    /// Sources in the core of a patch.
    pub core: usize,
    /// Reach of a patch beyond its core, in local spacings.
    pub overlap: f64,
    /// Iterations of the same kind that correct each coarse level, on its own rows.
    pub coarse_iterations: usize,
    /// When one correction of every group of levels, wherever the count starts, leaves more than this part of the
    /// residual, it has reached the plateau: the least-squares optimum, within a few percent.
    pub plateau: f64,
    /// The same for a correction of the finest level alone, from the second iteration on.
    pub finest_plateau: f64,
    /// Iterations at most.
    pub most_iterations: usize,
    /// Relative accuracy of the sums for the first correction, which takes most of the data away.
    pub first_accuracy: f64,
    /// Relative accuracy of the sums for later corrections, which are as small as what is left to correct.
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

/// Relative accuracy of the residual that is reported, times what the residual is of the data.
const FINAL_ACCURACY: f64 = 0.02;
/// No sums need be better than this: data without a residual, as of affine maps, would ask for any accuracy, and pay for it.
const BEST_ACCURACY: f64 = 1e-12;
/// Later groups correct what the first leaves, and can be summed so much less accurately.
const LATER_GROUPS: f64 = 10.0;
/// Part of the residual by which the one carried along may have drifted before it is computed afresh.
const DRIFT: f64 = 0.02;

/// Systems of up to so many rows times sources are polished: sums over them cost a few hundredths of a second.
const POLISHED_PAIRS: usize = 100_000_000;
/// Polishing ends when an iteration leaves more than this part.
const POLISHED: f64 = 0.99;

/// Why the iterations ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum SchwarzStop {
    /// The residual is as small as asked for.
    Goal,
    /// The residual fell no further: it is the optimum's, to within what an iteration gains.
    Plateau,
    /// The number of iterations allowed was used up.
    Iterations,
}

/// The coefficients, and how they were found.
#[derive(Debug, Clone)]
pub struct Solution {
    /// A row per source, level after level, then four rows for the functions 1, x, y, z if the basis has them.
    pub coefficients: Values,
    /// Data minus what the coefficients give, a row per collocation point. Carried along from correction to correction:
    /// right to a few hundredths of its norm.
    pub residual: Values,
    /// Iterations made.
    pub iterations: usize,
    /// Weighted root mean square of the residual over all columns before the first iteration and after each; the last may
    /// have corrected some levels only. Carried along from correction to correction, right to a percent or so.
    pub history: Vec<f64>,
    /// Why they ended.
    pub stop: SchwarzStop,
}

/// A system made ready for any number of right-hand sides.
pub struct SchwarzFactor {
    collocation: Vec<Point>,
    /// Area shares, one per collocation point.
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

/// What a coarse level above the coarsest needs to iterate on its own rows.
struct CoarseStep {
    /// The rows of the next coarser level, as indices into this level's.
    coarser_rows: Vec<u32>,
    from_coarser: Sums,
    from_own: Sums,
}

impl SchwarzFactor {
    /// Factors the levels, coarse to fine; the last is the one whose spacing the map is to resolve. `weights` are the area
    /// shares of the collocation points. `progress` is called with the patches made and their number.
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
            let patches = factor.patches(level, progress)?;
            factor.levels.push(patches);
        }
        let coarse = levels.len().saturating_sub(1).max(1);
        factor.add_group(&levels[..coarse], 0)?;
        if levels.len() > 1 {
            factor.add_group(&levels[coarse..], coarse)?;
        }
        Ok(factor)
    }

    /// How many numbers the local problems of these levels keep, the dense coarsest left out; before any is made.
    pub fn patch_entries(levels: &[Level], options: &SchwarzOptions) -> u64 {
        let kept = |level| Patches::patch_entries(level, options.core, options.overlap);
        levels.iter().map(kept).sum()
    }

    /// Adds collocation points and a finer level, whose rows may be old points and new. Warm starts carry over: the
    /// coefficients of the levels before keep their place.
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

    /// The modes of data at the collocation points: see [`BasisModes::of`].
    pub fn modes_of(&self, data: &Values, truncation: f64) -> Option<(Values, BasisModes)> {
        BasisModes::of(data, &self.collocation, &self.weights, self.affine, truncation)
    }

    /// Positions of the collocation points.
    pub fn collocation(&self) -> &[Point] {
        &self.collocation
    }

    /// Number of collocation points.
    pub fn rows(&self) -> usize {
        self.collocation.len()
    }

    /// The coefficients for boundary values `data`, a row per collocation point and any number of columns, which share
    /// every kernel value. Starts at `start` if given (its rows may be fewer by those of the latest level), ends when the
    /// root mean square of the residual is below `goal` in every column or falls no further. `progress` is called with the
    /// iterations made and the residual, several times in each iteration.
    ///
    /// # Errors
    ///
    /// [`SolveError::DataLength`], and [`SolveError::Cancelled`] when `progress` ends it.
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
        let mut search = Gcr::new(&self.weights, residual, solution);
        let rms = |squares: &[f64]| (squares.iter().sum::<f64>() / area).sqrt();
        let reached = |squares: &[f64]| squares.iter().all(|s| (s / area).sqrt() <= goal);
        let mut history = vec![rms(&search.squares())];
        // Of the residual before and after each correction, since the latest start.
        let mut trace = history.clone();
        let mut refreshed = false;
        let mut next = 0;
        let stop = loop {
            let latest = trace[trace.len() - 1];
            let stop = if reached(&search.squares()) {
                Some(SchwarzStop::Goal)
            } else if self.is_plateau(&trace) {
                Some(SchwarzStop::Plateau)
            } else {
                (history.len() > self.options.most_iterations).then_some(SchwarzStop::Iterations)
            };
            if let Some(stop) = stop {
                // The sums are rough, and the residual carried along drifts from the true one.
                let drift = self.options.first_accuracy * trace[0]
                    + self.options.later_accuracy * trace[1..].iter().sum::<f64>();
                if drift <= DRIFT * latest || refreshed || stop == SchwarzStop::Iterations {
                    break stop;
                }
                progress(history.len() - 1, latest)?;
                let accuracy = FINAL_ACCURACY * latest / history[0];
                let accuracy = accuracy.clamp(BEST_ACCURACY, self.options.first_accuracy.max(BEST_ACCURACY));
                search.restart(self.residual(data, &search.solution, accuracy)?);
                refreshed = true;
                trace = vec![rms(&search.squares())];
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
            let step = self.correction(group, &search.residual, accuracy)?;
            progress(history.len() - 1, latest)?;
            let image = self.image(group, &step, accuracy)?;
            search.advance(step, image);
            trace.push(rms(&search.squares()));
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
            self.polish(&mut search, &rms, &mut history, progress)?;
        }
        Ok(Solution {
            coefficients: search.solution,
            residual: search.residual,
            iterations: history.len() - 1,
            history,
            stop,
        })
    }

    /// More corrections, from the gradient of the whole residual. Local problems see their own rows only, and vanish a few percent above
    /// the least-squares optimum; the gradient vanishes at the optimum and nowhere else. It takes a transposed sum
    /// for every iteration, so that only small systems get it.
    fn polish(
        &self,
        search: &mut Gcr<'_>,
        rms: &dyn Fn(&[f64]) -> f64,
        history: &mut Vec<f64>,
        progress: &dyn Fn(usize, f64) -> Result<(), SolveError>,
    ) -> Result<(), SolveError> {
        let sources: Vec<Point> = self.groups.iter().flat_map(|group| group.sources.clone()).collect();
        let transposed = sums(&self.collocation, &sources, &self.options)?.with_accuracy(self.options.later_accuracy);
        for _ in 0..self.options.most_iterations {
            let before = history[history.len() - 1];
            progress(history.len() - 1, before)?;
            let gradient = self.gradient(&transposed, &search.residual)?;
            for group in &self.groups {
                if let Some(step) = self.gradient_correction(group, &gradient) {
                    let image = self.image(group, &step, self.options.later_accuracy)?;
                    search.advance(step, image);
                }
            }
            let now = rms(&search.squares());
            history.push(now);
            if now > POLISHED * before {
                break;
            }
        }
        Ok(())
    }

    /// `Aᵀ W r` for all unknowns.
    fn gradient(&self, transposed: &Sums, residual: &Values) -> Result<Values, SolveError> {
        let columns = residual.columns();
        let weighted: Vec<f64> = (0..self.rows())
            .flat_map(|r| residual.row(r).iter().map(move |value| self.weights[r] * value))
            .collect();
        let mut gradient = transposed.potential(&weighted, columns)?;
        if self.affine {
            let mut sums = vec![0.0; 4 * columns];
            for (row, p) in weighted.chunks_exact(columns).zip(&self.collocation) {
                for (k, value) in row.iter().enumerate() {
                    for (function, factor) in [1.0, p.x, p.y, p.z].into_iter().enumerate() {
                        sums[function * columns + k] += factor * value;
                    }
                }
            }
            gradient.extend(sums);
        }
        Ok(Values::new(columns, gradient))
    }

    /// What the local normal equations of a group of one level make of a gradient.
    fn gradient_correction(&self, group: &LevelGroup, gradient: &Values) -> Option<Values> {
        if !group.steps.is_empty() {
            return None;
        }
        let columns = gradient.columns();
        let before: usize = self.levels[..group.first].iter().map(|level| level.sources).sum();
        let all = gradient.as_slice();
        let own = &all[before * columns..][..group.sources.len() * columns];
        let mut step = vec![0.0; all.len()];
        match &self.levels[group.first].solver {
            LevelSolver::Patches(patches) => {
                let solved = patches.solve_gradient(&Values::new(columns, own.to_vec()));
                step[before * columns..][..own.len()].copy_from_slice(solved.as_slice());
            }
            LevelSolver::Dense(dense) => {
                let affine = &all[self.sources() * columns..];
                let solved = dense.solve_normal(&Values::new(columns, [own, affine].concat()))?;
                let (coefficients, affine) = solved.as_slice().split_at(own.len());
                step[..own.len()].copy_from_slice(coefficients);
                step[self.sources() * columns..].copy_from_slice(affine);
            }
        }
        Some(Values::new(columns, step))
    }

    /// Whether the latest corrections gained so little that more would gain next to nothing.
    fn is_plateau(&self, trace: &[f64]) -> bool {
        // One dense level is solved in one go.
        if self.levels.len() == 1 && trace.len() > 1 {
            return true;
        }
        let groups = self.groups.len();
        let gain = |corrections: usize| trace[trace.len() - 1] / trace[trace.len() - 1 - corrections];
        let cycle = trace.len() > groups && gain(groups) > self.options.plateau;
        // The finest group's latest gain, at the end of an iteration that is not the first.
        let finest = trace.len() > 2 * groups && (trace.len() - 1).is_multiple_of(groups);
        cycle || (finest && gain(1) > self.options.finest_plateau)
    }

    fn unknowns(&self) -> usize {
        self.sources() + if self.affine { 4 } else { 0 }
    }

    /// Coefficients of fewer levels, with zeros for the others.
    fn extended(&self, start: &Values) -> Values {
        let mut solution = Values::zeros(self.unknowns(), start.columns());
        let affine = if self.affine { 4 } else { 0 };
        let sources = (start.rows() - affine).min(self.sources());
        (0..sources).for_each(|s| solution.row_mut(s).copy_from_slice(start.row(s)));
        for k in 0..affine {
            let row = self.sources() + k;
            solution
                .row_mut(row)
                .copy_from_slice(start.row(start.rows() - affine + k));
        }
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
        Ok(FactoredLevel {
            sources: level.sources.len(),
            rows: level.rows.clone(),
            weights: level.weights.clone(),
            solver: LevelSolver::Dense(Box::new(DenseFactor::new(&system, &DenseOptions::default())?)),
        })
    }

    fn patches<A: ProgressResponse>(
        &self,
        level: &Level,
        progress: &dyn Fn(usize, usize) -> A,
    ) -> Result<FactoredLevel, SolveError> {
        let points = self.points(&level.rows);
        let SchwarzOptions { core, overlap, .. } = self.options;
        Ok(FactoredLevel {
            sources: level.sources.len(),
            rows: level.rows.clone(),
            weights: level.weights.clone(),
            solver: LevelSolver::Patches(Patches::new(level, points, core, overlap, progress)?),
        })
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

    /// A group's correction of a residual, as coefficients of all unknowns.
    fn correction(&self, group: &LevelGroup, residual: &Values, accuracy: f64) -> Result<Values, SolveError> {
        let columns = residual.columns();
        let last = group.steps.len();
        let rest = residual.gather(&self.levels[group.first + last].rows);
        let solved = self.correct_level(group, last, rest, accuracy)?;
        let before: usize = self.levels[..group.first].iter().map(|level| level.sources).sum();
        let own = group.sources.len() * columns;
        let (coefficients, affine) = solved.as_slice().split_at(own);
        let mut all = vec![0.0; self.unknowns() * columns];
        all[before * columns..][..own].copy_from_slice(coefficients);
        if !affine.is_empty() {
            all[self.sources() * columns..].copy_from_slice(affine);
        }
        Ok(Values::new(columns, all))
    }

    /// Coefficients of the group's levels up to this one (and the affine functions, in the first group) for a residual at
    /// this level's rows: a few iterations of the same kind as those of the whole.
    fn correct_level(
        &self,
        group: &LevelGroup,
        index: usize,
        residual: Values,
        accuracy: f64,
    ) -> Result<Values, SolveError> {
        let level = &self.levels[group.first + index];
        let columns = residual.columns();
        let patches = match &level.solver {
            LevelSolver::Dense(dense) => return dense.solve_columns(&residual),
            LevelSolver::Patches(patches) => patches,
        };
        if index == 0 {
            return Ok(patches.solve(&residual));
        }
        let step = &group.steps[index - 1];
        let coarser: usize = self.levels[group.first..group.first + index]
            .iter()
            .map(|level| level.sources)
            .sum();
        let affine = if self.affine { 4 } else { 0 };
        let unknowns = coarser + level.sources + affine;
        let mut search = Gcr::new(&level.weights, residual, Values::zeros(unknowns, columns));
        for iteration in 0..self.options.coarse_iterations {
            let accuracy = if iteration == 0 {
                accuracy
            } else {
                accuracy.max(self.options.later_accuracy)
            };
            let rest = search.residual.gather(&step.coarser_rows);
            let solved = self.correct_level(group, index - 1, rest, accuracy)?;
            let (own, linear) = solved.as_slice().split_at(coarser * columns);
            let mut image = Values::new(
                columns,
                step.from_coarser.with_accuracy(accuracy).potential(own, columns)?,
            );
            self.add_affine(&mut image, linear, |r| self.collocation[level.rows[r] as usize]);
            let gap = vec![0.0; level.sources * columns];
            search.advance(Values::new(columns, [own, &gap, linear].concat()), image);

            let solved = patches.solve(&search.residual);
            let own = step.from_own.with_accuracy(accuracy.max(self.options.later_accuracy));
            let image = Values::new(columns, own.potential(solved.as_slice(), columns)?);
            let (gap, no_affine) = (vec![0.0; coarser * columns], vec![0.0; affine * columns]);
            search.advance(
                Values::new(columns, [&gap, solved.as_slice(), &no_affine].concat()),
                image,
            );
        }
        Ok(search.solution)
    }

    /// What a group's part of the coefficients, and with the first group the affine functions, give at the collocation
    /// points.
    fn image(&self, group: &LevelGroup, coefficients: &Values, accuracy: f64) -> Result<Values, SolveError> {
        let columns = coefficients.columns();
        let before: usize = self.levels[..group.first].iter().map(|level| level.sources).sum();
        let weights = &coefficients.as_slice()[before * columns..][..group.sources.len() * columns];
        let potential = group
            .to_collocation
            .with_accuracy(accuracy)
            .potential(weights, columns)?;
        let mut image = Values::new(columns, potential);
        if group.first == 0 && self.affine {
            let affine = &coefficients.as_slice()[self.sources() * columns..];
            self.add_affine(&mut image, affine, |r| self.collocation[r]);
        }
        Ok(image)
    }

    fn add_affine(&self, values: &mut Values, affine: &[f64], point: impl Fn(usize) -> Point) {
        if affine.is_empty() {
            return;
        }
        let columns = values.columns();
        for r in 0..values.rows() {
            let p = point(r);
            for (k, value) in values.row_mut(r).iter_mut().enumerate() {
                let a = |function: usize| affine[function * columns + k];
                *value += a(0) + a(1) * p.x + a(2) * p.y + a(3) * p.z;
            }
        }
    }

    /// Data minus what all coefficients give, to a relative accuracy of the sums.
    fn residual(&self, data: &Values, coefficients: &Values, accuracy: f64) -> Result<Values, SolveError> {
        let mut residual = data.clone();
        for group in &self.groups {
            let accuracy = accuracy * if group.first == 0 { 1.0 } else { LATER_GROUPS };
            let image = self.image(group, coefficients, accuracy)?;
            residual.add_scaled(&vec![-1.0; data.columns()], &image);
        }
        Ok(residual)
    }
}

/// Where the second list's rows stand in the first.
fn positions_in(rows: &[u32], chosen: &[u32]) -> Result<Vec<u32>, SolveError> {
    let mut place: Vec<u32> = (0..rows.len() as u32).collect();
    place.sort_unstable_by_key(|&i| rows[i as usize]);
    let find = |row: &u32| {
        place
            .binary_search_by_key(row, |&i| rows[i as usize])
            .map(|at| place[at])
    };
    chosen
        .iter()
        .map(|row| find(row).map_err(|_| SolveError::RowsNotNested { row: *row }))
        .collect()
}

fn sums(sources: &[Point], targets: &[Point], options: &SchwarzOptions) -> Result<Sums, SolveError> {
    let (first, later) = (options.first_accuracy, options.later_accuracy);
    Ok(Sums::with_range(sources, targets, first, later)?)
}

//! The pipeline (the algorithm of section 3.3): boundary map → samples → system → map.
//!
//! What depends on the domain alone is done once, in [`DomainFactor::new`]; every boundary map of that domain then costs
//! one [`DomainFactor::solve`] (section 4.6).

mod boundary_data;
mod distant;
mod domain;
mod error;
mod frames;
mod free_sources;
mod held_out;
mod image_spacing;
mod levels;
mod options;
mod phase;
mod placement;
mod refinement;
mod report;
mod self_intersections;
mod size;
mod source_room;
mod system;
mod timings;
mod unit_frame;
mod worst_places;

use std::cell::Cell;
use std::ops::ControlFlow;
use std::rc::Rc;
use std::sync::Arc;

pub(crate) use boundary_data::is_flat;
pub use error::FitError;
pub use frames::{FrameEvaluator, FrameImages};
pub use free_sources::{COLLOCATION_PER_FREE_SOURCE, FreeSourcesEnd, FreeSourcesReport, MOST_FREE_SOURCES};
pub use held_out::boundary_error;
pub use options::{FitMethod, FitOptions, Placement};
pub use phase::Phase;
pub use report::{BoundaryError, Fit, FitReport, LocalError, RefinementEnd};
pub use self_intersections::{self_intersection_finder, self_intersection_warning};
pub use size::FitSize;
pub use timings::FitTimings;
pub use worst_places::worst_places;

use crate::boundary_map::BoundaryMap;
use crate::mesh::{SurfaceMesh, SurfacePoint};
use crate::progress::{ProgressControl, ProgressResponse};
use boundary_data::{BoundaryData, right_hand_sides};
use domain::checked;
use held_out::HeldOut;
use phase::Progress;
use placement::PlacedPoints;
use refinement::Refiner;
use report::MeasuredMap;
use system::{System, SystemSolution, UnfactoredSystem};
use timings::Stopwatch;

/// Fits the harmonic map that carries the boundary of the domain as `boundary` does.
///
/// With the Schwarz solver, time and memory are linear in the number of sources (`docs/scaling.md`); dense QR takes
/// `2mn²` flops and `8mn` bytes for `m` collocation points and `n` sources.
///
/// # Errors
///
/// When the domain does not bound a solid, a setting is out of range, the fit needs more memory than allowed, or the
/// system cannot be solved; [`FitError::Cancelled`] when `progress` cancels it ([`ProgressResponse`]).
pub fn fit<R: ProgressResponse>(
    boundary: &BoundaryMap,
    options: &FitOptions,
    progress: &dyn Fn(Phase) -> R,
) -> Result<Fit, FitError> {
    let mut factor = DomainFactor::new(boundary.domain(), options, progress)?;
    factor.solve_refined(boundary, progress)
}

/// A domain with points placed and the system factored. Solves for any number of boundary maps.
pub struct DomainFactor {
    domain: Arc<SurfaceMesh>,
    options: FitOptions,
    system: System,
    held_out: HeldOut,
    warnings: Vec<String>,
    timings: FitTimings,
}

/// A round of refinement has helped if it lowers the smallest error so far to less than this fraction of it.
const GAIN: f64 = 0.95;
/// Consecutive rounds that did not help after which refinement ends.
const ROUNDS_IN_VAIN: usize = 3;

impl DomainFactor {
    /// Checks and repairs the domain, places sources and collocation points, and factors the system.
    ///
    /// # Errors
    ///
    /// As [`fit`].
    pub fn new<R: ProgressResponse>(
        domain: &SurfaceMesh,
        options: &FitOptions,
        progress: &dyn Fn(Phase) -> R,
    ) -> Result<Self, FitError> {
        let respond = |phase| progress(phase).control_flow();
        let progress = Progress(&respond);
        let mut clock = Stopwatch::start();
        progress.enter(Phase::Checking)?;
        options.require_valid()?;
        let options = options.with_memory_limit();
        let size = FitSize::of(domain, &options);
        if options.free_sources {
            free_sources::require_worth(&size)?;
        }
        size.require_memory(&options)?;
        let (domain, mut warnings) = checked(domain)?;

        progress.enter(Phase::Sampling)?;
        let placed = PlacedPoints::new(&domain, &options, &mut warnings, &progress)?;
        progress.enter(Phase::Sampling)?;
        let held_out = HeldOut::new(&domain, options.held_out, options.seed);
        let system = UnfactoredSystem::new(placed, &domain, &options);
        system.size.require_memory(&options)?;
        let sampling = clock.lap();

        let system = system.factor(&progress)?;
        Ok(Self {
            domain: Arc::new(domain),
            options,
            system,
            held_out,
            warnings,
            timings: FitTimings {
                sampling,
                factor: clock.lap(),
                ..FitTimings::default()
            },
        })
    }

    /// What is unusual about the domain, and how it was repaired, for the user to read.
    pub fn warnings(&self) -> &[String] {
        &self.warnings
    }

    /// The map for one boundary map of this domain, measured at held-out points. The report's `sampling` and `factor`
    /// times are those of the factorisation, also when it is used again.
    ///
    /// # Errors
    ///
    /// [`FitError::OtherDomain`] when the boundary map is not one of the domain that was factored.
    pub fn solve<R: ProgressResponse>(
        &self,
        boundary: &BoundaryMap,
        progress: &dyn Fn(Phase) -> R,
    ) -> Result<Fit, FitError> {
        let mut fits = self.solve_all(std::slice::from_ref(boundary), progress)?;
        Ok(fits.remove(0))
    }

    /// The maps for several boundary maps of this domain at once, such as the frames of a sequence. Each kernel value
    /// is computed once for all of them, and the Schwarz solver is run only for the modes that represent all boundary
    /// data to a five-hundredth of the tolerance (see [`BasisModes`](crate::solver::BasisModes)). Each report's `solve`
    /// and `check` times are an equal share of the block's.
    ///
    /// Needs about `240 · (collocation + sources)` bytes for each boundary map after the first.
    ///
    /// # Errors
    ///
    /// As [`Self::solve`], and [`FitError::TooLarge`] when that is more than allowed.
    pub fn solve_block<R: ProgressResponse>(
        &self,
        boundaries: &[BoundaryMap],
        progress: &dyn Fn(Phase) -> R,
    ) -> Result<Vec<Fit>, FitError> {
        if boundaries.is_empty() {
            return Ok(Vec::new());
        }
        let size = FitSize {
            maps: boundaries.len(),
            ..self.system.size
        };
        size.require_memory(&self.options)?;
        self.solve_all(boundaries, progress)
    }

    fn solve_all<R: ProgressResponse>(
        &self,
        boundaries: &[BoundaryMap],
        progress: &dyn Fn(Phase) -> R,
    ) -> Result<Vec<Fit>, FitError> {
        let respond = |phase| progress(phase).control_flow();
        let data = boundaries.iter().map(|boundary| self.data_of(boundary));
        let data: Vec<BoundaryData> = data.collect::<Result<_, _>>()?;
        let (maps, _) = self.solve_and_measure(&data, None, &Progress(&respond))?;
        Ok(data
            .into_iter()
            .zip(maps)
            .map(|(data, map)| self.fit_of(map, data))
            .collect())
    }

    /// The map for one boundary map of this domain, with finer sources added where its error is too large for the
    /// tolerance, or with free sources moved. They stay, and serve later boundary maps as well.
    ///
    /// Ends with the best map when the tolerance is met, no more sources or memory are allowed, or three consecutive
    /// rounds did not help. A dense system is never refined.
    ///
    /// # Errors
    ///
    /// As [`Self::solve`].
    pub fn solve_refined<R: ProgressResponse>(
        &mut self,
        boundary: &BoundaryMap,
        progress: &dyn Fn(Phase) -> R,
    ) -> Result<Fit, FitError> {
        let concluded = Cell::new(false);
        let control = |phase| {
            let control = progress(phase).control();
            concluded.set(concluded.get() || control == ProgressControl::Conclude);
            control
        };
        let until_solved = |phase| control(phase).control_flow();
        let until_concluded = |phase| match control(phase) {
            ProgressControl::Continue => ControlFlow::Continue(()),
            ProgressControl::Conclude | ProgressControl::Cancel => ControlFlow::Break(()),
        };
        let data = self.data_of(boundary)?;
        let (first, solution) = self.solve_one(&data, None, &Progress(&until_solved))?;
        let (mut best, end) = match self.options.method {
            FitMethod::Dense { .. } if self.options.free_sources => {
                self.free_sources(&data, first, &control, &|| concluded.get())?
            }
            _ if self.is_met_by(&first) => (first, RefinementEnd::Tolerance),
            FitMethod::Dense { .. } => (first, RefinementEnd::Fixed),
            FitMethod::Schwarz { .. } if !self.options.refine => (first, RefinementEnd::Off),
            FitMethod::Schwarz { alpha, .. } => {
                let refiner = Refiner::new(&self.domain, &self.system.anchors, alpha)?;
                let progress = Progress(&until_concluded);
                self.refine_until_met(&data, refiner, first, solution, &progress, &|| concluded.get())?
            }
        };
        best.report.refinement_end = Some(end);
        Ok(self.fit_of(best, data))
    }

    /// The best map of all rounds of refinement, and why there are no more. Work that `progress` ends is cancelled, unless
    /// `is_concluded`.
    fn refine_until_met(
        &mut self,
        data: &BoundaryData,
        mut refiner: Refiner,
        first: MeasuredMap,
        mut solution: SystemSolution,
        progress: &Progress,
        is_concluded: &dyn Fn() -> bool,
    ) -> Result<(MeasuredMap, RefinementEnd), FitError> {
        let mut spent = first.timings;
        let mut latest = Rc::new(first);
        let mut best = latest.clone();
        let mut in_vain = 0;
        let end = loop {
            if self.is_met_by(&best) {
                break RefinementEnd::Tolerance;
            }
            if in_vain == ROUNDS_IN_VAIN {
                break RefinementEnd::InVain;
            }
            if is_concluded() {
                break RefinementEnd::Concluded;
            }
            match self.add_level(&mut refiner, &latest, data, progress) {
                Err(FitError::Cancelled) if is_concluded() => break RefinementEnd::Concluded,
                added => {
                    if let Some(end) = added? {
                        break end;
                    }
                }
            }
            let solved = self.solve_one(data, Some(&solution), progress);
            if matches!(solved, Err(FitError::Cancelled)) && is_concluded() {
                break RefinementEnd::Concluded;
            }
            let (map, next) = solved?;
            spent = spent.with(map.timings.solve, map.timings.check);
            (latest, solution) = (Rc::new(map), next);
            let error = |map: &MeasuredMap| self.options.criterion(&map.report);
            in_vain = if error(&latest) < GAIN * error(&best) {
                0
            } else {
                in_vain + 1
            };
            if error(&latest) < error(&best) {
                best = latest.clone();
            }
        };
        drop(latest);
        let mut best = Rc::unwrap_or_clone(best);
        best.timings = spent;
        Ok((best, end))
    }

    /// The map with free sources moved, or the first one where that is better, and why no sources are added. The system keeps the
    /// sources of that map.
    fn free_sources(
        &mut self,
        data: &BoundaryData,
        first: MeasuredMap,
        control: &dyn Fn(Phase) -> ProgressControl,
        is_concluded: &dyn Fn() -> bool,
    ) -> Result<(MeasuredMap, RefinementEnd), FitError> {
        let mut clock = Stopwatch::start();
        let until_solved = |phase| control(phase).control_flow();
        let progress = Progress(&until_solved);
        let values = right_hand_sides(std::slice::from_ref(data), &self.system.collocation);
        let freed = self.system.free_sources(&self.domain, &values, control)?;
        let end = match is_concluded() {
            true => RefinementEnd::Concluded,
            false => RefinementEnd::Fixed,
        };
        let Some(freed) = freed else {
            return Ok((first, end));
        };
        let (moved, mut report) = freed.of(&first.report);
        let Some(system) = self.system.with_sources(moved, &progress)? else {
            return Ok((first, end));
        };
        let moving = clock.lap();
        let placed = std::mem::replace(&mut self.system, system);
        self.held_out.forget_sources();
        let solved = self.solve_one(data, None, &progress);
        let (solved, is_better) = match solved {
            Ok((map, _)) => {
                let error = |map: &MeasuredMap| self.options.criterion(&map.report);
                let is_better = error(&map) < error(&first);
                (Ok(map), is_better)
            }
            Err(error) => (Err(error), false),
        };
        if !is_better {
            self.system = placed;
            self.held_out.forget_sources();
        }
        let map = solved?;
        let spent = first.timings.with(map.timings.solve + moving, map.timings.check);
        report.kept = is_better;
        let mut best = if is_better { map } else { first };
        best.timings = spent;
        best.report.free_sources = Some(report);
        Ok((best, end))
    }

    /// Adds sources where the error of a map is too large, or says why there are no more.
    fn add_level(
        &mut self,
        refiner: &mut Refiner,
        map: &MeasuredMap,
        data: &BoundaryData,
        progress: &Progress,
    ) -> Result<Option<RefinementEnd>, FitError> {
        let mut clock = Stopwatch::start();
        progress.enter(Phase::Refining {
            round: self.system.size.refinements + 1,
            error: self.options.criterion(&map.report),
            sources: self.system.size.sources,
        })?;
        let errors_at = |points: &[SurfacePoint]| data.errors_of(&map.map, points);
        let spacing_at = |point: &SurfacePoint| data.spacing_at(point);
        let rows = self.system.collocation.len();
        let finer = refiner.refine(&self.domain, rows, &self.options, &errors_at, &spacing_at);
        self.timings.sampling += clock.lap();
        let Some(finer) = finer else {
            return Ok(Some(RefinementEnd::NoRoom));
        };
        if let Some((end, warning)) = self.system.refined_size(&finer).exceeded_limit(&self.options) {
            self.warnings.push(warning);
            return Ok(Some(end));
        }
        self.system.refine(&self.domain, finer, progress)?;
        self.held_out.forget_sources();
        self.timings.factor += clock.lap();
        Ok(None)
    }

    /// Solves for all boundary data together, and measures each map.
    fn solve_and_measure(
        &self,
        data: &[BoundaryData],
        start: Option<&SystemSolution>,
        progress: &Progress,
    ) -> Result<(Vec<MeasuredMap>, SystemSolution), FitError> {
        let mut clock = Stopwatch::start();
        let right_hand_sides = right_hand_sides(data, &self.system.collocation);
        let tolerance = self.options.residual_tolerance();
        let solution = self.system.solve(&right_hand_sides, start, tolerance, progress)?;
        let solve = clock.lap() / data.len() as f64;

        progress.enter(Phase::Measuring)?;
        let errors = self.held_out.errors(&self.system, &solution, data)?;
        let timings = FitTimings::default().with(solve, clock.lap() / data.len() as f64);

        let maps = self.system.maps(&solution, data).into_iter().zip(errors).enumerate();
        let measured = maps.map(|(k, (map, (errors, held_out)))| MeasuredMap {
            map,
            report: FitReport::new(&self.domain, &self.options, &self.system, (&solution, k), errors),
            held_out,
            timings,
        });
        Ok((measured.collect(), solution))
    }

    fn solve_one(
        &self,
        data: &BoundaryData,
        start: Option<&SystemSolution>,
        progress: &Progress,
    ) -> Result<(MeasuredMap, SystemSolution), FitError> {
        let (mut maps, solution) = self.solve_and_measure(std::slice::from_ref(data), start, progress)?;
        Ok((maps.remove(0), solution))
    }

    fn is_met_by(&self, map: &MeasuredMap) -> bool {
        self.options.is_met_by(&map.report)
    }

    fn data_of(&self, boundary: &BoundaryMap) -> Result<BoundaryData, FitError> {
        BoundaryData::new(boundary, &self.domain, self.options.affine)
    }

    fn fit_of(&self, map: MeasuredMap, data: BoundaryData) -> Fit {
        let MeasuredMap {
            map,
            report,
            held_out,
            timings,
        } = map;
        let report = FitReport {
            seconds: Some(self.timings.with(timings.solve, timings.check)),
            warnings: self.warnings.iter().cloned().chain(data.warning()).collect(),
            ..report
        };
        Fit {
            map,
            boundary: data.boundary,
            report,
            held_out,
        }
    }
}

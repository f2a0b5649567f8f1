//! The pipeline on one screen (the algorithm of section 3.3): boundary map → samples → system → map.
//!
//! What depends on the domain alone is done once, in [`DomainFactor::new`]; every boundary map of that domain then costs
//! one [`DomainFactor::solve`] (section 4.6).

mod error;
mod estimate;
mod frame;
mod held_out;
mod levels;
mod options;
mod placement;
mod refinement;
mod report;
mod system;

use std::ops::ControlFlow;
use std::time::Instant;

use rayon::prelude::*;

pub use error::FitError;
pub use estimate::Workload;
pub use options::{FitOptions, Placement, Solver};
pub use report::{BoundaryError, Fit, FitReport, Phase, RefinementEnd, Seconds};

use crate::Point;
use crate::boundary_map::BoundaryMap;
use crate::check;
use crate::map::{HarmonicMap, VolumeMap};
use crate::memory::readable;
use crate::mesh::{SurfaceMesh, SurfacePoint};
use crate::progress::ProgressResponse;
use crate::solver::{Coefficients, SchwarzFactor, Values};
use estimate::{require_room, with_budget};
use frame::Frame;
use held_out::HeldOut;
use options::require_valid;
use refinement::Grading;
use system::{Solved, System};

/// Fits the harmonic map that carries the boundary of the domain as `boundary` does.
///
/// With the Schwarz solver, time and memory grow with the number of sources (`docs/scaling.md`); a dense one takes `2mn²` flops and `8mn` bytes for
/// `m` collocation points and `n` sources (QR).
///
/// # Errors
///
/// When the domain does not bound a solid, a setting is out of range, the fit needs more memory than allowed, or the
/// system cannot be solved; [`FitError::Cancelled`] when `progress` says so ([`ProgressResponse`]).
pub fn fit<A: ProgressResponse>(
    boundary: &BoundaryMap,
    options: &FitOptions,
    progress: &dyn Fn(Phase) -> A,
) -> Result<Fit, FitError> {
    let mut factor = DomainFactor::new(boundary.domain(), options, progress)?;
    factor.solve_refined(boundary, progress)
}

/// Tells how far a fit is; whether to go on.
type Tell<'a> = &'a dyn Fn(Phase) -> ControlFlow<()>;

fn go_on(answer: ControlFlow<()>) -> Result<(), FitError> {
    match answer {
        ControlFlow::Continue(()) => Ok(()),
        ControlFlow::Break(()) => Err(FitError::Cancelled),
    }
}

/// Residuals below this part of the tolerance need no more iterations.
const FAR_BELOW: f64 = 0.02;
/// A round of refinement that leaves more of the error than this was in vain.
const GAIN: f64 = 0.95;
/// Rounds in vain, one after the other, that end refinement.
const ROUNDS_IN_VAIN: usize = 3;
/// A volume below this part of the diagonal's cube is none but for rounding.
const FLAT: f64 = 1e-12;

/// A domain made ready: points placed and the system factored. Answers any number of boundary maps.
pub struct DomainFactor {
    domain: SurfaceMesh,
    options: FitOptions,
    frame: Frame,
    system: System,
    /// Numbers in its local problems.
    local_numbers: Option<u64>,
    held_out: HeldOut,
    refinements: usize,
    warnings: Vec<String>,
    seconds: Seconds,
}

impl DomainFactor {
    /// Checks and mends the domain, places sources and collocation points, and factors the system.
    ///
    /// # Errors
    ///
    /// As [`fit`].
    pub fn new<A: ProgressResponse>(
        domain: &SurfaceMesh,
        options: &FitOptions,
        progress: &dyn Fn(Phase) -> A,
    ) -> Result<Self, FitError> {
        Self::make(domain, options, &|phase| progress(phase).control_flow())
    }

    fn make(domain: &SurfaceMesh, options: &FitOptions, progress: Tell) -> Result<Self, FitError> {
        let start = Instant::now();
        go_on(progress(Phase::Checking))?;
        require_valid(options)?;
        let options = &with_budget(options);
        require_room(&Workload::of(domain, options), options)?;
        let (domain, mut warnings) = checked(domain)?;
        go_on(progress(Phase::Sampling))?;
        let frame = Frame::of(&domain);
        let placed = System::place(&domain, &frame, options, &mut warnings)?;
        go_on(progress(Phase::Sampling))?;
        let held_out = HeldOut::new(&domain, &frame, options.held_out, options.seed);
        let work = placed.work(domain.vertices().len());
        require_room(&work, options)?;
        let sampled = start.elapsed().as_secs_f64();
        let system = placed.factor(&frame, progress)?;
        let seconds = Seconds {
            sampling: sampled,
            factor: start.elapsed().as_secs_f64() - sampled,
            ..Seconds::default()
        };
        Ok(Self {
            domain,
            options: options.clone(),
            frame,
            system,
            local_numbers: work.local_numbers,
            held_out,
            refinements: 0,
            warnings,
            seconds,
        })
    }

    /// The map for one boundary map of this domain, with finer sources added where its error is too large for the
    /// tolerance. They stay, and serve later boundary maps as well.
    ///
    /// Ends with the best map when the tolerance is met, no more sources are allowed, or three rounds did not help.
    ///
    /// # Errors
    ///
    /// As [`Self::solve`].
    pub fn solve_refined<A: ProgressResponse>(
        &mut self,
        boundary: &BoundaryMap,
        progress: &dyn Fn(Phase) -> A,
    ) -> Result<Fit, FitError> {
        self.solve_until_met(boundary, &|phase| progress(phase).control_flow())
    }

    fn solve_until_met(&mut self, boundary: &BoundaryMap, progress: Tell) -> Result<Fit, FitError> {
        let (mut best, mut solved) = self.solve_from(boundary, None, progress)?;
        let tolerance = self.options.tolerance;
        let is_met = |fit: &Fit| fit.report.boundary_error.p99 <= tolerance;
        let (alpha, end) = match self.options.placement {
            _ if is_met(&best) => (0.0, Some(RefinementEnd::Tolerance)),
            Placement::Adaptive { alpha } if self.system.is_refinable() => {
                (alpha, (!self.options.refine).then_some(RefinementEnd::Off))
            }
            _ => (0.0, Some(RefinementEnd::Fixed)),
        };
        if end.is_some() {
            best.report.refinement_end = end;
            return Ok(best);
        }
        let start = Instant::now();
        let mut grading = Grading::new(&self.domain, &self.system.anchors, alpha)?;
        self.seconds.sampling += start.elapsed().as_secs_f64();
        let mut latest = best.clone();
        let mut spent = best.report.seconds.unwrap_or_default();
        let mut in_vain = 0;
        let end = loop {
            if is_met(&best) {
                break RefinementEnd::Tolerance;
            }
            if in_vain == ROUNDS_IN_VAIN {
                break RefinementEnd::InVain;
            }
            if let Some(end) = self.refine(&mut grading, &latest, progress)? {
                break end;
            }
            (latest, solved) = self.solve_from(boundary, Some(&solved.coefficients), progress)?;
            let round = latest.report.seconds.unwrap_or_default();
            (spent.solve, spent.check) = (spent.solve + round.solve, spent.check + round.check);
            let (before, now) = (best.report.boundary_error.p99, latest.report.boundary_error.p99);
            in_vain = if now < GAIN * before { 0 } else { in_vain + 1 };
            if now < before {
                best = latest.clone();
            }
        };
        let Seconds { sampling, factor, .. } = self.seconds;
        best.report.seconds = Some(Seconds {
            total: sampling + factor + spent.solve + spent.check,
            sampling,
            factor,
            ..spent
        });
        best.report.refinement_end = Some(end);
        best.report.warnings = [&self.warnings[..], &remarks_of(&best)].concat();
        Ok(best)
    }

    /// Adds sources where a fit errs too much, or says why there are no more.
    fn refine(&mut self, grading: &mut Grading, fit: &Fit, progress: Tell) -> Result<Option<RefinementEnd>, FitError> {
        let start = Instant::now();
        self.refinements += 1;
        go_on(progress(Phase::Refining {
            round: self.refinements,
            error: fit.report.boundary_error.p99,
            sources: self.system.sources.len(),
        }))?;
        let diagonal = fit.boundary.target_diagonal();
        let finer = grading.refine(
            &self.domain,
            &self.frame,
            self.options.tolerance,
            self.system.collocation.len(),
            self.options.seed,
            &|points| errors_at(&fit.map, &fit.boundary, points, diagonal),
        );
        let sampled = start.elapsed().as_secs_f64();
        self.seconds.sampling += sampled;
        let Some(finer) = finer else {
            return Ok(Some(RefinementEnd::NoRoom));
        };
        let mut work = self.work(1);
        work.sources += finer.level.sources.len();
        work.collocation += finer.points.len();
        work.refinements = self.refinements;
        work.local_numbers = match self.options.solver {
            Solver::Schwarz(options) => {
                let added = SchwarzFactor::patch_entries(std::slice::from_ref(&finer.level), &options);
                self.local_numbers.map(|kept| kept + added)
            }
            Solver::Dense(_) => None,
        };
        if let Some((end, limit)) = self.exceeded(&work) {
            self.warnings.push(format!(
                "refinement ended before the tolerance was met: it calls for {} sources, {limit}",
                work.sources
            ));
            return Ok(Some(end));
        }
        self.local_numbers = work.local_numbers;
        self.system.refine(&self.domain, &self.frame, finer, progress)?;
        self.held_out.forget_sources();
        self.seconds.factor += start.elapsed().as_secs_f64() - sampled;
        Ok(None)
    }

    fn work(&self, maps: usize) -> Workload {
        Workload {
            vertices: self.domain.vertices().len(),
            sources: self.system.sources.len(),
            collocation: self.system.collocation.len(),
            maps,
            refinements: self.refinements,
            local_numbers: self.local_numbers,
            solver: self.options.solver,
        }
    }

    /// The limit that a round of refinement would break, and how to say so.
    fn exceeded(&self, work: &Workload) -> Option<(RefinementEnd, String)> {
        let most = self.options.max_sources;
        if work.sources > most {
            let limit = format!("and {most} are allowed; `max_sources` raises the limit");
            return Some((RefinementEnd::MaxSources, limit));
        }
        let (need, allowed) = (work.bytes(), self.options.memory?);
        let limit = || {
            let (need, allowed) = (readable(need), readable(allowed));
            format!("which need about {need}, and {allowed} are allowed; `memory` raises the limit")
        };
        (need > allowed).then(|| (RefinementEnd::Memory, limit()))
    }

    fn solve_from(
        &self,
        boundary: &BoundaryMap,
        from: Option<&Values>,
        progress: Tell,
    ) -> Result<(Fit, Solved), FitError> {
        let (mut fits, solved) = self.solve_columns(std::slice::from_ref(boundary), from, progress)?;
        Ok((fits.remove(0), solved))
    }

    /// The map for one boundary map of this domain, measured at held-out points. The report's `sampling` and `factor`
    /// times are those of the factorisation, also when it is used again.
    ///
    /// # Errors
    ///
    /// [`FitError::OtherDomain`] when the boundary map is not one of the domain that was factored.
    pub fn solve<A: ProgressResponse>(
        &self,
        boundary: &BoundaryMap,
        progress: &dyn Fn(Phase) -> A,
    ) -> Result<Fit, FitError> {
        Ok(self
            .solve_from(boundary, None, &|phase| progress(phase).control_flow())?
            .0)
    }

    /// The maps for several boundary maps of this domain at once, such as the frames of a sequence. They share every
    /// kernel value, and what they have in common is solved for once: with a tolerance, the system is solved for as many modes
    /// of the data as make it up to a five-hundredth of the tolerance (see [`BasisModes`](crate::solver::BasisModes)). Each
    /// report's `solve` and `check` times are its share.
    ///
    /// Needs `24 · (collocation + sources)` bytes per boundary map, some ten times over.
    ///
    /// # Errors
    ///
    /// As [`Self::solve`], and [`FitError::TooLarge`] when that is more than allowed.
    pub fn solve_block<A: ProgressResponse>(
        &self,
        boundaries: &[BoundaryMap],
        progress: &dyn Fn(Phase) -> A,
    ) -> Result<Vec<Fit>, FitError> {
        if boundaries.is_empty() {
            return Ok(Vec::new());
        }
        require_room(&self.work(boundaries.len()), &self.options)?;
        let progress = &|phase| progress(phase).control_flow();
        Ok(self.solve_columns(boundaries, None, progress)?.0)
    }

    fn solve_columns(
        &self,
        boundaries: &[BoundaryMap],
        from: Option<&Values>,
        progress: Tell,
    ) -> Result<(Vec<Fit>, Solved), FitError> {
        let start = Instant::now();
        let goals = boundaries.iter().map(|boundary| self.goal_of(boundary));
        let goals: Vec<Goal> = goals.collect::<Result<_, _>>()?;
        let goal = FAR_BELOW * self.options.tolerance;
        let columns: Vec<Vec<[f64; 3]>> = goals.iter().map(|goal| goal.data(&self.system.collocation)).collect();
        let data = side_by_side(&columns);
        let solved = self.system.solve(&self.frame, &data, from, goal, progress)?;
        let coefficients = solved.coefficients_of_data();
        let seconds = start.elapsed().as_secs_f64() / goals.len() as f64;
        go_on(progress(Phase::Measuring))?;
        let start = Instant::now();
        let residuals = (0..goals.len()).into_par_iter();
        let residuals: Vec<Residual> = residuals.map(|k| Residual::of(&solved.residual, 3 * k)).collect();
        // The dense solver is the reference, and measured exactly.
        let error = match solved.stop {
            Some(_) => residuals
                .iter()
                .map(|residual| residual.rms.max(goal))
                .fold(f64::INFINITY, f64::min),
            None => 0.0,
        };
        let values = self.held_out.values(&self.system, &self.frame, &solved, error)?;
        let errors = self.held_out.errors(&goals, &values)?;
        let checked = start.elapsed().as_secs_f64() / goals.len() as f64;
        let parts = goals.into_iter().zip(errors).zip(residuals).enumerate();
        let fits = parts.map(|(k, ((goal, boundary_error), residual))| {
            let unit = Coefficients::of_columns(&coefficients, 3 * k, self.system.sources.len());
            self.finish(goal, unit, (boundary_error, residual), &solved, [seconds, checked])
        });
        Ok((fits.collect(), solved))
    }

    /// What a boundary map asks of the solver.
    fn goal_of(&self, boundary: &BoundaryMap) -> Result<Goal, FitError> {
        // The repaired domain has the same vertices and triangles; some of them are turned over.
        let boundary = boundary.over(self.domain.clone()).map_err(|_| FitError::OtherDomain)?;
        let target = Frame::of_box(boundary.target_box());
        // With the constant in the basis the shift changes nothing but rounding; without it, it would change the fit.
        let origin = if self.options.affine {
            target.centre
        } else {
            Point::origin()
        };
        Ok(Goal {
            boundary,
            target,
            origin,
        })
    }

    /// The map of coefficients in the unit frame, with what was measured of it and the seconds of solving and measuring.
    fn finish(
        &self,
        goal: Goal,
        unit: Coefficients,
        (boundary_error, residual): (BoundaryError, Residual),
        solved: &Solved,
        [seconds, checked]: [f64; 2],
    ) -> Fit {
        let map = HarmonicMap::new(
            self.system.sources.clone(),
            self.frame.to_model(unit, goal.scale(), goal.origin),
        )
        .expect("one coefficient row per source");
        let map = match solved.stop {
            Some(_) => map.with_error(residual.rms),
            None => map,
        };
        let dense = self.system.rank_and_condition();
        let report = FitReport {
            vertices: self.domain.vertices().len(),
            faces: self.domain.triangles().len(),
            sources: self.system.sources.len(),
            collocation: self.system.collocation.len(),
            method: self.system.method().into(),
            placement: self.options.placement,
            affine: self.options.affine,
            iterations: solved.iterations,
            refinements: self.refinements,
            refinement_end: None,
            stop: solved.stop,
            rank: dense.map(|(rank, _)| rank),
            condition: dense.map(|(_, condition)| condition).filter(|c| c.is_finite()),
            boundary_error,
            memory_estimate: self.work(1).bytes(),
            c_error: residual.sum_of_squares,
            residual_rms: residual.rms,
            seconds: Some(Seconds {
                total: self.seconds.sampling + self.seconds.factor + seconds + checked,
                solve: seconds,
                check: checked,
                ..self.seconds
            }),
            warnings: self.warnings.clone(),
        };
        let mut fit = Fit {
            map,
            boundary: goal.boundary,
            report,
        };
        fit.report.warnings.extend(remarks_of(&fit));
        fit
    }
}

/// A boundary map of the repaired domain, and the frame of its target.
struct Goal {
    boundary: BoundaryMap,
    target: Frame,
    /// Data are taken from here.
    origin: Point,
}

impl Goal {
    fn data(&self, points: &[SurfacePoint]) -> Vec<[f64; 3]> {
        let images = self.boundary.evaluate(points);
        let scale = self.scale();
        images.iter().map(|p| ((p - self.origin) / scale).into()).collect()
    }

    /// Lengths of the target are solved for in this unit, so that the maps of a block weigh alike.
    fn scale(&self) -> f64 {
        self.target.diagonal
    }
}

/// Misfit of one map at the collocation points.
struct Residual {
    sum_of_squares: f64,
    rms: f64,
}

impl Residual {
    /// Of three columns, from `first` on.
    fn of(residual: &Values, first: usize) -> Self {
        let square = |r: usize| residual.row(r)[first..first + 3].iter().map(|v| v * v).sum::<f64>();
        let sum_of_squares: f64 = (0..residual.rows()).map(square).sum();
        Self {
            sum_of_squares,
            rms: (sum_of_squares / residual.rows().max(1) as f64).sqrt(),
        }
    }
}

/// One row per point with the triples of all lists.
fn side_by_side(lists: &[Vec<[f64; 3]>]) -> Values {
    let rows = lists.first().map_or(0, Vec::len);
    let mut numbers = Vec::with_capacity(3 * rows * lists.len());
    for r in 0..rows {
        lists.iter().for_each(|list| numbers.extend(list[r]));
    }
    Values::new(3 * lists.len(), numbers)
}

fn errors_at(map: &HarmonicMap, boundary: &BoundaryMap, points: &[SurfacePoint], diagonal: f64) -> Vec<f64> {
    let images = map.evaluate(&boundary.positions(points));
    let pairs = images.iter().zip(boundary.evaluate(points));
    pairs.map(|(f, exact)| (f - exact).norm() / diagonal).collect()
}

/// The domain with its faces turned outward, and what there is to say about it.
fn checked(domain: &SurfaceMesh) -> Result<(SurfaceMesh, Vec<String>), FitError> {
    let diagonal = domain.diagonal();
    // Of what has no extent or is not finite, the doctor says more.
    if diagonal > 0.0 && diagonal.is_finite() && !(1e-60..=1e60).contains(&diagonal) {
        return Err(FitError::OutOfScale { diagonal });
    }
    let report = check::check(domain, None);
    if !report.is_solvable() {
        return Err(FitError::DefectiveDomain(Box::new(report)));
    }
    let (repaired, repairs) = check::repair(domain);
    let warnings = report.warnings().map(|finding| finding.message.clone());
    let warnings = warnings.chain(repairs.iter().map(ToString::to_string)).collect();
    Ok((repaired, warnings))
}

/// What is odd about a target, though it can be mapped to.
fn remarks_of(fit: &Fit) -> Vec<String> {
    if fit.boundary.is_by_function() {
        return Vec::new();
    }
    let volume = fit.boundary.target_volume();
    let remark = if volume.abs() < FLAT * fit.boundary.target_diagonal().powi(3) {
        "the target encloses no volume, so it is no solid; the map flattens the domain"
    } else if volume < 0.0 {
        "the boundary map turns the solid inside out: it is a reflection"
    } else {
        return Vec::new();
    };
    vec![remark.into()]
}

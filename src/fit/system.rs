//! The linear system of a domain. Points and boundary values go in and maps come out in model units; it is solved in
//! the unit frame, so that results do not depend on the unit of length.

use std::borrow::Cow;
use std::sync::OnceLock;

use rayon::prelude::*;

use super::boundary_data::BoundaryData;
use super::distant::DistantSources;
use super::free_sources::{FreedSources, freed};
use super::phase::{Phase, Progress};
use super::placement::{PlacedPoints, SourceSets};
use super::refinement::FinerLevel;
use super::unit_frame::UnitFrame;
use super::{FitError, FitOptions, FitSize};
use crate::Point;
use crate::kernel::Sums;
use crate::map::HarmonicMap;
use crate::mesh::{SurfaceMesh, SurfacePoint};
use crate::progress::ProgressControl;
use crate::sampling::Anchors;
use crate::solver::{
    BasisModes, Coefficients, CollocationSystem, Decomposition, DenseFactor, DenseOptions, Level, SchwarzFactor,
    SchwarzOptions, SchwarzStop, SolveError, Values,
};

/// A system with its points placed and nothing factored yet.
pub(super) struct UnfactoredSystem {
    frame: UnitFrame,
    pub size: FitSize,
    anchors: Anchors,
    collocation: Vec<SurfacePoint>,
    /// Positions and area shares of the collocation points, in the unit frame.
    points: Vec<Point>,
    weights: Vec<f64>,
    /// In the unit frame.
    sources: SourceSets,
    affine: bool,
}

/// A factored system.
pub(super) struct System {
    frame: UnitFrame,
    pub size: FitSize,
    /// The vertices that the sources of the finest level before refinement belong to.
    pub anchors: Anchors,
    sources: Vec<Point>,
    pub collocation: Vec<SurfacePoint>,
    factor: Factor,
    affine: bool,
    /// Made when boundary values are solved for first; `None` where there are none.
    distant: OnceLock<Option<DistantSources>>,
}

enum Factor {
    Dense {
        factor: Box<DenseFactor>,
        options: DenseOptions,
        /// The collocation points and their area shares in the unit frame.
        points: Vec<Point>,
        areas: Vec<f64>,
    },
    Schwarz(Box<SchwarzFactor>, SchwarzOptions),
}

/// Fraction of the residual tolerance that may be lost by solving for fewer modes than right-hand sides.
const TRUNCATION: f64 = 0.1;

impl UnfactoredSystem {
    pub fn new(placed: PlacedPoints, domain: &SurfaceMesh, options: &FitOptions) -> Self {
        let frame = UnitFrame::of(domain);
        let (sources, source_count, patch_entries) = match placed.sources {
            SourceSets::Levels(levels, options) => {
                let levels: Vec<Level> = levels.into_iter().map(|level| frame.level_to_unit(level)).collect();
                let count = levels.iter().map(|level| level.sources.len()).sum();
                let entries = SchwarzFactor::patch_entries(&levels[1..], &options);
                (SourceSets::Levels(levels, options), count, Some(entries))
            }
            SourceSets::Dense(sources, options) => {
                let count = sources.len();
                (SourceSets::Dense(frame.all_to_unit(&sources), options), count, None)
            }
        };
        Self {
            frame,
            size: FitSize {
                sources: source_count,
                collocation: placed.collocation.points.len(),
                patch_entries,
                ..FitSize::of(domain, options)
            },
            anchors: placed.anchors,
            points: frame.all_to_unit(&positions(domain, &placed.collocation.points)),
            weights: frame.areas_to_unit(&placed.collocation.areas),
            collocation: placed.collocation.points,
            sources,
            affine: options.affine,
        }
    }

    pub fn factor(self, progress: &Progress) -> Result<System, FitError> {
        let (sources, factor) = match self.sources {
            SourceSets::Levels(levels, options) => {
                let report = |done, of| progress.report(Phase::Factoring { done, of });
                let factor = SchwarzFactor::new(self.points, self.weights, &levels, self.affine, &options, &report)?;
                let sources: Vec<Point> = levels.into_iter().flat_map(|level| level.sources).collect();
                (sources, Factor::Schwarz(Box::new(factor), options))
            }
            SourceSets::Dense(sources, options) => {
                let system = CollocationSystem {
                    collocation: &self.points,
                    row_weights: &row_weights(&self.weights),
                    sources: &sources,
                    affine: self.affine,
                };
                let phase = Phase::Decomposing {
                    rows: self.points.len(),
                    columns: system.unknowns(),
                };
                progress.enter(phase)?;
                let factor = DenseFactor::new_with_progress(&system, &options, &|| progress.report(phase))?;
                let factor = Factor::Dense {
                    factor: Box::new(factor),
                    options,
                    points: self.points,
                    areas: self.weights,
                };
                (sources, factor)
            }
        };
        Ok(System {
            sources: self.frame.all_to_model(&sources),
            frame: self.frame,
            size: self.size,
            anchors: self.anchors,
            collocation: self.collocation,
            factor,
            affine: self.affine,
            distant: OnceLock::new(),
        })
    }
}

impl System {
    /// Coefficients for right-hand sides at the collocation points, to a root mean square residual of `tolerance` in every
    /// column or the least there is. Iterations start at the solution `start`, if given.
    pub fn solve(
        &self,
        right_hand_sides: &Values,
        start: Option<&SystemSolution>,
        tolerance: f64,
        progress: &Progress,
    ) -> Result<SystemSolution, FitError> {
        match &self.factor {
            Factor::Dense { factor, points, .. } => {
                progress.enter(Phase::Solving)?;
                let coefficients = factor.solve_columns(right_hand_sides)?;
                let values = values(&self.sums(points, 0.0)?, &coefficients, points)?;
                Ok(SystemSolution {
                    coefficients,
                    modes: None,
                    is_distant: false,
                    residuals: residual_norms(&right_hand_sides.minus(&values)),
                    tolerance,
                    iterations: 1,
                    stop: None,
                })
            }
            Factor::Schwarz(factor, _) => {
                let report = |iteration, residual| progress.report(Phase::Iterating { iteration, residual });
                // Refinement follows where they did not suffice.
                if start.is_none()
                    && let Some(solution) = self.by_distant_sources(factor, right_hand_sides, tolerance)?
                {
                    return Ok(solution);
                }
                let start = start.filter(|start| !start.is_distant).map(|start| &start.coefficients);
                let compressed = match start {
                    None if right_hand_sides.columns() > 3 => factor.modes_of(right_hand_sides, TRUNCATION * tolerance),
                    _ => None,
                };
                let (solution, residuals, modes) = match compressed {
                    None => {
                        let solution = factor.solve(right_hand_sides, start, tolerance, &report)?;
                        let residuals = residual_norms(&solution.residual);
                        (solution, residuals, None)
                    }
                    Some((data, modes)) => {
                        // The factors of a right-hand side in the modes, and so of its residual, have norm one at
                        // most.
                        let per_mode = tolerance / (data.columns() as f64).sqrt();
                        let solution = factor.solve(&data, None, per_mode, &report)?;
                        let values = modes.values(&data.minus(&solution.residual), factor.collocation());
                        (solution, residual_norms(&right_hand_sides.minus(&values)), Some(modes))
                    }
                };
                Ok(SystemSolution {
                    coefficients: solution.coefficients,
                    modes,
                    is_distant: false,
                    residuals,
                    tolerance,
                    iterations: solution.iterations,
                    stop: Some(solution.stop),
                })
            }
        }
    }

    /// The solution by distant sources alone; `None` unless they meet the tolerance. Those that fail are left out.
    fn by_distant_sources(
        &self,
        factor: &SchwarzFactor,
        right_hand_sides: &Values,
        tolerance: f64,
    ) -> Result<Option<SystemSolution>, FitError> {
        let points = factor.collocation();
        if self.distant.get().is_none() {
            let made = match self.affine {
                true => unless_failed(DistantSources::new(points, factor.weights()))?.flatten(),
                false => None,
            };
            // Another thread may have made the same.
            let _ = self.distant.set(made);
        }
        let Some(distant) = self.distant_sources() else {
            return Ok(None);
        };
        let Some(coefficients) = unless_failed(distant.fitted(right_hand_sides, points, tolerance))?.flatten() else {
            return Ok(None);
        };
        let Some(values) = unless_failed(distant.values(&coefficients, points))? else {
            return Ok(None);
        };
        let residuals = residual_norms(&right_hand_sides.minus(&values));
        let is_met = residuals.iter().all(|residual| residual.rms <= tolerance);
        Ok(is_met.then_some(SystemSolution {
            coefficients,
            modes: None,
            is_distant: true,
            residuals,
            tolerance,
            iterations: 0,
            stop: Some(SchwarzStop::Goal),
        }))
    }

    fn distant_sources(&self) -> Option<&DistantSources> {
        self.distant.get().and_then(Option::as_ref)
    }

    /// The map of each boundary map that was solved for.
    pub fn maps(&self, solution: &SystemSolution, data: &[BoundaryData]) -> Vec<HarmonicMap> {
        let coefficients = match &solution.modes {
            Some(modes) => Cow::Owned(modes.coefficients(&solution.coefficients)),
            None => Cow::Borrowed(&solution.coefficients),
        };
        let sources = self.sources_of(solution);
        let map = |(k, data): (usize, &BoundaryData)| {
            let unit = Coefficients::of_columns(&coefficients, 3 * k, sources.len());
            let coefficients = self.frame.coefficients_to_model(unit, data.diagonal, data.origin);
            let map = HarmonicMap::new(sources.to_vec(), coefficients).expect("one coefficient row per source");
            match solution.stop {
                Some(_) => map.with_error(solution.residuals[k].rms),
                None => map,
            }
        };
        data.iter().enumerate().map(map).collect()
    }

    /// The sources of the maps of a solution, in model units.
    pub fn sources_of(&self, solution: &SystemSolution) -> Cow<'_, [Point]> {
        match self.distant_sources() {
            Some(distant) if solution.is_distant => Cow::Owned(self.frame.all_to_model(&distant.positions)),
            _ => Cow::Borrowed(&self.sources),
        }
    }

    /// An evaluator of solutions at these points, whose sums have at most this relative error.
    pub fn evaluator(&self, points: &[Point], accuracy: f64) -> Result<Evaluator, FitError> {
        let points = self.frame.all_to_unit(points);
        Ok(Evaluator {
            sums: self.sums(&points, accuracy)?,
            points,
        })
    }

    /// Sums over all sources at points of the unit frame.
    fn sums(&self, points: &[Point], accuracy: f64) -> Result<Sums, FitError> {
        Ok(Sums::new(&self.frame.all_to_unit(&self.sources), points, accuracy).map_err(SolveError::from)?)
    }

    /// The size of the system with a further level.
    pub fn refined_size(&self, finer: &FinerLevel) -> FitSize {
        let added = match &self.factor {
            Factor::Schwarz(_, options) => {
                let level = self.frame.level_to_unit(finer.level.clone());
                Some(SchwarzFactor::patch_entries(&[level], options))
            }
            Factor::Dense { .. } => None,
        };
        FitSize {
            sources: self.size.sources + finer.level.sources.len(),
            collocation: self.size.collocation + finer.points.len(),
            refinements: self.size.refinements + 1,
            patch_entries: self.size.patch_entries.zip(added).map(|(kept, added)| kept + added),
            ..self.size
        }
    }

    /// Adds a level and its collocation points; a dense system stays as it is.
    pub fn refine(&mut self, domain: &SurfaceMesh, finer: FinerLevel, progress: &Progress) -> Result<(), FitError> {
        let size = self.refined_size(&finer);
        let Factor::Schwarz(factor, _) = &mut self.factor else {
            return Ok(());
        };
        let points = self.frame.all_to_unit(&positions(domain, &finer.points));
        let weights = self.frame.areas_to_unit(&finer.areas);
        let level = self.frame.level_to_unit(finer.level);
        let report = |done, of| progress.report(Phase::Factoring { done, of });
        factor.refine(&points, &weights, &level, &report)?;
        self.collocation.extend(finer.points);
        self.sources.extend(self.frame.all_to_model(&level.sources));
        self.size = size;
        Ok(())
    }

    /// Positions of the sources that lower the residual of some boundary values; `None` for the Schwarz solver.
    pub fn free_sources(
        &self,
        domain: &SurfaceMesh,
        right_hand_sides: &Values,
        progress: &dyn Fn(Phase) -> ProgressControl,
    ) -> Result<Option<FreedSources>, FitError> {
        let Factor::Dense {
            options, points, areas, ..
        } = &self.factor
        else {
            return Ok(None);
        };
        let system = CollocationSystem {
            collocation: points,
            row_weights: &row_weights(areas),
            sources: &self.frame.all_to_unit(&self.sources),
            affine: self.affine,
        };
        let ridge = options.truncation.max(f64::EPSILON);
        freed(domain, (&system, areas), right_hand_sides, ridge, progress).map(Some)
    }

    /// The dense system with its sources at other positions, given in the unit frame; `None` for the Schwarz solver.
    pub fn with_sources(&self, sources: Vec<Point>, progress: &Progress) -> Result<Option<Self>, FitError> {
        let Factor::Dense {
            options, points, areas, ..
        } = &self.factor
        else {
            return Ok(None);
        };
        let unfactored = UnfactoredSystem {
            frame: self.frame,
            size: self.size,
            anchors: self.anchors.clone(),
            collocation: self.collocation.clone(),
            points: points.clone(),
            weights: areas.clone(),
            sources: SourceSets::Dense(sources, *options),
            affine: self.affine,
        };
        unfactored.factor(progress).map(Some)
    }

    /// `"schwarz"`, `"dense-qr"` or `"dense-svd"`.
    pub fn method(&self) -> &'static str {
        match self.factor {
            Factor::Schwarz(..) => "schwarz",
            Factor::Dense { options, .. } => match options.decomposition {
                Decomposition::Qr => "dense-qr",
                Decomposition::Svd => "dense-svd",
            },
        }
    }

    /// Rank and condition number of a dense decomposition.
    pub fn rank_and_condition(&self) -> Option<(usize, f64)> {
        match &self.factor {
            Factor::Dense { factor, .. } => Some((factor.rank(), factor.condition())),
            Factor::Schwarz(..) => None,
        }
    }
}

/// Coefficients for the right-hand sides of some boundary maps, and how they were found.
pub(super) struct SystemSolution {
    /// In the unit frame: those of the right-hand sides, or of their modes.
    pub coefficients: Values,
    modes: Option<BasisModes>,
    /// Whether they are those of the distant sources. A map has either kind of sources, never both: coefficients of distant ones are
    /// so large, and cancel so much, that fast sums over all would be rough.
    is_distant: bool,
    /// For each boundary map.
    pub residuals: Vec<ResidualNorm>,
    tolerance: f64,
    pub iterations: usize,
    pub stop: Option<SchwarzStop>,
}

/// Misfit of a map at the collocation points, in units of the target's diagonal.
pub(super) struct ResidualNorm {
    pub sum_of_squares: f64,
    pub rms: f64,
}

impl SystemSolution {
    /// Estimate of the smallest error of the maps, which decides how accurately they are measured.
    pub fn expected_error(&self) -> f64 {
        match self.stop {
            Some(_) => self
                .residuals
                .iter()
                .map(|residual| residual.rms.max(self.tolerance))
                .fold(f64::INFINITY, f64::min),
            // The dense solver is the reference, and measured exactly.
            None => 0.0,
        }
    }
}

/// The norms for each map, which has three columns.
fn residual_norms(residual: &Values) -> Vec<ResidualNorm> {
    let norm = |first: usize| {
        let square = |r: usize| residual.row(r)[first..first + 3].iter().map(|v| v * v).sum::<f64>();
        let sum_of_squares: f64 = (0..residual.rows()).map(square).sum();
        ResidualNorm {
            sum_of_squares,
            rms: (sum_of_squares / residual.rows().max(1) as f64).sqrt(),
        }
    };
    let maps = (0..residual.columns() / 3).into_par_iter();
    maps.map(|k| norm(3 * k)).collect()
}

/// Sums over the sources of a system at fixed points, for any number of solutions.
pub(super) struct Evaluator {
    sums: Sums,
    /// In the unit frame.
    points: Vec<Point>,
}

impl Evaluator {
    /// Values of the right-hand sides' functions at the points.
    pub fn values(&self, system: &System, solution: &SystemSolution, accuracy: f64) -> Result<Values, FitError> {
        if let Some(distant) = system.distant_sources().filter(|_| solution.is_distant) {
            return distant.values(&solution.coefficients, &self.points);
        }
        let values = values(&self.sums.with_accuracy(accuracy), &solution.coefficients, &self.points)?;
        Ok(match &solution.modes {
            Some(modes) => modes.values(&values, &self.points),
            None => values,
        })
    }
}

/// What could be made; `None` where it failed, but not where the work was cancelled or needs too much memory.
fn unless_failed<T>(made: Result<T, FitError>) -> Result<Option<T>, FitError> {
    match made {
        Err(error @ (FitError::Cancelled | FitError::TooLarge { .. } | FitError::Solve(SolveError::Cancelled))) => {
            Err(error)
        }
        made => Ok(made.ok()),
    }
}

/// Values of all columns of a solution at the points of `sums`.
pub(super) fn values(sums: &Sums, coefficients: &Values, points: &[Point]) -> Result<Values, FitError> {
    let columns = coefficients.columns();
    let (of_sources, affine) = coefficients.as_slice().split_at(sums.sources() * columns);
    let potential = sums.potential(of_sources, columns).map_err(SolveError::from)?;
    let mut values = Values::new(columns, potential);
    values.add_affine(affine, points);
    Ok(values)
}

/// The square roots of areas, whose mean is 1: they make the squared residual an integral over the surface.
fn row_weights(areas: &[f64]) -> Vec<f64> {
    let mean = areas.iter().sum::<f64>() / areas.len().max(1) as f64;
    areas.iter().map(|area| (area / mean).sqrt()).collect()
}

fn positions(domain: &SurfaceMesh, points: &[SurfacePoint]) -> Vec<Point> {
    points.iter().map(|p| p.position(domain, domain.vertices())).collect()
}

#[cfg(test)]
mod tests {
    use std::ops::ControlFlow;

    use super::*;
    use crate::boundary_map::BoundaryMap;
    use crate::geometry::test_models;
    use crate::kernel::direct;
    use crate::mesh::shapes;
    use crate::solver::{DenseOptions, SchwarzOptions};

    /// What the Schwarz solver is given for a domain, and data for it.
    struct Case {
        domain: SurfaceMesh,
        points: Vec<Point>,
        weights: Vec<f64>,
        collocation: Vec<SurfacePoint>,
        levels: Vec<Level>,
    }

    impl Case {
        fn new(domain: SurfaceMesh, max_sources: usize) -> Self {
            let options = FitOptions {
                max_sources,
                ..FitOptions::adaptive()
            };
            let progress = Progress(&|_| ControlFlow::Continue(()));
            let placed = PlacedPoints::new(&domain, &options, &mut Vec::new(), &progress).unwrap();
            let system = UnfactoredSystem::new(placed, &domain, &options);
            let SourceSets::Levels(levels, _) = system.sources else {
                panic!("levels for the Schwarz solver");
            };
            Self {
                points: system.points,
                weights: system.weights,
                collocation: system.collocation,
                levels,
                domain,
            }
        }

        fn schwarz(&self, options: &SchwarzOptions) -> SchwarzFactor {
            let (points, weights) = (self.points.clone(), self.weights.clone());
            SchwarzFactor::new(points, weights, &self.levels, true, options, &|_, _| {}).unwrap()
        }

        fn data(&self, f: impl Fn(&Point) -> Point) -> Values {
            let frame = UnitFrame::of(&self.domain);
            let image = self.domain.vertices().iter().map(|p| f(&frame.to_unit(p))).collect();
            let boundary = BoundaryMap::new(self.domain.clone(), image).unwrap();
            let rows: Vec<[f64; 3]> = boundary
                .evaluate(&self.collocation)
                .iter()
                .map(|p| (*p).into())
                .collect();
            Values::from_triples(&rows)
        }

        fn sources(&self) -> Vec<Point> {
            self.levels.iter().flat_map(|level| level.sources.clone()).collect()
        }

        /// Weighted root mean square residual of coefficients, summed term by term.
        fn residual(&self, data: &Values, sources: &[Point], coefficients: &Values) -> f64 {
            let rows: Vec<[f64; 3]> = (0..sources.len() + 4)
                .map(|r| std::array::from_fn(|k| coefficients.row(r)[k]))
                .collect();
            let (of_sources, affine) = rows.split_at(sources.len());
            let kernel_sources = direct::Sources::new(sources, of_sources).unwrap();
            let potential = direct::potential(&kernel_sources, &self.points);
            let rows = self.points.iter().zip(&self.weights).enumerate();
            let squares = rows.map(|(r, (p, weight))| {
                let error = |k: usize| {
                    let linear = affine[0][k] + affine[1][k] * p.x + affine[2][k] * p.y + affine[3][k] * p.z;
                    data.row(r)[k] - potential[r][k] - linear
                };
                weight * (0..3).map(|k| error(k).powi(2)).sum::<f64>()
            });
            (squares.sum::<f64>() / self.weights.iter().sum::<f64>()).sqrt()
        }
    }

    /// Radial projection onto the unit sphere.
    fn radial(p: &Point) -> Point {
        Point::from(p.coords / p.coords.norm().max(0.05))
    }

    /// Radial projection onto the cube, with creases where the face changes.
    fn onto_cube(p: &Point) -> Point {
        Point::from(p.coords / p.coords.amax().max(0.05))
    }

    fn smooth(p: &Point) -> Point {
        let potential = |x, y, z| 1.0 / (p - Point::new(x, y, z)).norm();
        Point::new(
            potential(2.0, 0.3, 0.1),
            potential(-0.3, 1.7, 0.2),
            p.z + potential(1.0, 1.0, -1.5),
        )
    }

    fn procedural() -> Vec<(&'static str, SurfaceMesh, usize)> {
        vec![
            ("bumpy ball", shapes::bumpy_sphere(12), usize::MAX),
            ("genus 2", shapes::double_torus(6), usize::MAX),
            ("cube of few sources", shapes::cube(1.0, 25), 1100),
        ]
    }

    fn real() -> Vec<(&'static str, SurfaceMesh, usize)> {
        let load = |(name, sources)| Some((name, test_models::load(name)?, sources));
        [
            ("surfaces/igea_15k.obj", 2000),
            ("surfaces/kitten_g1_9k.obj", 1500),
            ("surfaces/double_torus_g2_3k.obj", 1500),
            ("surfaces/spot_uv_2k9.obj", 1200),
        ]
        .into_iter()
        .filter_map(load)
        .collect()
    }

    /// How far the residual is above the optimum of the finest level alone, the problem that the coarser levels are to
    /// help solve; 1 when below a fiftieth of the default tolerance, where fits stop anyway. The dense solver truncates
    /// so low that it has the least residual up to rounding; both are summed anew, term by term.
    fn excess(name: &str, case: &Case) -> f64 {
        let schwarz = case.schwarz(&SchwarzOptions::default());
        let (all, finest) = (case.sources(), &case.levels[case.levels.len() - 1].sources);
        let system = CollocationSystem {
            collocation: &case.points,
            row_weights: &case.weights.iter().map(|w| w.sqrt()).collect::<Vec<_>>(),
            sources: finest,
            affine: true,
        };
        let options = DenseOptions {
            truncation: 1e-14,
            ..DenseOptions::default()
        };
        let dense = DenseFactor::new(&system, &options).unwrap();
        let excess_of = |(kind, data): (&str, Values)| {
            let solution = schwarz.solve(&data, None, 0.0, &|_, _| {}).unwrap();
            let found = case.residual(&data, &all, &solution.coefficients);
            let least = case.residual(&data, finest, &dense.solve_columns(&data).unwrap());
            let (iterations, n) = (solution.iterations, finest.len());
            println!("{name}, {n} sources, {kind}: {found:.3e} in {iterations} iterations, optimum {least:.3e}");
            if found < 0.02 * FitOptions::adaptive().tolerance {
                1.0
            } else {
                found / least
            }
        };
        let kinds = [
            ("radial", case.data(radial)),
            ("onto_cube", case.data(onto_cube)),
            ("smooth", case.data(smooth)),
        ];
        kinds.into_iter().map(excess_of).fold(0.0, f64::max)
    }

    #[test]
    fn schwarz_comes_within_a_tenth_of_dense_least_squares() {
        for (name, domain, sources) in procedural() {
            let excess = excess(name, &Case::new(domain, sources));
            assert!(excess < 1.1, "{name}: {excess}");
        }
    }

    #[test]
    fn schwarz_comes_within_a_tenth_of_dense_least_squares_on_real_models() {
        for (name, domain, sources) in real() {
            let excess = excess(name, &Case::new(domain, sources));
            assert!(excess < 1.1, "{name}: {excess}");
        }
    }

    #[test]
    fn schwarz_comes_within_a_tenth_of_dense_least_squares_at_4000_sources() {
        for (name, domain, _) in real().into_iter().take(2) {
            let excess = excess(name, &Case::new(domain, 4000));
            assert!(excess < 1.1, "{name}: {excess}");
        }
    }

    #[test]
    fn what_fails_is_left_out_but_not_what_is_cancelled_or_too_large() {
        assert_eq!(unless_failed(Ok(1)).unwrap(), Some(1));
        let numerical = FitError::Solve(SolveError::RankZero { truncation: 0.0 });
        assert_eq!(unless_failed::<u32>(Err(numerical)).unwrap(), None);
        let cancelled = unless_failed::<u32>(Err(SolveError::Cancelled.into()));
        assert!(matches!(cancelled, Err(FitError::Cancelled)));
        let too_large = FitError::TooLarge {
            sources: 1,
            collocation: 1,
            need: 1,
            allowed: 0,
            fitting: 0,
            addresses_are_short: false,
        };
        assert!(matches!(
            unless_failed::<u32>(Err(too_large)),
            Err(FitError::TooLarge { .. })
        ));
    }

    #[test]
    fn a_solution_needs_no_more_than_one_iteration_to_be_found_again() {
        let case = Case::new(shapes::bumpy_sphere(16), usize::MAX);
        let (factor, data) = (case.schwarz(&SchwarzOptions::default()), case.data(radial));
        let first = factor.solve(&data, None, 0.0, &|_, _| {}).unwrap();
        let again = factor.solve(&data, Some(&first.coefficients), 0.0, &|_, _| {}).unwrap();
        let (before, after) = (
            first.history[first.history.len() - 1],
            again.history[again.history.len() - 1],
        );
        assert!(again.iterations <= 1, "{:?} then {:?}", first.history, again.history);
        assert!(after <= before * (1.0 + 1e-6), "{before:e} then {after:e}");
        // A goal just above the residual already reached is met at once.
        let met = factor
            .solve(&data, Some(&first.coefficients), 1.01 * before, &|_, _| {})
            .unwrap();
        assert_eq!((met.iterations, met.stop), (0, SchwarzStop::Goal));
    }

    #[test]
    fn iterations_stop_at_the_goal_a_plateau_or_the_limit() {
        let case = Case::new(shapes::bumpy_sphere(16), usize::MAX);
        let data = case.data(smooth);
        let factor = case.schwarz(&SchwarzOptions::default());
        let plateau = factor.solve(&data, None, 0.0, &|_, _| {}).unwrap();
        assert_eq!(plateau.stop, SchwarzStop::Plateau);
        let least = plateau.history[plateau.history.len() - 1];
        assert!((case.residual(&data, &case.sources(), &plateau.coefficients) / least - 1.0).abs() < 1e-3);

        let goal = 100.0 * least;
        let early = factor.solve(&data, None, goal, &|_, _| {}).unwrap();
        assert_eq!(early.stop, SchwarzStop::Goal);
        assert!(early.iterations < plateau.iterations);
        let found = case.residual(&data, &case.sources(), &early.coefficients);
        assert!(found <= 3f64.sqrt() * goal && found > least, "{found:e}");

        let one_iteration = SchwarzOptions {
            most_iterations: 1,
            plateau: 1.0,
            ..SchwarzOptions::default()
        };
        let cut = case
            .schwarz(&one_iteration)
            .solve(&data, None, 0.0, &|_, _| {})
            .unwrap();
        assert_eq!((cut.iterations, cut.stop), (1, SchwarzStop::Iterations));
    }

    /// Zero data, affine data (in the basis), and data with the wrong number of rows.
    #[test]
    fn trivial_data_are_solved_and_mismatched_data_are_refused() {
        let case = Case::new(shapes::bumpy_sphere(12), usize::MAX);
        let factor = case.schwarz(&SchwarzOptions::default());
        let zero = factor
            .solve(&Values::zeros(case.points.len(), 2), None, 0.0, &|_, _| {})
            .unwrap();
        assert!(zero.coefficients.as_slice().iter().all(|w| *w == 0.0) && zero.iterations == 0);
        let affine = case.data(|p| Point::new(1.0 + p.x, 2.0 * p.y - p.z, 3.0 * p.z));
        let solution = factor.solve(&affine, None, 1e-10, &|_, _| {}).unwrap();
        assert!(
            case.residual(&affine, &case.sources(), &solution.coefficients) < 1e-10,
            "{:?}",
            solution.history
        );
        let few = Values::zeros(case.points.len() - 1, 3);
        let error = factor.solve(&few, None, 0.0, &|_, _| {});
        assert!(matches!(error, Err(crate::solver::SolveError::DataLength { .. })));
    }
}

//! The linear system of a domain: points placed and the matrix factored. Boundary values go in, coefficients come out.

use rayon::prelude::*;

use super::frame::Frame;
use super::levels::levels;
use super::options::{Size, Solver};
use super::placement::{place_collocation, place_sources};
use super::refinement::Finer;
use super::{FitError, FitOptions, Phase, Placement, Tell, Workload, go_on};
use crate::Point;
use crate::geometry::SurfaceQuery;
use crate::kernel::Sums;
use crate::mesh::{SurfaceMesh, SurfacePoint};
use crate::sampling::Anchors;
use crate::solver::{
    BasisModes, CollocationSystem, Decomposition, DenseFactor, SchwarzFactor, SchwarzStop, SolveError, Values,
};

/// A factored system, its points in model units.
pub(super) struct System {
    /// The finest level as it was placed first.
    pub anchors: Anchors,
    pub sources: Vec<Point>,
    pub collocation: Vec<SurfacePoint>,
    solver: Factor,
}

enum Factor {
    /// With the collocation points in the unit frame.
    Dense(Box<DenseFactor>, Decomposition, Vec<Point>),
    Schwarz(Box<SchwarzFactor>),
}

/// Part of the goal for the residual that may be lost by solving for modes of the data.
const TRUNCATION: f64 = 0.1;

/// Coefficients in the unit frame and how they were found.
pub(super) struct Solved {
    pub coefficients: Values,
    /// How the data's coefficients follow from these, where they are those of fewer modes.
    mixing: Option<BasisModes>,
    /// Data minus values at the collocation points.
    pub residual: Values,
    pub iterations: usize,
    pub stop: Option<SchwarzStop>,
}

impl Solved {
    /// Coefficients for the data.
    pub fn coefficients_of_data(&self) -> Values {
        match &self.mixing {
            Some(mixing) => mixing.coefficients(&self.coefficients),
            None => self.coefficients.clone(),
        }
    }

    /// Values at points of the unit frame, from what the coefficients give there.
    pub fn values_of_data(&self, values: Values, points: &[Point]) -> Values {
        match &self.mixing {
            Some(mixing) => mixing.values(&values, points),
            None => values,
        }
    }
}

impl System {
    /// Places sources and collocation points. Gives what is needed to factor it, so that the two are timed apart.
    pub fn place(
        domain: &SurfaceMesh,
        frame: &Frame,
        options: &FitOptions,
        warnings: &mut Vec<String>,
    ) -> Result<Placed, FitError> {
        let size = Size::of(domain, options);
        warnings.extend(size.remark());
        let anchors = Anchors::choose(domain, size.sources);
        let collocation = place_collocation(domain, &anchors, &size, options);
        let points = collocation
            .points
            .iter()
            .map(|p| frame.to_unit(&p.position(domain, domain.vertices())))
            .collect();
        let layout = match (options.solver, options.placement) {
            (Solver::Schwarz(schwarz), Placement::Adaptive { alpha }) => {
                let query = SurfaceQuery::with_winding_sign(domain)?;
                let levels = levels(domain, &anchors, &collocation, alpha, &query, frame, warnings)?;
                Layout::Levels(levels, schwarz)
            }
            (Solver::Schwarz(_), _) => return Err(FitError::SchwarzNeedsNearSources),
            (Solver::Dense(dense), _) => {
                let sources = place_sources(domain, &anchors, &size, options, warnings)?;
                Layout::Dense(sources.iter().map(|q| frame.to_unit(q)).collect(), dense)
            }
        };
        Ok(Placed {
            anchors,
            points,
            weights: frame.unit_areas(&collocation.areas),
            collocation: collocation.points,
            layout,
            affine: options.affine,
        })
    }

    pub fn solve(
        &self,
        frame: &Frame,
        data: &Values,
        start: Option<&Values>,
        goal: f64,
        progress: Tell,
    ) -> Result<Solved, FitError> {
        match &self.solver {
            Factor::Dense(dense, _, points) => {
                go_on(progress(Phase::Solving))?;
                let coefficients = dense.solve_columns(data)?;
                let values = values(&self.sums(frame, points, 0.0)?, &coefficients, points)?;
                Ok(Solved {
                    residual: data.minus(&values),
                    coefficients,
                    mixing: None,
                    iterations: 1,
                    stop: None,
                })
            }
            Factor::Schwarz(schwarz) => {
                let report = |iteration, residual| progress(Phase::Iterating { iteration, residual });
                let compressed = match start {
                    None if data.columns() > 3 => schwarz.modes_of(data, TRUNCATION * goal),
                    _ => None,
                };
                let Some((modes, mixing)) = compressed else {
                    let solution = schwarz.solve(data, start, goal, &report)?;
                    return Ok(Solved {
                        coefficients: solution.coefficients,
                        mixing: None,
                        residual: solution.residual,
                        iterations: solution.iterations,
                        stop: Some(solution.stop),
                    });
                };
                // A frame is a mixture of all modes with factors of norm one, and so may be its residual.
                let goal = goal / (modes.columns() as f64).sqrt();
                let solution = schwarz.solve(&modes, None, goal, &report)?;
                Ok(Solved {
                    coefficients: solution.coefficients,
                    residual: data.minus(&mixing.values(&modes.minus(&solution.residual), schwarz.collocation())),
                    mixing: Some(mixing),
                    iterations: solution.iterations,
                    stop: Some(solution.stop),
                })
            }
        }
    }

    /// Adds a level and its collocation points.
    pub fn refine(
        &mut self,
        domain: &SurfaceMesh,
        frame: &Frame,
        finer: Finer,
        progress: Tell,
    ) -> Result<(), FitError> {
        let Factor::Schwarz(schwarz) = &mut self.solver else {
            return Ok(());
        };
        let points = finer
            .points
            .iter()
            .map(|p| frame.to_unit(&p.position(domain, domain.vertices())))
            .collect::<Vec<_>>();
        let report = |done, of| progress(Phase::Factoring { done, of });
        schwarz.refine(&points, &frame.unit_areas(&finer.areas), &finer.level, &report)?;
        self.collocation.extend(finer.points);
        self.sources
            .extend(finer.level.sources.iter().map(|q| frame.to_model_point(q)));
        Ok(())
    }

    /// Sums over all sources at points of the unit frame.
    pub fn sums(&self, frame: &Frame, points: &[Point], accuracy: f64) -> Result<Sums, FitError> {
        let sources: Vec<Point> = self.sources.iter().map(|q| frame.to_unit(q)).collect();
        Ok(Sums::new(&sources, points, accuracy).map_err(SolveError::from)?)
    }

    /// Whether levels can be added.
    pub fn is_refinable(&self) -> bool {
        matches!(self.solver, Factor::Schwarz(_))
    }

    /// `"schwarz"`, `"dense-qr"` or `"dense-svd"`.
    pub fn method(&self) -> &'static str {
        match self.solver {
            Factor::Schwarz(_) => "schwarz",
            Factor::Dense(_, Decomposition::Qr, _) => "dense-qr",
            Factor::Dense(_, Decomposition::Svd, _) => "dense-svd",
        }
    }

    /// Rank and condition number of a dense decomposition.
    pub fn rank_and_condition(&self) -> Option<(usize, f64)> {
        match &self.solver {
            Factor::Dense(dense, ..) => Some((dense.rank(), dense.condition())),
            Factor::Schwarz(_) => None,
        }
    }
}

/// Values of all columns of a solution at the points of `sums`.
pub(super) fn values(sums: &Sums, coefficients: &Values, points: &[Point]) -> Result<Values, FitError> {
    let columns = coefficients.columns();
    let (weights, affine) = coefficients.as_slice().split_at(sums.sources() * columns);
    let mut values = sums.potential(weights, columns).map_err(SolveError::from)?;
    for (function, row) in affine.chunks_exact(columns).enumerate() {
        values.par_chunks_mut(columns).zip(points).for_each(|(value, p)| {
            let factor = if function == 0 { 1.0 } else { p[function - 1] };
            value.iter_mut().zip(row).for_each(|(value, a)| *value += a * factor);
        });
    }
    Ok(Values::new(columns, values))
}

/// Points placed, nothing factored yet.
pub(super) struct Placed {
    anchors: Anchors,
    collocation: Vec<SurfacePoint>,
    /// Positions and area shares of the collocation points in the unit frame.
    points: Vec<Point>,
    weights: Vec<f64>,
    layout: Layout,
    affine: bool,
}

enum Layout {
    Levels(Vec<crate::solver::Level>, crate::solver::SchwarzOptions),
    Dense(Vec<Point>, crate::solver::DenseOptions),
}

impl Placed {
    /// What factoring will take for these points, of a domain with so many vertices.
    pub fn work(&self, vertices: usize) -> Workload {
        let (sources, local_numbers, solver) = match &self.layout {
            Layout::Levels(levels, options) => {
                let local = levels.get(1..).unwrap_or_default();
                let kept = SchwarzFactor::patch_entries(local, options);
                let sources = levels.iter().map(|level| level.sources.len()).sum();
                (sources, Some(kept), Solver::Schwarz(*options))
            }
            Layout::Dense(sources, options) => (sources.len(), None, Solver::Dense(*options)),
        };
        Workload {
            vertices,
            sources,
            collocation: self.points.len(),
            maps: 1,
            refinements: 0,
            local_numbers,
            solver,
        }
    }

    pub fn factor(self, frame: &Frame, progress: Tell) -> Result<System, FitError> {
        let (sources, solver) = match self.layout {
            Layout::Levels(levels, options) => {
                let report = |done, of| progress(Phase::Factoring { done, of });
                let factor = SchwarzFactor::new(self.points, self.weights, &levels, self.affine, &options, &report)?;
                let sources = levels.into_iter().flat_map(|level| level.sources).collect();
                (sources, Factor::Schwarz(Box::new(factor)))
            }
            Layout::Dense(sources, options) => {
                let mean = self.weights.iter().sum::<f64>() / self.weights.len().max(1) as f64;
                let system = CollocationSystem {
                    collocation: &self.points,
                    row_weights: &self.weights.iter().map(|w| (w / mean).sqrt()).collect::<Vec<_>>(),
                    sources: &sources,
                    affine: self.affine,
                };
                go_on(progress(Phase::Decomposing {
                    rows: self.points.len(),
                    columns: system.unknowns(),
                }))?;
                let factor = DenseFactor::new(&system, &options)?;
                (
                    sources,
                    Factor::Dense(Box::new(factor), options.decomposition, self.points),
                )
            }
        };
        let sources: Vec<Point> = sources;
        Ok(System {
            anchors: self.anchors,
            sources: sources.iter().map(|q| frame.to_model_point(q)).collect(),
            collocation: self.collocation,
            solver,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::boundary_map::BoundaryMap;
    use crate::geometry::test_models;
    use crate::kernel::direct;
    use crate::mesh::shapes;
    use crate::solver::{DenseOptions, Level, SchwarzOptions};

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
            let frame = Frame::of(&domain);
            let placed = System::place(&domain, &frame, &options, &mut Vec::new()).unwrap();
            let Layout::Levels(levels, _) = placed.layout else {
                panic!("levels for the Schwarz solver");
            };
            Self {
                points: placed.points,
                weights: placed.weights,
                collocation: placed.collocation,
                levels,
                domain,
            }
        }

        fn schwarz(&self, options: &SchwarzOptions) -> SchwarzFactor {
            let (points, weights) = (self.points.clone(), self.weights.clone());
            SchwarzFactor::new(points, weights, &self.levels, true, options, &|_, _| {}).unwrap()
        }

        fn data(&self, f: impl Fn(&Point) -> Point) -> Values {
            let frame = Frame::of(&self.domain);
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

        /// Weighted root mean square of what coefficients leave, summed term by term.
        fn residual(&self, data: &Values, sources: &[Point], coefficients: &Values) -> f64 {
            let rows: Vec<[f64; 3]> = (0..sources.len() + 4)
                .map(|r| std::array::from_fn(|k| coefficients.row(r)[k]))
                .collect();
            let (weights, affine) = rows.split_at(sources.len());
            let charges = direct::Sources::new(sources, weights).unwrap();
            let potential = direct::potential(&charges, &self.points);
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

    fn radial(p: &Point) -> Point {
        Point::from(p.coords / p.coords.norm().max(0.05))
    }

    /// A polycube of the nearest axis: creases all over.
    fn boxed(p: &Point) -> Point {
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

    /// How far the residual is above the optimum of the finest level alone, the problem that the coarser levels are to help
    /// solve; one when below a fiftieth of the default tolerance, where fits end before.
    /// The dense solver truncates so low that it has the least residual to rounding; both are summed afresh, term by term.
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
            ("boxed", case.data(boxed)),
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
        // What was found already is a goal that is met at once.
        let met = factor
            .solve(&data, Some(&first.coefficients), 1.01 * before, &|_, _| {})
            .unwrap();
        assert_eq!((met.iterations, met.stop), (0, SchwarzStop::Goal));
    }

    #[test]
    fn iterations_end_at_the_goal_the_plateau_or_their_number() {
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

        let none_left = SchwarzOptions {
            most_iterations: 1,
            plateau: 1.0,
            ..SchwarzOptions::default()
        };
        let cut = case.schwarz(&none_left).solve(&data, None, 0.0, &|_, _| {}).unwrap();
        assert_eq!((cut.iterations, cut.stop), (1, SchwarzStop::Iterations));
    }

    /// Nothing to fit, affine data (in the basis), and data that are not as many as the rows.
    #[test]
    fn trivial_and_wrong_data_are_answered() {
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

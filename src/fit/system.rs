//! The linear system of a domain: points placed and the matrix factored. Boundary values go in, coefficients come out.

use super::frame::Frame;
use super::levels::levels;
use super::options::{Size, Solver};
use super::placement::{place_collocation, place_sources};
use super::refinement::Finer;
use super::{FitError, FitOptions, Phase, Placement};
use crate::Point;
use crate::geometry::SurfaceQuery;
use crate::mesh::{SurfaceMesh, SurfacePoint};
use crate::sampling::Anchors;
use crate::solver::{CollocationSystem, DenseFactor, Method, SchwarzFactor, Stop, Values};

/// A factored system, its points in model units.
pub(super) struct System {
    /// The finest level as it was placed first.
    pub anchors: Anchors,
    pub sources: Vec<Point>,
    pub collocation: Vec<SurfacePoint>,
    solver: Factor,
}

enum Factor {
    Dense(DenseFactor, Method),
    Schwarz(Box<SchwarzFactor>),
}

/// Coefficients in the unit frame and how they were found.
pub(super) struct Solved {
    pub coefficients: Values,
    /// Data minus map at the collocation points, where the solver has it.
    pub residual: Option<Values>,
    pub iterations: usize,
    pub stop: Option<Stop>,
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
        data: &Values,
        start: Option<&Values>,
        goal: f64,
        progress: &dyn Fn(Phase),
    ) -> Result<Solved, FitError> {
        match &self.solver {
            Factor::Dense(dense, _) => {
                progress(Phase::Solving);
                Ok(Solved {
                    coefficients: dense.solve_columns(data)?,
                    residual: None,
                    iterations: 1,
                    stop: None,
                })
            }
            Factor::Schwarz(schwarz) => {
                let report = |iteration, residual| progress(Phase::Iterating { iteration, residual });
                let solution = schwarz.solve(data, start, goal, &report)?;
                Ok(Solved {
                    coefficients: solution.coefficients,
                    residual: Some(solution.residual),
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
        progress: &dyn Fn(Phase),
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

    /// Whether levels can be added.
    pub fn is_refinable(&self) -> bool {
        matches!(self.solver, Factor::Schwarz(_))
    }

    /// `"schwarz"`, `"dense-qr"` or `"dense-svd"`.
    pub fn method(&self) -> &'static str {
        match self.solver {
            Factor::Schwarz(_) => "schwarz",
            Factor::Dense(_, Method::Qr) => "dense-qr",
            Factor::Dense(_, Method::Svd) => "dense-svd",
        }
    }

    /// Rank and condition number of a dense decomposition.
    pub fn rank_and_condition(&self) -> Option<(usize, f64)> {
        match &self.solver {
            Factor::Dense(dense, _) => Some((dense.rank(), dense.condition())),
            Factor::Schwarz(_) => None,
        }
    }
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
    pub fn factor(self, frame: &Frame, progress: &dyn Fn(Phase)) -> Result<System, FitError> {
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
                progress(Phase::Decomposing {
                    rows: self.points.len(),
                    columns: system.unknowns(),
                });
                let factor = DenseFactor::new(&system, &options)?;
                (sources, Factor::Dense(factor, options.method))
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

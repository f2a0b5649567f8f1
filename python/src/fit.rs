//! Fits, and factors of domains that serve many of them.

use std::sync::{Arc, Mutex, PoisonError};

use numpy::{PyArray2, PyReadonlyArray2, PyReadonlyArray3};
use pyo3::prelude::*;
use solidmap::Point;
use solidmap::boundary_map::BoundaryMap;
use solidmap::fit::{
    COLLOCATION_PER_FREE_SOURCE, DomainFactor, Fit, FitMethod, FitOptions, FitSize, Phase, Placement,
    self_intersection_warning,
};
use solidmap::mesh::SurfaceMesh;
use solidmap::solver::{Decomposition, DenseOptions, SchwarzOptions};

use crate::arrays::{Points, from_points};
use crate::boundary::{Boundary, Inputs, provenance};
use crate::error::Failure;
use crate::map::Map;
use crate::meshes::Surface;
use crate::run::{Step, of, part, run, step};

/// The program's options of the method.
#[derive(FromPyObject, Clone)]
#[pyo3(from_item_all)]
pub struct FitArguments {
    pub tolerance: f64,
    pub max_error: f64,
    pub max_local_error: f64,
    pub paper: bool,
    pub placement: Option<String>,
    pub alpha: Option<f64>,
    pub offset: Option<f64>,
    pub radius: Option<f64>,
    pub s_ratio: Option<f64>,
    pub c_ratio: Option<f64>,
    pub max_sources: Option<usize>,
    pub max_s_ratio: Option<f64>,
    pub memory: Option<u64>,
    pub method: Option<String>,
    pub truncation: Option<f64>,
    pub no_affine: bool,
    pub no_refine: bool,
    pub free_sources: bool,
    pub held_out: usize,
    pub seed: u64,
}

impl FitArguments {
    /// The library's options: where an option is not given, what those that are imply.
    pub fn options(&self) -> Result<FitOptions, Failure> {
        let implied = match (self.offset, self.radius) {
            (Some(_), _) => "offset",
            (None, Some(_)) => "sphere",
            (None, None) if self.paper => "offset",
            (None, None) => "adaptive",
        };
        let kind = self.placement.as_deref().unwrap_or(implied);
        for (is_given, name, its) in [
            (self.alpha.is_some(), "alpha", "adaptive"),
            (self.offset.is_some(), "offset", "offset"),
            (self.radius.is_some(), "radius", "sphere"),
        ] {
            if is_given && kind != its {
                return Err(Failure::invalid(format!(
                    "{name} has no meaning with placement=\"{kind}\""
                )));
            }
        }
        let base = match self.paper || kind != "adaptive" {
            true => FitOptions::paper(),
            false => FitOptions::adaptive(),
        };
        let placement = match kind {
            "offset" => Placement::Offset {
                distance: self.offset.unwrap_or(Placement::DEFAULT_DISTANCE),
            },
            "sphere" => Placement::Sphere {
                radius: self.radius.unwrap_or(Placement::DEFAULT_RADIUS),
            },
            _ => Placement::Adaptive {
                alpha: self.alpha.unwrap_or(Placement::DEFAULT_ALPHA),
            },
        };
        let by_default = match base.method {
            FitMethod::Schwarz { .. } if self.free_sources => "dense",
            FitMethod::Schwarz { .. } => "schwarz",
            FitMethod::Dense { .. } => "svd",
        };
        let dense = |decomposition| FitMethod::Dense {
            placement,
            options: DenseOptions {
                decomposition,
                truncation: self.truncation.unwrap_or(DenseOptions::default().truncation),
            },
        };
        let method = match self.method.as_deref().unwrap_or(by_default) {
            "schwarz" if self.truncation.is_some() => {
                return Err(Failure::invalid("truncation needs method=\"dense\" or \"svd\""));
            }
            "schwarz" => FitMethod::schwarz(placement, SchwarzOptions::default())?,
            "svd" => dense(Decomposition::Svd),
            _ => dense(Decomposition::Qr),
        };
        let source_ratio = self.s_ratio.unwrap_or(base.source_ratio);
        let collocation_ratio = match self.free_sources {
            true => COLLOCATION_PER_FREE_SOURCE * source_ratio,
            false => base.collocation_ratio,
        };
        Ok(FitOptions {
            method,
            source_ratio,
            collocation_ratio: self.c_ratio.unwrap_or(collocation_ratio),
            max_sources: self.max_sources.unwrap_or(method.default_max_sources()),
            max_source_ratio: self.max_s_ratio.unwrap_or(base.max_source_ratio),
            affine: !self.no_affine,
            tolerance: self.tolerance,
            max_error_ratio: self.max_error,
            max_local_error: self.max_local_error,
            refine: !self.no_refine,
            free_sources: self.free_sources,
            memory: self.memory,
            held_out: self.held_out,
            seed: self.seed,
        })
    }
}

pub fn fit_step(phase: Phase) -> Step {
    match phase {
        Phase::Checking => step("checking"),
        Phase::Sampling => step("placing sources"),
        Phase::Decomposing { rows, columns } => step(&format!("decomposing a {rows} × {columns} matrix")),
        Phase::Factoring { done, of } => part("factoring patches", done, of),
        Phase::Solving => step("solving"),
        Phase::Iterating { iteration, residual } => of(
            "solving",
            None,
            format!("iteration {iteration}, residual {residual:.1e}"),
        ),
        Phase::Measuring => step("measuring the boundary error"),
        Phase::MovingSources { round, residual } => of(
            "moving sources",
            None,
            format!("round {round}, residual {residual:.1e}"),
        ),
        Phase::Refining { round, error, sources } => of(
            "refining",
            None,
            format!("round {round}, error {error:.1e}, {sources} sources"),
        ),
    }
}

/// Fits a map, and says whether the tolerance is met.
#[pyfunction]
#[pyo3(signature = (boundary, arguments, inputs, progress=None, time_limit=None))]
pub fn fit(
    py: Python,
    boundary: &Boundary,
    arguments: FitArguments,
    inputs: Inputs,
    progress: Option<&Bound<'_, PyAny>>,
    time_limit: Option<f64>,
) -> PyResult<(Map, bool)> {
    let (file, options) = (Arc::clone(&boundary.0), arguments.options()?);
    run(py, progress, time_limit, move |watch| {
        let inputs_read = provenance(&inputs)?;
        let _ = watch.tell(|| step("looking for self-intersections"));
        let name = inputs
            .first()
            .map_or_else(|| "the domain".into(), |(_, path)| path.display().to_string());
        let warning = self_intersection_warning(file.boundary.domain(), &name);
        let mut found = solidmap::fit::fit(&file.boundary, &options, &|phase| {
            watch.tell_until_deadline(|| fit_step(phase))
        })?;
        found.report.warnings.extend(warning);
        let is_met = options.is_met_by(&found.report);
        Ok((Map::of(found, inputs_read), is_met))
    })
}

/// Bytes that a fit of this domain needs at the start, by an estimate.
#[pyfunction]
pub fn fit_memory(domain: &Surface, arguments: FitArguments) -> PyResult<u64> {
    Ok(FitSize::of(&domain.0, &arguments.options()?).bytes())
}

/// A domain, factored.
#[pyclass(frozen, module = "solidmap._solidmap")]
pub struct Factor {
    domain: Arc<SurfaceMesh>,
    factor: Arc<DomainFactor>,
    options: FitOptions,
}

#[pymethods]
impl Factor {
    /// `refined_for` is a boundary map that sources are added for.
    #[new]
    #[pyo3(signature = (domain, arguments, refined_for=None, progress=None))]
    fn new(
        py: Python,
        domain: &Surface,
        arguments: FitArguments,
        refined_for: Option<&Boundary>,
        progress: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let (domain, options) = (Arc::clone(&domain.0), arguments.options()?);
        let refined_for = refined_for.map(|boundary| Arc::clone(&boundary.0));
        run(py, progress, None, move |watch| {
            let progress = |phase| watch.tell(|| fit_step(phase));
            let mut factor = DomainFactor::new(&domain, &options, &progress)?;
            if let Some(file) = refined_for {
                factor.solve_refined(&file.boundary, &progress)?;
            }
            Ok(Self {
                domain,
                factor: Arc::new(factor),
                options,
            })
        })
    }

    #[getter]
    fn warnings(&self) -> Vec<String> {
        self.factor.warnings().to_vec()
    }

    fn solve(&self, py: Python, boundary: &Boundary, progress: Option<&Bound<'_, PyAny>>) -> PyResult<(Map, bool)> {
        let (file, factor, options) = (Arc::clone(&boundary.0), Arc::clone(&self.factor), self.options.clone());
        run(py, progress, None, move |watch| {
            let found = factor.solve(&file.boundary, &|phase| watch.tell(|| fit_step(phase)))?;
            let is_met = options.is_met_by(&found.report);
            Ok((Map::of(found, file.metadata.inputs.clone()), is_met))
        })
    }

    /// The maps of all frames, `k × n × 3` images of the vertices.
    fn solve_many<'py>(
        &self,
        py: Python<'py>,
        frames: PyReadonlyArray3<'py, f64>,
        progress: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Vec<(Map, bool)>> {
        let frames = self.frames(&frames)?;
        let (factor, options) = (Arc::clone(&self.factor), self.options.clone());
        run(py, progress, None, move |watch| {
            let fits = factor.solve_block(&frames, &|phase| watch.tell(|| fit_step(phase)))?;
            let with_verdict = |found: Fit| {
                let is_met = options.is_met_by(&found.report);
                (Map::of(found, vec![]), is_met)
            };
            Ok(fits.into_iter().map(with_verdict).collect())
        })
    }
}

/// Images of fixed points in one frame after the other.
#[pyclass(frozen, module = "solidmap._solidmap")]
pub struct FrameEvaluator(Arc<Mutex<solidmap::fit::FrameEvaluator>>);

#[pymethods]
impl FrameEvaluator {
    #[new]
    fn new<'py>(
        py: Python<'py>,
        factor: &Factor,
        points: PyReadonlyArray2<'py, f64>,
        most_modes: usize,
    ) -> PyResult<Self> {
        let (factor, points) = (Arc::clone(&factor.factor), Points::of("points", &points)?);
        run(py, None, None, move |_| {
            let frames = solidmap::fit::FrameEvaluator::new(factor, &points, most_modes)?;
            Ok(Self(Arc::new(Mutex::new(frames))))
        })
    }

    /// Images of the points, the boundary's root mean square error, what is left out, and the modes that were solved for.
    #[pyo3(signature = (images, progress=None))]
    #[allow(clippy::type_complexity, reason = "fields of a result")]
    fn evaluate<'py>(
        &self,
        py: Python<'py>,
        images: PyReadonlyArray2<'py, f64>,
        progress: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<(Bound<'py, PyArray2<f64>>, f64, f64, usize)> {
        let (frames, images) = (Arc::clone(&self.0), Points::of("images", &images)?);
        let found = run(py, progress, None, move |watch| {
            // Modes are added whole, so that they are sound after a panic, too.
            let mut frames = frames.lock().unwrap_or_else(PoisonError::into_inner);
            Ok(frames.evaluate(images.to_vec(), &|phase| watch.tell(|| fit_step(phase)))?)
        })?;
        let images = from_points(py, found.images)?;
        Ok((images, found.boundary_rms, found.left_out, found.solved))
    }

    #[getter]
    fn modes(&self, py: Python) -> usize {
        let frames = Arc::clone(&self.0);
        py.detach(move || frames.lock().unwrap_or_else(PoisonError::into_inner).modes())
    }
}

impl Factor {
    fn frames(&self, frames: &PyReadonlyArray3<'_, f64>) -> Result<Vec<BoundaryMap>, Failure> {
        use numpy::PyUntypedArrayMethods;
        let [count, vertices, columns] = [0, 1, 2].map(|axis| frames.shape()[axis]);
        if vertices != self.domain.vertices().len() || columns != 3 {
            let expected = self.domain.vertices().len();
            return Err(Failure::invalid(format!(
                "frames has the shape ({count}, {vertices}, {columns}), but must be (k, {expected}, 3), an image of every \
                 vertex of the domain for each frame"
            )));
        }
        let slice = frames
            .as_slice()
            .map_err(|_| Failure::invalid("frames is not in C order"))?;
        let all = slice.as_chunks::<3>().0;
        let each = all.chunks_exact(vertices.max(1)).enumerate().map(|(frame, images)| {
            let images: Vec<Point> = images.iter().map(|&xyz| Point::from(xyz)).collect();
            BoundaryMap::new(Arc::clone(&self.domain), images)
                .map_err(|error| Failure::invalid(format!("frames[{frame}]: {error}")))
        });
        each.collect()
    }
}

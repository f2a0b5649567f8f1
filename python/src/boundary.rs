//! Boundary maps: given, read, and made by way of the sphere.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use numpy::{PyArray2, PyArray3, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;
use serde_json::{Value, json};
use solidmap::boundary_map::check::{BoundaryCheckOptions, check};
use solidmap::boundary_map::pair::{
    LandmarkCurve, Landmarks, PairError, PairMethod, PairOptions, PairPhase, fitting_torus, map_pair,
    map_pair_with_alternatives,
};
use solidmap::boundary_map::{BoundaryMap, SurfaceDistortion, fundamental_domain};
use solidmap::files::{self, BoundaryFile, BoundaryMetadata, Provenance};
use solidmap::fit::self_intersection_finder;
use solidmap::improve::{ImproveOptions, ImprovePhase, improve_boundary};
use solidmap::io::{self, SolidMesh};
use solidmap::mesh::SurfacePoint;
use solidmap::spherical::{SphereEnergy, SphereOptions, SpherePhase, SphereStart, check_embedding, map_to_sphere};
use solidmap::{Point, Vector};

use crate::arrays::{Points, copy_of_corners, copy_of_points, copy_of_rows, entries, from_points, rows};
use crate::error::{ErrorKind, Failure};
use crate::fit::fit_step;
use crate::meshes::{Surface, json as to_json};
use crate::run::{Step, part, run, run_briefly, step};

/// Files by their roles.
pub type Inputs = Vec<(String, PathBuf)>;

/// The names and hashes of files that something is made from.
pub fn provenance(inputs: &Inputs) -> Result<Vec<Provenance>, Failure> {
    let of = |(role, path): &(String, PathBuf)| {
        Provenance::of(role, path)
            .map_err(|error| Failure::new(ErrorKind::Io, format!("cannot read `{}`: {error}", path.display())))
    };
    inputs.iter().map(of).collect()
}

/// Where every point of a solid's boundary goes.
#[pyclass(frozen, module = "solidmap._solidmap")]
pub struct Boundary(pub Arc<BoundaryFile>);

impl Boundary {
    pub fn of(boundary: BoundaryMap, inputs: Vec<Provenance>) -> Self {
        let metadata = BoundaryMetadata::new(inputs);
        Self(Arc::new(BoundaryFile { boundary, metadata }))
    }

    pub fn map(&self) -> &BoundaryMap {
        &self.0.boundary
    }
}

#[pymethods]
impl Boundary {
    /// The map that takes each vertex to its image, linear over triangles.
    #[new]
    fn new(domain: &Surface, images: PyReadonlyArray2<f64>) -> PyResult<Self> {
        let images = Points::of("images", &images)?.to_vec();
        let map = BoundaryMap::new(Arc::clone(&domain.0), images).map_err(Failure::from)?;
        Ok(Self::of(map, vec![]))
    }

    /// The map between two surfaces with the same triangles.
    #[staticmethod]
    fn between(domain: &Surface, image: &Surface) -> PyResult<Self> {
        let map = BoundaryMap::between(Arc::clone(&domain.0), &image.0).map_err(Failure::from)?;
        Ok(Self::of(map, vec![]))
    }

    /// The map from one file to another: meshes with the same elements, or a domain and a text of node images.
    #[staticmethod]
    fn read_between(py: Python, domain: PathBuf, image: PathBuf) -> PyResult<Self> {
        run(py, None, None, move |_| {
            Ok(Self::of(between_files(&domain, &image)?, vec![]))
        })
    }

    /// A boundary file.
    #[staticmethod]
    fn read(py: Python, path: PathBuf) -> PyResult<Self> {
        run(py, None, None, move |_| {
            Ok(Self(Arc::new(files::read_boundary(&path)?)))
        })
    }

    fn write(&self, py: Python, path: PathBuf) -> PyResult<()> {
        let file = Arc::clone(&self.0);
        run(py, None, None, move |_| Ok(files::write_boundary(&path, &file)?))
    }

    /// Writes the domain with the image of each vertex and the distortion of each triangle.
    fn write_fields(&self, py: Python, path: PathBuf) -> PyResult<()> {
        let file = Arc::clone(&self.0);
        run(py, None, None, move |_| {
            Ok(files::write_boundary_fields(&path, &file.boundary)?)
        })
    }

    /// The same map of a domain whose triangles face otherwise.
    fn over(&self, py: Python, domain: &Surface) -> PyResult<Self> {
        let (file, domain) = (Arc::clone(&self.0), Arc::clone(&domain.0));
        run(py, None, None, move |_| {
            let (repaired, _) = solidmap::check::repair(&domain);
            Ok(Self::of(file.boundary.over(repaired)?, file.metadata.inputs.clone()))
        })
    }

    #[getter]
    fn domain(&self) -> Surface {
        Surface::of(self.map().domain().clone())
    }

    #[getter]
    fn target(&self, py: Python) -> PyResult<Surface> {
        run_briefly(py, || Surface::of(self.map().outward_target()))
    }

    /// The surface that was mapped to, where the map is composed of two spherical embeddings.
    #[getter]
    fn target_surface(&self) -> Option<Surface> {
        self.map().target_surface().cloned().map(Surface::of)
    }

    #[getter]
    fn images<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        copy_of_points(py, self.map().image())
    }

    #[getter]
    fn target_volume(&self, py: Python) -> PyResult<f64> {
        run_briefly(py, || self.map().target_volume())
    }

    #[getter]
    fn target_diagonal(&self) -> f64 {
        self.map().target_diagonal()
    }

    #[getter]
    fn is_linear(&self) -> bool {
        self.map().is_linear()
    }

    /// Images of points of triangles, given by barycentric coordinates.
    fn evaluate<'py>(
        &self,
        py: Python<'py>,
        triangles: PyReadonlyArray1<'py, u32>,
        barycentric: PyReadonlyArray2<'py, f64>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let triangles = entries("triangles", &triangles)?;
        let barycentric = rows::<f64, 3>("barycentric", &barycentric)?;
        let faces = self.map().domain().triangles().len();
        if let Some(far) = triangles.iter().find(|t| **t as usize >= faces) {
            return Err(Failure::invalid(format!(
                "triangles names triangle {far}, and the domain has {faces}, counted from 0"
            ))
            .into());
        }
        if triangles.len() != barycentric.len() {
            let [a, b] = [triangles.len(), barycentric.len()];
            return Err(Failure::invalid(format!("triangles has {a} entries, and barycentric {b} rows")).into());
        }
        let points: Vec<SurfacePoint> = triangles
            .iter()
            .zip(barycentric)
            .map(|(&triangle, &barycentric)| SurfacePoint { triangle, barycentric })
            .collect();
        let file = Arc::clone(&self.0);
        let found = run(py, None, None, move |_| Ok(file.boundary.evaluate(&points)))?;
        from_points(py, found)
    }

    /// The inverse of a map between two solids.
    fn inverse(&self, py: Python) -> PyResult<Self> {
        let file = Arc::clone(&self.0);
        run(py, None, None, move |_| match file.boundary.inverse() {
            Some(inverse) => Ok(Self::of(inverse, vec![])),
            None => Err(Failure::new(
                ErrorKind::Unsupported,
                "only a boundary map between two solids, made by boundary.pair, has an inverse",
            )),
        })
    }

    /// The report, and its text.
    fn check(
        &self,
        py: Python,
        target: Option<&Surface>,
        tolerance: f64,
        seed: u64,
        worst: usize,
    ) -> PyResult<(String, String)> {
        let (file, target) = (Arc::clone(&self.0), target.map(|target| Arc::clone(&target.0)));
        run(py, None, None, move |_| {
            let options = BoundaryCheckOptions {
                tolerance,
                seed,
                worst_places: worst,
                ..BoundaryCheckOptions::default()
            };
            let report = check(&file.boundary, target.as_deref(), &options, self_intersection_finder())?;
            Ok((to_json(&report)?, report.to_string()))
        })
    }
}

fn between_files(domain: &Path, image: &Path) -> Result<BoundaryMap, Failure> {
    let is_text = image.extension().is_some_and(|e| e.eq_ignore_ascii_case("txt"));
    let solid = io::read_solid(domain)?;
    if is_text {
        let images: Vec<(u32, Point)> = io::read_node_images(image)?;
        return Ok(match solid {
            SolidMesh::Cells(mesh) => BoundaryMap::of_nodes(&mesh, &images)?,
            SolidMesh::Surface(surface) => BoundaryMap::of_vertices(surface, &images)?,
        });
    }
    Ok(match (solid, io::read_solid(image)?) {
        (SolidMesh::Cells(domain), SolidMesh::Cells(image)) => BoundaryMap::between_cells(&domain, &image)?,
        (SolidMesh::Surface(domain), SolidMesh::Surface(surface)) => {
            let is_cut_otherwise =
                surface.triangles().len() == domain.triangles().len() && surface.triangles() != domain.triangles();
            let surface = match is_cut_otherwise {
                true => io::read_surface_as(image, &domain)?,
                false => surface,
            };
            BoundaryMap::between(domain, &surface)?
        }
        (domain, image) => BoundaryMap::between(domain.into_surface(), &image.into_surface())?,
    })
}

fn sphere_step(phase: SpherePhase, before: &str) -> Step {
    match phase {
        SpherePhase::Coarsening => step(&format!("{before}coarsening")),
        SpherePhase::Embedding { vertices, total } => {
            part(&format!("{before}embedding in the sphere"), vertices, total)
        }
        SpherePhase::Flowing => step(&format!("{before}flowing to the sphere")),
        SpherePhase::Optimising {
            iterations,
            most_iterations,
        } => part(&format!("{before}optimising"), iterations, most_iterations),
    }
}

pub fn pair_step(phase: PairPhase) -> Step {
    match phase {
        PairPhase::Sphere(side, phase) => sphere_step(phase, &format!("mapping the {side} to the sphere: ")),
        PairPhase::Tori => step("laying both solids out on tori"),
        PairPhase::HyperbolicSurface => step("laying out on a hyperbolic surface"),
        PairPhase::Reversed => step("seeking a map from the target to the domain"),
        PairPhase::Shell { shell, of } => part("mapping the shells", shell - 1, of),
        PairPhase::Aligning { done, of } => part("aligning", done, of),
        PairPhase::Intrinsic { done, of } => part("intrinsic shapes", done, of),
        PairPhase::CoarseEmbeddings { vertices, done, of } => {
            part(&format!("trying coarse embeddings of {vertices} vertices"), done, of)
        }
        PairPhase::Refining { vertices, total, .. } => part("refining the embedding", vertices, total),
        PairPhase::Improving { rounds, most_rounds } => part("lowering the distortion", rounds, most_rounds),
        PairPhase::Measuring { done, of } => part("measuring", done, of),
    }
}

/// The map of a surface of genus 0 to the unit sphere, with its report.
#[pyfunction]
#[pyo3(signature = (surface, energy, start, inputs, progress=None, time_limit=None))]
pub fn boundary_sphere(
    py: Python,
    surface: &Surface,
    energy: &str,
    start: &str,
    inputs: Inputs,
    progress: Option<&Bound<'_, PyAny>>,
    time_limit: Option<f64>,
) -> PyResult<(Boundary, String)> {
    let surface = Arc::clone(&surface.0);
    let options = SphereOptions {
        energy: match energy {
            "conformal" => SphereEnergy::Conformal,
            _ => SphereEnergy::Balanced,
        },
        start: match start {
            "flow" => SphereStart::Flow,
            _ => SphereStart::Progressive,
        },
        ..SphereOptions::default()
    };
    run(py, progress, time_limit, move |watch| {
        let progress = |phase| watch.tell_until_deadline(|| sphere_step(phase, ""));
        let (embedding, report) = map_to_sphere(&surface, &options, &progress)?;
        let certificate = check_embedding(embedding.surface().triangles(), embedding.directions());
        let boundary = BoundaryMap::onto_sphere(embedding)?;
        let mut report = value_of(&report)?;
        report["vertices"] = json!(boundary.domain().vertices().len());
        report["faces"] = json!(boundary.domain().triangles().len());
        report["certificate"] = value_of(&certificate)?;
        report["distortion"] = value_of(&SurfaceDistortion::of(boundary.domain(), boundary.image()))?;
        Ok((Boundary::of(boundary, provenance(&inputs)?), report.to_string()))
    })
}

/// The map of a surface of genus 1 to the torus of revolution that fits it best, its report, and whether it looks wrong.
#[pyfunction]
#[pyo3(signature = (surface, inputs, progress=None, time_limit=None))]
pub fn boundary_torus(
    py: Python,
    surface: &Surface,
    inputs: Inputs,
    progress: Option<&Bound<'_, PyAny>>,
    time_limit: Option<f64>,
) -> PyResult<(Boundary, String, bool)> {
    let surface = Arc::clone(&surface.0);
    run(py, progress, time_limit, move |watch| {
        // A cancellation takes effect in the search.
        let _ = watch.tell(|| step("laying out on a flat torus"));
        let torus = fitting_torus(&surface).map_err(|error| PairError::Torus { side: "domain", error })?;
        let progress = |phase| watch.tell_until_deadline(|| pair_step(phase));
        let (map, report) = map_pair(&surface, &torus.surface, &PairOptions::default(), &progress)?;
        let looks_wrong = report.looks_wrong();
        let mut report = value_of(&report)?;
        report["fitting_torus"] = json!({"major": torus.major, "minor": torus.minor, "modulus": torus.modulus});
        Ok((Boundary::of(map, provenance(&inputs)?), report.to_string(), looks_wrong))
    })
}

/// The layout of a surface with handles in the plane: its handles, triangles, their corners, and the sides of the polygon.
#[pyfunction]
#[allow(clippy::type_complexity, reason = "Python takes it apart at once")]
pub fn boundary_unfold<'py>(
    py: Python<'py>,
    surface: &Surface,
) -> PyResult<(
    u64,
    Bound<'py, PyArray2<u32>>,
    Bound<'py, PyArray3<f64>>,
    Vec<Bound<'py, PyArray2<f64>>>,
)> {
    let surface = Arc::clone(&surface.0);
    let found = run(py, None, None, move |_| Ok(fundamental_domain(&surface)?))?;
    Ok((
        found.genus,
        copy_of_rows(py, found.surface.triangles()),
        copy_of_corners(py, &found.triangles),
        found.sides.iter().map(|side| copy_of_rows(py, side)).collect(),
    ))
}

/// The map with its images moved such that the harmonic energy of the inside falls, and its report.
#[pyfunction]
#[pyo3(signature = (boundary, max_distortion, rounds, tolerance, progress=None, time_limit=None))]
pub fn boundary_improve(
    py: Python,
    boundary: &Boundary,
    max_distortion: f64,
    rounds: usize,
    tolerance: f64,
    progress: Option<&Bound<'_, PyAny>>,
    time_limit: Option<f64>,
) -> PyResult<(Boundary, String)> {
    let file = Arc::clone(&boundary.0);
    let mut options = ImproveOptions {
        most_distortion: max_distortion,
        most_rounds: rounds,
        ..ImproveOptions::default()
    };
    options.fit.tolerance = tolerance;
    run(py, progress, time_limit, move |watch| {
        let progress = |phase| {
            watch.tell_until_deadline(|| match phase {
                ImprovePhase::Fitting(phase) => fit_step(phase),
                ImprovePhase::Moving {
                    rounds, most_rounds, ..
                } => part("lowering the energy", rounds, most_rounds),
            })
        };
        let (map, report) = improve_boundary(&file.boundary, &options, &progress)?;
        Ok((Boundary::of(map, file.metadata.inputs.clone()), to_json(&report)?))
    })
}

pub fn value_of(report: &impl serde::Serialize) -> Result<Value, Failure> {
    serde_json::to_value(report).map_err(|error| Failure::new(ErrorKind::Internal, error.to_string()))
}

/// How the boundary map of a pair is made, as the program's options.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct PairArguments {
    landmarks: Vec<[u32; 2]>,
    /// Instead of the pairs themselves.
    landmarks_file: Option<PathBuf>,
    landmarks_weight: Option<f64>,
    landmark_curves: Vec<(Vec<u32>, Vec<u32>)>,
    landmark_curves_file: Option<PathBuf>,
    loops: Vec<(Vec<u32>, Vec<u32>)>,
    loops_file: Option<PathBuf>,
    components: Vec<[usize; 2]>,
    components_file: Option<PathBuf>,
    up: Option<[[f64; 3]; 2]>,
    max_stretched: f64,
    via: String,
    aligned: bool,
    no_improve: bool,
    alternatives: usize,
}

/// Those of a file, where one is named, or else these.
fn curves(given: Vec<(Vec<u32>, Vec<u32>)>, file: Option<PathBuf>) -> Result<Vec<LandmarkCurve>, Failure> {
    let curve = |(domain, target)| LandmarkCurve { domain, target };
    match file {
        Some(file) => Ok(files::read_landmark_curves(file)?),
        None => Ok(given.into_iter().map(curve).collect()),
    }
}

/// The map of a surface to another, its report, and whether it looks wrong; and other maps.
#[pyfunction]
#[pyo3(signature = (domain, target, arguments, start, inputs, progress=None, time_limit=None))]
#[allow(clippy::too_many_arguments, reason = "it is called from Python, by keywords")]
pub fn boundary_pair(
    py: Python,
    domain: &Surface,
    target: &Surface,
    arguments: PairArguments,
    start: Option<&Boundary>,
    inputs: Inputs,
    progress: Option<&Bound<'_, PyAny>>,
    time_limit: Option<f64>,
) -> PyResult<(Boundary, String, bool, Vec<Boundary>)> {
    let (domain, target) = (Arc::clone(&domain.0), Arc::clone(&target.0));
    let start = start.map(|start| start.map().clone());
    run(py, progress, time_limit, move |watch| {
        let vertices = [&domain, &target].map(|surface| surface.vertices().len());
        let landmarks = match &arguments.landmarks_file {
            Some(file) => files::read_landmarks(file, vertices[0], vertices[1])?,
            None => Landmarks::new(arguments.landmarks, vertices[0], vertices[1])
                .map_err(|error| Failure::invalid(format!("landmarks: {error}")))?,
        };
        let landmark_curves = curves(arguments.landmark_curves, arguments.landmark_curves_file)?;
        let loops = curves(arguments.loops, arguments.loops_file)?;
        let components = match &arguments.components_file {
            Some(file) => files::read_components(file)?,
            None => arguments.components,
        };
        let options = PairOptions {
            method: match arguments.via.as_str() {
                "conformal" => PairMethod::Conformal,
                _ => PairMethod::SoftTargets,
            },
            landmarks,
            landmarks_weight: arguments.landmarks_weight,
            curves: landmark_curves,
            loops,
            components,
            up: arguments.up.map(|up| up.map(Vector::from)),
            start,
            alternatives: arguments.alternatives,
            most_stretched: arguments.max_stretched,
            aligned: arguments.aligned,
            improve: !arguments.no_improve,
            ..PairOptions::default()
        };
        let progress = |phase| watch.tell_until_deadline(|| pair_step(phase));
        let made = map_pair_with_alternatives(&domain, &target, &options, &progress)?;
        let inputs = provenance(&inputs)?;
        let others = made.alternatives.into_iter();
        Ok((
            Boundary::of(made.map, inputs.clone()),
            to_json(&made.report)?,
            made.report.looks_wrong(),
            others.map(|map| Boundary::of(map, inputs.clone())).collect(),
        ))
    })
}

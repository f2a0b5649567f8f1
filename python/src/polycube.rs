//! Polycubes, and meshes of models made by them.

use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};

use numpy::{PyArray1, PyArray2, PyReadonlyArray1, PyReadonlyArray2, ToPyArray};
use pyo3::prelude::*;
use serde_json::json;
use solidmap::files;
use solidmap::fit::FitOptions;
use solidmap::hexmesh::{HexmeshOptions, HexmeshPhase, make_hexmesh};
use solidmap::io;
use solidmap::mesh::{CellMesh, SurfaceMesh, TetMesh};
use solidmap::model_polycube::{
    self, ModelPolycube, ModelPolycubeError, ModelPolycubeOptions, ModelPolycubePhase, PolycubeKind,
    make_model_polycube,
};
use solidmap::polycube::{
    BestAttempt, MakePolycubeError, Orientation, PolycubeOptions, PolycubePhase, make_polycube_with_labels,
};
use solidmap::remesh::{CellSize, RemeshOptions};

use crate::arrays::{copy_of_rows, entries, rows};
use crate::boundary::{Boundary, Inputs, pair_step, provenance, value_of};
use crate::error::{ErrorKind, Failure};
use crate::fit::fit_step;
use crate::map::Map;
use crate::measures::arrays_of;
use crate::meshes::{Cells, Surface, json as to_json};
use crate::native::filled;
use crate::remesh::{CarriedMesh, RemeshArguments, remesh_step};
use crate::run::{Step, Watch, of, run, step};

/// A model, as tetrahedra or as a surface that is filled.
enum Model {
    Tets(TetMesh),
    Surface(Arc<SurfaceMesh>),
}

impl Model {
    fn of(surface: Option<&Surface>, mesh: Option<&Cells>) -> Result<Self, Failure> {
        match (surface, mesh) {
            (_, Some(mesh)) => Ok(Self::Tets(mesh.tets("model")?)),
            (Some(surface), None) => Ok(Self::Surface(Arc::clone(&surface.0))),
            (None, None) => Err(Failure::invalid("model is missing")),
        }
    }

    fn tets(self, watch: &Watch) -> Result<TetMesh, Failure> {
        match self {
            Self::Tets(mesh) => Ok(mesh),
            Self::Surface(surface) => filled(&surface, None, watch),
        }
    }
}

fn polycube_step(phase: ModelPolycubePhase) -> Step {
    match phase {
        ModelPolycubePhase::Simplifying => step("simplifying"),
        ModelPolycubePhase::Deforming(phase) => deformation_step(phase),
        ModelPolycubePhase::Pairing(phase) => pair_step(phase),
    }
}

fn deformation_step(phase: PolycubePhase) -> Step {
    match phase {
        PolycubePhase::Attempting { attempt } => step(&format!("attempt {attempt}")),
        PolycubePhase::Labelling { round } => of("directions", None, format!("round {round}")),
        PolycubePhase::Deforming { inverted } => of("deforming", None, format!("{inverted} inverted")),
        PolycubePhase::Snapping => step("snapping"),
    }
}

fn orientation(name: &str) -> Orientation {
    match name {
        "principal" => Orientation::Principal,
        "best" => Orientation::Best,
        _ => Orientation::Given,
    }
}

fn kind_of(name: &str) -> PolycubeKind {
    match name {
        "deformed" => PolycubeKind::Deformed,
        "voxels" => PolycubeKind::Voxels,
        _ => PolycubeKind::Auto,
    }
}

/// The program's options of polycubes.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct PolycubeArguments {
    polycube: String,
    max_vertices: usize,
    smoothness: f64,
    features: Option<f64>,
    orient: String,
    lattice: Option<f64>,
}

/// A polycube and its model.
#[pyclass(frozen, module = "solidmap._solidmap")]
pub struct Polycube {
    made: ModelPolycube,
    /// The boundary triangles of the mesh that was given, and the label of each.
    given: (Vec<[u32; 3]>, Vec<u8>),
    inputs: Inputs,
}

impl Polycube {
    fn of(made: ModelPolycube, model: &TetMesh, inputs: Inputs) -> Self {
        let boundary = model.boundary();
        let node = |v: u32| boundary.vertex_ids[v as usize];
        let triangles: Vec<[u32; 3]> = boundary.surface.triangles().iter().map(|t| t.map(node)).collect();
        let labels = made.labels_of(model, &triangles).unwrap_or_default();
        Self {
            made,
            given: (triangles, labels),
            inputs,
        }
    }
}

#[pymethods]
impl Polycube {
    /// Surfaces of the polycube and of the model, with the same triangles.
    fn surfaces(&self) -> (Surface, Surface) {
        let boundary = &self.made.boundary;
        (Surface::of(boundary.domain().clone()), Surface::of(boundary.target()))
    }

    /// The map from one to the other.
    fn boundary(&self) -> PyResult<Boundary> {
        Ok(Boundary::of(self.made.boundary.clone(), provenance(&self.inputs)?))
    }

    /// Tetrahedra of the polycube and of the model that was deformed; none of voxels.
    fn tets(&self) -> Option<(Cells, Cells)> {
        let model_polycube::Polycube::Deformed(made, _) = &self.made.polycube else {
            return None;
        };
        let [polycube, model] = [&made.polycube, &made.model].map(|mesh| Cells::of(CellMesh::from(mesh.clone())));
        Some((polycube, model))
    }

    /// For each triangle of the surfaces the direction that it faces along: 0 to 5 for -x, +x, -y, +y, -z, +z.
    #[getter]
    fn labels<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<u8>> {
        PyArray1::from_vec(py, self.made.labels())
    }

    /// The boundary triangles of the mesh that was given, and the direction of each.
    #[getter]
    fn given_labels<'py>(&self, py: Python<'py>) -> (Bound<'py, PyArray2<u32>>, Bound<'py, PyArray1<u8>>) {
        let (triangles, labels) = &self.given;
        (copy_of_rows(py, triangles), labels.to_pyarray(py))
    }

    /// Of a deformation.
    #[getter]
    fn report_json(&self) -> PyResult<Option<String>> {
        Ok(match &self.made.polycube {
            model_polycube::Polycube::Deformed(made, _) => Some(to_json(&made.report)?),
            model_polycube::Polycube::Voxels(..) => None,
        })
    }

    /// Of the simplified model that was deformed.
    #[getter]
    fn simplified_json(&self) -> PyResult<Option<String>> {
        Ok(match &self.made.polycube {
            model_polycube::Polycube::Deformed(_, Some(report)) => Some(to_json(report)?),
            _ => None,
        })
    }

    /// Of voxels.
    #[getter]
    fn voxels_json(&self) -> PyResult<Option<String>> {
        Ok(match &self.made.polycube {
            model_polycube::Polycube::Voxels(_, report) => Some(to_json(report)?),
            model_polycube::Polycube::Deformed(..) => None,
        })
    }
}

/// Labels of triangles, one a line.
#[pyfunction]
pub fn read_labels(py: Python<'_>, path: PathBuf, triangles: usize) -> PyResult<Bound<'_, PyArray1<u8>>> {
    let labels = run(py, None, None, move |_| Ok(io::read_triangle_labels(&path, triangles)?))?;
    Ok(PyArray1::from_vec(py, labels))
}

/// Writes labels of triangles, one a line.
#[pyfunction]
pub fn write_labels(py: Python, path: PathBuf, labels: PyReadonlyArray1<u8>) -> PyResult<()> {
    let labels = entries("labels", &labels)?;
    run(py, None, None, move |_| Ok(io::write_triangle_labels(&path, &labels)?))
}

/// Why no polycube was found; the polycube's tetrahedra and the model's in the best attempt; what is known of each; a report,
/// and the places that are bad.
type NotFound<'py> = (String, Cells, Cells, Vec<(String, Bound<'py, PyArray1<f64>>)>, String);

/// A polycube of a model; with labels of the triangles of its boundary, the one that they describe. Where none is found,
/// the best attempt.
#[pyfunction]
#[pyo3(signature = (surface, mesh, arguments, inputs, labels=None, progress=None))]
#[allow(clippy::type_complexity, reason = "one of two results")]
pub fn polycube_of<'py>(
    py: Python<'py>,
    surface: Option<&Surface>,
    mesh: Option<&Cells>,
    arguments: PolycubeArguments,
    inputs: Inputs,
    labels: Option<(PyReadonlyArray2<u32>, PyReadonlyArray1<u8>)>,
    progress: Option<&Bound<'py, PyAny>>,
) -> PyResult<(Option<Polycube>, Option<NotFound<'py>>)> {
    let model = Model::of(surface, mesh)?;
    let options = ModelPolycubeOptions {
        kind: kind_of(&arguments.polycube),
        most_vertices: arguments.max_vertices,
        deformation: PolycubeOptions {
            smoothness: arguments.smoothness,
            feature_angle: arguments.features,
            lattice: arguments.lattice.map(CellSize::Length),
            orientation: orientation(&arguments.orient),
            ..PolycubeOptions::default()
        },
    };
    let labels = match labels {
        None => None,
        Some((triangles, labels)) => {
            let triangles = rows::<u32, 3>("labels", &triangles)?;
            let labels = entries("labels", &labels)?;
            Some(triangles.iter().copied().zip(labels).collect::<Vec<_>>())
        }
    };
    let (made, best) = run(py, progress, None, move |watch| {
        let tets = model.tets(watch)?;
        let made = match labels {
            Some(labels) => {
                let report = |phase| watch.tell(|| deformation_step(phase));
                let made = make_polycube_with_labels(&tets, &labels, &options.deformation, &report);
                made.map_err(ModelPolycubeError::from)
                    .and_then(|made| Ok(ModelPolycube::of_deformed(made)?))
            }
            None => make_model_polycube(&tets, &options, &|phase| watch.tell(|| polycube_step(phase))),
        };
        match made {
            Ok(made) => Ok((Some(Polycube::of(made, &tets, inputs)), None)),
            Err(error) => match best_attempt(&error) {
                Some(best) => Ok((None, Some((error.to_string(), best.clone())))),
                None => Err(error.into()),
            },
        }
    })?;
    let not_found = best.map(|(message, best)| {
        let [polycube, model] = [&best.polycube, &best.model].map(|mesh| Cells::of(CellMesh::from(mesh.clone())));
        let report = json!({ "report": value_of(&best.report)?, "places": value_of(&best.places)? });
        let fields = arrays_of(py, files::attempt_fields(&best));
        Ok::<_, Failure>((message, polycube, model, fields, report.to_string()))
    });
    Ok((made, not_found.transpose()?))
}

/// What the deformation ended with.
fn best_attempt(error: &ModelPolycubeError) -> Option<&BestAttempt> {
    match error {
        ModelPolycubeError::Deformation(MakePolycubeError::NotFound { best, .. }) => Some(best),
        ModelPolycubeError::Neither { deformed, .. } => best_attempt(deformed),
        _ => None,
    }
}

/// The program's options of `hexmesh`, beside those of the mesh.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct HexmeshArguments {
    polycube: String,
    smoothness: f64,
    features: Option<f64>,
    orient: String,
    tolerance: f64,
    polish: usize,
    max_distance: f64,
    max_vertices: usize,
}

/// A mesh of a model, the map that carried it, and the polycube.
#[pyclass(frozen, module = "solidmap._solidmap")]
pub struct Hexmesh {
    parts: Mutex<Option<(Map, CarriedMesh, Polycube)>>,
    tolerance_met: bool,
}

#[pymethods]
impl Hexmesh {
    /// The map, the mesh and the polycube; once.
    fn take(&self) -> PyResult<(Map, CarriedMesh, Polycube)> {
        let parts = self.parts.lock().unwrap_or_else(PoisonError::into_inner).take();
        Ok(parts.ok_or_else(|| Failure::new(ErrorKind::Internal, "the parts of a mesh were taken twice"))?)
    }

    #[getter]
    fn tolerance_met(&self) -> bool {
        self.tolerance_met
    }
}

/// A mesh of a model by its polycube.
#[pyfunction]
#[pyo3(signature = (surface, mesh, arguments, carried, inputs, progress=None))]
pub fn hexmesh(
    py: Python,
    surface: Option<&Surface>,
    mesh: Option<&Cells>,
    arguments: HexmeshArguments,
    carried: RemeshArguments,
    inputs: Inputs,
    progress: Option<&Bound<'_, PyAny>>,
) -> PyResult<Hexmesh> {
    let model = Model::of(surface, mesh)?;
    let options = HexmeshOptions {
        kind: carried.kind(),
        size: carried.size()?,
        most_cells: carried.max_cells,
        max_distance: arguments.max_distance,
        most_vertices: arguments.max_vertices,
        polycube_kind: kind_of(&arguments.polycube),
        polycube: PolycubeOptions {
            smoothness: arguments.smoothness,
            feature_angle: arguments.features,
            orientation: orientation(&arguments.orient),
            ..PolycubeOptions::default()
        },
        fit: FitOptions {
            tolerance: arguments.tolerance,
            memory: carried.memory,
            ..FitOptions::adaptive()
        },
        remesh: RemeshOptions {
            polish: arguments.polish,
            polish_valid: arguments.polish > 0,
            ..carried.options()
        },
    };
    run(py, progress, None, move |watch| {
        let tets = model.tets(watch)?;
        let report = |phase| {
            watch.tell(|| match phase {
                HexmeshPhase::Polycube(phase) => polycube_step(phase),
                HexmeshPhase::Fitting(phase) => fit_step(phase),
                HexmeshPhase::Remeshing(phase) => remesh_step(phase),
            })
        };
        let made = make_hexmesh(&tets, &options, &report)?;
        let tolerance_met = options.fit.is_met_by(&made.fit.report);
        let polycube = ModelPolycube {
            polycube: made.polycube,
            boundary: made.fit.boundary.clone(),
        };
        let map = Map::of(made.fit, provenance(&inputs)?);
        let polycube = Polycube::of(polycube, &tets, inputs);
        Ok(Hexmesh {
            parts: Mutex::new(Some((map, CarriedMesh::of(made.remeshed, carried.worst), polycube))),
            tolerance_met,
        })
    })
}

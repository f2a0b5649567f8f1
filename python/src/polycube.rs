//! Polycubes, and meshes of models made by them.

use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};

use numpy::{PyArray1, PyArray2, PyReadonlyArray1, PyReadonlyArray2, ToPyArray};
use pyo3::prelude::*;
use serde_json::json;
use solidmap::files;
use solidmap::fit::FitOptions;
use solidmap::hexmesh::{HexmeshOptions, HexmeshPhase, HexmeshPolycube, PolycubeKind, make_hexmesh};
use solidmap::io;
use solidmap::mesh::{CellMesh, SurfaceMesh, TetMesh};
use solidmap::polycube::{
    self, MakePolycubeError, Orientation, PolycubeOptions, PolycubePhase, make_polycube, make_polycube_with_labels,
};
use solidmap::remesh::{CellSize, RemeshOptions};

use crate::arrays::{copy_of_rows, entries, rows};
use crate::boundary::{Inputs, pair_step, provenance, value_of};
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

fn polycube_step(phase: PolycubePhase) -> Step {
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

/// The program's options of polycubes.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct PolycubeArguments {
    smoothness: f64,
    orient: String,
    lattice: Option<f64>,
}

/// A polycube and its model.
#[pyclass(frozen, module = "solidmap._solidmap")]
pub struct Polycube(Arc<polycube::PolycubeMap>);

#[pymethods]
impl Polycube {
    /// Surfaces of the polycube and of the model, with the same triangles.
    fn surfaces(&self, py: Python) -> PyResult<(Surface, Surface)> {
        let made = Arc::clone(&self.0);
        run(py, None, None, move |_| {
            let [polycube, model] = made.surfaces().map(Surface::of);
            Ok((polycube, model))
        })
    }

    /// Tetrahedra of the polycube and of the model.
    fn tets(&self) -> (Cells, Cells) {
        let [polycube, model] = [&self.0.polycube, &self.0.model].map(|mesh| Cells::of(CellMesh::from(mesh.clone())));
        (polycube, model)
    }

    /// For each triangle of the surfaces the direction that it faces along: 0 to 5 for -x, +x, -y, +y, -z, +z.
    #[getter]
    fn labels<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<u8>> {
        self.0.labels.to_pyarray(py)
    }

    /// The boundary triangles of the mesh that was given, and the direction of all parts of each.
    #[getter]
    fn given_labels<'py>(&self, py: Python<'py>) -> (Bound<'py, PyArray2<u32>>, Bound<'py, PyArray1<u8>>) {
        let (triangles, labels): (Vec<_>, Vec<_>) = self.0.given_labels.iter().copied().unzip();
        (copy_of_rows(py, &triangles), PyArray1::from_vec(py, labels))
    }

    #[getter]
    fn report_json(&self) -> PyResult<String> {
        Ok(to_json(&self.0.report)?)
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
#[pyo3(signature = (surface, mesh, arguments, labels=None, progress=None))]
#[allow(clippy::type_complexity, reason = "one of two results")]
pub fn polycube_of<'py>(
    py: Python<'py>,
    surface: Option<&Surface>,
    mesh: Option<&Cells>,
    arguments: PolycubeArguments,
    labels: Option<(PyReadonlyArray2<u32>, PyReadonlyArray1<u8>)>,
    progress: Option<&Bound<'py, PyAny>>,
) -> PyResult<(Option<Polycube>, Option<NotFound<'py>>)> {
    let model = Model::of(surface, mesh)?;
    let options = PolycubeOptions {
        smoothness: arguments.smoothness,
        lattice: arguments.lattice.map(CellSize::Length),
        orientation: orientation(&arguments.orient),
        ..PolycubeOptions::default()
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
        let report = |phase| watch.tell(|| polycube_step(phase));
        let made = match labels {
            Some(labels) => make_polycube_with_labels(&tets, &labels, &options, &report),
            None => make_polycube(&tets, &options, &report),
        };
        match made {
            Ok(made) => Ok((Some(Polycube(Arc::new(made))), None)),
            Err(error) => match &error {
                MakePolycubeError::NotFound { best, .. } => Ok((None, Some((error.to_string(), best.clone())))),
                _ => Err(error.into()),
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

/// The program's options of `hexmesh`, beside those of the mesh.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct HexmeshArguments {
    polycube: String,
    smoothness: f64,
    orient: String,
    tolerance: f64,
    polish: usize,
    max_distance: f64,
    max_vertices: usize,
}

/// A mesh of a model, the map that carried it, the polycube where it is the model deformed, and the report.
#[pyclass(frozen, module = "solidmap._solidmap")]
pub struct Hexmesh {
    parts: Mutex<Option<(Map, CarriedMesh, Option<Polycube>)>>,
    simplified: Option<String>,
    voxels: Option<String>,
    tolerance_met: bool,
}

#[pymethods]
impl Hexmesh {
    /// The map, the mesh and the polycube; once.
    fn take(&self) -> PyResult<(Map, CarriedMesh, Option<Polycube>)> {
        let parts = self.parts.lock().unwrap_or_else(PoisonError::into_inner).take();
        Ok(parts.ok_or_else(|| Failure::new(ErrorKind::Internal, "the parts of a mesh were taken twice"))?)
    }

    #[getter]
    fn simplified_json(&self) -> Option<String> {
        self.simplified.clone()
    }

    #[getter]
    fn voxels_json(&self) -> Option<String> {
        self.voxels.clone()
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
        polycube_kind: match arguments.polycube.as_str() {
            "deformed" => PolycubeKind::Deformed,
            "voxels" => PolycubeKind::Voxels,
            _ => PolycubeKind::Auto,
        },
        polycube: PolycubeOptions {
            smoothness: arguments.smoothness,
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
                HexmeshPhase::Simplifying => step("simplifying"),
                HexmeshPhase::Polycube(phase) => polycube_step(phase),
                HexmeshPhase::Pairing(phase) => pair_step(phase),
                HexmeshPhase::Fitting(phase) => fit_step(phase),
                HexmeshPhase::Remeshing(phase) => remesh_step(phase),
            })
        };
        let made = make_hexmesh(&tets, &options, &report)?;
        let tolerance_met = options.fit.is_met_by(&made.fit.report);
        let (polycube, simplified, voxels) = match made.polycube {
            HexmeshPolycube::Deformed(found, simplified) => {
                (Some(Polycube(Arc::new(*found))), value_of(&simplified)?, json!(null))
            }
            HexmeshPolycube::Voxels(_, report) => (None, json!(null), value_of(&report)?),
        };
        let map = Map::of(made.fit, provenance(&inputs)?);
        Ok(Hexmesh {
            parts: Mutex::new(Some((map, CarriedMesh::of(made.remeshed, carried.worst), polycube))),
            simplified: (!simplified.is_null()).then(|| simplified.to_string()),
            voxels: (!voxels.is_null()).then(|| voxels.to_string()),
            tolerance_met,
        })
    })
}

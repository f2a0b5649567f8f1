//! Frames of deformed solids, measured block by block.

use std::sync::{Arc, Mutex, PoisonError};

use numpy::{PyArray2, PyReadonlyArray2};
use pyo3::prelude::*;
use serde_json::{Value, json};
use solidmap::boundary_map::BoundaryMap;
use solidmap::energy::{AdaptiveOptions, GridResolution};
use solidmap::fit::self_intersection_finder;
use solidmap::mesh::TetMesh;
use solidmap::remesh::RemeshOptions;
use solidmap::sequence::{FilledReference, FrameMeasurement, SequenceError, SequenceOptions, SequencePhase, cycles};
use solidmap::transfer::{FieldMesh, push_forward};

use crate::arrays::{Points, from_points};
use crate::boundary::value_of;
use crate::error::{ErrorKind, Failure};
use crate::fit::{FitArguments, fit_step};
use crate::measures::lame_of;
use crate::meshes::{Cells, Surface, cell_list, json as to_json};
use crate::native::filled;
use crate::remesh::remesh_step;
use crate::run::run;
use crate::transfer::{FoundField, GivenField, found, given};

/// The program's options of sequences, beside those of the method.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct SequenceArguments {
    map: String,
    effort: f64,
    resolution: usize,
    energy_tolerance: f64,
    lame: [f64; 2],
    own_volume: bool,
    close_holes: Option<usize>,
    frames_per_block: Option<usize>,
}

struct Prepared {
    sequence: solidmap::sequence::Sequence,
    /// The reference filled with tetrahedra, and how maps over them are repaired, for one-to-one maps.
    filled: Option<(TetMesh, RemeshOptions)>,
}

impl Prepared {
    fn filled(&self) -> Result<Option<FilledReference<'static>>, SequenceError> {
        let of = |(mesh, options): &(TetMesh, RemeshOptions)| {
            FilledReference::new(&self.sequence, mesh.clone(), *options, self_intersection_finder())
        };
        self.filled.as_ref().map(of).transpose()
    }
}

/// A mesh with fields that each frame carries.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct Material<'py> {
    points: PyReadonlyArray2<'py, f64>,
    cells: Option<PyReadonlyArray2<'py, u32>>,
    point_fields: Vec<GivenField<'py>>,
    cell_fields: Vec<GivenField<'py>>,
}

impl Material<'_> {
    fn read(self) -> PyResult<FieldMesh> {
        let cells = self.cells.as_ref().map(|cells| cell_list("cells", cells)).transpose()?;
        let mesh = FieldMesh {
            points: Points::of("points", &self.points)?.to_vec(),
            cells: cells.unwrap_or_default(),
            point_fields: given(self.point_fields)?,
            cell_fields: given(self.cell_fields)?,
        };
        mesh.check().map_err(Failure::from)?;
        Ok(mesh)
    }
}

/// Its points and its fields in a frame.
type CarriedMaterial<'py> = (Bound<'py, PyArray2<f64>>, Vec<FoundField<'py>>, Vec<FoundField<'py>>);

/// A reference, factored. Lost when work on it is cancelled.
#[pyclass(frozen, module = "solidmap._solidmap")]
pub struct Sequence {
    prepared: Arc<Mutex<Option<Prepared>>>,
    #[pyo3(get)]
    frames_per_block: usize,
    #[pyo3(get)]
    warnings: Vec<String>,
    #[pyo3(get)]
    report_json: String,
    resolution_of_energy: f64,
}

#[pymethods]
impl Sequence {
    #[new]
    #[pyo3(signature = (reference, fit, arguments, tets=None, progress=None))]
    fn new(
        py: Python,
        reference: &Surface,
        fit: FitArguments,
        arguments: SequenceArguments,
        tets: Option<&Cells>,
        progress: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let surface = Arc::clone(&reference.0);
        let own: Option<TetMesh> = tets.map(|tets| tets.tets("reference")).transpose()?;
        let options = SequenceOptions {
            fit: fit.options()?,
            quadrature: AdaptiveOptions {
                resolution: GridResolution::CellsAlongLongestSide(arguments.resolution),
                tolerance: arguments.energy_tolerance,
                max_points: None,
            },
            lame: lame_of(arguments.lame)?,
            own_volume: arguments.own_volume,
            close_holes: arguments.close_holes,
            frames_per_block: arguments.frames_per_block,
        };
        run(py, progress, None, move |watch| {
            let show = |phase| watch.tell_or_unwind(|| fit_step(phase));
            let sequence = solidmap::sequence::Sequence::new(&surface, &options, &show)?;
            let filled = match arguments.map.as_str() {
                "bijective" => {
                    let memory = fit.memory.or_else(solidmap::memory::default_budget);
                    let mesh = match own {
                        Some(mesh) => mesh,
                        None => filled(sequence.domain(), memory, watch)?,
                    };
                    let options = RemeshOptions {
                        effort: arguments.effort,
                        memory,
                        ..RemeshOptions::default()
                    };
                    Some((mesh, options))
                }
                _ => None,
            };
            let prepared = Prepared { sequence, filled };
            let filled = prepared.filled()?;
            let sequence = &prepared.sequence;
            let frames_per_block = match &filled {
                Some(filled) => sequence.frames_per_block_of(filled),
                None => sequence.frames_per_block(),
            };
            let report = json!({
                "map_kind": arguments.map,
                "vertices": surface.vertices().len(),
                "faces": surface.triangles().len(),
                "closed_holes": value_of(&sequence.holes())?,
                "volume": sequence.domain().volume(),
                "points": match &filled { None => json!(sequence.quadrature().points().len()), Some(_) => json!(null) },
                "tets": filled.as_ref().map(|filled| filled.mesh().tets().len()),
                "frames_per_block": frames_per_block,
                "own_volume": options.own_volume,
            });
            Ok(Self {
                frames_per_block,
                warnings: sequence.warnings().to_vec(),
                report_json: report.to_string(),
                resolution_of_energy: sequence.resolution_of_energy(),
                prepared: Arc::new(Mutex::new(Some(prepared))),
            })
        })
    }

    /// Measures frames, all at once: for each what was found, or why it was skipped; and the points and fields of a material
    /// as each frame carries it, none where it was skipped.
    #[pyo3(signature = (frames, material=None, progress=None))]
    #[allow(clippy::type_complexity, reason = "parts of meshes")]
    fn measure<'py>(
        &self,
        py: Python<'py>,
        frames: Vec<PyRef<'_, Surface>>,
        material: Option<Material<'py>>,
        progress: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<(String, Vec<Option<CarriedMaterial<'py>>>)> {
        let frames: Vec<_> = frames.iter().map(|frame| Arc::clone(&frame.0)).collect();
        let material = material.map(Material::read).transpose()?;
        let shared = Arc::clone(&self.prepared);
        let (report, carried) = run(py, progress, None, move |watch| {
            let lost = || {
                Failure::new(
                    ErrorKind::Unsupported,
                    "the sequence was cancelled, or is in use by another thread",
                )
            };
            // Taken out while it changes: work that is unwound loses it.
            let taken = shared.try_lock().ok().and_then(|mut prepared| prepared.take());
            let mut prepared = taken.ok_or_else(lost)?;
            let found = measured(&mut prepared, &frames, watch)?;
            *shared.lock().unwrap_or_else(PoisonError::into_inner) = Some(prepared);
            let (mut rows, mut carried) = (vec![], vec![]);
            for found in found {
                let moved = match (&found, &material) {
                    (Ok(found), Some(material)) => Some(push_forward(&found.map, material)?),
                    _ => None,
                };
                carried.push(moved);
                rows.push(match &found {
                    Ok(found) => row(found)?,
                    Err(error) => json!({ "skipped": error.to_string() }),
                });
            }
            Ok((to_json(&rows)?, carried))
        })?;
        let of = |mesh: FieldMesh| {
            let points = from_points(py, mesh.points)?;
            Ok((points, found(py, mesh.point_fields), found(py, mesh.cell_fields)))
        };
        let carried = carried.into_iter().map(|mesh| mesh.map(of).transpose());
        Ok((report, carried.collect::<PyResult<_>>()?))
    }

    /// The cycles of a curve of energies, or why there are none.
    fn cycles(&self, energies: Vec<f64>) -> PyResult<(Option<String>, Option<String>)> {
        Ok(match cycles(&energies, self.resolution_of_energy) {
            Ok(found) => (Some(to_json(&found)?), None),
            Err(error) => (None, Some(error.to_string())),
        })
    }
}

fn measured(
    prepared: &mut Prepared,
    frames: &[Arc<solidmap::mesh::SurfaceMesh>],
    watch: &crate::run::Watch,
) -> Result<Vec<Result<FrameMeasurement, SequenceError>>, Failure> {
    let filled = prepared.filled()?;
    let sequence = &mut prepared.sequence;
    let maps: Vec<Result<BoundaryMap, SequenceError>> = frames.iter().map(|surface| sequence.frame(surface)).collect();
    let usable: Vec<BoundaryMap> = maps.iter().filter_map(|map| map.as_ref().ok().cloned()).collect();
    let found = match &filled {
        None => sequence.measure(&usable, &|phase| watch.tell_or_unwind(|| fit_step(phase))),
        Some(filled) => sequence.measure_bijective(filled, &usable, &|phase| {
            watch.tell_or_unwind(|| match phase {
                SequencePhase::Fit(phase) => fit_step(phase),
                SequencePhase::Repair { phase, .. } => remesh_step(phase),
            });
        }),
    };
    let mut found = found.into_iter();
    let each = maps.into_iter();
    let each = each.map(|map| map.and_then(|_| found.next().expect("one result for each usable frame")));
    Ok(each.collect())
}

fn row(measured: &FrameMeasurement) -> Result<Value, Failure> {
    Ok(json!({
        "deformation_energy": measured.deformation,
        "harmonic_energy": measured.harmonic,
        "errors": value_of(&measured.errors)?,
        "deformation_density": value_of(&measured.deformation_density)?,
        "boundary_error": value_of(&measured.boundary_error)?,
        "folded_fraction": measured.folded_fraction,
        "inverted_as_mapped": measured.map.bijective().map(|made| made.report.inverted_as_mapped),
        "volume": measured.volume,
        "skipped": null,
    }))
}

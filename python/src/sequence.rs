//! Frames of deformed solids, measured block by block.

use std::sync::{Arc, Mutex, PoisonError};

use pyo3::prelude::*;
use serde_json::{Value, json};
use solidmap::boundary_map::BoundaryMap;
use solidmap::energy::{AdaptiveOptions, GridResolution};
use solidmap::fit::self_intersection_finder;
use solidmap::mesh::TetMesh;
use solidmap::remesh::RemeshOptions;
use solidmap::sequence::{FilledReference, FrameMeasurement, SequenceError, SequenceOptions, SequencePhase, cycles};

use crate::boundary::value_of;
use crate::error::{ErrorKind, Failure};
use crate::fit::{FitArguments, fit_step};
use crate::measures::lame_of;
use crate::meshes::{Cells, Surface, json as to_json};
use crate::native::filled;
use crate::remesh::remesh_step;
use crate::run::run;

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

    /// Measures frames, all at once: for each what was found, or why it was skipped.
    #[pyo3(signature = (frames, progress=None))]
    fn measure(
        &self,
        py: Python,
        frames: Vec<PyRef<'_, Surface>>,
        progress: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<String> {
        let frames: Vec<_> = frames.iter().map(|frame| Arc::clone(&frame.0)).collect();
        let shared = Arc::clone(&self.prepared);
        run(py, progress, None, move |watch| {
            let lost = || {
                Failure::new(
                    ErrorKind::Unsupported,
                    "the sequence was cancelled, or is in use by another thread",
                )
            };
            // Taken out while it changes: work that is unwound loses it.
            let taken = shared.try_lock().ok().and_then(|mut prepared| prepared.take());
            let mut prepared = taken.ok_or_else(lost)?;
            let rows = measured(&mut prepared, &frames, watch)?;
            *shared.lock().unwrap_or_else(PoisonError::into_inner) = Some(prepared);
            to_json(&rows)
        })
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
) -> Result<Vec<Value>, Failure> {
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
    let rows = maps.into_iter().map(|map| {
        let measured = map.and_then(|_| found.next().expect("one result for each usable frame"));
        match measured {
            Ok(measured) => row(&measured),
            Err(error) => Ok(json!({ "skipped": error.to_string() })),
        }
    });
    rows.collect()
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

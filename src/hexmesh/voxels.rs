//! Hexahedra by a polycube of voxels.

use super::{Hexmesh, HexmeshError, HexmeshOptions, HexmeshPhase, boxes_per_lattice_cell, carried, lattice_of};
use crate::model_polycube::voxels::{Candidate, candidates, onto_model};
use crate::model_polycube::{Model, ModelPolycube, ModelPolycubeError, Polycube};
use crate::progress::ProgressControl;
use crate::remesh::CellSize;

/// By voxels; by coarser ones if that mesh is not good.
pub(super) fn hexmesh(
    model: &Model,
    options: &HexmeshOptions,
    progress: &dyn Fn(HexmeshPhase) -> ProgressControl,
) -> Result<Hexmesh, HexmeshError> {
    let mut best: Option<Hexmesh> = None;
    let mut failure = None;
    for candidate in candidates(model, lattice_of(options))? {
        match by_voxels(candidate, model, options, progress) {
            Ok(made) => {
                if best.as_ref().is_none_or(|best| made.is_better_than(best, options)) {
                    best = Some(made);
                }
                if best.as_ref().is_some_and(|best| best.is_good(options)) {
                    break;
                }
            }
            Err(error) if error.is_cancelled() => return Err(error),
            Err(error) => failure = failure.or(Some(error)),
        }
    }
    best.ok_or_else(|| failure.unwrap_or(ModelPolycubeError::NoVolume.into()))
}

/// By one polycube.
fn by_voxels(
    candidate: Candidate,
    model: &Model,
    options: &HexmeshOptions,
    progress: &dyn Fn(HexmeshPhase) -> ProgressControl,
) -> Result<Hexmesh, HexmeshError> {
    let making = |phase| progress(HexmeshPhase::Polycube(phase));
    let ModelPolycube { mut polycube, boundary } = onto_model(candidate, model, &making)?;
    let mut size = options.size;
    if let Polycube::Voxels(voxels, report) = &mut polycube {
        report.cells *= boxes_per_lattice_cell(options.kind);
        size = CellSize::Length(voxels.size / report.cells as f64);
    }
    let (fit, remeshed) = carried(&boundary, size, options, progress)?;
    Ok(Hexmesh {
        polycube,
        fit,
        remeshed,
    })
}

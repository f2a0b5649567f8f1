//! From models to their hexahedra.

use super::bridge::ffi;
use super::bridge::ffi::Watcher;
use super::error::{Error, ErrorKind, guarded};
use super::maps::{Map, fit_for_cpp, fit_options, on_phase};
use super::meshes::{VolumeMesh, tets_of};
use super::model_polycube::{ModelPolycube, kind_for_cpp, kind_of, on_model_polycube_phase};
use super::polycube::{polycube_for_cpp, polycube_options, size_for_cpp};
use super::solids::{RemeshResult, cell_kind, on_remesh_phase, remesh_for_cpp, remesh_options, required_cell_size};
use solidmap::hexmesh::{self, HexmeshOptions, HexmeshPhase};
use solidmap::model_polycube;
use solidmap::remesh::CellKind;

/// A mesh of a model, and what it was made by.
pub struct Hexmesh {
    /// Until it is taken.
    polycube: Option<Box<ModelPolycube>>,
    map: Map,
    remeshed: RemeshResult,
    crossings: usize,
}

/// The library's own options.
pub fn hexmesh_defaults() -> ffi::HexmeshOptions {
    let options = HexmeshOptions::default();
    let (along, length) = size_for_cpp(options.size);
    ffi::HexmeshOptions {
        hexes: options.kind == CellKind::Hexes,
        along,
        length,
        most_cells: options.most_cells,
        max_distance: options.max_distance,
        most_vertices: options.most_vertices,
        polycube_kind: kind_for_cpp(options.polycube_kind),
        polycube: polycube_for_cpp(&options.polycube),
        fit: fit_for_cpp(&options.fit),
        remesh: remesh_for_cpp(&options.remesh),
    }
}

fn hexmesh_options(options: &ffi::HexmeshOptions) -> Result<HexmeshOptions, Error> {
    Ok(HexmeshOptions {
        kind: cell_kind(options.hexes),
        size: required_cell_size(options.along, options.length)?,
        most_cells: options.most_cells,
        max_distance: options.max_distance,
        most_vertices: options.most_vertices,
        polycube_kind: kind_of(options.polycube_kind),
        polycube: polycube_options(&options.polycube),
        fit: fit_options(&options.fit)?,
        remesh: remesh_options(&options.remesh),
    })
}

pub fn make_hexmesh(
    model: &VolumeMesh,
    options: &ffi::HexmeshOptions,
    watcher: &Watcher,
) -> Result<Box<Hexmesh>, Error> {
    guarded(|| {
        let tets = tets_of(model, "a model is given as")?;
        let progress = |phase| match phase {
            HexmeshPhase::Polycube(phase) => on_model_polycube_phase(watcher, phase),
            HexmeshPhase::Fitting(phase) => on_phase(watcher, phase),
            HexmeshPhase::Remeshing(phase) => on_remesh_phase(watcher, phase),
        };
        let made = hexmesh::make_hexmesh(&tets, &hexmesh_options(options)?, &progress)?;
        let crossings = made.crossings();
        let polycube = ModelPolycube::of(model_polycube::ModelPolycube {
            polycube: made.polycube,
            boundary: made.fit.boundary.clone(),
        });
        Ok(Box::new(Hexmesh {
            polycube: Some(Box::new(polycube)),
            map: Map::of(made.fit),
            remeshed: RemeshResult(made.remeshed),
            crossings,
        }))
    })
}

impl Hexmesh {
    pub fn remeshed(&self) -> &RemeshResult {
        &self.remeshed
    }

    pub fn map(&self) -> Result<Box<Map>, Error> {
        guarded(|| Ok(Box::new(self.map.clone())))
    }

    pub fn crossings(&self) -> usize {
        self.crossings
    }

    pub fn take_polycube(&mut self) -> Result<Box<ModelPolycube>, Error> {
        let found = self.polycube.take();
        found.ok_or_else(|| Error::new(ErrorKind::Internal, "the polycube was taken twice"))
    }
}

//! From models to their hexahedra.

use super::bridge::ffi;
use super::bridge::ffi::Watcher;
use super::error::{Error, ErrorKind, guarded};
use super::maps::{Map, ask, fit_for_cpp, fit_options, on_pair_phase, on_phase};
use super::meshes::{VolumeMesh, tets_of};
use super::polycube::{
    PolycubeMap, distortion_of, on_polycube_phase, polycube_for_cpp, polycube_options, size_for_cpp,
};
use super::solids::{RemeshResult, cell_kind, on_remesh_phase, remesh_for_cpp, remesh_options, required_cell_size};
use solidmap::hexmesh::{
    self, HexmeshOptions, HexmeshPhase, HexmeshPolycube, PolycubeKind, SimplifiedReport, VoxelReport,
};
use solidmap::remesh::CellKind;

/// A mesh of a model, and what it was made by.
pub struct Hexmesh {
    /// Of a deformed model, until it is taken.
    deformed: Option<Box<PolycubeMap>>,
    /// Where it is not the model itself that was deformed.
    simplified: Option<Box<SimplifiedReport>>,
    /// Of a polycube of voxels.
    voxels: Option<Box<VoxelReport>>,
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
        polycube_kind: match options.polycube_kind {
            PolycubeKind::Auto => 0,
            PolycubeKind::Deformed => 1,
            PolycubeKind::Voxels => 2,
        },
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
        polycube_kind: match options.polycube_kind {
            0 => PolycubeKind::Auto,
            1 => PolycubeKind::Deformed,
            _ => PolycubeKind::Voxels,
        },
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
            HexmeshPhase::Simplifying => ask(watcher, "simplifying", f64::NAN, ""),
            HexmeshPhase::Polycube(phase) => on_polycube_phase(watcher, phase),
            HexmeshPhase::Pairing(phase) => on_pair_phase(watcher, phase),
            HexmeshPhase::Fitting(phase) => on_phase(watcher, phase),
            HexmeshPhase::Remeshing(phase) => on_remesh_phase(watcher, phase),
        };
        let made = hexmesh::make_hexmesh(&tets, &hexmesh_options(options)?, &progress)?;
        let crossings = made.crossings();
        let (deformed, simplified, voxels) = match made.polycube {
            HexmeshPolycube::Deformed(found, simplified) => (Some(Box::new(PolycubeMap::of(*found))), simplified, None),
            HexmeshPolycube::Voxels(_, report) => (None, None, Some(report)),
        };
        Ok(Box::new(Hexmesh {
            deformed,
            simplified,
            voxels,
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

    pub fn is_deformed(&self) -> bool {
        self.deformed.is_some()
    }

    pub fn take_deformed(&mut self) -> Result<Box<PolycubeMap>, Error> {
        let found = self.deformed.take();
        found.ok_or_else(|| Error::new(ErrorKind::Internal, "there is no deformed model, or it was taken twice"))
    }

    pub fn is_simplified(&self) -> bool {
        self.simplified.is_some()
    }

    pub fn simplified(&self) -> Result<ffi::SimplifiedReport, Error> {
        let found = self.simplified.as_ref();
        let found = found.ok_or_else(|| Error::new(ErrorKind::Internal, "the model was not simplified"))?;
        Ok(ffi::SimplifiedReport {
            vertices: found.vertices,
            of: found.of,
            distortion: distortion_of(Some(&found.distortion)),
        })
    }

    pub fn voxels(&self) -> Result<ffi::VoxelReport, Error> {
        let found = self.voxels.as_ref();
        let found = found.ok_or_else(|| Error::new(ErrorKind::Internal, "the polycube does not consist of voxels"))?;
        Ok(ffi::VoxelReport {
            voxels: found.voxels,
            size: found.size,
            cells: found.cells,
            missed: found.missed,
            tried: found.tried,
            distortion: distortion_of(Some(&found.distortion)),
        })
    }
}

//! Polycubes of models of any size.

use std::ops::ControlFlow;

use super::bridge::ffi;
use super::bridge::ffi::Watcher;
use super::error::{Error, ErrorKind, guarded};
use super::maps::{Boundary, ask, boxed_boundary, on_pair_phase};
use super::meshes::{VolumeMesh, tets_of};
use super::polycube::{PolycubeMap, distortion_of, on_polycube_phase, polycube_for_cpp, polycube_options};
use solidmap::boundary_map::BoundaryMap;
use solidmap::model_polycube::{
    self, ModelPolycubeOptions, ModelPolycubePhase, Polycube, PolycubeKind, SimplifiedReport, VoxelReport,
};

/// A polycube of a model, and the map between their boundaries.
pub struct ModelPolycube {
    boundary: BoundaryMap,
    labels: Vec<u8>,
    /// The deformed model; `None` for voxels, and once it is taken.
    deformed: Option<Box<PolycubeMap>>,
    /// The simplified model, where one was deformed in place of the model.
    simplified: Option<Box<SimplifiedReport>>,
    /// What is known of the voxels; `None` for a deformed model.
    voxels: Option<Box<VoxelReport>>,
}

/// The library's own options.
pub fn model_polycube_defaults() -> ffi::ModelPolycubeOptions {
    let options = ModelPolycubeOptions::default();
    ffi::ModelPolycubeOptions {
        kind: kind_for_cpp(options.kind),
        most_vertices: options.most_vertices,
        deformation: polycube_for_cpp(&options.deformation),
    }
}

pub fn kind_for_cpp(kind: PolycubeKind) -> u8 {
    match kind {
        PolycubeKind::Auto => 0,
        PolycubeKind::Deformed => 1,
        PolycubeKind::Voxels => 2,
    }
}

pub fn kind_of(number: u8) -> PolycubeKind {
    match number {
        0 => PolycubeKind::Auto,
        1 => PolycubeKind::Deformed,
        _ => PolycubeKind::Voxels,
    }
}

pub fn make_model_polycube(
    model: &VolumeMesh,
    options: &ffi::ModelPolycubeOptions,
    watcher: &Watcher,
) -> Result<Box<ModelPolycube>, Error> {
    guarded(|| {
        let tets = tets_of(model, "a polycube is made of")?;
        let options = ModelPolycubeOptions {
            kind: kind_of(options.kind),
            most_vertices: options.most_vertices,
            deformation: polycube_options(&options.deformation),
        };
        let progress = |phase| on_model_polycube_phase(watcher, phase);
        let made = model_polycube::make_model_polycube(&tets, &options, &progress)?;
        Ok(Box::new(ModelPolycube::of(made)))
    })
}

/// Tells the callback the phase, and asks it whether the work goes on.
pub fn on_model_polycube_phase(watcher: &Watcher, phase: ModelPolycubePhase) -> ControlFlow<()> {
    match phase {
        ModelPolycubePhase::Simplifying => ask(watcher, "simplifying", f64::NAN, ""),
        ModelPolycubePhase::Deforming(phase) => on_polycube_phase(watcher, phase),
        ModelPolycubePhase::Pairing(phase) => on_pair_phase(watcher, phase),
    }
}

impl ModelPolycube {
    pub fn of(made: model_polycube::ModelPolycube) -> Self {
        let labels = made.labels();
        let (deformed, simplified, voxels) = match made.polycube {
            Polycube::Deformed(found, simplified) => (Some(Box::new(PolycubeMap::of(*found))), simplified, None),
            Polycube::Voxels(_, report) => (None, None, Some(report)),
        };
        Self {
            boundary: made.boundary,
            labels,
            deformed,
            simplified,
            voxels,
        }
    }

    pub fn boundary(&self) -> Result<Box<Boundary>, Error> {
        guarded(|| boxed_boundary(self.boundary.clone()))
    }

    pub fn labels(&self) -> &[u8] {
        &self.labels
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

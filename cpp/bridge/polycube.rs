//! Polycubes deformed from tetrahedra.

use std::ops::ControlFlow;

use super::bridge::ffi;
use super::bridge::ffi::Watcher;
use super::error::{Error, guarded};
use super::maps::ask;
use super::meshes::{Surface, VolumeMesh, boxed, tets_of, whole};
use super::solids::cell_size;
use solidmap::boundary_map::SurfaceDistortion;
use solidmap::mesh::{CellMesh, SurfaceMesh, TetMesh};
use solidmap::polycube::{self, LabelSource, Orientation, PolycubeOptions, PolycubePhase};
use solidmap::remesh::CellSize;

/// A polycube with its model.
pub struct PolycubeMap {
    made: polycube::PolycubeMap,
    /// Of the polycube and of the model.
    surfaces: [SurfaceMesh; 2],
}

/// The library's own options.
pub fn polycube_defaults() -> ffi::PolycubeOptions {
    polycube_for_cpp(&PolycubeOptions::default())
}

/// The options as C++ knows them.
pub fn polycube_for_cpp(options: &PolycubeOptions) -> ffi::PolycubeOptions {
    let (lattice_along, lattice_length) = options.lattice.map_or((0, 0.0), size_for_cpp);
    ffi::PolycubeOptions {
        smoothness: options.smoothness,
        feature_angle: options.feature_angle.unwrap_or(0.0),
        most_added: options.most_added,
        attempts: options.attempts,
        effort: options.effort,
        lattice_along,
        lattice_length,
        orientation: match options.orientation {
            Orientation::Given => 0,
            Orientation::Principal => 1,
            Orientation::Best => 2,
        },
    }
}

/// The number of cells along the longest side, and the length of their sides: one of them 0.
pub fn size_for_cpp(size: CellSize) -> (usize, f64) {
    match size {
        CellSize::Along(along) => (along, 0.0),
        CellSize::Length(length) => (0, length),
    }
}

pub fn polycube_options(options: &ffi::PolycubeOptions) -> PolycubeOptions {
    PolycubeOptions {
        smoothness: options.smoothness,
        feature_angle: (options.feature_angle != 0.0).then_some(options.feature_angle),
        most_added: options.most_added,
        attempts: options.attempts,
        effort: options.effort,
        lattice: cell_size(options.lattice_along, options.lattice_length),
        orientation: match options.orientation {
            0 => Orientation::Given,
            1 => Orientation::Principal,
            _ => Orientation::Best,
        },
    }
}

pub fn make_polycube(
    model: &VolumeMesh,
    options: &ffi::PolycubeOptions,
    watcher: &Watcher,
) -> Result<Box<PolycubeMap>, Error> {
    guarded(|| {
        let tets = tets_of(model, "a polycube is made of")?;
        let progress = |phase| on_polycube_phase(watcher, phase);
        let made = polycube::make_polycube(&tets, &polycube_options(options), &progress)?;
        Ok(Box::new(PolycubeMap::of(made)))
    })
}

pub fn make_polycube_with_labels(
    model: &VolumeMesh,
    triangles: &[u32],
    labels: &[u8],
    options: &ffi::PolycubeOptions,
    watcher: &Watcher,
) -> Result<Box<PolycubeMap>, Error> {
    guarded(|| {
        let tets = tets_of(model, "a polycube is made of")?;
        let triangles = whole::<u32, 3>("corners of triangles", triangles)?;
        if triangles.len() != labels.len() {
            let (labels, triangles) = (labels.len(), triangles.len());
            return Err(Error::invalid(format!(
                "there are {labels} labels for {triangles} triangles"
            )));
        }
        let given: Vec<([u32; 3], u8)> = triangles.iter().copied().zip(labels.iter().copied()).collect();
        let progress = |phase| on_polycube_phase(watcher, phase);
        let made = polycube::make_polycube_with_labels(&tets, &given, &polycube_options(options), &progress)?;
        Ok(Box::new(PolycubeMap::of(made)))
    })
}

/// Tells the callback the phase of a polycube, and asks it whether the work goes on.
pub fn on_polycube_phase(watcher: &Watcher, phase: PolycubePhase) -> ControlFlow<()> {
    let (step, detail) = match phase {
        PolycubePhase::Attempting { attempt } => ("attempting", format!("attempt {attempt}")),
        PolycubePhase::Labelling { round } => ("labelling", format!("round {round}")),
        PolycubePhase::Deforming { inverted } => ("deforming", format!("{inverted} inverted")),
        PolycubePhase::Snapping => ("snapping", String::new()),
    };
    ask(watcher, step, f64::NAN, &detail)
}

impl PolycubeMap {
    pub fn of(made: polycube::PolycubeMap) -> Self {
        let surfaces = made.surfaces();
        Self { made, surfaces }
    }

    pub fn model(&self) -> Result<Box<VolumeMesh>, Error> {
        guarded(|| Ok(cells(&self.made.model)))
    }

    pub fn polycube(&self) -> Result<Box<VolumeMesh>, Error> {
        guarded(|| Ok(cells(&self.made.polycube)))
    }

    pub fn boundary(&self) -> &[u32] {
        self.made.boundary.as_flattened()
    }

    pub fn labels(&self) -> &[u8] {
        &self.made.labels
    }

    pub fn given_boundary(&self) -> Vec<u32> {
        self.made
            .given_labels
            .iter()
            .flat_map(|(triangle, _)| *triangle)
            .collect()
    }

    pub fn given_labels(&self) -> Vec<u8> {
        self.made.given_labels.iter().map(|(_, label)| *label).collect()
    }

    pub fn polycube_surface(&self) -> Result<Box<Surface>, Error> {
        guarded(|| boxed(self.surfaces[0].clone()))
    }

    pub fn model_surface(&self) -> Result<Box<Surface>, Error> {
        guarded(|| boxed(self.surfaces[1].clone()))
    }

    pub fn report(&self) -> ffi::PolycubeReport {
        let report = &self.made.report;
        ffi::PolycubeReport {
            labels: match report.labels {
                LabelSource::Cut => 0,
                LabelSource::Sphere => 1,
                LabelSource::Given => 2,
            },
            smoothness: report.smoothness,
            features: report
                .features
                .map_or([0.0; 3], |found| [found.angle, found.length, found.on_borders]),
            attempts: report.attempts,
            turn: report.turn.map_or(vec![], |rows| rows.as_flattened().to_vec()),
            charts: report.charts,
            corners: report.corners,
            planes: report.planes,
            lattice: report.lattice.unwrap_or(0.0),
            tets_given: report.tets_given,
            tets: report.tets,
            inverted_at_start: report.inverted_at_start,
            inverted_after_descent: report.inverted_after_descent,
            energy: report.energy,
            distortion: distortion_of(report.distortion.as_ref()),
        }
    }
}

fn cells(mesh: &TetMesh) -> Box<VolumeMesh> {
    Box::new(VolumeMesh(CellMesh::from(mesh.clone())))
}

/// The numbers that C++ gets; NaN without any.
pub fn distortion_of(found: Option<&SurfaceDistortion>) -> ffi::SurfaceDistortion {
    let value = |of: fn(&SurfaceDistortion) -> f64| found.map_or(f64::NAN, of);
    ffi::SurfaceDistortion {
        angle_median: value(|found| found.angle.p50),
        angle_p99: value(|found| found.angle.p99),
        area_median: value(|found| found.area.p50),
        area_p99: value(|found| found.area.p99),
    }
}

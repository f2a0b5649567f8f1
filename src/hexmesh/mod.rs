//! From a model to its hexahedra: a polycube of the model on a lattice, the harmonic map from the polycube to the model, and
//! the lattice's cells carried by it and repaired.
//!
//! Every step is also there by itself: [`make_model_polycube`](crate::model_polycube::make_model_polycube), [`fit`], [`remesh`].

mod voxels;

use crate::boundary_map::BoundaryMap;
use crate::fit::{Fit, FitError, FitOptions, Phase, fit};
use crate::mesh::TetMesh;
use crate::model_polycube::{
    MOST_VERTICES, Model, ModelPolycube, ModelPolycubeError, ModelPolycubePhase, Polycube, PolycubeKind, deformed,
    with_few_attempts,
};
use crate::polycube::PolycubeOptions;
use crate::progress::{ProgressControl, ProgressResponse};
use crate::remesh::{
    CellKind, CellSize, RemeshError, RemeshOptions, RemeshPhase, RemeshSource, Remeshed, crossing_triangles, remesh,
};

/// Voxels are tried, too, where a deformation of a model with one handle or none leads to a valid mesh with a smaller least scaled
/// Jacobian. For scale: where the rocker arm has
/// 0.058 by its deformation, it has 0.40 by voxels.
const POOR: f64 = 0.1;

/// Part of the effort that a second polycube gets where the first has led to a valid mesh. For scale: voxels of a thin tube took 150 s in vain.
const EFFORT_OF_SECOND: f64 = 0.1;

/// A mesh is no better than another one from which the model is this many times less far, in the mean, whatever its cells: voxels round
/// off what is sharp. Of CAD parts whose deformation led to poor cells voxels were 5 times as far away, of the rocker arm 0.7 times.
const MOST_FARTHER: f64 = 2.0;

/// Options of [`make_hexmesh`].
#[derive(Debug, Clone, PartialEq)]
pub struct HexmeshOptions {
    /// Kind of the cells.
    pub kind: CellKind,
    /// Size of the cells in the polycube, which is about as large as the model.
    pub size: CellSize,
    /// Largest number of cells; more are refused before any is made.
    pub most_cells: usize,
    /// How far the model and the mesh may be from each other, over the diagonal of the model, before another polycube is tried.
    pub max_distance: f64,
    /// Where the polycube comes from. With [`PolycubeKind::Auto`], voxels are also tried where the deformed model leads to a poor mesh, and
    /// the better mesh is returned.
    pub polycube_kind: PolycubeKind,
    /// The number of vertices above which a model is simplified
    /// ([`ModelPolycubeOptions::most_vertices`](crate::model_polycube::ModelPolycubeOptions::most_vertices)). The mesh's boundary is on the
    /// model itself.
    pub most_vertices: usize,
    /// How the model is deformed to a polycube. Its lattice is chosen by the size of the cells.
    pub polycube: PolycubeOptions,
    /// How the map is fitted.
    pub fit: FitOptions,
    /// How the cells are repaired and polished.
    pub remesh: RemeshOptions,
}

impl Default for HexmeshOptions {
    fn default() -> Self {
        Self {
            kind: CellKind::Hexes,
            size: CellSize::Along(32),
            most_cells: 20_000_000,
            max_distance: MAX_DISTANCE,
            polycube_kind: PolycubeKind::Auto,
            most_vertices: MOST_VERTICES,
            polycube: PolycubeOptions::default(),
            fit: FitOptions {
                tolerance: TOLERANCE,
                ..FitOptions::adaptive()
            },
            remesh: RemeshOptions::default(),
        }
    }
}

/// The default tolerance of the fit. Boundary nodes are where the boundary map puts them, not the fitted one, and inner nodes
/// are moved by the repair.
pub const TOLERANCE: f64 = 0.002;

/// The default of [`HexmeshOptions::max_distance`].
pub const MAX_DISTANCE: f64 = 0.05;

/// The current step of [`make_hexmesh`], for progress callbacks.
#[derive(Debug, Clone, PartialEq)]
pub enum HexmeshPhase {
    /// The polycube is made, and its boundary mapped to the model's.
    Polycube(ModelPolycubePhase),
    /// The map is fitted.
    Fitting(Phase),
    /// Its cells are carried to the model.
    Remeshing(RemeshPhase),
}

/// Why there is no mesh.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum HexmeshError {
    /// No polycube was found, or the model cannot be used.
    #[error(transparent)]
    Polycube(#[from] ModelPolycubeError),
    /// The largest distance allowed is not positive.
    #[error("the distance allowed between the model and the mesh is {0}, but must be positive")]
    MaxDistance(f64),
    /// The model cannot be deformed to a polycube, and voxels lead to no mesh.
    #[error("{deformed}; and by voxels instead: {voxels}")]
    Neither {
        /// Why there is no deformed model.
        deformed: Box<ModelPolycubeError>,
        /// Why there is no mesh by voxels.
        voxels: Box<Self>,
    },
    /// The map cannot be fitted.
    #[error(transparent)]
    Fit(#[from] FitError),
    /// The polycube's cells cannot be carried.
    #[error(transparent)]
    Remesh(#[from] RemeshError),
}

/// A model's mesh of hexahedra or tetrahedra, and what it was made by.
#[derive(Debug)]
pub struct Hexmesh {
    /// The polycube.
    pub polycube: Polycube,
    /// The harmonic map from the polycube to the model.
    pub fit: Fit,
    /// The mesh: its nodes are `remeshed.images`.
    pub remeshed: Remeshed,
}

impl Hexmesh {
    /// Invalid cells, and pairs of boundary triangles that pass through each other.
    fn faults(&self) -> usize {
        self.remeshed.report.after.cells.len() + self.crossings()
    }

    /// Pairs of boundary triangles of the mesh that pass through each other, quads as two triangles. They are searched for at
    /// every call.
    pub fn crossings(&self) -> usize {
        crossing_triangles(self.remeshed.mesh.boundary(), &self.remeshed.images).len()
    }

    /// Whether there are no faults, and no part of the model is missed.
    fn is_good(&self, options: &HexmeshOptions) -> bool {
        self.farthest() <= options.max_distance && self.faults() == 0
    }

    /// By faults; then by the least scaled Jacobian if both are near enough to the model, and this one is not much farther from it in
    /// the mean; else by the distance.
    fn is_better_than(&self, other: &Self, options: &HexmeshOptions) -> bool {
        let of_both = [self, other];
        let [faults, of_other] = of_both.map(Self::faults);
        if faults != of_other {
            return faults < of_other;
        }
        if of_both.iter().any(|made| made.farthest() > options.max_distance) {
            return self.farthest() < other.farthest();
        }
        self.least_scaled_jacobian() > other.least_scaled_jacobian()
            && self.mean_distance() <= MOST_FARTHER * other.mean_distance()
    }

    fn least_scaled_jacobian(&self) -> f64 {
        let quality = self.remeshed.report.quality;
        quality.map_or(f64::NEG_INFINITY, |quality| quality.min_scaled_jacobian)
    }

    /// Largest distance between the model and the mesh, either way, over the diagonal.
    fn farthest(&self) -> f64 {
        self.remeshed.report.farthest()
    }

    fn mean_distance(&self) -> f64 {
        self.remeshed.report.target_to_mesh.mean
    }
}

/// Meshes a model, given as tetrahedra, with hexahedra: a polycube, the harmonic map from it, and its cells in the model.
///
/// Several polycubes may be tried ([`PolycubeKind`]). The first mesh is returned that is valid, within
/// [`HexmeshOptions::max_distance`] of the model and without a poor cell, else the best: the one with the fewest faults, of these that
/// with the largest least scaled Jacobian. Cells that stay inverted are not an
/// error; the report lists them.
///
/// # Errors
///
/// Where no polycube is found, and those of [`fit`] and [`remesh`].
pub fn make_hexmesh<R: ProgressResponse>(
    model: &TetMesh,
    options: &HexmeshOptions,
    progress: &dyn Fn(HexmeshPhase) -> R,
) -> Result<Hexmesh, HexmeshError> {
    let progress = |phase| progress(phase).control();
    let is_usable = options.max_distance > 0.0;
    if !is_usable {
        return Err(HexmeshError::MaxDistance(options.max_distance));
    }
    let model = Model::new(model);
    let may_be_voxels = match options.polycube_kind {
        PolycubeKind::Auto => model.has_pairs(),
        PolycubeKind::Deformed => false,
        PolycubeKind::Voxels => return voxels::hexmesh(&model, options, &progress),
    };
    let few_attempts = may_be_voxels && model.has_few_handles();
    // With many handles voxels take long, and are seldom better.
    let is_enough = |made: &Hexmesh| made.is_good(options) && (!few_attempts || made.least_scaled_jacobian() >= POOR);
    match by_deformation(&model, options, few_attempts, &progress) {
        Ok(made) if may_be_voxels && !is_enough(&made) => {
            // Where there is a valid mesh, another one is worth less effort. What the other polycube fails with says nothing about this one.
            let options = &HexmeshOptions {
                remesh: RemeshOptions {
                    effort: options.remesh.effort * if made.is_good(options) { EFFORT_OF_SECOND } else { 1.0 },
                    ..options.remesh
                },
                ..options.clone()
            };
            let other = match voxels::hexmesh(&model, options, &progress) {
                Err(error) if error.is_cancelled() => return Err(error),
                other => other.ok(),
            };
            Ok(match other {
                Some(other) if other.is_better_than(&made, options) => other,
                _ => made,
            })
        }
        Err(HexmeshError::Polycube(deformed)) if may_be_voxels && deformed.may_be_voxels() => {
            voxels::hexmesh(&model, options, &progress).map_err(|voxels| match voxels.is_cancelled() {
                true => voxels,
                false => HexmeshError::Neither {
                    deformed: Box::new(deformed),
                    voxels: Box::new(voxels),
                },
            })
        }
        made => made,
    }
}

impl HexmeshError {
    /// Whether no polycube was found, though the model is one that can be used.
    pub fn is_without_polycube(&self) -> bool {
        match self {
            Self::Polycube(error) => error.is_without_polycube(),
            error => matches!(error, Self::Neither { .. }),
        }
    }

    /// Whether the progress callback cancelled the work.
    pub fn is_cancelled(&self) -> bool {
        match self {
            Self::Polycube(error) => error.is_cancelled(),
            error => matches!(
                error,
                Self::Fit(FitError::Cancelled) | Self::Remesh(RemeshError::Cancelled)
            ),
        }
    }
}

/// By a deformation of the model, sought in a few attempts or all.
fn by_deformation(
    model: &Model,
    options: &HexmeshOptions,
    few_attempts: bool,
    progress: &dyn Fn(HexmeshPhase) -> ProgressControl,
) -> Result<Hexmesh, HexmeshError> {
    let deformation = PolycubeOptions {
        lattice: Some(lattice_of(options)),
        ..options.polycube
    };
    let deformation = match few_attempts {
        true => with_few_attempts(&deformation),
        false => deformation,
    };
    let making = |phase| progress(HexmeshPhase::Polycube(phase));
    let ModelPolycube { polycube, boundary } = deformed(model, options.most_vertices, &deformation, &making)?;
    // The lattice's own size where the polycube's planes are on it.
    let size = match &polycube {
        Polycube::Deformed(found, _) => found
            .report
            .lattice
            .map(|size| size / boxes_per_lattice_cell(options.kind) as f64),
        Polycube::Voxels(..) => None,
    };
    let size = size.map_or(options.size, CellSize::Length);
    let (fit, remeshed) = carried(&boundary, size, options, progress)?;
    Ok(Hexmesh {
        polycube,
        fit,
        remeshed,
    })
}

/// The harmonic map with these boundary values, and a regular mesh carried by it.
fn carried(
    boundary: &BoundaryMap,
    size: CellSize,
    options: &HexmeshOptions,
    progress: &dyn Fn(HexmeshPhase) -> ProgressControl,
) -> Result<(Fit, Remeshed), HexmeshError> {
    let fitted = fit(boundary, &options.fit, &|phase| progress(HexmeshPhase::Fitting(phase)))?;
    let source = RemeshSource::Regular {
        kind: options.kind,
        size,
        most_cells: options.most_cells,
    };
    // Another polycube is better than a boundary map that knows nothing of its charts.
    let remesh_options = RemeshOptions {
        keep_boundary_map: true,
        ..options.remesh
    };
    let remeshed = remesh(boundary, &fitted.map, source, &remesh_options, &|phase| {
        progress(HexmeshPhase::Remeshing(phase))
    })?;
    Ok((fitted, remeshed))
}

/// Boxes between two cells of the lattice: grids of tetrahedra have an even number between planes.
fn boxes_per_lattice_cell(kind: CellKind) -> usize {
    match kind {
        CellKind::Tets => 2,
        CellKind::Hexes => 1,
    }
}

fn lattice_of(options: &HexmeshOptions) -> CellSize {
    let boxes = boxes_per_lattice_cell(options.kind);
    match options.size {
        CellSize::Along(count) => CellSize::Along(count.div_ceil(boxes)),
        CellSize::Length(length) => CellSize::Length(boxes as f64 * length),
    }
}

#[cfg(test)]
mod tests;

//! From a model to its hexahedra: a polycube of the model on a lattice, the harmonic map from the polycube to the model, and
//! the lattice's cells carried by it and repaired.
//!
//! Every step is also there by itself: [`make_polycube`], [`fit`], [`remesh`].

use crate::boundary_map::{BoundaryMap, BoundaryMapError};
use crate::fit::{Fit, FitError, FitOptions, Phase, fit};
use crate::mesh::TetMesh;
use crate::polycube::{MakePolycubeError, PolycubeMap, PolycubeOptions, PolycubePhase, make_polycube};
use crate::progress::ProgressResponse;
use crate::remesh::{CellKind, CellSize, RemeshError, RemeshOptions, RemeshPhase, RemeshSource, Remeshed, remesh};

/// Options of [`make_hexmesh`].
#[derive(Debug, Clone, PartialEq)]
pub struct HexmeshOptions {
    /// Kind of the cells.
    pub kind: CellKind,
    /// Size of the cells in the polycube, which is about as large as the model.
    pub size: CellSize,
    /// Largest number of cells; more are refused before any is made.
    pub most_cells: usize,
    /// How the polycube is made. Its lattice is chosen by the size of the cells.
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

/// The current step of [`make_hexmesh`], for progress callbacks.
#[derive(Debug, Clone, PartialEq)]
pub enum HexmeshPhase {
    /// The polycube is made.
    Polycube(PolycubePhase),
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
    Polycube(#[from] MakePolycubeError),
    /// The polycube's boundary and the model's are no boundary map.
    #[error(transparent)]
    BoundaryMap(#[from] BoundaryMapError),
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
    pub polycube: PolycubeMap,
    /// The harmonic map from the polycube to the model.
    pub fit: Fit,
    /// The mesh: its nodes are `remeshed.images`.
    pub remeshed: Remeshed,
}

/// Meshes a model, given as tetrahedra, with hexahedra: a polycube, the harmonic map from it, and its cells in the model.
///
/// Cells that stay inverted are not an error; the report lists them.
///
/// # Errors
///
/// Where no polycube is found, and those of [`fit`] and [`remesh`].
pub fn make_hexmesh<R: ProgressResponse>(
    model: &TetMesh,
    options: &HexmeshOptions,
    progress: &dyn Fn(HexmeshPhase) -> R,
) -> Result<Hexmesh, HexmeshError> {
    let polycube_options = PolycubeOptions {
        lattice: Some(lattice_of(options)),
        ..options.polycube
    };
    let polycube = make_polycube(model, &polycube_options, &|phase| {
        progress(HexmeshPhase::Polycube(phase))
    })?;
    let [domain, target] = polycube.surfaces();
    let boundary = BoundaryMap::between(domain, &target)?;
    let fitted = fit(&boundary, &options.fit, &|phase| progress(HexmeshPhase::Fitting(phase)))?;
    let source = RemeshSource::Regular {
        kind: options.kind,
        size: cell_size(options, &polycube),
        most_cells: options.most_cells,
    };
    let remeshed = remesh(&boundary, &fitted.map, source, &options.remesh, &|phase| {
        progress(HexmeshPhase::Remeshing(phase))
    })?;
    Ok(Hexmesh {
        polycube,
        fit: fitted,
        remeshed,
    })
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

/// The lattice's own size where the polycube's planes are on it.
fn cell_size(options: &HexmeshOptions, polycube: &PolycubeMap) -> CellSize {
    match polycube.report.lattice {
        Some(size) => CellSize::Length(size / boxes_per_lattice_cell(options.kind) as f64),
        None => options.size,
    }
}

#[cfg(test)]
mod tests;

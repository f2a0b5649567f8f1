//! From a model to its hexahedra: a polycube of the model on a lattice, the harmonic map from the polycube to the model, and
//! the lattice's cells carried by it and repaired.
//!
//! The polycube is the model itself, deformed, or one of voxels with a bijection of the boundaries. Of a large solid a
//! simplified model is deformed.
//! Every step is also there by itself: [`make_polycube`] or [`VoxelPolycube`] and
//! [`map_pair`](crate::boundary_map::pair::map_pair), [`fit`], [`remesh`].

mod simplified;
mod voxels;

use crate::boundary_map::pair::{PairError, PairPhase};
use crate::boundary_map::{BoundaryMap, BoundaryMapError};
use crate::fit::{Fit, FitError, FitOptions, Phase, fit};
use crate::mesh::{SurfaceMesh, TetMesh};
use crate::polycube::{
    MakePolycubeError, PolycubeMap, PolycubeOptions, PolycubePhase, VoxelPolycube, VoxelPolycubeError, make_polycube,
};
use crate::progress::{ProgressControl, ProgressResponse};
use crate::remesh::{
    CellKind, CellSize, RemeshError, RemeshOptions, RemeshPhase, RemeshSource, Remeshed, crossing_triangles, remesh,
};
use crate::spherical::{SphericalError, genus};

pub use simplified::SimplifiedReport;
pub use voxels::VoxelReport;

/// Where the polycube comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum PolycubeKind {
    /// A deformation of the model if one attempt finds one that leads to a valid mesh (with two handles or more: if any attempt does), else
    /// voxels.
    #[default]
    Auto,
    /// The model, deformed ([`make_polycube`]).
    Deformed,
    /// Voxels ([`VoxelPolycube`]).
    Voxels,
}

/// Attempts at a deformation where voxels are left as well. For scale: an attempt that fails takes up to a minute for 50 000
/// tetrahedra, voxels 20 s, with cells no worse.
const ATTEMPTS_BEFORE_VOXELS: usize = 1;
/// Most of the effort of such an attempt ([`PolycubeOptions::effort`]).
const EFFORT_BEFORE_VOXELS: f64 = 2000.0;

/// Handles of a model, at most, whose voxels are tried after a few attempts at a deformation, and not after all: the more handles, the
/// less often voxels show all of them.
const HANDLES_OF_FEW_ATTEMPTS: u64 = 1;

/// Vertices of a model with handles that is deformed as it is, over [`HexmeshOptions::most_vertices`]. A simplified ring leads to a
/// polycube less often than the ring itself, and voxels, which follow, to worse cells: the kitten's, of 9447 vertices, have a least
/// scaled Jacobian of 0.61 by its own deformation in 22 s, 0.43 by voxels in 43 s.
const RINGS: f64 = 2.5;

/// Voxels are tried, too, where a deformation of a model with one handle or none leads to a valid mesh with a smaller least scaled
/// Jacobian. For scale: where the rocker arm has
/// 0.058 by its deformation, it has 0.40 by voxels.
const POOR: f64 = 0.1;

/// Options of [`make_hexmesh`].
#[derive(Debug, Clone, PartialEq)]
pub struct HexmeshOptions {
    /// Kind of the cells.
    pub kind: CellKind,
    /// Size of the cells in the polycube, which is about as large as the model.
    pub size: CellSize,
    /// Largest number of cells; more are refused before any is made.
    pub most_cells: usize,
    /// How far a vertex of the model may be from the mesh, over the diagonal of the model, before another polycube is tried.
    pub max_distance: f64,
    /// Where the polycube comes from.
    pub polycube_kind: PolycubeKind,
    /// A model of genus 0 whose surface has more vertices, or one with handles with more than 2.5 times as many, is simplified, and its
    /// polycube is made from the simplified one. The mesh's boundary is on the model itself. Without the feature `native` it is
    /// deformed as it is.
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

/// The default of [`HexmeshOptions::most_vertices`].
pub const MOST_VERTICES: usize = 6000;

/// The current step of [`make_hexmesh`], for progress callbacks.
#[derive(Debug, Clone, PartialEq)]
pub enum HexmeshPhase {
    /// A large model is simplified.
    Simplifying,
    /// The polycube is made.
    Polycube(PolycubePhase),
    /// The boundary of a polycube of voxels, or of a simplified model, is mapped to the model's.
    Pairing(PairPhase),
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
    /// There is no polycube of voxels.
    #[error(transparent)]
    Voxels(#[from] VoxelPolycubeError),
    /// The boundary of the polycube of voxels, or of the simplified model, cannot be mapped to the model's.
    #[error(
        "the boundary of the polycube of voxels, or of the simplified model, cannot be mapped to the model's (the target): {0}"
    )]
    Pair(#[from] PairError),
    /// The largest distance allowed is not positive.
    #[error("the distance allowed between the model and the mesh is {0}, but must be positive")]
    MaxDistance(f64),
    /// The surface of the model encloses no volume, or it is inside out.
    #[error("the surface of the model encloses no volume")]
    NoVolume,
    /// The model cannot be deformed to a polycube, and voxels lead to no mesh.
    #[error("{deformed}; and by voxels instead: {voxels}")]
    Neither {
        /// Why there is no deformed model.
        deformed: Box<Self>,
        /// Why there is no mesh by voxels.
        voxels: Box<Self>,
    },
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

/// The polycube of a [`Hexmesh`].
#[derive(Debug)]
pub enum HexmeshPolycube {
    /// The model, deformed; or a simplified one.
    Deformed(Box<PolycubeMap>, Option<Box<SimplifiedReport>>),
    /// Voxels.
    Voxels(VoxelPolycube, Box<VoxelReport>),
}

/// A model's mesh of hexahedra or tetrahedra, and what it was made by.
#[derive(Debug)]
pub struct Hexmesh {
    /// The polycube.
    pub polycube: HexmeshPolycube,
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

    /// By faults; then by the least scaled Jacobian if both are near enough to the model, else by the distance.
    fn is_better_than(&self, other: &Self, options: &HexmeshOptions) -> bool {
        let of_both = [self, other];
        let [faults, of_other] = of_both.map(Self::faults);
        if faults != of_other {
            return faults < of_other;
        }
        match of_both.iter().all(|made| made.farthest() <= options.max_distance) {
            true => self.least_scaled_jacobian() > other.least_scaled_jacobian(),
            false => self.farthest() < other.farthest(),
        }
    }

    fn least_scaled_jacobian(&self) -> f64 {
        let quality = self.remeshed.report.quality;
        quality.map_or(f64::NEG_INFINITY, |quality| quality.min_scaled_jacobian)
    }

    /// Largest distance of a vertex of the model from the mesh, over the diagonal.
    fn farthest(&self) -> f64 {
        self.remeshed.report.target_to_mesh.max
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
    let few_attempts = may_be_voxels
        && model
            .genus
            .as_ref()
            .is_ok_and(|genus| *genus <= HANDLES_OF_FEW_ATTEMPTS);
    // With many handles voxels take long, and are seldom better.
    let is_enough = |made: &Hexmesh| made.is_good(options) && (!few_attempts || made.least_scaled_jacobian() >= POOR);
    match by_deformation(&model, options, few_attempts, &progress) {
        Ok(made) if may_be_voxels && !is_enough(&made) => {
            // What the other polycube fails with says nothing about this one.
            let other = match voxels::hexmesh(&model, options, &progress) {
                Err(error) if error.is_cancelled() => return Err(error),
                other => other.ok(),
            };
            Ok(match other {
                Some(other) if other.is_better_than(&made, options) => other,
                _ => made,
            })
        }
        Err(deformed) if may_be_voxels && deformed.may_be_voxels() => voxels::hexmesh(&model, options, &progress)
            .map_err(|error| match error.is_cancelled() {
                true => error,
                false => HexmeshError::Neither {
                    deformed: Box::new(deformed),
                    voxels: Box::new(error),
                },
            }),
        made => made,
    }
}

impl HexmeshError {
    /// Whether no polycube was found, though the model is one that can be used.
    pub fn is_without_polycube(&self) -> bool {
        matches!(
            self,
            Self::Polycube(MakePolycubeError::NotFound { .. } | MakePolycubeError::NoLabels) | Self::Neither { .. }
        )
    }

    /// Whether voxels may lead to a mesh all the same.
    fn may_be_voxels(&self) -> bool {
        self.is_without_polycube() || matches!(self, Self::Pair(_)) && !self.is_cancelled()
    }

    /// Whether the progress callback cancelled the work.
    pub fn is_cancelled(&self) -> bool {
        matches!(
            self,
            Self::Polycube(MakePolycubeError::Cancelled)
                | Self::Pair(PairError::Cancelled)
                | Self::Fit(FitError::Cancelled)
                | Self::Remesh(RemeshError::Cancelled)
        )
    }
}

/// A model with its surface.
struct Model<'a> {
    tets: &'a TetMesh,
    surface: SurfaceMesh,
    genus: Result<u64, SphericalError>,
}

impl<'a> Model<'a> {
    fn new(tets: &'a TetMesh) -> Self {
        let surface = tets.boundary().surface;
        let genus = genus(&surface);
        Self { tets, surface, genus }
    }

    /// Whether the boundaries of other solids are mapped to this one ([`map_pair`](crate::boundary_map::pair::map_pair)).
    fn has_pairs(&self) -> bool {
        self.genus.is_ok()
    }

    /// Whether it has so many vertices that a simplified model is deformed in its place.
    fn is_large(&self, options: &HexmeshOptions) -> bool {
        let most = options.most_vertices as f64;
        let most = if self.genus == Ok(0) { most } else { RINGS * most };
        self.surface.vertices().len() as f64 > most
    }
}

/// By a deformation of the model, sought in a few attempts or all.
fn by_deformation(
    model: &Model,
    options: &HexmeshOptions,
    few_attempts: bool,
    progress: &dyn Fn(HexmeshPhase) -> ProgressControl,
) -> Result<Hexmesh, HexmeshError> {
    let mut polycube_options = PolycubeOptions {
        lattice: Some(lattice_of(options)),
        ..options.polycube
    };
    if few_attempts {
        polycube_options.attempts = polycube_options.attempts.min(ATTEMPTS_BEFORE_VOXELS);
        polycube_options.effort = polycube_options.effort.min(EFFORT_BEFORE_VOXELS);
    }
    let making = |phase| progress(HexmeshPhase::Polycube(phase));
    let mut by_simplified = None;
    if model.has_pairs()
        && model.is_large(options)
        && let Some(simplified) = simplified::simplified(model, options, progress)?
    {
        let polycube = make_polycube(&simplified, &polycube_options, &making)?;
        let [domain, image] = polycube.surfaces();
        by_simplified = match simplified::onto_model(domain, &image, &model.surface, progress) {
            Ok((boundary, report)) => Some((polycube, boundary, Some(Box::new(report)))),
            // With many handles closest points may not say which goes where: then the model is deformed as it is.
            Err(HexmeshError::Pair(PairError::NoClass { .. })) => None,
            Err(error) => return Err(error),
        };
    }
    let (polycube, boundary, simplified) = match by_simplified {
        Some(made) => made,
        None => {
            let polycube = make_polycube(model.tets, &polycube_options, &making)?;
            let [domain, image] = polycube.surfaces();
            let boundary = BoundaryMap::between(domain, &image)?;
            (polycube, boundary, None)
        }
    };
    let size = cell_size(options, &polycube);
    let (fit, remeshed) = carried(&boundary, size, options, progress)?;
    Ok(Hexmesh {
        polycube: HexmeshPolycube::Deformed(Box::new(polycube), simplified),
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

/// The lattice's own size where the polycube's planes are on it.
fn cell_size(options: &HexmeshOptions, polycube: &PolycubeMap) -> CellSize {
    match polycube.report.lattice {
        Some(size) => CellSize::Length(size / boxes_per_lattice_cell(options.kind) as f64),
        None => options.size,
    }
}

#[cfg(test)]
mod tests;

//! Polycubes of voxels, whose boundary is mapped to the model's by embeddings in the sphere, a flat torus or a hyperbolic surface.

use super::{Model, ModelPolycube, ModelPolycubeError, ModelPolycubePhase, Polycube};
use crate::boundary_map::SurfaceDistortion;
use crate::boundary_map::pair::{PairError, PairOptions, map_pair};
use crate::mesh::SurfaceMesh;
use crate::polycube::{MakePolycubeError, VoxelPolycube, VoxelPolycubeError};
use crate::progress::ProgressControl;
use crate::remesh::CellSize;

/// Voxels along the longest side of the model, at least, where cells are small enough.
const LEAST_ALONG: usize = 12;
/// Squares along a side of a voxel in the polycube's boundary, as it is mapped.
const DIVISIONS: usize = 2;
/// Voxels at most, but where the coarsest polycube has more: maps of more take a minute and more.
const MOST_VOXELS: usize = 1600;
/// Volume of a model over the cube of its diagonal that is no rounding error.
const LEAST_VOLUME: f64 = 1e-12;
/// Sizes of voxels that are tried.
const MOST_SIZES: usize = 3;

/// What is known of a polycube of voxels.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct VoxelReport {
    /// How many voxels it has.
    pub voxels: usize,
    /// Their edge length, in the units of the model.
    pub size: f64,
    /// Cells of the lattice along a voxel's edge; in a mesh, its own cells.
    pub cells: usize,
    /// Vertices of the model that are farther than a voxel from the polycube.
    pub missed: usize,
    /// How many such polycubes were tried.
    pub tried: usize,
    /// How the boundary is distorted from the polycube to the model.
    pub distortion: SurfaceDistortion,
}

/// By the first polycube of voxels whose boundary is mapped to the model's.
pub(super) fn coarser_until_mapped(
    model: &Model,
    lattice: CellSize,
    progress: &dyn Fn(ModelPolycubePhase) -> ProgressControl,
) -> Result<ModelPolycube, ModelPolycubeError> {
    let mut failure = None;
    for candidate in candidates(model, lattice)? {
        match onto_model(candidate, model, progress) {
            Err(error) if !error.is_cancelled() => failure = failure.or(Some(error)),
            made => return made,
        }
    }
    Err(failure.unwrap_or(ModelPolycubeError::NoVolume))
}

/// Voxels that may be a polycube of a model.
pub(crate) struct Candidate {
    polycube: VoxelPolycube,
    /// Cells of the lattice along the edge of a voxel.
    cells: usize,
    /// Its place in the order, from 1.
    number: usize,
}

/// Polycubes of voxels on a lattice in the order in which they are tried, at least one.
pub(crate) fn candidates(model: &Model, lattice: CellSize) -> Result<Vec<Candidate>, ModelPolycubeError> {
    let target = &model.surface;
    let has_volume = target.volume() > LEAST_VOLUME * target.diagonal().powi(3);
    if !has_volume {
        return Err(ModelPolycubeError::NoVolume);
    }
    let handles = match &model.genus {
        Ok(handles) => *handles,
        Err(error) => {
            let (side, error) = ("target", error.clone());
            return Err(PairError::Sphere { side, error }.into());
        }
    };
    let size = lattice_size(lattice, target)?;
    let along = longest_side(target) / size;
    let found = polycubes(target, handles, size, along as usize)?;
    if found.is_empty() {
        return Err(VoxelPolycubeError::Thin(size).into());
    }
    let candidate = |(number, (cells, polycube))| Candidate {
        polycube,
        cells,
        number,
    };
    Ok((1..).zip(found).take(MOST_SIZES).map(candidate).collect())
}

/// A polycube of voxels with the map from its boundary to the model's.
pub(crate) fn onto_model(
    candidate: Candidate,
    model: &Model,
    progress: &dyn Fn(ModelPolycubePhase) -> ProgressControl,
) -> Result<ModelPolycube, ModelPolycubeError> {
    let Candidate {
        polycube,
        cells,
        number,
    } = candidate;
    let pairing = |phase| progress(ModelPolycubePhase::Pairing(phase));
    let in_place = PairOptions {
        aligned: true,
        ..PairOptions::default()
    };
    let (boundary, pair) = map_pair(&polycube.surface(DIVISIONS), &model.surface, &in_place, &pairing)?;
    let report = VoxelReport {
        voxels: polycube.voxels.len(),
        size: polycube.size,
        cells,
        missed: polycube.missed,
        tried: number,
        distortion: pair.after,
    };
    Ok(ModelPolycube {
        polycube: Polycube::Voxels(polycube, Box::new(report)),
        boundary,
    })
}

fn longest_side(surface: &SurfaceMesh) -> f64 {
    surface.bounding_box().map_or(0.0, |(low, high)| (high - low).max())
}

/// The size of the lattice's cells.
fn lattice_size(lattice: CellSize, target: &SurfaceMesh) -> Result<f64, ModelPolycubeError> {
    let size = match lattice {
        CellSize::Length(length) => length,
        CellSize::Along(count) => longest_side(target) / count as f64,
    };
    let is_usable = size > 0.0 && size.is_finite();
    if is_usable {
        Ok(size)
    } else {
        Err(MakePolycubeError::Lattice(size).into())
    }
}

/// Numbers of cells along a voxel, each at most 4/5 of the one before, down to 1: those of a fine lattice are too many to try them all.
fn finer_from(coarsest: usize) -> impl Iterator<Item = usize> {
    let finer = |cells: &usize| (*cells > 1).then(|| cells / 5 * 4 + cells % 5 * 4 / 5);
    std::iter::successors(Some(coarsest), finer)
}

/// Polycubes of voxels with a whole number of cells along an edge, in the order in which they are tried: from the finest that has
/// no more than [`MOST_VOXELS`], or the coarsest, to coarser ones. Thin limbs are stretched less by fine voxels.
fn polycubes(
    target: &SurfaceMesh,
    handles: u64,
    size: f64,
    along: usize,
) -> Result<Vec<(usize, VoxelPolycube)>, VoxelPolycubeError> {
    let with = |cells: usize| VoxelPolycube::new(target, handles, cells as f64 * size);
    let coarsest = (along / LEAST_ALONG).max(1);
    let mut found = vec![];
    let mut failure = None;
    for cells in finer_from(coarsest) {
        match with(cells) {
            Ok(polycube) if !found.is_empty() && polycube.voxels.len() > MOST_VOXELS => break,
            Ok(polycube) => found.push((cells, polycube)),
            // Smaller voxels may fit through a hole that these do not.
            Err(VoxelPolycubeError::Handles { .. }) if cells > 1 => {}
            Err(error) => failure = Some(error),
        }
    }
    found.reverse();
    let coarser = coarsest + 1;
    found.extend(with(coarser).map(|polycube| (coarser, polycube)));
    match failure {
        Some(error) if found.is_empty() => Err(error),
        _ => Ok(found),
    }
}

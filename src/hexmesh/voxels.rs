//! Hexahedra by a polycube of voxels, whose boundary is mapped to the model's by embeddings in the sphere, a flat torus or a hyperbolic surface.

use super::{
    Hexmesh, HexmeshError, HexmeshOptions, HexmeshPhase, HexmeshPolycube, Model, boxes_per_lattice_cell, carried,
    lattice_of,
};
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
    /// Cells of the mesh along a voxel's edge.
    pub cells: usize,
    /// Vertices of the model that are farther than a voxel from the polycube.
    pub missed: usize,
    /// How many such polycubes were tried.
    pub tried: usize,
    /// How the boundary is distorted from the polycube to the model.
    pub distortion: SurfaceDistortion,
}

/// By voxels; by coarser ones if that mesh is not good.
pub(super) fn hexmesh(
    model: &Model,
    options: &HexmeshOptions,
    progress: &dyn Fn(HexmeshPhase) -> ProgressControl,
) -> Result<Hexmesh, HexmeshError> {
    let target = &model.surface;
    let has_volume = target.volume() > LEAST_VOLUME * target.diagonal().powi(3);
    if !has_volume {
        return Err(HexmeshError::NoVolume);
    }
    let handles = match &model.genus {
        Ok(handles) => *handles,
        Err(error) => {
            let (side, error) = ("target", error.clone());
            return Err(PairError::Sphere { side, error }.into());
        }
    };
    let boxes = boxes_per_lattice_cell(options.kind);
    let size = lattice_size(options, target)?;
    let along = longest_side(target) / size;
    let mut polycubes = polycubes(target, handles, size, along as usize)?;
    polycubes.truncate(MOST_SIZES);
    let mut best: Option<Hexmesh> = None;
    let mut failure = None;
    for (tried, (cells, polycube)) in (1..).zip(polycubes) {
        match by_polycube(polycube, cells * boxes, target, options, progress) {
            Ok((polycube, mut report, (fit, remeshed))) => {
                report.tried = tried;
                let made = Hexmesh {
                    polycube: HexmeshPolycube::Voxels(polycube, Box::new(report)),
                    fit,
                    remeshed,
                };
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
    match (best, failure) {
        (Some(best), _) => Ok(best),
        (None, Some(error)) => Err(error),
        (None, None) => Err(VoxelPolycubeError::Thin(size).into()),
    }
}

fn longest_side(surface: &SurfaceMesh) -> f64 {
    surface.bounding_box().map_or(0.0, |(low, high)| (high - low).max())
}

/// The size of the lattice's cells.
fn lattice_size(options: &HexmeshOptions, target: &SurfaceMesh) -> Result<f64, HexmeshError> {
    let size = match lattice_of(options) {
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
    for cells in (1..=coarsest).rev() {
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

type Carried = (crate::fit::Fit, crate::remesh::Remeshed);

/// By one polycube, with this many of the mesh's boxes along the edge of a voxel.
fn by_polycube(
    polycube: VoxelPolycube,
    cells: usize,
    target: &SurfaceMesh,
    options: &HexmeshOptions,
    progress: &dyn Fn(HexmeshPhase) -> ProgressControl,
) -> Result<(VoxelPolycube, VoxelReport, Carried), HexmeshError> {
    let pairing = |phase| progress(HexmeshPhase::Pairing(phase));
    let in_place = PairOptions {
        aligned: true,
        ..PairOptions::default()
    };
    let (boundary, pair) = map_pair(&polycube.surface(DIVISIONS), target, &in_place, &pairing)?;
    let carried = carried(
        &boundary,
        CellSize::Length(polycube.size / cells as f64),
        options,
        progress,
    )?;
    let report = VoxelReport {
        voxels: polycube.voxels.len(),
        size: polycube.size,
        cells,
        missed: polycube.missed,
        tried: 1,
        distortion: pair.after,
    };
    Ok((polycube, report, carried))
}

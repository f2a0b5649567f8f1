//! Regular meshes of a solid from a polycube, carried by a map, with no cell inverted: section 5.3 of the paper, and what
//! it leaves to do.
//!
//! Boundary nodes go where the boundary map sends them, inner ones where the volume map does. That inverts some cells:
//! harmonic maps of solids need not be one-to-one, and cells are straight. Inner nodes are then moved until none is
//! ([`Garanzha et al. 2021`](https://doi.org/10.1145/3450626.3459847)), and what is left is counted again from positions.

mod descent;
mod foldover;
mod grid;
mod planes;
mod quality;
mod repair;

use std::time::Instant;

use crate::Point;
use crate::boundary_map::BoundaryMap;
use crate::geometry::{QueryError, SurfaceQuery};
use crate::map::VolumeMap;
use crate::mesh::{SurfaceMesh, SurfacePoint};
use crate::statistics::quantiles;

pub use grid::{CellKind, CellList, RegularMesh, cell_count, regular_mesh};
pub use planes::{Polycube, PolycubeError};
pub use quality::{BadCells, CellQuality, bad_cells, quality, scaled_jacobians};
pub use repair::RepairReport;

/// How large the boxes of the grid are.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum CellSize {
    /// So many along the longest side of the domain.
    Along(usize),
    /// This length, in the units of the domain.
    Length(f64),
}

/// What can be chosen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RemeshOptions {
    /// What cells.
    pub kind: CellKind,
    /// How large; numbers of boxes between planes are rounded up to even ones.
    pub size: CellSize,
    /// Whether inner nodes are moved until no cell is inverted.
    pub repair: bool,
    /// Iterations of the polish of shapes after the repair.
    pub polish: usize,
    /// Cells at most; more are refused before any is made.
    pub most_cells: usize,
}

impl Default for RemeshOptions {
    fn default() -> Self {
        Self {
            kind: CellKind::Tets,
            size: CellSize::Along(32),
            repair: true,
            polish: 200,
            most_cells: 20_000_000,
        }
    }
}

/// How far a remeshing is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RemeshPhase {
    /// The grid is made.
    Meshing,
    /// Nodes are carried by the maps.
    Mapping {
        /// How many.
        nodes: usize,
    },
    /// Inverted cells are turned back.
    Repairing {
        /// Rounds so far.
        round: usize,
        /// Inverted tetrahedra, or corners of hexahedra.
        inverted: usize,
    },
    /// Everything is counted and measured again.
    Verifying,
}

/// Why there is no mesh.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum RemeshError {
    /// The domain is no polycube.
    #[error("the domain is no polycube: {0}")]
    Polycube(#[from] PolycubeError),
    /// The size of cells is no size.
    #[error("a cell size of {0} makes no mesh")]
    Size(f64),
    /// More cells than allowed.
    #[error(
        "cells of this size would be {cells:.0}, more than the limit of {limit}; choose larger ones, or raise the limit"
    )]
    TooMany {
        /// How many there would be.
        cells: f64,
        /// How many there may be.
        limit: usize,
    },
    /// A surface cannot be queried.
    #[error(transparent)]
    Query(#[from] QueryError),
}

/// Distances between surfaces, as fractions of the target's diagonal.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Distances {
    /// Largest.
    pub max: f64,
    /// Mean over the points.
    pub mean: f64,
}

/// Wall-clock seconds.
#[derive(Debug, Clone, Copy, PartialEq, Default, serde::Serialize)]
pub struct RemeshSeconds {
    /// The grid.
    pub mesh: f64,
    /// Carrying the nodes.
    pub map: f64,
    /// Repair and polish.
    pub repair: f64,
    /// Counting and measuring.
    pub verify: f64,
    /// All of it.
    pub total: f64,
}

/// What is known of the result.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct RemeshReport {
    /// What cells.
    pub kind: CellKind,
    /// How many.
    pub cells: usize,
    /// Nodes.
    pub nodes: usize,
    /// Of them on the boundary, which the repair does not move.
    pub boundary_nodes: usize,
    /// Length of the boxes' sides asked for, in the domain.
    pub cell_size: f64,
    /// Cells with all nodes on the boundary that it inverts: no repair with this boundary can help them.
    pub blocked: usize,
    /// Bad cells as the maps leave them.
    pub before: BadCells,
    /// Bad cells of the result.
    pub after: BadCells,
    /// Quality of the grid in the domain.
    pub domain_quality: Option<CellQuality>,
    /// Quality of the result.
    pub quality: Option<CellQuality>,
    /// Determinants of the map of the cells' tetrahedra (or corners), over their mean: 0, 1, 10, 50, 90, 99, 100 %.
    pub determinants: Option<[f64; 7]>,
    /// From vertices of the target to the boundary of the result.
    pub target_to_mesh: Distances,
    /// From nodes and centres of boundary triangles of the result to the target.
    pub mesh_to_target: Distances,
    /// Volume of the result.
    pub volume: f64,
    /// Volume of the target.
    pub target_volume: f64,
    /// What the repair did.
    pub repair: RepairReport,
    /// Largest shift of an inner node by the repair, over the target's diagonal.
    pub largest_shift: f64,
    /// Time.
    pub seconds: RemeshSeconds,
}

/// A mesh of the domain, and the same mesh of the target.
#[derive(Debug, Clone, PartialEq)]
pub struct Remeshed {
    /// The mesh in the domain.
    pub mesh: RegularMesh,
    /// Its nodes in the target.
    pub images: Vec<Point>,
    /// What is known of it.
    pub report: RemeshReport,
}

/// A regular mesh of the polycube that `boundary` starts from, carried into its target.
///
/// Takes, without the map's own sums, some 2 s per 100 000 cells on two cores, most of it for the polish.
///
/// # Errors
///
/// When the domain is no polycube, or there would be too many cells. Cells that stay inverted are no error: they are in
/// the report.
pub fn remesh(
    boundary: &BoundaryMap,
    map: &dyn VolumeMap,
    options: &RemeshOptions,
    progress: &dyn Fn(RemeshPhase),
) -> Result<Remeshed, RemeshError> {
    let start = Instant::now();
    progress(RemeshPhase::Meshing);
    let polycube = Polycube::of(boundary.domain())?;
    let size = size_of(&polycube, options.size)?;
    let cells = cell_count(&polycube, size, options.kind);
    if cells > options.most_cells as f64 {
        return Err(RemeshError::TooMany {
            cells,
            limit: options.most_cells,
        });
    }
    let mesh = regular_mesh(&polycube, size, options.kind);
    let meshed = start.elapsed().as_secs_f64();

    progress(RemeshPhase::Mapping {
        nodes: mesh.nodes.len(),
    });
    let carried = carry(&mesh, boundary, map)?;
    let mapped = start.elapsed().as_secs_f64();

    let (mut images, mut repair) = (carried.clone(), RepairReport::default());
    let samples = samples(&mesh, &carried);
    if options.repair {
        let free: Vec<u32> = (0..mesh.nodes.len() as u32)
            .filter(|&v| !mesh.on_boundary[v as usize])
            .collect();
        let step = 0.1 * (boundary.target_volume().abs() / mesh.cells.len() as f64).cbrt();
        let told = |round, inverted| progress(RemeshPhase::Repairing { round, inverted });
        repair = repair::repair(&samples, &mut images, &free, step, options.polish, &told);
    }
    let repaired = start.elapsed().as_secs_f64();

    progress(RemeshPhase::Verifying);
    let before = bad_cells(&mesh.cells, &carried);
    let mut after = bad_cells(&mesh.cells, &images);
    // What is counted decides, not what the repair believes of itself.
    if after.cells.len() > before.cells.len() {
        (images, after) = (carried.clone(), before.clone());
    }
    let diagonal = boundary.target_diagonal();
    let shifts = images.iter().zip(&carried).map(|(a, b)| (a - b).norm());
    let [target_to_mesh, mesh_to_target] = distances(&mesh, &images, boundary)?;
    let determinants = samples.determinants(&images);
    let mut report = RemeshReport {
        kind: options.kind,
        cells: mesh.cells.len(),
        nodes: mesh.nodes.len(),
        boundary_nodes: mesh.on_boundary.iter().filter(|is| **is).count(),
        cell_size: size,
        blocked: blocked(&mesh, &after),
        before,
        after,
        domain_quality: quality(&mesh.cells, &mesh.nodes),
        quality: quality(&mesh.cells, &images),
        determinants: quantiles(&determinants, [0.0, 0.01, 0.1, 0.5, 0.9, 0.99, 1.0]),
        target_to_mesh,
        mesh_to_target,
        volume: boundary_of(&mesh, &images).volume(),
        target_volume: boundary.target_volume(),
        repair,
        largest_shift: shifts.fold(0.0, f64::max) / diagonal,
        seconds: RemeshSeconds::default(),
    };
    let total = start.elapsed().as_secs_f64();
    report.seconds = RemeshSeconds {
        mesh: meshed,
        map: mapped - meshed,
        repair: repaired - mapped,
        verify: total - repaired,
        total,
    };
    Ok(Remeshed { mesh, images, report })
}

fn size_of(polycube: &Polycube, size: CellSize) -> Result<f64, RemeshError> {
    let longest = polycube
        .planes()
        .iter()
        .filter_map(|p| Some(p.last()? - p.first()?))
        .fold(0.0, f64::max);
    let length = match size {
        CellSize::Along(count) => longest / count as f64,
        CellSize::Length(length) => length,
    };
    if length > 0.0 && length.is_finite() {
        Ok(length)
    } else {
        Err(RemeshError::Size(length))
    }
}

/// Nodes where the maps send them: those on the boundary by the boundary map.
fn carry(mesh: &RegularMesh, boundary: &BoundaryMap, map: &dyn VolumeMap) -> Result<Vec<Point>, RemeshError> {
    let select = |on: bool| -> Vec<Point> {
        let nodes = mesh.nodes.iter().zip(&mesh.on_boundary);
        nodes.filter(|(_, is)| **is == on).map(|(p, _)| *p).collect()
    };
    let query = SurfaceQuery::with_winding_sign(boundary.domain())?;
    let places: Vec<SurfacePoint> = query
        .closest_points(&select(true))
        .iter()
        .map(|found| SurfacePoint {
            triangle: found.triangle as u32,
            barycentric: found.barycentric,
        })
        .collect();
    let (mut outer, mut inner) = (
        boundary.evaluate(&places).into_iter(),
        map.evaluate(&select(false)).into_iter(),
    );
    Ok(mesh
        .on_boundary
        .iter()
        .map(|&on| if on { outer.next() } else { inner.next() })
        .map(|p| p.unwrap_or(Point::from(crate::Vector::repeat(f64::NAN))))
        .collect())
}

/// Tetrahedra against the domain's, corners of hexahedra against those of cubes.
fn samples(mesh: &RegularMesh, images: &[Point]) -> foldover::Samples {
    let volume = boundary_of(mesh, images).volume();
    match &mesh.cells {
        CellList::Tets(tets) => foldover::Samples::of_tets(tets, &mesh.nodes, volume),
        CellList::Hexes(hexes) => foldover::Samples::of_hexes(hexes, mesh.nodes.len(), volume),
    }
}

/// The boundary of the mesh with its nodes at these places; inner nodes stay without triangles.
fn boundary_of(mesh: &RegularMesh, positions: &[Point]) -> SurfaceMesh {
    SurfaceMesh::new(positions.to_vec(), mesh.boundary.clone()).expect("boundary triangles name nodes")
}

/// Bad cells whose bad tetrahedra have all their nodes on the boundary.
fn blocked(mesh: &RegularMesh, bad: &BadCells) -> usize {
    let all_fixed = |corners: &[u32]| corners.iter().all(|&v| mesh.on_boundary[v as usize]);
    let is_blocked = |&&cell: &&u32| match &mesh.cells {
        CellList::Tets(tets) => all_fixed(&tets[cell as usize]),
        CellList::Hexes(hexes) => all_fixed(&hexes[cell as usize]),
    };
    bad.cells.iter().filter(is_blocked).count()
}

fn distances(mesh: &RegularMesh, images: &[Point], boundary: &BoundaryMap) -> Result<[Distances; 2], RemeshError> {
    let plain;
    let target = match boundary.target_surface() {
        Some(target) => target,
        None => {
            plain = boundary.target();
            &plain
        }
    };
    let surface = boundary_of(mesh, images);
    let centres = surface.triangles().iter().map(|t| {
        let sum: crate::Vector = t.iter().map(|&v| images[v as usize].coords).sum();
        Point::from(sum / 3.0)
    });
    let nodes = images
        .iter()
        .zip(&mesh.on_boundary)
        .filter(|(_, on)| **on)
        .map(|(p, _)| *p);
    let probes: Vec<Point> = nodes.chain(centres).collect();
    let diagonal = boundary.target_diagonal();
    let of = |surface: &SurfaceMesh, points: &[Point]| -> Result<Distances, RemeshError> {
        let found = SurfaceQuery::with_winding_sign(surface)?.closest_points(points);
        let (mut max, mut sum) = (0.0f64, 0.0);
        for place in &found {
            // A NaN must stay one.
            max = if max.is_nan() || max > place.distance {
                max
            } else {
                place.distance
            };
            sum += place.distance;
        }
        Ok(Distances {
            max: max / diagonal,
            mean: sum / found.len() as f64 / diagonal,
        })
    };
    Ok([of(&surface, target.vertices())?, of(target, &probes)?])
}

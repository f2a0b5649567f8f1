//! Meshes of the target: a regular mesh of a polycube domain, or a given mesh of the domain, is mapped to the target
//! and repaired until no cell is inverted. Section 5.3 of the paper, which leaves the repair open.
//!
//! The boundary map maps the boundary nodes, the volume map the inner ones. That inverts some cells: harmonic maps of
//! solids need not be one to one, and cells have straight edges. Inner nodes are then moved until no cell is inverted
//! ([`Garanzha et al. 2021`](https://doi.org/10.1145/3450626.3459847)); tetrahedra are split where nodes are stuck. The
//! result is checked from its node positions alone.

mod attempts;
mod boundary_split;
mod bounded_mesh;
mod cells_at_nodes;
mod crossings;
pub(crate) mod foldover;
mod given;
mod grid;
mod hex_corners;
mod hex_polish;
mod inversion_causes;
mod jacobian_lanes;
pub(crate) mod lbfgs;
mod other_boundary;
mod own_size;
mod padding;
mod patches;
mod planes;
mod polish;
mod quality;
mod relax;
mod repair;
mod rings;
mod self_intersections;
mod shared_coordinates;
mod sheets;
mod slide;
mod split;
mod start;
mod surface_distance;
mod tet_lanes;
mod worst_places;

use std::ops::ControlFlow;
use std::time::Instant;

use crate::Point;
use crate::boundary_map::BoundaryMap;
use crate::geometry::{QueryError, SurfaceQuery};
use crate::map::VolumeMap;
use crate::memory::readable;
use crate::mesh::{CellList, CellMesh, SurfaceMesh, SurfacePoint};
use crate::progress::{ProgressControl, ProgressResponse};
use crate::statistics::quantiles;

use attempts::{AsMapped, Attempt, Carrier};
pub use boundary_split::BoundarySplitReport;
pub(crate) use boundary_split::halve_boundary_edges;
pub(crate) use bounded_mesh::faces;
pub use bounded_mesh::{BoundedMesh, CellSetBoundary};
pub(crate) use cells_at_nodes::CellsAtNodes;
pub(crate) use crossings::crossing_triangles;
pub use given::{GivenMesh, GivenMeshError, given_mesh};
pub use grid::{CellKind, CellSize, cell_count, grid_points, regular_mesh};
use grid::{HexGrid, box_count};
pub use inversion_causes::{InversionCause, InversionCauses, inversion_causes};
pub use other_boundary::OtherBoundary;
pub use padding::PaddingReport;
use padding::padded_where_needed;
pub(crate) use patches::local_volumes;
pub use planes::{Polycube, PolycubeError};
pub use polish::{PolishOutcome, PolishReport};
pub use quality::{CellQuality, InvalidCells, determinants, invalid_cells, quality, scaled_jacobians};
pub(crate) use quality::{is_right_handed, tet_scaled_jacobians};
pub use relax::RelaxReport;
pub(crate) use repair::next_epsilon;
pub use repair::{RepairReport, RepairStart, SplitReport};
pub use self_intersections::BoundaryIntersections;
pub(crate) use shared_coordinates::SharedCoordinates;
pub use slide::SlideReport;
pub(crate) use split::{halve_edges, split_between_boundary_nodes, split_edges};
pub use surface_distance::SurfaceDistances;
use surface_distance::distances_both_ways;

/// Where the mesh of the domain comes from.
#[derive(Debug, Clone, PartialEq)]
pub enum RemeshSource {
    /// A regular mesh of the domain, which has to be a polycube.
    Regular {
        /// Kind of the cells.
        kind: CellKind,
        /// Size of the boxes; the number of boxes between two planes is rounded up, for tetrahedra to an even one.
        size: CellSize,
        /// Largest number of cells; more are refused before any is made.
        most_cells: usize,
    },
    /// A mesh of the domain.
    Given(CellMesh),
}

/// Options of [`remesh`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RemeshOptions {
    /// Whether inner nodes are moved until no cell is inverted.
    pub repair: bool,
    /// Whether boundary nodes may slide along the target: where inner nodes alone cannot help, and in the polish of
    /// hexahedra; and whether the boundary of a regular mesh is split (tetrahedra) or relaxed where it passes through
    /// itself.
    pub slide: bool,
    /// Whether a regular mesh stays on the given boundary map. Otherwise, where it cannot be repaired under that and `slide` allows, a
    /// boundary map of less distortion is sought ([`map_pair`](crate::boundary_map::pair::map_pair)), and taken if the mesh is
    /// better under it ([`RemeshReport::other_boundary`]).
    pub keep_boundary_map: bool,
    /// Largest number of tetrahedra that splitting may add where moving nodes does not suffice; 0 for no splitting. `None`
    /// for a third of those that the mesh has, and 5000. Half of it may be used up at the boundary of
    /// a regular mesh, where much splitting comes before moving nodes only if a number is given.
    pub most_added: Option<usize>,
    /// Work after which a repair ends although cells stay inverted: iterations of descent for each cell of the mesh, in
    /// the mean. Meshes of fewer than 100 000 cells get as much as one of so many.
    pub effort: f64,
    /// Largest number of iterations of the polish, which improves the shapes of cells after the repair; 0 for none. It
    /// never lowers the least scaled Jacobian nor its 1 % quantile: it ends where it would, or is undone. The boundary of
    /// hexahedra, which slides if `slide` allows, gets no more than 10 % farther from the target's vertices in the mean, and
    /// 50 % at most.
    pub polish: usize,
    /// Whether a mesh is polished, too, in which nothing is inverted as mapped.
    pub polish_valid: bool,
    /// Bytes that the whole run may take, by [`memory_estimate`]; a mesh that needs more is refused before it is made
    /// or examined. No limit when `None`.
    pub memory: Option<u64>,
}

/// Volume of a target over the cube of its diagonal below which its sign may be a rounding error.
const LEAST_VOLUME: f64 = 1e-12;

/// The default of [`RemeshOptions::effort`].
pub const DEFAULT_EFFORT: f64 = 2000.0;

impl Default for RemeshOptions {
    fn default() -> Self {
        Self {
            repair: true,
            slide: true,
            keep_boundary_map: false,
            most_added: None,
            effort: DEFAULT_EFFORT,
            polish: 200,
            polish_valid: false,
            memory: None,
        }
    }
}

/// The current step of [`remesh`], for progress callbacks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RemeshPhase {
    /// The grid is made, or a given mesh examined.
    Meshing,
    /// Nodes are mapped.
    Mapping {
        /// How many.
        nodes: usize,
    },
    /// A boundary map of less distortion is sought: under the given one, a regular grid cannot be repaired.
    MappingBoundary,
    /// Inverted cells are repaired.
    Repairing {
        /// Rounds so far.
        round: usize,
        /// Inverted cells.
        inverted: usize,
    },
    /// Inverted cells are counted, and the result is measured.
    Verifying,
}

/// Why [`remesh`] failed.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum RemeshError {
    /// The domain is not a polycube.
    #[error("the domain is not a polycube: {0}")]
    Polycube(#[from] PolycubeError),
    /// A given mesh cannot be used.
    #[error("the given mesh cannot be used: {0}")]
    Given(#[from] GivenMeshError),
    /// The cell size is not positive and finite.
    #[error("a cell size of {0} is not possible; give a positive, finite one")]
    Size(f64),
    /// More cells than allowed.
    #[error("cells of this size would make {count:.0} {what}, more than the limit of {limit:.0}; choose larger ones")]
    TooMany {
        /// Cells or grid points.
        what: &'static str,
        /// How many there would be.
        count: f64,
        /// How many there may be.
        limit: f64,
    },
    /// More memory than allowed.
    #[error(
        "{cells} cells need about {} of memory, and {} are allowed; choose larger cells, or allow more",
        readable(*need), readable(*allowed)
    )]
    TooLarge {
        /// Cells of the mesh.
        cells: usize,
        /// Bytes that they need, by the estimate.
        need: u64,
        /// Bytes that are allowed.
        allowed: u64,
    },
    /// The boundary map turns the solid inside out.
    #[error(
        "the map mirrors the solid: the image of its boundary is inside out, and so would every cell be; reflect one of the \
         two models, for example by changing the sign of all x in the image, or correct the boundary map"
    )]
    Mirrored,
    /// A surface cannot be queried.
    #[error(transparent)]
    Query(#[from] QueryError),
    /// The progress callback cancelled the run.
    #[error("cancelled by the progress callback")]
    Cancelled,
}

/// Wall-clock seconds.
#[derive(Debug, Clone, Copy, PartialEq, Default, serde::Serialize)]
pub struct RemeshTimings {
    /// The grid, or the examination of a given mesh.
    pub mesh: f64,
    /// Mapping the nodes.
    pub map: f64,
    /// Repair and polish.
    pub repair: f64,
    /// Counting and measuring.
    pub verify: f64,
    /// All of it.
    pub total: f64,
}

/// What was done, and measurements of the result.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct RemeshReport {
    /// Kind of the cells.
    pub kind: CellKind,
    /// How many, with those that splitting added ([`SplitReport`]).
    pub cells: usize,
    /// Nodes, also with those that splitting added.
    pub nodes: usize,
    /// Nodes on the boundary.
    pub boundary_nodes: usize,
    /// Requested edge length of the boxes, in the units of the domain; `None` for a given mesh.
    pub cell_size: Option<f64>,
    /// Largest distance of a given mesh's boundary nodes from the domain's surface, over its diagonal.
    pub off_surface: f64,
    /// Where regular hexahedra have a padding layer; `None` for other meshes.
    pub padding: Option<PaddingReport>,
    /// How far the boundary map that was taken is from the given one: under that, a regular grid could not be repaired. What is said
    /// of the mesh as mapped, and of boundary nodes that slid, is from the one that was taken.
    pub other_boundary: Option<OtherBoundary>,
    /// Causes of inversion as long as the boundary stays as it is mapped and no cell is split.
    pub causes_before: InversionCauses,
    /// Invalid cells after mapping, before the repair, by the indices that cells had then.
    pub before: InvalidCells,
    /// Invalid cells of the result.
    pub after: InvalidCells,
    /// Causes of inversion with the boundary of the result.
    pub causes_after: InversionCauses,
    /// Quality of the mesh in the domain.
    pub domain_quality: Option<CellQuality>,
    /// Cells that are flat or inverted in the domain: hexahedra of the padding where faces of a polycube look both ways along
    /// an axis, so that no layer below all of them has a volume. In the target they have one.
    pub invalid_in_domain: usize,
    /// Quality as mapped, before the repair.
    pub quality_as_mapped: Option<CellQuality>,
    /// Quality of the result.
    pub quality: Option<CellQuality>,
    /// Quantiles of the [`determinants`] of the cells' maps at 0, 1, 10, 50, 90, 99 and 100 %, of those that are defined.
    pub determinants: Option<[f64; 7]>,
    /// From the target's surface to the boundary of the result.
    pub target_to_mesh: SurfaceDistances,
    /// From the boundary of the result, quads as two triangles, to the target's surface.
    pub mesh_to_target: SurfaceDistances,
    /// Volume of the result.
    pub volume: f64,
    /// Volume of the target.
    pub target_volume: f64,
    /// Bytes that the whole run takes at its peak, by [`memory_estimate`].
    pub memory_estimate: u64,
    /// What the repair did.
    pub repair: RepairReport,
    /// Largest displacement of an inner node by the repair, over the target's diagonal.
    pub largest_shift: f64,
    /// Boundary nodes that slid along the target.
    pub slid_nodes: usize,
    /// Largest displacement of a boundary node, over the target's diagonal.
    pub largest_slide: f64,
    /// The same, over the mean edge of the boundary's triangles as mapped.
    pub largest_slide_in_cells: f64,
    /// Time.
    pub seconds: RemeshTimings,
}

impl RemeshReport {
    /// Largest distance between target and mesh, either way, over the target's diagonal.
    pub fn farthest(&self) -> f64 {
        let [there, back] = [self.target_to_mesh.max, self.mesh_to_target.max];
        // NaN is farther than anything.
        if there >= back || there.is_nan() { there } else { back }
    }
}

/// A mesh of the domain, and the same mesh of the target.
#[derive(Debug, Clone, PartialEq)]
pub struct Remeshed {
    /// The mesh in the domain.
    pub mesh: BoundedMesh,
    /// Images of its nodes under the maps.
    pub carried: Vec<Point>,
    /// Node positions in the target: `carried`, changed by the repair.
    pub images: Vec<Point>,
    /// What was done, and measurements of the result.
    pub report: RemeshReport,
    /// The boundary before its edges were split, if they were.
    unsplit_boundary: Option<Vec<[u32; 3]>>,
}

/// Maps a mesh of the domain of `boundary` to its target, and repairs inverted cells.
///
/// Apart from the evaluation of the map, it takes some 4 s per 100 000 tetrahedra and 30 s per 100 000 hexahedra, five times as long where cells stay poor, on two
/// cores, more if boundary nodes have to slide; most of it for the polish. Another boundary map
/// ([`RemeshOptions::keep_boundary_map`]) takes the time of [`map_pair`](crate::boundary_map::pair::map_pair), and that of a second repair.
///
/// # Errors
///
/// When the domain is not a polycube, there would be too many cells, a given mesh is not one of the domain, or the map
/// mirrors it;
/// [`RemeshError::Cancelled`] when `progress` cancels it ([`ProgressResponse`]). Cells that stay inverted are not an
/// error; the report lists them.
pub fn remesh<A: ProgressResponse>(
    boundary: &BoundaryMap,
    map: &dyn VolumeMap,
    source: RemeshSource,
    options: &RemeshOptions,
    progress: &dyn Fn(RemeshPhase) -> A,
) -> Result<Remeshed, RemeshError> {
    let start = Instant::now();
    let report = |phase| match progress(phase).control_flow() {
        ControlFlow::Continue(()) => Ok(()),
        ControlFlow::Break(()) => Err(RemeshError::Cancelled),
    };
    report(RemeshPhase::Meshing)?;
    let regular = matches!(source, RemeshSource::Regular { .. }).then(|| source.clone());
    let mut prepared = prepare(source, Padding::WhereNeeded, boundary, options)?;
    let meshed = start.elapsed().as_secs_f64();

    report(RemeshPhase::Mapping {
        nodes: prepared.mesh.nodes.len(),
    })?;
    let carried = mapped_nodes(&prepared.mesh, boundary, map)?;
    let mapped = start.elapsed().as_secs_f64();

    let target = boundary.target_surface().cloned().unwrap_or_else(|| boundary.target());
    let progress = |phase| progress(phase).control();
    let repaired =
        |prepared: &PreparedMesh, carried| repaired(prepared, carried, boundary, map, &target, options, &progress);
    let mut attempt = repaired(&prepared, carried)?;
    // With padding everywhere there are more nodes that the repair can move.
    if let Some(source) = regular
        && options.repair
        && prepared.padding.is_some_and(|padding| !padding.is_everywhere())
        && attempt.faults() != [0, 0]
    {
        match prepare(source, Padding::Everywhere, boundary, options) {
            // These may be more cells than allowed.
            Err(RemeshError::TooMany { .. } | RemeshError::TooLarge { .. }) => {}
            Err(error) => return Err(error),
            Ok(everywhere) => {
                let carried = mapped_nodes(&everywhere.mesh, boundary, map)?;
                let other = repaired(&everywhere, carried)?;
                if other.faults() < attempt.faults() {
                    (prepared, attempt) = (everywhere, other);
                }
            }
        }
    }
    let repaired = start.elapsed().as_secs_f64();

    report(RemeshPhase::Verifying)?;
    let mut remeshed = verified(&prepared, attempt, boundary, &target)?;
    let total = start.elapsed().as_secs_f64();
    remeshed.report.seconds = RemeshTimings {
        mesh: meshed,
        map: mapped - meshed,
        repair: repaired - mapped,
        verify: total - repaired,
        total,
    };
    if remeshed.report.repair.boundary_split.edges > 0 {
        remeshed.unsplit_boundary = Some(prepared.mesh.boundary);
    }
    Ok(remeshed)
}

/// The mesh with its nodes where the maps send them, repaired if that is asked for.
fn repaired(
    prepared: &PreparedMesh,
    carried: Vec<Point>,
    boundary: &BoundaryMap,
    map: &dyn VolumeMap,
    target: &SurfaceMesh,
    options: &RemeshOptions,
    progress: &dyn Fn(RemeshPhase) -> ProgressControl,
) -> Result<Attempt, RemeshError> {
    let as_mapped = AsMapped::of(&prepared.mesh, &carried);
    if !options.repair {
        return Ok(Attempt::unrepaired(prepared.mesh.clone(), carried, as_mapped));
    }
    let most_are_inverted = 2 * as_mapped.invalid.cells.len() > prepared.mesh.cells.len();
    if most_are_inverted && boundary.target_volume() < -LEAST_VOLUME * boundary.target_diagonal().powi(3) {
        return Err(RemeshError::Mirrored);
    }
    Carrier {
        mesh: &prepared.mesh,
        is_regular: prepared.cell_size.is_some(),
        boundary,
        map,
        target,
        options,
        progress,
    }
    .repaired(carried, as_mapped)
}

/// A mesh of the domain, ready to be mapped.
struct PreparedMesh {
    mesh: BoundedMesh,
    cell_size: Option<f64>,
    off_surface: f64,
    /// Where the padding layer is; `None` unless these are regular hexahedra.
    padding: Option<PaddingReport>,
    /// Bytes that the whole run takes.
    memory: u64,
}

/// Where regular hexahedra are padded.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Padding {
    WhereNeeded,
    Everywhere,
}

fn prepare(
    source: RemeshSource,
    padding: Padding,
    boundary: &BoundaryMap,
    options: &RemeshOptions,
) -> Result<PreparedMesh, RemeshError> {
    let domain = boundary.domain();
    Ok(match source {
        RemeshSource::Regular { kind, size, most_cells } => {
            let polycube = Polycube::of(domain)?;
            let size = size.of(&polycube);
            let allows = |count: usize| match count > most_cells {
                true => Err(RemeshError::TooMany {
                    what: "cells",
                    count: count as f64,
                    limit: most_cells as f64,
                }),
                false => Ok(()),
            };
            let is_partly_padded = (kind, padding) == (CellKind::Hexes, Padding::WhereNeeded);
            // How many cells the padding adds is known when it is made.
            let most_in_all = if is_partly_padded { usize::MAX } else { most_cells };
            let cells = cell_count(&polycube, size, kind, most_in_all)?;
            allows(box_count(&polycube, size, kind) as usize)?;
            let memory = require_room(kind, cells, grid_points(&polycube, size), domain, options)?;
            let (mesh, padding) = match is_partly_padded {
                true => {
                    let (mesh, report) = hexes_padded_where_needed(&polycube, size, boundary)?;
                    allows(mesh.cells.len())?;
                    (mesh, Some(report))
                }
                false => {
                    let mesh = regular_mesh(&polycube, size, kind, most_cells)?;
                    let report = mesh.quads().map(|quads| PaddingReport::everywhere(quads.len()));
                    (mesh, report)
                }
            };
            PreparedMesh {
                memory,
                mesh,
                padding,
                cell_size: Some(size),
                off_surface: 0.0,
            }
        }
        RemeshSource::Given(mesh) => {
            require_room(kind_of(mesh.cells()), mesh.cells().len(), 0, domain, options)?;
            let given = given_mesh(mesh, domain)?;
            PreparedMesh {
                memory: memory_estimate(kind_of(&given.mesh.cells), given.mesh.cells.len(), 0, domain),
                mesh: given.mesh,
                cell_size: None,
                padding: None,
                off_surface: given.off_surface,
            }
        }
    })
}

/// The hexahedra of a grid, with a padding layer below those of its faces where the boundary map calls for one.
fn hexes_padded_where_needed(
    polycube: &Polycube,
    size: f64,
    boundary: &BoundaryMap,
) -> Result<(BoundedMesh, PaddingReport), RemeshError> {
    let grid = HexGrid::of(polycube, size);
    let mut on_boundary: Vec<u32> = grid.quads.iter().flat_map(|quad| quad.nodes).collect();
    on_boundary.sort_unstable();
    on_boundary.dedup();
    let points: Vec<Point> = on_boundary.iter().map(|&v| grid.nodes[v as usize]).collect();
    let query = SurfaceQuery::with_winding_sign(boundary.domain())?;
    let mapped = boundary.evaluate(&surface_points(&query, &points));
    let mut images = vec![Point::from([f64::NAN; 3]); grid.nodes.len()];
    for (&v, image) in on_boundary.iter().zip(mapped) {
        images[v as usize] = image;
    }
    Ok(padded_where_needed(grid, &images))
}

/// The result with all its measurements but the timings.
fn verified(
    prepared: &PreparedMesh,
    attempt: Attempt,
    boundary: &BoundaryMap,
    target: &SurfaceMesh,
) -> Result<Remeshed, RemeshError> {
    let Attempt {
        mesh,
        as_mapped,
        carried,
        mut images,
        mut repair,
        other_boundary,
    } = attempt;
    let AsMapped {
        invalid: before,
        causes: causes_before,
        quality: quality_as_mapped,
    } = as_mapped;
    let mut after = invalid_cells(&mesh.cells, &images);
    // The exact count decides: the repair works with rounded determinants.
    if after.cells.len() > before.cells.len() {
        images = carried.clone();
        after = invalid_cells(&mesh.cells, &images);
        repair.polish = PolishOutcome::CellsInverted.into();
    }
    let causes_after = inversion_causes(&mesh, &images);
    let diagonal = boundary.target_diagonal();
    let shifts = |of_boundary: bool| -> Vec<f64> {
        let nodes = (0..images.len()).filter(|&v| mesh.on_boundary[v] == of_boundary);
        nodes.map(|v| (images[v] - carried[v]).norm()).collect()
    };
    let slides = shifts(true);
    let largest_slide = slides.iter().copied().fold(0.0, f64::max);
    let edge = mean_boundary_edge(&mesh, &carried);
    let largest_shift = shifts(false).into_iter().fold(0.0, f64::max) / diagonal;
    let spacing = 0.5 * mean_boundary_edge(&mesh, &images);
    let [mesh_to_target, target_to_mesh] =
        distances_both_ways(&boundary_of(&mesh, &images), target, spacing, diagonal)?;
    let determinants = determinants(&mesh.cells, &mesh.nodes, &images);
    let report = RemeshReport {
        kind: kind_of(&mesh.cells),
        cells: mesh.cells.len(),
        nodes: mesh.nodes.len(),
        boundary_nodes: mesh.on_boundary.iter().filter(|is| **is).count(),
        cell_size: prepared.cell_size,
        off_surface: prepared.off_surface,
        padding: prepared.padding,
        other_boundary,
        causes_before,
        before,
        after,
        causes_after,
        domain_quality: quality(&mesh.cells, &mesh.nodes),
        invalid_in_domain: invalid_cells(&mesh.cells, &mesh.nodes).cells.len(),
        quality_as_mapped,
        quality: quality(&mesh.cells, &images),
        determinants: quantiles(&determinants, [0.0, 0.01, 0.1, 0.5, 0.9, 0.99, 1.0]),
        target_to_mesh,
        mesh_to_target,
        volume: boundary_of(&mesh, &images).volume(),
        target_volume: boundary.target_volume(),
        memory_estimate: prepared.memory,
        repair,
        largest_shift,
        slid_nodes: slides.iter().filter(|s| **s > 0.0).count(),
        largest_slide: largest_slide / diagonal,
        largest_slide_in_cells: largest_slide / edge,
        seconds: RemeshTimings::default(),
    };
    Ok(Remeshed {
        mesh,
        carried,
        images,
        report,
        unsplit_boundary: None,
    })
}

fn kind_of(cells: &CellList) -> CellKind {
    match cells {
        CellList::Tets(_) => CellKind::Tets,
        CellList::Hexes(_) => CellKind::Hexes,
    }
}

/// Peak memory of a whole run, in bytes, including the program, the map and its surfaces; within 30 % of the peak
/// resident set of runs of the program with 3000 to 1 600 000 tetrahedra and 900 to 51 000 hexahedra (x86-64, Linux).
/// `grid_points` are those of [`grid_points`] for a regular mesh, which count where the domain fills little of its
/// bounding box; 0 for a given one.
pub fn memory_estimate(kind: CellKind, cells: usize, grid_points: usize, domain: &SurfaceMesh) -> u64 {
    let per_cell = match kind {
        CellKind::Tets => PER_TET,
        CellKind::Hexes => PER_HEX,
    };
    let of_domain = PER_VERTEX * domain.vertices().len() as f64;
    (PROGRAM + of_domain + PER_GRID_POINT * grid_points as f64 + per_cell * cells as f64) as u64
}

/// Bytes of the program itself, and of what its threads keep.
const PROGRAM: f64 = 27e6;
/// Bytes for each vertex of the domain: both surfaces, and the map's sources.
const PER_VERTEX: f64 = 1000.0;
/// Bytes for each point of the grid, inside the domain or not: the index of its node, and whether its box is filled.
const PER_GRID_POINT: f64 = 5.0;
/// Bytes for each tetrahedron with its nodes: connectivity, finite elements for the start, references for the repair, vectors
/// of the descent.
const PER_TET: f64 = 450.0;
/// Bytes for each hexahedron; the repair looks at each of its eight corners, and the polish has the mesh, its references and
/// the vectors of its descent a second time.
const PER_HEX: f64 = 1750.0;

/// The memory that a run needs, by the estimate, unless it is more than allowed.
fn require_room(
    kind: CellKind,
    cells: usize,
    grid_points: usize,
    domain: &SurfaceMesh,
    options: &RemeshOptions,
) -> Result<u64, RemeshError> {
    let need = memory_estimate(kind, cells, grid_points, domain);
    match options.memory {
        Some(allowed) if need > allowed => Err(RemeshError::TooLarge { cells, need, allowed }),
        _ => Ok(need),
    }
}

/// Images of the nodes: of those on the boundary by the boundary map, of the others by the volume map.
fn mapped_nodes(mesh: &BoundedMesh, boundary: &BoundaryMap, map: &dyn VolumeMap) -> Result<Vec<Point>, RemeshError> {
    let mut images = boundary_nodes_mapped(mesh, boundary)?;
    map_inner_nodes(mesh, map, &mut images);
    Ok(images)
}

/// Images of the nodes on the boundary; others are not numbers.
fn boundary_nodes_mapped(mesh: &BoundedMesh, boundary: &BoundaryMap) -> Result<Vec<Point>, RemeshError> {
    let query = SurfaceQuery::with_winding_sign(boundary.domain())?;
    let mut images = vec![Point::from([f64::NAN; 3]); mesh.nodes.len()];
    let mapped = boundary.evaluate(&surface_points(&query, &nodes_where(mesh, true)));
    assign(&mut images, mesh, true, mapped);
    Ok(images)
}

/// Sets the images of the inner nodes.
fn map_inner_nodes(mesh: &BoundedMesh, map: &dyn VolumeMap, images: &mut [Point]) {
    assign(images, mesh, false, map.evaluate(&nodes_where(mesh, false)));
}

/// The nodes on the boundary, or the inner ones.
fn nodes_where(mesh: &BoundedMesh, on_boundary: bool) -> Vec<Point> {
    let nodes = mesh.nodes.iter().zip(&mesh.on_boundary);
    nodes.filter(|(_, is)| **is == on_boundary).map(|(p, _)| *p).collect()
}

/// Sets the images of the nodes on the boundary, or of the inner ones.
fn assign(images: &mut [Point], mesh: &BoundedMesh, on_boundary: bool, values: Vec<Point>) {
    let selected = images.iter_mut().zip(&mesh.on_boundary);
    let selected = selected.filter(|(_, is)| **is == on_boundary);
    for ((image, _), value) in selected.zip(values) {
        *image = value;
    }
}

/// The points of a surface that are closest to these.
fn surface_points(surface: &SurfaceQuery, points: &[Point]) -> Vec<SurfacePoint> {
    let found = surface.closest_points(points).into_iter();
    found
        .map(|found| SurfacePoint {
            triangle: found.triangle as u32,
            barycentric: found.barycentric,
        })
        .collect()
}

/// The boundary of the mesh with its nodes at `positions`; inner nodes are vertices without triangles.
fn boundary_of(mesh: &BoundedMesh, positions: &[Point]) -> SurfaceMesh {
    SurfaceMesh::new(positions.to_vec(), mesh.boundary.clone()).expect("boundary triangles name nodes")
}

/// Mean edge length of the boundary: of each triangle the two shortest sides, which leaves out the diagonals of quads.
fn mean_boundary_edge(mesh: &BoundedMesh, images: &[Point]) -> f64 {
    let shortest_two = |t: &[u32; 3]| {
        let p = t.map(|v| images[v as usize]);
        let mut sides = [(p[0] - p[1]).norm(), (p[1] - p[2]).norm(), (p[2] - p[0]).norm()];
        sides.sort_by(f64::total_cmp);
        sides[0] + sides[1]
    };
    mesh.boundary.iter().map(shortest_two).sum::<f64>() / (2 * mesh.boundary.len()) as f64
}

//! Tetrahedra and offset surfaces by CGAL and TetGen, and meshes carried by maps.

use std::ops::ControlFlow;

use super::bridge::ffi;
use super::bridge::ffi::Watcher;
#[cfg(not(feature = "native"))]
use super::error::ErrorKind;
use super::error::{Error, guarded};
use super::maps::{Map, ask};
use super::measures::worst_place;
use super::meshes::{Surface, VolumeMesh, quality_of};
use solidmap::mesh::CellMesh;
use solidmap::remesh::{
    self, CellKind, CellSize, PolishOutcome, RemeshOptions, RemeshPhase, RemeshSource, RepairStart,
};
use solidmap::worst_places::LISTED;

pub struct RemeshResult(pub remesh::Remeshed);

/// The error of a build without CGAL and TetGen.
#[cfg(not(feature = "native"))]
pub fn needs_native(what: &str) -> Error {
    Error::new(
        ErrorKind::Unsupported,
        format!(
            "{what} needs CGAL and TetGen, and this solidmap was built without them; build it with SOLIDMAP_NATIVE=ON"
        ),
    )
}

#[cfg(not(feature = "native"))]
pub fn tetrahedralise(_: &Surface, _: &ffi::TetOptions, _: &Watcher) -> Result<Box<VolumeMesh>, Error> {
    Err(needs_native("tetrahedralisation"))
}

#[cfg(not(feature = "native"))]
pub fn offset_surface(
    _: &Surface,
    _: f64,
    _: &ffi::OffsetOptions,
    _: &Watcher,
    _: &mut ffi::OffsetReport,
) -> Result<Box<Surface>, Error> {
    Err(needs_native("an offset surface"))
}

#[cfg(feature = "native")]
pub fn tetrahedralise(
    surface: &Surface,
    options: &ffi::TetOptions,
    watcher: &Watcher,
) -> Result<Box<VolumeMesh>, Error> {
    use solidmap::cgal_tetgen::{Mesh3Options, TetOptions, cancellable, tetrahedralize, tetrahedralize_mesh3};
    use solidmap::mesh::CellList;
    use std::time::Duration;

    let given = |value: f64| (value != 0.0).then_some(value);
    let memory = (options.memory > 0).then_some(options.memory);
    guarded(|| {
        let progress = || ask(watcher, "meshing", f64::NAN, "");
        let surface = surface.0.clone();
        let mesh = if options.cgal {
            let time_limit = Duration::try_from_secs_f64(options.time_limit)
                .map_err(|error| Error::invalid(format!("time_limit is {}: {error}", options.time_limit)))?;
            let options = Mesh3Options {
                cell_size: given(options.cell_size),
                facet_distance: given(options.facet_distance),
                feature_angle: options.feature_angle,
                time_limit,
                memory,
            };
            cancellable(&progress, move || tetrahedralize_mesh3(&surface, &options))?
        } else {
            let options = TetOptions {
                radius_edge_ratio: given(options.radius_edge_ratio),
                min_dihedral: options.min_dihedral,
                max_volume: given(options.max_volume),
                memory,
            };
            cancellable(&progress, move || tetrahedralize(&surface, &options))?
        };
        let (nodes, tets) = mesh.into_parts();
        let regions = vec![1; tets.len()];
        Ok(Box::new(VolumeMesh(CellMesh::new(
            nodes,
            CellList::Tets(tets),
            regions,
        )?)))
    })
}

#[cfg(feature = "native")]
pub fn offset_surface(
    surface: &Surface,
    distance: f64,
    options: &ffi::OffsetOptions,
    watcher: &Watcher,
    report: &mut ffi::OffsetReport,
) -> Result<Box<Surface>, Error> {
    use solidmap::cgal_tetgen::{self, OffsetOptions, cancellable};
    guarded(|| {
        let options = OffsetOptions {
            alpha: (options.alpha != 0.0).then_some(options.alpha),
            rounds: options.rounds,
            retries: options.retries,
            min_fraction: options.min_fraction,
            genus: None,
            max_triangles: options.max_triangles,
        };
        let surface = surface.0.clone();
        let progress = || ask(watcher, "wrapping", f64::NAN, "");
        let found = cancellable(&progress, move || {
            cgal_tetgen::offset_surface(&surface, distance, &options)
        })?;
        *report = ffi::OffsetReport {
            vertex_error: found.vertex_error,
            centroid_error: found.centroid_error,
            min_distance: found.min_distance,
            genus: found.genus,
            components: found.components,
            alpha: found.alpha,
            raw_wrap: found.raw_wrap,
        };
        Ok(Box::new(Surface(found.mesh)))
    })
}

pub fn remesh_regular(
    map: &Map,
    hexes: bool,
    along: usize,
    length: f64,
    most_cells: usize,
    options: &ffi::RemeshOptions,
    watcher: &Watcher,
) -> Result<Box<RemeshResult>, Error> {
    guarded(|| {
        let source = RemeshSource::Regular {
            kind: cell_kind(hexes),
            size: required_cell_size(along, length)?,
            most_cells,
        };
        carried(map, source, options, watcher)
    })
}

pub fn cell_kind(hexes: bool) -> CellKind {
    if hexes { CellKind::Hexes } else { CellKind::Tets }
}

/// The length of cells if it is given, else their number along the longest side; `None` if both are 0.
pub fn cell_size(along: usize, length: f64) -> Option<CellSize> {
    match (along, length) {
        (0, 0.0) => None,
        (along, 0.0) => Some(CellSize::Along(along)),
        (_, length) => Some(CellSize::Length(length)),
    }
}

/// The same, an error if both are 0.
pub fn required_cell_size(along: usize, length: f64) -> Result<CellSize, Error> {
    cell_size(along, length).ok_or_else(|| {
        Error::invalid("give the number of cells along the longest side (`along`), or their length (`length`)")
    })
}

pub fn remesh_given(
    map: &Map,
    mesh: &VolumeMesh,
    options: &ffi::RemeshOptions,
    watcher: &Watcher,
) -> Result<Box<RemeshResult>, Error> {
    guarded(|| carried(map, RemeshSource::Given(mesh.0.clone()), options, watcher))
}

fn carried(
    map: &Map,
    source: RemeshSource,
    options: &ffi::RemeshOptions,
    watcher: &Watcher,
) -> Result<Box<RemeshResult>, Error> {
    let progress = |phase| on_remesh_phase(watcher, phase);
    let remeshed = remesh::remesh(
        map.boundary_map()?,
        map.map(),
        source,
        &remesh_options(options),
        &progress,
    )?;
    Ok(Box::new(RemeshResult(remeshed)))
}

pub fn remesh_options(options: &ffi::RemeshOptions) -> RemeshOptions {
    RemeshOptions {
        repair: options.repair,
        slide: options.slide,
        keep_boundary_map: options.keep_boundary_map,
        most_added: (options.most_added != usize::MAX).then_some(options.most_added),
        effort: options.effort,
        polish: options.polish,
        polish_valid: options.polish_valid,
        memory: (options.memory > 0).then_some(options.memory),
    }
}

/// The options as C++ knows them.
pub fn remesh_for_cpp(options: &RemeshOptions) -> ffi::RemeshOptions {
    ffi::RemeshOptions {
        repair: options.repair,
        slide: options.slide,
        keep_boundary_map: options.keep_boundary_map,
        polish: options.polish,
        polish_valid: options.polish_valid,
        most_added: options.most_added.unwrap_or(usize::MAX),
        effort: options.effort,
        memory: options.memory.unwrap_or(0),
    }
}

pub fn on_remesh_phase(watcher: &Watcher, phase: RemeshPhase) -> ControlFlow<()> {
    let (step, detail) = match phase {
        RemeshPhase::Meshing => ("meshing", String::new()),
        RemeshPhase::Mapping { nodes } => ("mapping", format!("{nodes} nodes")),
        RemeshPhase::MappingBoundary => ("mapping boundary", String::new()),
        RemeshPhase::Repairing { round, inverted } => {
            ("repairing", format!("round {round}, {inverted} cells inverted"))
        }
        RemeshPhase::Verifying => ("verifying", String::new()),
    };
    ask(watcher, step, f64::NAN, &detail)
}

impl RemeshResult {
    pub fn report(&self) -> Result<ffi::RemeshReport, Error> {
        guarded(|| {
            let (mesh, report) = (&self.0.mesh, &self.0.report);
            Ok(ffi::RemeshReport {
                nodes: report.nodes,
                boundary_nodes: report.boundary_nodes,
                padded_quads: report.padding.map_or(0, |padding| padding.quads),
                boundary_quads: report.padding.map_or(0, |padding| padding.of),
                quality_as_mapped: quality_of(mesh.cells(), &self.0.carried),
                quality: quality_of(mesh.cells(), &self.0.images),
                polish: match report.repair.polish.outcome {
                    PolishOutcome::NotAsked => 0,
                    PolishOutcome::NothingInverted => 1,
                    PolishOutcome::CellsInverted => 2,
                    PolishOutcome::NoGain => 3,
                    PolishOutcome::Kept => 4,
                    PolishOutcome::Undone => 5,
                },
                mesh_to_target_max: report.mesh_to_target.max,
                mesh_to_target_mean: report.mesh_to_target.mean,
                target_to_mesh_max: report.target_to_mesh.max,
                target_to_mesh_mean: report.target_to_mesh.mean,
                volume: report.volume,
                target_volume: report.target_volume,
                other_boundary: report.other_boundary.is_some(),
                other_boundary_mean: report.other_boundary.map_or(0.0, |other| other.mean_shift),
                other_boundary_largest: report.other_boundary.map_or(0.0, |other| other.largest_shift),
                largest_shift: report.largest_shift,
                slid_nodes: report.slid_nodes,
                largest_slide: report.largest_slide,
                cells_added: report.repair.split.cells_added,
                boundary_edges_split: report.repair.boundary_split.edges,
                boundary_cells_added: report.repair.boundary_split.cells_added,
                from_finite_elements: report.repair.start == RepairStart::FiniteElements,
                seconds: report.seconds.total,
                worst_places: self.0.worst_places(LISTED).iter().map(worst_place).collect(),
            })
        })
    }

    pub fn mesh(&self) -> Result<Box<VolumeMesh>, Error> {
        guarded(|| self.cells(&self.0.images))
    }

    pub fn domain_mesh(&self) -> Result<Box<VolumeMesh>, Error> {
        guarded(|| self.cells(self.0.mesh.nodes()))
    }

    fn cells(&self, nodes: &[solidmap::Point]) -> Result<Box<VolumeMesh>, Error> {
        let mesh = &self.0.mesh;
        let (cells, regions) = (mesh.cells().clone(), mesh.regions().to_vec());
        Ok(Box::new(VolumeMesh(CellMesh::new(nodes.to_vec(), cells, regions)?)))
    }
}

//! A mesh of the domain under the given boundary map, repaired; and a regular grid that cannot be repaired under that, under
//! another one.

use std::ops::ControlFlow;

use super::bounded_mesh::BoundedMesh;
use super::crossings::crossing_triangles;
use super::inversion_causes::{InversionCauses, inversion_causes};
use super::other_boundary::{OtherBoundary, less_distorted, nodes_mapped_by};
use super::quality::{CellQuality, InvalidCells, invalid_cells, quality};
use super::repair::{Repair, RepairReport, RepairStart};
use super::slide::{SlidingSurface, stiffness};
use super::{RemeshError, RemeshOptions, RemeshPhase, boundary_of, mean_boundary_edge, surface_points};
use crate::Point;
use crate::boundary_map::BoundaryMap;
use crate::geometry::SurfaceQuery;
use crate::map::VolumeMap;
use crate::mesh::{CellList, SurfaceMesh};
use crate::progress::{ProgressControl, run_cancellable};

/// Share of the boundary's triangles, in pairs that pass through each other as mapped, from which a regular mesh seldom can be repaired
/// under its boundary map: of six grids of 16 to 48 cells from a cube to VOLMAP's bunny, which are above it, the two with 16 cells could.
const MOST_CROSSING: f64 = 0.01;
/// Part of the effort that is made under such a boundary map before another one is sought.
const EFFORT_IF_HOPELESS: f64 = 0.1;

/// Tetrahedra that splitting may add to any mesh, however small.
const ROOM_TO_SPLIT: usize = 5000;
/// Cells whose effort any mesh gets, however small.
const CELLS_IN_ANY: usize = 100_000;

/// A mesh of the domain, and what it is carried by.
pub(super) struct Carrier<'a> {
    pub mesh: &'a BoundedMesh,
    /// Whether it is a regular grid of a polycube.
    pub is_regular: bool,
    pub boundary: &'a BoundaryMap,
    pub map: &'a dyn VolumeMap,
    pub target: &'a SurfaceMesh,
    pub options: &'a RemeshOptions,
    pub progress: &'a dyn Fn(RemeshPhase) -> ProgressControl,
}

/// The mesh under one boundary map.
pub(super) struct Attempt {
    /// With the nodes and cells that splitting added.
    pub mesh: BoundedMesh,
    pub as_mapped: AsMapped,
    /// Images of the nodes under the maps.
    pub carried: Vec<Point>,
    /// The same after the repair.
    pub images: Vec<Point>,
    pub repair: RepairReport,
    /// Set if it is not the given boundary map.
    pub other_boundary: Option<OtherBoundary>,
}

impl Attempt {
    pub fn unrepaired(mesh: BoundedMesh, carried: Vec<Point>, as_mapped: AsMapped) -> Self {
        Self {
            mesh,
            as_mapped,
            images: carried.clone(),
            carried,
            repair: RepairReport::default(),
            other_boundary: None,
        }
    }

    /// Inverted cells and pairs of boundary triangles that pass through each other.
    pub fn faults(&self) -> [usize; 2] {
        [
            invalid_cells(&self.mesh.cells, &self.images).cells.len(),
            crossing_triangles(&self.mesh.boundary, &self.images).len(),
        ]
    }
}

/// A mesh as mapped, before its repair.
#[derive(Clone)]
pub(super) struct AsMapped {
    pub invalid: InvalidCells,
    pub causes: InversionCauses,
    pub quality: Option<CellQuality>,
}

impl AsMapped {
    pub fn of(mesh: &BoundedMesh, carried: &[Point]) -> Self {
        Self {
            invalid: invalid_cells(&mesh.cells, carried),
            causes: inversion_causes(mesh, carried),
            quality: quality(&mesh.cells, carried),
        }
    }
}

impl Carrier<'_> {
    /// The repaired mesh, from the images of its nodes under the given maps. A regular grid that cannot be repaired under the given
    /// boundary map is tried under another one of less distortion.
    pub fn repaired(&self, carried: Vec<Point>, as_mapped: AsMapped) -> Result<Attempt, RemeshError> {
        if !self.is_regular || !self.options.slide || self.options.keep_boundary_map {
            return self.under(self.boundary, carried, as_mapped, self.options);
        }
        let crossings = crossing_triangles(&self.mesh.boundary, &carried).len();
        let seems_hopeless = crossings as f64 > MOST_CROSSING * self.mesh.boundary.len() as f64;
        let with_less_effort = RemeshOptions {
            effort: EFFORT_IF_HOPELESS * self.options.effort,
            ..*self.options
        };
        let options = if seems_hopeless {
            &with_less_effort
        } else {
            self.options
        };
        let first = self.under(self.boundary, carried.clone(), as_mapped.clone(), options)?;
        let faults = first.faults();
        // Boundary triangles cross under any boundary map where those of the target do.
        let crosses_itself = || !crossing_triangles(self.target.triangles(), self.target.vertices()).is_empty();
        if faults == [0, 0] || (faults[0] == 0 && crosses_itself()) {
            return Ok(first);
        }
        let second = self.under_other_boundary(&carried)?;
        match second.filter(|second| second.faults() < faults) {
            Some(second) => Ok(second),
            None if seems_hopeless => self.under(self.boundary, carried, as_mapped, self.options),
            None => Ok(first),
        }
    }

    /// The mesh repaired under a boundary map of little distortion; `None` where none is found.
    fn under_other_boundary(&self, given: &[Point]) -> Result<Option<Attempt>, RemeshError> {
        let proceed = || match (self.progress)(RemeshPhase::MappingBoundary) {
            ProgressControl::Cancel => ControlFlow::Break(()),
            _ => ControlFlow::Continue(()),
        };
        let Some(other) = less_distorted(self.boundary, self.target, &proceed)? else {
            return Ok(None);
        };
        let (carried, by_elements, shift) = nodes_mapped_by(&other, self.mesh, given, self.map)?;
        let as_mapped = AsMapped::of(self.mesh, &carried);
        let mut attempt = self.under(&other, carried, as_mapped, self.options)?;
        attempt.other_boundary = Some(shift);
        if by_elements {
            attempt.repair.start = RepairStart::FiniteElements;
        }
        Ok(Some(attempt))
    }

    /// Repairs the mesh, whose nodes are mapped by a boundary map.
    fn under(
        &self,
        boundary: &BoundaryMap,
        carried: Vec<Point>,
        as_mapped: AsMapped,
        options: &RemeshOptions,
    ) -> Result<Attempt, RemeshError> {
        let Self { target, is_regular, .. } = *self;
        let mut attempt = Attempt::unrepaired(self.mesh.clone(), carried, as_mapped);
        let Attempt { mesh, carried, .. } = &mut attempt;
        let mut sliding_surface = None;
        if options.slide {
            sliding_surface = Some(SlidingSurface {
                target,
                query: SurfaceQuery::with_winding_sign(target)?,
                stiffness: stiffness(mesh.cells.len(), mean_boundary_edge(mesh, carried)),
            });
        }
        let domain = SurfaceQuery::with_winding_sign(boundary.domain())?;
        let boundary_image = |points: &[Point]| boundary.evaluate(&surface_points(&domain, points));
        let splits_boundary = options.slide && is_regular && matches!(mesh.cells, CellList::Tets(_));
        let cells = mesh.cells.len();
        let polish_all = options.polish_valid || is_regular || matches!(mesh.cells, CellList::Hexes(_));
        let on_round = |(round, inverted)| (self.progress)(RemeshPhase::Repairing { round, inverted });
        let repaired = run_cancellable(&on_round, |monitor| {
            Repair {
                volume: boundary_of(mesh, carried).volume(),
                step: 0.1 * (boundary.target_volume().abs() / cells as f64).cbrt(),
                most_added: options.most_added.unwrap_or(cells / 3 + ROOM_TO_SPLIT),
                most_work: (options.effort * cells.max(CELLS_IN_ANY) as f64) as u64,
                mesh,
                carried,
                polish: options.polish,
                polish_valid: options.polish_valid,
                polish_all,
                boundary_image: splits_boundary.then_some(&boundary_image),
                splits_first: options.most_added.is_some(),
                is_regular,
                shaken: None,
                sliding_surface: sliding_surface.as_ref(),
                monitor,
            }
            .run()
        });
        let (images, repair) = repaired.ok_or(RemeshError::Cancelled)?;
        Ok(Attempt {
            images,
            repair,
            ..attempt
        })
    }
}

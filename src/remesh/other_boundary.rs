//! Regular grids under another boundary map: where the given one squeezes limbs of the target into small parts of the domain, chords
//! between the images of a grid's nodes cut across them, whatever the inner nodes do.

use std::ops::ControlFlow;

use super::bounded_mesh::BoundedMesh;
use super::start::by_finite_elements;
use super::{RemeshError, boundary_nodes_mapped, map_inner_nodes};
use crate::Point;
use crate::boundary_map::BoundaryMap;
use crate::boundary_map::pair::{PairError, PairOptions, PairPhase, map_pair};
use crate::map::VolumeMap;
use crate::mesh::SurfaceMesh;

/// How far the boundary map that was taken is from the one that was given, at the boundary nodes as mapped.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct OtherBoundary {
    /// Largest distance of the images of a node, over the target's diagonal.
    pub largest_shift: f64,
    /// The mean of these distances.
    pub mean_shift: f64,
}

/// A boundary map of little distortion, as [`map_pair`] finds it; `None` where it finds none.
pub(super) fn less_distorted(
    boundary: &BoundaryMap,
    target: &SurfaceMesh,
    proceed: &dyn Fn() -> ControlFlow<()>,
) -> Result<Option<BoundaryMap>, RemeshError> {
    match map_pair(boundary.domain(), target, &PairOptions::default(), &|_: PairPhase| {
        proceed()
    }) {
        Ok((map, _)) => Ok(Some(map)),
        Err(PairError::Cancelled) => Err(RemeshError::Cancelled),
        Err(_) => Ok(None),
    }
}

/// The images of all nodes under a boundary map, continued inside by finite elements on these cells, or else by a volume map of
/// another boundary map; whether it was by finite elements; and how far they are from `given` on the boundary.
pub(super) fn nodes_mapped_by(
    other: &BoundaryMap,
    mesh: &BoundedMesh,
    given: &[Point],
    map: &dyn VolumeMap,
) -> Result<(Vec<Point>, bool, OtherBoundary), RemeshError> {
    let mut carried = boundary_nodes_mapped(mesh, other)?;
    let on_boundary = || (0..mesh.nodes.len()).filter(|&v| mesh.on_boundary[v]);
    let shifts: Vec<f64> = on_boundary().map(|v| (carried[v] - given[v]).norm()).collect();
    let diagonal = other.target_diagonal();
    let shift = OtherBoundary {
        largest_shift: shifts.iter().copied().fold(0.0, f64::max) / diagonal,
        mean_shift: shifts.iter().sum::<f64>() / shifts.len() as f64 / diagonal,
    };
    if let Some(found) = by_finite_elements(mesh, &carried) {
        return Ok((found, true, shift));
    }
    map_inner_nodes(mesh, map, &mut carried);
    Ok((carried, false, shift))
}

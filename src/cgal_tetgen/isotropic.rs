//! Surfaces with triangles of one size.

use super::calls::{Operation, call_on};
use super::error::CgalTetgenError;
use super::input::{check_closed, check_manifold, check_numbers, surface as surface_of};
use crate::mesh::SurfaceMesh;
use crate::mesh::topology::Topology;

/// A closed surface remeshed with edges of about this length, by splits, collapses and flips, with its vertices smoothed and
/// projected back (Botsch & Kobbelt 2004, as CGAL has it): simplified where the length is above that of its edges.
///
/// Edges with a larger angle between the normals beside them than `feature_angle`, in degrees, stay where they are, though they are split and
/// collapsed; other features are rounded, and all are with `None`. Parts that are thinner than an edge may vanish or pass through themselves; neither is checked.
///
/// # Errors
///
/// [`CgalTetgenError::InvalidInput`] for a surface that is open, not manifold or degenerate, or without a usable length, and errors
/// of CGAL.
pub fn remesh_isotropically(
    surface: &SurfaceMesh,
    edge_length: f64,
    feature_angle: Option<f64>,
) -> Result<SurfaceMesh, CgalTetgenError> {
    check_numbers(surface)?;
    let topology = Topology::new(surface);
    check_manifold(&topology)?;
    check_closed(&topology)?;
    surface_of(&call_on(
        Operation::Remesh,
        surface,
        &[edge_length, feature_angle.unwrap_or(0.0)],
    )?)
}

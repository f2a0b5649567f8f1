//! Calls of CGAL and TetGen on plain arrays, in this process or in the worker if there is one. Nothing is checked here.

use super::CgalTetgenError;
use super::bridge::ffi;
use super::error::CallFailure;
use super::worker::{Message, Operation, connection};

pub(super) use ffi::Mesh;

/// Makes TetGen fail harmlessly.
pub(super) fn self_test() -> Result<(), CgalTetgenError> {
    call(Operation::SelfTest, &[], &[], &[]).map(|_| ())
}

/// Tetrahedra by TetGen. Options: largest radius-edge ratio (0 for none), smallest dihedral angle in degrees, largest
/// volume (0 for none).
pub(super) fn tetgen(xyz: &[f64], triangles: &[u32], options: &[f64; 3]) -> Result<Mesh, CgalTetgenError> {
    call(Operation::Tetgen, xyz, triangles, options)
}

/// Tetrahedra by CGAL. Options: the fields of `RefinementSizes`, in their order.
pub(super) fn mesh3(xyz: &[f64], triangles: &[u32], options: &[f64; 8]) -> Result<Mesh, CgalTetgenError> {
    call(Operation::Mesh3, xyz, triangles, options)
}

/// A surface around triangles. Options: alpha, offset.
pub(super) fn wrap(xyz: &[f64], triangles: &[u32], options: &[f64; 2]) -> Result<Mesh, CgalTetgenError> {
    call(Operation::Wrap, xyz, triangles, options)
}

/// An isotropically remeshed surface.
pub(super) fn remesh(xyz: &[f64], triangles: &[u32], edge_length: f64) -> Result<Mesh, CgalTetgenError> {
    call(Operation::Remesh, xyz, triangles, &[edge_length])
}

/// Indices of intersecting triangles, two per pair. Tests at most `max_tested` pairs.
pub(super) fn intersections(xyz: &[f64], triangles: &[u32], max_tested: f64) -> Result<Vec<u32>, CgalTetgenError> {
    Ok(call(Operation::Intersections, xyz, triangles, &[max_tested])?.corners)
}

fn call(operation: Operation, xyz: &[f64], triangles: &[u32], options: &[f64]) -> Result<Mesh, CgalTetgenError> {
    let Some(connection) = connection() else {
        return Ok(run_in_process(operation, xyz, triangles, options)?);
    };
    let request = Message {
        reals: [options, xyz].concat(),
        integers: triangles.to_vec(),
        ..Message::default()
    };
    let reply = connection.call(operation, None, request)?.message;
    Ok(Mesh {
        xyz: reply.reals,
        corners: reply.integers,
    })
}

/// Every operation but those of distance fields, which need state.
pub(super) fn run_in_process(
    operation: Operation,
    xyz: &[f64],
    triangles: &[u32],
    options: &[f64],
) -> Result<Mesh, CallFailure> {
    let mut out = Mesh::default();
    let outcome = match (operation, options) {
        (Operation::SelfTest, []) => ffi::check_tetgen(),
        (Operation::Tetgen, &[ratio, dihedral, volume]) => {
            ffi::tetgen_mesh(xyz, triangles, ratio, dihedral, volume, &mut out)
        }
        (
            Operation::Mesh3,
            &[
                edge_size,
                facet_size,
                facet_angle,
                facet_distance,
                cell_size,
                cell_radius_edge_ratio,
                feature_angle,
                seconds,
            ],
        ) => {
            let sizes = ffi::RefinementSizes {
                edge_size,
                facet_size,
                facet_angle,
                facet_distance,
                cell_size,
                cell_radius_edge_ratio,
                feature_angle,
                seconds,
            };
            ffi::mesh3_mesh(xyz, triangles, &sizes, &mut out)
        }
        (Operation::Wrap, &[alpha, offset]) => ffi::wrap_surface(xyz, triangles, alpha, offset, &mut out),
        (Operation::Remesh, &[edge_length]) => ffi::remesh_surface(xyz, triangles, edge_length, &mut out),
        (Operation::Intersections, &[most]) => ffi::intersecting_pairs(xyz, triangles, most, &mut out.corners),
        _ => return Err(CallFailure::unknown("wrong number of options")),
    };
    check_outcome(outcome).map(|()| out)
}

/// The codes are those of `src/cgal_tetgen/cpp/core.h`.
pub(super) fn check_outcome(outcome: ffi::Outcome) -> Result<(), CallFailure> {
    match outcome.code {
        0 => Ok(()),
        code => Err(CallFailure {
            code,
            message: outcome.message,
        }),
    }
}

//! Calls of CGAL and TetGen on plain arrays, in this process or in the worker if there is one. Nothing is checked here.

use super::CgalTetgenError;
use std::panic::resume_unwind;
use std::thread::Builder;

use super::bridge::ffi;
use super::cancellation::require_wanted;
use super::error::CallFailure;
use super::input::flat;
use super::worker::{Message, connection};
use crate::mesh::SurfaceMesh;

pub(super) use super::worker::Operation;
pub(super) use ffi::Mesh;

/// Runs an operation on a surface, with the options listed at [`Operation`]. Not for the operations of distance fields.
pub(super) fn call_on(operation: Operation, surface: &SurfaceMesh, options: &[f64]) -> Result<Mesh, CgalTetgenError> {
    let triangles = surface.triangles().as_flattened();
    call(operation, &flat(surface.vertices()), triangles, options)
}

/// As [`call_on`], for a surface in arrays.
pub(super) fn call(
    operation: Operation,
    xyz: &[f64],
    triangles: &[u32],
    options: &[f64],
) -> Result<Mesh, CgalTetgenError> {
    let Some(connection) = connection() else {
        require_wanted()?;
        return Ok(run_in_process(operation, xyz, triangles, options)?);
    };
    let request = Message {
        reals: [options, xyz].concat(),
        integers: triangles.to_vec(),
        ..Message::default()
    };
    let (reply, _) = connection.call(operation, None, request)?;
    Ok(Mesh {
        xyz: reply.reals,
        corners: reply.integers,
    })
}

/// Stack of the thread that runs a call, the first that the system grants. TetGen recurses over the triangles about a
/// vertex: 2000 of them took more than 64 MiB. Pages that are not used take no memory.
const STACKS: [usize; 2] = [1 << 30, 1 << 27];

/// As [`call`], in this process.
pub(super) fn run_in_process(
    operation: Operation,
    xyz: &[f64],
    triangles: &[u32],
    options: &[f64],
) -> Result<Mesh, CallFailure> {
    let run = || run_on_this_stack(operation, xyz, triangles, options);
    std::thread::scope(|scope| {
        let started = STACKS
            .into_iter()
            .find_map(|stack| Builder::new().stack_size(stack).spawn_scoped(scope, run).ok());
        match started {
            Some(thread) => thread.join().unwrap_or_else(|panic| resume_unwind(panic)),
            None => run(),
        }
    })
}

fn run_on_this_stack(
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
        (Operation::Remesh, &[edge_length, feature_angle]) => {
            ffi::remesh_surface(xyz, triangles, edge_length, feature_angle, &mut out)
        }
        (Operation::Intersections, &[most]) => ffi::intersecting_pairs(xyz, triangles, most, &mut out.corners),
        _ => return Err(CallFailure::unknown("wrong number of options")),
    };
    check_outcome(outcome).map(|()| out)
}

/// The codes are those of `src/cgal_tetgen/cpp/core.h`.
pub(super) fn check_outcome(outcome: ffi::Outcome) -> Result<(), CallFailure> {
    match outcome.code {
        0 => Ok(()),
        code => Err(CallFailure::new(code, outcome.message)),
    }
}

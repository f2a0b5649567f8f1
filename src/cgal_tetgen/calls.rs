//! The calls of CGAL and TetGen: in this process, or in the worker where there is one. Arrays in, arrays out; nothing is
//! checked here.

use super::CgalTetgenError;
use super::bridge::ffi;
use super::error::Failed;
use super::worker::{Frame, Operation, line};

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

/// A surface with edges of this length.
pub(super) fn remesh(xyz: &[f64], triangles: &[u32], edge_length: f64) -> Result<Mesh, CgalTetgenError> {
    call(Operation::Remesh, xyz, triangles, &[edge_length])
}

/// Pairs of triangles that meet where they should not, one after the other, found among so many at most.
pub(super) fn intersections(xyz: &[f64], triangles: &[u32], most_tested: f64) -> Result<Vec<u32>, CgalTetgenError> {
    Ok(call(Operation::Intersections, xyz, triangles, &[most_tested])?.corners)
}

fn call(operation: Operation, xyz: &[f64], triangles: &[u32], options: &[f64]) -> Result<Mesh, CgalTetgenError> {
    let Some(line) = line() else {
        return Ok(here(operation, xyz, triangles, options)?);
    };
    let request = Frame {
        reals: [options, xyz].concat(),
        integers: triangles.to_vec(),
        ..Frame::default()
    };
    let answer = line.call(operation, None, request)?.frame;
    Ok(Mesh {
        xyz: answer.reals,
        corners: answer.integers,
    })
}

/// In this process. Arrays alone come out of every operation but those of fields.
pub(super) fn here(operation: Operation, xyz: &[f64], triangles: &[u32], options: &[f64]) -> Result<Mesh, Failed> {
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
        _ => return Err(Failed::unknown("an operation with the wrong options")),
    };
    done(outcome).map(|()| out)
}

/// The codes are those of `src/cgal_tetgen/cpp/core.h`.
pub(super) fn done(outcome: ffi::Outcome) -> Result<(), Failed> {
    match outcome.code {
        0 => Ok(()),
        code => Err(Failed {
            code,
            message: outcome.message,
        }),
    }
}

//! The calls of CGAL and TetGen: in this process, or in the worker where there is one. Arrays in, arrays out; nothing is
//! checked here.

use super::NativeError;
use super::worker::{Frame, Line, Operation, line};

pub(super) use super::bridge::ffi::Mesh;

/// Makes TetGen fail harmlessly.
pub(super) fn self_test() -> Result<(), NativeError> {
    match line() {
        None => Ok(here::self_test()?),
        Some(line) => line.call(Operation::SelfTest, None, Frame::default()).map(|_| ()),
    }
}

/// Tetrahedra by TetGen. Options: largest radius-edge ratio (0 for none), smallest dihedral angle in degrees, largest
/// volume (0 for none).
pub(super) fn tetgen(xyz: &[f64], triangles: &[u32], options: &[f64; 3]) -> Result<Mesh, NativeError> {
    match line() {
        None => Ok(here::tetgen(xyz, triangles, options)?),
        Some(line) => there(&line, Operation::Tetgen, xyz, triangles, options),
    }
}

/// Tetrahedra by CGAL. Options: the fields of `RefinementSizes`, in their order.
pub(super) fn mesh3(xyz: &[f64], triangles: &[u32], options: &[f64; 8]) -> Result<Mesh, NativeError> {
    match line() {
        None => Ok(here::mesh3(xyz, triangles, options)?),
        Some(line) => there(&line, Operation::Mesh3, xyz, triangles, options),
    }
}

/// A surface around triangles. Options: alpha, offset.
pub(super) fn wrap(xyz: &[f64], triangles: &[u32], options: &[f64; 2]) -> Result<Mesh, NativeError> {
    match line() {
        None => Ok(here::wrap(xyz, triangles, options)?),
        Some(line) => there(&line, Operation::Wrap, xyz, triangles, options),
    }
}

/// A surface with edges of this length.
pub(super) fn remesh(xyz: &[f64], triangles: &[u32], edge_length: f64) -> Result<Mesh, NativeError> {
    let options = [edge_length];
    match line() {
        None => Ok(here::remesh(xyz, triangles, &options)?),
        Some(line) => there(&line, Operation::Remesh, xyz, triangles, &options),
    }
}

/// Pairs of triangles that meet where they should not, one after the other.
pub(super) fn intersections(xyz: &[f64], triangles: &[u32]) -> Result<Vec<u32>, NativeError> {
    match line() {
        None => Ok(here::intersections(xyz, triangles)?),
        Some(line) => Ok(there(&line, Operation::Intersections, xyz, triangles, &[])?.corners),
    }
}

/// In the worker; what it answers is taken as a mesh.
fn there(
    line: &Line,
    operation: Operation,
    xyz: &[f64],
    triangles: &[u32],
    options: &[f64],
) -> Result<Mesh, NativeError> {
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

/// In this process.
pub(super) mod here {
    use super::super::bridge::ffi;
    use super::super::error::Failed;
    use super::Mesh;

    pub fn self_test() -> Result<(), Failed> {
        done(ffi::check_tetgen())
    }

    pub fn tetgen(xyz: &[f64], triangles: &[u32], options: &[f64; 3]) -> Result<Mesh, Failed> {
        let mut out = Mesh::default();
        let [ratio, dihedral, volume] = *options;
        done(ffi::tetgen_mesh(xyz, triangles, ratio, dihedral, volume, &mut out))?;
        Ok(out)
    }

    pub fn mesh3(xyz: &[f64], triangles: &[u32], options: &[f64; 8]) -> Result<Mesh, Failed> {
        let &[
            edge_size,
            facet_size,
            facet_angle,
            facet_distance,
            cell_size,
            cell_radius_edge_ratio,
            feature_angle,
            seconds,
        ] = options;
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
        let mut out = Mesh::default();
        done(ffi::mesh3_mesh(xyz, triangles, &sizes, &mut out))?;
        Ok(out)
    }

    pub fn wrap(xyz: &[f64], triangles: &[u32], &[alpha, offset]: &[f64; 2]) -> Result<Mesh, Failed> {
        let mut out = Mesh::default();
        done(ffi::wrap_surface(xyz, triangles, alpha, offset, &mut out))?;
        Ok(out)
    }

    pub fn remesh(xyz: &[f64], triangles: &[u32], &[edge_length]: &[f64; 1]) -> Result<Mesh, Failed> {
        let mut out = Mesh::default();
        done(ffi::remesh_surface(xyz, triangles, edge_length, &mut out))?;
        Ok(out)
    }

    pub fn intersections(xyz: &[f64], triangles: &[u32]) -> Result<Vec<u32>, Failed> {
        let mut pairs = Vec::new();
        done(ffi::intersecting_pairs(xyz, triangles, &mut pairs))?;
        Ok(pairs)
    }

    /// The codes are those of `cpp/native/core.h`.
    pub fn done(outcome: ffi::Outcome) -> Result<(), Failed> {
        match outcome.code {
            0 => Ok(()),
            code => Err(Failed {
                code,
                message: outcome.message,
            }),
        }
    }
}

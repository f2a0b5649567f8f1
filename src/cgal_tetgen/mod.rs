//! CGAL and TetGen, called through C++: tetrahedralisation, offset surfaces, signed distance and self-intersections.
//! Feature `native`.
//!
//! Both libraries crash on unexpected input. Every function here checks its input first, catches all C++ exceptions,
//! and checks the result; any failure is a [`CgalTetgenError`]. What is inside a surface is decided by the even-odd
//! rule: a shell inside a shell is a cavity, and a shell inside a cavity is solid again, whatever the orientation of
//! the triangles.
//!
//! Calls run in this process until [`isolate`] sends them to a worker process, so that a crash of the worker is an
//! error here. The command line does so.
//!
//! Results are the same from run to run and for any number of threads.
//!
//! - Si, *TetGen, a Delaunay-based quality tetrahedral mesh generator*, ACM Trans. Math. Softw. 41 (2015): AGPL.
//! - *The CGAL User and Reference Manual*, release 5.5: GPL for the packages used here.

mod bridge;
mod calls;
mod cancellation;
mod distance;
mod error;
mod input;
mod intersections;
mod isotropic;
mod offset;
mod tetrahedra;
mod worker;

pub use cancellation::cancellable;
pub use distance::SignedDistanceField;
pub use error::{CgalTetgenError, InputDefect};
pub use intersections::self_intersections;
pub use isotropic::remesh_isotropically;
pub use offset::{OffsetOptions, OffsetSurface, offset_surface};
pub use tetrahedra::{
    Mesh3Options, TetOptions, memory_estimate, regular_tet_circumradius, tetrahedralize, tetrahedralize_mesh3,
};
pub use worker::{Isolation, isolate, serve_calls};

/// Makes TetGen fail harmlessly, and checks that the failure is reported as an error here.
///
/// TetGen ends the process on an error unless its error function is replaced, as solidmap does; where a second copy of
/// TetGen was loaded first, the replacement may have no effect. [`tetrahedralize`] makes the same check before its
/// first run, so this is for start-up diagnostics.
///
/// # Errors
///
/// [`CgalTetgenError::SelfTestFailed`] when TetGen must not be called in this process.
pub fn self_test() -> Result<(), CgalTetgenError> {
    calls::call(calls::Operation::SelfTest, &[], &[], &[]).map(drop)
}

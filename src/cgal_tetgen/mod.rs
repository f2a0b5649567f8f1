//! What CGAL and TetGen do for us, through C++: tetrahedralisation, offset surfaces, signed distance and
//! self-intersections. Feature `native`.
//!
//! Both libraries crash on inputs that they do not expect. Every function here checks its input first, catches
//! whatever C++ throws, and checks the result before handing it on; what cannot be used is a [`CgalTetgenError`]. Surfaces
//! are read by the even-odd rule: a shell inside a shell is a cavity, a shell inside a cavity is a body again,
//! whatever way their triangles turn.
//!
//! Calls stay in this process until [`isolate`] sends them to a worker, whose end is an error and not that of the program.
//! The command line does so.
//!
//! All results are the same from run to run and for any number of threads.
//!
//! - Si, *TetGen, a Delaunay-based quality tetrahedral mesh generator*, ACM Trans. Math. Softw. 41 (2015): AGPL.
//! - *The CGAL User and Reference Manual*, release 5.5: GPL for the packages used here.

mod bridge;
mod calls;
mod distance;
mod error;
mod input;
mod intersections;
mod offset;
mod tetrahedra;
mod worker;

pub use distance::SignedDistanceField;
pub use error::{CgalTetgenError, InputDefect};
pub use intersections::self_intersections;
pub use offset::{OffsetOptions, OffsetSurface, offset_surface};
pub use tetrahedra::{Mesh3Options, TetOptions, memory_estimate, tetrahedralize, tetrahedralize_mesh3};
pub use worker::{Isolation, isolate, serve_calls};

/// Checks that an error of TetGen would arrive as an error here, by making it fail harmlessly.
///
/// The library ends the process on its own errors unless its error function is replaced, which solidmap does; where a
/// second copy of TetGen was loaded first, the replacement may not take. [`tetrahedralize`] makes the same check
/// before its first run, so calling this is for start-up diagnostics.
///
/// # Errors
///
/// [`CgalTetgenError::SelfTestFailed`] when TetGen must not be called in this process.
pub fn self_test() -> Result<(), CgalTetgenError> {
    calls::self_test()
}

//! Harmonic volumetric maps between solids by the method of fundamental solutions.
//!
//! Given a solid bounded by a closed triangle mesh, the *domain*, and an image for every vertex of that mesh, this
//! crate computes a map of the whole solid whose coordinate functions are harmonic and which agrees with those images
//! on the boundary. No tetrahedra are needed: the map is a sum of point sources outside the domain, fitted to the
//! boundary, and has a value and a derivative at any point.
//!
//! ```
//! use solidmap::boundary_map::BoundaryMap;
//! use solidmap::fit::{FitOptions, fit};
//! use solidmap::map::VolumeMap;
//! use solidmap::mesh::shapes;
//! use solidmap::Point;
//!
//! let domain = shapes::sphere(1.0, 2);
//! let image = domain.vertices().iter().map(|p| Point::new(2.0 * p.x, p.y, p.z + 0.3 * p.x * p.y)).collect();
//! let boundary = BoundaryMap::new(domain, image)?;
//! let fit = fit(&boundary, &FitOptions::default(), &|_| {})?;
//! assert!(fit.report.boundary_error.rms < 1e-2);
//! let centre = fit.map.evaluate(&[Point::origin()])[0];
//! assert!((centre - Point::origin()).norm() < 1e-2);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # Conventions
//!
//! Lengths are in model units. Arrays of points are `n × 3`; triangles are counter-clockwise seen from outside, and
//! indices count from 0. Errors of a map are fractions of the target's bounding-box diagonal, at boundary points that
//! the fit has not seen ([`fit::BoundaryError`]). Results do not depend on the order of evaluation; they may differ in
//! the last digits between numbers of threads and kinds of processors.
//!
//! # Method
//!
//! X. Li, X. Guo, H. Wang, Y. He, X. Gu, H. Qin, *Harmonic Volumetric Mapping for Solid Modeling Applications*, ACM
//! Symposium on Solid and Physical Modeling, 2007. `docs/method.md` maps its notation to this code and says where the
//! two differ.
//!
//! # Features
//!
//! `native` (default) calls CGAL (GPL) and TetGen (AGPL) through C++; without it the crate is pure Rust under MIT or
//! Apache-2.0, and whatever needs them is left out or returns an error that says so. `io` (default) reads and writes
//! files.

#![deny(missing_docs, rustdoc::broken_intra_doc_links)]

pub mod baseline;
pub mod bijective;
pub mod boundary_map;
pub mod certificate;
#[cfg(feature = "native")]
pub mod cgal_tetgen;
pub mod check;
pub mod compare;
pub mod energy;
pub mod error_kind;
#[cfg(feature = "io")]
pub mod files;
pub mod fit;
pub mod geometry;
pub mod hexmesh;
pub mod hyperbolic;
pub mod improve;
pub mod intrinsic;
pub mod inverse;
#[cfg(feature = "io")]
pub mod io;
pub mod kernel;
pub mod map;
pub mod memory;
pub mod mesh;
pub mod model_polycube;
mod partition;
pub mod polycube;
pub mod progress;
pub mod remesh;
pub mod sampling;
pub mod sequence;
mod simd;
pub mod solver;
pub mod spherical;
pub mod statistics;
pub mod texture;
pub mod toroidal;
pub mod transfer;
pub mod worst_places;

/// The licences of this build: with the feature `native` it contains CGAL and TetGen.
pub const LICENCE: &str = if cfg!(feature = "native") {
    "built with CGAL (GPL-3.0-or-later) and TetGen (AGPL-3.0-or-later): this binary may be distributed under AGPL-3.0"
} else {
    "built without CGAL and TetGen: MIT OR Apache-2.0"
};

/// The linear algebra crate that the point types are from, re-exported so that callers use the same version.
pub use nalgebra;

/// A point in space, in model units.
pub type Point = nalgebra::Point3<f64>;
/// A displacement, normal or gradient.
pub type Vector = nalgebra::Vector3<f64>;
/// A 3 × 3 matrix; a Jacobian `J` has `J[(i, k)] = ∂f_i / ∂x_k`.
pub type Matrix3 = nalgebra::Matrix3<f64>;

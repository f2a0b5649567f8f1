//! Harmonic volumetric maps between solids by the method of fundamental solutions.

pub mod boundary_map;
pub mod check;
pub mod energy;
pub mod fit;
pub mod geometry;
pub mod io;
pub mod kernel;
pub mod map;
pub mod mesh;
#[cfg(feature = "native")]
pub mod native;
pub mod report;
pub mod sampling;
pub mod solver;

/// A point in space, in model units.
pub type Point = nalgebra::Point3<f64>;
/// A displacement, normal or gradient.
pub type Vector = nalgebra::Vector3<f64>;
/// A 3 × 3 matrix; a Jacobian `J` has `J[(i, k)] = ∂f_i / ∂x_k`.
pub type Matrix3 = nalgebra::Matrix3<f64>;

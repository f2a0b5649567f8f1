//! Maps of boundary surfaces: where each point of the domain's surface goes, whether it is one to one, and how far it
//! distorts.

pub mod check;
mod composition;
mod correspondence;
mod distortion;
pub mod examples;
mod function;
pub mod pair;

pub use correspondence::{BoundaryMap, BoundaryMapError};
pub use distortion::{DistortionQuantiles, SurfaceDistortion, TriangleDistortion, triangle_distortions};

//! Boundary maps: the image of each point of the domain's surface, whether the map is bijective, and its distortion.

pub mod check;
mod composition;
mod correspondence;
mod distortion;
mod error;
pub mod examples;
mod function;
mod fundamental_domain;
mod line_search;
pub mod pair;
mod shells;
pub(crate) mod sweep;

pub use correspondence::BoundaryMap;
pub use distortion::{DistortionQuantiles, SurfaceDistortion, TriangleDistortion, triangle_distortions};
pub use error::BoundaryMapError;
pub use fundamental_domain::{FundamentalDomain, FundamentalDomainError, fundamental_domain};
pub use shells::ShellMap;

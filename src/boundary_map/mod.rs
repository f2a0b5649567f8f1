//! Maps of boundary surfaces: where each point of the domain's surface goes.

mod correspondence;
mod course;
pub mod examples;

pub use correspondence::{BoundaryMap, BoundaryMapError};

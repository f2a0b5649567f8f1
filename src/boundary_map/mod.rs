//! Maps of boundary surfaces: where each point of the domain's surface goes.

mod correspondence;
pub mod examples;
pub mod pair;

pub use correspondence::{BoundaryMap, BoundaryMapError};

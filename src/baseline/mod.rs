//! Rival maps of solids, behind the same trait as the harmonic map, so that a comparison measures all alike.

mod mean_value;

pub use mean_value::{MeanValueError, MeanValueMap};

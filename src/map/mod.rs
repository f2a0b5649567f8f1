//! Maps of solids: the trait that all implement, and the harmonic map.

mod cancellable;
mod harmonic_map;
mod volume_map;

pub use cancellable::{Cancelled, with_cancellation};
pub use harmonic_map::HarmonicMap;
pub use volume_map::VolumeMap;

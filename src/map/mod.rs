//! Maps of solids: what every one of them offers, and the harmonic map itself.

mod harmonic_map;
mod volume_map;

pub use harmonic_map::HarmonicMap;
pub use volume_map::VolumeMap;

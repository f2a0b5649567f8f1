//! Maps of solids.

mod volume_map;

pub use volume_map::VolumeMap;

//! What several commands share.

pub mod bijective;
pub mod boundary_map;
pub mod carried_mesh_file;
pub mod carried_mesh_picture;
pub mod carried_mesh_report;
pub mod chosen_map;
pub mod exhausted_memory;
pub mod fields;
pub mod fitting;
pub mod input;
pub mod interrupt;
#[cfg(feature = "native")]
pub mod isolation;
pub mod json;
pub mod made_folder;
pub mod map_page;
pub mod output;
pub mod page;
pub mod picture_file;
pub mod pictures;
pub mod places;
pub mod points;
pub mod polycubes;
pub mod progress;
pub mod remeshing;
pub mod stored_paths;

//! solidmap's own files: maps, boundary maps, solid textures, landmarks, landmark curves and pairs of components; and fields of maps
//! for ParaView.
//!
//! Maps, boundary maps and textures are safetensors containers: named tensors, with a JSON object in the metadata.
//! Landmarks and pairs of components are text.

mod boundary;
mod boundary_tensors;
mod components;
mod fields;
mod landmark_curves;
mod landmarks;
mod map;
mod number_rows;
mod provenance;
mod tensor_file;
mod texture;

pub use boundary::{BoundaryFile, BoundaryMetadata, read_boundary, write_boundary};
pub use components::read_components;
pub use fields::{
    attempt_fields, certificate_fields, energy_fields, write_boundary_fields, write_cell_means, write_fields,
    write_fit_fields,
};
pub use landmark_curves::read_landmark_curves;
pub use landmarks::{LandmarkFileError, read_landmark_files, read_landmarks};
pub use map::{MapFile, MapMetadata, read_map, write_map};
pub use provenance::Provenance;
pub use tensor_file::TensorFileError;
pub use texture::{TextureFile, TextureMetadata, read_texture, write_texture};

//! VTK's formats in XML, which ParaView reads and writes: unstructured grids (`.vtu`) and image data (`.vti`).
//!
//! Reading: numbers as text, base64 or appended (raw or base64), plain or compressed by zlib. Writing: base64 in
//! place, which every reader of the format takes and which is valid XML.

mod arrays;
mod document;
mod image;
mod read;
mod write;

pub use image::{ImageGrid, write_vti};
pub use write::write_vtu;

pub(in crate::io) use read::{parse as parse_vtu, parse_with_fields as parse_vtu_with_fields};

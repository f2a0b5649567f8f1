//! The legacy VTK format (`.vtk`), in text and binary.

mod arrays;
mod read;
mod write;

pub use write::{VtkEncoding, write_vtk};

pub(in crate::io) use read::parse;

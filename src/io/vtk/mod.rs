//! VTK's formats: the legacy one and those in XML.
//!
//! Our own code: `vtkio` allocates by unchecked counts of the file, and its errors have no positions.

mod cells;
mod lattice;
mod legacy;
mod xml;

pub use legacy::{VtkEncoding, write_vtk};
pub use xml::{ImageGrid, write_vti, write_vtu};

pub(super) use legacy::parse as parse_legacy;
pub(super) use xml::{parse_vti, parse_vtu};

//! Meshes as plain arrays: closed triangle surfaces, solids of tetrahedra or hexahedra, and procedural examples.
//!
//! Imports nothing else of this crate. A vertex is identified by its index: no function here renumbers vertices unless
//! it returns the renumbering.

mod boundary_surface;
mod cell_faces;
mod cell_mesh;
mod creases;
mod hex_split;
mod kuhn;
pub mod shapes;
mod surface_mesh;
mod surface_point;
mod tet_mesh;
pub mod topology;
mod weld;

pub use boundary_surface::BoundarySurface;
pub(crate) use cell_faces::{CellFace, faces, outer, sorted};
pub use cell_mesh::{CellList, CellMesh, HEXAHEDRON};
pub(crate) use cell_mesh::{HEX_CORNERS, HEX_FACES, TET_FACES};
pub(crate) use creases::FEATURE_ANGLE;
pub use creases::{creases, feature_curves};
pub use hex_split::tets_of_hex;
pub(crate) use kuhn::KUHN;
pub(crate) use surface_mesh::triangle_area;
pub use surface_mesh::{MeshError, SurfaceMesh};
pub use surface_point::SurfacePoint;
pub use tet_mesh::TetMesh;
pub use weld::{lowest_coincident_vertices, welded};

/// The six directions along the axes, in the order of the labels 0 to 5 of polycubes.
pub const DIRECTION_NAMES: [&str; 6] = ["-x", "+x", "-y", "+y", "-z", "+z"];

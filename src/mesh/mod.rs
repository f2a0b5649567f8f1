//! Meshes as plain arrays: closed triangle surfaces and tetrahedral solids, and procedural examples of both.
//!
//! Imports nothing else of this crate. A vertex is identified by its index: no function here renumbers vertices unless
//! it returns the renumbering.

mod cell_mesh;
mod kuhn;
pub mod shapes;
mod surface_mesh;
mod surface_point;
mod tet_mesh;
pub mod topology;
mod weld;

pub(crate) use cell_mesh::TET_FACES;
pub use cell_mesh::{CellList, CellMesh, HEXAHEDRON};
pub(crate) use kuhn::KUHN;
pub(crate) use surface_mesh::triangle_area;
pub use surface_mesh::{MeshError, SurfaceMesh};
pub use surface_point::SurfacePoint;
pub use tet_mesh::{BoundarySurface, TetMesh};
pub use weld::{lowest_coincident_vertices, welded};

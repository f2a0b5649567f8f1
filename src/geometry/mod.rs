//! Distance, inside and winding number queries on surfaces, plane sections, and exact orientation of tetrahedra.
//!
//! [`SurfaceQuery`] is built once per surface and asked often; the other items are what it is made of.

mod aabb;
mod bvh;
mod cell_shape;
pub(crate) mod clip;
mod closest_point;
mod distance_field;
mod hex_validity;
mod predicates;
mod procrustes;
mod section;
mod surface_query;
#[cfg(test)]
pub(crate) mod test_models;
mod tet_locator;
mod winding_number;

pub use aabb::Aabb;
pub use bvh::{Bvh, BvhNode};
pub(crate) use cell_shape::{hex_scaled_jacobian, lesser, tet_scaled_jacobian, trilinear_gradients};
pub use closest_point::{Feature, TrianglePoint, closest_point_on_triangle};
pub use distance_field::{are_outside, count_outside, distance_field};
pub(crate) use hex_validity::is_hex_positive;
pub use predicates::{FlipCounts, flipped_cells, flipped_tets, orientation};
pub(crate) use procrustes::similarity;
pub use procrustes::{Similarity, SphereRotation, sphere_rotation};
pub use section::{Axis, AxisPlane, PlaneSection, SectionError};
pub(crate) use surface_query::morton_order;
pub use surface_query::{ClosestPoint, QueryError, SurfaceQuery};
pub use tet_locator::{TetLocator, TetPoint};
pub use winding_number::{solid_angle, winding_number};

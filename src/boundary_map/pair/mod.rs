//! Pairs of solids of different connectivity: rough correspondences to start from.

mod alignment;
mod oriented_query;
mod procrustes;

pub use alignment::{AlignError, Alignment, Alignments, Body, align, align_by_landmarks};
pub use oriented_query::{OrientedPoint, OrientedQuery, vertex_normals};
pub use procrustes::{Similarity, SphereRotation, sphere_rotation};

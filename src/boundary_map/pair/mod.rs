//! Pairs of solids of different connectivity: rough correspondences to start from.

mod alignment;
mod landmarks;
mod lift;
mod oriented_query;
mod rotation;
mod targets;

pub use alignment::{AlignError, Alignment, AlignmentStart, Alignments, Body, align, align_by_landmarks};
pub use landmarks::{LandmarkError, Landmarks};
pub use oriented_query::{OrientedPoint, OrientedQuery, vertex_normals};
pub use rotation::{RotationMatch, search_rotations};
pub use targets::{VertexTarget, vertex_targets};

//! Collocation points, held-out points and sources (the paper's sections 4.1 and 4.5).
//!
//! Points on the boundary are [`crate::mesh::SurfacePoint`]s, so that their images follow from the boundary map; only
//! points off the surface are plain positions.

mod cells;
mod collocation;
mod farthest_point;
mod hierarchy;
mod sources;

pub use cells::{RefinedSites, SurfaceCells};
pub use collocation::{Collocation, held_out};
pub use farthest_point::{Anchors, thin};
pub use hierarchy::{HierarchyOptions, SiteLevel, coarser_levels};
pub use sources::{
    AreOutside, PlacedSources, SourceSite, adaptive_sources, bounding_sphere, even_points, place_sources,
};

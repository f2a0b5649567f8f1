//! Bijections of closed surfaces of genus 0 with the unit sphere.
//!
//! A [`SphericalMap`] gives every vertex of a surface a direction such that the geodesic triangles over its faces cover
//! the sphere once: it is checked with exact predicates when it is made, so that whoever holds one holds a bijection.

mod certificate;
mod cholesky;
mod cmcf;
mod energy;
mod hierarchy;
mod kernel;
mod moebius;
mod newton;
mod progressive;
mod spherical_map;

pub use certificate::{Certificate, certify};
pub use spherical_map::{SphericalError, SphericalMap, require_sphere};

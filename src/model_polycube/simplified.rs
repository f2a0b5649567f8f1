//! A large model's polycube: a simplified model is deformed in its place, and the polycube's boundary goes to the model's by way of
//! the simplified one's.
//!
//! What a deformation costs grows with the tetrahedra, and what is wanted of it, a few charts that follow the shape, does not need
//! more of them. The simplified boundary is mapped to the model's through embeddings in the sphere, a flat torus or a hyperbolic surface, so that every point of
//! the polycube's boundary has its point of the model's own, one to one.

use super::{Model, ModelPolycubeError, ModelPolycubePhase};
use crate::boundary_map::pair::{PairOptions, map_pair, over_surface};
use crate::boundary_map::{BoundaryMap, SurfaceDistortion};
#[cfg(feature = "native")]
use crate::mesh::FEATURE_ANGLE;
use crate::mesh::{SurfaceMesh, TetMesh};
use crate::polycube::MakePolycubeError;
use crate::progress::ProgressControl;

/// What is known of a simplified model.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct SimplifiedReport {
    /// Vertices of its surface.
    pub vertices: usize,
    /// Vertices of the model's surface.
    pub of: usize,
    /// Distortion of the map from its surface to the model's.
    pub distortion: SurfaceDistortion,
}

/// The simplified model, filled with tetrahedra; `None` where it cannot be simplified without passing through itself, or this build
/// cannot.
pub(super) fn simplified(
    model: &Model,
    most_vertices: usize,
    progress: &dyn Fn(ModelPolycubePhase) -> ProgressControl,
) -> Result<Option<TetMesh>, ModelPolycubeError> {
    if progress(ModelPolycubePhase::Simplifying) == ProgressControl::Cancel {
        return Err(MakePolycubeError::Cancelled.into());
    }
    Ok(filled(model, most_vertices))
}

/// Vertices of a simplified model, about: edges end somewhat shorter. For scale: with 6000 heads and a bunny take twice as long, and their
/// cells are no better.
#[cfg(feature = "native")]
const VERTICES: usize = 4000;

#[cfg(feature = "native")]
fn filled(model: &Model, most_vertices: usize) -> Option<TetMesh> {
    use crate::cgal_tetgen::{TetOptions, remesh_isotropically, tetrahedralize};
    let vertices = VERTICES.min(most_vertices);
    // Two triangles of side l, √3/4 l² each, for every vertex.
    let edge_length = (2.0 * model.surface.area() / (3f64.sqrt() * vertices as f64)).sqrt();
    let feature_angle = model.has_features.then_some(FEATURE_ANGLE);
    let remeshed = remesh_isotropically(&model.surface, edge_length, feature_angle).ok()?;
    // Short edges are collapsed: a thin handle may be gone.
    let is_alike = crate::spherical::genus(&remeshed) == model.genus;
    // Refuses surfaces that pass through themselves.
    is_alike.then(|| tetrahedralize(&remeshed, &TetOptions::default()).ok())?
}

#[cfg(not(feature = "native"))]
fn filled(_: &Model, _: usize) -> Option<TetMesh> {
    None
}

/// The map from the polycube's boundary to the model's; `simplified` is the simplified model's, with the triangles of the polycube's.
pub(super) fn onto_model(
    polycube: SurfaceMesh,
    simplified: &SurfaceMesh,
    model: &SurfaceMesh,
    progress: &dyn Fn(ModelPolycubePhase) -> ProgressControl,
) -> Result<(BoundaryMap, SimplifiedReport), ModelPolycubeError> {
    let in_place = PairOptions {
        aligned: true,
        ..PairOptions::default()
    };
    let pairing = |phase| progress(ModelPolycubePhase::Pairing(phase));
    let (onto, pair) = map_pair(simplified, model, &in_place, &pairing)?;
    let report = SimplifiedReport {
        vertices: simplified.vertices().len(),
        of: model.vertices().len(),
        distortion: pair.after,
    };
    Ok((over_surface(&onto, polycube)?, report))
}

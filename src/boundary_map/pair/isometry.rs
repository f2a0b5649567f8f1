//! Embeddings rated by their energy and by how far their map is from an isometry.
//!
//! The energy sees each triangle, the isometry defect where limbs are: a map that takes a leg to another leg of the same length,
//! or turns about one, costs little energy. Each chooses right in most pairs, and they err in different ones: see
//! `docs/boundary_maps.md`.

use super::inter_surface::InverseEmbedding;
use crate::intrinsic::{IntrinsicShape, MappedVertex, isometry_defect};
use crate::mesh::{SurfaceMesh, triangle_area};
use crate::spherical::PartialEmbedding;

/// The intrinsic shapes of a domain and its target.
pub(super) struct IntrinsicShapes {
    pub domain: IntrinsicShape,
    pub target: IntrinsicShape,
}

/// A defect that counts as much as the energy of an isometry: the largest one of maps between poses of a body.
const DEFECT_SCALE: f64 = 0.05;

/// How good the map of an embedding is.
#[derive(Debug, Clone, Copy)]
pub(super) struct Quality {
    /// See [`EmbeddingCandidate::energy`](super::embedder::EmbeddingCandidate::energy).
    pub energy: f64,
    /// How far the map is from an isometry; `None` where the surfaces have no intrinsic shapes.
    pub isometry_defect: Option<f64>,
}

impl Quality {
    /// What maps are compared by, the less the better: the energy, more for those that are far from an isometry.
    pub fn rating(&self) -> f64 {
        self.energy * (1.0 + self.isometry_defect.unwrap_or(0.0) / DEFECT_SCALE)
    }
}

impl IntrinsicShapes {
    /// The [isometry defect](isometry_defect) of the map of an embedding, from its vertices. `None` when they are too few.
    pub fn defect(
        &self,
        embedding: &PartialEmbedding,
        domain: &SurfaceMesh,
        inverse: &InverseEmbedding,
    ) -> Option<f64> {
        let mut areas = vec![0.0; domain.vertices().len()];
        for corners in embedding.rings.triangles() {
            let area = triangle_area(&corners.map(|v| domain.vertices()[v as usize]));
            corners.iter().for_each(|&v| areas[v as usize] += area / 3.0);
        }
        let mapped = |&vertex: &u32| {
            let (corners, barycentric) = inverse.corners(&embedding.directions[vertex as usize]);
            MappedVertex {
                vertex,
                area: areas[vertex as usize],
                image: std::array::from_fn(|k| (corners[k], barycentric[k])),
            }
        };
        isometry_defect(&self.domain, &self.target, embedding.inserted.iter().map(mapped))
    }
}

//! Embeddings rated by their energy and by how far their map is from an isometry.
//!
//! The energy sees each triangle, the isometry defect where limbs are: a map that takes a leg to another leg of the same length,
//! or turns about one, costs little energy. Each chooses right in most pairs, and they err in different ones: see
//! `docs/boundary_maps.md`.

use std::sync::Arc;

use super::inter_surface::InverseEmbedding;
use super::{DISTINCT, NearerIsometry};
use crate::Point;
use crate::intrinsic::{Correspondence, IntrinsicShape, MappedVertex, isometry_defect};
use crate::mesh::{SurfaceMesh, triangle_area};
use crate::spherical::PartialEmbedding;

/// The intrinsic shapes of a domain and its target.
#[derive(Clone)]
pub(super) struct IntrinsicShapes {
    pub domain: Arc<IntrinsicShape>,
    pub target: Arc<IntrinsicShape>,
}

/// A defect that counts as much as the energy of an isometry: the largest one of maps between poses of a body.
const DEFECT_SCALE: f64 = 0.05;
/// Smaller defects are as good as this one: all limbs are in their places, and the energy sees what is left.
pub(super) const SMALL_DEFECT: f64 = 0.03;

/// A correspondence is clearly nearer to an isometry than a map when its defect is less than this times that of the map. The
/// functional map of a correspondence was refined to have little, so that it has less for the same limbs, too.
const CLEARLY_NEARER: f64 = 0.7;

/// How good the map of an embedding is.
#[derive(Debug, Clone, Copy)]
pub(super) struct Quality {
    /// See [`EmbeddingCandidate::energy`](super::embedder::EmbeddingCandidate::energy).
    pub energy: f64,
    /// How far the map is from an isometry; `None` where the surfaces have no intrinsic shapes.
    pub isometry_defect: Option<f64>,
}

/// Maps with larger defects are of different bodies, and no worse for it.
const MOST_OF_POSES: f64 = 0.12;

/// Whether a map between poses of a body, by its defect, has a part out of its place.
pub(super) fn is_off(defect: f64) -> bool {
    (SMALL_DEFECT..MOST_OF_POSES).contains(&defect)
}

impl Quality {
    /// What maps are compared by, the less the better: the energy, more for those that are far from an isometry.
    pub fn rating(&self) -> f64 {
        self.energy * (1.0 + self.isometry_defect.unwrap_or(0.0).max(SMALL_DEFECT) / DEFECT_SCALE)
    }
}

impl NearerIsometry {
    /// The correspondence, where it is clearly nearer to an isometry than a map with this defect and these images of vertices, and
    /// takes vertices elsewhere.
    pub(super) fn than(
        isometry_defect: f64,
        images: impl Iterator<Item = Point>,
        closest: &Correspondence,
        target: &SurfaceMesh,
    ) -> Option<Self> {
        if closest.defect >= CLEARLY_NEARER * isometry_defect {
            return None;
        }
        let (mut sum, mut weights) = (0.0, 0.0);
        for (found, image) in closest.targets.iter().zip(images) {
            if let &Some((w, weight)) = found {
                sum += weight * (image - target.vertices()[w as usize]).norm();
                weights += weight;
            }
        }
        let distance = sum / (weights * target.diagonal());
        (distance > DISTINCT).then_some(Self {
            isometry_defect: closest.defect,
            distance,
        })
    }
}

impl IntrinsicShapes {
    /// The same shapes for the map back: domain and target exchanged.
    pub fn exchanged(&self) -> Self {
        Self {
            domain: self.target.clone(),
            target: self.domain.clone(),
        }
    }

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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::shapes;

    #[test]
    fn a_correspondence_that_is_nearer_and_elsewhere_is_told() {
        let target = shapes::sphere(1.0, 3);
        let count = target.vertices().len();
        let to = |vertices: Vec<usize>, defect| Correspondence {
            extremities: vec![],
            targets: vertices.into_iter().map(|w| Some((w as u32, 0.5))).collect(),
            defect,
            coverage: 1.0,
        };
        let own: Vec<usize> = (0..count).collect();
        let opposite = |p: &Point| {
            let distance = |w: &usize| (target.vertices()[*w] + p.coords).coords.norm();
            (0..count).min_by(|a, b| distance(a).total_cmp(&distance(b))).unwrap()
        };
        let opposite: Vec<usize> = target.vertices().iter().map(opposite).collect();
        let than =
            |closest: &Correspondence| NearerIsometry::than(0.1, target.vertices().iter().copied(), closest, &target);
        let found = than(&to(opposite.clone(), 0.05)).unwrap();
        // Opposite points are 2 apart, and the diagonal is at most 2√3.
        assert!(
            found.isometry_defect == 0.05 && (0.57..0.65).contains(&found.distance),
            "{found:?}"
        );
        assert_eq!(than(&to(own.clone(), 0.05)), None);
        assert_eq!(than(&to(opposite, 0.08)), None);
        let nowhere = Correspondence {
            targets: vec![None; count],
            ..to(own, 0.0)
        };
        assert_eq!(than(&nowhere), None);
    }
}

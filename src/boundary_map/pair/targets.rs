//! A correspondence by shape alone: for each vertex of the aligned domain the closest point of the target that faces
//! the same way.

use rayon::prelude::*;

use super::OrientedPoint;
use super::alignment::{AlignmentSurface, NORMAL_WEIGHT};
use crate::geometry::Similarity;
use crate::mesh::SurfacePoint;
use crate::{Point, Vector};

/// The point of the target that corresponds to a vertex, with a confidence.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VertexTarget {
    /// Point of the target's surface.
    pub place: SurfacePoint,
    /// Confidence: from 1 where the aligned surfaces coincide down to 0 where they are far apart or normals disagree.
    pub weight: f64,
    /// Distance to it from the aligned vertex, as a fraction of the target's size (twice the largest distance from its
    /// centroid).
    pub distance: f64,
}

/// Distance at which the weight has fallen to 1/e where normals agree, as a fraction of the target's size.
const FAR: f64 = 0.1;
/// Vertices of lower weight have no target.
const LEAST_WEIGHT: f64 = 0.01;

/// For each vertex of the domain, in its order, the closest point of the target in the metric of position and normal
/// once the domain is moved by `alignment`. `None` where that point is far, or faces another way, and for vertices
/// without a normal. The correspondence is neither continuous nor one to one.
pub fn vertex_targets(
    domain: &AlignmentSurface,
    target: &AlignmentSurface,
    alignment: &Similarity,
) -> Vec<Option<VertexTarget>> {
    closest_targets(target, &domain.vertices_in(target, alignment))
}

/// The same for some of the vertices.
pub(super) fn targets_of_vertices(
    domain: &AlignmentSurface,
    target: &AlignmentSurface,
    alignment: &Similarity,
    vertices: &[u32],
) -> Vec<Option<VertexTarget>> {
    let all = domain.vertices_in(target, alignment);
    let of_vertices: Vec<(Point, Vector)> = vertices.iter().map(|&v| all[v as usize]).collect();
    closest_targets(target, &of_vertices)
}

/// The targets of points with normals in the target's frame.
fn closest_targets(target: &AlignmentSurface, points: &[(Point, Vector)]) -> Vec<Option<VertexTarget>> {
    let size = target.size;
    let found = target.query.closest_of_all(points, NORMAL_WEIGHT * size);
    let target_of = |((p, n), found): (&(Point, Vector), &OrientedPoint)| {
        let distance = nalgebra::distance(p, &found.point) / size;
        let agreement = n.dot(&found.normal).max(0.0);
        let weight = agreement * (-(distance / FAR).powi(2)).exp();
        (weight > LEAST_WEIGHT).then_some(VertexTarget {
            place: found.place,
            weight,
            distance,
        })
    };
    points.par_iter().zip(&found).map(target_of).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{SurfaceMesh, shapes};

    fn prepared(surface: &SurfaceMesh) -> AlignmentSurface {
        AlignmentSurface::new(surface, "domain").unwrap()
    }

    #[test]
    fn a_solid_is_its_own_target() {
        let surface = shapes::bumpy_sphere(8);
        let itself = prepared(&surface);
        let targets = vertex_targets(&itself, &itself, &Similarity::identity());
        assert_eq!(targets.len(), surface.vertices().len());
        for (found, p) in targets.iter().zip(surface.vertices()) {
            let found = found.unwrap();
            assert!((found.place.position(&surface, surface.vertices()) - p).norm() < 1e-12);
            assert!(found.weight > 1.0 - 1e-9 && found.distance < 1e-12);
        }
    }

    /// Moved across by most of its thickness, the upper side of a plate is closest to the lower one.
    #[test]
    fn targets_stay_on_the_side_that_faces_the_same_way() {
        let plate = shapes::deformed(&shapes::cube(1.0, 10), |p| Point::new(p.x, p.y, 0.02 * p.z));
        let shift = Similarity {
            translation: Vector::new(0.0, 0.0, -0.015),
            ..Similarity::identity()
        };
        let targets = vertex_targets(&prepared(&plate), &prepared(&plate), &shift);
        let mut seen = 0;
        for (found, p) in targets.iter().zip(plate.vertices()) {
            if p.x.abs().max(p.y.abs()) < 0.45 {
                let place = found.unwrap().place.position(&plate, plate.vertices());
                assert!((place.z - p.z).abs() < 1e-12);
                seen += 1;
            }
        }
        assert_eq!(seen, 2 * 81);
    }

    #[test]
    fn far_parts_have_no_target() {
        let small = prepared(&shapes::sphere(1.0, 2));
        let spike = shapes::deformed(&shapes::sphere(1.0, 3), |p| {
            if p.z > 0.99 { Point::new(0.0, 0.0, 6.0) } else { *p }
        });
        let tip = spike.vertices().iter().position(|p| p.z > 5.0).unwrap();
        let targets = vertex_targets(&prepared(&spike), &small, &Similarity::identity());
        assert!(targets[tip].is_none());
        assert!(targets.iter().filter(|t| t.is_some()).count() > spike.vertices().len() / 2);
    }
}

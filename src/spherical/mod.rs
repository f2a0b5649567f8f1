//! Spherical embeddings: bijections of closed surfaces of genus 0 with the unit sphere.
//!
//! A [`SphericalEmbedding`] gives every vertex of a surface a direction such that the geodesic triangles over its faces
//! cover the sphere once. Exact predicates check this when one is constructed.

mod cholesky;
mod cmcf;
mod curvature;
mod distortion_energy;
mod embedding_check;
mod hierarchy;
mod locate;
mod map_to_sphere;
mod moebius;
mod newton;
mod progressive;
mod relax;
mod rest_shape;
mod ring_kernel;
mod spherical_embedding;

pub(crate) use cholesky::Cholesky;
pub(crate) use curvature::Curvature;
pub(crate) use distortion_energy::tangents;
pub(crate) use distortion_energy::{DistortionEnergy, ElementDerivatives, EnergyWeights, Objective};
pub use embedding_check::{EmbeddingCheck, check_embedding};
pub(crate) use hierarchy::{Hierarchy, Insertion, VertexRings};
pub use locate::Locator;
pub(crate) use locate::MAX_WALK;
pub use map_to_sphere::{SphereEnergy, SphereOptions, SpherePhase, SphereReport, SphereStart, map_to_sphere};
pub(crate) use moebius::Moebius;
pub(crate) use newton::{Newton, NewtonOptions};
pub(crate) use progressive::{InsertedMesh, PartialEmbedding};
pub(crate) use relax::{Relaxation, RelaxationStar, better_place};
pub(crate) use rest_shape::{RestShape, RestShapes};
pub(crate) use ring_kernel::{det, point_in_kernel, positive_det};
pub use spherical_embedding::{SphericalEmbedding, SphericalError, require_genus_0};
pub(crate) use spherical_embedding::{genus, require_genus, require_scale};

/// Spherical embeddings for tests.
#[cfg(test)]
pub(crate) mod testing {
    use super::SphericalEmbedding;
    use crate::mesh::SurfaceMesh;
    use crate::{Point, Vector};

    /// The radial projection of a surface that is star-shaped about the origin.
    pub fn radial_embedding(surface: SurfaceMesh) -> SphericalEmbedding {
        let directions: Vec<Vector> = surface.vertices().iter().map(|p| p.coords.normalize()).collect();
        SphericalEmbedding::new(surface, &directions).unwrap()
    }

    /// A cylinder with pointed ends, whose rings of `around` vertices shrink geometrically towards the poles of the
    /// sphere, as under a conformal map of a protrusion: to polar angles of `2 · 10^-power`.
    pub fn graded_spindle(power: f64, around: usize) -> SphericalEmbedding {
        let rings = 4 * power.ceil() as i32;
        let angle = |j: usize| std::f64::consts::TAU * j as f64 / around as f64;
        let mut vertices = vec![Point::new(0.0, 0.0, f64::from(-rings) - 1.0)];
        let mut directions = vec![-Vector::z()];
        for k in -rings..=rings {
            // Stereographic: radius `r` on the plane through the equator.
            let r = 10f64.powf(-power * f64::from(k) / f64::from(rings));
            for (sin, cos) in (0..around).map(|j| angle(j).sin_cos()) {
                vertices.push(Point::new(2.0 * cos, 2.0 * sin, f64::from(k)));
                directions.push(Vector::new(2.0 * r * cos, 2.0 * r * sin, 1.0 - r * r) / (1.0 + r * r));
            }
        }
        vertices.push(Point::new(0.0, 0.0, f64::from(rings) + 1.0));
        directions.push(Vector::z());
        let (n, tip) = (around as u32, vertices.len() as u32 - 1);
        let at = |ring: u32, j: u32| 1 + ring * n + j % n;
        let last = 2 * rings as u32;
        let mut triangles = Vec::new();
        for j in 0..n {
            triangles.push([0, at(0, j + 1), at(0, j)]);
            for ring in 0..last {
                let (a, b, c, d) = (at(ring, j), at(ring, j + 1), at(ring + 1, j + 1), at(ring + 1, j));
                triangles.extend([[a, b, c], [a, c, d]]);
            }
            triangles.push([at(last, j), at(last, j + 1), tip]);
        }
        SphericalEmbedding::new(SurfaceMesh::new(vertices, triangles).unwrap(), &directions).unwrap()
    }
}

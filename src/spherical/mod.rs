//! Bijections of closed surfaces of genus 0 with the unit sphere.
//!
//! A [`SphericalMap`] gives every vertex of a surface a direction such that the geodesic triangles over its faces cover
//! the sphere once: it is checked with exact predicates when it is made, so that whoever holds one holds a bijection.

mod certificate;
mod cholesky;
mod cmcf;
mod embedding;
mod energy;
mod hierarchy;
mod kernel;
mod locate;
mod moebius;
mod newton;
mod progressive;
mod relax;
mod rest;
mod spherical_map;

pub use certificate::{Certificate, certify};
pub use embedding::{SphereEnergy, SphereOptions, SpherePhase, SphereReport, SphereStart, map_to_sphere};
#[cfg(test)]
pub(crate) use energy::tangents;
pub(crate) use energy::{Element, Energy, Hessian, Objective, Pull, Weights, semidefinite};
pub(crate) use hierarchy::Hierarchy;
pub(crate) use kernel::{det, positive_det};
pub use locate::Locator;
pub(crate) use moebius::Moebius;
pub(crate) use newton::{Newton, NewtonError, NewtonOptions};
pub(crate) use progressive::Drawing;
pub(crate) use relax::{Relaxation, newton_step};
pub(crate) use rest::{Rest, RestShapes};
pub(crate) use spherical_map::require_scale;
pub use spherical_map::{SphericalError, SphericalMap, require_sphere};

/// Surfaces on the sphere, for tests.
#[cfg(test)]
pub(crate) mod testing {
    use super::SphericalMap;
    use crate::mesh::SurfaceMesh;
    use crate::{Point, Vector};

    /// A surface that is star-shaped about the origin, each vertex in its own direction.
    pub fn drawn_by_rays(surface: SurfaceMesh) -> SphericalMap {
        let directions: Vec<Vector> = surface.vertices().iter().map(|p| p.coords.normalize()).collect();
        SphericalMap::new(surface, &directions).unwrap()
    }

    /// A spindle of even triangles, whose rings of `around` vertices are drawn as conformal maps draw a protrusion: ever
    /// nearer to the poles, at polar angles down to `2 · 10^-power`.
    pub fn graded(power: f64, around: usize) -> SphericalMap {
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
        SphericalMap::new(SurfaceMesh::new(vertices, triangles).unwrap(), &directions).unwrap()
    }
}

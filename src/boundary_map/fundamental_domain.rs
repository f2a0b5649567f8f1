//! A surface with handles laid out in the plane: in a polygon whose sides are glued in pairs.
//!
//! A surface of genus 1 maps to the Euclidean plane, in which translations by two periods leave it as it is, and surfaces of more
//! handles to the hyperbolic plane, drawn in Poincaré's disk, which keeps angles. One copy of every triangle is in the polygon, or has its
//! middle there: triangles across a side stick out, as they are needed on the side that it is glued to.

use crate::hyperbolic::{HyperbolicEmbedding, HyperbolicError};
use crate::mesh::SurfaceMesh;
use crate::spherical::{SphericalError, genus};
use crate::toroidal::{Periods, TORUS_AREA, ToroidalError, TorusSurface};
use crate::{Point, Vector};

/// A surface laid out in a polygon of the plane, one to one.
#[derive(Debug, Clone, PartialEq)]
pub struct FundamentalDomain {
    /// The surface, facing outward.
    pub surface: SurfaceMesh,
    /// Its handles.
    pub genus: u64,
    /// The corners of each of its triangles, counter-clockwise: in the plane, with the area 1 for all, or in the unit disk.
    pub triangles: Vec<[[f64; 2]; 3]>,
    /// The sides of the polygon, counter-clockwise, each as points from its beginning to its end: four, or four for each handle.
    pub sides: Vec<Vec<[f64; 2]>>,
}

/// Why a surface is not laid out in the plane.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum FundamentalDomainError {
    /// The surface is not one closed manifold.
    #[error(transparent)]
    Surface(SphericalError),
    /// Surfaces without handles have no such polygon.
    #[error("it has no handle: its canonical surface is the sphere (`solidmap boundary sphere`)")]
    NoHandle,
    /// As of surfaces of genus 1.
    #[error(transparent)]
    Toroidal(ToroidalError),
    /// As of surfaces of more handles.
    #[error(transparent)]
    Hyperbolic(HyperbolicError),
}

/// Points along a side of a hyperbolic polygon.
const SIDE_POINTS: usize = 32;

/// Lays out a surface of genus 1 or more, for low distortion of angles, and of areas where that costs little. A second for 10 000
/// vertices.
///
/// # Errors
///
/// As of [`FundamentalDomainError`].
pub fn fundamental_domain(surface: &SurfaceMesh) -> Result<FundamentalDomain, FundamentalDomainError> {
    match genus(surface).map_err(FundamentalDomainError::Surface)? {
        0 => Err(FundamentalDomainError::NoHandle),
        1 => in_parallelogram(surface).map_err(FundamentalDomainError::Toroidal),
        genus => in_hyperbolic_polygon(surface, genus).map_err(FundamentalDomainError::Hyperbolic),
    }
}

fn in_parallelogram(surface: &SurfaceMesh) -> Result<FundamentalDomain, ToroidalError> {
    let torus = TorusSurface::new(surface)?;
    let (_, layout) = torus.layouts(usize::MAX)?;
    let embedding = torus.embedded(&layout)?;
    let (periods, times) = Periods::of_embedding(&embedding).upright();
    // The same point in units of the new periods: u a + v b = (u − v times) a + v (b + times a).
    let upright = |x: Vector| Vector::new(x.x - times * x.y, x.y, x.z);
    // The first period along the first axis.
    let first = periods.translation([1, 0]).normalize() / TORUS_AREA.sqrt();
    let place = |x: [f64; 2]| {
        let p = periods.place(x);
        [first.x * p.x + first.y * p.y, first.x * p.y - first.y * p.x]
    };
    let triangle = |t: usize| {
        let corners = embedding.corners(t).map(upright);
        let middle: Vector = corners.iter().sum::<Vector>() / 3.0;
        corners.map(|x| place([x.x - middle.x.floor(), x.y - middle.y.floor()]))
    };
    let corners = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]].map(place);
    Ok(FundamentalDomain {
        surface: embedding.surface().clone(),
        genus: 1,
        triangles: (0..embedding.surface().triangles().len()).map(triangle).collect(),
        sides: (0..4).map(|k| vec![corners[k], corners[(k + 1) % 4]]).collect(),
    })
}

fn in_hyperbolic_polygon(surface: &SurfaceMesh, genus: u64) -> Result<FundamentalDomain, HyperbolicError> {
    let embedding = HyperbolicEmbedding::of_surface(surface)?;
    let triangles = (0..embedding.surface().triangles().len()).map(|t| embedding.triangle_in_polygon(t).map(in_disk));
    let corners = embedding.group().corners();
    let side = |k: usize| {
        let (from, to) = (corners[k], corners[(k + 1) % corners.len()]);
        let at = |i: usize| {
            let share = i as f64 / SIDE_POINTS as f64;
            in_disk(from * (1.0 - share) + to * share)
        };
        (0..=SIDE_POINTS).map(at).collect()
    };
    Ok(FundamentalDomain {
        genus,
        triangles: triangles.collect(),
        sides: (0..corners.len()).map(side).collect(),
        surface: embedding.surface().clone(),
    })
}

/// The point of Poincaré's disk on the ray to a point within the light cone.
fn in_disk(x: Vector) -> [f64; 2] {
    let length = (x.z * x.z - x.x * x.x - x.y * x.y).sqrt();
    [x.x, x.y].map(|c| c / (length + x.z))
}

impl FundamentalDomain {
    /// The layout as a mesh in the plane, its triangles in the order of the surface's, and for each of its vertices that of the
    /// surface that it is a copy of. Vertices at the sides have several copies.
    pub fn mesh(&self) -> (SurfaceMesh, Vec<u32>) {
        let mut of_place = std::collections::HashMap::new();
        let (mut vertices, mut origins) = (vec![], vec![]);
        let mut corner = |v: u32, p: [f64; 2]| {
            // Copies are far apart, and triangles around a copy agree on its place up to rounding.
            let key = (v, p.map(|c| (c * 1e6).round() as i64));
            *of_place.entry(key).or_insert_with(|| {
                vertices.push(Point::new(p[0], p[1], 0.0));
                origins.push(v);
                vertices.len() as u32 - 1
            })
        };
        let triangles = self.surface.triangles().iter().zip(&self.triangles);
        let triangles: Vec<[u32; 3]> = triangles
            .map(|(t, places)| [0, 1, 2].map(|k| corner(t[k], places[k])))
            .collect();
        let mesh = SurfaceMesh::new(vertices, triangles).expect("corners are vertices");
        (mesh, origins)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::shapes;

    fn area([a, b, c]: &[[f64; 2]; 3]) -> f64 {
        0.5 * ((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))
    }

    #[test]
    fn a_ring_fills_a_parallelogram_once() {
        let ring = shapes::torus(2.0, 0.8, 40, 20);
        let found = fundamental_domain(&ring).unwrap();
        assert_eq!((found.genus, found.sides.len(), found.triangles.len()), (1, 4, 1600));
        assert!(found.triangles.iter().all(|t| area(t) > 0.0));
        let total: f64 = found.triangles.iter().map(area).sum();
        assert!((total - 1.0).abs() < 1e-9, "{total}");
        // √(ρ² − 1) times as high as wide, and upright.
        let [_, right, top] = [0, 1, 2].map(|k| found.sides[k][0]);
        assert!((top[1] / right[0] / (2.5f64.powi(2) - 1.0).sqrt() - 1.0).abs() < 0.1);
        assert!((top[0] - right[0]).abs() < 0.02 * right[0]);
        // However long it is.
        let thin = fundamental_domain(&shapes::torus(20.0, 1.0, 160, 12)).unwrap();
        let [_, right, top] = [0, 1, 2].map(|k| thin.sides[k][0]);
        assert!((top[0] - right[0]).abs() <= 0.501 * right[0], "{:?}", thin.sides);
        assert!(thin.triangles.iter().all(|t| area(t) > 0.0));
        let total: f64 = thin.triangles.iter().map(area).sum();
        assert!((total - 1.0).abs() < 1e-9, "{total}");
        // Cut open, it is a disk: one vertex more than edges and triangles say, with copies along the cut.
        let (mesh, origins) = found.mesh();
        assert!(mesh.vertices().len() > ring.vertices().len() && mesh.vertices().len() < 1200);
        assert_eq!(origins.iter().max(), Some(&799));
        for (t, own) in mesh.triangles().iter().zip(found.surface.triangles()) {
            assert_eq!(t.map(|v| origins[v as usize]), *own);
        }
    }

    #[test]
    fn a_double_torus_fills_an_octagon_of_the_disk_once() {
        let surface = shapes::double_torus(2);
        let found = fundamental_domain(&surface).unwrap();
        assert_eq!((found.genus, found.sides.len()), (2, 8));
        assert!(found.triangles.iter().all(|t| area(t) > 0.0));
        let inside = found.triangles.iter().flatten();
        assert!(inside.clone().all(|[x, y]| x.hypot(*y) < 1.0));
        // Hyperbolic areas, (2 / (1 − |p|²))² per area of the disk, add up to 4π: to the size of the triangles.
        let density = |t: &[[f64; 2]; 3]| {
            let [x, y] = [0, 1].map(|k| t.iter().map(|p| p[k]).sum::<f64>() / 3.0);
            (2.0 / (1.0 - x * x - y * y)).powi(2)
        };
        let total: f64 = found.triangles.iter().map(|t| area(t) * density(t)).sum();
        assert!((total / (4.0 * std::f64::consts::PI) - 1.0).abs() < 0.05, "{total}");
        // Sides are as long as each other, and meet at π/4.
        for k in 0..8 {
            let (own, next) = (&found.sides[k], &found.sides[(k + 1) % 8]);
            assert!((0..2).all(|c| (own[SIDE_POINTS][c] - next[0][c]).abs() < 1e-12));
            let [p, q] = [own[0], own[SIDE_POINTS]].map(|p| p[0].hypot(p[1]));
            assert!((p - q).abs() < 1e-12);
        }
    }

    #[test]
    fn a_ball_has_none() {
        let error = fundamental_domain(&shapes::sphere(1.0, 1)).unwrap_err();
        assert_eq!(error, FundamentalDomainError::NoHandle);
    }
}

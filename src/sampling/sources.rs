//! Where the sources stand: near the surface at a distance that follows the local spacing (the default), evenly on an
//! offset surface, or on a bounding sphere (the paper's two choices, section 4.5 and figure 4).

use rayon::prelude::*;

use super::collocation::Collocation;
use super::farthest_point::{Anchors, thin};
use crate::Point;
use crate::mesh::SurfaceMesh;

/// A source that cannot reach this fraction of its intended distance is dropped: so near the surface, its field is a
/// spike that no collocation point sees.
const LEAST_DISTANCE: f64 = 0.15;
/// Factor by which a blocked source steps back towards the surface.
const STEP_BACK: f64 = 0.7;
/// A source at distance `d` along the normal must be at least this part of `d` away from the whole surface.
const CLEARANCE: f64 = 0.7;

/// Sources, and how many of those asked for found no place.
#[derive(Debug, Clone, PartialEq)]
pub struct PlacedSources {
    /// Positions outside the solid.
    pub positions: Vec<Point>,
    /// Anchors left without a source, as in a gap narrower than the spacing.
    pub dropped: usize,
}

/// One source per anchor at `alpha` times its spacing along the outward normal, stepped back where another part of the
/// surface is near, so that every source is outside: also in thin gaps, and inside cavities, whose surface faces into
/// them.
///
/// `signed_distance` is that to the surface, negative inside. Costs one to a dozen distance queries per anchor.
pub fn adaptive_sources(
    domain: &SurfaceMesh,
    anchors: &Anchors,
    alpha: f64,
    signed_distance: &(dyn Fn(&Point) -> f64 + Sync),
) -> PlacedSources {
    let placed: Vec<Option<Point>> = (0..anchors.vertices.len())
        .into_par_iter()
        .map(|k| {
            let anchor = domain.vertices()[anchors.vertices[k] as usize];
            let intended = alpha * anchors.spacing[k];
            let mut distance = intended;
            while distance >= LEAST_DISTANCE * intended {
                let source = anchor + anchors.normals[k] * distance;
                if signed_distance(&source) >= CLEARANCE * distance {
                    return Some(source);
                }
                distance *= STEP_BACK;
            }
            None
        })
        .collect();
    let dropped = placed.iter().filter(|p| p.is_none()).count();
    PlacedSources {
        positions: placed.into_iter().flatten().collect(),
        dropped,
    }
}

/// `count` points spread evenly over a surface by area, such as an offset surface: the well-spread ones of eight times
/// as many random points.
pub fn even_points(surface: &SurfaceMesh, count: usize, seed: u64) -> Vec<Point> {
    let candidates: Vec<Point> = Collocation::even(surface, 8 * count, seed)
        .points
        .iter()
        .map(|p| p.position(surface, surface.vertices()))
        .collect();
    thin(&candidates, count).into_iter().map(|k| candidates[k]).collect()
}

/// `count` points spread evenly on a sphere (a spherical Fibonacci lattice; González, *Measurement of areas on a sphere
/// using Fibonacci and latitude–longitude lattices*, Math. Geosci. 42, 2010).
pub fn bounding_sphere(centre: Point, radius: f64, count: usize) -> Vec<Point> {
    let turn = std::f64::consts::PI * (3.0 - 5f64.sqrt());
    (0..count)
        .map(|k| {
            let z = 1.0 - (2 * k + 1) as f64 / count as f64;
            let (sine, cosine) = (turn * k as f64).sin_cos();
            let r = (1.0 - z * z).sqrt();
            centre + radius * crate::Vector::new(r * cosine, r * sine, z)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::shapes;

    /// Distance to the slab `|z| < 0.1` under the ball of radius 1 about `(0, 0, 1.15)`: a gap of 0.05 at the nearest.
    fn ball_over_slab(p: &Point) -> f64 {
        ((p - Point::new(0.0, 0.0, 1.15)).norm() - 1.0).min(p.z.abs() - 0.1)
    }

    #[test]
    fn sources_step_back_in_a_narrow_gap_and_stay_outside() {
        let ball = shapes::deformed(&shapes::sphere(1.0, 3), |p| p + crate::Vector::z() * 1.15);
        let anchors = Anchors::choose(&ball, usize::MAX);
        let placed = adaptive_sources(&ball, &anchors, 1.0, &ball_over_slab);
        assert_eq!(placed.dropped, 0);
        assert!(placed.positions.iter().all(|p| ball_over_slab(p) > 0.0));
        let free = placed.positions.iter().filter(|p| p.z > 1.0);
        let spacing = (ball.area() / 642.0).sqrt();
        assert!(free.clone().count() > 300);
        for p in free {
            assert!((ball_over_slab(p) / spacing - 1.0).abs() < 0.25);
        }
    }

    #[test]
    fn an_anchor_without_room_is_dropped() {
        let ball = shapes::sphere(1.0, 2);
        let anchors = Anchors::choose(&ball, usize::MAX);
        let placed = adaptive_sources(&ball, &anchors, 1.0, &|p| {
            if p.z > 0.0 { -1.0 } else { p.coords.norm() - 1.0 }
        });
        assert!(placed.dropped > 60 && placed.positions.len() + placed.dropped == 162);
    }

    #[test]
    fn even_points_lie_on_the_surface_and_do_not_crowd() {
        let torus = shapes::torus(1.0, 0.4, 60, 30);
        let points = even_points(&torus, 200, 5);
        assert_eq!(points.len(), 200);
        let spacing = (torus.area() / 200.0).sqrt();
        for (i, p) in points.iter().enumerate() {
            let nearest = points
                .iter()
                .enumerate()
                .filter(|(j, _)| *j != i)
                .map(|(_, q)| (p - q).norm());
            assert!(nearest.fold(f64::INFINITY, f64::min) > 0.5 * spacing);
        }
    }

    #[test]
    fn sphere_points_balance() {
        let centre = Point::new(1.0, 2.0, 3.0);
        let points = bounding_sphere(centre, 2.0, 500);
        assert!(points.iter().all(|p| ((p - centre).norm() - 2.0).abs() < 1e-14));
        let mean = points.iter().map(|p| p - centre).sum::<crate::Vector>() / 500.0;
        assert!(mean.norm() < 0.01);
    }
}

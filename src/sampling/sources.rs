//! Where the sources are placed: near the surface at a distance that follows the local spacing (the default), evenly on
//! an offset surface, or on a bounding sphere (the paper's two choices, section 4.5 and figure 4).

use super::collocation::Collocation;
use super::farthest_point::{Anchors, thin};
use crate::mesh::SurfaceMesh;
use crate::{Point, Vector};

/// A source that has no room at this fraction of its distance is dropped: nearer to the surface, its field would peak
/// between the collocation points.
const MIN_DISTANCE: f64 = 0.15;
/// Factor by which a blocked source steps back towards the surface.
const STEP_BACK: f64 = 0.7;
/// A source placed at distance `d` along the normal must be at least this fraction of `d` away from the whole surface.
const CLEARANCE: f64 = 0.7;

/// A point of the surface at which a source is to be placed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SourceSite {
    /// The point of the surface.
    pub position: Point,
    /// Unit outward normal there.
    pub normal: Vector,
    /// Local spacing of the sources.
    pub spacing: f64,
}

/// Sources, and the number of sites where there was no room for one.
#[derive(Debug, Clone, PartialEq)]
pub struct PlacedSources {
    /// Positions outside the solid.
    pub positions: Vec<Point>,
    /// Index of the site or anchor of each source, ascending.
    pub sites: Vec<u32>,
    /// Sites left without a source, as in a gap narrower than the spacing.
    pub dropped: usize,
}

/// Whether each ball, by centre and radius, lies outside the solid and clear of its surface:
/// [`crate::geometry::SurfaceQuery::are_outside`].
pub type AreOutside<'a> = dyn Fn(&[(Point, f64)]) -> Vec<bool> + 'a;

/// One source per anchor, placed as [`place_sources`] does.
pub fn adaptive_sources(
    domain: &SurfaceMesh,
    anchors: &Anchors,
    alpha: f64,
    are_outside: &AreOutside,
) -> PlacedSources {
    place_sources(&anchors.sites(domain), alpha, are_outside)
}

/// One source per site at `alpha` times its spacing along the outward normal, stepped back where another part of the
/// surface is near, so that every source is outside: also in thin gaps, and inside cavities, whose surface faces into
/// them.
///
/// Costs one query per site, and up to five more for those that are blocked.
pub fn place_sources(sites: &[SourceSite], alpha: f64, are_outside: &AreOutside) -> PlacedSources {
    let mut placed: Vec<Option<Point>> = vec![None; sites.len()];
    let mut waiting: Vec<usize> = (0..sites.len()).collect();
    let mut fraction = 1.0;
    while fraction >= MIN_DISTANCE && !waiting.is_empty() {
        let ball = |&k: &usize| {
            let distance = fraction * alpha * sites[k].spacing;
            (sites[k].position + sites[k].normal * distance, CLEARANCE * distance)
        };
        let balls: Vec<(Point, f64)> = waiting.iter().map(ball).collect();
        let outside = are_outside(&balls);
        for ((&k, &(centre, _)), is_outside) in waiting.iter().zip(&balls).zip(outside) {
            placed[k] = is_outside.then_some(centre);
        }
        waiting.retain(|&k| placed[k].is_none());
        fraction *= STEP_BACK;
    }
    let placed = placed.into_iter().enumerate();
    let (sites, positions) = placed.filter_map(|(k, source)| Some((k as u32, source?))).unzip();
    PlacedSources {
        positions,
        sites,
        dropped: waiting.len(),
    }
}

/// `count` points spread evenly by area over a surface, such as an offset surface: chosen from eight times as many
/// random points by farthest-point selection.
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
            centre + radius * Vector::new(r * cosine, r * sine, z)
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

    fn clear_by(balls: &[(Point, f64)], signed_distance: impl Fn(&Point) -> f64) -> Vec<bool> {
        balls.iter().map(|(p, radius)| signed_distance(p) >= *radius).collect()
    }

    #[test]
    fn sources_step_back_in_a_narrow_gap_and_stay_outside() {
        let ball = shapes::deformed(&shapes::sphere(1.0, 3), |p| p + Vector::z() * 1.15);
        let anchors = Anchors::choose(&ball, usize::MAX);
        let placed = adaptive_sources(&ball, &anchors, 1.0, &|balls| clear_by(balls, ball_over_slab));
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
        let solid = |p: &Point| if p.z > 0.0 { -1.0 } else { p.coords.norm() - 1.0 };
        let placed = adaptive_sources(&ball, &anchors, 1.0, &|balls| clear_by(balls, solid));
        assert!(placed.dropped > 60 && placed.positions.len() + placed.dropped == 162);
        for (source, &site) in placed.positions.iter().zip(&placed.sites) {
            let normal = anchors.normals[site as usize];
            let anchor = ball.vertices()[anchors.vertices[site as usize] as usize];
            assert!((source - anchor).cross(&normal).norm() < 1e-14);
        }
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
        let mean = points.iter().map(|p| p - centre).sum::<Vector>() / 500.0;
        assert!(mean.norm() < 0.01);
    }
}

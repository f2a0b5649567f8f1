//! Where a boundary map is worst: groups of triangles of the domain.

use super::findings::Measurements;
use crate::Point;
use crate::boundary_map::triangle_distortions;
use crate::mesh::{SurfaceMesh, triangle_area};
use crate::statistics::weighted_quantiles;
use crate::worst_places::{LARGE, PlaceKind, WorstPlace, listed, of_triangles};

impl Measurements<'_> {
    /// Triangles that face the wrong way, that have no area in the image, that pass through others, and that are distorted
    /// most, the largest group of each first. Distortion is that of the map that takes the vertices of a surface, the
    /// domain or a subdivision of it, to `image`.
    pub fn worst_places(&self, (surface, image): (&SurfaceMesh, &[Point]), most: usize) -> Vec<WorstPlace> {
        let (domain, area) = (self.domain, self.domain.area());
        let defects = |kind, triangles: Vec<u32>| {
            let bad: Vec<(u32, f64)> = triangles.into_iter().map(|t| (t, f64::NAN)).collect();
            of_triangles(kind, |t| domain.corners(t as usize), domain.triangles(), &bad, area)
        };
        let mut crossing = self.crossing.concat();
        crossing.sort_unstable();
        crossing.dedup();
        listed(
            [
                defects(PlaceKind::Flipped, self.covering.facing_wrong_way()),
                defects(PlaceKind::Degenerate, self.covering.degenerate.clone()),
                defects(PlaceKind::SelfIntersecting, crossing),
                most_distorted(surface, image),
            ],
            most,
        )
    }
}

/// Where the symmetric Dirichlet energy exceeds what 99 % of the area does not.
fn most_distorted(surface: &SurfaceMesh, image: &[Point]) -> Vec<WorstPlace> {
    let Some(distortions) = triangle_distortions(surface, image) else {
        return vec![];
    };
    let values: Vec<f64> = distortions
        .iter()
        .map(|of_triangle| {
            of_triangle
                .as_ref()
                .map_or(f64::NAN, |found| found.symmetric_dirichlet())
        })
        .collect();
    let corners = |t: u32| surface.corners(t as usize);
    let areas: Vec<f64> = (0..values.len() as u32).map(|t| triangle_area(&corners(t))).collect();
    let Some([large]) = weighted_quantiles(&values, &areas, [LARGE]) else {
        return vec![];
    };
    // Equal up to rounding is not worse.
    let large = large * (1.0 + 1e-9);
    let bad = (0..).zip(&values).filter(|(_, value)| **value > large);
    let bad: Vec<(u32, f64)> = bad.map(|(t, value)| (t, *value)).collect();
    of_triangles(
        PlaceKind::Distortion,
        corners,
        surface.triangles(),
        &bad,
        surface.area(),
    )
}

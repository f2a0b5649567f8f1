//! How much of a surface a map stretches or compresses so far that it is probably wrong.
//!
//! Maps that take limbs to other limbs, or turn about a limb, stretch a part of the surface by more than bodies of one kind
//! differ. The limit is from maps whose correspondence is known: see `docs/boundary_maps.md`.

use serde::Serialize;

use super::super::BoundaryMap;
use super::super::distortion::triangle_distortions;
use crate::mesh::triangle_area;
use crate::worst_places::{PlaceKind, WorstPlace, of_triangles};

/// The share of the domain's area that is stretched or compressed too far, and where.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Stretch {
    /// Lengths that change by more than this factor count, beside the ratio of the sizes of the solids.
    pub factor: f64,
    /// The share of the domain's area where they do.
    pub share: f64,
    /// The share from which the map counts as wrong.
    pub limit: f64,
    /// Where, the largest area first.
    pub places: Vec<WorstPlace>,
}

/// The default of [`PairOptions::most_stretched`](super::PairOptions::most_stretched).
pub(super) const MOST_STRETCHED: f64 = 0.0075;
/// See [`Stretch::factor`].
const FACTOR: f64 = 10.0;
/// Places that are listed.
const MOST_PLACES: usize = 5;

impl Stretch {
    /// Measures the map itself, over triangles cut into four. `None` without area.
    pub(super) fn of(map: &BoundaryMap, limit: f64) -> Option<Self> {
        let fine = map.subdivided();
        let surface = fine.domain();
        let distortions = triangle_distortions(surface, fine.image())?;
        let corners = |t: u32| surface.corners(t as usize);
        let area = |t: u32| triangle_area(&corners(t));
        let total: f64 = (0..distortions.len() as u32).map(area).sum();
        let stretched = distortions.iter().zip(0..).filter_map(|(found, t)| {
            let [largest, least] = found.as_ref()?.stretches;
            Some((t, largest.max(1.0 / least)))
        });
        let far: Vec<(u32, f64)> = stretched.filter(|(_, stretch)| *stretch > FACTOR).collect();
        // The sum of no areas is -0.
        let share = (0.0 + far.iter().map(|(t, _)| area(*t)).sum::<f64>()) / total;
        let mut places = of_triangles(PlaceKind::Stretched, corners, surface.triangles(), &far, total);
        places.truncate(MOST_PLACES);
        Some(Self {
            factor: FACTOR,
            share,
            limit,
            places,
        })
    }

    /// Whether more than the limit is stretched too far.
    pub fn looks_wrong(&self) -> bool {
        self.share > self.limit
    }
}

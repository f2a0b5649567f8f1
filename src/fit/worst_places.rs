//! Where a map misses its boundary map most.

use rayon::prelude::*;

use crate::boundary_map::BoundaryMap;
use crate::map::{HarmonicMap, VolumeMap};
use crate::mesh::{SurfacePoint, triangle_area};
use crate::statistics::{Summary, weighted_quantiles};
use crate::worst_places::{LARGE, PlaceKind, WorstPlace, listed, of_triangles};

/// Centres at which the error is measured first.
const PROBES: usize = 200;
/// Relative error of the sums as a fraction of the map's own error, and its largest.
const PART_OF_ERROR: f64 = 0.03;
const MAX_SUM_ERROR: f64 = 1e-4;

/// The connected groups of triangles of the domain at whose centres the boundary error exceeds what it does not on 99 % of
/// the area, the largest error first; at most `most`.
///
/// Takes the values of both maps at all centres, the map's no more accurate than its error asks for: a fifth of the time
/// of a fit without refinement.
pub fn worst_places(map: &HarmonicMap, boundary: &BoundaryMap, most: usize) -> Vec<WorstPlace> {
    let (domain, diagonal) = (boundary.domain(), boundary.target_diagonal());
    let centres: Vec<SurfacePoint> = (0..domain.triangles().len() as u32)
        .map(|triangle| SurfacePoint {
            triangle,
            barycentric: [1.0 / 3.0; 3],
        })
        .collect();
    let errors_at = |map: &HarmonicMap, places: &[SurfacePoint]| -> Vec<f64> {
        let values = map.evaluate(&boundary.positions(places));
        let pairs = values.into_iter().zip(boundary.evaluate(places));
        pairs.map(|(value, exact)| (value - exact).norm() / diagonal).collect()
    };
    let some: Vec<SurfacePoint> = centres
        .iter()
        .step_by(centres.len().div_ceil(PROBES).max(1))
        .copied()
        .collect();
    let Some(probed) = Summary::of(&errors_at(map, &some)) else {
        return vec![];
    };
    let accuracy = (PART_OF_ERROR * probed.rms).min(MAX_SUM_ERROR);
    let errors = errors_at(&map.clone().with_accuracy_at_most(accuracy), &centres);
    let areas: Vec<f64> = (0..errors.len())
        .into_par_iter()
        .map(|t| triangle_area(&domain.corners(t)))
        .collect();
    let Some([large]) = weighted_quantiles(&errors, &areas, [LARGE]) else {
        return vec![];
    };
    let bad = (0..).zip(&errors).filter(|(_, error)| **error > large);
    let bad: Vec<(u32, f64)> = bad.map(|(t, error)| (t, *error)).collect();
    let corners = |t: u32| domain.corners(t as usize);
    let found = of_triangles(
        PlaceKind::BoundaryError,
        corners,
        domain.triangles(),
        &bad,
        domain.area(),
    );
    listed([found], most)
}

//! Where a map misses its boundary map most.

use rayon::prelude::*;

use super::Fit;
use crate::boundary_map::BoundaryMap;
use crate::map::{HarmonicMap, VolumeMap};
use crate::mesh::{SurfaceMesh, SurfacePoint, triangle_area};
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
    groups(domain, PlaceKind::BoundaryError, &errors, most)
}

impl Fit {
    /// As [`worst_places`], by the largest error at the held-out points in each triangle, which the fit has measured: takes
    /// a few milliseconds. In a domain of more than 100 000 triangles some have no such point, and count as exact. Where errors
    /// exceed the spacing of the image around, up to half of the places are those.
    pub fn worst_places(&self, most: usize) -> Vec<WorstPlace> {
        let domain = self.boundary.domain();
        let mut errors = vec![0.0f64; domain.triangles().len()];
        let mut local_errors = errors.clone();
        let largest = |of: &mut [f64], values: &[f64]| {
            for (point, &error) in self.held_out.points.iter().zip(values) {
                let largest = &mut of[point.triangle as usize];
                *largest = largest.max(error);
            }
        };
        largest(&mut errors, &self.held_out.errors);
        largest(&mut local_errors, &self.held_out.local_errors);
        let mut places = groups(domain, PlaceKind::BoundaryError, &errors, most);
        // Smaller ones are no fault.
        let mut local = groups(domain, PlaceKind::LocalError, &local_errors, most);
        local.retain(|place| place.value > Some(1.0));
        let shown = (most / 2).min(local.len());
        places.truncate(most.saturating_sub(shown).max(1).min(most));
        listed([places, local], most)
    }
}

/// The groups of triangles with the largest errors, of which each triangle has one.
fn groups(domain: &SurfaceMesh, kind: PlaceKind, errors: &[f64], most: usize) -> Vec<WorstPlace> {
    let areas: Vec<f64> = (0..errors.len())
        .into_par_iter()
        .map(|t| triangle_area(&domain.corners(t)))
        .collect();
    let Some([large]) = weighted_quantiles(errors, &areas, [LARGE]) else {
        return vec![];
    };
    let bad = (0..).zip(errors).filter(|(_, error)| **error > large);
    let bad: Vec<(u32, f64)> = bad.map(|(t, error)| (t, *error)).collect();
    let corners = |t: u32| domain.corners(t as usize);
    let found = of_triangles(kind, corners, domain.triangles(), &bad, domain.area());
    listed([found], most)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fit::{FitOptions, fit};
    use crate::mesh::shapes;

    #[test]
    fn held_out_errors_show_the_places_that_errors_at_all_centres_show() {
        // A ball with a dent that its sources cannot follow.
        let domain = shapes::sphere(1.0, 4);
        let dented = |p: &crate::Point| {
            let near = (p - crate::Point::new(0.0, 0.6, 0.8)).norm_squared();
            crate::Point::from(p.coords * (1.0 - 0.1 * (-near / 0.01).exp()))
        };
        let image = domain.vertices().iter().map(dented).collect();
        let boundary = BoundaryMap::new(domain, image).unwrap();
        let options = FitOptions {
            refine: false,
            ..FitOptions::default()
        };
        let fit = fit(&boundary, &options, &|_| ()).unwrap();
        let [measured, all] = [fit.worst_places(5), worst_places(&fit.map, &fit.boundary, 5)];
        for places in [&measured, &all] {
            let [x, y, z] = places[0].point;
            assert!(
                (x * x + (y - 0.6).powi(2) + (z - 0.8).powi(2)).sqrt() < 0.3,
                "{places:?}"
            );
            assert!((1..=5).contains(&places.len()));
        }
        // The largest of several points in a triangle is above that at its centre.
        let [measured, all] = [measured, all].map(|places| places[0].value.unwrap());
        assert!((0.5 * all..4.0 * all).contains(&measured), "{measured} {all}");
        assert!(measured <= 1.001 * fit.report.boundary_error.max);
    }
}

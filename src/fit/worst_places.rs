//! Where a map misses its boundary map most.

use rayon::prelude::*;

use crate::boundary_map::BoundaryMap;
use crate::map::VolumeMap;
use crate::mesh::{SurfacePoint, triangle_area};
use crate::statistics::weighted_quantiles;
use crate::worst_places::{LARGE, PlaceKind, WorstPlace, listed, of_triangles};

/// The connected groups of triangles of the domain at whose centres the boundary error exceeds what it does not on 99 % of
/// the area, the largest error first; at most `most`.
///
/// Values of the map and the boundary map at all centres: some percent of the time of a fit.
pub fn worst_places(map: &dyn VolumeMap, boundary: &BoundaryMap, most: usize) -> Vec<WorstPlace> {
    let (domain, diagonal) = (boundary.domain(), boundary.target_diagonal());
    let centres: Vec<SurfacePoint> = (0..domain.triangles().len() as u32)
        .map(|triangle| SurfacePoint {
            triangle,
            barycentric: [1.0 / 3.0; 3],
        })
        .collect();
    let positions = boundary.positions(&centres);
    let values = map.evaluate(&positions).into_iter().zip(boundary.evaluate(&centres));
    let errors: Vec<f64> = values.map(|(value, exact)| (value - exact).norm() / diagonal).collect();
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

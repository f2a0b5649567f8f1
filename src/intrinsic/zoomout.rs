//! Maps refined from few eigenfunctions to many, in both directions.
//!
//! Melzi, Ren, Rodolà, Sharma, Wonka, Ovsjanikov, *ZoomOut: spectral upsampling for efficient shape correspondence*, ACM
//! Trans. Graph. 38 (2019). The matrices are fitted to samples, as there.

use super::IntrinsicShape;
use super::functional_map::{MODES, fit, images_of_samples, mapped, nearest_vertices};
use super::spectral::descend;
use nalgebra::DMatrix;
use rayon::prelude::*;

/// Modes that each step adds.
const STEP: usize = 5;
/// Forward-backward distance, as a fraction of the diagonal, at which the weight of a vertex is 1/e.
const TRUSTED: f64 = 0.05;
/// Vertices of lower weight have no target.
const LEAST_WEIGHT: f64 = 0.01;

/// For each vertex of the domain, before simplification, a vertex of the target and its weight in (0, 1]: how well the
/// map back agrees there. `images` are vertices of the target's simplified surface, one for each sample of the domain. `None` when `proceed` says no or the samples do not determine a map.
pub(super) fn refined(
    domain: &IntrinsicShape,
    target: &IntrinsicShape,
    images: &[u32],
    proceed: &(dyn Fn() -> bool + Sync),
) -> Option<Vec<Option<(u32, f64)>>> {
    let modes = MODES.min(domain.modes()).min(target.modes());
    let matrix = fit(domain, target, images, modes)?;
    let back = images_of_samples(target, domain, &matrix.transpose());
    let forward = zoomed(domain, target, images, proceed)?;
    let backward = zoomed(target, domain, &back, proceed)?;
    let queries = mapped(domain.all_rows(forward.nrows()), &forward);
    let there = nearest_vertices(&queries, target);
    let back = nearest_vertices(&mapped(target.all_rows(backward.nrows()), &backward), domain);
    let points = &domain.simplified.points;
    let weight = |v: usize| {
        let returned = back[there[v] as usize];
        let distance = (points[returned as usize] - points[v]).norm() / domain.diagonal;
        (-(distance / TRUSTED).powi(2)).exp()
    };
    let weights: Vec<f64> = (0..points.len()).map(weight).collect();
    let of_original = |v: u32| {
        let nearest = domain.simplified.nearest(v);
        let weight = weights[nearest as usize];
        let image = image_of_original(domain, target, &queries, v, there[nearest as usize]);
        (weight >= LEAST_WEIGHT).then(|| (target.simplified.originals[image as usize], weight))
    };
    Some(
        (0..domain.simplified.places.len() as u32)
            .into_par_iter()
            .map(of_original)
            .collect(),
    )
}

/// The functional map of the most modes.
fn zoomed(
    from: &IntrinsicShape,
    to: &IntrinsicShape,
    images: &[u32],
    proceed: &(dyn Fn() -> bool + Sync),
) -> Option<DMatrix<f64>> {
    let most = from.modes().min(to.modes());
    let mut modes = MODES.min(most);
    let mut matrix = fit(from, to, images, modes)?;
    while modes < most {
        if !proceed() {
            return None;
        }
        let images = images_of_samples(from, to, &matrix);
        modes = (modes + STEP).min(most);
        matrix = fit(from, to, &images, modes)?;
    }
    Some(matrix)
}

/// The image of a vertex between those of the simplified surface, near that of the nearest of them.
fn image_of_original(
    domain: &IntrinsicShape,
    target: &IntrinsicShape,
    queries: &DMatrix<f64>,
    vertex: u32,
    near: u32,
) -> u32 {
    let place = &domain.simplified.places[vertex as usize];
    if place.barycentric.contains(&1.0) {
        return near;
    }
    let corners = domain.simplified.triangles[place.triangle as usize];
    let row = |k: usize| queries.column(corners[k] as usize) * place.barycentric[k];
    let query = row(0) + row(1) + row(2);
    descend(query.as_slice(), target.all_rows(query.len()), &target.neighbours, near)
}

//! The map that all others are compared with inside: by fundamental solutions, on a finer surface.

use std::time::Instant;

use super::{CompareError, MapDifference, MapEvaluator};
use crate::boundary_map::BoundaryMap;
use crate::check;
use crate::fit::{BoundaryError, Fit, FitOptions, fit};

/// With fewer vertices, the triangles of the reference are cut into four once more.
const MOST_REFERENCE_VERTICES: usize = 25_000;

/// The reference, and how accurate it is.
#[derive(Debug, Clone, serde::Serialize, serde::Deserialize)]
pub struct Reference {
    /// What it is.
    pub description: String,
    /// At held-out points.
    pub boundary_error: BoundaryError,
    /// Difference to a reference on triangles four times as large, an estimate of the error of that one inside; its own
    /// is smaller.
    pub difference_to_coarser: MapDifference,
    /// Its sources.
    pub sources: usize,
    /// Seconds that it took.
    pub seconds: f64,
}

/// Makes the reference for a boundary map, at a tenth of the tolerance of `options`.
///
/// # Errors
///
/// When a fit fails, or its map is not finite inside.
pub fn reference(
    boundary: &BoundaryMap,
    options: &FitOptions,
    evaluator: &MapEvaluator,
    progress: &dyn Fn(String),
) -> Result<(Fit, Reference), CompareError> {
    let start = Instant::now();
    let mut coarser = boundary.clone();
    let mut parts = 4;
    if boundary.domain().vertices().len() < MOST_REFERENCE_VERTICES {
        coarser = coarser.subdivided();
        parts = 16;
    }
    progress("fitting the reference".into());
    let options = FitOptions {
        tolerance: 0.1 * options.tolerance,
        refine: false,
        ..options.clone()
    };
    let before = fit(&coarser, &options, &|_| {})?;
    let made = fit(&coarser.subdivided(), &options, &|_| {})?;
    let images = evaluator.interior_images(&made.map)?;
    let difference_to_coarser = evaluator.difference(&images, &evaluator.interior_images(&before.map)?);
    let description = format!(
        "mfs with every triangle cut into {parts}, {} sources",
        made.report.sources
    );
    let found = Reference {
        description,
        boundary_error: made.report.boundary_error,
        difference_to_coarser,
        sources: made.report.sources,
        seconds: start.elapsed().as_secs_f64(),
    };
    Ok((made, found))
}

/// The boundary map over its domain with outward faces.
///
/// # Errors
///
/// When the domain cannot be turned outward without changing what the map is given at.
pub fn outward(boundary: BoundaryMap) -> Result<BoundaryMap, crate::boundary_map::BoundaryMapError> {
    let (repaired, repairs) = check::repair(boundary.domain());
    match repairs.is_empty() {
        true => Ok(boundary),
        false => boundary.over(repaired),
    }
}

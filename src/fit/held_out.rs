//! Boundary points that the solver does not see, and the errors of maps there.

use std::sync::{Arc, OnceLock};

use rayon::prelude::*;

use super::FitError;
use super::boundary_data::BoundaryData;
use super::report::{BoundaryError, LocalError};
use super::system::{Evaluator, System, SystemSolution};
use crate::boundary_map::BoundaryMap;
use crate::map::VolumeMap;
use crate::mesh::{SurfaceMesh, SurfacePoint};
use crate::sampling;
use crate::statistics::Summary;
use crate::{Point, Vector};

/// Largest number of triangles that the largest error is taken over.
const TRIANGLES: usize = 100_000;
/// Relative error allowed in the sums that measure a map, as a fraction of the map's own error. Values are some tenths
/// of the diagonal, and the two errors add in quadrature: the measured error is off by half a percent.
const PART_OF_ERROR: f64 = 0.3;
/// Largest relative error allowed in these sums, whatever the map's error.
pub(super) const MAX_SUM_ERROR: f64 = 1e-4;

/// Distance of a map from the boundary map at points of the boundary that depend on the seed: averages over `even` points,
/// spread by area, the largest also over one in each triangle.
///
/// # Errors
///
/// [`FitError::NonFiniteMap`] when the map is not finite at one.
pub fn boundary_error(
    map: &dyn VolumeMap,
    boundary: &BoundaryMap,
    even: usize,
    seed: u64,
) -> Result<BoundaryError, FitError> {
    let held_out = HeldOut::new(boundary.domain(), even, seed);
    let (images, exact) = (map.evaluate(&held_out.positions), boundary.evaluate(&held_out.points));
    let diagonal = boundary.target_diagonal();
    let pairs = images.par_iter().zip(&exact);
    let errors: Vec<f64> = pairs.map(|(image, exact)| (image - exact).norm() / diagonal).collect();
    held_out.boundary_error(&errors)
}

/// Relative error of sums that measure maps of about this error.
pub(super) fn sum_accuracy(expected_error: f64) -> f64 {
    (PART_OF_ERROR * expected_error).min(MAX_SUM_ERROR)
}

/// Points of the boundary that are not collocation points.
pub(super) struct HeldOut {
    points: Arc<[SurfacePoint]>,
    /// The first `even` points are spread evenly by area; averages are taken over these alone.
    even: usize,
    positions: Vec<Point>,
    /// Built for the current sources when first needed, and kept for further boundary maps.
    evaluator: OnceLock<Evaluator>,
}

/// The errors of one map.
#[derive(Debug, Clone)]
pub(super) struct HeldOutErrors {
    pub points: Arc<[SurfacePoint]>,
    /// At each point, as fractions of the target's diagonal.
    pub errors: Vec<f64>,
    /// The same as multiples of the spacing of the image around; empty where images are no positions.
    pub local_errors: Vec<f64>,
}

/// What a report says of them.
type Errors = (BoundaryError, Option<LocalError>);

impl HeldOut {
    pub fn new(domain: &SurfaceMesh, even: usize, seed: u64) -> Self {
        let points = sampling::held_out(domain, even, TRIANGLES, seed);
        let position = |p: &SurfacePoint| p.position(domain, domain.vertices());
        Self {
            positions: points.par_iter().map(position).collect(),
            even: even.min(points.len()),
            points: points.into(),
            evaluator: OnceLock::new(),
        }
    }

    /// The points that are spread evenly by area, and their positions in the domain.
    pub fn even(&self) -> (&[SurfacePoint], &[Point]) {
        (&self.points[..self.even], &self.positions[..self.even])
    }

    /// To be called when sources were added.
    pub fn forget_sources(&mut self) {
        self.evaluator = OnceLock::new();
    }

    /// The errors of each map of a solution.
    pub fn errors(
        &self,
        system: &System,
        solution: &SystemSolution,
        data: &[BoundaryData],
    ) -> Result<Vec<(Errors, HeldOutErrors)>, FitError> {
        let evaluator = match self.evaluator.get() {
            Some(evaluator) => evaluator,
            None => {
                let evaluator = system.evaluator(&self.positions, MAX_SUM_ERROR)?;
                self.evaluator.get_or_init(|| evaluator)
            }
        };
        let accuracy = sum_accuracy(solution.expected_error());
        let values = evaluator.values(system, solution, accuracy)?;
        let error_of = |(k, data): (usize, &BoundaryData)| {
            let exact = data.values_at(&self.points);
            let distance = |(r, exact): (usize, &Vector)| {
                let [x, y, z] = [0, 1, 2].map(|i| values.row(r)[3 * k + i]);
                (Vector::new(x, y, z) - exact).norm()
            };
            let errors: Vec<f64> = exact.par_iter().enumerate().map(distance).collect();
            let pairs = self.points.iter().zip(&errors);
            let local: Option<Vec<f64>> = pairs
                .map(|(point, error)| Some(error / data.spacing_at(point)?))
                .collect();
            let local_error = local.as_deref().map(|local| self.local_error(local)).transpose()?;
            let held_out = HeldOutErrors {
                points: self.points.clone(),
                local_errors: local.unwrap_or_default(),
                errors,
            };
            Ok(((self.boundary_error(&held_out.errors)?, local_error), held_out))
        };
        data.par_iter().enumerate().map(error_of).collect()
    }

    fn boundary_error(&self, errors: &[f64]) -> Result<BoundaryError, FitError> {
        let even = self.of_even(errors)?;
        let max = errors.iter().copied().fold(0.0, f64::max);
        Ok(BoundaryError {
            rms: even.rms,
            p99: even.p99,
            max,
        })
    }

    fn local_error(&self, errors: &[f64]) -> Result<LocalError, FitError> {
        let max = errors.iter().copied().fold(0.0, f64::max);
        Ok(LocalError {
            p99: self.of_even(errors)?.p99,
            max,
        })
    }

    /// Errors at the points that are spread evenly.
    fn of_even(&self, errors: &[f64]) -> Result<Summary, FitError> {
        let even = Summary::of(&errors[..self.even]).filter(|_| errors.iter().all(|e| e.is_finite()));
        even.ok_or(FitError::NonFiniteMap)
    }
}

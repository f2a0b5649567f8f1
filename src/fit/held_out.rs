//! Boundary points that the solver does not see, and the errors of maps there.

use std::sync::OnceLock;

use rayon::prelude::*;

use super::FitError;
use super::boundary_data::BoundaryData;
use super::report::BoundaryError;
use super::system::{Evaluator, System, SystemSolution};
use crate::mesh::{SurfaceMesh, SurfacePoint};
use crate::sampling;
use crate::statistics::Summary;
use crate::{Point, Vector};

/// Triangles at most that are visited for the largest error.
const TRIANGLES: usize = 100_000;
/// Relative error of the sums for measuring a map, as a part of the map's own error. Values are some tenths of the
/// diagonal, and errors of sums and map add as squares: that is half a percent of the error.
const PART_OF_ERROR: f64 = 0.3;
/// Largest relative error of these sums.
const LEAST_ACCURACY: f64 = 1e-4;

/// Points of the boundary that are not collocation points.
pub(super) struct HeldOut {
    points: Vec<SurfacePoint>,
    /// The first so many are spread evenly, and averaged over.
    even: usize,
    positions: Vec<Point>,
    /// Made for the sources there are, and kept for further boundary maps.
    evaluator: OnceLock<Evaluator>,
}

impl HeldOut {
    pub fn new(domain: &SurfaceMesh, even: usize, seed: u64) -> Self {
        let points = sampling::held_out(domain, even, TRIANGLES, seed);
        let position = |p: &SurfacePoint| p.position(domain, domain.vertices());
        Self {
            positions: points.par_iter().map(position).collect(),
            even: even.min(points.len()),
            points,
            evaluator: OnceLock::new(),
        }
    }

    /// To be called when sources were added.
    pub fn forget_sources(&mut self) {
        self.evaluator = OnceLock::new();
    }

    /// The boundary error for each of the data of a solution.
    pub fn errors(
        &self,
        system: &System,
        solution: &SystemSolution,
        data: &[BoundaryData],
    ) -> Result<Vec<BoundaryError>, FitError> {
        let evaluator = match self.evaluator.get() {
            Some(evaluator) => evaluator,
            None => {
                let evaluator = system.evaluator(&self.positions, LEAST_ACCURACY)?;
                self.evaluator.get_or_init(|| evaluator)
            }
        };
        let accuracy = (PART_OF_ERROR * solution.expected_error()).min(LEAST_ACCURACY);
        let values = evaluator.values(solution, accuracy)?;
        let error_of = |(k, data): (usize, &BoundaryData)| {
            let exact = data.values_at(&self.points);
            let distance = |(r, exact): (usize, &Vector)| {
                let [x, y, z] = [0, 1, 2].map(|i| values.row(r)[3 * k + i]);
                (Vector::new(x, y, z) - exact).norm()
            };
            self.summary(&exact.par_iter().enumerate().map(distance).collect::<Vec<_>>())
        };
        data.par_iter().enumerate().map(error_of).collect()
    }

    fn summary(&self, errors: &[f64]) -> Result<BoundaryError, FitError> {
        let even = Summary::of(&errors[..self.even]).filter(|_| errors.iter().all(|e| e.is_finite()));
        let even = even.ok_or(FitError::NonFiniteMap)?;
        Ok(BoundaryError {
            rms: even.rms,
            p99: even.p99,
            max: errors.iter().copied().fold(0.0, f64::max),
        })
    }
}

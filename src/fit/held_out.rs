//! Boundary points that the solver does not see, and how far maps are off there.

use std::sync::OnceLock;

use rayon::prelude::*;

use super::frame::Frame;
use super::report::BoundaryError;
use super::system::{Solved, System, values};
use super::{FitError, Goal};
use crate::kernel::Sums;
use crate::mesh::{SurfaceMesh, SurfacePoint};
use crate::sampling;
use crate::solver::Values;
use crate::statistics::Summary;
use crate::{Point, Vector};

/// Triangles at most that are visited for the largest error.
const TRIANGLES: usize = 100_000;
/// Part of a map's error that the sums for measuring it may have as their relative error, and the least accuracy of them.
/// Values are some tenths of the diagonal, and errors of sums and map add as squares: that is half a percent of the error.
const ACCURACY: (f64, f64) = (0.3, 1e-4);

/// The points, and what it takes to sum there again and again.
pub(super) struct HeldOut {
    points: Vec<SurfacePoint>,
    /// The first so many are spread evenly, and averaged over.
    even: usize,
    /// In the unit frame.
    positions: Vec<Point>,
    sums: OnceLock<Sums>,
}

impl HeldOut {
    pub fn new(domain: &SurfaceMesh, frame: &Frame, even: usize, seed: u64) -> Self {
        let points = sampling::held_out(domain, even, TRIANGLES, seed);
        let position = |p: &SurfacePoint| frame.to_unit(&p.position(domain, domain.vertices()));
        Self {
            positions: points.par_iter().map(position).collect(),
            even: even.min(points.len()),
            points,
            sums: OnceLock::new(),
        }
    }

    /// To be called when sources were added.
    pub fn forget_sources(&mut self) {
        self.sums = OnceLock::new();
    }

    /// Values of all columns of data at the points, right to a part of the root mean square `error`.
    pub fn values(&self, system: &System, frame: &Frame, solved: &Solved, error: f64) -> Result<Values, FitError> {
        let (part, least) = ACCURACY;
        let sums = match self.sums.get() {
            Some(sums) => sums,
            None => {
                let sums = system.sums(frame, &self.positions, least)?;
                self.sums.get_or_init(|| sums)
            }
        };
        let sums = sums.with_accuracy((part * error).min(least));
        let values = values(&sums, &solved.coefficients, &self.positions)?;
        Ok(solved.values_of_data(values, &self.positions))
    }

    /// The error of each map, whose values take three columns each, as fractions of its target's diagonal.
    pub fn errors(&self, goals: &[Goal], values: &Values) -> Result<Vec<BoundaryError>, FitError> {
        let error_of = |(k, goal): (usize, &Goal)| {
            let images = goal.boundary.evaluate(&self.points);
            let distance = |(r, exact): (usize, &Point)| {
                let [x, y, z] = [0, 1, 2].map(|i| values.row(r)[3 * k + i]);
                (Vector::new(x, y, z) - (exact - goal.origin) / goal.scale()).norm()
            };
            let errors: Vec<f64> = images.par_iter().enumerate().map(distance).collect();
            let even = Summary::of(&errors[..self.even]).filter(|_| errors.iter().all(|e| e.is_finite()));
            let even = even.ok_or(FitError::NonFiniteMap)?;
            Ok(BoundaryError {
                rms: even.rms,
                p99: even.p99,
                max: errors.iter().copied().fold(0.0, f64::max),
            })
        };
        goals.par_iter().enumerate().map(error_of).collect()
    }
}

//! Smooth boundary values by a few distant sources.
//!
//! The method of fundamental solutions converges the faster, the farther its sources are from the solid, where the boundary values are
//! those of a function that is harmonic so far beyond it (Barnett & Betcke, *Stability and convergence of the method of fundamental
//! solutions for Helmholtz problems on analytic domains*, J. Comput. Phys. 227, 2008): for polynomials and the like by a digit with some
//! twenty sources more. Where they are not, distant sources are of no use, and near ones resolve what their spacing can.
//! Which of the two it is, a dense least-squares system of a few hundred rows tells, at rows that it was not fitted to. Where distant
//! sources serve, the large system is not solved at all.

use super::FitError;
use super::system::values;
use crate::Point;
use crate::kernel::Sums;
use crate::sampling::bounding_sphere;
use crate::solver::{CollocationSystem, DenseFactor, DenseOptions, SolveError, Values};

/// Sources, at most. For scale: 200 resolve harmonic polynomials up to degree 13 on their sphere.
const SOURCES: usize = 240;
/// Fewer than this are of no use.
const LEAST_SOURCES: usize = 60;
/// Radius of their sphere, over the diagonal of the solid's bounding box: twice that of the sphere around the box.
const RADIUS: f64 = 1.0;
/// Rows that they are fitted to for each of them, and rows that show how well.
const FITTED_PER_SOURCE: usize = 4;
const TESTED_PER_SOURCE: usize = 2;
/// Bytes of their factored system.
pub(super) const BYTES: f64 = 8.0 * (FITTED_PER_SOURCE * SOURCES * (SOURCES + 4)) as f64;

/// Distant sources of a domain, and the factored system of some of its collocation points, in the unit frame.
pub(super) struct DistantSources {
    pub positions: Vec<Point>,
    factor: DenseFactor,
    fitted: Vec<u32>,
    tested: Vec<u32>,
    tests: Sums,
}

impl DistantSources {
    /// `None` where there are too few collocation points. `weights` are the areas that these stand for.
    pub fn new(collocation: &[Point], weights: &[f64]) -> Result<Option<Self>, FitError> {
        let per_source = FITTED_PER_SOURCE + TESTED_PER_SOURCE;
        let sources = SOURCES.min(collocation.len() / per_source);
        if sources < LEAST_SOURCES {
            return Ok(None);
        }
        let chosen = evenly_by_area(weights, per_source * sources);
        let is_tested = |k: usize| k % per_source >= FITTED_PER_SOURCE;
        let of_kind = |tested: bool| -> Vec<u32> {
            let numbered = chosen.iter().enumerate();
            numbered
                .filter(|&(k, _)| is_tested(k) == tested)
                .map(|(_, &r)| r)
                .collect()
        };
        let [fitted, tested] = [of_kind(false), of_kind(true)];
        let points = |rows: &[u32]| -> Vec<Point> { rows.iter().map(|&r| collocation[r as usize]).collect() };
        let positions = bounding_sphere(Point::origin(), RADIUS, sources);
        let system = CollocationSystem {
            collocation: &points(&fitted),
            row_weights: &vec![1.0; fitted.len()],
            sources: &positions,
            affine: true,
        };
        if system.collocation.len() < system.unknowns() {
            return Ok(None);
        }
        Ok(Some(Self {
            factor: DenseFactor::new(&system, &DenseOptions::default())?,
            tests: Sums::new(&positions, &points(&tested), 0.0).map_err(SolveError::from)?,
            positions,
            fitted,
            tested,
        }))
    }

    /// Coefficients of these sources, and of the affine functions; `None` unless the root mean square of what they leave at the tested rows
    /// is within the tolerance in every column. Rows of `right_hand_sides` beyond those that were known at first are not looked at.
    pub fn fitted(
        &self,
        right_hand_sides: &Values,
        collocation: &[Point],
        tolerance: f64,
    ) -> Result<Option<Values>, FitError> {
        let coefficients = self.factor.solve_columns(&right_hand_sides.gather(&self.fitted))?;
        let points: Vec<Point> = self.tested.iter().map(|&r| collocation[r as usize]).collect();
        let found = values(&self.tests, &coefficients, &points)?;
        let left = right_hand_sides.gather(&self.tested).minus(&found);
        let is_small = |column: usize| {
            let squares = (0..left.rows()).map(|r| left.row(r)[column].powi(2));
            (squares.sum::<f64>() / left.rows() as f64).sqrt() <= tolerance
        };
        Ok((0..left.columns()).all(is_small).then_some(coefficients))
    }

    /// Values of these coefficients at points.
    pub fn values(&self, coefficients: &Values, points: &[Point]) -> Result<Values, FitError> {
        let sums = Sums::new(&self.positions, points, 0.0).map_err(SolveError::from)?;
        values(&sums, coefficients, points)
    }
}

/// So many rows, or all, evenly by area.
fn evenly_by_area(weights: &[f64], count: usize) -> Vec<u32> {
    let total: f64 = weights.iter().sum();
    let mut before = 0.0;
    let passes = |weight: &f64| {
        let place = |area: f64| (area / total * count as f64) as usize;
        let first = place(before);
        before += weight;
        place(before) > first
    };
    let chosen = weights.iter().map(passes).collect::<Vec<_>>().into_iter().zip(0..);
    chosen.filter_map(|(is_chosen, row)| is_chosen.then_some(row)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::shapes;

    fn points() -> (Vec<Point>, Vec<f64>) {
        let body = shapes::bumpy_sphere(40);
        let (low, high) = body.bounding_box().unwrap();
        let (centre, diagonal) = (nalgebra::center(&low, &high), (high - low).norm());
        let points: Vec<Point> = body
            .vertices()
            .iter()
            .map(|p| Point::from((p - centre) / diagonal))
            .collect();
        let weights = vec![1.0; points.len()];
        (points, weights)
    }

    fn columns(points: &[Point], f: impl Fn(&Point) -> [f64; 3]) -> Values {
        Values::from_triples(&points.iter().map(f).collect::<Vec<_>>())
    }

    #[test]
    fn harmonic_polynomials_are_met_to_eight_digits_and_data_with_kinks_are_refused() {
        let (points, weights) = points();
        let distant = DistantSources::new(&points, &weights).unwrap().unwrap();
        let smooth = columns(&points, |p| {
            let (x, y, z) = (2.0 * p.x, 2.0 * p.y, 2.0 * p.z);
            [x * x - y * y + z, x * y * z + 2.0, x * x * x - 3.0 * x * y * y + y * z]
        });
        let found = distant.fitted(&smooth, &points, 1e-8).unwrap().expect("smooth data");
        let left = smooth.minus(&distant.values(&found, &points).unwrap());
        let largest = left.as_slice().iter().map(|v| v.abs()).fold(0.0, f64::max);
        assert!(largest < 1e-7, "{largest:e}");
        let kinked = columns(&points, |p| [p.x.abs(), p.y, p.z]);
        assert_eq!(distant.fitted(&kinked, &points, 1e-3).unwrap(), None);
    }

    #[test]
    fn rows_are_chosen_evenly_by_area_and_few_have_no_distant_sources() {
        let weights: Vec<f64> = (0..1000).map(|r| if r < 500 { 3.0 } else { 1.0 }).collect();
        let chosen = evenly_by_area(&weights, 100);
        assert_eq!(chosen.iter().filter(|&&r| r < 500).count(), 75);
        assert!((99..=100).contains(&chosen.len()));
        let (points, weights) = points();
        assert!(DistantSources::new(&points[..300], &weights[..300]).unwrap().is_none());
    }
}

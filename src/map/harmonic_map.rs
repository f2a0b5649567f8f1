//! The harmonic map as a sum of point sources and an affine part: equation (1) of the paper, and its derivative.

use rayon::prelude::*;

use super::VolumeMap;
use crate::kernel::Sums;
use crate::solver::Coefficients;
use crate::{Matrix3, Point, Vector};

/// A harmonic map `f(x) = A·(1, x) + Σ_s w_s / (4π |x − Q_s|)`, in model units of its domain and target.
///
/// Every coordinate of `f` is harmonic wherever no source stands, whatever the coefficients; the fit
/// reports how closely `f` agrees with its boundary map. Outside the domain the values are meaningless, and at a source
/// they are not finite.
#[derive(Debug, Clone)]
pub struct HarmonicMap {
    sources: Vec<Point>,
    coefficients: Coefficients,
    accuracy: f64,
}

/// Default relative accuracy of sums over many sources.
const ACCURACY: f64 = 1e-8;
/// Error of the sums as a fraction of the map's own error.
const SHARE_OF_ERROR: f64 = 0.03;

impl HarmonicMap {
    /// The map with these sources and coefficients. `None` when their counts differ.
    pub fn new(sources: Vec<Point>, coefficients: Coefficients) -> Option<Self> {
        (sources.len() == coefficients.sources.len()).then_some(Self {
            sources,
            coefficients,
            accuracy: ACCURACY,
        })
    }

    /// The same map with the accuracy of its sums suited to its boundary error, a fraction of the target's diagonal.
    /// Sums over up to a few thousand sources are exact to rounding in any case; those over more cost two to five times
    /// as much at 1e-8, the default, as at 1e-6.
    pub fn with_error(self, boundary_error: f64) -> Self {
        Self {
            accuracy: (SHARE_OF_ERROR * boundary_error).clamp(1e-10, 1e-6),
            ..self
        }
    }

    /// The same map with sums that are no more accurate than this, relative to their size.
    pub(crate) fn with_accuracy_at_most(self, accuracy: f64) -> Self {
        Self {
            accuracy: self.accuracy.max(accuracy),
            ..self
        }
    }

    /// Positions `Q` of the sources, outside the domain.
    pub fn sources(&self) -> &[Point] {
        &self.sources
    }

    /// The coefficients, one row per source, and the affine part.
    pub fn coefficients(&self) -> &Coefficients {
        &self.coefficients
    }

    fn sums(&self, points: &[Point], accuracy: f64) -> Sums {
        Sums::new(&self.sources, points, accuracy).expect("fewer than 2³² − 1 points")
    }

    fn weights(&self) -> &[f64] {
        self.coefficients.sources.as_flattened()
    }

    fn affine(&self, x: &Point) -> Vector {
        let a = &self.coefficients.affine;
        Vector::from_fn(|i, _| a[0][i] + a[1][i] * x.x + a[2][i] * x.y + a[3][i] * x.z)
    }
}

impl VolumeMap for HarmonicMap {
    fn evaluate(&self, points: &[Point]) -> Vec<Point> {
        let sums = self.sums(points, self.accuracy).potential(self.weights(), 3);
        let sums = sums.expect("one weight per source");
        sums.as_chunks::<3>()
            .0
            .par_iter()
            .zip(points)
            .map(|(&sum, x)| Point::from(self.affine(x) + Vector::from(sum)))
            .collect()
    }

    fn jacobian(&self, points: &[Point]) -> Vec<Matrix3> {
        self.evaluate_with_jacobian(points).1
    }

    fn evaluate_with_jacobian(&self, points: &[Point]) -> (Vec<Point>, Vec<Matrix3>) {
        let a = &self.coefficients.affine;
        let linear = Matrix3::from_fn(|i, k| a[k + 1][i]);
        // A gradient has about a digit less than the potential.
        let sums = self
            .sums(points, 0.1 * self.accuracy)
            .potential_and_gradient(self.weights(), 3);
        let (sums, gradients) = sums.expect("one weight per source");
        let images = sums.as_chunks::<3>().0.par_iter().zip(points);
        let gradients = gradients.as_chunks::<9>().0.par_iter();
        (
            images
                .map(|(&sum, x)| Point::from(self.affine(x) + Vector::from(sum)))
                .collect(),
            gradients
                .map(|gradient| Matrix3::from_row_slice(gradient) + linear)
                .collect(),
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn example() -> HarmonicMap {
        let sources = vec![
            Point::new(2.0, 0.1, -0.3),
            Point::new(-0.4, 2.2, 0.5),
            Point::new(0.3, -0.2, -2.1),
        ];
        let coefficients = Coefficients {
            sources: vec![[1.0, -2.0, 0.5], [0.3, 0.7, -1.1], [-0.6, 1.2, 2.0]],
            affine: [[0.1, 0.2, 0.3], [1.0, 0.1, 0.0], [0.0, 0.9, -0.2], [0.3, 0.0, 1.1]],
        };
        HarmonicMap::new(sources, coefficients).unwrap()
    }

    fn points() -> Vec<Point> {
        (0..50)
            .map(|k| Point::new((k as f64).sin(), (1.7 * k as f64).cos(), (0.3 * k as f64).sin()) * 0.55)
            .collect()
    }

    /// A central difference of step `h` errs by at most `h² max|∂³f| / 6`, and each source adds at most
    /// `|w| · 6 / (4π r⁴)` to a third derivative; here `r ≥ 1` and the coefficients sum to less than 6 in each row.
    #[test]
    fn jacobian_matches_central_differences() {
        let (map, h) = (example(), 1e-4);
        let bound = h * h * 6.0 * 6.0 / (4.0 * std::f64::consts::PI) / 6.0 + 1e-11;
        let jacobians = map.jacobian(&points());
        for (x, jacobian) in points().iter().zip(jacobians) {
            for axis in 0..3 {
                let step = Vector::ith(axis, h);
                let images = map.evaluate(&[x + step, x - step]);
                let slope = (images[0] - images[1]) / (2.0 * h);
                assert!((slope - jacobian.column(axis)).amax() < bound);
            }
        }
    }

    /// The trace of each coordinate's Hessian, by second differences of the Jacobian: the error is `h² max|∂⁴f| / 6`
    /// per axis, with `|∂⁴(1/4πr)| ≤ 24 / 4πr⁵`.
    #[test]
    fn every_coordinate_is_harmonic() {
        let (map, h) = (example(), 1e-3);
        let bound = 3.0 * h * h / 6.0 * 6.0 * 24.0 / (4.0 * std::f64::consts::PI) + 1e-10;
        for x in points() {
            let mut laplacian = Vector::zeros();
            for axis in 0..3 {
                let step = Vector::ith(axis, h);
                let j = map.jacobian(&[x + step, x - step]);
                laplacian += (j[0] - j[1]).column(axis) / (2.0 * h);
            }
            assert!(laplacian.amax() < bound);
        }
    }

    #[test]
    fn without_sources_the_map_is_affine() {
        let affine = [[1.0, 2.0, 3.0], [2.0, 0.0, 0.0], [0.0, 3.0, 0.0], [0.0, 0.0, 4.0]];
        let map = HarmonicMap::new(
            vec![],
            Coefficients {
                sources: vec![],
                affine,
            },
        )
        .unwrap();
        assert_eq!(map.evaluate(&[Point::new(1.0, 1.0, 1.0)])[0], Point::new(3.0, 5.0, 7.0));
        assert_eq!(
            map.jacobian(&[Point::origin()])[0],
            Matrix3::from_diagonal(&Vector::new(2.0, 3.0, 4.0))
        );
        assert!(HarmonicMap::new(vec![Point::origin()], Coefficients::default()).is_none());
    }
}

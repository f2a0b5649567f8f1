//! Points inside a shell, carried by its map: by the affine map that fits it best near by, which is "moving least squares" (Levin
//! 1998; Schaefer, McPhail, Warren 2006, section 2.1, in space).

use crate::boundary_map::BoundaryMap;
use crate::sampling::Collocation;
use crate::{Matrix3, Point, Vector};

/// Points of the shell that are fitted.
const SAMPLES: usize = 2000;
const SEED: u64 = 1;

/// The map of a shell at points of its surface.
pub(super) struct MovingLeastSquares {
    from: Vec<Point>,
    to: Vec<Point>,
}

impl MovingLeastSquares {
    pub fn of(map: &BoundaryMap) -> Self {
        let samples = Collocation::even(map.domain(), SAMPLES, SEED).points;
        Self {
            from: map.positions(&samples),
            to: map.evaluate(&samples),
        }
    }

    /// Exact for affine maps.
    pub fn carried(&self, p: &Point) -> Point {
        let weights = self
            .from
            .iter()
            .map(|q| (q - p).norm_squared().max(f64::MIN_POSITIVE).recip().powi(2));
        let weights: Vec<f64> = weights.collect();
        let total: f64 = weights.iter().sum();
        let mean = |points: &[Point]| -> Vector {
            let weighted = points.iter().zip(&weights).map(|(q, w)| q.coords * (w / total));
            weighted.sum()
        };
        let (from, to) = (mean(&self.from), mean(&self.to));
        let (mut covariance, mut mixed) = (Matrix3::zeros(), Matrix3::zeros());
        for ((q, image), w) in self.from.iter().zip(&self.to).zip(&weights) {
            let (d, e) = (q.coords - from, image.coords - to);
            covariance += d * d.transpose() * (w / total);
            mixed += e * d.transpose() * (w / total);
        }
        let linear = covariance
            .try_inverse()
            .map_or_else(Matrix3::identity, |inverse| mixed * inverse);
        Point::from(to + linear * (p.coords - from))
    }
}

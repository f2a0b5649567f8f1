use crate::solver::Coefficients;
use crate::{Point, Vector};

/// The frame in which the system is solved: the box centre at the origin, the diagonal 1.
pub(super) struct Frame {
    pub centre: Point,
    pub diagonal: f64,
}

impl Frame {
    pub fn of(points: &[Point]) -> Self {
        let low = points
            .iter()
            .fold(Vector::repeat(f64::INFINITY), |low, p| low.inf(&p.coords));
        let high = points
            .iter()
            .fold(Vector::repeat(f64::NEG_INFINITY), |high, p| high.sup(&p.coords));
        Self {
            centre: Point::from((low + high) / 2.0),
            diagonal: (high - low).norm(),
        }
    }

    pub fn to_unit(&self, p: &Point) -> Point {
        Point::from((p - self.centre) / self.diagonal)
    }

    /// Coefficients for points in model units: `1/|x'| = diagonal / |x|`, and `A·(1, x') = (A₀ − A·centre/d) + (A/d)·x`.
    pub fn to_model(&self, unit: Coefficients, origin: Point) -> Coefficients {
        let sources = unit.sources.iter().map(|w| w.map(|w| w * self.diagonal)).collect();
        let mut affine = unit.affine.map(|row| row.map(|a| a / self.diagonal));
        affine[0] = std::array::from_fn(|i| {
            let shift: f64 = (0..3).map(|k| affine[k + 1][i] * self.centre[k]).sum();
            unit.affine[0][i] - shift + origin[i]
        });
        Coefficients { sources, affine }
    }
}

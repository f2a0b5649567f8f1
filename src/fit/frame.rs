use crate::Point;
use crate::mesh::SurfaceMesh;
use crate::solver::Coefficients;

/// The frame in which the system is solved: the box centre at the origin, the diagonal 1.
pub(super) struct Frame {
    pub centre: Point,
    pub diagonal: f64,
}

impl Frame {
    pub fn of(surface: &SurfaceMesh) -> Self {
        Self::of_box(surface.bounding_box().unwrap_or_default())
    }

    pub fn of_box((low, high): (Point, Point)) -> Self {
        Self {
            centre: nalgebra::center(&low, &high),
            diagonal: (high - low).norm(),
        }
    }

    pub fn to_unit(&self, p: &Point) -> Point {
        Point::from((p - self.centre) / self.diagonal)
    }

    pub fn unit_areas(&self, areas: &[f64]) -> Vec<f64> {
        let unit = self.diagonal.powi(2).recip();
        areas.iter().map(|area| area * unit).collect()
    }

    pub fn to_model_point(&self, p: &Point) -> Point {
        self.centre + p.coords * self.diagonal
    }

    /// Coefficients for points in model units: `1/|x'| = diagonal / |x|`, and `A·(1, x') = (A₀ − A·centre/d) + (A/d)·x`.
    /// Values are multiplied by `scale` and moved by `origin`.
    pub fn to_model(&self, unit: Coefficients, scale: f64, origin: Point) -> Coefficients {
        let sources = unit
            .sources
            .iter()
            .map(|w| w.map(|w| w * scale * self.diagonal))
            .collect();
        let mut affine = unit.affine.map(|row| row.map(|a| a * scale / self.diagonal));
        affine[0] = std::array::from_fn(|i| {
            let shift: f64 = (0..3).map(|k| affine[k + 1][i] * self.centre[k]).sum();
            scale * unit.affine[0][i] - shift + origin[i]
        });
        Coefficients { sources, affine }
    }
}

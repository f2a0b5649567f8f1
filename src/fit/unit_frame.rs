use crate::Point;
use crate::mesh::SurfaceMesh;
use crate::solver::{Coefficients, Level};

/// The coordinates in which the system is solved: the centre of the domain's bounding box at the origin, its diagonal 1.
#[derive(Debug, Clone, Copy)]
pub(super) struct UnitFrame {
    pub centre: Point,
    pub diagonal: f64,
}

impl UnitFrame {
    pub fn of(surface: &SurfaceMesh) -> Self {
        let (low, high) = surface.bounding_box().unwrap_or_default();
        Self {
            centre: nalgebra::center(&low, &high),
            diagonal: (high - low).norm(),
        }
    }

    pub fn to_unit(self, p: &Point) -> Point {
        Point::from((p - self.centre) / self.diagonal)
    }

    pub fn all_to_unit(self, points: &[Point]) -> Vec<Point> {
        points.iter().map(|p| self.to_unit(p)).collect()
    }

    pub fn areas_to_unit(self, areas: &[f64]) -> Vec<f64> {
        let unit = self.diagonal.powi(2).recip();
        areas.iter().map(|area| area * unit).collect()
    }

    pub fn level_to_unit(self, level: Level) -> Level {
        Level {
            sources: self.all_to_unit(&level.sources),
            spacing: level.spacing.iter().map(|spacing| spacing / self.diagonal).collect(),
            weights: self.areas_to_unit(&level.weights),
            ..level
        }
    }

    pub fn all_to_model(self, points: &[Point]) -> Vec<Point> {
        points.iter().map(|p| self.centre + p.coords * self.diagonal).collect()
    }

    /// Coefficients for points in model units: distances give `1/r' = d/r` with `d` the diagonal, and
    /// `A·(1, x') = (A₀ − A·centre/d) + (A/d)·x`. Values are multiplied by `scale` and shifted by `origin`.
    pub fn coefficients_to_model(self, unit: Coefficients, scale: f64, origin: Point) -> Coefficients {
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

use super::SurfaceMesh;
use crate::{Point, Vector};

/// A point of a surface: a triangle and barycentric coordinates over its corners (they sum to 1).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SurfacePoint {
    /// Index of the triangle.
    pub triangle: u32,
    /// Weights of the three corners.
    pub barycentric: [f64; 3],
}

impl SurfacePoint {
    /// A corner of a triangle.
    pub fn corner(triangle: u32, corner: usize) -> Self {
        let mut barycentric = [0.0; 3];
        barycentric[corner] = 1.0;
        Self { triangle, barycentric }
    }

    /// Where the point lies when the vertices of `mesh` stand at `positions`.
    pub fn position(&self, mesh: &SurfaceMesh, positions: &[Point]) -> Point {
        let corners = mesh.triangles()[self.triangle as usize];
        let weighted = (0..3).map(|k| positions[corners[k] as usize].coords * self.barycentric[k]);
        Point::from(weighted.sum::<Vector>())
    }
}

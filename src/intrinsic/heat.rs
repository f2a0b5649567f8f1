//! Geodesic distances by the heat method: Crane, Weischedel & Wardetzky, *Geodesics in heat*, ACM Trans. Graph. 32 (2013).

use super::laplacian::Laplacian;
use super::triangulation::{IntrinsicTriangulation, area};
use crate::spherical::Cholesky;

/// Regularises the Poisson equation: far below the least positive eigenvalue, about 10, far above rounding.
const SHIFT: f64 = 1e-6;

/// Computes distances from any vertex with two factorisations.
#[derive(Debug)]
pub(super) struct HeatMethod {
    flow: Cholesky,
    poisson: Cholesky,
    triangles: Vec<FlatTriangle>,
}

#[derive(Debug)]
struct FlatTriangle {
    corners: [u32; 3],
    /// The sides opposite to the corners, turned by a right angle towards them: the gradients of the corners' hat
    /// functions times twice the area.
    gradients: [[f64; 2]; 3],
}

impl HeatMethod {
    /// `None` when the factorisations do not fit into memory or break down.
    pub fn new(triangulation: &IntrinsicTriangulation, laplacian: &Laplacian) -> Option<Self> {
        let time = triangulation.mean_length().powi(2);
        let triangles = triangulation.triangles.iter().zip(&triangulation.lengths);
        Some(Self {
            flow: laplacian.factored(time, 1.0)?,
            poisson: laplacian.factored(1.0, SHIFT)?,
            triangles: triangles
                .map(|(corners, lengths)| FlatTriangle::new(*corners, lengths))
                .collect(),
        })
    }

    /// Distances of all vertices from one, where the area of the surface is 1.
    pub fn distances(&self, source: u32) -> Vec<f64> {
        let mut heat = vec![0.0; self.flow.unknowns()];
        heat[source as usize] = 1.0;
        self.flow.solve_shared(&mut heat);
        let mut distance = vec![0.0; heat.len()];
        for triangle in &self.triangles {
            triangle.add_divergence(&heat, &mut distance);
        }
        self.poisson.solve_shared(&mut distance);
        let start = distance[source as usize];
        distance.iter_mut().for_each(|d| *d = (*d - start).max(0.0));
        distance
    }
}

impl FlatTriangle {
    fn new(corners: [u32; 3], lengths: &[f64; 3]) -> Self {
        let [ab, bc, ca] = *lengths;
        let along = (ab * ab + ca * ca - bc * bc) / (2.0 * ab);
        let c = [along, 2.0 * area(lengths) / ab];
        // Corners (0, 0), (ab, 0) and c.
        let sides = [[c[0] - ab, c[1]], [-c[0], -c[1]], [ab, 0.0]];
        Self {
            corners,
            gradients: sides.map(|[x, y]| [-y, x]),
        }
    }

    /// Adds the integrals of the hat functions' gradients against the unit field that points away from the heat.
    fn add_divergence(&self, heat: &[f64], sums: &mut [f64]) {
        let mut field = [0.0; 2];
        for (&corner, gradient) in self.corners.iter().zip(&self.gradients) {
            (0..2).for_each(|axis| field[axis] -= heat[corner as usize] * gradient[axis]);
        }
        let norm = field[0].hypot(field[1]);
        if norm > 0.0 {
            for (&corner, gradient) in self.corners.iter().zip(&self.gradients) {
                sums[corner as usize] += (gradient[0] * field[0] + gradient[1] * field[1]) / (2.0 * norm);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::shapes;

    /// Largest error of distances on the unit sphere.
    fn error(frequency: usize) -> f64 {
        let mesh = shapes::geodesic_sphere(1.0, frequency);
        let triangulation = IntrinsicTriangulation::delaunay(mesh.vertices(), mesh.triangles()).unwrap();
        let heat = HeatMethod::new(&triangulation, &Laplacian::new(&triangulation)).unwrap();
        let source = mesh.vertices()[17];
        let radius = mesh.area().sqrt();
        let found = heat.distances(17);
        let errors = found
            .iter()
            .zip(mesh.vertices())
            .map(|(d, p)| (d * radius - p.coords.angle(&source.coords)).abs());
        errors.fold(0.0, f64::max)
    }

    /// The field is constant in each triangle: the error is of the order of the length of sides, here 1.2 / frequency,
    /// and largest near the antipode, where the field is not smooth.
    #[test]
    fn distances_on_a_sphere_are_those_along_great_circles() {
        let [coarse, fine] = [12, 24].map(error);
        assert!(fine < 1.2 / 24.0, "{fine}");
        assert!(fine < 0.7 * coarse, "{fine} {coarse}");
    }
}

//! Conformalised mean curvature flow (cMCF), which converges to a conformal map to the sphere.
//!
//! Kazhdan, Solomon & Ben-Chen, *Can mean-curvature flow be modified to be non-singular?*, Computer Graphics Forum 31
//! (2012): the stiffness matrix is that of the initial surface, the mass matrix that of the moving one. It converges
//! for many shapes, without guarantee, and the result may have flipped triangles.

use super::check_embedding;
use super::cholesky::Cholesky;
use crate::{Point, Vector};

/// Time of one implicit step, for a surface of area 4π.
const TIME_STEP: f64 = 0.1;
const MAX_ITERATIONS: usize = 100;
/// Largest change of a vertex in one step, as a fraction of the radius, at which the flow has converged.
const TOLERANCE: f64 = 1e-3;
/// Largest cotangent weight: those of needles are unbounded.
const MAX_WEIGHT: f64 = 1e4;
/// Smallest cotangent weight: negative ones, of obtuse angles, fold the result.
const MIN_WEIGHT: f64 = 1e-4;

/// The directions that the vertices of a closed surface converge to, if these are an embedding (decided exactly).
///
/// `None` also when the flow fails: a vertex of a triangle is out of range, a coordinate is not finite, the surface has
/// no area, or memory is short.
pub(crate) fn flow(triangles: &[[u32; 3]], positions: &[Point]) -> Option<Vec<Vector>> {
    let in_range = |t: &[u32; 3]| t.iter().all(|&v| (v as usize) < positions.len());
    if triangles.is_empty() || !triangles.iter().all(in_range) {
        return None;
    }
    let mut x: Vec<Vector> = positions.iter().map(|p| p.coords).collect();
    normalise(triangles, &mut x)?;
    let stiffness = Stiffness::new(triangles, &x);
    let mut cholesky = Cholesky::new(stiffness.begin.clone(), stiffness.rows.clone()).ok()?;
    for _ in 0..MAX_ITERATIONS {
        let masses = masses(triangles, &x);
        if !cholesky.factor(&stiffness.implicit(&masses)) {
            return None;
        }
        let mut columns: Vec<f64> = (0..3)
            .flat_map(|k| x.iter().zip(&masses).map(move |(x, m)| x[k] * m))
            .collect();
        cholesky.solve(&mut columns);
        let count = x.len();
        let mut next: Vec<Vector> = (0..count)
            .map(|v| Vector::new(columns[v], columns[count + v], columns[2 * count + v]))
            .collect();
        normalise(triangles, &mut next)?;
        let change = x.iter().zip(&next).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max);
        x = next;
        if change <= TOLERANCE {
            break;
        }
    }
    let directions: Vec<Vector> = x.iter().map(Vector::normalize).collect();
    let is_bijective = check_embedding(triangles, &directions).is_bijective();
    is_bijective.then_some(directions)
}

/// Moves the centroid to the origin and scales to the area 4π; `None` when there is no area, or it is not finite.
fn normalise(triangles: &[[u32; 3]], x: &mut [Vector]) -> Option<()> {
    // Scaled to size 1 first, so that areas neither over- nor underflow.
    let size = x.iter().map(|x| x.amax()).fold(0.0, f64::max);
    if !(size > 0.0 && size.is_finite()) || x.iter().any(|x| x.iter().any(|c| !c.is_finite())) {
        return None;
    }
    x.iter_mut().for_each(|x| *x /= size);
    let (mut area, mut moment) = (0.0, Vector::zeros());
    for t in triangles {
        let [a, b, c] = t.map(|v| x[v as usize]);
        let of_triangle = 0.5 * (b - a).cross(&(c - a)).norm();
        area += of_triangle;
        moment += (a + b + c) * (of_triangle / 3.0);
    }
    let (centre, scale) = (moment / area, (4.0 * std::f64::consts::PI / area).sqrt());
    x.iter_mut().for_each(|x| *x = (*x - centre) * scale);
    (area > 0.0 && scale.is_finite()).then_some(())
}

/// A third of the area of the triangles at each vertex.
fn masses(triangles: &[[u32; 3]], x: &[Vector]) -> Vec<f64> {
    let mut masses = vec![0.0; x.len()];
    for t in triangles {
        let [a, b, c] = t.map(|v| x[v as usize]);
        let area = 0.5 * (b - a).cross(&(c - a)).norm();
        t.iter().for_each(|&v| masses[v as usize] += area / 3.0);
    }
    // Keeps the matrix definite at vertices with flat triangles or none.
    let least = 1e-12 * masses.iter().sum::<f64>() / masses.len() as f64;
    masses.iter().map(|m: &f64| m.max(least)).collect()
}

/// The cotangent stiffness of a surface: the lower triangle by columns, the diagonal first.
struct Stiffness {
    begin: Vec<u32>,
    rows: Vec<u32>,
    values: Vec<f64>,
}

impl Stiffness {
    fn new(triangles: &[[u32; 3]], x: &[Vector]) -> Self {
        let mut weights: Vec<([u32; 2], f64)> = Vec::with_capacity(3 * triangles.len());
        for t in triangles {
            for k in 0..3 {
                let [i, j, opposite] = [t[k], t[(k + 1) % 3], t[(k + 2) % 3]];
                let [p, q, apex] = [i, j, opposite].map(|v| x[v as usize]);
                let (u, v) = (p - apex, q - apex);
                let cotangent = 0.5 * u.dot(&v) / u.cross(&v).norm();
                // NaN where corners coincide.
                let cotangent = if cotangent.is_nan() { 0.0 } else { cotangent };
                weights.push(([i.min(j), i.max(j)], cotangent.clamp(-MAX_WEIGHT, MAX_WEIGHT)));
            }
        }
        weights.retain(|([i, j], _)| i != j);
        // A stable sort, so that sums are always in the same order.
        weights.sort_by_key(|(edge, _)| *edge);
        let mut edges = weights.chunk_by(|a, b| a.0 == b.0).peekable();
        let mut diagonal = vec![0.0; x.len()];
        let (mut begin, mut rows, mut values) = (vec![0], Vec::new(), Vec::new());
        for column in 0..x.len() as u32 {
            rows.push(column);
            values.push(0.0);
            while let Some(sides) = edges.next_if(|sides| sides[0].0[0] == column) {
                let sum: f64 = sides.iter().map(|(_, weight)| weight).sum();
                let (weight, row) = (sum.clamp(MIN_WEIGHT, MAX_WEIGHT), sides[0].0[1]);
                diagonal[column as usize] += weight;
                diagonal[row as usize] += weight;
                rows.push(row);
                values.push(-weight);
            }
            begin.push(rows.len() as u32);
        }
        for (first, sum) in begin.iter().zip(&diagonal) {
            values[*first as usize] = *sum;
        }
        Self { begin, rows, values }
    }

    /// The matrix of one implicit step.
    fn implicit(&self, masses: &[f64]) -> Vec<f64> {
        let mut values: Vec<f64> = self.values.iter().map(|value| TIME_STEP * value).collect();
        for (first, mass) in self.begin.iter().zip(masses) {
            values[*first as usize] += mass;
        }
        values
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::shapes;

    #[test]
    fn a_sphere_stays_itself() {
        let sphere = shapes::sphere(3.0, 3);
        let directions = flow(sphere.triangles(), sphere.vertices()).unwrap();
        for (x, p) in directions.iter().zip(sphere.vertices()) {
            // Twelve vertices have five triangles, the others six: the flow evens this out, by moves of about the
            // square of the spacing.
            assert!((x - p.coords / 3.0).norm() < 0.02);
        }
    }

    #[test]
    fn a_bumpy_solid_and_a_cube_flow_to_a_sphere() {
        for mesh in [shapes::bumpy_sphere(20), shapes::cube(2.0, 10)] {
            let moved = shapes::deformed(&mesh, |p| Point::from(1e5 * (p.coords + Vector::new(3.0, 4.0, 5.0))));
            let directions = flow(moved.triangles(), moved.vertices()).unwrap();
            assert!(check_embedding(mesh.triangles(), &directions).is_bijective());
            let mean: Vector = directions.iter().sum();
            assert!(mean.norm() < 0.5 * directions.len() as f64);
        }
    }

    #[test]
    fn gives_none_instead_of_directions_that_are_no_embedding() {
        let sphere = shapes::sphere(1.0, 2);
        let flow = |mesh: &crate::mesh::SurfaceMesh| flow(mesh.triangles(), mesh.vertices());
        assert_eq!(flow(&shapes::deformed(&sphere, |_| Point::origin())), None);
        assert_eq!(flow(&shapes::deformed(&sphere, |p| p * f64::NAN)), None);
        assert_eq!(
            flow(&shapes::deformed(&sphere, |p| if p.x > 0.9 {
                p * f64::INFINITY
            } else {
                *p
            })),
            None
        );
        assert_eq!(flow(&sphere.reversed()), None);
        assert_eq!(super::flow(&[], sphere.vertices()), None);
        assert_eq!(super::flow(&[[0, 1, 99]], sphere.vertices()), None);
        assert_eq!(flow(&shapes::torus(1.0, 0.3, 12, 8)), None);
    }
}

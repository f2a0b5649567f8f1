//! The foldover-free energy of tetrahedra and of the triangles of a polycube: each of these is flat across its axis, and
//! mapped in the plane.
//!
//! Garanzha et al., *Foldover-free maps in 50 lines of code* (2021). Without the triangles' part all tetrahedra can be
//! positive although triangles face the wrong way along their axis: the polycube then passes through itself.

use nalgebra::{Matrix2, Vector2};

use super::axis_of;
use crate::geometry::lesser;
use crate::remesh::foldover::{EnergyValue, FoldoverEnergy, chi, edges, length_or_one, regular_edges};
use crate::remesh::lbfgs::DescentEnergy;
use crate::remesh::{local_volumes, tet_scaled_jacobians};
use crate::{Matrix3, Point, Vector};

/// Scaled Jacobian below which a tetrahedron is no reference.
const SLIVER: f64 = 0.02;
/// Height of a triangle over its longest edge below which it is no reference.
const NEEDLE: f64 = 0.02;
/// The part of the triangles.
const FACE_PART: f64 = 0.5;

/// The shapes that cells are compared with, and their weights.
#[derive(Debug, Clone)]
pub(super) struct References {
    pub tets: Vec<Matrix3>,
    pub faces: Vec<Matrix2<f64>>,
    /// Shares of the volume, and of the area.
    pub tet_weights: Vec<f64>,
    pub face_weights: Vec<f64>,
}

impl References {
    /// Those of the model, regular ones of similar size where a cell is a sliver or a needle. Inverse matrices of edges.
    pub fn new(tets: &[[u32; 4]], faces: &[[u32; 3]], nodes: &[Point]) -> Self {
        let quality = tet_scaled_jacobians(tets, nodes);
        let sizes = local_volumes(tets, nodes);
        let shape = |t: usize| {
            if quality[t] > SLIVER {
                edges(tets[t].map(|v| nodes[v as usize]))
            } else {
                regular_edges() * length_or_one(sizes[t].cbrt())
            }
        };
        let tet_shapes: Vec<Matrix3> = (0..tets.len()).map(shape).collect();
        let face_shapes: Vec<Matrix2<f64>> = faces.iter().map(|f| flat_edges(f, nodes)).collect();
        Self {
            tet_weights: shares(tet_shapes.iter().map(|e| e.determinant().abs()).collect()),
            face_weights: shares(face_shapes.iter().map(|e| e.determinant().abs()).collect()),
            tets: tet_shapes
                .iter()
                .map(|e| e.try_inverse().unwrap_or_else(Matrix3::identity))
                .collect(),
            faces: face_shapes
                .iter()
                .map(|e| e.try_inverse().unwrap_or_else(Matrix2::identity))
                .collect(),
        }
    }
}

fn shares(mut sizes: Vec<f64>) -> Vec<f64> {
    let total = length_or_one(sizes.iter().sum());
    sizes.iter_mut().for_each(|size| *size /= total);
    sizes
}

/// The edges from the first corner of a triangle in its own plane; of an equilateral one for a needle.
fn flat_edges(face: &[u32; 3], nodes: &[Point]) -> Matrix2<f64> {
    let [a, b, c] = face.map(|v| nodes[v as usize]);
    let (first, second) = (b - a, c - a);
    let longest = first.norm().max(second.norm()).max((c - b).norm());
    let height = first.cross(&second).norm() / longest;
    // Written so that NaN is a needle.
    if height > NEEDLE * longest {
        let length = first.norm();
        let along = first / length;
        let across = (second - along * along.dot(&second)).norm();
        Matrix2::new(length, along.dot(&second), 0.0, across)
    } else {
        let shortest = first.norm().min(second.norm()).min((c - b).norm());
        let length = length_or_one((longest * shortest).sqrt());
        Matrix2::new(length, 0.5 * length, 0.0, 0.75f64.sqrt() * length)
    }
}

/// The two other axes of a label, in the order in which triangles that face along the label turn to the left.
pub(super) fn plane_axes(label: u8) -> [usize; 2] {
    let axis = axis_of(label);
    let [u, v] = [(axis + 1) % 3, (axis + 2) % 3];
    if label % 2 == 1 { [u, v] } else { [v, u] }
}

/// The energy of tetrahedra and labelled triangles.
pub(super) struct PolycubeEnergy {
    tets: FoldoverEnergy,
    tet_count: usize,
    faces: Vec<[u32; 3]>,
    /// Axes of the plane, inverse of the reference edges and weight of each triangle.
    planes: Vec<[usize; 2]>,
    rest: Vec<Matrix2<f64>>,
    weights: Vec<f64>,
    /// Corners of triangles at each node, in compressed rows: three times the triangle plus the corner.
    starts: Vec<u32>,
    uses: Vec<u32>,
}

impl PolycubeEnergy {
    /// All cells between `nodes` nodes, with the labels of the faces.
    pub fn new(tets: Vec<[u32; 4]>, faces: Vec<[u32; 3]>, labels: &[u8], references: References, nodes: usize) -> Self {
        let mut starts = vec![0u32; nodes + 1];
        faces.iter().flatten().for_each(|&v| starts[v as usize + 1] += 1);
        (0..nodes).for_each(|v| starts[v + 1] += starts[v]);
        let mut next = starts.clone();
        let mut uses = vec![0; 3 * faces.len()];
        for (k, &v) in faces.iter().flatten().enumerate() {
            uses[next[v as usize] as usize] = k as u32;
            next[v as usize] += 1;
        }
        Self {
            tet_count: tets.len(),
            tets: FoldoverEnergy::of_weighted_tets(tets, references.tets, references.tet_weights, nodes),
            faces,
            planes: labels.iter().map(|&label| plane_axes(label)).collect(),
            rest: references.faces,
            weights: references.face_weights.iter().map(|w| FACE_PART * w).collect(),
            starts,
            uses,
        }
    }

    fn jacobian(&self, face: usize, x: &[Point]) -> Matrix2<f64> {
        let [u, v] = self.planes[face];
        let [a, b, c] = self.faces[face].map(|node| Vector2::new(x[node as usize][u], x[node as usize][v]));
        Matrix2::from_columns(&[b - a, c - a]) * self.rest[face]
    }

    pub fn tet_count(&self) -> usize {
        self.tet_count
    }

    /// Least determinant of all cells.
    pub fn least(&self, x: &[Point]) -> f64 {
        let tets = self.tets.determinants(x);
        let least = tets.iter().fold(f64::INFINITY, |least, &d| lesser(least, d));
        (0..self.faces.len()).fold(least, |least, f| lesser(least, self.jacobian(f, x).determinant()))
    }
}

/// The determinant of a Jacobian in the plane, and its derivative.
fn determinant(jacobian: &Matrix2<f64>) -> (f64, Matrix2<f64>) {
    let cofactors = Matrix2::new(jacobian[(1, 1)], -jacobian[(1, 0)], -jacobian[(0, 1)], jacobian[(0, 0)]);
    (jacobian.determinant(), cofactors)
}

impl DescentEnergy for PolycubeEnergy {
    fn evaluate(
        &self,
        x: &[Point],
        epsilon: f64,
        free: &[u32],
        parts: &mut Vec<Vector>,
        gradient: &mut [Vector],
    ) -> EnergyValue {
        let mut value = self.tets.evaluate(x, epsilon, free, parts, gradient);
        let mut by_corner = vec![Vector::zeros(); 3 * self.faces.len()];
        for (face, corners) in by_corner.chunks_exact_mut(3).enumerate() {
            let jacobian = self.jacobian(face, x);
            let (det, cofactors) = determinant(&jacobian);
            let (chi, slope) = chi(det, epsilon);
            let weight = self.weights[face] / chi;
            let size = jacobian.norm_squared() + det * det + 1.0;
            value.energy += weight * size;
            value.inverted += usize::from(det.is_nan() || det <= 0.0);
            value.add_determinant(det);
            let by_jacobian = jacobian * (2.0 * weight) + cofactors * (weight * (2.0 * det - size * slope / chi));
            let by_edges = by_jacobian * self.rest[face].transpose();
            let [u, v] = self.planes[face];
            for k in 0..2 {
                for (axis, part) in [(u, by_edges[(0, k)]), (v, by_edges[(1, k)])] {
                    corners[k + 1][axis] += part;
                    corners[0][axis] -= part;
                }
            }
        }
        for (gradient, &v) in gradient.iter_mut().zip(free) {
            let range = self.starts[v as usize] as usize..self.starts[v as usize + 1] as usize;
            self.uses[range]
                .iter()
                .for_each(|&k| *gradient += by_corner[k as usize]);
        }
        value
    }

    fn diagonal_blocks(&self, x: &[Point], epsilon: f64, free: &[u32]) -> Vec<Matrix3> {
        let mut blocks = self.tets.diagonal_blocks(x, epsilon, free);
        for (block, &v) in blocks.iter_mut().zip(free) {
            let range = self.starts[v as usize] as usize..self.starts[v as usize + 1] as usize;
            for &k in &self.uses[range] {
                let (face, corner) = (k as usize / 3, k as usize % 3);
                let plane = self.face_block(face, corner, x, epsilon);
                let axes = self.planes[face];
                for i in 0..2 {
                    for j in 0..2 {
                        block[(axes[i], axes[j])] += plane[(i, j)];
                    }
                }
            }
        }
        blocks
    }
}

impl PolycubeEnergy {
    /// The Hessian with respect to a corner, without the curvature of `χ`.
    fn face_block(&self, face: usize, corner: usize, x: &[Point], epsilon: f64) -> Matrix2<f64> {
        let jacobian = self.jacobian(face, x);
        let rest = &self.rest[face];
        let slope: Vector2<f64> = match corner {
            0 => -rest.row_sum().transpose(),
            k => rest.row(k - 1).transpose(),
        };
        let (det, cofactors) = determinant(&jacobian);
        let (chi, chi_slope) = chi(det, epsilon);
        let by_det = cofactors * slope;
        let by_chi = by_det * chi_slope;
        let size = jacobian.norm_squared() + det * det + 1.0;
        let by_size = (jacobian * slope + by_det * det) * 2.0;
        let mixed = by_size * by_chi.transpose();
        let hessian = (Matrix2::identity() * slope.norm_squared() + by_det * by_det.transpose()) * (2.0 / chi)
            - (mixed + mixed.transpose()) / (chi * chi)
            + by_chi * by_chi.transpose() * (2.0 * size / chi.powi(3));
        hessian * self.weights[face]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two tetrahedra on three of whose faces labels are put.
    fn example() -> (PolycubeEnergy, Vec<Point>) {
        let nodes: Vec<Point> = [
            [0.0, 0.1, 0.0],
            [1.0, 0.0, 0.2],
            [0.1, 1.3, 0.0],
            [0.2, 0.1, 0.9],
            [0.9, 1.0, 1.1],
        ]
        .map(Point::from)
        .into();
        let tets = vec![[0, 1, 2, 3], [1, 2, 3, 4]];
        let faces = vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 4]];
        let references = References::new(&tets, &faces, &nodes);
        let energy = PolycubeEnergy::new(tets, faces, &[4, 2, 0, 1], references, nodes.len());
        (energy, nodes)
    }

    #[test]
    fn gradients_match_differences_with_and_without_inverted_cells() {
        let (energy, mut x) = example();
        let free: Vec<u32> = (0..x.len() as u32).collect();
        for turn in 0..2 {
            for epsilon in [0.1, 1e-2] {
                let mut gradient = vec![Vector::zeros(); x.len()];
                let value = energy.evaluate(&x, epsilon, &free, &mut vec![], &mut gradient);
                assert_eq!(value.least, energy.least(&x));
                assert!(turn == 0 || value.inverted > 0);
                let size = gradient.iter().map(|g| g.amax()).fold(0.0, f64::max);
                for v in 0..x.len() {
                    for axis in 0..3 {
                        let at = |step: f64| {
                            let mut moved = x.clone();
                            moved[v][axis] += step;
                            energy.evaluate(&moved, epsilon, &[], &mut vec![], &mut []).energy
                        };
                        let slope = (at(1e-6) - at(-1e-6)) / 2e-6;
                        assert!((slope - gradient[v][axis]).abs() < 1e-6 * size, "{epsilon} {v} {axis}");
                    }
                }
            }
            x[3].z = -0.4;
        }
    }

    #[test]
    fn blocks_are_second_derivatives_where_nothing_is_inverted() {
        let (energy, x) = example();
        let free: Vec<u32> = (0..4).collect();
        // The face across +x is of the second tetrahedron and inverted: only node 0 has positive faces alone.
        let block = energy.diagonal_blocks(&x, 1e-9, &free)[0];
        let gradient = |x: &[Point]| {
            let mut gradient = vec![Vector::zeros(); 1];
            energy.evaluate(x, 1e-9, &[0], &mut vec![], &mut gradient);
            gradient[0]
        };
        for axis in 0..3 {
            let at = |step: f64| {
                let mut moved = x.clone();
                moved[0][axis] += step;
                gradient(&moved)
            };
            // The determinant of a tetrahedron is linear in a node, so that nothing is left out.
            let column = (at(1e-5) - at(-1e-5)) / 2e-5;
            assert!((column - block.column(axis)).norm() < 1e-4 * block.norm(), "{axis}");
        }
    }

    #[test]
    fn an_undeformed_cube_has_the_least_energy() {
        let tets = crate::baseline::test_meshes::cube(2);
        let boundary = tets.boundary();
        let surface = boundary.surface;
        let label = |t: usize| {
            let normal = surface.area_vector(t).normalize();
            let axis = normal.iamax();
            (2 * axis + usize::from(normal[axis] > 0.0)) as u8
        };
        let labels: Vec<u8> = (0..surface.triangles().len()).map(label).collect();
        let faces: Vec<[u32; 3]> = surface
            .triangles()
            .iter()
            .map(|t| t.map(|v| boundary.vertex_ids[v as usize]))
            .collect();
        let (nodes, tets) = tets.into_parts();
        let references = References::new(&tets, &faces, &nodes);
        let energy = PolycubeEnergy::new(tets, faces, &labels, references, nodes.len());
        // 3 + 2 for tetrahedra, half of 2 + 2 for triangles.
        let value = energy.evaluate(&nodes, 1e-12, &[], &mut vec![], &mut []);
        assert!((value.energy - 7.0).abs() < 1e-9 && value.inverted == 0, "{value:?}");
    }
}

//! The discrete harmonic energy of maps that are linear over tetrahedra.
//!
//! Wang, Gu, Thompson & Yau, *3D harmonic mapping and tetrahedral meshing of brain imaging data* (2004), write it as a
//! sum over edges, `E(f) = Σ k_uv |f(u) − f(v)|²` with `k_uv = Σ l cot θ / 12` over the tetrahedra around the edge `uv`:
//! `l` is the length of the edge opposite to `uv` in the tetrahedron, `θ` the dihedral angle there. That is
//! `½ ∫ ‖J‖²`, the usual Dirichlet energy and half of [`crate::energy::harmonic_density`]. The matrix of linear finite
//! elements has `∫ ∇φ_u · ∇φ_v = −Σ l cot θ / 6 = −2 k_uv` off its diagonal, so that the two have the same minimiser.
//! Weights are negative where obtuse angles prevail; the energy of a mesh without flat tetrahedra is positive all the
//! same, since it is that of the gradient in each.

use rayon::prelude::*;

use super::BaselineError;
use crate::mesh::TetMesh;
use crate::{Matrix3, Point, Vector};

/// The edges of a tetrahedron by their ends, in the order of its weights.
pub const EDGES: [[usize; 2]; 6] = [[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]];

/// Determinant of a [`ScaledTet`] below which a tetrahedron counts as flat: its volume then consists of rounding
/// errors.
const FLAT: f64 = 64.0 * f64::EPSILON;

/// Rows per task.
const ROWS: usize = 1024;

/// Edge weights `k_uv` of a mesh, as a symmetric sparse matrix without a diagonal.
#[derive(Debug, Clone, PartialEq)]
pub struct TetStiffness(SparseRows);

/// The entries of a sparse matrix, row after row.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct SparseRows {
    begin: Vec<usize>,
    columns: Vec<u32>,
    values: Vec<f64>,
}

impl SparseRows {
    /// `fill` adds the entries of one row to an empty list.
    pub fn assemble(count: usize, fill: impl Fn(usize, &mut Vec<(u32, f64)>) + Sync) -> Self {
        let parts = (0..count.div_ceil(ROWS)).into_par_iter().map(|part| {
            let (mut ends, mut entries, mut row) = (Vec::new(), Vec::new(), Vec::new());
            for i in part * ROWS..((part + 1) * ROWS).min(count) {
                fill(i, &mut row);
                entries.append(&mut row);
                ends.push(entries.len());
            }
            (ends, entries)
        });
        let parts: Vec<_> = parts.collect();
        let entries = parts.iter().map(|part| part.1.len()).sum();
        let mut begin = Vec::with_capacity(count + 1);
        let (mut columns, mut values) = (Vec::with_capacity(entries), Vec::with_capacity(entries));
        begin.push(0);
        for (ends, entries) in parts {
            begin.extend(ends.iter().map(|end| columns.len() + end));
            columns.extend(entries.iter().map(|entry| entry.0));
            values.extend(entries.iter().map(|entry| entry.1));
        }
        Self { begin, columns, values }
    }

    /// Columns and values of a row.
    pub fn row(&self, i: usize) -> impl Iterator<Item = (usize, f64)> + '_ {
        let (columns, values) = self.row_slices(i);
        columns.iter().map(|&c| c as usize).zip(values.iter().copied())
    }

    fn row_slices(&self, i: usize) -> (&[u32], &[f64]) {
        let row = self.begin[i]..self.begin[i + 1];
        (&self.columns[row.clone()], &self.values[row])
    }

    /// Number of entries of all rows.
    pub fn len(&self) -> usize {
        self.columns.len()
    }
}

impl TetStiffness {
    /// The edge weights of a mesh. Tetrahedra of either orientation count alike.
    ///
    /// # Errors
    ///
    /// [`BaselineError::NoTets`], [`BaselineError::NonFiniteVertex`] and [`BaselineError::FlatTet`].
    pub fn new(mesh: &TetMesh) -> Result<Self, BaselineError> {
        Self::with_incidence(mesh, &Incidence::new(mesh))
    }

    pub(super) fn with_incidence(mesh: &TetMesh, incidence: &Incidence) -> Result<Self, BaselineError> {
        check_vertices(mesh)?;
        let of_tets = weights_of_tets(mesh)?;
        let rows = SparseRows::assemble(mesh.vertices().len(), |v, row| {
            let v = v as u32;
            for &t in incidence.of(v) {
                let corners = mesh.tets()[t as usize];
                for (&[a, b], &weight) in EDGES.iter().zip(&of_tets[t as usize]) {
                    if corners[a] == v {
                        row.push((corners[b], weight));
                    } else if corners[b] == v {
                        row.push((corners[a], weight));
                    }
                }
            }
            // The sort is stable: from either end, the terms of an edge are added in the order of the tetrahedra, and
            // the matrix is symmetric to the last bit.
            row.sort_by_key(|&(neighbour, _)| neighbour);
            row.dedup_by(|(next, term), (neighbour, sum)| {
                let is_same = next == neighbour;
                if is_same {
                    *sum += *term;
                }
                is_same
            });
        });
        Ok(Self(rows))
    }

    /// Number of vertices.
    pub fn vertices(&self) -> usize {
        self.0.begin.len() - 1
    }

    /// The vertices that share an edge with `v`, ascending, and the weights of those edges.
    ///
    /// # Panics
    ///
    /// Where the mesh has no vertex `v`.
    pub fn edges_of(&self, v: usize) -> (&[u32], &[f64]) {
        self.0.row_slices(v)
    }

    /// The energy `Σ k_uv |f(u) − f(v)|²` over the edges: `½ ∫ ‖J‖²` of the map that carries vertex `v` to `images[v]`.
    ///
    /// # Errors
    ///
    /// [`BaselineError::ImageCount`] unless there is one image per vertex.
    pub fn energy(&self, images: &[Point]) -> Result<f64, BaselineError> {
        if images.len() != self.vertices() {
            return Err(BaselineError::ImageCount {
                expected: self.vertices(),
                found: images.len(),
            });
        }
        let of_vertex = |v: usize| {
            let (neighbours, weights) = self.edges_of(v);
            let edges = neighbours.iter().zip(weights);
            // Every edge is met from both of its ends.
            edges.map(move |(&u, k)| 0.5 * k * (images[u as usize] - images[v]).norm_squared())
        };
        let of_parts = (0..self.vertices().div_ceil(ROWS)).into_par_iter().map(|part| {
            let rows = part * ROWS..((part + 1) * ROWS).min(self.vertices());
            rows.flat_map(of_vertex).sum::<f64>()
        });
        Ok(of_parts.collect::<Vec<f64>>().iter().sum())
    }
}

/// The weights `l cot θ / 12` of a tetrahedron's edges, in the order of [`EDGES`]; `None` when it is flat.
///
/// With `G_a = det · ∇φ_a`, where `φ_a` is the linear function that is 1 in corner `a` and 0 in the others and `det` six
/// times the volume, `l cot θ = −G_a · G_b / |det|`: no angle is computed.
pub fn tet_weights(corners: &[Point; 4]) -> Option<[f64; 6]> {
    let frame = ScaledTet::new(corners)?;
    let gradients = frame.scaled_gradients();
    let factor = -frame.side / (12.0 * frame.det.abs());
    Some(EDGES.map(|[a, b]| factor * gradients[a].dot(&gradients[b])))
}

/// A tetrahedron's edges from its first corner, in units of their largest coordinate, so that nothing over- or
/// underflows.
pub(super) struct ScaledTet {
    pub side: f64,
    edges: Matrix3,
    det: f64,
}

impl ScaledTet {
    /// `None` when the tetrahedron is flat or not finite.
    pub fn new([a, b, c, d]: &[Point; 4]) -> Option<Self> {
        let edges = [b - a, c - a, d - a];
        let side = edges.iter().map(Vector::amax).fold(0.0, f64::max);
        let edges = Matrix3::from_columns(&edges.map(|e| e / side));
        let det = edges.determinant();
        (det.abs() > FLAT && side.is_finite()).then_some(Self { side, edges, det })
    }

    /// Rows of the inverse edge matrix times the determinant, for the last three corners; they sum to zero with the
    /// first.
    fn scaled_gradients(&self) -> [Vector; 4] {
        let [e1, e2, e3] = [0, 1, 2].map(|k| self.edges.column(k).into_owned());
        let (second, third, fourth) = (e2.cross(&e3), e3.cross(&e1), e1.cross(&e2));
        [-(second + third + fourth), second, third, fourth]
    }

    /// Gradients of the barycentric coordinates of the last three corners, as rows.
    pub fn inverse(&self) -> Matrix3 {
        let [_, second, third, fourth] = self.scaled_gradients();
        let factor = 1.0 / (self.det * self.side);
        Matrix3::from_rows(&[second, third, fourth].map(|g| (g * factor).transpose()))
    }
}

/// Which tetrahedra meet in a vertex.
pub(super) struct Incidence {
    begin: Vec<usize>,
    tets: Vec<u32>,
}

impl Incidence {
    pub fn new(mesh: &TetMesh) -> Self {
        let mut begin = vec![0; mesh.vertices().len() + 1];
        mesh.tets().iter().flatten().for_each(|&v| begin[v as usize + 1] += 1);
        for v in 1..begin.len() {
            begin[v] += begin[v - 1];
        }
        let mut next = begin.clone();
        let mut tets = vec![0; 4 * mesh.tets().len()];
        for (t, corners) in mesh.tets().iter().enumerate() {
            for &v in corners {
                tets[next[v as usize]] = t as u32;
                next[v as usize] += 1;
            }
        }
        Self { begin, tets }
    }

    /// The tetrahedra at a vertex, ascending.
    pub fn of(&self, v: u32) -> &[u32] {
        &self.tets[self.begin[v as usize]..self.begin[v as usize + 1]]
    }
}

/// Refuses meshes without tetrahedra, and corners that are not finite.
pub(super) fn check_vertices(mesh: &TetMesh) -> Result<(), BaselineError> {
    if mesh.tets().is_empty() {
        return Err(BaselineError::NoTets);
    }
    let is_finite = |&v: &u32| mesh.vertices()[v as usize].iter().all(|c| c.is_finite());
    let broken = mesh.tets().par_iter().find_first(|tet| !tet.iter().all(is_finite));
    match broken.and_then(|tet| tet.iter().find(|v| !is_finite(v))) {
        None => Ok(()),
        Some(&vertex) => Err(BaselineError::NonFiniteVertex {
            vertex,
            position: mesh.vertices()[vertex as usize],
        }),
    }
}

fn weights_of_tets(mesh: &TetMesh) -> Result<Vec<[f64; 6]>, BaselineError> {
    let weights = (0..mesh.tets().len()).into_par_iter();
    let weights: Vec<[f64; 6]> = weights
        .map(|t| tet_weights(&mesh.corners(t)).unwrap_or([f64::NAN; 6]))
        .collect();
    match weights.par_iter().position_first(|w| w.iter().any(|k| !k.is_finite())) {
        None => Ok(weights),
        Some(tet) => Err(BaselineError::FlatTet {
            tet,
            vertices: mesh.tets()[tet],
            volume: mesh.signed_volume(tet).abs(),
        }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::baseline::test_meshes::{ball, cube, torus};

    fn regular() -> [Point; 4] {
        [[1., 1., 1.], [1., -1., -1.], [-1., 1., -1.], [-1., -1., 1.]].map(Point::from)
    }

    /// The corner of a cube: right angles along the legs, `cos θ = 1/√3` along the three sides of length √2 opposite to
    /// them.
    fn corner() -> [Point; 4] {
        [[0., 0., 0.], [1., 0., 0.], [0., 1., 0.], [0., 0., 1.]].map(Point::from)
    }

    #[test]
    fn weights_of_a_regular_tetrahedron_are_those_by_hand() {
        // Sides of 2√2 and cos θ = 1/3, so that cot θ = 1/√8: l cot θ = 1.
        for weight in tet_weights(&regular()).unwrap() {
            assert!((weight - 1.0 / 12.0).abs() < 1e-16);
        }
    }

    #[test]
    fn weights_of_a_cube_corner_are_those_by_hand() {
        // Opposite to a leg lies a side: √2 · cot θ = √2 / √2 = 1. Opposite to a side lies a leg, with a right angle.
        let weights = tet_weights(&corner()).unwrap();
        for (k, weight) in weights.into_iter().enumerate() {
            let expected = if k < 3 { 1.0 / 12.0 } else { 0.0 };
            assert!((weight - expected).abs() < 1e-16, "{k}: {weight}");
        }
    }

    #[test]
    fn weights_are_lengths_times_cotangents_of_dihedral_angles() {
        let corners = [[0.1, 0.2, -0.1], [1.3, 0.1, 0.2], [0.2, 0.9, 0.1], [0.4, 0.1, 1.7]].map(Point::from);
        let weights = tet_weights(&corners).unwrap();
        for (&[a, b], weight) in EDGES.iter().zip(weights) {
            let others: Vec<usize> = (0..4).filter(|&k| k != a && k != b).collect();
            let (c, d) = (corners[others[0]], corners[others[1]]);
            let along = (d - c).normalize();
            // The directions from the opposite edge to either end, perpendicular to it.
            let [p, q] = [a, b].map(|k| {
                let to = corners[k] - c;
                to - along * along.dot(&to)
            });
            let expected = (d - c).norm() / p.angle(&q).tan() / 12.0;
            assert!((weight - expected).abs() < 1e-14, "{weight} {expected}");
        }
    }

    #[test]
    fn matrix_is_symmetric_to_the_last_bit() {
        let stiffness = TetStiffness::new(&ball(5)).unwrap();
        for v in 0..stiffness.vertices() {
            let (neighbours, weights) = stiffness.edges_of(v);
            assert!(neighbours.is_sorted_by(|a, b| a < b));
            for (&u, weight) in neighbours.iter().zip(weights) {
                let (back, of_back) = stiffness.edges_of(u as usize);
                let at = back.binary_search(&(v as u32)).unwrap();
                assert_eq!(of_back[at], *weight);
            }
        }
    }

    /// A linear function is harmonic: around a vertex off the boundary its weighted differences cancel.
    #[test]
    fn rows_off_the_boundary_annihilate_linear_functions() {
        let mesh = torus(6);
        let boundary = mesh.boundary().vertex_ids;
        let stiffness = TetStiffness::new(&mesh).unwrap();
        for v in (0..mesh.vertices().len()).filter(|v| boundary.binary_search(&(*v as u32)).is_err()) {
            let (neighbours, weights) = stiffness.edges_of(v);
            let edges = neighbours.iter().zip(weights);
            let sum: Vector = edges
                .map(|(&u, &k)| k * (mesh.vertices()[u as usize] - mesh.vertices()[v]))
                .sum();
            assert!(sum.norm() < 1e-14, "{sum}");
        }
    }

    #[test]
    fn energy_of_a_linear_map_is_half_its_squared_norm_times_the_volume() {
        let matrix = Matrix3::new(1.2, 0.5, -0.3, 0.1, 0.8, 0.2, -0.4, 0.3, 1.1);
        for mesh in [cube(4), ball(4), torus(4)] {
            let images: Vec<Point> = mesh.vertices().iter().map(|p| matrix * p).collect();
            let energy = TetStiffness::new(&mesh).unwrap().energy(&images).unwrap();
            let expected = 0.5 * matrix.norm_squared() * mesh.volume();
            assert!((energy / expected - 1.0).abs() < 1e-13, "{energy} {expected}");
        }
    }

    #[test]
    fn weights_follow_rigid_motions_and_units_of_the_domain() {
        let motion = nalgebra::Rotation3::new(Vector::new(0.3, -1.2, 2.0));
        let before = tet_weights(&corner()).unwrap();
        for unit in [1e-90, 1.0, 1e90] {
            let moved = corner().map(|p| motion * p * unit);
            let after = tet_weights(&moved).unwrap();
            for (a, b) in after.iter().zip(before) {
                assert!((a / unit - b).abs() < 1e-16);
            }
            let [a, b, c, d] = moved;
            let reflected = tet_weights(&[b, a, c, d]).unwrap();
            assert!((reflected[0] - after[0]).abs() <= 1e-15 * unit);
        }
    }

    #[test]
    fn rejects_meshes_without_gradients() {
        let mut vertices = corner().to_vec();
        let empty = TetMesh::new(vertices.clone(), vec![]).unwrap();
        assert_eq!(TetStiffness::new(&empty), Err(BaselineError::NoTets));
        vertices.push(Point::new(0.25, 0.25, 0.0));
        let flat = TetMesh::new(vertices.clone(), vec![[0, 1, 2, 3], [0, 1, 2, 4]]).unwrap();
        assert!(matches!(
            TetStiffness::new(&flat),
            Err(BaselineError::FlatTet {
                tet: 1,
                vertices: [0, 1, 2, 4],
                ..
            })
        ));
        vertices[4].y = f64::NAN;
        let broken = TetMesh::new(vertices, vec![[0, 1, 2, 3], [0, 1, 2, 4]]).unwrap();
        assert!(matches!(
            TetStiffness::new(&broken),
            Err(BaselineError::NonFiniteVertex { vertex: 4, .. })
        ));
        let stiffness = TetStiffness::new(&cube(2)).unwrap();
        assert!(matches!(
            stiffness.energy(&[]),
            Err(BaselineError::ImageCount { expected: 27, found: 0 })
        ));
    }
}

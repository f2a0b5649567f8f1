//! The minimiser of the discrete harmonic energy with the boundary held, as a linear system: for every vertex `v` off
//! the boundary, `Σ_u k_uv (f(v) − f(u)) = 0`.

use std::sync::Arc;

use rayon::prelude::*;

use super::boundary::{boundary_faces, vertices_of};
use super::stiffness::{Incidence, SparseRows, TetStiffness};
use super::tet_map::SharedMesh;
use super::{BaselineError, check_images};
use crate::geometry::morton_order;
use crate::mesh::TetMesh;
use crate::{Point, Vector};

/// Rows per task. Sums over all rows add the sums of such parts in order, so that they do not depend on the number
/// of threads.
pub(super) const ROWS: usize = 2048;

/// Values of a map at the unknowns, one row each.
pub(super) type UnknownValues = Vec<Vector>;

/// The system, its unknowns ordered along a space-filling curve.
#[derive(Debug, Clone)]
pub(super) struct Dirichlet {
    pub solid: Arc<SharedMesh>,
    /// Vertices on the boundary, ascending.
    pub fixed: Vec<u32>,
    /// Triangles of the boundary, by indices into `fixed`.
    pub faces: Vec<[u32; 3]>,
    /// The vertex of each unknown.
    pub free: Vec<u32>,
    /// The symmetric matrix without its diagonal; its entries are minus these weights.
    pub inner: SparseRows,
    /// Sum of all weights around each unknown.
    pub diagonal: Vec<f64>,
    /// Weights between unknowns and indices into `fixed`.
    pub outer: SparseRows,
    /// Weights between indices into `fixed`.
    rim: SparseRows,
}

impl Dirichlet {
    pub fn new(mesh: TetMesh) -> Result<Self, BaselineError> {
        let incidence = Incidence::new(&mesh);
        let stiffness = TetStiffness::with_incidence(&mesh, &incidence)?;
        let faces = boundary_faces(&mesh, &incidence);
        let fixed = vertices_of(&faces);

        let mut place = vec![u32::MAX; mesh.vertices().len()];
        set_indices(&fixed, &mut place);
        let is_free = |v: &u32| place[*v as usize] == u32::MAX && !incidence.of(*v).is_empty();
        let inside: Vec<u32> = (0..mesh.vertices().len() as u32).filter(is_free).collect();
        let positions: Vec<Point> = inside.iter().map(|&v| mesh.vertices()[v as usize]).collect();
        let free: Vec<u32> = morton_order(&positions).iter().map(|&i| inside[i as usize]).collect();

        let outer = rows_among(&stiffness, &free, &place);
        let rim = rows_among(&stiffness, &fixed, &place);
        let faces = faces.iter().map(|face| face.map(|v| place[v as usize])).collect();
        fixed.iter().for_each(|&v| place[v as usize] = u32::MAX);
        set_indices(&free, &mut place);
        let inner = rows_among(&stiffness, &free, &place);
        let sum = |&v: &u32| stiffness.edges_of(v as usize).1.iter().sum();
        let system = Self {
            solid: Arc::new(SharedMesh::new(mesh)),
            diagonal: free.par_iter().map(sum).collect(),
            fixed,
            faces,
            free,
            inner,
            outer,
            rim,
        };
        system.check_connected()?;
        Ok(system)
    }

    /// Refuses unknowns that no path of edges leads to from the boundary: they are undetermined, and the matrix is
    /// singular.
    fn check_connected(&self) -> Result<(), BaselineError> {
        let touches_boundary = |i: usize| self.outer.row(i).next().is_some();
        let mut is_connected: Vec<bool> = (0..self.free.len()).map(touches_boundary).collect();
        let mut pending: Vec<usize> = (0..self.free.len()).filter(|&i| is_connected[i]).collect();
        while let Some(i) = pending.pop() {
            for (j, _) in self.inner.row(i) {
                if !std::mem::replace(&mut is_connected[j], true) {
                    pending.push(j);
                }
            }
        }
        let unconnected = (0..self.free.len()).filter(|&i| !is_connected[i]).map(|i| self.free[i]);
        match unconnected.min() {
            Some(vertex) => Err(BaselineError::NoBoundary { vertex }),
            None => Ok(()),
        }
    }

    /// Checks boundary data, in the order of `fixed`, and returns their mean over the vertices, and the data minus
    /// that: data far from the origin would lose digits, and constant data are met exactly.
    pub fn centred(&self, images: &[Point]) -> Result<(Vector, UnknownValues), BaselineError> {
        check_images(images, self.fixed.len())?;
        let mean = sum_of_parts(images.len(), |i| images[i].coords) / images.len().max(1) as f64;
        Ok((mean, images.iter().map(|p| p.coords - mean).collect()))
    }

    /// The right-hand side for images of the boundary.
    pub fn right_hand_side(&self, images: &[Vector]) -> UnknownValues {
        self.each_unknown(|i| self.outer.row(i).map(|(j, k)| images[j] * k).sum())
    }

    /// The matrix times `values`.
    pub fn times(&self, values: &[Vector]) -> UnknownValues {
        self.each_unknown(|i| {
            let whole = values[i] * self.diagonal[i];
            whole - self.inner.row(i).map(|(j, k)| values[j] * k).sum::<Vector>()
        })
    }

    fn each_unknown(&self, value: impl Fn(usize) -> Vector + Send + Sync) -> UnknownValues {
        let unknowns = (0..self.free.len()).into_par_iter();
        unknowns.with_min_len(ROWS).map(value).collect()
    }

    /// The energy `Σ k_uv |f(u) − f(v)|²` of images of the unknowns and the boundary.
    pub fn energy(&self, values: &[Vector], boundary: &[Vector]) -> f64 {
        let inside = |i: usize| {
            let to_unknowns = self.inner.row(i);
            let to_boundary = self.outer.row(i);
            to_unknowns
                .map(|(j, k)| 0.5 * k * (values[j] - values[i]).norm_squared())
                .sum::<f64>()
                + to_boundary
                    .map(|(j, k)| k * (boundary[j] - values[i]).norm_squared())
                    .sum::<f64>()
        };
        let outside = |i: usize| {
            let edges = self.rim.row(i);
            edges
                .map(|(j, k)| 0.5 * k * (boundary[j] - boundary[i]).norm_squared())
                .sum::<f64>()
        };
        sum_of_parts(self.free.len(), inside) + sum_of_parts(self.fixed.len(), outside)
    }

    /// Images of all vertices. Those that no tetrahedron uses go to the mean.
    pub fn images(&self, mean: &Vector, values: &[Vector], boundary: &[Point]) -> Vec<Point> {
        let mut images = vec![Point::from(*mean); self.solid.mesh.vertices().len()];
        for (&v, value) in self.free.iter().zip(values) {
            images[v as usize] += value;
        }
        for (&v, &image) in self.fixed.iter().zip(boundary) {
            images[v as usize] = image;
        }
        images
    }
}

/// The rows of these vertices, restricted to the columns of vertices that have an index (not `u32::MAX`), ascending by
/// it.
fn rows_among(stiffness: &TetStiffness, vertices: &[u32], index: &[u32]) -> SparseRows {
    SparseRows::assemble(vertices.len(), |i, row| {
        let (neighbours, weights) = stiffness.edges_of(vertices[i] as usize);
        let columns = neighbours.iter().map(|&u| index[u as usize]);
        row.extend(columns.zip(weights.iter().copied()).filter(|entry| entry.0 != u32::MAX));
        row.sort_unstable_by_key(|entry| entry.0);
    })
}

fn set_indices(vertices: &[u32], place: &mut [u32]) {
    for (i, &v) in vertices.iter().enumerate() {
        place[v as usize] = i as u32;
    }
}

/// Sum over `0..count`, the same for any number of threads.
pub(super) fn sum_of_parts<T>(count: usize, term: impl Fn(usize) -> T + Sync) -> T
where
    T: Send + std::iter::Sum<T>,
{
    let parts = (0..count.div_ceil(ROWS)).into_par_iter();
    let sums = parts.map(|part| (part * ROWS..((part + 1) * ROWS).min(count)).map(&term).sum());
    sums.collect::<Vec<T>>().into_iter().sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::baseline::test_meshes::{ball, torus};

    #[test]
    fn energy_is_that_of_the_edges() {
        for mesh in [ball(5), torus(3)] {
            let stiffness = TetStiffness::new(&mesh).unwrap();
            let image = |p: &Point| Point::new(p.x.sin(), p.y * p.z, p.x - p.z);
            let images: Vec<Point> = mesh.vertices().iter().map(image).collect();
            let expected = stiffness.energy(&images).unwrap();
            let system = Dirichlet::new(mesh).unwrap();
            let at =
                |vertices: &[u32]| -> UnknownValues { vertices.iter().map(|&v| images[v as usize].coords).collect() };
            let found = system.energy(&at(&system.free), &at(&system.fixed));
            assert!((found / expected - 1.0).abs() < 1e-13);
        }
    }

    #[test]
    fn solids_without_a_boundary_are_refused() {
        // Every triangle belongs to two tetrahedra.
        let mesh = ball(2);
        let twice = [mesh.tets(), mesh.tets()].concat();
        let twice = TetMesh::new(mesh.vertices().to_vec(), twice).unwrap();
        assert!(matches!(
            Dirichlet::new(twice),
            Err(BaselineError::NoBoundary { vertex: 0 })
        ));
    }
}

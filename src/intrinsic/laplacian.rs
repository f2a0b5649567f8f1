//! The Laplacian of an intrinsic triangulation: cotangent stiffness, and a diagonal mass matrix.

use super::triangulation::{IntrinsicTriangulation, area, cotangents};
use crate::spherical::Cholesky;

/// The stiffness matrix `L`, positive semidefinite with the constants as kernel, and the lumped masses `M`, of sum 1.
#[derive(Debug, Clone)]
pub(super) struct Laplacian {
    /// The lower triangle of `L` by columns, the diagonal first: column `j` has the rows `rows[begin[j]..begin[j + 1]]`,
    /// ascending.
    begin: Vec<u32>,
    rows: Vec<u32>,
    values: Vec<f64>,
    /// A third of the area of the triangles at each vertex.
    pub masses: Vec<f64>,
}

impl Laplacian {
    pub fn new(triangulation: &IntrinsicTriangulation) -> Self {
        let n = triangulation.vertices;
        let mut masses = vec![0.0; n];
        let mut diagonal = vec![0.0; n];
        let mut entries = Vec::with_capacity(3 * triangulation.triangles.len());
        for (corners, lengths) in triangulation.triangles.iter().zip(&triangulation.lengths) {
            let third = area(lengths) / 3.0;
            for (k, cotangent) in cotangents(lengths).into_iter().enumerate() {
                let [i, j] = [corners[k], corners[(k + 1) % 3]];
                masses[i as usize] += third;
                if i != j {
                    entries.push((i.min(j), i.max(j), cotangent / 2.0));
                    diagonal[i as usize] += cotangent / 2.0;
                    diagonal[j as usize] += cotangent / 2.0;
                }
            }
        }
        entries.sort_by_key(|&(column, row, _)| (column, row));
        let (mut begin, mut rows, mut values) = (vec![0], Vec::new(), Vec::new());
        let mut entries = entries.into_iter().peekable();
        for (j, diagonal) in diagonal.into_iter().enumerate() {
            rows.push(j as u32);
            values.push(diagonal);
            while let Some((_, row, weight)) = entries.next_if(|&(column, ..)| column as usize == j) {
                if rows.last() == Some(&row) {
                    *values.last_mut().expect("as many as rows") -= weight;
                } else {
                    rows.push(row);
                    values.push(-weight);
                }
            }
            begin.push(rows.len() as u32);
        }
        Self {
            begin,
            rows,
            values,
            masses,
        }
    }

    /// The factorisation of `a L + b M`. `None` when it does not fit into memory or the matrix is not positive definite.
    pub fn factored(&self, a: f64, b: f64) -> Option<Cholesky> {
        let mut values: Vec<f64> = self.values.iter().map(|value| a * value).collect();
        for (&diagonal, mass) in self.begin.iter().zip(&self.masses) {
            values[diagonal as usize] += b * mass;
        }
        let mut cholesky = Cholesky::new(self.begin.clone(), self.rows.clone()).ok()?;
        cholesky.factor(&values).then_some(cholesky)
    }

    /// The neighbours of every vertex in the triangulation: those of vertex `v` are `list[begin[v]..begin[v + 1]]`.
    pub fn neighbours(&self) -> Neighbours {
        let n = self.masses.len();
        let mut begin = vec![0u32; n + 1];
        let pairs = || {
            let columns = self.begin.windows(2).enumerate();
            columns.flat_map(|(j, range)| {
                self.rows[range[0] as usize + 1..range[1] as usize]
                    .iter()
                    .map(move |&i| (i as usize, j))
            })
        };
        for (i, j) in pairs() {
            begin[i + 1] += 1;
            begin[j + 1] += 1;
        }
        for v in 0..n {
            begin[v + 1] += begin[v];
        }
        let mut next = begin.clone();
        let mut list = vec![0; begin[n] as usize];
        for (i, j) in pairs() {
            for (v, other) in [(i, j), (j, i)] {
                list[next[v] as usize] = other as u32;
                next[v] += 1;
            }
        }
        Neighbours { begin, list }
    }

    /// `L x`.
    #[cfg(test)]
    pub fn applied_to(&self, x: &[f64]) -> Vec<f64> {
        let mut y = vec![0.0; x.len()];
        for (j, range) in self.begin.windows(2).enumerate() {
            for at in range[0] as usize..range[1] as usize {
                let (i, value) = (self.rows[at] as usize, self.values[at]);
                y[i] += value * x[j];
                if i != j {
                    y[j] += value * x[i];
                }
            }
        }
        y
    }
}

/// Lists of neighbours.
#[derive(Debug, Clone)]
pub(super) struct Neighbours {
    begin: Vec<u32>,
    list: Vec<u32>,
}

impl Neighbours {
    pub fn of(&self, vertex: u32) -> &[u32] {
        &self.list[self.begin[vertex as usize] as usize..self.begin[vertex as usize + 1] as usize]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::shapes;

    /// On a regular tetrahedron of area 1 every edge has the weight `cot 60°`, and every vertex a quarter of the area.
    #[test]
    fn the_laplacian_of_a_regular_tetrahedron() {
        let p = crate::Point::new;
        let points = [p(1., 1., 1.), p(1., -1., -1.), p(-1., 1., -1.), p(-1., -1., 1.)];
        let triangles = [[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]];
        let laplacian = Laplacian::new(&IntrinsicTriangulation::delaunay(&points, &triangles).unwrap());
        let weight = 3f64.sqrt().recip();
        let applied = laplacian.applied_to(&[1.0, 0.0, 0.0, 0.0]);
        let expected = [3.0 * weight, -weight, -weight, -weight];
        assert!(applied.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-12));
        assert!(laplacian.masses.iter().all(|m| (m - 0.25).abs() < 1e-12));
        assert_eq!(laplacian.neighbours().of(2), [0, 1, 3]);
    }

    #[test]
    fn constants_are_in_the_kernel_and_the_factorisation_solves() {
        let mesh = shapes::bumpy_sphere(12);
        let triangulation = IntrinsicTriangulation::delaunay(mesh.vertices(), mesh.triangles()).unwrap();
        let laplacian = Laplacian::new(&triangulation);
        let n = mesh.vertices().len();
        assert!(laplacian.applied_to(&vec![1.0; n]).iter().all(|y| y.abs() < 1e-12));
        let x: Vec<f64> = (0..n).map(|i| (i as f64).sin()).collect();
        let mut y: Vec<f64> = laplacian.applied_to(&x);
        y.iter_mut()
            .zip(&x)
            .zip(&laplacian.masses)
            .for_each(|((y, x), m)| *y = 2.0 * *y + 3.0 * m * x);
        laplacian.factored(2.0, 3.0).unwrap().solve_shared(&mut y);
        // The condition number is some 1e5.
        assert!(y.iter().zip(&x).all(|(y, x)| (y - x).abs() < 1e-10));
    }
}

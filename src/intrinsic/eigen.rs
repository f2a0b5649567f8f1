//! The lowest eigenpairs of the Laplacian: block Lanczos on the inverse, shifted.
//!
//! With `M` the lumped masses, `(L + s M)⁻¹` has the eigenvectors of `L φ = λ M φ` and the eigenvalues `1 / (λ + s)`, whose
//! largest a Krylov space finds first (Ericsson & Ruhe, *The spectral transformation Lanczos method*, Math. Comp. 35,
//! 1980). Blocks find multiple eigenvalues, which symmetric surfaces have; the basis is orthogonalised twice against all
//! of itself and never restarted.

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::evd::{ComputeEigenvectors, self_adjoint_evd, self_adjoint_evd_scratch};
use faer::linalg::matmul::matmul;
use faer::{Accum, Mat, MatMut, MatRef, Par};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::laplacian::Laplacian;

/// Columns of a block.
const BLOCK: usize = 4;
/// The shift: below the least positive eigenvalue of a surface of area 1, about 10.
const SHIFT: f64 = 1.0;
/// Relative residual of eigenvalues of the inverse. Errors of eigenvalues are of the order of its square.
const TOLERANCE: f64 = 1e-7;
/// Columns of the basis for each eigenpair at the first test of convergence, and their growth from test to test.
const FIRST_TEST: f64 = 2.2;
const GROWTH: f64 = 1.12;

/// Eigenvalues, ascending, and orthonormal eigenfunctions. The first is constant and positive; each other one has a
/// positive mean cube.
#[derive(Debug, Clone)]
pub(super) struct Eigenpairs {
    pub values: Vec<f64>,
    /// Rows for the vertices, one after the other.
    pub functions: Vec<f64>,
}

impl Eigenpairs {
    /// The lowest `count` pairs, the constant one among them. `None` when there are not enough, when `proceed` says no,
    /// or without memory.
    pub fn lowest(laplacian: &Laplacian, count: usize, proceed: &(dyn Fn() -> bool + Sync)) -> Option<Self> {
        let n = laplacian.masses.len();
        if count == 0 || count > n {
            return None;
        }
        let roots: Vec<f64> = laplacian.masses.iter().map(|mass| mass.sqrt()).collect();
        let inverse = laplacian.factored(1.0, SHIFT)?;
        let apply = |block: &mut [f64]| {
            block.chunks_mut(n).for_each(|column| scale(column, &roots));
            inverse.solve_shared(block);
            block.chunks_mut(n).for_each(|column| scale(column, &roots));
        };
        let mut space = KrylovSpace::new(&roots, n);
        let mut next_test = (FIRST_TEST * count as f64) as usize;
        let ritz = loop {
            if !proceed() {
                return None;
            }
            let exhausted = !space.grow(&apply);
            if exhausted || space.columns() >= next_test {
                let ritz = space.ritz_pairs()?;
                if exhausted || ritz.largest_residual(count - 1) < TOLERANCE {
                    break ritz;
                }
                next_test = (GROWTH * next_test as f64) as usize;
            }
        };
        if ritz.values.len() + 1 < count {
            return None;
        }
        let values = ritz.values[..count - 1]
            .iter()
            .map(|inverse| (inverse.recip() - SHIFT).max(0.0));
        let values = std::iter::once(0.0).chain(values).collect();
        let vectors = space.combined(&ritz, count - 1);
        Some(Self {
            values,
            functions: functions(&vectors, &roots, count),
        })
    }

    /// Number of pairs.
    pub fn count(&self) -> usize {
        self.values.len()
    }

    /// The eigenfunctions' values at a vertex.
    pub fn at(&self, vertex: u32) -> &[f64] {
        let k = self.count();
        &self.functions[vertex as usize * k..][..k]
    }
}

/// An orthonormal basis of the Krylov space, column by column, and the operator in it, a block tridiagonal matrix. The
/// first column is the constant mode, which all others are orthogonal to.
struct KrylovSpace {
    n: usize,
    basis: Vec<f64>,
    /// Columns of the basis that the operator has been applied to, without the first.
    applied: usize,
    /// The blocks of the diagonal and, below each, that which couples it to the next: rows first.
    blocks: Vec<[[[f64; BLOCK]; BLOCK]; 2]>,
    random: ChaCha8Rng,
}

struct RitzPairs {
    /// Eigenvalues of the inverse, descending.
    values: Vec<f64>,
    /// Columns ascend as the eigenvalues do.
    vectors: Mat<f64>,
    coupling: [[f64; BLOCK]; BLOCK],
}

impl KrylovSpace {
    fn new(roots: &[f64], n: usize) -> Self {
        let mut made = Self {
            n,
            basis: roots.to_vec(),
            applied: 0,
            blocks: Vec::new(),
            random: ChaCha8Rng::seed_from_u64(0),
        };
        let norm = roots.iter().map(|x| x * x).sum::<f64>().sqrt();
        made.basis.iter_mut().for_each(|x| *x /= norm);
        let mut block: Vec<f64> = (0..BLOCK * n).map(|_| made.random.random_range(-1.0..1.0)).collect();
        // Random at every vertex of the surface, not in its masses.
        block.chunks_mut(n).for_each(|column| scale(column, roots));
        made.append(block);
        made
    }

    /// Columns that the operator has been applied to.
    fn columns(&self) -> usize {
        self.applied
    }

    /// Applies the operator to the last block. False when the space has no room for another.
    fn grow(&mut self, apply: &dyn Fn(&mut [f64])) -> bool {
        let last = self.basis[(1 + self.applied) * self.n..].to_vec();
        let mut block = last.clone();
        apply(&mut block);
        let mut diagonal = [[0.0; BLOCK]; BLOCK];
        for (j, column) in block.chunks(self.n).enumerate() {
            for (i, with) in last.chunks(self.n).enumerate() {
                diagonal[i][j] = dot(with, column);
            }
        }
        self.applied += BLOCK;
        if 1 + self.applied + BLOCK > self.n {
            self.blocks.push([diagonal, [[0.0; BLOCK]; BLOCK]]);
            return false;
        }
        let coupling = self.append(block);
        self.blocks.push([diagonal, coupling]);
        true
    }

    /// Appends a block, orthonormalised. Returns the upper triangular factor.
    fn append(&mut self, mut block: Vec<f64>) -> [[f64; BLOCK]; BLOCK] {
        let n = self.n;
        let sizes: Vec<f64> = block.chunks(n).map(norm).collect();
        (0..2).for_each(|_| self.project_out(&mut block));
        let mut factor = [[0.0; BLOCK]; BLOCK];
        for j in 0..BLOCK {
            let (before, column) = block.split_at_mut(j * n);
            let column = &mut column[..n];
            for _ in 0..2 {
                for (i, with) in before.chunks(n).enumerate() {
                    let along = dot(with, column);
                    factor[i][j] += along;
                    column.iter_mut().zip(with).for_each(|(x, y)| *x -= along * y);
                }
            }
            let mut size = norm(column);
            if size > 1e-12 * sizes[j] {
                factor[j][j] = size;
            } else {
                // The space is invariant: it goes on with any other direction.
                column.iter_mut().for_each(|x| *x = self.random.random_range(-1.0..1.0));
                for _ in 0..3 {
                    project(&self.basis, n, column);
                    project(before, n, column);
                }
                size = norm(column);
            }
            column.iter_mut().for_each(|x| *x /= size);
        }
        self.basis.extend(block);
        factor
    }

    fn project_out(&self, block: &mut [f64]) {
        project(&self.basis, self.n, block);
    }

    fn ritz_pairs(&self) -> Option<RitzPairs> {
        let m = self.applied;
        let mut operator = Mat::zeros(m, m);
        for (b, [diagonal, coupling]) in self.blocks.iter().enumerate() {
            let first = b * BLOCK;
            for (i, j) in (0..BLOCK).flat_map(|i| (0..BLOCK).map(move |j| (i, j))) {
                operator[(first + i, first + j)] = (diagonal[i][j] + diagonal[j][i]) / 2.0;
                if first + BLOCK < m {
                    operator[(first + BLOCK + i, first + j)] = coupling[i][j];
                }
            }
        }
        let mut vectors = Mat::zeros(m, m);
        let mut values = faer::Col::zeros(m);
        let scratch = self_adjoint_evd_scratch::<f64>(m, ComputeEigenvectors::Yes, Par::Seq, Default::default());
        let mut scratch = MemBuffer::try_new(scratch).ok()?;
        let (values_out, vectors_out) = (values.as_diagonal_mut(), Some(vectors.as_mut()));
        let stack = MemStack::new(&mut scratch);
        self_adjoint_evd(
            operator.as_ref(),
            values_out,
            vectors_out,
            Par::Seq,
            stack,
            Default::default(),
        )
        .ok()?;
        Some(RitzPairs {
            values: values.iter().rev().copied().collect(),
            vectors,
            coupling: self.blocks.last()?[1],
        })
    }

    /// The first `count` Ritz vectors, column by column.
    fn combined(&self, ritz: &RitzPairs, count: usize) -> Vec<f64> {
        let (n, m) = (self.n, self.applied);
        let mut vectors = vec![0.0; n * count];
        let basis = MatRef::from_column_major_slice(&self.basis[n..][..n * m], n, m);
        let factors = ritz.vectors.as_ref().reverse_cols().subcols(0, count);
        let out = MatMut::from_column_major_slice_mut(&mut vectors, n, count);
        matmul(out, Accum::Replace, basis, factors, 1.0, Par::Seq);
        vectors
    }
}

impl RitzPairs {
    /// The largest residual of the first `count` pairs, each relative to its eigenvalue.
    fn largest_residual(&self, count: usize) -> f64 {
        let m = self.vectors.nrows();
        let residual = |pair: usize| {
            let last = |i: usize| self.vectors[(m - BLOCK + i, m - 1 - pair)];
            let rows = self
                .coupling
                .iter()
                .map(|row| (0..BLOCK).map(|i| row[i] * last(i)).sum::<f64>());
            rows.map(|sum| sum * sum).sum::<f64>().sqrt() / self.values[pair]
        };
        (0..count.min(m)).map(residual).fold(0.0, f64::max)
    }
}

/// Takes from columns their parts in the span of an orthonormal basis.
fn project(basis: &[f64], n: usize, columns: &mut [f64]) {
    let (m, b) = (basis.len() / n, columns.len() / n);
    if m == 0 {
        return;
    }
    let basis = MatRef::from_column_major_slice(basis, n, m);
    let mut columns = MatMut::from_column_major_slice_mut(columns, n, b);
    let mut along = Mat::zeros(m, b);
    matmul(
        along.as_mut(),
        Accum::Replace,
        basis.transpose(),
        columns.as_ref(),
        1.0,
        Par::Seq,
    );
    matmul(columns.as_mut(), Accum::Add, basis, along.as_ref(), -1.0, Par::Seq);
}

/// Rows of eigenfunctions from columns of eigenvectors, which are the functions times the roots of the masses.
fn functions(vectors: &[f64], roots: &[f64], count: usize) -> Vec<f64> {
    let n = roots.len();
    let mut functions = vec![1.0; n * count];
    for (mode, vector) in vectors.chunks(n).enumerate() {
        let cubes = vector.iter().zip(roots).map(|(x, root)| x * x * x / root);
        let sign = if cubes.sum::<f64>() < 0.0 { -1.0 } else { 1.0 };
        for (v, (x, root)) in vector.iter().zip(roots).enumerate() {
            functions[v * count + mode + 1] = sign * x / root;
        }
    }
    functions
}

fn scale(column: &mut [f64], factors: &[f64]) {
    column.iter_mut().zip(factors).for_each(|(x, factor)| *x *= factor);
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(x, y)| x * y).sum()
}

fn norm(a: &[f64]) -> f64 {
    dot(a, a).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::intrinsic::triangulation::IntrinsicTriangulation;
    use crate::mesh::{SurfaceMesh, shapes};
    use std::f64::consts::PI;

    fn pairs(mesh: &SurfaceMesh, count: usize) -> (Laplacian, Eigenpairs) {
        let triangulation = IntrinsicTriangulation::delaunay(mesh.vertices(), mesh.triangles()).unwrap();
        let laplacian = Laplacian::new(&triangulation);
        let pairs = Eigenpairs::lowest(&laplacian, count, &|| true).unwrap();
        (laplacian, pairs)
    }

    /// Spherical harmonics of degree `l` have the eigenvalue `λ = l (l + 1)` on the unit sphere, `2 l + 1` times. Errors of
    /// linear elements of size `h`, here 1.2 / frequency, are some `λ h² / 12` of it.
    #[test]
    fn eigenvalues_of_a_sphere_converge_with_all_multiplicities() {
        let errors = [8, 16].map(|frequency| {
            let (_, found) = pairs(&shapes::geodesic_sphere(1.0, frequency), 81);
            let degrees = (0..9).flat_map(|l| std::iter::repeat_n(f64::from(l * (l + 1)), 2 * l as usize + 1));
            let errors = degrees
                .zip(&found.values)
                .skip(1)
                .map(|(exact, value)| (value / (4.0 * PI) / exact - 1.0).abs());
            errors.fold(0.0, f64::max)
        });
        assert!(errors[1] < 72.0 * (1.2f64 / 16.0).powi(2) / 12.0, "{errors:?}");
        assert!((3.5..4.5).contains(&(errors[0] / errors[1])), "{errors:?}");
    }

    #[test]
    fn pairs_solve_the_eigenvalue_problem_and_are_orthonormal() {
        let (laplacian, found) = pairs(&shapes::bumpy_sphere(10), 60);
        let (n, k) = (laplacian.masses.len(), found.count());
        let column = |j: usize| -> Vec<f64> { (0..n).map(|v| found.functions[v * k + j]).collect() };
        assert!(column(0).iter().all(|&x| x == 1.0));
        for j in 0..k {
            let (phi, value) = (column(j), found.values[j]);
            let applied = laplacian.applied_to(&phi);
            let residual =
                (0..n).map(|v| (applied[v] - value * laplacian.masses[v] * phi[v]).powi(2) / laplacian.masses[v]);
            // The tolerance of the inverse, times the eigenvalue for its scaling, and again for the norm of L.
            assert!(residual.sum::<f64>().sqrt() < 1e-3 * (1.0 + value), "{j}");
            for i in 0..=j {
                let product = column(i)
                    .iter()
                    .zip(&phi)
                    .zip(&laplacian.masses)
                    .map(|((a, b), m)| a * b * m)
                    .sum::<f64>();
                assert!((product - f64::from(i == j)).abs() < 1e-10, "{i} {j}");
            }
        }
    }

    #[test]
    fn small_surfaces_have_as_many_pairs_as_blocks_fit() {
        let (_, found) = pairs(&shapes::sphere(1.0, 1), 20);
        assert_eq!(found.count(), 20);
        assert!(found.values.windows(2).all(|pair| pair[0] <= pair[1] + 1e-9));
    }

    #[test]
    fn stops_when_told() {
        let mesh = shapes::bumpy_sphere(10);
        let triangulation = IntrinsicTriangulation::delaunay(mesh.vertices(), mesh.triangles()).unwrap();
        assert!(Eigenpairs::lowest(&Laplacian::new(&triangulation), 60, &|| false).is_none());
    }
}

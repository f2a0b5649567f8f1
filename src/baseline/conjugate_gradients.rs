//! Conjugate gradients, preconditioned by an incomplete Cholesky factorisation without fill (Meijerink & van der Vorst,
//! *An iterative solution method for linear systems of which the coefficient matrix is a symmetric M-matrix*, Math. Comp.
//! 31, 1977) of diagonal blocks, so that blocks can be factored and solved in parallel.
//!
//! The matrix is not an M-matrix where obtuse angles prevail, and the factorisation may break down. A block where it
//! does is factored with its diagonal enlarged until it does not (Manteuffel, *An incomplete factorization technique
//! for positive definite linear systems*, Math. Comp. 34, 1980).

use rayon::prelude::*;

use super::dirichlet::{Dirichlet, ROWS, UnknownValues, sum_of_parts};
use super::{BaselineError, HarmonicOptions};
use crate::Vector;

/// Rows of a block: few large blocks cost few extra iterations, and two already allow parallel work.
const BLOCK: usize = 1 << 14;
/// A pivot below this fraction of its diagonal entry counts as a breakdown.
const LEAST_PIVOT: f64 = 1e-3;
/// The first enlargement of a diagonal; the next ones are ten times as large.
const FIRST_SHIFT: f64 = 1e-3;
/// Iterations after which the residual is recomputed, so that rounding errors of the recurrence do not accumulate.
const REFRESH: usize = 50;

/// An incomplete factorisation of the diagonal blocks.
#[derive(Debug, Clone)]
pub(super) struct IncompleteCholesky {
    blocks: Vec<DiagonalBlock>,
}

/// `L` with `L Lᵀ ≈ A`, row by row.
#[derive(Debug, Clone)]
struct DiagonalBlock {
    /// Where the entries of each row begin, and the number of all entries.
    begin: Vec<usize>,
    /// Columns left of the diagonal, counted from the block's first, ascending.
    columns: Vec<u32>,
    entries: Vec<f64>,
    /// One over the diagonal of `L`.
    pivots: Vec<f64>,
}

impl IncompleteCholesky {
    pub fn new(system: &Dirichlet) -> Self {
        let count = system.free.len();
        let blocks = (0..count.div_ceil(BLOCK)).into_par_iter().map(|b| {
            let rows = b * BLOCK..((b + 1) * BLOCK).min(count);
            DiagonalBlock::new(system, rows)
        });
        Self {
            blocks: blocks.collect(),
        }
    }

    /// The inverse of the factorisation times the residual.
    fn apply(&self, residual: &[Vector]) -> UnknownValues {
        let mut values = residual.to_vec();
        let parts = values.par_chunks_mut(BLOCK);
        parts.zip(&self.blocks).for_each(|(values, block)| block.solve(values));
        values
    }
}

impl DiagonalBlock {
    fn new(system: &Dirichlet, rows: std::ops::Range<usize>) -> Self {
        let (mut begin, mut columns, mut matrix) = (vec![0], Vec::new(), Vec::new());
        for i in rows.clone() {
            let left = system.inner.row(i).filter(|&(j, _)| rows.contains(&j) && j < i);
            for (j, k) in left {
                columns.push((j - rows.start) as u32);
                matrix.push(-k);
            }
            begin.push(columns.len());
        }
        let mut block = Self {
            begin,
            columns,
            entries: Vec::new(),
            pivots: Vec::new(),
        };
        let diagonal = &system.diagonal[rows];
        let mut shift = 0.0;
        while !block.factor(&matrix, diagonal, 1.0 + shift) {
            shift = f64::max(FIRST_SHIFT, 10.0 * shift);
        }
        block
    }

    /// `false` when a pivot breaks down. Enlarged enough, any positive diagonal dominates and no pivot fails; a
    /// diagonal entry that is not positive is replaced by 1.
    fn factor(&mut self, matrix: &[f64], diagonal: &[f64], enlargement: f64) -> bool {
        self.entries.clear();
        self.entries.extend_from_slice(matrix);
        self.pivots.clear();
        for (i, &diagonal) in diagonal.iter().enumerate() {
            let row = self.begin[i]..self.begin[i + 1];
            let mut squares = 0.0;
            for at in row.clone() {
                let j = self.columns[at] as usize;
                let overlap = self.overlap(row.start..at, self.begin[j]..self.begin[j + 1]);
                let entry = (self.entries[at] - overlap) * self.pivots[j];
                self.entries[at] = entry;
                squares += entry * entry;
            }
            let whole = if diagonal > 0.0 {
                diagonal * enlargement
            } else {
                enlargement
            };
            let pivot = whole - squares;
            if pivot <= LEAST_PIVOT * whole && enlargement < 1e6 {
                return false;
            }
            self.pivots.push(1.0 / pivot.max(LEAST_PIVOT * whole).sqrt());
        }
        true
    }

    /// Dot product of the parts of two rows with these entries.
    fn overlap(&self, mut a: std::ops::Range<usize>, mut b: std::ops::Range<usize>) -> f64 {
        let mut sum = 0.0;
        while a.start < a.end && b.start < b.end {
            let (left, right) = (self.columns[a.start], self.columns[b.start]);
            if left == right {
                sum += self.entries[a.start] * self.entries[b.start];
            }
            a.start += usize::from(left <= right);
            b.start += usize::from(right <= left);
        }
        sum
    }

    fn solve(&self, values: &mut [Vector]) {
        for i in 0..values.len() {
            let mut value = values[i];
            for at in self.begin[i]..self.begin[i + 1] {
                value -= values[self.columns[at] as usize] * self.entries[at];
            }
            values[i] = value * self.pivots[i];
        }
        for i in (0..values.len()).rev() {
            let value = values[i] * self.pivots[i];
            values[i] = value;
            for at in self.begin[i]..self.begin[i + 1] {
                values[self.columns[at] as usize] -= value * self.entries[at];
            }
        }
    }
}

/// The solution for this right-hand side, its three columns in lock-step, and the number of iterations. The residual's
/// norm is at most `tolerance` times that of the right-hand side, in each column.
pub(super) fn solve(
    system: &Dirichlet,
    preconditioner: &IncompleteCholesky,
    right_hand_side: &[Vector],
    options: &HarmonicOptions,
) -> Result<(UnknownValues, usize), BaselineError> {
    let limit = dot(right_hand_side, right_hand_side) * (options.tolerance * options.tolerance);
    let mut solution = vec![Vector::zeros(); right_hand_side.len()];
    let mut residual = right_hand_side.to_vec();
    let mut direction = preconditioner.apply(&residual);
    let mut slope = dot(&residual, &direction);
    let mut squares = dot(&residual, &residual);
    let mut iteration = 0;
    loop {
        if (0..3).all(|c| squares[c] <= limit[c]) {
            return Ok((solution, iteration));
        }
        if iteration == options.most_iterations || !squares.iter().all(|s| s.is_finite()) {
            let relative = squares.component_div(&dot(right_hand_side, right_hand_side));
            return Err(BaselineError::NotConverged {
                residual: relative.iter().copied().fold(0.0, f64::max).sqrt(),
                tolerance: options.tolerance,
                iterations: iteration,
            });
        }
        let image = system.times(&direction);
        // The direction of a converged column eventually becomes zero.
        let lengths = ratio(&slope, &dot(&direction, &image));
        add_scaled(&mut solution, &lengths, &direction);
        if iteration % REFRESH == REFRESH - 1 {
            let product = system.times(&solution);
            let fresh = right_hand_side
                .par_iter()
                .zip(product)
                .with_min_len(ROWS)
                .map(|(b, ax)| b - ax);
            residual = fresh.collect();
        } else {
            add_scaled(&mut residual, &-lengths, &image);
        }
        squares = dot(&residual, &residual);
        let next = preconditioner.apply(&residual);
        let next_slope = dot(&residual, &next);
        let beta = ratio(&next_slope, &slope);
        slope = next_slope;
        let rows = direction.par_iter_mut().zip(next).with_min_len(ROWS);
        rows.for_each(|(d, z)| *d = z + d.component_mul(&beta));
        iteration += 1;
    }
}

/// Dot products of the columns.
pub(super) fn dot(a: &[Vector], b: &[Vector]) -> Vector {
    sum_of_parts(a.len(), |i| a[i].component_mul(&b[i]))
}

pub(super) fn add_scaled(to: &mut [Vector], factors: &Vector, step: &[Vector]) {
    let rows = to.par_iter_mut().zip(step).with_min_len(ROWS);
    rows.for_each(|(x, d)| *x += d.component_mul(factors));
}

/// Column by column; 0 where `b` is.
fn ratio(a: &Vector, b: &Vector) -> Vector {
    a.zip_map(b, |a, b| if b == 0.0 { 0.0 } else { a / b })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::baseline::test_meshes::{ball, cube};

    /// That defines the factorisation.
    #[test]
    fn factorisation_agrees_with_the_matrix_where_that_has_entries() {
        let system = Dirichlet::new(cube(4)).unwrap();
        let factor = IncompleteCholesky::new(&system);
        let block = &factor.blocks[0];
        let row = |i: usize| -> Vec<(usize, f64)> {
            let entries =
                (block.begin[i]..block.begin[i + 1]).map(|at| (block.columns[at] as usize, block.entries[at]));
            entries.chain([(i, 1.0 / block.pivots[i])]).collect()
        };
        for i in 0..system.free.len() {
            for (j, k) in system.inner.row(i).filter(|&(j, _)| j < i) {
                let (a, b) = (row(i), row(j));
                let products = a
                    .iter()
                    .flat_map(|x| b.iter().filter(|y| y.0 == x.0).map(move |y| x.1 * y.1));
                assert!((products.sum::<f64>() + k).abs() < 1e-15);
            }
            let squares: f64 = row(i).iter().map(|x| x.1 * x.1).sum();
            assert!((squares - system.diagonal[i]).abs() < 1e-15);
        }
    }

    #[test]
    fn broken_factorisations_are_repaired_by_a_shift() {
        // The matrix [1 2; 2 1] is indefinite.
        let mut block = DiagonalBlock {
            begin: vec![0, 0, 1],
            columns: vec![0],
            entries: vec![],
            pivots: vec![],
        };
        assert!(!block.factor(&[2.0], &[1.0, 1.0], 1.0));
        assert!(block.factor(&[2.0], &[1.0, 1.0], 11.0));
        assert!(block.pivots.iter().all(|p| p.is_finite() && *p > 0.0));
    }

    #[test]
    fn preconditioner_saves_iterations() {
        let system = Dirichlet::new(ball(14)).unwrap();
        let data = vec![Vector::new(1.0, -2.0, 0.5); system.free.len()];
        let with = IncompleteCholesky::new(&system);
        let mut without = with.clone();
        for block in &mut without.blocks {
            block.entries.fill(0.0);
            block.pivots.fill(1.0);
        }
        let options = HarmonicOptions {
            tolerance: 1e-10,
            most_iterations: 1000,
            ..HarmonicOptions::default()
        };
        let (x, iterations) = solve(&system, &with, &data, &options).unwrap();
        let (_, plain) = solve(&system, &without, &data, &options).unwrap();
        assert!(2 * iterations < plain, "{iterations} against {plain}");
        let image = system.times(&x);
        for (found, wanted) in image.iter().zip(&data) {
            assert!((found - wanted).norm() < 1e-8);
        }
    }
}

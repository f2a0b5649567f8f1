use rayon::prelude::*;

use super::affine_functions;
use crate::Point;

/// Several right-hand sides, solutions or residuals side by side: a row-major matrix of `rows × columns` entries.
#[derive(Debug, Clone, PartialEq)]
pub struct Values {
    columns: usize,
    entries: Vec<f64>,
}

impl Values {
    /// All zero.
    pub fn zeros(rows: usize, columns: usize) -> Self {
        Self::new(columns, vec![0.0; rows * columns])
    }

    /// From the entries, row after row.
    ///
    /// # Panics
    ///
    /// When the number of entries is not a multiple of `columns`.
    pub fn new(columns: usize, entries: Vec<f64>) -> Self {
        assert!(columns > 0 && entries.len().is_multiple_of(columns), "rows are whole");
        Self { columns, entries }
    }

    /// Rows of three.
    pub fn from_triples(triples: &[[f64; 3]]) -> Self {
        Self::new(3, triples.as_flattened().to_vec())
    }

    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.entries.len() / self.columns
    }

    /// Number of columns.
    pub fn columns(&self) -> usize {
        self.columns
    }

    /// One row.
    pub fn row(&self, row: usize) -> &[f64] {
        &self.entries[row * self.columns..(row + 1) * self.columns]
    }

    /// One row, mutable.
    pub fn row_mut(&mut self, row: usize) -> &mut [f64] {
        &mut self.entries[row * self.columns..(row + 1) * self.columns]
    }

    /// All entries, row after row.
    pub fn as_slice(&self) -> &[f64] {
        &self.entries
    }

    /// All entries, mutable.
    pub(super) fn as_mut_slice(&mut self) -> &mut [f64] {
        &mut self.entries
    }

    /// `self − other`, of the same size.
    ///
    /// # Panics
    ///
    /// When the sizes differ.
    pub fn minus(&self, other: &Self) -> Self {
        assert_eq!((self.columns, self.entries.len()), (other.columns, other.entries.len()));
        let pairs = self.entries.par_iter().zip(&other.entries);
        Self::new(self.columns, pairs.with_min_len(1 << 14).map(|(a, b)| a - b).collect())
    }

    /// The chosen rows, in that order.
    pub(crate) fn gather(&self, rows: &[u32]) -> Self {
        let mut entries = Vec::with_capacity(rows.len() * self.columns);
        rows.iter()
            .for_each(|&r| entries.extend_from_slice(self.row(r as usize)));
        Self::new(self.columns, entries)
    }

    /// Adds `factors[c] · other` to column `c`.
    pub(super) fn add_scaled(&mut self, factors: &[f64], other: &Self) {
        debug_assert_eq!(self.entries.len(), other.entries.len());
        let chunk = self.columns * ROWS_PER_TASK;
        let parts = self.entries.par_chunks_mut(chunk).zip(other.entries.par_chunks(chunk));
        parts.for_each(|(mine, others)| {
            let rows = mine
                .chunks_exact_mut(factors.len())
                .zip(others.chunks_exact(factors.len()));
            for (mine, other) in rows {
                for ((value, other), factor) in mine.iter_mut().zip(other).zip(factors) {
                    *value += factor * other;
                }
            }
        });
    }

    /// Adds affine functions of a point for each row: `affine` has rows of coefficients for 1, x, y and z, or is empty.
    pub(crate) fn add_affine(&mut self, affine: &[f64], points: &[Point]) {
        let columns = self.columns;
        let rows = self.entries.par_chunks_mut(columns).zip(points);
        rows.with_min_len(ROWS_PER_TASK).for_each(|(row, p)| {
            for (coefficients, function) in affine.chunks_exact(columns).zip(affine_functions(p)) {
                let terms = row.iter_mut().zip(coefficients);
                terms.for_each(|(value, a)| *value += a * function);
            }
        });
    }

    /// For every column, `Σ_r weights[r] · self[r] · other[r]`; the same for any number of threads.
    pub(super) fn dot(&self, other: &Self, weights: &[f64]) -> Vec<f64> {
        let chunk = self.columns * ROWS_PER_TASK;
        let parts: Vec<Vec<f64>> = self
            .entries
            .par_chunks(chunk)
            .zip(other.entries.par_chunks(chunk))
            .zip(weights.par_chunks(ROWS_PER_TASK))
            .map(|((mine, others), weights)| {
                let mut sums = vec![0.0; self.columns];
                let rows = mine.chunks_exact(self.columns).zip(others.chunks_exact(self.columns));
                for ((mine, other), weight) in rows.zip(weights) {
                    for ((sum, a), b) in sums.iter_mut().zip(mine).zip(other) {
                        *sum += weight * a * b;
                    }
                }
                sums
            })
            .collect();
        parts.iter().fold(vec![0.0; self.columns], |mut total, part| {
            total.iter_mut().zip(part).for_each(|(t, p)| *t += p);
            total
        })
    }
}

/// Rows that make a task worth handing to another thread.
const ROWS_PER_TASK: usize = 1 << 12;

#[cfg(test)]
mod tests {
    use super::*;

    fn waves(rows: usize, columns: usize, phase: f64) -> Values {
        let entries = (0..rows * columns).map(|i| (i as f64 * 0.7 + phase).sin());
        Values::new(columns, entries.collect())
    }

    /// Over more rows than one task takes; the sums differ by their order, so by the rounding of as many terms.
    #[test]
    fn columns_are_summed_and_scaled_one_by_one() {
        let (rows, columns) = (2 * ROWS_PER_TASK + 37, 4);
        let (mut a, b) = (waves(rows, columns, 0.1), waves(rows, columns, 0.9));
        let weights: Vec<f64> = (0..rows).map(|r| 1.0 + (r as f64).cos()).collect();
        for (k, dot) in a.dot(&b, &weights).iter().enumerate() {
            let expected: f64 = (0..rows).map(|r| weights[r] * a.row(r)[k] * b.row(r)[k]).sum();
            assert!((dot - expected).abs() < 1e-16 * (rows * rows) as f64);
        }
        let before = a.clone();
        a.add_scaled(&[0.0, 1.0, -2.0, 0.5], &b);
        for r in 0..rows {
            for (k, factor) in [0.0, 1.0, -2.0, 0.5].into_iter().enumerate() {
                assert_eq!(a.row(r)[k], before.row(r)[k] + factor * b.row(r)[k]);
            }
        }
    }

    #[test]
    fn products_are_the_same_for_any_number_of_threads() {
        let (a, b) = (waves(5 * ROWS_PER_TASK, 3, 0.2), waves(5 * ROWS_PER_TASK, 3, 1.2));
        let weights = vec![0.3; a.rows()];
        let with = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| a.dot(&b, &weights))
        };
        assert_eq!(with(1), with(3));
    }

    #[test]
    fn rows_are_chosen_in_the_order_asked_for() {
        let values = Values::from_triples(&[[1.0, 2.0, 3.0], [4.0, 5.0, 6.0], [7.0, 8.0, 9.0]]);
        assert_eq!(
            values.gather(&[2, 0, 2]).as_slice(),
            [7.0, 8.0, 9.0, 1.0, 2.0, 3.0, 7.0, 8.0, 9.0]
        );
        assert_eq!((values.gather(&[]).rows(), values.gather(&[]).columns()), (0, 3));
    }

    #[test]
    #[should_panic(expected = "rows are whole")]
    fn rows_must_be_whole() {
        Values::new(3, vec![0.0; 7]);
    }
}

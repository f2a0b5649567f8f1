//! The matrix of the least-squares system (the paper's `A`, section 3.2).

use faer::Mat;
use rayon::prelude::*;

use super::{SolveError, affine_functions};
use crate::{Point, kernel};

/// `weight_r · ( Σ_s w_s G(P_r, Q_s) + affine(P_r) ) = weight_r · f'(P_r)` for every collocation point `P_r`.
#[derive(Debug, Clone, Copy)]
pub struct CollocationSystem<'a> {
    /// The points `P` on the boundary, one row each.
    pub collocation: &'a [Point],
    /// A weight per row. The square root of the surface area that a point stands for makes the squared residual an
    /// integral over the boundary.
    pub row_weights: &'a [f64],
    /// The points `Q` outside the solid, one column each.
    pub sources: &'a [Point],
    /// Whether the functions 1, x, y, z are columns too.
    pub affine: bool,
}

impl CollocationSystem<'_> {
    /// Number of columns.
    pub fn unknowns(&self) -> usize {
        self.sources.len() + if self.affine { 4 } else { 0 }
    }

    /// The weighted matrix with columns scaled to unit norm, and the scales: `A = scaled · diag(scales)`.
    ///
    /// Columns of distant sources are small; without scaling a truncation would drop them first, and the condition
    /// number would measure distances.
    pub(super) fn matrix(&self) -> Result<(Mat<f64>, Vec<f64>), SolveError> {
        let (rows, columns) = (self.collocation.len(), self.unknowns());
        let mut matrix = Mat::<f64>::zeros(rows, columns);
        let scales: Vec<f64> = matrix
            .par_col_iter_mut()
            .enumerate()
            .map(|(column, entries)| {
                let contiguous = entries
                    .try_as_col_major_mut()
                    .expect("columns of an owned matrix are contiguous");
                self.fill_column(column, contiguous.as_slice_mut())
            })
            .collect();
        match scales.iter().position(|s| !s.is_finite()) {
            Some(column) => Err(SolveError::NonFinite { column }),
            None => Ok((matrix, scales)),
        }
    }

    fn fill_column(&self, column: usize, entries: &mut [f64]) -> f64 {
        match self.sources.get(column) {
            Some(source) => {
                let filled = kernel::direct::fill_matrix(self.collocation, std::slice::from_ref(source), entries);
                debug_assert!(filled.is_ok(), "a column has one entry per row");
            }
            None => {
                let function = column - self.sources.len();
                for (entry, p) in entries.iter_mut().zip(self.collocation) {
                    *entry = affine_functions(p)[function];
                }
            }
        }
        let mut squares = 0.0;
        for (entry, weight) in entries.iter_mut().zip(self.row_weights) {
            *entry *= weight;
            squares += *entry * *entry;
        }
        let scale = squares.sqrt();
        if scale > 0.0 {
            entries.iter_mut().for_each(|entry| *entry /= scale);
        }
        scale
    }
}

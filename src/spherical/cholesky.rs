//! Sparse Cholesky factorisations of matrices that share one pattern.
//!
//! faer's factorisation, supernodal but for small ones, in an approximate minimum degree ordering (Amestoy, Davis & Duff,
//! *Algorithm 837: AMD*, ACM Trans. Math. Softw. 30, 2004).

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt::factor::LltRegularization;
use faer::sparse::linalg::SupernodalThreshold;
use faer::sparse::linalg::cholesky::{
    CholeskySymbolicParams, LltRef, SymbolicCholesky, SymmetricOrdering, factorize_symbolic_cholesky,
};
use faer::sparse::{SparseColMatRef, SymbolicSparseColMat};
use faer::{Conj, MatMut, Par, Side, Spec};

/// Parts that dense blocks are divided into: fixed, so that results do not depend on the number of threads.
const PARTS: usize = 4;

/// The ratio of operations to entries from which on the factorisation is supernodal, over faer's own limit. Patterns are kept here, so
/// that symbolic work counts less: factorisations of 1000 to 17 000 unknowns take 0.9 to 0.5 of the time that they take with 1.
const SUPERNODAL: f64 = 0.3;

/// A factorisation whose ordering and pattern are kept while the values change.
pub(crate) struct Cholesky {
    pattern: SymbolicSparseColMat<u32>,
    symbolic: SymbolicCholesky<u32>,
    factor: Vec<f64>,
    scratch: MemBuffer,
}

/// The factorisation does not fit into memory.
#[derive(Debug)]
pub(crate) struct OutOfMemory;

impl std::fmt::Debug for Cholesky {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let (unknowns, entries) = (self.unknowns(), self.factor.len());
        f.debug_struct("Cholesky")
            .field("unknowns", &unknowns)
            .field("entries", &entries)
            .finish_non_exhaustive()
    }
}

impl Cholesky {
    /// Prepares for matrices whose lower triangle has, in column `j`, entries in the sorted rows
    /// `rows[begin[j]..begin[j + 1]]`.
    pub(crate) fn new(begin: Vec<u32>, rows: Vec<u32>) -> Result<Self, OutOfMemory> {
        let count = begin.len() - 1;
        let pattern = SymbolicSparseColMat::new_checked(count, count, begin, None, rows);
        let params = CholeskySymbolicParams {
            supernodal_flop_ratio_threshold: SupernodalThreshold(SUPERNODAL),
            ..CholeskySymbolicParams::default()
        };
        let symbolic = factorize_symbolic_cholesky(pattern.as_ref(), Side::Lower, SymmetricOrdering::Amd, params)
            .map_err(|_| OutOfMemory)?;
        let mut factor = Vec::new();
        factor.try_reserve_exact(symbolic.len_val()).map_err(|_| OutOfMemory)?;
        factor.resize(symbolic.len_val(), 0.0);
        let to_factor = symbolic.factorize_numeric_llt_scratch::<f64>(parallelism(), Spec::default());
        let to_solve = symbolic.solve_in_place_scratch::<f64>(3, parallelism());
        let scratch = MemBuffer::try_new(to_factor.or(to_solve)).map_err(|_| OutOfMemory)?;
        Ok(Self {
            pattern,
            symbolic,
            factor,
            scratch,
        })
    }

    pub(crate) fn unknowns(&self) -> usize {
        self.pattern.nrows()
    }

    /// Factors the matrix with these entries in the order of the pattern. False when it is not positive definite.
    pub(crate) fn factor(&mut self, values: &[f64]) -> bool {
        // NaN would pass the check of the pivots.
        if values.iter().any(|value| !value.is_finite()) {
            return false;
        }
        let factored = self.symbolic.factorize_numeric_llt(
            &mut self.factor,
            SparseColMatRef::new(self.pattern.as_ref(), values),
            Side::Lower,
            LltRegularization::default(),
            parallelism(),
            MemStack::new(&mut self.scratch),
            Spec::default(),
        );
        factored.is_ok()
    }

    /// Solves in place for up to three right-hand sides, one after the other, with the last factorisation.
    pub(crate) fn solve(&mut self, columns: &mut [f64]) {
        let rows = self.unknowns();
        if rows == 0 {
            return;
        }
        let columns = MatMut::from_column_major_slice_mut(columns, rows, columns.len() / rows);
        let factor = LltRef::new(&self.symbolic, &self.factor);
        factor.solve_in_place_with_conj(Conj::No, columns, parallelism(), MemStack::new(&mut self.scratch));
    }

    /// As [`Self::solve`], for any number of right-hand sides and from several threads at once: allocates what it needs.
    pub(crate) fn solve_shared(&self, columns: &mut [f64]) {
        let rows = self.unknowns();
        if rows == 0 {
            return;
        }
        let count = columns.len() / rows;
        let columns = MatMut::from_column_major_slice_mut(columns, rows, count);
        let factor = LltRef::new(&self.symbolic, &self.factor);
        let mut scratch = MemBuffer::new(self.symbolic.solve_in_place_scratch::<f64>(count, Par::Seq));
        factor.solve_in_place_with_conj(Conj::No, columns, Par::Seq, MemStack::new(&mut scratch));
    }
}

fn parallelism() -> Par {
    Par::rayon(PARTS)
}

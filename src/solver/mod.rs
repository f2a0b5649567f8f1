//! Least-squares systems for the coefficients: points come in as slices, coefficients go out.
//!
//! The unknowns are one coefficient per source and coordinate, and by default the twelve coefficients of an affine map.
//! The affine functions are harmonic, so the map stays so; with them the identity and every affine map are reproduced
//! exactly, which point sources at a finite distance cannot do.

mod assemble;
mod dense;
mod krylov;
mod modes;
mod patches;
mod schwarz;
mod values;
mod variable_projection;

pub use assemble::CollocationSystem;
pub use dense::{Decomposition, DenseFactor, DenseOptions};
pub use modes::BasisModes;
pub use schwarz::{Level, SchwarzFactor, SchwarzOptions, SchwarzStop, Solution};
pub use values::Values;
pub use variable_projection::{GaussNewton, Projection, SeparableSystem};

use crate::Point;

/// The unknowns of the fit.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Coefficients {
    /// One row per source: the coefficients `w` of equation (1) for the three coordinates.
    pub sources: Vec<[f64; 3]>,
    /// Rows for the functions 1, x, y, z; zero when the basis has no affine part.
    pub affine: [[f64; 3]; 4],
}

impl Coefficients {
    /// The coefficients in three columns of a solution, from `first` on. The solution has one row per source, then the
    /// rows of the affine functions if the basis has them.
    pub fn of_columns(solution: &Values, first: usize, sources: usize) -> Self {
        let row = |r: usize| std::array::from_fn(|k| solution.row(r)[first + k]);
        let mut affine = [[0.0; 3]; 4];
        for (function, r) in affine.iter_mut().zip(sources..solution.rows()) {
            *function = row(r);
        }
        Self {
            sources: (0..sources).map(row).collect(),
            affine,
        }
    }
}

/// The values of the affine basis functions 1, x, y and z.
fn affine_functions(p: &Point) -> [f64; 4] {
    [1.0, p.x, p.y, p.z]
}

/// Why a system has no usable solution.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SolveError {
    /// Fewer equations than unknowns.
    #[error(
        "{collocation} collocation points cannot determine {unknowns} unknowns ({sources} sources); raise the number of \
         collocation points (c-ratio) or lower the number of sources (s-ratio)"
    )]
    Underdetermined {
        /// Rows.
        collocation: usize,
        /// Columns.
        unknowns: usize,
        /// Columns that belong to sources.
        sources: usize,
    },
    /// A source coincides with a collocation point, or a coordinate is not finite.
    #[error(
        "the matrix has a non-finite entry in column {column}: a source coincides with a collocation point (raise the \
         source offset), or a coordinate is not finite"
    )]
    NonFinite {
        /// The first such column.
        column: usize,
    },
    /// The number of boundary values is not that of the rows.
    #[error("{data} boundary values were given for {collocation} collocation points")]
    DataLength {
        /// Values given.
        data: usize,
        /// Rows.
        collocation: usize,
    },
    /// The singular value iteration failed.
    #[error("the singular value decomposition did not converge; use the QR method instead")]
    NoConvergence,
    /// A coarse level has a collocation point that the next finer level lacks.
    #[error("collocation point {row} is in a coarse level, but not in the next finer one")]
    RowsNotNested {
        /// The first such point.
        row: u32,
    },
    /// The progress callback asked to stop.
    #[error("cancelled by the progress callback")]
    Cancelled,
    /// A sum over the sources could not be formed.
    #[error(transparent)]
    Sum(#[from] crate::kernel::KernelError),
    /// No singular value or pivot was kept.
    #[error("no singular value or pivot exceeds the truncation {truncation:e}; the boundary points may all coincide")]
    RankZero {
        /// The relative truncation.
        truncation: f64,
    },
}

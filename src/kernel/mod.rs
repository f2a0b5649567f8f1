//! The Laplace kernel in three dimensions, and sums of it over many sources.
//!
//! [`direct`] forms them term by term, [`fmm`] to a given accuracy in time linear in the number of points, and
//! [`Sums`] by whichever of the two is cheaper.
//! Imports only the vector instructions from this crate: points and weights arrive as slices.

pub mod direct;
pub mod fmm;
mod laplace;
mod sums;

pub use laplace::{laplace_gradient, laplace_potential};
pub use sums::Sums;

/// Why a kernel sum or matrix could not be formed.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum KernelError {
    /// Two arrays that describe the same thing differ in length.
    #[error("{found} {what} were given where {expected} are needed")]
    LengthMismatch {
        /// What is counted.
        what: &'static str,
        /// How many are needed.
        expected: usize,
        /// How many there are.
        found: usize,
    },
    /// More points than the indices of a tree can count.
    #[error(
        "{found} {what} are more than the {} that a tree can hold; sum over parts of them",
        u32::MAX - 1
    )]
    TooMany {
        /// What is counted.
        what: &'static str,
        /// How many there are.
        found: usize,
    },
}

fn require_length(what: &'static str, found: usize, expected: usize) -> Result<(), KernelError> {
    if found == expected {
        Ok(())
    } else {
        Err(KernelError::LengthMismatch { what, expected, found })
    }
}

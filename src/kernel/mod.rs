//! The Laplace kernel in space, and sums of it over many sources.
//!
//! Imports nothing else of this crate: points and weights arrive as slices.

pub mod direct;
mod laplace;
pub mod sums;

pub use laplace::{laplace_gradient, laplace_potential};

/// Why a kernel sum or matrix could not be formed.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum KernelError {
    /// Two arrays that describe the same thing differ in length.
    #[error("{found} {what} were given where {expected} are needed")]
    LengthMismatch {
        /// What is counted.
        what: &'static str,
        /// How many the other arrays call for.
        expected: usize,
        /// How many there are.
        found: usize,
    },
}

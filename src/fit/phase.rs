use std::ops::ControlFlow;

use super::FitError;

/// The steps of a fit, for showing progress.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Phase {
    /// Checking the domain.
    Checking,
    /// Placing sources and collocation points.
    Sampling,
    /// Decomposing a dense matrix of this many rows and columns.
    Decomposing {
        /// Collocation points.
        rows: usize,
        /// Unknowns.
        columns: usize,
    },
    /// Factoring the patches of a level.
    Factoring {
        /// Patches factored.
        done: usize,
        /// Patches of the level.
        of: usize,
    },
    /// Applying a dense decomposition.
    Solving,
    /// Iterating.
    Iterating {
        /// Iterations made.
        iteration: usize,
        /// Root mean square residual, as a fraction of the target's diagonal.
        residual: f64,
    },
    /// Measuring the boundary error.
    Measuring,
    /// Moving free sources.
    MovingSources {
        /// The round, from 1.
        round: usize,
        /// Root mean square residual so far, as a fraction of the target's diagonal.
        residual: f64,
    },
    /// Adding sources where the error is too large.
    Refining {
        /// The round, from 1.
        round: usize,
        /// The boundary error so far (99 % of the area).
        error: f64,
        /// Sources so far.
        sources: usize,
    },
}

/// A progress callback.
pub(super) struct Progress<'a>(pub &'a dyn Fn(Phase) -> ControlFlow<()>);

impl Progress<'_> {
    /// Reports a phase of the fit itself.
    pub fn enter(&self, phase: Phase) -> Result<(), FitError> {
        match self.report(phase) {
            ControlFlow::Continue(()) => Ok(()),
            ControlFlow::Break(()) => Err(FitError::Cancelled),
        }
    }

    /// Reports a phase on behalf of the solver, which returns its own error when cancelled.
    pub fn report(&self, phase: Phase) -> ControlFlow<()> {
        (self.0)(phase)
    }
}

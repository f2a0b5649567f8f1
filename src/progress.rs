//! How long work tells how far it is, and how it is ended early.
//!
//! Whoever takes a progress callback takes one that returns nothing or a [`ControlFlow`]: [`ControlFlow::Break`] ends the
//! work with the error `Cancelled` of its stage. Callbacks run on the calling thread, at least once in every iteration of
//! a solver.

use std::cell::Cell;
use std::ops::ControlFlow;

/// What a progress callback returns: nothing, or whether to go on.
///
/// ```
/// use std::ops::ControlFlow;
/// use solidmap::boundary_map::BoundaryMap;
/// use solidmap::fit::{FitError, FitOptions, Phase, fit};
/// use solidmap::mesh::shapes;
///
/// let domain = shapes::sphere(1.0, 2);
/// let boundary = BoundaryMap::new(domain.clone(), domain.vertices().to_vec())?;
/// let until_iterating = |phase| match phase {
///     Phase::Iterating { .. } => ControlFlow::Break(()),
///     _ => ControlFlow::Continue(()),
/// };
/// let ended = fit(&boundary, &FitOptions::default(), &until_iterating);
/// assert!(matches!(ended, Err(FitError::Cancelled)));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub trait Answer {
    /// Whether to go on.
    fn flow(self) -> ControlFlow<()>;
}

impl Answer for () {
    fn flow(self) -> ControlFlow<()> {
        ControlFlow::Continue(())
    }
}

impl Answer for ControlFlow<()> {
    fn flow(self) -> ControlFlow<()> {
        self
    }
}

/// Asks a callback again and again, for loops whose answer is not an error at once.
pub(crate) struct Watch<'a, T: Copy> {
    progress: &'a dyn Fn(T) -> ControlFlow<()>,
    latest: Cell<T>,
    ended: Cell<bool>,
}

impl<'a, T: Copy> Watch<'a, T> {
    pub fn new(start: T, progress: &'a dyn Fn(T) -> ControlFlow<()>) -> Self {
        Self {
            progress,
            latest: Cell::new(start),
            ended: Cell::new(false),
        }
    }

    /// Tells how far it is.
    pub fn tell(&self, what: T) {
        self.latest.set(what);
        self.goes_on();
    }

    /// Tells the latest again; whether to go on. Once it is not, the callback is not asked any more.
    pub fn goes_on(&self) -> bool {
        if !self.ended.get() {
            self.ended.set((self.progress)(self.latest.get()).is_break());
        }
        !self.ended.get()
    }
}

//! How long work tells how far it is, and how it is ended early.
//!
//! Whoever takes a progress callback takes one that returns nothing or a [`ControlFlow`]: [`ControlFlow::Break`] ends the
//! work with the error `Cancelled` of its stage. Callbacks run on the calling thread, at least once in every iteration of
//! a solver.

use std::cell::Cell;
use std::ops::ControlFlow;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::time::Duration;

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

/// How often a callback is asked at least while work runs on other threads.
const PATIENCE: Duration = Duration::from_millis(100);

/// Does work on rayon's threads, while the calling thread hands on what it tells and asks whether it is to go on. `None`
/// when it was not; from then on the callback is not asked any more.
pub(crate) fn attended<T: Copy + Send, R: Send>(
    progress: &dyn Fn(T) -> ControlFlow<()>,
    work: impl FnOnce(&Reporter<T>) -> R + Send,
) -> Option<R> {
    let ended = AtomicBool::new(false);
    let (sender, told) = channel();
    let mut result = None;
    rayon::in_place_scope(|scope| {
        let reporter = Reporter { sender, ended: &ended };
        let result = &mut result;
        scope.spawn(move |_| *result = Some(work(&reporter)));
        let mut latest = None;
        loop {
            match told.recv_timeout(PATIENCE) {
                Ok(what) => latest = Some(what),
                Err(RecvTimeoutError::Disconnected) => break,
                // The work may wait for this very thread, where that is one of rayon's.
                Err(RecvTimeoutError::Timeout) => drop(rayon::yield_now()),
            }
            if let Some(what) = latest
                && !ended.load(Ordering::Relaxed)
                && progress(what).is_break()
            {
                ended.store(true, Ordering::Relaxed);
            }
        }
    });
    result.filter(|_| !ended.into_inner())
}

/// Of work that is attended.
pub(crate) struct Reporter<'a, T> {
    sender: Sender<T>,
    ended: &'a AtomicBool,
}

impl<T> Reporter<'_, T> {
    /// Tells how far it is.
    pub fn tell(&self, what: T) -> ControlFlow<()> {
        // Somebody listens until this is dropped.
        let _ = self.sender.send(what);
        if self.goes_on() {
            ControlFlow::Continue(())
        } else {
            ControlFlow::Break(())
        }
    }

    /// Whether the work is wanted still.
    pub fn goes_on(&self) -> bool {
        !self.ended.load(Ordering::Relaxed)
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

    /// Whether the callback has asked for an end; does not ask it.
    pub fn has_ended(&self) -> bool {
        self.ended.get()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn attended_work_tells_the_calling_thread_and_ends_when_that_says_so() {
        let caller = std::thread::current().id();
        let heard = Cell::new(0);
        let all = attended(
            &|k: usize| {
                assert_eq!(std::thread::current().id(), caller);
                heard.set(heard.get().max(k));
                ControlFlow::Continue(())
            },
            |reporter| {
                (0..=20)
                    .map(|k| reporter.tell(k))
                    .filter(|told| told.is_continue())
                    .count()
            },
        );
        assert_eq!((all, heard.get()), (Some(21), 20));
        // Silent work is asked for all the same, and nobody is asked after an end.
        let asked = Cell::new(0);
        let end = attended(
            &|()| {
                asked.set(asked.get() + 1);
                if asked.get() < 3 {
                    ControlFlow::Continue(())
                } else {
                    ControlFlow::Break(())
                }
            },
            |reporter| {
                let _ = reporter.tell(());
                while reporter.goes_on() {
                    std::thread::yield_now();
                }
                let _ = reporter.tell(());
            },
        );
        assert_eq!((end, asked.get()), (None, 3));
    }

    #[test]
    fn an_end_at_the_last_word_counts() {
        assert_eq!(
            attended(&|()| ControlFlow::Break(()), |reporter| reporter.tell(()).is_break()),
            None
        );
        assert_eq!(attended(&|()| ControlFlow::Break(()), |_| 7), Some(7));
    }

    #[test]
    fn attended_work_runs_in_a_pool_of_one_thread() {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        let done = pool.install(|| {
            attended(&|()| ControlFlow::Continue(()), |reporter| {
                reporter.tell(()).is_continue()
            })
        });
        assert_eq!(done, Some(true));
    }
}

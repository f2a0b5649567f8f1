//! Progress callbacks of long work, and cancellation through them.
//!
//! A progress callback returns nothing, or a [`ControlFlow`]: [`ControlFlow::Break`] cancels the work, which then returns the
//! error `Cancelled` of its stage. Callbacks run on the calling thread, at least once in every iteration of a solver.

use std::cell::Cell;
use std::ops::ControlFlow;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::time::Duration;

/// What a progress callback returns: nothing, or whether to continue.
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
pub trait ProgressResponse {
    /// Whether to continue.
    fn control_flow(self) -> ControlFlow<()>;
}

impl ProgressResponse for () {
    fn control_flow(self) -> ControlFlow<()> {
        ControlFlow::Continue(())
    }
}

impl ProgressResponse for ControlFlow<()> {
    fn control_flow(self) -> ControlFlow<()> {
        self
    }
}

/// Longest time between two calls of the callback while work runs on other threads.
const POLL_INTERVAL: Duration = Duration::from_millis(100);

/// Runs work on rayon's threads, while the calling thread passes its reports to the callback, and repeats the latest
/// when no new one arrives for a while. `None` when the callback cancelled the work; it is not called again after that.
pub(crate) fn run_cancellable<T: Copy + Send, R: Send>(
    progress: &dyn Fn(T) -> ControlFlow<()>,
    work: impl FnOnce(&ProgressSender<T>) -> R + Send,
) -> Option<R> {
    let cancelled = AtomicBool::new(false);
    let (sender, reports) = channel();
    let mut result = None;
    rayon::in_place_scope(|scope| {
        let sender = ProgressSender {
            sender,
            cancelled: &cancelled,
        };
        let result = &mut result;
        scope.spawn(move |_| *result = Some(work(&sender)));
        let mut latest = None;
        loop {
            match reports.recv_timeout(POLL_INTERVAL) {
                Ok(report) => latest = Some(report),
                Err(RecvTimeoutError::Disconnected) => break,
                // The work may wait for this very thread, where that is one of rayon's.
                Err(RecvTimeoutError::Timeout) => drop(rayon::yield_now()),
            }
            if let Some(report) = latest
                && !cancelled.load(Ordering::Relaxed)
                && progress(report).is_break()
            {
                cancelled.store(true, Ordering::Relaxed);
            }
        }
    });
    result.filter(|_| !cancelled.into_inner())
}

/// The worker's end of [`run_cancellable`].
pub(crate) struct ProgressSender<'a, T> {
    sender: Sender<T>,
    cancelled: &'a AtomicBool,
}

impl<T> ProgressSender<'_, T> {
    /// Reports progress; whether to continue.
    pub fn send(&self, report: T) -> ControlFlow<()> {
        // The receiver outlives the sender.
        let _ = self.sender.send(report);
        if self.should_continue() {
            ControlFlow::Continue(())
        } else {
            ControlFlow::Break(())
        }
    }

    /// Whether the work has not been cancelled.
    pub fn should_continue(&self) -> bool {
        !self.cancelled.load(Ordering::Relaxed)
    }
}

/// A callback that can be polled again and again, for loops that leave early and return an error only later.
pub(crate) struct ProgressMonitor<'a, T: Copy> {
    progress: &'a dyn Fn(T) -> ControlFlow<()>,
    latest: Cell<T>,
    cancelled: Cell<bool>,
}

impl<'a, T: Copy> ProgressMonitor<'a, T> {
    pub fn new(start: T, progress: &'a dyn Fn(T) -> ControlFlow<()>) -> Self {
        Self {
            progress,
            latest: Cell::new(start),
            cancelled: Cell::new(false),
        }
    }

    /// Reports progress.
    pub fn report(&self, report: T) {
        self.latest.set(report);
        self.should_continue();
    }

    /// Calls the callback with the latest report, unless it has cancelled the work; whether to continue.
    pub fn should_continue(&self) -> bool {
        if !self.cancelled.get() {
            self.cancelled.set((self.progress)(self.latest.get()).is_break());
        }
        !self.cancelled.get()
    }

    /// Whether the callback has cancelled the work; does not call it.
    pub fn is_cancelled(&self) -> bool {
        self.cancelled.get()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reports_arrive_on_the_calling_thread_which_can_cancel() {
        let caller = std::thread::current().id();
        let last = Cell::new(0);
        let all = run_cancellable(
            &|k: usize| {
                assert_eq!(std::thread::current().id(), caller);
                last.set(last.get().max(k));
                ControlFlow::Continue(())
            },
            |sender| {
                (0..=20)
                    .map(|k| sender.send(k))
                    .filter(ControlFlow::is_continue)
                    .count()
            },
        );
        assert_eq!((all, last.get()), (Some(21), 20));
        // The callback is called without new reports too, and not after it has cancelled.
        let calls = Cell::new(0);
        let end = run_cancellable(
            &|()| {
                calls.set(calls.get() + 1);
                if calls.get() < 3 {
                    ControlFlow::Continue(())
                } else {
                    ControlFlow::Break(())
                }
            },
            |sender| {
                let _ = sender.send(());
                while sender.should_continue() {
                    std::thread::yield_now();
                }
                let _ = sender.send(());
            },
        );
        assert_eq!((end, calls.get()), (None, 3));
    }

    #[test]
    fn cancelling_at_the_last_report_counts() {
        assert_eq!(
            run_cancellable(&|()| ControlFlow::Break(()), |sender| sender.send(()).is_break()),
            None
        );
        assert_eq!(run_cancellable(&|()| ControlFlow::Break(()), |_| 7), Some(7));
    }

    #[test]
    fn cancellable_work_runs_in_a_pool_of_one_thread() {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        let done =
            pool.install(|| run_cancellable(&|()| ControlFlow::Continue(()), |sender| sender.send(()).is_continue()));
        assert_eq!(done, Some(true));
    }
}

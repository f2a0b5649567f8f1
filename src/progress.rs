//! Progress callbacks of long work, and cancellation through them.
//!
//! A progress callback returns nothing, a [`ControlFlow`] or a [`ProgressControl`]. [`ControlFlow::Break`] cancels the
//! work, which then returns the error `Cancelled` of its stage; [`ProgressControl::Conclude`] asks for the best result
//! so far. Callbacks run on the calling thread: at least once in every iteration of a solver, or ten times in a second
//! while it waits for others.

use std::cell::Cell;
use std::ops::ControlFlow;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::time::Duration;

/// What a progress callback returns: nothing, or whether to continue.
///
/// ```
/// use std::ops::ControlFlow;
/// use solidmap::Point;
/// use solidmap::boundary_map::BoundaryMap;
/// use solidmap::fit::{FitError, FitOptions, Phase, fit};
/// use solidmap::mesh::shapes;
///
/// let domain = shapes::sphere(1.0, 2);
/// let flattened = |p: &Point| Point::new(p.x + p.x.abs(), p.y, p.z);
/// let boundary = BoundaryMap::new(domain.clone(), domain.vertices().iter().map(flattened).collect())?;
/// let until_iterating = |phase| match phase {
///     Phase::Iterating { .. } => ControlFlow::Break(()),
///     _ => ControlFlow::Continue(()),
/// };
/// let ended = fit(&boundary, &FitOptions::default(), &until_iterating);
/// assert!(matches!(ended, Err(FitError::Cancelled)));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub trait ProgressResponse: Sized {
    /// How to go on.
    fn control(self) -> ProgressControl;

    /// Whether to continue, for work that has no result before its end: it is not concluded.
    fn control_flow(self) -> ControlFlow<()> {
        match self.control() {
            ProgressControl::Continue | ProgressControl::Conclude => ControlFlow::Continue(()),
            ProgressControl::Cancel => ControlFlow::Break(()),
        }
    }
}

/// How work goes on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ProgressControl {
    /// As before.
    Continue,
    /// With the best valid result so far, without further improvement. Work that has none yet goes on until it has one.
    /// Heeded by [`fit`](crate::fit::fit), [`map_to_sphere`](crate::spherical::map_to_sphere),
    /// [`map_pair`](crate::boundary_map::pair::map_pair) and [`improve_boundary`](crate::improve::improve_boundary), whose reports then say so; all else continues.
    Conclude,
    /// Not at all: the stage returns its error `Cancelled`.
    Cancel,
}

impl ProgressResponse for () {
    fn control(self) -> ProgressControl {
        ProgressControl::Continue
    }
}

impl ProgressResponse for ControlFlow<()> {
    fn control(self) -> ProgressControl {
        match self {
            ControlFlow::Continue(()) => ProgressControl::Continue,
            ControlFlow::Break(()) => ProgressControl::Cancel,
        }
    }
}

impl ProgressResponse for ProgressControl {
    fn control(self) -> ProgressControl {
        self
    }
}

/// Longest time between two calls of the callback while work runs on other threads.
const POLL_INTERVAL: Duration = Duration::from_millis(100);

/// Runs work on rayon's threads, while the calling thread passes its reports to the callback, and repeats the latest
/// when no new one arrives for a while. `None` when the callback cancelled the work; it is not called again after that.
pub(crate) fn run_cancellable<T: Copy + Send, R: Send>(
    progress: &dyn Fn(T) -> ProgressControl,
    work: impl FnOnce(&ProgressSender<T>) -> R + Send,
) -> Option<R> {
    let cancelled = AtomicBool::new(false);
    let concluded = AtomicBool::new(false);
    let (sender, reports) = channel();
    let mut result = None;
    rayon::in_place_scope(|scope| {
        let sender = ProgressSender {
            sender,
            cancelled: &cancelled,
            concluded: &concluded,
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
            {
                match progress(report) {
                    ProgressControl::Continue => {}
                    ProgressControl::Conclude => concluded.store(true, Ordering::Relaxed),
                    ProgressControl::Cancel => cancelled.store(true, Ordering::Relaxed),
                }
            }
        }
    });
    result.filter(|_| !cancelled.into_inner())
}

/// How [`run_abandonable`] starts work on another thread.
pub(crate) type Spawn = fn(Box<dyn FnOnce() + Send>);

/// On a thread of rayon's, for work that is parallel itself.
pub(crate) const ON_RAYON: Spawn = |work| rayon::spawn(work);

/// Why [`run_abandonable`] has no result.
#[derive(Debug, PartialEq, Eq)]
pub(crate) enum Unfinished {
    /// The callback cancelled the work.
    Cancelled,
    /// There was no thread for it.
    NotStarted,
}

/// Runs work that cannot be interrupted, while the calling thread calls the callback. When that cancels, this returns at
/// once: the work goes on to its end in the background, and its result is dropped.
pub(crate) fn run_abandonable<R: Send + 'static>(
    spawn: Spawn,
    progress: &dyn Fn() -> ControlFlow<()>,
    work: impl FnOnce() -> R + Send + 'static,
) -> Result<R, Unfinished> {
    let (sender, result) = channel();
    // A panic on a thread of rayon's would end the process.
    let work = AssertUnwindSafe(work);
    spawn(Box::new(move || drop(sender.send(catch_unwind(work)))));
    loop {
        match result.recv_timeout(POLL_INTERVAL) {
            Ok(Ok(result)) => return Ok(result),
            Ok(Err(panic)) => resume_unwind(panic),
            Err(RecvTimeoutError::Disconnected) => return Err(Unfinished::NotStarted),
            Err(RecvTimeoutError::Timeout) => drop(rayon::yield_now()),
        }
        if progress().is_break() {
            return Err(Unfinished::Cancelled);
        }
    }
}

/// The worker's end of [`run_cancellable`].
pub(crate) struct ProgressSender<'a, T> {
    sender: Sender<T>,
    cancelled: &'a AtomicBool,
    concluded: &'a AtomicBool,
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

    /// Whether the best result so far is asked for.
    pub fn should_conclude(&self) -> bool {
        self.concluded.load(Ordering::Relaxed)
    }

    /// Whether to improve a result that could be returned as it is.
    pub fn should_improve(&self) -> bool {
        self.should_continue() && !self.should_conclude()
    }

    /// How to go on, for work that this one consists of.
    pub fn control(&self) -> ProgressControl {
        match (self.should_continue(), self.should_conclude()) {
            (false, _) => ProgressControl::Cancel,
            (true, true) => ProgressControl::Conclude,
            (true, false) => ProgressControl::Continue,
        }
    }
}

/// A callback that can be polled again and again, for loops that leave early and return an error only later.
pub(crate) struct ProgressMonitor<'a, T: Copy> {
    progress: &'a dyn Fn(T) -> ProgressControl,
    latest: Cell<T>,
    cancelled: Cell<bool>,
    concluded: Cell<bool>,
}

impl<'a, T: Copy> ProgressMonitor<'a, T> {
    pub fn new(start: T, progress: &'a dyn Fn(T) -> ProgressControl) -> Self {
        Self {
            progress,
            latest: Cell::new(start),
            cancelled: Cell::new(false),
            concluded: Cell::new(false),
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
            match (self.progress)(self.latest.get()) {
                ProgressControl::Continue => {}
                ProgressControl::Conclude => self.concluded.set(true),
                ProgressControl::Cancel => self.cancelled.set(true),
            }
        }
        !self.cancelled.get()
    }

    /// As [`Self::should_continue`]; whether to improve a result that could be returned as it is.
    pub fn should_improve(&self) -> bool {
        self.should_continue() && !self.concluded.get()
    }

    /// Whether the callback has asked for the best result so far; does not call it.
    pub fn is_concluded(&self) -> bool {
        self.concluded.get()
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
                ProgressControl::Continue
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
                    ProgressControl::Continue
                } else {
                    ProgressControl::Cancel
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
            run_cancellable(&|()| ProgressControl::Cancel, |sender| sender.send(()).is_break()),
            None
        );
        assert_eq!(run_cancellable(&|()| ProgressControl::Cancel, |_| 7), Some(7));
    }

    #[test]
    fn cancellable_work_runs_in_a_pool_of_one_thread() {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        let done =
            pool.install(|| run_cancellable(&|()| ProgressControl::Continue, |sender| sender.send(()).is_continue()));
        assert_eq!(done, Some(true));
    }

    #[test]
    fn work_that_cannot_be_interrupted_is_left_behind() {
        let (end, ended) = channel::<()>();
        let left = run_abandonable(
            ON_RAYON,
            &|| ControlFlow::Break(()),
            // Ends only after it was left.
            move || ended.recv().is_err(),
        );
        assert_eq!(left, Err(Unfinished::Cancelled));
        drop(end);
        let calls = Cell::new(0);
        let poll = || {
            calls.set(calls.get() + 1);
            ControlFlow::Continue(())
        };
        let slow = || std::thread::sleep(3 * POLL_INTERVAL);
        assert_eq!(run_abandonable(ON_RAYON, &poll, slow), Ok(()));
        assert!(calls.get() > 0);
        assert_eq!(run_abandonable(drop, &poll, slow), Err(Unfinished::NotStarted));
        let panicked = catch_unwind(|| run_abandonable(ON_RAYON, &|| ControlFlow::Continue(()), || panic!("seen")));
        assert_eq!(panicked.unwrap_err().downcast_ref(), Some(&"seen"));
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        let inside = pool.install(|| run_abandonable(ON_RAYON, &|| ControlFlow::Continue(()), || 7));
        assert_eq!(inside, Ok(7));
    }

    #[test]
    fn work_that_is_to_conclude_is_not_cancelled() {
        let done = run_cancellable(&|()| ProgressControl::Conclude, |sender| {
            let _ = sender.send(());
            while sender.should_improve() {
                std::thread::yield_now();
            }
            (sender.should_continue(), sender.control())
        });
        assert_eq!(done, Some((true, ProgressControl::Conclude)));
        let monitor = ProgressMonitor::new((), &|()| ProgressControl::Conclude);
        assert!(!monitor.is_concluded() && !monitor.should_improve() && monitor.is_concluded());
        assert!(monitor.should_continue() && !monitor.is_cancelled());
    }
}

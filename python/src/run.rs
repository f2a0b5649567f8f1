//! Runs work without Python's lock, so that Ctrl-C ends it and progress is shown.
//!
//! The work is done on a thread of its own, which never needs the lock. The calling thread looks for signals, and calls the
//! progress callback with the latest step. When either ends the work, the caller is free after [`GRACE`] at the latest:
//! what cannot be interrupted goes on to its end in the background, and its result is dropped.

use std::any::Any;
use std::ops::ControlFlow;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::atomic::{AtomicBool, AtomicU32, AtomicUsize, Ordering};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::sync::{Arc, Mutex, Once, PoisonError};
use std::time::{Duration, Instant};

use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use solidmap::progress::ProgressControl;

use crate::error::{ErrorKind, Failure};

/// How often signals are looked for.
const POLL_INTERVAL: Duration = Duration::from_millis(25);
/// How often the progress callback is called.
const PROGRESS_INTERVAL: Duration = Duration::from_millis(100);
/// How long cancelled work may take to end before it is left alone.
const GRACE: Duration = Duration::from_millis(80);
/// Stack of the thread that works, as large as a main thread's.
const STACK: usize = 8 << 20;

/// The step that work is at.
#[derive(Clone)]
pub struct Step {
    pub name: String,
    /// The share that is done, where it is known.
    pub fraction: Option<f64>,
    pub detail: String,
}

/// What work reports to, and asks whether it goes on.
#[derive(Clone)]
pub struct Watch(Arc<WatchState>);

struct WatchState {
    is_cancelled: AtomicBool,
    is_shown: bool,
    latest: Mutex<Option<Step>>,
    deadline: Option<Instant>,
}

/// What a callback that cannot answer unwinds with.
struct Unwound;

impl Watch {
    /// Reports a step; whether the work goes on.
    pub fn tell(&self, step: impl FnOnce() -> Step) -> ControlFlow<()> {
        if self.0.is_shown {
            *self.0.latest.lock().unwrap_or_else(PoisonError::into_inner) = Some(step());
        }
        match self.is_cancelled() {
            true => ControlFlow::Break(()),
            false => ControlFlow::Continue(()),
        }
    }

    /// As [`Self::tell`], for work that ends with its best result so far at the time limit.
    pub fn tell_until_deadline(&self, step: impl FnOnce() -> Step) -> ProgressControl {
        match self.tell(step) {
            ControlFlow::Break(()) => ProgressControl::Cancel,
            ControlFlow::Continue(()) if self.0.deadline.is_some_and(|end| Instant::now() >= end) => {
                ProgressControl::Conclude
            }
            ControlFlow::Continue(()) => ProgressControl::Continue,
        }
    }

    /// As [`Self::tell`], for callbacks of the library that return nothing: cancelled work is unwound, which drops all
    /// that it has made.
    pub fn tell_or_unwind(&self, step: impl FnOnce() -> Step) {
        if self.tell(step).is_break() {
            resume_unwind(Box::new(Unwound));
        }
    }

    pub fn is_cancelled(&self) -> bool {
        self.0.is_cancelled.load(Ordering::Relaxed)
    }
}

/// A step by its name.
pub fn step(name: &str) -> Step {
    of(name, None, String::new())
}

/// A step of which a part is done.
pub fn part(name: &str, done: usize, of_all: usize) -> Step {
    let fraction = (of_all > 0).then(|| done as f64 / of_all as f64);
    of(name, fraction, format!("{done} of {of_all}"))
}

pub fn of(name: &str, fraction: Option<f64>, detail: String) -> Step {
    Step {
        name: name.into(),
        fraction,
        detail,
    }
}

/// Runs work, and returns its result or raises its error. `progress` is called with the name of the step, the share that
/// is done or `None`, and details; when it returns `False`, or raises, the work is cancelled.
pub fn run<T: Send + 'static>(
    py: Python<'_>,
    progress: Option<&Bound<'_, PyAny>>,
    time_limit: Option<f64>,
    work: impl FnOnce(&Watch) -> Result<T, Failure> + Send + 'static,
) -> PyResult<T> {
    require_threads()?;
    let deadline = time_limit.map(deadline_after).transpose()?;
    if progress.is_some_and(|progress| !progress.is_callable()) {
        return Err(PyTypeError::new_err("progress is neither True, False nor a callable"));
    }
    let watch = Watch(Arc::new(WatchState {
        is_cancelled: AtomicBool::new(false),
        is_shown: progress.is_some(),
        latest: Mutex::new(None),
        deadline,
    }));
    let own = watch.clone();
    let (sender, receiver) = channel();
    let receiver = Mutex::new(receiver);
    let wait = |time| {
        receiver
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .recv_timeout(time)
    };
    let worker = std::thread::Builder::new().name("solidmap".into()).stack_size(STACK);
    let body = move || {
        // Nobody receives the result of work that was left alone.
        let _ = sender.send(guarded(|| work(&own)));
    };
    worker.spawn(body).map_err(|error| {
        Failure::new(
            ErrorKind::Memory,
            format!("no thread could be started for the work: {error}"),
        )
    })?;
    let mut shown = Instant::now();
    let ended = loop {
        match py.detach(|| wait(POLL_INTERVAL)) {
            Ok(result) => return Ok(result?),
            Err(RecvTimeoutError::Disconnected) => {
                return Err(Failure::new(ErrorKind::Internal, "the thread that worked is gone").into());
            }
            Err(RecvTimeoutError::Timeout) => {}
        }
        if let Err(error) = py.check_signals() {
            break error;
        }
        if let Some(progress) = progress
            && shown.elapsed() >= PROGRESS_INTERVAL
        {
            shown = Instant::now();
            match show(progress, &watch) {
                Ok(true) => {}
                Ok(false) => break Failure::cancelled().into(),
                Err(error) => break error,
            }
        }
    };
    watch.0.is_cancelled.store(true, Ordering::Relaxed);
    // A result that was ready all the same is not wanted any more.
    let _ = py.detach(|| wait(GRACE));
    Err(ended)
}

/// Runs work that takes less than some milliseconds, on this thread.
pub fn run_briefly<T: Send>(py: Python<'_>, work: impl FnOnce() -> T + Send) -> PyResult<T> {
    require_threads()?;
    Ok(py.detach(|| guarded(|| Ok(work())))?)
}

/// Calls the callback with the latest step that it has not seen; whether the work goes on.
fn show(progress: &Bound<'_, PyAny>, watch: &Watch) -> PyResult<bool> {
    let latest = watch.0.latest.lock().unwrap_or_else(PoisonError::into_inner).take();
    let Some(Step { name, fraction, detail }) = latest else {
        return Ok(true);
    };
    let answer = progress.call1((name, fraction, detail))?;
    // Anything but `False`, such as the `None` of a plain function, lets it go on.
    Ok(!matches!(answer.extract::<bool>(), Ok(false)))
}

fn deadline_after(seconds: f64) -> Result<Instant, Failure> {
    let limit = Duration::try_from_secs_f64(seconds).ok();
    let end = limit.and_then(|limit| Instant::now().checked_add(limit));
    end.ok_or_else(|| Failure::invalid(format!("time_limit is {seconds}, but must be a number of seconds")))
}

/// Where in the source the latest panic was: the panic hook learns it, `catch_unwind` does not.
static LATEST_PLACE: Mutex<String> = Mutex::new(String::new());

/// Turns a panic into an error.
fn guarded<T>(work: impl FnOnce() -> Result<T, Failure>) -> Result<T, Failure> {
    // The default hook would write to the standard error of the interpreter. This module has a hook of its own, which
    // other modules do not share.
    static SILENCE: Once = Once::new();
    SILENCE.call_once(|| {
        std::panic::set_hook(Box::new(|info| {
            let place = info.location().map(ToString::to_string).unwrap_or_default();
            *LATEST_PLACE.lock().unwrap_or_else(PoisonError::into_inner) = place;
        }));
    });
    // Objects of Python are immutable, or lost when work on them unwinds.
    catch_unwind(AssertUnwindSafe(work)).unwrap_or_else(|payload| Err(failure_of(payload.as_ref())))
}

fn failure_of(payload: &(dyn Any + Send)) -> Failure {
    if payload.is::<Unwound>() {
        return Failure::cancelled();
    }
    let what = payload.downcast_ref::<String>().map(String::as_str);
    let what = what.or_else(|| payload.downcast_ref::<&str>().copied());
    let place = LATEST_PLACE.lock().unwrap_or_else(PoisonError::into_inner).clone();
    Failure::new(
        ErrorKind::Internal,
        format!(
            "a bug in solidmap itself, please report it: {} ({place})",
            what.unwrap_or("a panic without a message")
        ),
    )
}

/// Has the system's allocator keep what is freed, up to as much as it keeps by itself after large blocks were freed. A
/// threshold in the environment, as Dask sets one for its workers, makes it give memory back to the system after each sum,
/// and take it again. Does nothing where the allocator is not glibc's.
#[pyfunction]
pub fn keep_freed_memory() {
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    {
        const MMAP_THRESHOLD: libc::c_int = 32 << 20;
        // SAFETY: both only set numbers of the allocator, under its lock.
        unsafe {
            libc::mallopt(libc::M_MMAP_THRESHOLD, MMAP_THRESHOLD);
            libc::mallopt(libc::M_TRIM_THRESHOLD, 2 * MMAP_THRESHOLD);
        }
    }
}

/// How many threads were asked for; 0 for as many as rayon starts by itself.
static WANTED: AtomicUsize = AtomicUsize::new(0);
/// The process whose threads they are; 0 before there are any.
static OWNER: AtomicU32 = AtomicU32::new(0);
static STARTING: Mutex<()> = Mutex::new(());

/// Starts the threads, if there are none yet.
fn require_threads() -> Result<(), Failure> {
    let this = std::process::id();
    match OWNER.load(Ordering::Acquire) {
        owner if owner == this => return Ok(()),
        0 => {}
        // Their threads do not exist in a forked process, which would wait for them forever.
        _ => {
            return Err(Failure::new(
                ErrorKind::Unsupported,
                "this process was forked from one that had already used solidmap, and has none of its threads; start \
                 processes by `spawn` (multiprocessing.set_start_method(\"spawn\"))",
            ));
        }
    }
    let _one = STARTING.lock().unwrap_or_else(PoisonError::into_inner);
    if OWNER.load(Ordering::Acquire) == this {
        return Ok(());
    }
    let threads = match WANTED.load(Ordering::Relaxed) {
        0 => from_environment(),
        wanted => wanted,
    };
    let built = rayon::ThreadPoolBuilder::new().num_threads(threads).build_global();
    built.map_err(|error| Failure::new(ErrorKind::Memory, format!("threads could not be started: {error}")))?;
    if threads > 0 {
        faer::set_global_parallelism(faer::Par::rayon(threads));
    }
    OWNER.store(this, Ordering::Release);
    Ok(())
}

/// What the environment asks for: rayon's own variable, which 0 leaves to rayon, or else the one that numerical programs
/// heed, and that Dask sets to 1 for its workers.
fn from_environment() -> usize {
    match std::env::var_os("RAYON_NUM_THREADS") {
        Some(_) => 0,
        None => std::env::var("OMP_NUM_THREADS")
            .ok()
            .and_then(|n| n.trim().parse().ok())
            .unwrap_or(0),
    }
}

/// At most eight threads per core, as in the program: many more spend their time waiting for one another.
const MOST_PER_CORE: usize = 8;

/// Sets the number of threads, before the first call that works.
#[pyfunction]
pub fn set_threads(threads: usize) -> PyResult<()> {
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    if threads == 0 {
        return Err(Failure::invalid("threads is 0, but must be at least 1").into());
    }
    let threads = threads.min(MOST_PER_CORE * cores);
    let _one = STARTING.lock().unwrap_or_else(PoisonError::into_inner);
    if OWNER.load(Ordering::Acquire) == std::process::id() {
        let running = rayon::current_num_threads();
        if running == threads {
            return Ok(());
        }
        return Err(Failure::new(
            ErrorKind::Unsupported,
            format!("{running} threads run already; set their number before the first call that works"),
        )
        .into());
    }
    WANTED.store(threads, Ordering::Relaxed);
    Ok(())
}

/// The number of threads that work is spread over.
#[pyfunction]
pub fn threads() -> PyResult<usize> {
    require_threads()?;
    Ok(rayon::current_num_threads())
}

//! Cancellation of calls, which neither library knows: the caller is free at once, and a worker is killed.

use std::cell::RefCell;
use std::io;
use std::net::Shutdown;
use std::os::unix::net::UnixStream;
use std::sync::{Arc, Mutex, PoisonError};

use super::CgalTetgenError;
use crate::progress::{ProgressResponse, Spawn, Unfinished, run_abandonable};

/// Runs calls of this module on another thread; `progress` is called ten times in a second on this one.
///
/// When it cancels, this returns at once. With a worker process ([`isolate`](super::isolate)) the call that is running is
/// ended, and the worker with it; the next call starts another. In this process the call goes on to its end in the
/// background, since neither library can be interrupted: its thread and its memory are free only then, and calls of TetGen
/// wait for it.
///
/// ```
/// use std::ops::ControlFlow;
/// use solidmap::cgal_tetgen::{CgalTetgenError, TetOptions, cancellable, tetrahedralize};
/// use solidmap::mesh::shapes;
///
/// let surface = shapes::sphere(1.0, 3);
/// let cancel = || ControlFlow::Break(());
/// let made = cancellable(&cancel, move || tetrahedralize(&surface, &TetOptions::default()));
/// assert_eq!(made.err(), Some(CgalTetgenError::Cancelled));
/// ```
///
/// # Errors
///
/// [`CgalTetgenError::Cancelled`], and those of the calls.
pub fn cancellable<R: Send + 'static, A: ProgressResponse>(
    progress: &dyn Fn() -> A,
    calls: impl FnOnce() -> Result<R, CgalTetgenError> + Send + 'static,
) -> Result<R, CgalTetgenError> {
    let poll = || progress().control_flow();
    if poll().is_break() {
        return Err(CgalTetgenError::Cancelled);
    }
    let running = RunningCall::default();
    let own = running.clone();
    let calls = move || {
        RUNNING.with_borrow_mut(|running| *running = own);
        calls()
    };
    run_abandonable(ON_NEW_THREAD, &poll, calls).unwrap_or_else(|unfinished| match unfinished {
        Unfinished::Cancelled => {
            running.cancel();
            Err(CgalTetgenError::Cancelled)
        }
        Unfinished::NotStarted => Err(CgalTetgenError::OutOfMemory),
    })
}

/// On a thread of its own, since calls may block it for long; not at all if the system has no thread left.
const ON_NEW_THREAD: Spawn = |work| drop(std::thread::Builder::new().spawn(work));

thread_local! {
    /// The call that this thread makes.
    static RUNNING: RefCell<RunningCall> = RefCell::default();
}

/// A thread's call, which another thread can end.
#[derive(Clone, Default)]
struct RunningCall(Arc<Mutex<CallState>>);

#[derive(Default)]
enum CallState {
    #[default]
    Idle,
    /// Waiting for the reply of a worker.
    Waiting(UnixStream),
    Cancelled,
}

impl RunningCall {
    /// Ends the call that is running, and refuses further ones.
    fn cancel(&self) {
        let mut state = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if let CallState::Waiting(socket) = &*state {
            // The wait for the reply ends with an error, upon which the worker is killed.
            let _ = socket.shutdown(Shutdown::Both);
        }
        *state = CallState::Cancelled;
    }

    /// Enters a state, unless cancelled.
    fn enter(&self, next: CallState) -> Result<(), CgalTetgenError> {
        match &mut *self.0.lock().unwrap_or_else(PoisonError::into_inner) {
            CallState::Cancelled => Err(CgalTetgenError::Cancelled),
            state => {
                *state = next;
                Ok(())
            }
        }
    }
}

/// Refuses a call in this process that is not wanted any more.
pub(super) fn require_wanted() -> Result<(), CgalTetgenError> {
    RUNNING.with_borrow(|running| running.enter(CallState::Idle))
}

/// Runs an exchange with a worker so that it can be cancelled: then it fails, as when the worker has ended.
pub(super) fn exchange<R>(
    socket: &UnixStream,
    exchange: impl FnOnce() -> io::Result<R>,
) -> Result<io::Result<R>, CgalTetgenError> {
    let socket = socket
        .try_clone()
        .map_err(|error| CgalTetgenError::Unknown(error.to_string()))?;
    RUNNING.with_borrow(|running| {
        running.enter(CallState::Waiting(socket))?;
        let reply = exchange();
        // Also where the reply came just before, since the socket is closed now.
        let wanted = running.enter(CallState::Idle);
        Ok(wanted.map_err(|_| io::ErrorKind::ConnectionAborted.into()).and(reply))
    })
}

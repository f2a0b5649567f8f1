//! Ctrl-C and the other signals that ask a program to end, and the time limit.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, MutexGuard, OnceLock, PoisonError};
use std::time::{Duration, Instant};

use indicatif::ProgressBar;

use super::json::{self, FailureKind};
use super::made_folder;
use super::output::{Output, to_stderr, to_stdout};
use solidmap::io;
use solidmap::progress::ProgressControl;

/// The exit code of a program that was interrupted, as shells have it.
const INTERRUPTED: i32 = 130;
/// The exit code of a program that did not end in time.
const COULD_NOT_RUN: i32 = crate::COULD_NOT_RUN as i32;

/// What an interrupt removes.
struct Removed {
    /// Temporary folders, with all that is in them.
    whole: Vec<PathBuf>,
    /// Folders to be removed if they are empty, inner ones first.
    if_empty: Vec<PathBuf>,
}

static REMOVED: Mutex<Removed> = Mutex::new(Removed {
    whole: Vec::new(),
    if_empty: Vec::new(),
});

fn removed() -> MutexGuard<'static, Removed> {
    REMOVED.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Has an interrupt remove this temporary folder as well.
pub fn remove_folder_too(folder: &Path) {
    removed().whole.push(folder.to_owned());
}

/// Has an interrupt remove these folders as well if they are empty then, inner ones first.
pub fn remove_empty_folders_too(folders: &[PathBuf]) {
    removed().if_empty.extend_from_slice(folders);
}

/// Does work that an interrupt waits for. The work must not call [`io::atomic_write`]: an interrupt blocks it for
/// ever, and would not end.
pub fn hold_off<T>(work: impl FnOnce() -> T) -> T {
    let _held = removed();
    work()
}

/// From now on an interrupt removes what is half written and ends the program. Signals that are ignored, as under
/// `nohup`, stay ignored.
pub fn end_cleanly(output: &Output) {
    let line = output.progress_line();
    let as_json = output.errors_as_json();
    let ignored = IgnoredSignals::now();
    // Without a handler the system ends the program, which may leave a temporary file.
    let _ = ctrlc::set_handler(move || end(&line, FailureKind::Interrupted, "interrupted", as_json));
    ignored.ignore();
}

/// The signals that end programs and are ignored: Ctrl-C by what a script runs in the background, the end of a session under
/// `nohup`.
#[cfg(unix)]
struct IgnoredSignals(Vec<libc::c_int>);

#[cfg(unix)]
impl IgnoredSignals {
    fn now() -> Self {
        let mut signals = vec![libc::SIGINT, libc::SIGTERM, libc::SIGHUP];
        signals.retain(|&signal| {
            let mut action = std::mem::MaybeUninit::<libc::sigaction>::zeroed();
            // SAFETY: a null pointer leaves the action as it is, and the other one points to room for it, which is zero
            // where none is written.
            let found = unsafe { libc::sigaction(signal, std::ptr::null(), action.as_mut_ptr()) };
            // SAFETY: all of it was zeroed, for which it has a meaning.
            found == 0 && unsafe { action.assume_init() }.sa_sigaction == libc::SIG_IGN
        });
        Self(signals)
    }

    fn ignore(&self) {
        for &signal in &self.0 {
            // SAFETY: to ignore a signal runs no code of ours.
            unsafe { libc::signal(signal, libc::SIG_IGN) };
        }
    }
}

#[cfg(not(unix))]
struct IgnoredSignals;

#[cfg(not(unix))]
impl IgnoredSignals {
    fn now() -> Self {
        Self
    }

    fn ignore(&self) {}
}

/// `--time-limit` in seconds, and when it began.
static TIME_LIMIT: OnceLock<(f64, Instant)> = OnceLock::new();
/// Whether a valid result is near, that the time limit waits for.
static RESULT_IS_NEAR: AtomicBool = AtomicBool::new(false);

/// How work goes on that can be concluded, so that its best result so far is written: it is once the time limit is
/// reached. `has_result` says that there is one, or soon will be; until then the limit ends the program.
pub fn control(has_result: bool) -> ProgressControl {
    control_until(1.0, has_result)
}

/// As [`control`], for work that other work follows: it is concluded at this share of the time limit.
pub fn control_until(share: f64, has_result: bool) -> ProgressControl {
    if has_result {
        RESULT_IS_NEAR.store(true, Ordering::Relaxed);
    }
    match TIME_LIMIT.get() {
        Some((limit, begun)) if begun.elapsed().as_secs_f64() >= share * limit => ProgressControl::Conclude,
        _ => ProgressControl::Continue,
    }
}

/// The warning that a result is what there was at the time limit.
pub fn concluded(what: &str) -> String {
    let limit = TIME_LIMIT.get().map_or(0.0, |(limit, _)| *limit);
    format!(
        "the time limit of {limit} s (--time-limit) was reached: the {what} is the best so far, and could be better"
    )
}

/// Seconds that concluding may take beyond a limit: a quarter of it, and at least this.
const LEAST_GRACE: f64 = 10.0;

/// Ends the program so many seconds from now, as an interrupt does; somewhat later where a result is near
/// ([`control`]).
pub fn end_after(seconds: f64, output: &Output) {
    let _ = TIME_LIMIT.set((seconds, Instant::now()));
    let line = output.progress_line();
    let as_json = output.errors_as_json();
    // Without a thread there is no memory left for anything else either.
    let _ = std::thread::Builder::new().spawn(move || {
        std::thread::sleep(Duration::from_secs_f64(seconds));
        if RESULT_IS_NEAR.load(Ordering::Relaxed) {
            std::thread::sleep(Duration::from_secs_f64(LEAST_GRACE.max(seconds / 4.0)));
        }
        let message = format!("not done within the time limit of {seconds} s (--time-limit)");
        end(&line, FailureKind::TimeLimit, &message, as_json);
    });
}

/// Removes what is half written and exits. The worker of CGAL and TetGen ends with this process.
fn end(line: &ProgressBar, kind: FailureKind, message: &str, as_json: bool) {
    io::abandon_writes();
    let removed = removed();
    for folder in &removed.whole {
        let _ = std::fs::remove_dir_all(folder);
    }
    made_folder::remove_empty(&removed.if_empty);
    line.finish_and_clear();
    let code = if kind == FailureKind::Interrupted {
        to_stderr(format_args!("{message}"));
        INTERRUPTED
    } else {
        to_stderr(format_args!("error: {message}"));
        COULD_NOT_RUN
    };
    if as_json {
        // A failure to write cannot be reported anywhere.
        let _ = to_stdout(&json::error(kind, message, code));
    }
    std::process::exit(code);
}

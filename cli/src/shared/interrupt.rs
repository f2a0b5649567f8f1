//! Ctrl-C and the other signals that ask a program to end, and the time limit.

use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use indicatif::ProgressBar;

use super::output::{Output, to_stderr};
use solidmap::io;

/// The exit code of a program that was interrupted, as shells have it.
const INTERRUPTED: i32 = 130;
/// The exit code of a program that did not end in time: as when it could not run.
const OUT_OF_TIME: i32 = 2;

static SCRATCH: Mutex<Option<PathBuf>> = Mutex::new(None);

fn scratch() -> MutexGuard<'static, Option<PathBuf>> {
    SCRATCH.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Has an interrupt remove this temporary folder as well.
pub fn remove_folder_too(folder: &Path) {
    *scratch() = Some(folder.to_owned());
}

/// Does work that an interrupt waits for. The work must not call [`io::atomic_write`]: an interrupt blocks it for
/// ever, and would not end.
pub fn hold_off<T>(work: impl FnOnce() -> T) -> T {
    let _held = scratch();
    work()
}

/// From now on an interrupt removes what is half written and ends the program. Signals that are ignored, as under
/// `nohup`, stay ignored.
pub fn end_cleanly(output: &Output) {
    let line = output.progress_line();
    // Without a handler the system ends the program, which may leave a temporary file.
    let _ = ctrlc::try_set_handler(move || end(&line, "interrupted", INTERRUPTED));
}

/// Ends the program so many seconds from now, as an interrupt does.
pub fn end_after(seconds: f64, output: &Output) {
    let line = output.progress_line();
    std::thread::spawn(move || {
        std::thread::sleep(Duration::from_secs_f64(seconds));
        let message = format!("error: not done within the time limit of {seconds} s (--time-limit)");
        end(&line, &message, OUT_OF_TIME);
    });
}

/// Removes what is half written and exits. The worker of CGAL and TetGen ends with this process.
fn end(line: &ProgressBar, message: &str, code: i32) {
    io::abandon_writes();
    if let Some(folder) = scratch().take() {
        let _ = std::fs::remove_dir_all(folder);
    }
    line.finish_and_clear();
    to_stderr(format_args!("{message}"));
    std::process::exit(code);
}

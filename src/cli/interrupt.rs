//! Ctrl-C, and the other signals that ask a program to end.

use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

use super::output::{self, Output};
use solidmap::io;

/// What a shell shows for a program that was interrupted.
const INTERRUPTED: i32 = 130;

static SCRATCH: Mutex<Option<PathBuf>> = Mutex::new(None);

fn scratch() -> MutexGuard<'static, Option<PathBuf>> {
    SCRATCH.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A temporary folder that an interrupt removes as well.
pub fn remove_folder(folder: &Path) {
    *scratch() = Some(folder.to_owned());
}

/// Does what must not be left half done: an interrupt waits for its end. Within it nothing may be written by
/// [`io::atomic_write`], which an interrupt stops.
pub fn hold_off<T>(work: impl FnOnce() -> T) -> T {
    let _held = scratch();
    work()
}

/// From now on an interrupt removes what is half written and ends the program. One that is ignored, as under `nohup`,
/// stays so.
pub fn end_cleanly(output: &Output) {
    let line = output.line();
    // Without a handler the system ends the program; no more than a temporary file is left.
    let _ = ctrlc::try_set_handler(move || {
        io::abandon_writes();
        if let Some(folder) = scratch().take() {
            let _ = std::fs::remove_dir_all(folder);
        }
        line.finish_and_clear();
        output::say(format_args!("interrupted"));
        std::process::exit(INTERRUPTED);
    });
}

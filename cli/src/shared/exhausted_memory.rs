//! What happens when the system gives no more memory, as under `ulimit -v`: the program ends with an error, not as if it
//! had crashed.
//!
//! Rust aborts when an allocation fails that nothing handles. The allocator notes the failure, so that the handler of the
//! abort can tell it from others.

use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicBool, Ordering};

/// The system's allocator; the program's `main.rs` installs it.
pub struct NotingAllocator;

/// Whether an allocation has failed.
static FAILED: AtomicBool = AtomicBool::new(false);
/// Whether the error is printed as JSON too.
static AS_JSON: AtomicBool = AtomicBool::new(false);

fn noted(memory: *mut u8) -> *mut u8 {
    if memory.is_null() {
        FAILED.store(true, Ordering::Relaxed);
    }
    memory
}

// SAFETY: every call goes to the system's allocator with the same arguments.
unsafe impl GlobalAlloc for NotingAllocator {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        // SAFETY: as for this function.
        noted(unsafe { System.alloc(layout) })
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        // SAFETY: as for this function.
        noted(unsafe { System.alloc_zeroed(layout) })
    }

    unsafe fn realloc(&self, memory: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        // SAFETY: as for this function.
        noted(unsafe { System.realloc(memory, layout, size) })
    }

    unsafe fn dealloc(&self, memory: *mut u8, layout: Layout) {
        // SAFETY: as for this function.
        unsafe { System.dealloc(memory, layout) }
    }
}

const MESSAGE: &str = "error: out of memory: the system gives this process no more; free some, raise its limit (ulimit -v), \
                       or take smaller models, fewer sources or --memory\n";

/// As [`super::json`] writes it.
const JSON: &str = concat!(
    "{\n  \"version\": {\n    \"schema\": 1,\n    \"program\": \"",
    env!("CARGO_PKG_VERSION"),
    "\"\n  },\n  \"error\": {\n    \"kind\": \"out_of_memory\",\n    \"message\": \"out of memory: the system gives this \
     process no more\",\n    \"exit_code\": 2\n  }\n}\n"
);

/// From now on, an allocation that fails ends the program with exit code 2.
#[cfg(unix)]
pub fn end_with_an_error(as_json: bool) {
    AS_JSON.store(as_json, Ordering::Relaxed);
    let handler = on_abort as extern "C" fn(libc::c_int);
    // SAFETY: the handler calls nothing that allocates or locks, but for removing files, which it only tries; and the
    // thread that it interrupts does not go on.
    unsafe {
        libc::signal(libc::SIGABRT, handler as libc::sighandler_t);
    }
}

#[cfg(unix)]
extern "C" fn on_abort(_: libc::c_int) {
    if !FAILED.load(Ordering::Relaxed) {
        // Another abort, or a signal from outside: it ends the process when this returns.
        // SAFETY: both may be called in handlers.
        unsafe {
            libc::signal(libc::SIGABRT, libc::SIG_DFL);
            libc::raise(libc::SIGABRT);
        }
        return;
    }
    solidmap::io::try_abandon_writes();
    print(libc::STDERR_FILENO, MESSAGE);
    if AS_JSON.load(Ordering::Relaxed) {
        print(libc::STDOUT_FILENO, JSON);
    }
    // SAFETY: it ends the process at once.
    unsafe { libc::_exit(crate::COULD_NOT_RUN.into()) }
}

#[cfg(unix)]
fn print(file: libc::c_int, text: &str) {
    // SAFETY: the text is that long. A failure cannot be reported anywhere.
    let _ = unsafe { libc::write(file, text.as_ptr().cast(), text.len()) };
}

#[cfg(not(unix))]
pub fn end_with_an_error(_: bool) {}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shared::json::{FailureKind, error};

    #[test]
    fn the_json_is_that_of_other_errors() {
        let message = "out of memory: the system gives this process no more";
        let other = error(FailureKind::Failed, message, 2) + "\n";
        assert_eq!(other.replace("\"failed\"", "\"out_of_memory\""), JSON);
    }
}

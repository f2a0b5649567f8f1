//! The one error type for C++: a kind and a message. Panics become errors of the kind `internal`.

use std::fmt::{self, Display, Formatter};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Mutex, Once, PoisonError};

pub use solidmap::error_kind::ErrorKind;
use solidmap::error_kind::{Classified, with_causes};

/// Why a call failed. Displays as the kind's digit and the message, which `throw_decoded` in C++ separates again.
#[derive(Debug)]
pub struct Error {
    kind: ErrorKind,
    message: String,
}

/// The number of a kind in `solidmap::Category` (`cpp/include/solidmap/error.hpp`).
fn digit(kind: ErrorKind) -> u8 {
    match kind {
        ErrorKind::InvalidInput => 0,
        ErrorKind::Io => 1,
        ErrorKind::NotFound => 2,
        ErrorKind::Unsupported => 3,
        ErrorKind::Numerical => 4,
        ErrorKind::Memory => 5,
        ErrorKind::Cancelled => 6,
        ErrorKind::Native => 7,
        ErrorKind::Internal => 8,
    }
}

impl Display for Error {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        write!(f, "{}{}", digit(self.kind), self.message)
    }
}

impl Error {
    pub fn invalid(message: impl Into<String>) -> Self {
        Self::new(ErrorKind::InvalidInput, message)
    }

    pub fn new(kind: ErrorKind, message: impl Into<String>) -> Self {
        let message = message.into();
        Self { kind, message }
    }
}

impl<E: Classified> From<E> for Error {
    fn from(error: E) -> Self {
        Self::new(error.error_kind(), with_causes(&error))
    }
}

/// Where in the source the latest panic was: the panic hook learns it, `catch_unwind` does not.
static LATEST_PLACE: Mutex<String> = Mutex::new(String::new());

/// Runs the body of a bridge function, and turns a panic into an error. Unwinding leaves no broken state behind: all
/// objects behind the bridge are immutable.
pub fn guarded<T>(work: impl FnOnce() -> Result<T, Error>) -> Result<T, Error> {
    // The default hook would write to the standard error of the calling program.
    static SILENCE: Once = Once::new();
    SILENCE.call_once(|| {
        std::panic::set_hook(Box::new(|info| {
            let place = info.location().map(ToString::to_string).unwrap_or_default();
            *LATEST_PLACE.lock().unwrap_or_else(PoisonError::into_inner) = place;
        }));
    });
    catch_unwind(AssertUnwindSafe(work)).unwrap_or_else(|payload| {
        let what = payload.downcast_ref::<String>().map(String::as_str);
        let what = what.or_else(|| payload.downcast_ref::<&str>().copied());
        let place = LATEST_PLACE.lock().unwrap_or_else(PoisonError::into_inner).clone();
        let message = format!(
            "a bug in solidmap itself, please report it: {} ({place})",
            what.unwrap_or("a panic without a message")
        );
        Err(Error::new(ErrorKind::Internal, message))
    })
}

#[cfg(test)]
mod tests {
    use solidmap::fit::FitError;
    use solidmap::solver::SolveError;

    use super::*;

    #[test]
    fn a_panic_is_an_error_that_names_its_place() {
        let error = guarded::<()>(|| panic!("{} of {}", 3, 2)).unwrap_err();
        assert_eq!(error.kind, ErrorKind::Internal);
        assert!(
            error.message.contains("3 of 2") && error.message.contains("bridge/error.rs:"),
            "{error}"
        );
        // Also a panic in another thread.
        let error = guarded::<()>(|| {
            rayon::join(|| panic!("elsewhere"), || ());
            Ok(())
        });
        assert!(error.unwrap_err().message.contains("elsewhere"));
        assert!(guarded(|| Ok(7)).is_ok_and(|seven| seven == 7));
    }

    #[test]
    fn kinds_have_the_numbers_and_names_of_the_header() {
        let header = include_str!("../include/solidmap/error.hpp");
        let body = header.split_once("enum class Category {").unwrap().1;
        let body = body.split_once("};").unwrap().0;
        let names = body.lines().map(str::trim).filter_map(|line| line.strip_suffix(','));
        let of = |kind: ErrorKind| (usize::from(digit(kind)), kind.name());
        assert!(names.enumerate().eq(ErrorKind::ALL.map(of)), "{body}");
    }

    #[test]
    fn errors_of_the_library_keep_their_kind_and_quote_causes_once() {
        let error: Error = FitError::from(SolveError::NoConvergence).into();
        assert_eq!(error.kind, ErrorKind::Numerical);
        assert_eq!(error.message.matches("did not converge").count(), 1);
    }
}

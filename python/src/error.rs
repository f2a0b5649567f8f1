//! Errors of the library as exceptions: `solidmap.SolidmapError` and its subclasses, which Python defines.

use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::PyType;

pub use solidmap::error_kind::ErrorKind;
use solidmap::error_kind::{Classified, with_causes};

/// The class of a kind, in `solidmap/_errors.py`.
fn class(kind: ErrorKind) -> &'static str {
    match kind {
        ErrorKind::InvalidInput => "InvalidInputError",
        ErrorKind::Io => "FileError",
        ErrorKind::NotFound => "MissingFileError",
        ErrorKind::Unsupported => "UnsupportedError",
        ErrorKind::Numerical => "NumericalError",
        ErrorKind::Memory => "TooLargeError",
        ErrorKind::Cancelled => "CancelledError",
        ErrorKind::Native => "NativeError",
        ErrorKind::Internal => "InternalError",
    }
}

/// Why a call failed.
#[derive(Debug)]
pub struct Failure {
    kind: ErrorKind,
    message: String,
}

impl Failure {
    pub fn new(kind: ErrorKind, message: impl Into<String>) -> Self {
        let message = message.into();
        Self { kind, message }
    }

    pub fn invalid(message: impl Into<String>) -> Self {
        Self::new(ErrorKind::InvalidInput, message)
    }

    pub fn message(&self) -> &str {
        &self.message
    }

    pub fn cancelled() -> Self {
        Self::new(ErrorKind::Cancelled, "cancelled by the progress callback")
    }

    /// What a build without CGAL and TetGen says.
    #[cfg(not(feature = "native"))]
    pub fn needs_native(what: &str, instead: &str) -> Self {
        Self::new(
            ErrorKind::Unsupported,
            format!(
                "{what} needs CGAL and TetGen, and this solidmap was built without them: build it from source with its \
                 default features (`pip install .` in a clone), or {instead}"
            ),
        )
    }
}

impl From<Failure> for PyErr {
    fn from(failure: Failure) -> Self {
        Python::attach(|py| {
            static CLASSES: PyOnceLock<Py<PyModule>> = PyOnceLock::new();
            let module = CLASSES.get_or_try_init(py, || py.import("solidmap._errors").map(Bound::unbind));
            let class = module.and_then(|module| module.bind(py).getattr(class(failure.kind)));
            match class.and_then(|class| Ok(class.cast_into::<PyType>()?)) {
                Ok(class) => PyErr::from_type(class, (failure.message,)),
                // Without its Python half, the module is being imported on its own.
                Err(_) => PyRuntimeError::new_err(failure.message),
            }
        })
    }
}

impl<E: Classified> From<E> for Failure {
    fn from(error: E) -> Self {
        Self::new(error.error_kind(), with_causes(&error))
    }
}

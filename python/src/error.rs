//! Errors of the library as exceptions: `solidmap.SolidmapError` and its subclasses, which Python defines.

use std::error::Error as StdError;
use std::io::ErrorKind;

use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::PyType;

use solidmap::baseline::BaselineError;
use solidmap::bijective::BijectiveError;
use solidmap::boundary_map::BoundaryMapError;
use solidmap::boundary_map::check::BoundaryCheckError;
use solidmap::boundary_map::pair::PairError;
use solidmap::certificate::CertificateError;
#[cfg(feature = "native")]
use solidmap::cgal_tetgen::CgalTetgenError;
use solidmap::check::HoleError;
use solidmap::compare::CompareError;
use solidmap::energy::{DomainMeshError, EnergyError, QuadratureError};
use solidmap::files::{LandmarkFileError, TensorFileError};
use solidmap::fit::FitError;
use solidmap::geometry::QueryError;
use solidmap::hexmesh::HexmeshError;
use solidmap::inverse::InverseError;
use solidmap::io::IoError;
use solidmap::map::Cancelled;
use solidmap::mesh::MeshError;
use solidmap::polycube::{MakePolycubeError, VoxelPolycubeError};
use solidmap::remesh::RemeshError;
use solidmap::sequence::SequenceError;
use solidmap::solver::SolveError;
use solidmap::spherical::SphericalError;
use solidmap::texture::TextureError;
use solidmap::transfer::TransferError;

/// What an error is about; each has its class in `solidmap/_errors.py`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Category {
    InvalidInput,
    File,
    NotFound,
    Unsupported,
    Numerical,
    Memory,
    Cancelled,
    Native,
    Internal,
}

impl Category {
    fn class(self) -> &'static str {
        match self {
            Self::InvalidInput => "InvalidInputError",
            Self::File => "FileError",
            Self::NotFound => "MissingFileError",
            Self::Unsupported => "UnsupportedError",
            Self::Numerical => "NumericalError",
            Self::Memory => "TooLargeError",
            Self::Cancelled => "CancelledError",
            Self::Native => "NativeError",
            Self::Internal => "InternalError",
        }
    }
}

/// Why a call failed.
#[derive(Debug)]
pub struct Failure {
    category: Category,
    message: String,
}

impl Failure {
    pub fn new(category: Category, message: impl Into<String>) -> Self {
        let message = message.into();
        Self { category, message }
    }

    pub fn invalid(message: impl Into<String>) -> Self {
        Self::new(Category::InvalidInput, message)
    }

    pub fn message(&self) -> &str {
        &self.message
    }

    pub fn cancelled() -> Self {
        Self::new(Category::Cancelled, "cancelled by the progress callback")
    }

    /// What a build without CGAL and TetGen says.
    #[cfg(not(feature = "native"))]
    pub fn needs_native(what: &str, instead: &str) -> Self {
        Self::new(
            Category::Unsupported,
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
            let class = module.and_then(|module| module.bind(py).getattr(failure.category.class()));
            match class.and_then(|class| Ok(class.cast_into::<PyType>()?)) {
                Ok(class) => PyErr::from_type(class, (failure.message,)),
                // Without its Python half, the module is being imported on its own.
                Err(_) => PyRuntimeError::new_err(failure.message),
            }
        })
    }
}

/// An error enum of the library whose variants have categories.
pub trait Categorised: StdError {
    fn category(&self) -> Category;
}

impl<E: Categorised> From<E> for Failure {
    fn from(error: E) -> Self {
        Self::new(error.category(), described(&error))
    }
}

/// The error and its causes, each once: many errors quote their cause.
fn described(error: &dyn StdError) -> String {
    let mut text = error.to_string();
    let mut cause = error.source();
    while let Some(error) = cause {
        let said = error.to_string();
        if !text.contains(&said) {
            text = format!("{text}: {said}");
        }
        cause = error.source();
    }
    text
}

macro_rules! categories {
    ($($error:ty => $($pattern:pat_param)|+ => $category:expr $(, $more:pat => $other:expr)*;)*) => {
        $(impl Categorised for $error {
            fn category(&self) -> Category {
                match self {
                    $($pattern)|+ => $category,
                    $($more => $other,)*
                    #[allow(unreachable_patterns, reason = "not every list leaves variants")]
                    _ => Category::InvalidInput,
                }
            }
        })*
    };
}

macro_rules! invalid_input {
    ($($error:ty),* $(,)?) => {
        $(impl Categorised for $error {
            fn category(&self) -> Category {
                Category::InvalidInput
            }
        })*
    };
}

invalid_input!(
    MeshError,
    BoundaryMapError,
    BoundaryCheckError,
    LandmarkFileError,
    HoleError,
    DomainMeshError,
    QuadratureError,
    QueryError,
    TransferError,
    VoxelPolycubeError,
);

categories! {
    TensorFileError => Self::Io(error) => error.category(), Self::Newer { .. } => Category::Unsupported;
    SphericalError =>
        Self::OutOfMemory { .. } => Category::Memory,
        Self::TooFine | Self::NotBijective(_) => Category::Numerical,
        Self::Cancelled => Category::Cancelled;
    PairError =>
        Self::Sphere { error, .. } => error.category(),
        Self::NoEmbedding => Category::Numerical,
        Self::Cancelled => Category::Cancelled;
    FitError =>
        Self::NoSources | Self::NonFiniteMap => Category::Numerical,
        Self::NeedsNative => Category::Unsupported,
        Self::TooLarge { .. } => Category::Memory,
        Self::Solve(error) => error.category(),
        Self::Cancelled => Category::Cancelled;
    BijectiveError =>
        Self::NotRepaired { .. } | Self::Boundary { .. } => Category::Numerical,
        Self::Remesh(error) => error.category(),
        Self::Cancelled => Category::Cancelled;
    Cancelled => Self => Category::Cancelled;
    CertificateError => Self::Cancelled => Category::Cancelled;
    InverseError => Self::Cancelled => Category::Cancelled, Self::NoValues => Category::Numerical;
    EnergyError => Self::NonFiniteJacobian { .. } => Category::Numerical;
    RemeshError =>
        Self::Cancelled => Category::Cancelled,
        Self::TooLarge { .. } | Self::TooMany { .. } => Category::Memory;
    MakePolycubeError =>
        Self::NoLabels | Self::NotFound { .. } => Category::Numerical,
        Self::Cancelled => Category::Cancelled;
    HexmeshError =>
        Self::Polycube(error) => error.category(),
        Self::Voxels(error) => error.category(),
        Self::Pair(error) => error.category(),
        Self::BoundaryMap(error) => error.category(),
        Self::Fit(error) => error.category(),
        Self::Remesh(error) => error.category(),
        Self::Neither { deformed, .. } => deformed.category();
    SequenceError =>
        Self::Fit(error) => error.category(),
        Self::Energy(error) => error.category(),
        Self::Bijective(error) => error.category();
    TextureError =>
        Self::Fit(error) => error.category(),
        Self::TooManySources { .. } => Category::Memory;
    CompareError =>
        Self::Fit(error) => error.category(),
        Self::Bijective(error) => error.category(),
        Self::NoMesher => Category::Unsupported,
        Self::TooManyTets { .. } => Category::Memory,
        Self::NonFinite { .. } | Self::NonFiniteBoundary => Category::Numerical;
    BaselineError => _ => Category::InvalidInput;
}

impl Categorised for SolveError {
    fn category(&self) -> Category {
        match self {
            Self::Underdetermined { .. } | Self::DataLength { .. } => Category::InvalidInput,
            Self::Cancelled => Category::Cancelled,
            _ => Category::Numerical,
        }
    }
}

impl Categorised for IoError {
    fn category(&self) -> Category {
        match self {
            Self::Read { source, .. } if source.kind() == ErrorKind::NotFound => Category::NotFound,
            Self::Read { .. } | Self::Write { .. } => Category::File,
            Self::UnknownExtension { .. } | Self::Unsupported { .. } => Category::Unsupported,
            _ => Category::InvalidInput,
        }
    }
}

#[cfg(feature = "native")]
impl Categorised for CgalTetgenError {
    fn category(&self) -> Category {
        match self {
            Self::InvalidInput(_) | Self::InvalidOption { .. } | Self::SelfIntersection { .. } => {
                Category::InvalidInput
            }
            Self::OutOfMemory | Self::TooFine { .. } | Self::TooLarge { .. } => Category::Memory,
            Self::Cancelled => Category::Cancelled,
            _ => Category::Native,
        }
    }
}

//! The one error type for C++: a category and a message. Panics become errors of the category `internal`.

use std::error::Error as StdError;
use std::fmt::{self, Display, Formatter};
use std::io::ErrorKind;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Mutex, Once, PoisonError};

use solidmap::bijective::BijectiveError;
use solidmap::boundary_map::BoundaryMapError;
use solidmap::boundary_map::pair::PairError;
use solidmap::certificate::CertificateError;
#[cfg(feature = "native")]
use solidmap::cgal_tetgen::CgalTetgenError;
use solidmap::check::HoleError;
use solidmap::energy::{DomainMeshError, EnergyError, QuadratureError};
use solidmap::files::TensorFileError;
use solidmap::fit::FitError;
use solidmap::geometry::SectionError;
use solidmap::hexmesh::HexmeshError;
use solidmap::inverse::InverseError;
use solidmap::io::IoError;
use solidmap::map::Cancelled;
use solidmap::mesh::MeshError;
use solidmap::polycube::{MakePolycubeError, VoxelPolycubeError};
use solidmap::remesh::RemeshError;
use solidmap::solver::SolveError;
use solidmap::spherical::SphericalError;

/// What an error is about; the numbers are those of `solidmap::Category` in `cpp/include/solidmap/error.hpp`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Category {
    InvalidInput = 0,
    Io = 1,
    NotFound = 2,
    Unsupported = 3,
    Numerical = 4,
    Memory = 5,
    Cancelled = 6,
    #[cfg_attr(not(feature = "native"), expect(dead_code, reason = "C++ knows it in every build"))]
    Native = 7,
    Internal = 8,
}

/// Why a call failed. Displays as the category's digit and the message, which `throw_decoded` in C++ separates again.
#[derive(Debug)]
pub struct Error {
    category: Category,
    message: String,
}

impl Display for Error {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        write!(f, "{}{}", self.category as u8, self.message)
    }
}

impl Error {
    pub fn invalid(message: impl Into<String>) -> Self {
        Self::new(Category::InvalidInput, message)
    }

    pub fn new(category: Category, message: impl Into<String>) -> Self {
        let message = message.into();
        Self { category, message }
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
        Err(Error::new(Category::Internal, message))
    })
}

/// An error enum of the library whose variants have categories.
pub trait Categorised: StdError {
    fn category(&self) -> Category;
}

impl<E: Categorised> From<E> for Error {
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

macro_rules! invalid_input {
    ($($error:ty),*) => {
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
    HoleError,
    DomainMeshError,
    QuadratureError,
    SectionError,
    VoxelPolycubeError
);

impl Categorised for IoError {
    fn category(&self) -> Category {
        match self {
            Self::Read { source, .. } if source.kind() == ErrorKind::NotFound => Category::NotFound,
            Self::Read { .. } | Self::Write { .. } => Category::Io,
            Self::UnknownExtension { .. } | Self::Unsupported { .. } => Category::Unsupported,
            _ => Category::InvalidInput,
        }
    }
}

impl Categorised for TensorFileError {
    fn category(&self) -> Category {
        match self {
            Self::Io(error) => error.category(),
            Self::Newer { .. } => Category::Unsupported,
            _ => Category::InvalidInput,
        }
    }
}

impl Categorised for SphericalError {
    fn category(&self) -> Category {
        match self {
            Self::OutOfMemory { .. } => Category::Memory,
            Self::TooFine | Self::NotBijective(_) => Category::Numerical,
            Self::Cancelled => Category::Cancelled,
            _ => Category::InvalidInput,
        }
    }
}

impl Categorised for PairError {
    fn category(&self) -> Category {
        match self {
            Self::Sphere { error, .. } => error.category(),
            Self::NoEmbedding => Category::Numerical,
            Self::Cancelled => Category::Cancelled,
            _ => Category::InvalidInput,
        }
    }
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

impl Categorised for FitError {
    fn category(&self) -> Category {
        match self {
            Self::NoSources | Self::NonFiniteMap => Category::Numerical,
            Self::NeedsNative => Category::Unsupported,
            #[cfg(feature = "native")]
            Self::Offset(error) => error.category(),
            Self::TooLarge { .. } => Category::Memory,
            Self::Solve(error) => error.category(),
            Self::Cancelled => Category::Cancelled,
            _ => Category::InvalidInput,
        }
    }
}

impl Categorised for BijectiveError {
    fn category(&self) -> Category {
        match self {
            Self::NotRepaired { .. } | Self::Boundary { .. } => Category::Numerical,
            Self::Remesh(error) => error.category(),
            Self::Cancelled => Category::Cancelled,
            _ => Category::InvalidInput,
        }
    }
}

impl Categorised for Cancelled {
    fn category(&self) -> Category {
        Category::Cancelled
    }
}

impl Categorised for CertificateError {
    fn category(&self) -> Category {
        match self {
            Self::Cancelled => Category::Cancelled,
            _ => Category::InvalidInput,
        }
    }
}

impl Categorised for InverseError {
    fn category(&self) -> Category {
        match self {
            Self::Cancelled => Category::Cancelled,
            Self::NoValues => Category::Numerical,
            _ => Category::InvalidInput,
        }
    }
}

impl Categorised for EnergyError {
    fn category(&self) -> Category {
        match self {
            Self::NonFiniteJacobian { .. } => Category::Numerical,
            _ => Category::InvalidInput,
        }
    }
}

impl Categorised for RemeshError {
    fn category(&self) -> Category {
        match self {
            Self::Cancelled => Category::Cancelled,
            Self::TooLarge { .. } | Self::TooMany { .. } => Category::Memory,
            _ => Category::InvalidInput,
        }
    }
}

impl Categorised for MakePolycubeError {
    fn category(&self) -> Category {
        match self {
            Self::NoLabels | Self::NotFound { .. } => Category::Numerical,
            Self::Cancelled => Category::Cancelled,
            _ => Category::InvalidInput,
        }
    }
}

impl Categorised for HexmeshError {
    fn category(&self) -> Category {
        match self {
            Self::Polycube(error) => error.category(),
            Self::Voxels(error) => error.category(),
            Self::Pair(error) => error.category(),
            Self::BoundaryMap(error) => error.category(),
            Self::Fit(error) => error.category(),
            Self::Remesh(error) => error.category(),
            Self::Neither { deformed, .. } => deformed.category(),
            Self::MaxDistance(_) | Self::NoVolume => Category::InvalidInput,
            _ => Category::Internal,
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_panic_is_an_error_that_names_its_place() {
        let error = guarded::<()>(|| panic!("{} of {}", 3, 2)).unwrap_err();
        assert_eq!(error.category, Category::Internal);
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
    fn causes_are_quoted_once_and_cancellation_keeps_its_category() {
        let error: Error = FitError::from(SolveError::Cancelled).into();
        assert_eq!(error.category, Category::Cancelled);
        let error: Error = FitError::from(SolveError::NoConvergence).into();
        assert_eq!(error.category, Category::Numerical);
        assert_eq!(error.message.matches("did not converge").count(), 1);
        let error: Error = HexmeshError::from(MakePolycubeError::Cancelled).into();
        assert_eq!(error.category, Category::Cancelled);
        let error: Error = HexmeshError::from(MakePolycubeError::NoLabels).into();
        assert_eq!(error.category, Category::Numerical);
        assert_eq!(error.message.matches("no polycube was found").count(), 1);
        let missing = solidmap::io::read_surface("/nowhere/a.obj").unwrap_err();
        assert_eq!(Error::from(missing).category, Category::NotFound);
    }
}

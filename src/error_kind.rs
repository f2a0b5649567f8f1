//! What an error is about, for programs that treat kinds of errors differently: one classification for Rust, C++, Python
//! and the program.

use std::error::Error as StdError;
use std::fmt::{self, Display, Formatter};
use std::io;

use crate::baseline::{BaselineError, MeanValueError};
use crate::bijective::BijectiveError;
use crate::boundary_map::check::BoundaryCheckError;
use crate::boundary_map::pair::{AlignError, ComponentsError, CurveError, LandmarkError, LoopError, PairError};
use crate::boundary_map::{BoundaryMapError, FundamentalDomainError};
use crate::certificate::CertificateError;
#[cfg(feature = "native")]
use crate::cgal_tetgen::{CgalTetgenError, InputDefect};
use crate::check::HoleError;
use crate::compare::CompareError;
use crate::energy::{DomainMeshError, EnergyError, QuadratureError};
#[cfg(feature = "io")]
use crate::files::{LandmarkFileError, TensorFileError};
use crate::fit::FitError;
use crate::geometry::{QueryError, SectionError};
use crate::hexmesh::HexmeshError;
use crate::hyperbolic::HyperbolicError;
use crate::improve::ImproveError;
use crate::inverse::InverseError;
#[cfg(feature = "io")]
use crate::io::IoError;
use crate::kernel::KernelError;
use crate::map::Cancelled;
use crate::mesh::MeshError;
use crate::model_polycube::ModelPolycubeError;
use crate::polycube::{MakePolycubeError, VoxelPolycubeError};
use crate::remesh::{GivenMeshError, PolycubeError, RemeshError};
use crate::sequence::{CycleError, SequenceError};
use crate::solver::SolveError;
use crate::spherical::SphericalError;
use crate::texture::TextureError;
use crate::toroidal::ToroidalError;
use crate::transfer::TransferError;

/// What an error is about; its message is for people.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum ErrorKind {
    /// Something given cannot be used: arrays that do not fit, an open surface, an option out of range, a damaged file.
    InvalidInput,
    /// The system could not read or write a file.
    Io,
    /// There is no such file.
    NotFound,
    /// Not in this build, an unknown format, or a file of a newer version.
    Unsupported,
    /// The computation failed: a singular system, a map that is not finite, no polycube.
    Numerical,
    /// More memory or more elements are needed than allowed, by an estimate made beforehand.
    Memory,
    /// A progress callback ended the work.
    Cancelled,
    /// CGAL or TetGen failed.
    Native,
    /// A bug in solidmap itself.
    Internal,
}

impl ErrorKind {
    /// All kinds.
    pub const ALL: [Self; 9] = [
        Self::InvalidInput,
        Self::Io,
        Self::NotFound,
        Self::Unsupported,
        Self::Numerical,
        Self::Memory,
        Self::Cancelled,
        Self::Native,
        Self::Internal,
    ];

    /// The name, such as `invalid_input`.
    pub fn name(self) -> &'static str {
        match self {
            Self::InvalidInput => "invalid_input",
            Self::Io => "io",
            Self::NotFound => "not_found",
            Self::Unsupported => "unsupported",
            Self::Numerical => "numerical",
            Self::Memory => "memory",
            Self::Cancelled => "cancelled",
            Self::Native => "native",
            Self::Internal => "internal",
        }
    }

    /// The kind of an error whose type is not known; `None` where it is none of this library and not of the system's files.
    ///
    /// ```
    /// use solidmap::error_kind::ErrorKind;
    ///
    /// let missing: Box<dyn std::error::Error> = solidmap::io::read_surface("no such file.obj").unwrap_err().into();
    /// assert_eq!(ErrorKind::of(&*missing), Some(ErrorKind::NotFound));
    /// ```
    pub fn of(error: &(dyn StdError + 'static)) -> Option<Self> {
        kind_of(error)
    }
}

impl Display for ErrorKind {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// An error with a kind: every error of this library, and those of the system's files.
pub trait Classified: StdError {
    /// What it is about.
    fn error_kind(&self) -> ErrorKind;
}

/// The message of an error with those of its causes, each once: many errors quote their cause.
pub fn with_causes(error: &dyn StdError) -> String {
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

// Variants are listed without a wildcard where any is not about what was given, so that a new one has to be classified.
macro_rules! classified {
    ($($(#[$attribute:meta])? $error:path { $($arms:tt)* })*) => {
        $($(#[$attribute])? impl Classified for $error {
            fn error_kind(&self) -> ErrorKind {
                match self { $($arms)* }
            }
        })*

        fn kind_of(error: &(dyn StdError + 'static)) -> Option<ErrorKind> {
            $($(#[$attribute])? {
                if let Some(found) = error.downcast_ref::<$error>() {
                    return Some(found.error_kind());
                }
            })*
            None
        }
    };
}

classified! {
    MeshError { _ => ErrorKind::InvalidInput }
    QueryError { _ => ErrorKind::InvalidInput }
    SectionError { _ => ErrorKind::InvalidInput }
    HoleError { _ => ErrorKind::InvalidInput }
    BoundaryMapError { _ => ErrorKind::InvalidInput }
    BoundaryCheckError { _ => ErrorKind::InvalidInput }
    AlignError { _ => ErrorKind::InvalidInput }
    LandmarkError { _ => ErrorKind::InvalidInput }
    ComponentsError { _ => ErrorKind::InvalidInput }
    CurveError { _ => ErrorKind::InvalidInput }
    LoopError { _ => ErrorKind::InvalidInput }
    KernelError { _ => ErrorKind::InvalidInput }
    MeanValueError { _ => ErrorKind::InvalidInput }
    GivenMeshError { _ => ErrorKind::InvalidInput }
    PolycubeError { _ => ErrorKind::InvalidInput }
    VoxelPolycubeError { _ => ErrorKind::InvalidInput }
    TransferError { _ => ErrorKind::InvalidInput }
    CycleError { _ => ErrorKind::InvalidInput }
    #[cfg(feature = "native")]
    InputDefect { _ => ErrorKind::InvalidInput }
    Cancelled { Self => ErrorKind::Cancelled }
    io::Error {
        error if error.kind() == io::ErrorKind::NotFound => ErrorKind::NotFound,
        error if error.kind() == io::ErrorKind::OutOfMemory => ErrorKind::Memory,
        _ => ErrorKind::Io,
    }
    #[cfg(feature = "io")]
    IoError {
        Self::Read { source, .. } => source.error_kind(),
        // The folder of a file that is written may be missing: the file itself is not what was looked for.
        Self::Write { .. } => ErrorKind::Io,
        Self::UnknownExtension { .. } | Self::Unsupported { .. } => ErrorKind::Unsupported,
        Self::Malformed { .. }
        | Self::Truncated { .. }
        | Self::CountExceedsFile { .. }
        | Self::Expands { .. }
        | Self::FewCorners { .. }
        | Self::IndexOutOfRange { .. }
        | Self::NoGeometry { .. }
        | Self::WrongKind { .. }
        | Self::TooLarge { .. }
        | Self::ValueCount { .. } => ErrorKind::InvalidInput,
    }
    #[cfg(feature = "io")]
    TensorFileError {
        Self::Io(error) => error.error_kind(),
        Self::Newer { .. } => ErrorKind::Unsupported,
        Self::Foreign { .. } | Self::Tensor { .. } => ErrorKind::InvalidInput,
    }
    #[cfg(feature = "io")]
    LandmarkFileError {
        Self::File(error) => error.error_kind(),
        Self::Empty { .. } | Self::Count { .. } | Self::OutOfRange { .. } | Self::Duplicate { .. } => {
            ErrorKind::InvalidInput
        }
    }
    #[cfg(feature = "native")]
    CgalTetgenError {
        Self::InvalidInput(_) | Self::InvalidOption { .. } | Self::SelfIntersection { .. } => ErrorKind::InvalidInput,
        Self::OutOfMemory | Self::TooFine { .. } | Self::TooLarge { .. } => ErrorKind::Memory,
        Self::Cancelled => ErrorKind::Cancelled,
        // Each is a failure of CGAL, of TetGen or of their process.
        _ => ErrorKind::Native,
    }
    ToroidalError {
        Self::Surface(error) => error.error_kind(),
        Self::OutOfMemory { .. } => ErrorKind::Memory,
        Self::TooFine | Self::NotBijective(_) => ErrorKind::Numerical,
        Self::Genus { .. } | Self::Crossing | Self::KnottedHole | Self::Count { .. } | Self::Translations { .. } => {
            ErrorKind::InvalidInput
        }
    }
    HyperbolicError {
        Self::Surface(error) => error.error_kind(),
        Self::Springs | Self::TooFine | Self::NotBijective(_) => ErrorKind::Numerical,
        Self::Genus { .. } | Self::Count { .. } | Self::Letters | Self::Words { .. } => ErrorKind::InvalidInput,
    }
    FundamentalDomainError {
        Self::Surface(error) => error.error_kind(),
        Self::Toroidal(error) => error.error_kind(),
        Self::Hyperbolic(error) => error.error_kind(),
        Self::NoHandle => ErrorKind::InvalidInput,
    }
    SphericalError {
        Self::OutOfMemory { .. } => ErrorKind::Memory,
        Self::TooFine | Self::NotBijective(_) => ErrorKind::Numerical,
        Self::Cancelled => ErrorKind::Cancelled,
        Self::Open { .. }
        | Self::NotManifold { .. }
        | Self::Components { .. }
        | Self::Genus { .. }
        | Self::NotOrientable { .. }
        | Self::OutOfScale { .. }
        | Self::NonFinite { .. }
        | Self::Unreferenced { .. }
        | Self::Count { .. } => ErrorKind::InvalidInput,
    }
    PairError {
        Self::Sphere { error, .. } => error.error_kind(),
        Self::Torus { error, .. } => error.error_kind(),
        Self::Hyperbolic { error, .. } => error.error_kind(),
        Self::Shell { error, .. } => error.error_kind(),
        Self::NoEmbedding => ErrorKind::Numerical,
        Self::Cancelled => ErrorKind::Cancelled,
        Self::Align(_)
        | Self::Landmarks(_)
        | Self::Curves(_)
        | Self::Loops(_)
        | Self::Components(_)
        | Self::Weight(_)
        | Self::Up
        | Self::UnequalGenus { .. }
        | Self::NoClass { .. }
        | Self::NotWithHandles { .. }
        | Self::Shells { .. }
        | Self::UnequalShells { .. }
        | Self::NoMatchingShells { .. }
        | Self::LandmarksMissed { .. }
        | Self::Start { .. }
        | Self::Boundary(_) => ErrorKind::InvalidInput,
    }
    SolveError {
        Self::Underdetermined { .. } | Self::DataLength { .. } => ErrorKind::InvalidInput,
        Self::Cancelled => ErrorKind::Cancelled,
        Self::NonFinite { .. }
        | Self::NoConvergence
        | Self::RowsNotNested { .. }
        | Self::Sum(_)
        | Self::RankZero { .. } => ErrorKind::Numerical,
    }
    FitError {
        Self::NoSources | Self::NonFiniteMap => ErrorKind::Numerical,
        Self::NeedsNative => ErrorKind::Unsupported,
        #[cfg(feature = "native")]
        Self::Offset(error) => error.error_kind(),
        Self::TooLarge { .. } => ErrorKind::Memory,
        Self::Solve(error) => error.error_kind(),
        Self::Cancelled => ErrorKind::Cancelled,
        Self::DefectiveDomain(_)
        | Self::OutOfScale { .. }
        | Self::Option { .. }
        | Self::SchwarzNeedsNearSources
        | Self::FreeSourcesNeedDense
        | Self::TooManyFreeSources { .. }
        | Self::Query(_)
        | Self::OtherDomain
        | Self::BoundaryMap(_) => ErrorKind::InvalidInput,
    }
    RemeshError {
        Self::Cancelled => ErrorKind::Cancelled,
        Self::TooMany { .. } | Self::TooLarge { .. } => ErrorKind::Memory,
        Self::Polycube(_) | Self::Given(_) | Self::Size(_) | Self::Mirrored | Self::Query(_) => ErrorKind::InvalidInput,
    }
    BijectiveError {
        Self::NotRepaired { .. } | Self::Boundary { .. } => ErrorKind::Numerical,
        Self::Remesh(error) => error.error_kind(),
        Self::Cancelled => ErrorKind::Cancelled,
        Self::NoTets
        | Self::ImageCount { .. }
        | Self::Inverted { .. }
        | Self::Option { .. }
        | Self::Query(_) => ErrorKind::InvalidInput,
    }
    CertificateError {
        Self::Cancelled => ErrorKind::Cancelled,
        Self::NonFiniteSource { .. }
        | Self::NonFiniteAffine
        | Self::NoVolume { .. }
        | Self::Open { .. }
        | Self::NoOrientation { .. }
        | Self::Option { .. } => ErrorKind::InvalidInput,
    }
    InverseError {
        Self::NoValues => ErrorKind::Numerical,
        Self::Cancelled => ErrorKind::Cancelled,
        Self::Domain(_) | Self::Target(_) | Self::Option { .. } | Self::Extent { .. } => ErrorKind::InvalidInput,
    }
    QuadratureError {
        Self::TooManyCells { .. } => ErrorKind::Memory,
        Self::Empty { .. }
        | Self::NonFinite { .. }
        | Self::NoCells(_)
        | Self::Open { .. }
        | Self::Tolerance(_)
        | Self::NoVolume { .. }
        | Self::InsideOut { .. } => ErrorKind::InvalidInput,
    }
    DomainMeshError {
        Self::Quadrature(error) => error.error_kind(),
        Self::Cells { .. } | Self::Volume { .. } | Self::Distance { .. } | Self::Surface(_) => ErrorKind::InvalidInput,
    }
    EnergyError {
        Self::NonFiniteJacobian { .. } => ErrorKind::Numerical,
        Self::Quadrature(error) => error.error_kind(),
        Self::Volume { .. } | Self::JacobianCount { .. } | Self::ImageCount { .. } => ErrorKind::InvalidInput,
    }
    MakePolycubeError {
        Self::NoLabels | Self::NotFound { .. } => ErrorKind::Numerical,
        Self::Cancelled => ErrorKind::Cancelled,
        Self::Smoothness(_)
        | Self::FeatureAngle(_)
        | Self::Lattice(_)
        | Self::Mesh(_)
        | Self::Empty
        | Self::NotManifold
        | Self::Flat(_)
        | Self::NotFinite(_)
        | Self::Labels { .. }
        | Self::MissingLabel(_)
        | Self::MirroredLabels => ErrorKind::InvalidInput,
    }
    ModelPolycubeError {
        Self::Deformation(error) => error.error_kind(),
        Self::Voxels(error) => error.error_kind(),
        Self::Pair(error) => error.error_kind(),
        Self::BoundaryMap(error) => error.error_kind(),
        // The deformation is what is tried first.
        Self::Neither { deformed, .. } => deformed.error_kind(),
        Self::NoVolume => ErrorKind::InvalidInput,
    }
    HexmeshError {
        Self::Polycube(error) => error.error_kind(),
        Self::Fit(error) => error.error_kind(),
        Self::Remesh(error) => error.error_kind(),
        // The deformed polycube is what is tried first.
        Self::Neither { deformed, .. } => deformed.error_kind(),
        Self::MaxDistance(_) => ErrorKind::InvalidInput,
    }
    ImproveError {
        Self::Fit(error) => error.error_kind(),
        Self::Energy(error) => error.error_kind(),
        Self::Sphere(error) => error.error_kind(),
        Self::Torus(error) => error.error_kind(),
        Self::Hyperbolic(error) => error.error_kind(),
        Self::BoundaryMap(error) => error.error_kind(),
        Self::NoEmbedding | Self::Option { .. } | Self::NoArea { .. } => {
            ErrorKind::InvalidInput
        }
    }
    SequenceError {
        Self::Quadrature(error) => error.error_kind(),
        Self::Fit(error) => error.error_kind(),
        Self::Energy(error) => error.error_kind(),
        Self::Bijective(error) => error.error_kind(),
        Self::Hole(_) | Self::Frame(_) | Self::Collapsed { .. } => ErrorKind::InvalidInput,
    }
    TextureError {
        Self::Fit(error) => error.error_kind(),
        Self::TooManySources { .. } | Self::TooLarge { .. } => ErrorKind::Memory,
        Self::PictureSize { .. }
        | Self::CheckerSquares { .. }
        | Self::UvCount { .. }
        | Self::UvNotFinite { .. }
        | Self::ColourCount { .. }
        | Self::ColourNotFinite { .. }
        | Self::NoUv
        | Self::Seams { .. }
        | Self::SourceLimit { .. }
        | Self::NoVoxels
        | Self::Inconsistent { .. }
        | Self::Query(_)
        | Self::BoundaryMap(_) => ErrorKind::InvalidInput,
    }
    BaselineError {
        Self::OutOfMemory { .. } => ErrorKind::Memory,
        Self::NotPositiveDefinite | Self::NotConverged { .. } => ErrorKind::Numerical,
        Self::NoTets
        | Self::NonFiniteVertex { .. }
        | Self::NonFiniteImage { .. }
        | Self::ImageCount { .. }
        | Self::FlatTet { .. }
        | Self::NoVolume { .. }
        | Self::NoBoundary { .. }
        | Self::Option { .. }
        | Self::Domain(_) => ErrorKind::InvalidInput,
    }
    CompareError {
        Self::Fit(error) => error.error_kind(),
        Self::Baseline(error) => error.error_kind(),
        Self::Bijective(error) => error.error_kind(),
        Self::MeanValue(error) => error.error_kind(),
        #[cfg(feature = "native")]
        Self::Mesher(error) => error.error_kind(),
        Self::Quadrature(error) => error.error_kind(),
        Self::Energy(error) => error.error_kind(),
        Self::NoMesher => ErrorKind::Unsupported,
        Self::TooManyTets { .. } => ErrorKind::Memory,
        Self::NonFinite { .. } | Self::NonFiniteBoundary => ErrorKind::Numerical,
        Self::OtherSolid { .. }
        | Self::Elsewhere { .. }
        | Self::Option { .. }
        | Self::Query(_)
        | Self::NotPrepared { .. }
        | Self::NoInterior { .. } => ErrorKind::InvalidInput,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_error_has_the_kind_of_its_cause_and_quotes_it_once() {
        let cancelled = HexmeshError::from(FitError::Solve(SolveError::Cancelled));
        assert_eq!(cancelled.error_kind(), ErrorKind::Cancelled);
        let failed = FitError::Solve(SolveError::NoConvergence);
        assert_eq!(failed.error_kind(), ErrorKind::Numerical);
        assert_eq!(with_causes(&failed).matches("did not converge").count(), 1);
        let neither = HexmeshError::Neither {
            deformed: Box::new(MakePolycubeError::NoLabels.into()),
            voxels: Box::new(ModelPolycubeError::NoVolume.into()),
        };
        assert_eq!(neither.error_kind(), ErrorKind::Numerical);
    }

    #[test]
    fn errors_of_unknown_types_are_classified_alike() {
        let boxed: Box<dyn StdError> = Box::new(CompareError::Bijective(Box::new(BijectiveError::Cancelled)));
        assert_eq!(ErrorKind::of(&*boxed), Some(ErrorKind::Cancelled));
        let missing = io::Error::from(io::ErrorKind::NotFound);
        assert_eq!(ErrorKind::of(&missing), Some(ErrorKind::NotFound));
        assert_eq!(ErrorKind::of(&fmt::Error), None);
    }
}

use crate::boundary_map::BoundaryMapError;
use crate::check::CheckReport;
use crate::geometry::QueryError;
use crate::memory::readable;
use crate::solver::SolveError;

/// Why a fit failed.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum FitError {
    /// The domain does not bound a solid.
    #[error("the domain does not bound a solid: {}", describe_errors(.0))]
    DefectiveDomain(Box<CheckReport>),
    /// Volumes and areas would overflow or underflow.
    #[error("the domain has a size of {diagonal:e}; scale it to between 1e-60 and 1e60")]
    OutOfScale {
        /// The diagonal of the bounding box, in model units.
        diagonal: f64,
    },
    /// A setting is out of range.
    #[error("`{option}` is {value}, but must be {range}")]
    Option {
        /// The field of [`crate::fit::FitOptions`].
        option: &'static str,
        /// Its value.
        value: f64,
        /// What is allowed.
        range: &'static str,
    },
    /// No source has room outside the domain.
    #[error("no source found a place outside the domain; its surface may be folded onto itself everywhere")]
    NoSources,
    /// The Schwarz solver was asked for with sources far from the surface.
    #[error(
        "the Schwarz solver needs sources near the surface: use the adaptive placement, or a dense solver with this one"
    )]
    SchwarzNeedsNearSources,
    /// Free sources were asked for with the Schwarz solver.
    #[error(
        "free sources need a dense solver, which the Schwarz solver is not: use QR or the singular value decomposition"
    )]
    FreeSourcesNeedDense,
    /// There are more sources than it pays to move.
    #[error(
        "{sources} free sources would take too long for what they gain, and at most {most} are allowed: ask for fewer \
         (`max_sources`), or leave the sources where they are placed, which meets the same error sooner with more of them"
    )]
    TooManyFreeSources {
        /// Sources asked for.
        sources: usize,
        /// Most that may be free: [`MOST_FREE_SOURCES`](crate::fit::MOST_FREE_SOURCES).
        most: usize,
    },
    /// Sources on an offset surface need the feature `native`.
    #[error("an offset surface needs CGAL; build with the feature `native`, or use the adaptive placement")]
    NeedsNative,
    /// The offset surface could not be built.
    #[cfg(feature = "native")]
    #[error("cannot build the offset surface for the sources: {0}")]
    Offset(#[source] crate::cgal_tetgen::CgalTetgenError),
    /// Distances to the domain's surface cannot be queried.
    #[error(transparent)]
    Query(#[from] QueryError),
    /// The boundary map is of another domain than the factorisation.
    #[error("the boundary map's domain is not the one that was factored")]
    OtherDomain,
    /// The coefficients are so large that the map has no finite value somewhere on the boundary.
    #[error(
        "the map is not finite on the whole boundary; bring sources nearer (adaptive placement) or raise the truncation"
    )]
    NonFiniteMap,
    /// The fit would not fit into memory.
    #[error(
        "{sources} sources and {collocation} collocation points need about {}, and {} are allowed{}; {}",
        readable(*.need), readable(*.allowed), describe_fitting(*.fitting), describe_remedy(*.addresses_are_short)
    )]
    TooLarge {
        /// Sources of all levels.
        sources: usize,
        /// Collocation points.
        collocation: usize,
        /// Bytes that the fit will need.
        need: u64,
        /// Bytes that it may take.
        allowed: u64,
        /// Sources to ask for (`max_sources`) that would fit; 0 when the mesh alone is too large.
        fitting: usize,
        /// Whether the address space is limited (`ulimit -v`) to less than is needed and the matrix kernels reserve.
        addresses_are_short: bool,
    },
    /// The boundary map is unusable.
    #[error(transparent)]
    BoundaryMap(#[from] BoundaryMapError),
    /// The system has no usable solution.
    #[error("cannot solve for the coefficients: {0}")]
    Solve(#[source] SolveError),
    /// The progress callback cancelled the fit.
    #[error("cancelled by the progress callback")]
    Cancelled,
}

#[cfg(feature = "native")]
impl From<crate::cgal_tetgen::CgalTetgenError> for FitError {
    fn from(error: crate::cgal_tetgen::CgalTetgenError) -> Self {
        match error {
            crate::cgal_tetgen::CgalTetgenError::Cancelled => Self::Cancelled,
            error => Self::Offset(error),
        }
    }
}

impl From<SolveError> for FitError {
    fn from(error: SolveError) -> Self {
        match error {
            SolveError::Cancelled => Self::Cancelled,
            error => Self::Solve(error),
        }
    }
}

fn describe_fitting(sources: usize) -> String {
    if sources == 0 {
        String::new()
    } else {
        format!(", enough for {sources} sources")
    }
}

fn describe_remedy(addresses_are_short: bool) -> &'static str {
    if addresses_are_short {
        "the address space of this process is limited (ulimit -v), and the matrix kernels reserve 1 GiB of it for each thread \
         and one more: raise that limit, or take fewer threads"
    } else {
        "lower the number of sources (`max_sources`, `source_ratio`) or of collocation points (`collocation_ratio`), use a \
         coarser mesh, or allow more (`memory`)"
    }
}

fn describe_errors(report: &CheckReport) -> String {
    let errors = report
        .errors()
        .map(|finding| format!("{}; {}", finding.message, finding.advice));
    errors.collect::<Vec<_>>().join("; also: ")
}

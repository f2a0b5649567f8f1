//! What can be chosen about a fit.

use super::{COLLOCATION_PER_FREE_SOURCE, FitError, FitReport};
use crate::memory;
use crate::mesh::SurfaceMesh;
use crate::solver::{Decomposition, DenseOptions, SchwarzOptions};

/// Where the sources are placed.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Placement {
    /// Along the vertex normals at a distance that follows the local spacing of the sources.
    Adaptive {
        /// Source offset over spacing; 1 to 1.5 is good.
        alpha: f64,
    },
    /// Evenly on an offset surface (the paper's choice; needs the feature `native`). It wraps the outside only, so
    /// cavities get their sources as by `Adaptive`.
    Offset {
        /// Source offset over the diagonal of the domain's bounding box, the paper's O-Distance; 0.02 to 0.2 is usual.
        distance: f64,
    },
    /// Evenly on a sphere about the centre of the bounding box; cavities get their sources as by `Adaptive`.
    Sphere {
        /// Radius over the diagonal of the domain's bounding box, the paper's R-Ratio; more than 0.5.
        radius: f64,
    },
}

impl Placement {
    /// Default `alpha` of [`Self::Adaptive`].
    pub const DEFAULT_ALPHA: f64 = 1.0;
    /// Default `distance` of [`Self::Offset`]: the paper's.
    pub const DEFAULT_DISTANCE: f64 = 0.1;
    /// Default `radius` of [`Self::Sphere`].
    pub const DEFAULT_RADIUS: f64 = 1.0;
}

/// How the least-squares system is solved, and where its sources are placed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum FitMethod {
    /// Iterations with a multilevel Schwarz preconditioner: time and memory are linear in the number of sources.
    Schwarz {
        /// Source offset over spacing, as in [`Placement::Adaptive`]: patches are small only for sources near the
        /// surface.
        alpha: f64,
        /// Settings of the solver.
        options: SchwarzOptions,
    },
    /// A dense decomposition: time grows with the cube of the number of sources and memory with the square (8 bytes per
    /// matrix entry by QR; six times as much by SVD at three collocation points per source).
    Dense {
        /// Where the sources are placed.
        placement: Placement,
        /// Settings of the decomposition.
        options: DenseOptions,
    },
}

impl FitMethod {
    /// The Schwarz solver, for callers that choose placement and solver independently.
    ///
    /// # Errors
    ///
    /// [`FitError::SchwarzNeedsNearSources`] for any placement but the adaptive one.
    pub fn schwarz(placement: Placement, options: SchwarzOptions) -> Result<Self, FitError> {
        match placement {
            Placement::Adaptive { alpha } => Ok(Self::Schwarz { alpha, options }),
            Placement::Offset { .. } | Placement::Sphere { .. } => Err(FitError::SchwarzNeedsNearSources),
        }
    }

    /// Where the sources are placed.
    pub fn placement(&self) -> Placement {
        match *self {
            Self::Schwarz { alpha, .. } => Placement::Adaptive { alpha },
            Self::Dense { placement, .. } => placement,
        }
    }

    /// Default of [`FitOptions::max_sources`]: what takes minutes on a desktop computer.
    pub fn default_max_sources(&self) -> usize {
        match self {
            Self::Schwarz { .. } => 2_000_000,
            Self::Dense { options, .. } => match options.decomposition {
                Decomposition::Qr => 5000,
                Decomposition::Svd => 3000,
            },
        }
    }
}

impl Default for FitMethod {
    fn default() -> Self {
        Self::Schwarz {
            alpha: Placement::DEFAULT_ALPHA,
            options: SchwarzOptions::default(),
        }
    }
}

/// Settings of a fit.
#[derive(Debug, Clone, PartialEq)]
pub struct FitOptions {
    /// How the system is solved, and where its sources are placed.
    pub method: FitMethod,
    /// Sources per boundary vertex, the paper's sRatio.
    pub source_ratio: f64,
    /// Collocation points per boundary vertex, the paper's cRatio. Up to 1 they are vertices; 3 with all vertices in use
    /// are the vertices and the centroids; with other ratios they are spread around the sources.
    pub collocation_ratio: f64,
    /// At most this many sources; a domain that asks for more gets fewer, and fewer collocation points in proportion.
    /// The coarser levels of the Schwarz solver, a tenth more, do not count, except towards the limit on refinement.
    pub max_sources: usize,
    /// At most this many sources per boundary vertex after refinement: it ends where that is not enough for the tolerance,
    /// as where the boundary map jumps. 50 000 sources are allowed in any case. Infinite for no such limit.
    pub max_source_ratio: f64,
    /// Whether the affine functions are in the basis; the paper's basis is without them.
    pub affine: bool,
    /// The boundary error (99 % of the area, as a fraction of the target's diagonal) to be reached.
    pub tolerance: f64,
    /// The largest boundary error to be reached, as a multiple of the tolerance: an image of which 99 % are right may lack a
    /// limb. Infinite for no such limit.
    pub max_error_ratio: f64,
    /// The largest boundary error to be reached as a multiple of the spacing of the image's vertices around
    /// ([`LocalError`](crate::fit::LocalError)): where a limb is squeezed, a small error may fold it. Infinite, the default,
    /// for no such limit.
    pub max_local_error: f64,
    /// Whether [`fit`](crate::fit::fit) adds sources where the error is too large for the tolerance. Needs the Schwarz
    /// solver.
    pub refine: bool,
    /// Whether [`fit`](crate::fit::fit) moves the sources, from where they are placed to where the residual is least. Needs a
    /// dense solver, at most [`MOST_FREE_SOURCES`](crate::fit::MOST_FREE_SOURCES) sources, and two collocation points for
    /// each or more ([`COLLOCATION_PER_FREE_SOURCE`](crate::fit::COLLOCATION_PER_FREE_SOURCE) are good). There are up to thirty
    /// rounds, and each takes some fifteen times as long as the fit with the same sources fixed: for maps that are to have few
    /// sources.
    pub free_sources: bool,
    /// Bytes that a fit may need by the estimate [`FitSize::bytes`](crate::fit::FitSize::bytes): more is refused, and
    /// refinement ends where it would need more. `None` for [`default_budget`](crate::memory::default_budget) at the
    /// start (less where the address space is limited), or no limit where the system does not say what is available.
    pub memory: Option<u64>,
    /// Held-out points that the boundary error is averaged over.
    pub held_out: usize,
    /// Seed of everything random (even samples, held-out points).
    pub seed: u64,
}

impl FitOptions {
    /// Adaptive placement with one source per vertex and three collocation points per source: the default.
    pub fn adaptive() -> Self {
        Self::with_method(FitMethod::default())
    }

    /// As [`Self::adaptive`], but by a dense decomposition, with at most 5000 sources.
    pub fn dense() -> Self {
        Self::with_method(FitMethod::Dense {
            placement: FitMethod::default().placement(),
            options: DenseOptions::default(),
        })
    }

    /// As [`Self::dense`], with free sources: few, and with more collocation points for each. Set
    /// [`max_sources`](Self::max_sources), unless the domain has few vertices.
    pub fn with_free_sources() -> Self {
        Self {
            collocation_ratio: COLLOCATION_PER_FREE_SOURCE,
            free_sources: true,
            ..Self::dense()
        }
    }

    /// The paper's settings (sections 4.1 to 4.5): an offset surface at 0.1 of the diagonal, sRatio 0.6, collocation at
    /// all vertices, singular value decomposition.
    pub fn paper() -> Self {
        Self {
            source_ratio: 0.6,
            collocation_ratio: 1.0,
            ..Self::with_method(FitMethod::Dense {
                placement: Placement::Offset {
                    distance: Placement::DEFAULT_DISTANCE,
                },
                options: DenseOptions {
                    decomposition: Decomposition::Svd,
                    ..DenseOptions::default()
                },
            })
        }
    }

    fn with_method(method: FitMethod) -> Self {
        Self {
            method,
            source_ratio: 1.0,
            collocation_ratio: 3.0,
            max_sources: method.default_max_sources(),
            max_source_ratio: 16.0,
            affine: true,
            tolerance: 1e-3,
            max_error_ratio: 20.0,
            max_local_error: f64::INFINITY,
            refine: true,
            free_sources: false,
            memory: None,
            held_out: 20_000,
            seed: 1,
        }
    }

    /// The options, with a limit from the available memory where none is given.
    pub(super) fn with_memory_limit(&self) -> Self {
        Self {
            memory: self.memory.or_else(memory::default_solver_budget),
            ..self.clone()
        }
    }

    /// Refuses settings out of range.
    pub(super) fn require_valid(&self) -> Result<(), FitError> {
        let require = |holds: bool, option, value, range| {
            if holds {
                Ok(())
            } else {
                Err(FitError::Option { option, value, range })
            }
        };
        let positive = |v: f64| v > 0.0 && v.is_finite();
        match self.method.placement() {
            Placement::Adaptive { alpha } => {
                require(
                    positive(alpha) && alpha <= MOST_ALPHA,
                    "alpha",
                    alpha,
                    "positive, and at most 5 (1 to 1.5 is good)",
                )?;
            }
            Placement::Offset { distance } => {
                require(positive(distance), "offset", distance, "positive (0.1 is usual)")?
            }
            Placement::Sphere { radius } => {
                require(
                    radius > 0.5 && radius.is_finite(),
                    "radius",
                    radius,
                    "more than 0.5, to contain the domain",
                )?;
            }
        }
        let (sources, collocation) = (self.source_ratio, self.collocation_ratio);
        require(
            positive(sources),
            "source_ratio",
            sources,
            "positive (0.6 in the paper)",
        )?;
        require(
            positive(collocation) && collocation >= sources,
            "collocation_ratio",
            collocation,
            "at least `source_ratio`, so that the system is not underdetermined",
        )?;
        require(
            !self.free_sources || collocation >= 2.0 * sources,
            "collocation_ratio",
            collocation,
            "at least twice `source_ratio` with free sources, whose positions are unknowns, too",
        )?;
        require(self.max_sources > 0, "max_sources", 0.0, "positive")?;
        let most = self.max_source_ratio;
        require(most > 0.0, "max_source_ratio", most, "positive (16 is usual)")?;
        let adaptive = matches!(self.method.placement(), Placement::Adaptive { .. });
        require(
            sources <= 1.0 || !adaptive,
            "source_ratio",
            sources,
            "at most 1 with the adaptive placement, which has one source per vertex; refine the mesh for more",
        )?;
        if let FitMethod::Dense { options, .. } = self.method {
            require(
                (0.0..1.0).contains(&options.truncation),
                "truncation",
                options.truncation,
                "from 0 to below 1 (1e-10 is usual)",
            )?;
        }
        let tolerance = self.tolerance;
        require(
            positive(tolerance),
            "tolerance",
            tolerance,
            "positive (1e-3 of the target's diagonal is usual)",
        )?;
        let most = self.max_error_ratio;
        require(most >= 1.0, "max_error_ratio", most, "at least 1 (20 is usual)")?;
        let most = self.max_local_error;
        require(
            most > 0.0,
            "max_local_error",
            most,
            "positive (1 is as far as the next vertex of the image)",
        )?;
        let held_out = self.held_out;
        require(
            (1..=MOST_HELD_OUT).contains(&held_out),
            "held_out",
            held_out as f64,
            "from 1 to 10 million",
        )
    }

    /// Whether the errors are within the tolerance on 99 % of the area, and everywhere within its multiple and that of the
    /// spacing of the image.
    pub fn is_met_by(&self, report: &FitReport) -> bool {
        self.criterion(report) <= self.tolerance
    }

    /// What is compared with the tolerance, and what refinement lowers.
    pub(super) fn criterion(&self, report: &FitReport) -> f64 {
        let error = &report.boundary_error;
        let local = report.local_error.map_or(0.0, |local| local.max / self.max_local_error);
        error
            .p99
            .max(error.max / self.max_error_ratio)
            .max(local * self.tolerance)
    }

    /// At most this many sources after refinement, in a domain with this many vertices.
    pub(super) fn most_refined_sources(&self, vertices: usize) -> usize {
        let most = (self.max_source_ratio * vertices as f64).max(ALWAYS_ALLOWED as f64) as usize;
        most.min(self.max_sources)
    }

    /// Root mean square residual at which iterations end, as a fraction of the target's diagonal: far below the
    /// tolerance.
    pub(super) fn residual_tolerance(&self) -> f64 {
        0.02 * self.tolerance
    }
}

impl Default for FitOptions {
    fn default() -> Self {
        Self::adaptive()
    }
}

/// Limit on `alpha`: sources that are several times as far as they are apart are nearly dependent. Fits of a cow met
/// the tolerance up to 2, of a cat up to 4; at 7 their errors were 26 % and 9 % of the diagonal, and they took 19 and 31
/// times as long as at 1.2.
const MOST_ALPHA: f64 = 5.0;

/// Sources that refinement may use in any domain, however few vertices it has: they are solved for in some
/// five seconds of processor time. A polycube of few vertices needs more than 20 000 for a tolerance of 1e-3.
const ALWAYS_ALLOWED: usize = 50_000;

/// Limit on [`FitOptions::held_out`].
const MOST_HELD_OUT: usize = 10_000_000;

/// How many points a fit uses.
pub(super) struct PointCounts {
    pub sources: usize,
    pub collocation: usize,
    /// Number of sources without the limit.
    unlimited_sources: usize,
}

impl PointCounts {
    /// What the options ask for on this domain, as far as the limit on the sources allows.
    pub fn of(domain: &SurfaceMesh, options: &FitOptions) -> Self {
        let vertices = domain.vertices().len() as f64;
        let unlimited_sources = ((options.source_ratio * vertices).round() as usize).max(1);
        let sources = unlimited_sources.min(options.max_sources);
        let ratio = options.collocation_ratio / options.source_ratio;
        let collocation = if sources < unlimited_sources {
            ratio * sources as f64
        } else {
            options.collocation_ratio * vertices
        };
        Self {
            sources,
            collocation: collocation.round() as usize,
            unlimited_sources,
        }
    }

    /// Whether the limit has reduced the number of sources.
    pub fn is_limited(&self) -> bool {
        self.sources < self.unlimited_sources
    }

    /// A warning when the limit has reduced the number of sources.
    pub fn warning(&self) -> Option<String> {
        let (sources, asked) = (self.sources, self.unlimited_sources);
        self.is_limited().then(|| {
            format!(
                "the domain's vertices call for {asked} sources; {sources} are used, as many as are allowed. Detail finer \
                 than their spacing is lost: see the boundary error. `max_sources` raises the limit"
            )
        })
    }
}

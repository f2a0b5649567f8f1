//! What can be chosen about a fit.

use super::FitError;
use crate::mesh::SurfaceMesh;
use crate::solver::{Decomposition, DenseOptions, SchwarzOptions};

/// Where the sources stand.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Placement {
    /// Along the vertex normals at a distance that follows the local spacing of the sources.
    Adaptive {
        /// Distance over spacing; 1 to 1.5 is good.
        alpha: f64,
    },
    /// Evenly on an offset surface (the paper's choice; needs the feature `native`). It wraps the outside only, so
    /// cavities get their sources as by `Adaptive`.
    Offset {
        /// Distance over the diagonal of the domain's bounding box, the paper's O-Distance; 0.02 to 0.2 is usual.
        distance: f64,
    },
    /// Evenly on a sphere about the centre of the bounding box; cavities get their sources as by `Adaptive`.
    Sphere {
        /// Radius over the diagonal of the domain's bounding box, the paper's R-Ratio; more than 0.5.
        radius: f64,
    },
}

/// How the least-squares system is solved.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Solver {
    /// Iterations preconditioned by local solves on several levels: time and memory grow with the number of sources.
    /// Needs sources near the surface, that is, the adaptive placement.
    Schwarz(SchwarzOptions),
    /// A dense decomposition: time grows with the cube of the number of sources and memory (24 bytes per entry) with
    /// the square.
    Dense(DenseOptions),
}

/// Settings of a fit.
#[derive(Debug, Clone, PartialEq)]
pub struct FitOptions {
    /// Where the sources stand.
    pub placement: Placement,
    /// Sources per boundary vertex, the paper's sRatio.
    pub source_ratio: f64,
    /// Collocation points per boundary vertex, the paper's cRatio. Up to 1 they are vertices; 3 with all vertices in use
    /// are the vertices and the centroids; other numbers are spread around the sources.
    pub collocation_ratio: f64,
    /// At most this many sources; a domain that asks for more gets fewer, and fewer collocation points in proportion.
    /// The coarser levels of the Schwarz solver, a tenth more, do not count.
    pub max_sources: usize,
    /// Whether the affine functions are in the basis; without them it is the paper's.
    pub affine: bool,
    /// How the system is solved.
    pub solver: Solver,
    /// The boundary error (99 % of the area, as a fraction of the target's diagonal) to be reached.
    pub tolerance: f64,
    /// Whether [`fit`](crate::fit::fit) adds sources where the error is too large for the tolerance. Needs the Schwarz solver.
    pub refine: bool,
    /// Bytes that a fit may need, estimated before they are taken ([`Workload::bytes`](crate::fit::Workload::bytes)): more is refused, and a round of
    /// refinement that needs more ends it. `None` for nine tenths of what is available at the start, where the system
    /// says so, else no limit.
    pub memory: Option<u64>,
    /// Held-out points that the boundary error is averaged over.
    pub held_out: usize,
    /// Seed of everything random (even samples, held-out points).
    pub seed: u64,
}

impl FitOptions {
    /// Adaptive placement with one source per vertex, overdetermined by three: the default.
    pub fn adaptive() -> Self {
        Self {
            placement: Placement::Adaptive { alpha: 1.0 },
            source_ratio: 1.0,
            collocation_ratio: 3.0,
            max_sources: 2_000_000,
            affine: true,
            solver: Solver::Schwarz(SchwarzOptions::default()),
            tolerance: 1e-3,
            refine: true,
            memory: None,
            held_out: 20_000,
            seed: 1,
        }
    }

    /// As [`Self::adaptive`] by a dense decomposition, with at most 5000 sources.
    pub fn dense() -> Self {
        Self {
            max_sources: 5000,
            solver: Solver::Dense(DenseOptions::default()),
            ..Self::adaptive()
        }
    }

    /// The paper's settings (sections 4.1 to 4.5): an offset surface at 0.1 of the size, sRatio 0.6, collocation at all
    /// vertices, singular value decomposition.
    pub fn paper() -> Self {
        Self {
            placement: Placement::Offset { distance: 0.1 },
            source_ratio: 0.6,
            collocation_ratio: 1.0,
            max_sources: 3000,
            solver: Solver::Dense(DenseOptions {
                decomposition: Decomposition::Svd,
                ..DenseOptions::default()
            }),
            ..Self::adaptive()
        }
    }
}

impl Default for FitOptions {
    fn default() -> Self {
        Self::adaptive()
    }
}

/// Held-out points that may be asked for.
const MOST_HELD_OUT: usize = 10_000_000;

pub(super) fn require_valid(options: &FitOptions) -> Result<(), FitError> {
    let require = |holds: bool, option, value, range| {
        if holds {
            Ok(())
        } else {
            Err(FitError::Option { option, value, range })
        }
    };
    let positive = |v: f64| v > 0.0 && v.is_finite();
    match options.placement {
        Placement::Adaptive { alpha } => require(positive(alpha), "alpha", alpha, "positive (1 to 1.5 is good)")?,
        Placement::Offset { distance } => require(positive(distance), "offset", distance, "positive (0.1 is usual)")?,
        Placement::Sphere { radius } => {
            require(
                radius > 0.5 && radius.is_finite(),
                "radius",
                radius,
                "more than 0.5, to contain the domain",
            )?;
        }
    }
    let (sources, collocation) = (options.source_ratio, options.collocation_ratio);
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
    require(options.max_sources > 0, "max_sources", 0.0, "positive")?;
    let adaptive = matches!(options.placement, Placement::Adaptive { .. });
    require(
        sources <= 1.0 || !adaptive,
        "source_ratio",
        sources,
        "at most 1 with the adaptive placement, which has one source per vertex; refine the mesh for more",
    )?;
    match options.solver {
        Solver::Dense(DenseOptions { truncation, .. }) => require(
            (0.0..1.0).contains(&truncation),
            "truncation",
            truncation,
            "from 0 to below 1 (1e-10 is usual)",
        )?,
        Solver::Schwarz(_) if !adaptive => return Err(FitError::SchwarzNeedsNearSources),
        Solver::Schwarz(_) => {}
    }
    let tolerance = options.tolerance;
    require(
        positive(tolerance),
        "tolerance",
        tolerance,
        "positive (1e-3 of the target's diagonal is usual)",
    )?;
    let held_out = options.held_out;
    require(
        (1..=MOST_HELD_OUT).contains(&held_out),
        "held_out",
        held_out as f64,
        "from 1 to 10 million",
    )
}

/// How many points a fit uses.
pub(super) struct Size {
    pub sources: usize,
    pub collocation: usize,
    /// Sources that there would be without a limit.
    asked: usize,
}

impl Size {
    /// What the options ask of this domain, cut to what they allow.
    pub fn of(domain: &SurfaceMesh, options: &FitOptions) -> Self {
        let vertices = domain.vertices().len() as f64;
        let asked = ((options.source_ratio * vertices).round() as usize).max(1);
        let sources = asked.min(options.max_sources);
        let ratio = options.collocation_ratio / options.source_ratio;
        let collocation = if sources < asked {
            ratio * sources as f64
        } else {
            options.collocation_ratio * vertices
        };
        Self {
            sources,
            collocation: collocation.round() as usize,
            asked,
        }
    }

    /// Whether all vertices are in use, none left out for the sake of time.
    pub fn is_whole(&self) -> bool {
        self.sources == self.asked
    }

    /// A remark when the limit on the sources took some away.
    pub fn remark(&self) -> Option<String> {
        let Self { sources, asked, .. } = self;
        (!self.is_whole()).then(|| {
            format!(
                "the domain's vertices call for {asked} sources; {sources} are used, as many as are allowed. Detail finer \
                 than their spacing is lost: see the boundary error. `max_sources` raises the limit"
            )
        })
    }
}

use super::Placement;
use crate::boundary_map::BoundaryMap;
use crate::map::HarmonicMap;
use crate::solver::SchwarzStop;

/// Distances `|f(p) − f'(p)|` at held-out boundary points, as fractions of the target's diagonal.
///
/// Since `f − f_exact` is harmonic, its largest value anywhere inside is at most its largest on the boundary (maximum
/// principle): this error bounds that of the whole map against the exact harmonic one, as far as the points are dense.
#[derive(Debug, Clone, Copy, PartialEq, Default, serde::Serialize, serde::Deserialize)]
pub struct BoundaryError {
    /// Root mean square over the area.
    pub rms: f64,
    /// 99 % of the area is below.
    pub p99: f64,
    /// The largest, over more points than the average (at least one in each triangle, up to 100 000).
    pub max: f64,
}

/// Wall time by phase, in seconds.
#[derive(Debug, Clone, Copy, PartialEq, Default, serde::Serialize, serde::Deserialize)]
pub struct Seconds {
    /// Everything.
    pub total: f64,
    /// Checking the domain and placing points.
    pub sampling: f64,
    /// Assembling and decomposing the matrix.
    pub factor: f64,
    /// Applying the decomposition to the boundary data.
    pub solve: f64,
    /// Measuring the boundary error.
    pub check: f64,
}

/// What a fit did, and how well it meets its boundary map.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct FitReport {
    /// Boundary vertices of the domain.
    pub vertices: usize,
    /// Boundary triangles of the domain.
    pub faces: usize,
    /// Sources placed.
    pub sources: usize,
    /// Collocation points.
    pub collocation: usize,
    /// `"schwarz"`, `"dense-qr"` or `"dense-svd"`.
    pub method: String,
    /// Where the sources stand.
    pub placement: Placement,
    /// Whether the affine functions are in the basis.
    pub affine: bool,
    /// Iterations of the solver; 1 for a direct one.
    pub iterations: usize,
    /// Rounds of refinement, each with finer sources where the error was too large for the tolerance.
    #[serde(default)]
    pub refinements: usize,
    /// Why no more sources were added; `None` where no tolerance was aimed at.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub refinement_end: Option<RefinementEnd>,
    /// Why an iterative solver ended.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stop: Option<SchwarzStop>,
    /// Singular values or pivots kept by a dense solver, of `sources` plus 4.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rank: Option<usize>,
    /// Condition number of a dense solver's scaled matrix before truncation; `None` when it is singular to working
    /// precision.
    pub condition: Option<f64>,
    /// The number that counts.
    pub boundary_error: BoundaryError,
    /// The paper's C-Error (section 4.5), `Σ |f(p) − f'(p)|²` over the collocation points, in units of the target's
    /// diagonal squared. It is small where the fit was made and says little elsewhere.
    pub c_error: f64,
    /// Root mean square misfit at the collocation points, as a fraction of the target's diagonal.
    pub residual_rms: f64,
    /// Bytes that the whole run takes at its peak, by the estimate that `FitOptions::memory` is held against.
    #[serde(default)]
    pub memory_estimate: u64,
    /// Wall time; `None` in a map file, so that the same fit gives the same bytes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub seconds: Option<Seconds>,
    /// What was repaired or left out.
    pub warnings: Vec<String>,
}

/// Why no more sources were added.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RefinementEnd {
    /// The tolerance is met.
    Tolerance,
    /// Refinement was not asked for.
    Off,
    /// The solver is dense, or the sources stand far from the surface: neither can be refined.
    Fixed,
    /// The limit on the sources.
    MaxSources,
    /// The limit on the memory.
    Memory,
    /// Several rounds did not lower the error.
    InVain,
    /// No finer source finds a place outside the domain.
    NoRoom,
}

/// A map and what is known about it.
#[derive(Debug, Clone)]
pub struct Fit {
    /// The harmonic map, in model units.
    pub map: HarmonicMap,
    /// The boundary map that was fitted, its domain with the faces turned outward.
    pub boundary: BoundaryMap,
    /// How it was made and how good it is.
    pub report: FitReport,
}

/// The steps of a fit, for showing progress.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Phase {
    /// Checking the domain.
    Checking,
    /// Placing sources and collocation points.
    Sampling,
    /// Decomposing a dense matrix of this many rows and columns.
    Decomposing {
        /// Collocation points.
        rows: usize,
        /// Unknowns.
        columns: usize,
    },
    /// Factoring local problems of a level.
    Factoring {
        /// How many are done.
        done: usize,
        /// How many there are.
        of: usize,
    },
    /// Applying a dense decomposition.
    Solving,
    /// Iterating.
    Iterating {
        /// Iterations made.
        iteration: usize,
        /// Root mean square residual, as a fraction of the target's diagonal.
        residual: f64,
    },
    /// Measuring the boundary error.
    Measuring,
    /// Adding sources where the error is too large.
    Refining {
        /// Which round, from 1.
        round: usize,
        /// The boundary error so far (99 %).
        error: f64,
        /// Sources so far.
        sources: usize,
    },
}

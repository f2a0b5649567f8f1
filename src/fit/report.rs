use super::held_out::HeldOutErrors;
use super::system::{System, SystemSolution};
use super::{FitOptions, FitTimings, FreeSourcesReport, Placement};
use crate::boundary_map::BoundaryMap;
use crate::map::HarmonicMap;
use crate::mesh::SurfaceMesh;
use crate::solver::SchwarzStop;

/// Distances `|f(p) − f'(p)|` at held-out boundary points, as fractions of the target's diagonal.
///
/// Since `f − f_exact` is harmonic, its largest value anywhere inside is at most its largest on the boundary (maximum
/// principle): this error bounds that of the whole map against the exact harmonic one, as far as the points are dense.
#[derive(Debug, Clone, Copy, PartialEq, Default, serde::Serialize, serde::Deserialize)]
pub struct BoundaryError {
    /// Root mean square over the area.
    pub rms: f64,
    /// 99th percentile over the area.
    pub p99: f64,
    /// The largest, over these points and one in each triangle (of up to 100 000 evenly chosen triangles).
    pub max: f64,
}

/// Boundary errors as multiples of the spacing of the image's vertices around (the mean length of the image's edges,
/// linear between vertices).
///
/// Where it is above 1, the map misses its place by more than a vertex: what is that fine in the image, such as a
/// squeezed limb, is lost or folded, however small the error is beside the target's diagonal.
#[derive(Debug, Clone, Copy, PartialEq, Default, serde::Serialize, serde::Deserialize)]
pub struct LocalError {
    /// 99th percentile over the area.
    pub p99: f64,
    /// The largest, over the points that [`BoundaryError::max`] is taken over.
    pub max: f64,
}

/// What a fit did, and how well it meets its boundary map.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct FitReport {
    /// Boundary vertices of the domain.
    pub vertices: usize,
    /// Boundary triangles of the domain.
    pub faces: usize,
    /// Sources of the map.
    pub sources: usize,
    /// Collocation points.
    pub collocation: usize,
    /// `"schwarz"`, `"dense-qr"` or `"dense-svd"`.
    pub method: String,
    /// Where the sources are placed.
    pub placement: Placement,
    /// Whether the affine functions are in the basis.
    pub affine: bool,
    /// Iterations of the solver; 1 for a direct one.
    pub iterations: usize,
    /// Rounds of refinement, each with finer sources where the error was too large for the tolerance.
    #[serde(default)]
    pub refinements: usize,
    /// Why no more sources were added; `None` for a solve that does not refine.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub refinement_end: Option<RefinementEnd>,
    /// What became of free sources, where they were asked for.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub free_sources: Option<FreeSourcesReport>,
    /// Why an iterative solver ended.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stop: Option<SchwarzStop>,
    /// Singular values or pivots kept by a dense solver, of `sources` (plus 4 with `affine`).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rank: Option<usize>,
    /// Condition number of a dense solver's scaled matrix before truncation; `None` when it is singular to working
    /// precision.
    pub condition: Option<f64>,
    /// How well the map meets its boundary map.
    pub boundary_error: BoundaryError,
    /// The same beside the local size of the image; `None` for boundary values that are no positions.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub local_error: Option<LocalError>,
    /// The paper's C-Error (section 4.5), `Σ |f(p) − f'(p)|²` over the collocation points, in units of the target's
    /// diagonal squared. It is small whenever the system is solved, and says little about the boundary between these
    /// points.
    pub c_error: f64,
    /// Root mean square misfit at the collocation points, as a fraction of the target's diagonal.
    pub residual_rms: f64,
    /// Estimated peak memory of the whole run, in bytes: what `FitOptions::memory` limits.
    #[serde(default)]
    pub memory_estimate: u64,
    /// Wall time; `None` in a map file, so that the same fit gives the same bytes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub seconds: Option<FitTimings>,
    /// What was repaired or left out.
    pub warnings: Vec<String>,
}

impl FitReport {
    /// The report of the `k`th map of a solution, without times and warnings.
    pub(super) fn new(
        domain: &SurfaceMesh,
        options: &FitOptions,
        system: &System,
        (solution, k): (&SystemSolution, usize),
        (boundary_error, local_error): (BoundaryError, Option<LocalError>),
    ) -> Self {
        let (size, residual) = (&system.size, &solution.residuals[k]);
        let dense = system.rank_and_condition();
        Self {
            vertices: domain.vertices().len(),
            faces: domain.triangles().len(),
            sources: system.sources_of(solution).len(),
            collocation: size.collocation,
            method: system.method().into(),
            placement: options.method.placement(),
            affine: options.affine,
            iterations: solution.iterations,
            refinements: size.refinements,
            refinement_end: None,
            free_sources: None,
            stop: solution.stop,
            rank: dense.map(|(rank, _)| rank),
            condition: dense.map(|(_, condition)| condition).filter(|c| c.is_finite()),
            boundary_error,
            local_error,
            c_error: residual.sum_of_squares,
            residual_rms: residual.rms,
            memory_estimate: size.bytes(),
            seconds: None,
            warnings: Vec::new(),
        }
    }
}

/// Why no more sources were added.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RefinementEnd {
    /// The tolerance is met.
    Tolerance,
    /// Refinement was not asked for.
    Off,
    /// The solver is dense and cannot be refined.
    Fixed,
    /// The limit on the number of sources is reached.
    MaxSources,
    /// The limit on the number of sources per boundary vertex is reached.
    MaxSourceRatio,
    /// The limit on memory is reached.
    Memory,
    /// Several rounds did not lower the error.
    InVain,
    /// No finer source finds a place outside the domain.
    NoRoom,
    /// The progress callback asked for the best map so far
    /// ([`ProgressControl::Conclude`](crate::progress::ProgressControl::Conclude)).
    Concluded,
}

/// A map with its report, which lacks the warnings and timings of the whole fit.
#[derive(Clone)]
pub(super) struct MeasuredMap {
    pub map: HarmonicMap,
    pub report: FitReport,
    pub held_out: HeldOutErrors,
    /// For solving and measuring.
    pub timings: FitTimings,
}

/// A map and what is known about it.
#[derive(Debug, Clone)]
pub struct Fit {
    /// The harmonic map, in model units.
    pub map: HarmonicMap,
    /// The boundary map that was fitted, its domain with the faces oriented outward.
    pub boundary: BoundaryMap,
    /// How it was made and how good it is.
    pub report: FitReport,
    pub(super) held_out: HeldOutErrors,
}

//! The pipeline on one screen (the algorithm of section 3.3): boundary map → samples → system → map.
//!
//! What depends on the domain alone is done once, in [`DomainFactor::new`]; every boundary map of that domain then costs
//! one [`DomainFactor::solve`] (section 4.6).

use std::time::Instant;

use crate::boundary_map::{BoundaryMap, BoundaryMapError};
use crate::check::{self, CheckReport};
use crate::geometry::{QueryError, SurfaceQuery};
use crate::map::{HarmonicMap, VolumeMap};
use crate::mesh::topology::Topology;
use crate::mesh::{SurfaceMesh, SurfacePoint};
use crate::sampling::{self, Anchors, Collocation};
use crate::solver::{Coefficients, CollocationSystem, DenseFactor, DenseOptions, Method, SolveError};
use crate::{Point, Vector};

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

/// Settings of a fit.
#[derive(Debug, Clone, PartialEq)]
pub struct FitOptions {
    /// Where the sources stand.
    pub placement: Placement,
    /// Sources per boundary vertex, the paper's sRatio.
    pub source_ratio: f64,
    /// Collocation points per boundary vertex, the paper's cRatio. Up to 1 they are vertices; at 3 and more, with all
    /// vertices in use, they are the vertices and the centroids; otherwise as many around each source.
    pub collocation_ratio: f64,
    /// At most this many sources; a domain that asks for more gets fewer, and fewer collocation points in proportion.
    /// Time grows with the cube of it and memory (24 bytes per entry) with the square.
    pub max_sources: usize,
    /// Whether the affine functions are in the basis; without them it is the paper's.
    pub affine: bool,
    /// How the dense system is solved.
    pub solver: DenseOptions,
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
            max_sources: 5000,
            affine: true,
            solver: DenseOptions::default(),
            held_out: 20_000,
            seed: 1,
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
            solver: DenseOptions {
                method: Method::Svd,
                ..DenseOptions::default()
            },
            ..Self::adaptive()
        }
    }
}

impl Default for FitOptions {
    fn default() -> Self {
        Self::adaptive()
    }
}

/// Why no map came out.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum FitError {
    /// The domain does not bound a solid.
    #[error("the domain does not bound a solid: {}", describe_errors(.0))]
    DefectiveDomain(Box<CheckReport>),
    /// A setting is out of range.
    #[error("{option} is {value}, but must be {range}")]
    Option {
        /// The field of [`FitOptions`].
        option: &'static str,
        /// Its value.
        value: f64,
        /// What is allowed.
        range: &'static str,
    },
    /// No source found a place outside the domain.
    #[error("no source found a place outside the domain; its surface may be folded onto itself everywhere")]
    NoSources,
    /// Sources on an offset surface without the C++ bridge.
    #[error("an offset surface needs CGAL; build with the feature `native`, or use the adaptive placement")]
    NeedsNative,
    /// The offset surface could not be built.
    #[cfg(feature = "native")]
    #[error("cannot build the offset surface for the sources: {0}")]
    Offset(#[from] crate::native::NativeError),
    /// The domain's surface cannot be asked for distances.
    #[error(transparent)]
    Query(#[from] QueryError),
    /// The boundary map is of another domain than the factorisation.
    #[error("the boundary map's domain is not the one that was factored")]
    OtherDomain,
    /// The boundary map is unusable.
    #[error(transparent)]
    BoundaryMap(#[from] BoundaryMapError),
    /// The system has no usable solution.
    #[error("cannot solve for the coefficients: {0}")]
    Solve(#[from] SolveError),
}

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
    /// `"dense-qr"` or `"dense-svd"`.
    pub method: String,
    /// Where the sources stand.
    pub placement: Placement,
    /// Whether the affine functions are in the basis.
    pub affine: bool,
    /// Iterations of the solver; 1 for a direct one.
    pub iterations: usize,
    /// Singular values or pivots kept, of `sources` plus 4.
    pub rank: usize,
    /// Condition number of the scaled matrix before truncation; `None` when it is singular to working precision.
    pub condition: Option<f64>,
    /// The number that counts.
    pub boundary_error: BoundaryError,
    /// The paper's C-Error (section 4.5), `Σ |f(p) − f'(p)|²` over the collocation points, in units of the target's
    /// diagonal squared. It is small where the fit was made and says little elsewhere.
    pub c_error: f64,
    /// Root mean square misfit at the collocation points, as a fraction of the target's diagonal.
    pub residual_rms: f64,
    /// Wall time; `None` in a map file, so that the same fit gives the same bytes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub seconds: Option<Seconds>,
    /// What was mended or left out.
    pub warnings: Vec<String>,
}

/// A map and what is known about it.
#[derive(Debug, Clone)]
pub struct Fit {
    /// The harmonic map, in model units.
    pub map: HarmonicMap,
    /// How it was made and how good it is.
    pub report: FitReport,
}

/// The steps of a fit, for showing progress.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Phase {
    /// Checking the domain and placing sources and collocation points.
    Sampling,
    /// Decomposing a matrix of this many rows and columns.
    Factoring {
        /// Collocation points.
        rows: usize,
        /// Unknowns.
        columns: usize,
    },
    /// Applying the decomposition.
    Solving,
    /// Measuring the boundary error.
    Measuring,
}

/// Fits the harmonic map that carries the boundary of the domain as `boundary` does.
///
/// Costs `2mn²` flops and `8mn` bytes for `m` collocation points and `n` sources (QR).
///
/// # Errors
///
/// When the domain does not bound a solid, a setting is out of range, or the system cannot be solved.
pub fn fit(boundary: &BoundaryMap, options: &FitOptions, progress: &dyn Fn(Phase)) -> Result<Fit, FitError> {
    DomainFactor::new(boundary.domain(), options, progress)?.solve(boundary, progress)
}

/// A domain made ready: points placed and the matrix decomposed. Answers any number of boundary maps.
pub struct DomainFactor {
    domain: SurfaceMesh,
    options: FitOptions,
    frame: Frame,
    /// In model units.
    sources: Vec<Point>,
    collocation: Collocation,
    factor: DenseFactor,
    warnings: Vec<String>,
    seconds: Seconds,
}

impl DomainFactor {
    /// Checks and mends the domain, places sources and collocation points, and decomposes the matrix.
    ///
    /// # Errors
    ///
    /// As [`fit`].
    pub fn new(domain: &SurfaceMesh, options: &FitOptions, progress: &dyn Fn(Phase)) -> Result<Self, FitError> {
        let start = Instant::now();
        progress(Phase::Sampling);
        require_valid(options)?;
        let (domain, mut warnings) = checked(domain)?;
        let frame = Frame::of(domain.vertices());
        let size = Size::of(&domain, options, &mut warnings);
        let anchors = Anchors::choose(&domain, size.sources);
        let sources = place_sources(&domain, &anchors, options, &mut warnings)?;
        let collocation = place_collocation(&domain, &anchors, &size, options);
        let sampled = start.elapsed().as_secs_f64();

        let points = collocation
            .points
            .iter()
            .map(|p| frame.to_unit(&p.position(&domain, domain.vertices())));
        let points: Vec<Point> = points.collect();
        let mean_area = collocation.areas.iter().sum::<f64>() / points.len().max(1) as f64;
        let system = CollocationSystem {
            collocation: &points,
            row_weights: &collocation
                .areas
                .iter()
                .map(|a| (a / mean_area).sqrt())
                .collect::<Vec<_>>(),
            sources: &sources.iter().map(|q| frame.to_unit(q)).collect::<Vec<_>>(),
            affine: options.affine,
        };
        progress(Phase::Factoring {
            rows: points.len(),
            columns: system.unknowns(),
        });
        let factor = DenseFactor::new(&system, &options.solver)?;
        let seconds = Seconds {
            sampling: sampled,
            factor: start.elapsed().as_secs_f64() - sampled,
            ..Seconds::default()
        };
        Ok(Self {
            domain,
            options: options.clone(),
            frame,
            sources,
            collocation,
            factor,
            warnings,
            seconds,
        })
    }

    /// The map for one boundary map of this domain, measured at held-out points. The report's `sampling` and `factor`
    /// times are those of the factorisation, also when it is used again.
    ///
    /// # Errors
    ///
    /// [`FitError::OtherDomain`] when the boundary map is not one of the domain that was factored.
    pub fn solve(&self, boundary: &BoundaryMap, progress: &dyn Fn(Phase)) -> Result<Fit, FitError> {
        let start = Instant::now();
        progress(Phase::Solving);
        if boundary.domain().vertices() != self.domain.vertices() {
            return Err(FitError::OtherDomain);
        }
        let boundary = BoundaryMap::new(self.domain.clone(), boundary.image().to_vec())?;
        let target = Frame::of(boundary.image());
        // With the constant in the basis the shift changes nothing but rounding; without it, it would change the fit.
        let origin = if self.options.affine {
            target.centre
        } else {
            Point::origin()
        };
        let data: Vec<[f64; 3]> = boundary
            .evaluate(&self.collocation.points)
            .iter()
            .map(|p| (p - origin).into())
            .collect();
        let unit = self.factor.solve(&data)?;
        let map = HarmonicMap::new(self.sources.clone(), self.frame.to_model(unit, origin))
            .expect("one coefficient row per source");
        let solved = start.elapsed().as_secs_f64();

        progress(Phase::Measuring);
        let (boundary_error, residual) = self.measure(&map, &boundary, target.diagonal);
        let checked = start.elapsed().as_secs_f64() - solved;
        let seconds = Seconds {
            solve: solved,
            check: checked,
            ..self.seconds
        };
        let total = seconds.sampling + seconds.factor + solved + checked;
        let report = self.report(boundary_error, &residual, Seconds { total, ..seconds });
        Ok(Fit { map, report })
    }

    /// Number of singular values or pivots kept in the decomposition.
    pub fn rank(&self) -> usize {
        self.factor.rank()
    }

    fn measure(&self, map: &HarmonicMap, boundary: &BoundaryMap, diagonal: f64) -> (BoundaryError, Vec<f64>) {
        let error_at = |points: &[SurfacePoint]| -> Vec<f64> {
            let images = map.evaluate(&boundary.positions(points));
            images
                .iter()
                .zip(boundary.evaluate(points))
                .map(|(f, exact)| (f - exact).norm() / diagonal)
                .collect()
        };
        let held_out = sampling::held_out(&self.domain, self.options.held_out, 100_000, self.options.seed);
        let errors = error_at(&held_out);
        let max = errors.iter().copied().fold(0.0, f64::max);
        let mut averaged = errors;
        averaged.truncate(self.options.held_out);
        (
            BoundaryError {
                rms: rms(&averaged),
                p99: quantile(averaged, 0.99),
                max,
            },
            error_at(&self.collocation.points),
        )
    }

    fn report(&self, boundary_error: BoundaryError, residual: &[f64], seconds: Seconds) -> FitReport {
        FitReport {
            vertices: self.domain.vertices().len(),
            faces: self.domain.triangles().len(),
            sources: self.sources.len(),
            collocation: self.collocation.points.len(),
            method: match self.options.solver.method {
                Method::Qr => "dense-qr".into(),
                Method::Svd => "dense-svd".into(),
            },
            placement: self.options.placement,
            affine: self.options.affine,
            iterations: 1,
            rank: self.factor.rank(),
            condition: Some(self.factor.condition()).filter(|c| c.is_finite()),
            boundary_error,
            c_error: residual.iter().map(|r| r * r).sum(),
            residual_rms: rms(residual),
            seconds: Some(seconds),
            warnings: self.warnings.clone(),
        }
    }
}

/// How many points a fit uses.
struct Size {
    sources: usize,
    collocation: usize,
    /// Whether all vertices are in use, none left out for the sake of time.
    whole: bool,
}

impl Size {
    fn of(domain: &SurfaceMesh, options: &FitOptions, warnings: &mut Vec<String>) -> Self {
        let vertices = domain.vertices().len() as f64;
        let asked = ((options.source_ratio * vertices).round() as usize).max(1);
        let sources = asked.min(options.max_sources);
        if sources < asked {
            warnings.push(format!(
                "{vertices} vertices call for {asked} sources; {sources} are used, as many as the dense solver is allowed. \
                 Detail finer than their spacing is lost: see the boundary error. --max-sources raises the limit"
            ));
        }
        let ratio = options.collocation_ratio / options.source_ratio;
        let collocation = if sources < asked {
            ratio * sources as f64
        } else {
            options.collocation_ratio * vertices
        };
        Self {
            sources,
            collocation: collocation.round() as usize,
            whole: sources == asked,
        }
    }
}

/// The frame in which the system is solved: the box centre at the origin, the diagonal 1.
struct Frame {
    centre: Point,
    diagonal: f64,
}

impl Frame {
    fn of(points: &[Point]) -> Self {
        let low = points
            .iter()
            .fold(Vector::repeat(f64::INFINITY), |low, p| low.inf(&p.coords));
        let high = points
            .iter()
            .fold(Vector::repeat(f64::NEG_INFINITY), |high, p| high.sup(&p.coords));
        Self {
            centre: Point::from((low + high) / 2.0),
            diagonal: (high - low).norm(),
        }
    }

    fn to_unit(&self, p: &Point) -> Point {
        Point::from((p - self.centre) / self.diagonal)
    }

    /// Coefficients for points in model units: `1/|x'| = diagonal / |x|`, and `A·(1, x') = (A₀ − A·centre/d) + (A/d)·x`.
    fn to_model(&self, unit: Coefficients, origin: Point) -> Coefficients {
        let sources = unit.sources.iter().map(|w| w.map(|w| w * self.diagonal)).collect();
        let mut affine = unit.affine.map(|row| row.map(|a| a / self.diagonal));
        affine[0] = std::array::from_fn(|i| {
            let shift: f64 = (0..3).map(|k| affine[k + 1][i] * self.centre[k]).sum();
            unit.affine[0][i] - shift + origin[i]
        });
        Coefficients { sources, affine }
    }
}

fn describe_errors(report: &CheckReport) -> String {
    let errors = report
        .errors()
        .map(|finding| format!("{}; {}", finding.message, finding.advice));
    errors.collect::<Vec<_>>().join("; also: ")
}

fn require_valid(options: &FitOptions) -> Result<(), FitError> {
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
    require(positive(sources), "s-ratio", sources, "positive (0.6 in the paper)")?;
    require(
        positive(collocation) && collocation >= sources,
        "c-ratio",
        collocation,
        "at least the s-ratio, so that the system is not underdetermined",
    )?;
    require(options.max_sources > 0, "max-sources", 0.0, "positive")?;
    let truncation = options.solver.truncation;
    require(
        (0.0..1.0).contains(&truncation),
        "truncation",
        truncation,
        "from 0 to below 1 (1e-10 is usual)",
    )?;
    require(options.held_out > 0, "held-out", 0.0, "positive")
}

/// The domain with its faces turned outward, and what there is to say about it.
fn checked(domain: &SurfaceMesh) -> Result<(SurfaceMesh, Vec<String>), FitError> {
    let report = check::check(domain, None);
    if !report.is_solvable() {
        return Err(FitError::DefectiveDomain(Box::new(report)));
    }
    let (mended, mendings) = check::mend(domain);
    let warnings = report.warnings().map(|finding| finding.message.clone());
    let warnings = warnings.chain(mendings.iter().map(ToString::to_string)).collect();
    Ok((mended, warnings))
}

fn place_sources(
    domain: &SurfaceMesh,
    anchors: &Anchors,
    options: &FitOptions,
    warnings: &mut Vec<String>,
) -> Result<Vec<Point>, FitError> {
    let sources = match options.placement {
        Placement::Adaptive { alpha } => near_sources(domain, anchors, alpha, warnings)?,
        Placement::Offset { .. } | Placement::Sphere { .. } => {
            let in_cavity = cavity_vertices(domain);
            let within = anchors.only(|v| in_cavity[v as usize]);
            let count = anchors.vertices.len() - within.vertices.len();
            let mut sources = match options.placement {
                Placement::Offset { distance } => offset_sources(domain, distance, count, options.seed)?,
                Placement::Sphere { radius } => {
                    let frame = Frame::of(domain.vertices());
                    sampling::bounding_sphere(frame.centre, radius * frame.diagonal, count)
                }
                Placement::Adaptive { .. } => Vec::new(),
            };
            sources.extend(near_sources(domain, &within, 1.0, warnings)?);
            sources
        }
    };
    if sources.is_empty() {
        Err(FitError::NoSources)
    } else {
        Ok(sources)
    }
}

fn near_sources(
    domain: &SurfaceMesh,
    anchors: &Anchors,
    alpha: f64,
    warnings: &mut Vec<String>,
) -> Result<Vec<Point>, FitError> {
    // The winding number stays right where parts of the surface overlap; the few queries here can afford it.
    let query = SurfaceQuery::with_winding_sign(domain)?;
    let placed = sampling::adaptive_sources(domain, anchors, alpha, &|p| query.signed_distance(p));
    if placed.dropped > 0 {
        warnings.push(format!(
            "{} of {} sources found no room outside the domain (gaps narrower than their spacing) and were left out",
            placed.dropped,
            anchors.vertices.len()
        ));
    }
    Ok(placed.positions)
}

/// Whether each vertex lies on a shell that encloses a cavity: one that, on a mended surface, has a negative volume.
fn cavity_vertices(domain: &SurfaceMesh) -> Vec<bool> {
    let components = Topology::new(domain).components();
    let centre = Frame::of(domain.vertices()).centre;
    let mut volumes = vec![0.0; components.shapes.len()];
    let parts = |t: usize| Some(components.of_triangle[t] as usize).filter(|&c| c < components.shapes.len());
    for t in 0..domain.triangles().len() {
        let [a, b, c] = domain.corners(t).map(|p| p - centre);
        if let Some(component) = parts(t) {
            volumes[component] += a.dot(&b.cross(&c));
        }
    }
    let mut in_cavity = vec![false; domain.vertices().len()];
    for (t, corners) in domain.triangles().iter().enumerate() {
        if parts(t).is_some_and(|component| volumes[component] < 0.0) {
            corners.iter().for_each(|&v| in_cavity[v as usize] = true);
        }
    }
    in_cavity
}

#[cfg(not(feature = "native"))]
fn offset_sources(_: &SurfaceMesh, _: f64, _: usize, _: u64) -> Result<Vec<Point>, FitError> {
    Err(FitError::NeedsNative)
}

#[cfg(feature = "native")]
fn offset_sources(domain: &SurfaceMesh, distance: f64, count: usize, seed: u64) -> Result<Vec<Point>, FitError> {
    let distance = distance * Frame::of(domain.vertices()).diagonal;
    let offset = crate::native::offset_surface(domain, distance, &crate::native::OffsetOptions::default())?;
    Ok(sampling::even_points(&offset.mesh, count, seed))
}

fn place_collocation(domain: &SurfaceMesh, anchors: &Anchors, size: &Size, options: &FitOptions) -> Collocation {
    if options.collocation_ratio <= 1.0 {
        return Collocation::vertices(domain, &Anchors::choose(domain, size.collocation).vertices);
    }
    if options.collocation_ratio >= 3.0 && size.whole {
        return Collocation::vertices_and_centroids(domain);
    }
    match options.placement {
        Placement::Adaptive { .. } => {
            let extra = size.collocation.div_ceil(anchors.vertices.len().max(1)) - 1;
            Collocation::around(domain, anchors, extra, options.seed)
        }
        Placement::Offset { .. } | Placement::Sphere { .. } => {
            Collocation::even(domain, size.collocation, options.seed)
        }
    }
}

fn rms(values: &[f64]) -> f64 {
    (values.iter().map(|v| v * v).sum::<f64>() / values.len().max(1) as f64).sqrt()
}

/// The smallest value that at least the fraction `q` of the values does not exceed; 0 without values.
fn quantile(mut values: Vec<f64>, q: f64) -> f64 {
    let rank = (q * values.len() as f64).ceil() as usize;
    values.sort_unstable_by(f64::total_cmp);
    values.get(rank.saturating_sub(1)).copied().unwrap_or(0.0)
}

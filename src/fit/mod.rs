//! The pipeline on one screen (the algorithm of section 3.3): boundary map → samples → system → map.
//!
//! What depends on the domain alone is done once, in [`DomainFactor::new`]; every boundary map of that domain then costs
//! one [`DomainFactor::solve`] (section 4.6).

mod error;
mod frame;
mod options;
mod placement;
mod report;

use std::time::Instant;

pub use error::FitError;
pub use options::{FitOptions, Placement};
pub use report::{BoundaryError, Fit, FitReport, Phase, Seconds};

use crate::Point;
use crate::boundary_map::BoundaryMap;
use crate::check;
use crate::map::{HarmonicMap, VolumeMap};
use crate::mesh::{SurfaceMesh, SurfacePoint};
use crate::sampling::{self, Anchors, Collocation};
use crate::solver::{CollocationSystem, DenseFactor, Method};
use crate::statistics::Summary;
use frame::Frame;
use options::{Size, require_valid};
use placement::{place_collocation, place_sources};

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

/// A volume below this part of the diagonal's cube is none but for rounding.
const FLAT: f64 = 1e-12;

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
        let frame = Frame::of(&domain);
        let size = Size::of(&domain, options, &mut warnings)?;
        let anchors = Anchors::choose(&domain, size.sources);
        let sources = place_sources(&domain, &anchors, &size, options, &mut warnings)?;
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
        // The mended domain has the same vertices and triangles; some of them are turned over.
        let same_vertices = boundary.domain().vertices() == self.domain.vertices();
        let boundary = BoundaryMap::between(self.domain.clone(), &boundary.target())
            .ok()
            .filter(|_| same_vertices)
            .ok_or(FitError::OtherDomain)?;
        let target_surface = boundary.target();
        let target = Frame::of(&target_surface);
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
        let (boundary_error, residual) = self.measure(&map, &boundary, target.diagonal)?;
        let checked = start.elapsed().as_secs_f64() - solved;
        let seconds = Seconds {
            solve: solved,
            check: checked,
            ..self.seconds
        };
        let total = seconds.sampling + seconds.factor + solved + checked;
        let mut report = self.report(boundary_error, &residual, Seconds { total, ..seconds });
        report
            .warnings
            .extend(remark_on_target(&target_surface, target.diagonal));
        Ok(Fit { map, boundary, report })
    }

    fn measure(
        &self,
        map: &HarmonicMap,
        boundary: &BoundaryMap,
        diagonal: f64,
    ) -> Result<(BoundaryError, Summary), FitError> {
        let errors_at = |points: &[SurfacePoint]| -> Vec<f64> {
            let images = map.evaluate(&boundary.positions(points));
            let pairs = images.iter().zip(boundary.evaluate(points));
            pairs.map(|(f, exact)| (f - exact).norm() / diagonal).collect()
        };
        let finite = |errors: &[f64]| {
            Summary::of(errors)
                .filter(|s| s.not_finite == 0)
                .ok_or(FitError::NonFiniteMap)
        };
        let held_out = sampling::held_out(&self.domain, self.options.held_out, 100_000, self.options.seed);
        let errors = errors_at(&held_out);
        let max = finite(&errors)?.max;
        let averaged = finite(&errors[..self.options.held_out.min(errors.len())])?;
        let boundary_error = BoundaryError {
            rms: averaged.rms,
            p99: averaged.p99,
            max,
        };
        Ok((boundary_error, finite(&errors_at(&self.collocation.points))?))
    }

    fn report(&self, boundary_error: BoundaryError, residual: &Summary, seconds: Seconds) -> FitReport {
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
            c_error: residual.rms * residual.rms * residual.count as f64,
            residual_rms: residual.rms,
            seconds: Some(seconds),
            warnings: self.warnings.clone(),
        }
    }
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

/// What is odd about a target, though it can be mapped to.
fn remark_on_target(target: &SurfaceMesh, diagonal: f64) -> Option<String> {
    let volume = target.volume();
    if volume.abs() < FLAT * diagonal.powi(3) {
        return Some("the target encloses no volume, so it is no solid; the map flattens the domain".into());
    }
    (volume < 0.0).then(|| "the boundary map turns the solid inside out: it is a reflection".into())
}

//! The frames of a sequence mapped by one method, each frame timed.

use std::time::Instant;

use super::{BuildOptions, CompareError, ComparedMethod, boundary_error, mesh_for};
use crate::Point;
use crate::baseline::{
    DescentOptions, HarmonicOptions, HarmonicSolver, TetHarmonic, TetLaplacian, TetMap, boundary_images,
};
use crate::boundary_map::BoundaryMap;
use crate::fit::DomainFactor;
use crate::mesh::TetMesh;

/// Rounds of refinement at most, each for the worst frame.
const MOST_ROUNDS: usize = 4;
/// Points at which the boundary error of maps on tetrahedra is measured.
const HELD_OUT: usize = 5000;

/// What a sequence takes.
#[derive(Debug, Clone, Default, serde::Serialize, serde::Deserialize)]
pub struct FrameTimings {
    /// Meshing and factoring.
    pub setup_seconds: f64,
    /// For each frame, solved on its own.
    pub frame_seconds: Vec<f64>,
    /// All frames together: in a block, or each starting from the frame before.
    pub together_seconds: f64,
    /// The largest of all frames.
    pub boundary_error_p99: f64,
}

/// Maps the domain of `boundary` to one frame after the other, by the method of `options`.
///
/// # Errors
///
/// [`CompareError::NotPrepared`] for methods that keep nothing from frame to frame, and those of the method.
pub fn frame_timings(
    boundary: &BoundaryMap,
    frames: &[BoundaryMap],
    options: &BuildOptions,
    progress: &dyn Fn(String),
) -> Result<FrameTimings, CompareError> {
    match options.method {
        ComparedMethod::Mfs => by_fundamental_solutions(boundary, frames, options, progress),
        ComparedMethod::Fem => by_finite_elements(boundary, frames, options, progress),
        ComparedMethod::Variational => by_descent(boundary, frames, options, progress),
        ComparedMethod::MeanValue | ComparedMethod::Bijective => Err(CompareError::NotPrepared {
            method: options.method.name(),
        }),
    }
}

fn by_fundamental_solutions(
    boundary: &BoundaryMap,
    frames: &[BoundaryMap],
    options: &BuildOptions,
    progress: &dyn Fn(String),
) -> Result<FrameTimings, CompareError> {
    let start = Instant::now();
    let mut factor = DomainFactor::new(boundary.domain(), &options.fit, &|_| {})?;
    // Sources are added for the worst frame, until all meet the tolerance.
    for round in 1..=frames.len().min(MOST_ROUNDS) {
        progress(format!("placing sources for all frames, round {round}"));
        let fits = factor.solve_block(frames, &|_| {})?;
        let errors = fits.iter().map(|fit| fit.report.boundary_error.p99);
        let worst = errors.enumerate().max_by(|a, b| a.1.total_cmp(&b.1));
        match worst {
            Some((frame, error)) if error > options.fit.tolerance => factor.solve_refined(&frames[frame], &|_| {})?,
            _ => break,
        };
    }
    let setup_seconds = start.elapsed().as_secs_f64();
    let mut frame_seconds = Vec::new();
    let mut boundary_error_p99 = 0.0f64;
    for (i, frame) in frames.iter().enumerate() {
        progress(format!("frame {} of {}", i + 1, frames.len()));
        let start = Instant::now();
        let fit = factor.solve(frame, &|_| {})?;
        frame_seconds.push(start.elapsed().as_secs_f64());
        boundary_error_p99 = boundary_error_p99.max(fit.report.boundary_error.p99);
    }
    progress("all frames together".into());
    let start = Instant::now();
    factor.solve_block(frames, &|_| {})?;
    Ok(FrameTimings {
        setup_seconds,
        frame_seconds,
        together_seconds: start.elapsed().as_secs_f64(),
        boundary_error_p99,
    })
}

/// The mesh for a sequence.
fn mesh(boundary: &BoundaryMap, options: &BuildOptions) -> Result<TetMesh, CompareError> {
    Ok(mesh_for(boundary, &options.mesh, options.given)?.0)
}

/// The largest boundary error of maps on tets.
fn worst_error(frames: &[BoundaryMap], maps: &[TetMap], seed: u64) -> Result<f64, CompareError> {
    let mut worst = 0.0f64;
    for (frame, map) in frames.iter().zip(maps) {
        worst = worst.max(boundary_error(map, frame, HELD_OUT, seed.wrapping_add(1))?.p99);
    }
    Ok(worst)
}

fn by_finite_elements(
    boundary: &BoundaryMap,
    frames: &[BoundaryMap],
    options: &BuildOptions,
    progress: &dyn Fn(String),
) -> Result<FrameTimings, CompareError> {
    let start = Instant::now();
    let mesh = mesh(boundary, options)?;
    let images: Vec<Vec<Point>> = frames
        .iter()
        .map(|frame| Ok(boundary_images(&mesh, frame)?.images))
        .collect::<Result<_, CompareError>>()?;
    let direct = HarmonicOptions {
        solver: HarmonicSolver::Direct,
        ..HarmonicOptions::default()
    };
    progress("factoring".into());
    let system = TetHarmonic::new(mesh, &direct)?;
    let setup_seconds = start.elapsed().as_secs_f64();
    let mut frame_seconds = Vec::new();
    for images in &images {
        let start = Instant::now();
        system.solve(images)?;
        frame_seconds.push(start.elapsed().as_secs_f64());
    }
    progress("all frames together".into());
    let start = Instant::now();
    let maps = system.solve_block(&images)?;
    Ok(FrameTimings {
        setup_seconds,
        frame_seconds,
        together_seconds: start.elapsed().as_secs_f64(),
        boundary_error_p99: worst_error(frames, &maps, options.fit.seed)?,
    })
}

fn by_descent(
    boundary: &BoundaryMap,
    frames: &[BoundaryMap],
    options: &BuildOptions,
    progress: &dyn Fn(String),
) -> Result<FrameTimings, CompareError> {
    let start = Instant::now();
    let system = TetLaplacian::new(mesh(boundary, options)?)?;
    let setup_seconds = start.elapsed().as_secs_f64();
    let mut frame_seconds = Vec::new();
    let mut together_seconds = 0.0;
    let mut before: Option<Vec<Point>> = None;
    let mut maps = Vec::new();
    for (i, frame) in frames.iter().enumerate() {
        progress(format!("frame {} of {}", i + 1, frames.len()));
        let images = boundary_images(system.mesh(), frame)?.images;
        let start = Instant::now();
        system.solve(&images, &options.descent, &|_, _| {})?;
        frame_seconds.push(start.elapsed().as_secs_f64());
        let start = Instant::now();
        let from = DescentOptions {
            initial: before.take(),
            ..options.descent.clone()
        };
        let warm = system.solve(&images, &from, &|_, _| {})?;
        together_seconds += start.elapsed().as_secs_f64();
        before = Some(warm.map.images().to_vec());
        maps.push(warm.map);
    }
    Ok(FrameTimings {
        setup_seconds,
        frame_seconds,
        together_seconds,
        boundary_error_p99: worst_error(frames, &maps, options.fit.seed)?,
    })
}

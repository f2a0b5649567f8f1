//! The frames of a sequence mapped by one method, each frame timed.

use std::path::PathBuf;
use std::time::Instant;

use solidmap::Point;
use solidmap::baseline::{
    DescentOptions, HarmonicOptions, HarmonicSolver, TetHarmonic, TetLaplacian, TetMap, boundary_images,
};
use solidmap::boundary_map::BoundaryMap;
use solidmap::compare::{CompareError, ComparedMethod, boundary_error, mesh_for};
use solidmap::fit::DomainFactor;
use solidmap::io;
use solidmap::mesh::TetMesh;

use super::job::{Job, SequenceFigures};
use super::worker::{descent, fit_options, mesh_spec, tell};
use crate::shared::input;
use crate::shared::output::{describe, peak_rss_bytes};

/// Rounds of refinement at most, each for the worst frame.
const MOST_ROUNDS: usize = 4;

/// Maps the domain to one frame after the other.
pub fn sequence(
    job: &Job,
    boundary: &BoundaryMap,
    method: ComparedMethod,
    frames: &[PathBuf],
) -> anyhow::Result<SequenceFigures> {
    let mut skipped = Vec::new();
    let mut maps = Vec::new();
    for path in frames {
        let read = input::read_image(path, boundary.domain())
            .and_then(|s| Ok(BoundaryMap::between(boundary.domain().clone(), &s)?));
        match read {
            Ok(map) => maps.push(map),
            Err(error) => skipped.push(format!("`{}`: {}", path.display(), describe(&error))),
        }
    }
    anyhow::ensure!(!maps.is_empty(), "none of the {} frames can be used", frames.len());
    let mut figures = match method {
        ComparedMethod::Mfs => sequence_by_fundamental_solutions(job, boundary, &maps)?,
        ComparedMethod::Fem => sequence_by_finite_elements(job, boundary, &maps)?,
        ComparedMethod::Variational => sequence_by_descent(job, boundary, &maps)?,
        ComparedMethod::MeanValue | ComparedMethod::Bijective => {
            anyhow::bail!("{} keeps nothing from frame to frame", method.name())
        }
    };
    figures.skipped = skipped;
    figures.peak_rss_bytes = peak_rss_bytes();
    Ok(figures)
}

fn sequence_by_fundamental_solutions(
    job: &Job,
    boundary: &BoundaryMap,
    frames: &[BoundaryMap],
) -> anyhow::Result<SequenceFigures> {
    let start = Instant::now();
    let mut factor = DomainFactor::new(boundary.domain(), &fit_options(job), &|_| {})?;
    // Sources are added for the worst frame, until all meet the tolerance.
    for round in 1..=frames.len().min(MOST_ROUNDS) {
        tell(format!("placing sources for all frames, round {round}"));
        let fits = factor.solve_block(frames, &|_| {})?;
        let errors = fits.iter().map(|fit| fit.report.boundary_error.p99);
        let worst = errors.enumerate().max_by(|a, b| a.1.total_cmp(&b.1));
        match worst {
            Some((frame, error)) if error > job.tolerance => factor.solve_refined(&frames[frame], &|_| {})?,
            _ => break,
        };
    }
    let setup_seconds = start.elapsed().as_secs_f64();
    let mut frame_seconds = Vec::new();
    let mut boundary_error_p99 = 0.0f64;
    for (i, frame) in frames.iter().enumerate() {
        tell(format!("frame {} of {}", i + 1, frames.len()));
        let start = Instant::now();
        let fit = factor.solve(frame, &|_| {})?;
        frame_seconds.push(start.elapsed().as_secs_f64());
        boundary_error_p99 = boundary_error_p99.max(fit.report.boundary_error.p99);
    }
    tell("all frames together".into());
    let start = Instant::now();
    factor.solve_block(frames, &|_| {})?;
    Ok(SequenceFigures {
        setup_seconds,
        frame_seconds,
        together_seconds: start.elapsed().as_secs_f64(),
        boundary_error_p99,
        ..SequenceFigures::default()
    })
}

/// The mesh for a sequence.
fn sequence_mesh(job: &Job, boundary: &BoundaryMap) -> anyhow::Result<TetMesh> {
    let given = job.given.as_ref().map(io::read_tets).transpose()?;
    Ok(mesh_for(boundary, &mesh_spec(job, boundary), given.as_ref())?.0)
}

/// The largest boundary error of maps on tets.
fn worst_error(job: &Job, frames: &[BoundaryMap], maps: &[TetMap]) -> anyhow::Result<f64> {
    tell("measuring".into());
    let mut worst = 0.0f64;
    for (frame, map) in frames.iter().zip(maps) {
        worst = worst.max(boundary_error(map, frame, 5000, job.seed.wrapping_add(1))?.p99);
    }
    Ok(worst)
}

fn sequence_by_finite_elements(
    job: &Job,
    boundary: &BoundaryMap,
    frames: &[BoundaryMap],
) -> anyhow::Result<SequenceFigures> {
    let start = Instant::now();
    let mesh = sequence_mesh(job, boundary)?;
    let images: Vec<Vec<Point>> = frames
        .iter()
        .map(|frame| Ok(boundary_images(&mesh, frame)?.images))
        .collect::<Result<_, CompareError>>()?;
    let direct = HarmonicOptions {
        solver: HarmonicSolver::Direct,
        ..HarmonicOptions::default()
    };
    let system = TetHarmonic::new(mesh, &direct)?;
    let setup_seconds = start.elapsed().as_secs_f64();
    let mut frame_seconds = Vec::new();
    for images in &images {
        let start = Instant::now();
        system.solve(images)?;
        frame_seconds.push(start.elapsed().as_secs_f64());
    }
    let start = Instant::now();
    let maps = system.solve_block(&images)?;
    Ok(SequenceFigures {
        setup_seconds,
        frame_seconds,
        together_seconds: start.elapsed().as_secs_f64(),
        boundary_error_p99: worst_error(job, frames, &maps)?,
        ..SequenceFigures::default()
    })
}

fn sequence_by_descent(job: &Job, boundary: &BoundaryMap, frames: &[BoundaryMap]) -> anyhow::Result<SequenceFigures> {
    let start = Instant::now();
    let system = TetLaplacian::new(sequence_mesh(job, boundary)?)?;
    let setup_seconds = start.elapsed().as_secs_f64();
    let mut frame_seconds = Vec::new();
    let mut together_seconds = 0.0;
    let mut before: Option<Vec<Point>> = None;
    let mut maps = Vec::new();
    for (i, frame) in frames.iter().enumerate() {
        tell(format!("frame {} of {}", i + 1, frames.len()));
        let images = boundary_images(system.mesh(), frame)?.images;
        let start = Instant::now();
        system.solve(&images, &descent(job), &|_, _| {})?;
        frame_seconds.push(start.elapsed().as_secs_f64());
        let start = Instant::now();
        let from = DescentOptions {
            initial: before.take(),
            ..descent(job)
        };
        let warm = system.solve(&images, &from, &|_, _| {})?;
        together_seconds += start.elapsed().as_secs_f64();
        before = Some(warm.map.images().to_vec());
        maps.push(warm.map);
    }
    Ok(SequenceFigures {
        setup_seconds,
        frame_seconds,
        together_seconds,
        boundary_error_p99: worst_error(job, frames, &maps)?,
        ..SequenceFigures::default()
    })
}

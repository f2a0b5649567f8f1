//! `solidmap boundary check`: is a boundary map one to one, and how far does it distort?

use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::Context;
use serde::Serialize;
use solidmap::boundary_map::BoundaryMap;
use solidmap::boundary_map::check::{BoundaryCheck, BoundaryCheckOptions, check};
use solidmap::io;
use solidmap::mesh::SurfaceMesh;

use super::pictures;
use crate::cli::args::BoundaryCheckArgs;
use crate::cli::output::{Output, peak_rss_bytes};
use crate::cli::{Outcome, input};

/// What `boundary check --json` prints.
#[derive(Serialize)]
struct Report {
    domain: PathBuf,
    image: PathBuf,
    target: Option<PathBuf>,
    #[serde(flatten)]
    check: BoundaryCheck,
    seconds: f64,
    peak_rss_bytes: u64,
}

/// A map to look at, and the surface it is meant to cover.
struct Subject {
    map: BoundaryMap,
    target: Option<SurfaceMesh>,
}

/// Reads, checks, draws and reports; findings make the exit code 1.
pub fn run(args: &BoundaryCheckArgs, output: &Output) -> anyhow::Result<Outcome> {
    let start = Instant::now();
    anyhow::ensure!(
        args.tolerance.is_finite() && args.tolerance >= 0.0,
        "--tolerance is {}, but must be a fraction of the target's diagonal, such as 0.01",
        args.tolerance
    );
    if let Some(png) = &args.png {
        let inputs: Vec<&Path> = [Some(&args.domain), Some(&args.image), args.target.as_ref()]
            .into_iter()
            .flatten()
            .map(PathBuf::as_path)
            .collect();
        input::require_writable(png, &["png"], &inputs)?;
    }
    output.progress("reading");
    let subject = read(args)?;
    output.progress("checking");
    let options = BoundaryCheckOptions {
        tolerance: args.tolerance,
        seed: args.seed,
        ..BoundaryCheckOptions::default()
    };
    let check = examine(&subject, &options).with_context(|| format!("cannot check `{}`", args.image.display()))?;
    if let Some(png) = &args.png {
        output.progress("drawing");
        let figure = pictures::boundary(&subject.map, &check, args.up.into())?;
        let bytes = figure.to_png()?;
        io::atomic_write(png, |writer| writer.write_all(&bytes))?;
        output.note(format_args!("picture in {}", png.display()));
    }
    let report = Report {
        domain: args.domain.clone(),
        image: args.image.clone(),
        target: args.target.clone(),
        check,
        seconds: start.elapsed().as_secs_f64(),
        peak_rss_bytes: peak_rss_bytes(),
    };
    output.result(&report, || {
        format!("{} → {}\n{}", args.domain.display(), args.image.display(), report.check)
    })?;
    Ok(if report.check.findings.is_empty() {
        Outcome::Done
    } else {
        Outcome::CheckFailed
    })
}

/// The map that IMAGE holds, and its target.
fn read(args: &BoundaryCheckArgs) -> anyhow::Result<Subject> {
    Ok(Subject {
        map: input::read_boundary_map(&args.domain, &args.image)?,
        target: args.target.as_deref().map(input::read_surface).transpose()?,
    })
}

#[cfg(feature = "native")]
fn examine(subject: &Subject, options: &BoundaryCheckOptions) -> anyhow::Result<BoundaryCheck> {
    let find = |mesh: &SurfaceMesh| solidmap::native::self_intersections(mesh).map_err(|e| e.to_string());
    Ok(check(&subject.map, subject.target.as_ref(), options, Some(&find))?)
}

#[cfg(not(feature = "native"))]
fn examine(subject: &Subject, options: &BoundaryCheckOptions) -> anyhow::Result<BoundaryCheck> {
    Ok(check(&subject.map, subject.target.as_ref(), options, None)?)
}

//! Errors and times of fits with free sources, beside fits whose sources stay where they are placed.
//!
//! `cargo bench --bench free_sources -- BOUNDARY... [--sources=50,100,200] [--ratio=16] [--svg=FILE]`; by hand, since it takes
//! minutes. `BOUNDARY` is a boundary file, as `boundary pair` and `boundary sphere` write it, or `DOMAIN:IMAGE`; the ratio is that of collocation
//! points to sources. The last columns are how many fixed sources have the error of the free ones, and how long the default solver
//! takes for them; a dash where one for each vertex is not enough.

mod plot;
#[path = "../shared/mod.rs"]
mod shared;

use std::path::Path;

use solidmap::boundary_map::BoundaryMap;
use solidmap::files::read_boundary;
use solidmap::fit::{BoundaryError, COLLOCATION_PER_FREE_SOURCE, Fit, FitOptions, fit};
use solidmap::io::{SolidMesh, read_solid};

use plot::{Row, svg};
use shared::processor_seconds;

type Failure = Box<dyn std::error::Error>;

fn main() -> Result<(), Failure> {
    let option = |name: &str| {
        let start = format!("--{name}=");
        std::env::args().find_map(|argument| argument.strip_prefix(&start).map(str::to_owned))
    };
    let counts = option("sources").unwrap_or("50,100,200,400,800".into());
    let counts: Vec<usize> = counts.split(',').map(str::parse).collect::<Result<_, _>>()?;
    let ratio: f64 = option("ratio").map_or(Ok(COLLOCATION_PER_FREE_SOURCE), |text| text.parse())?;
    println!("Boundary errors at held-out points, over the target's diagonal; processor seconds of whole fits.\n");
    println!(
        "| model | sources | fixed: rms | 99 % | s | free: rms | 99 % | s | rounds | residual | as good: fixed | s |"
    );
    println!("|---|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|");
    let mut rows = Vec::new();
    for model in std::env::args().skip(1).filter(|argument| !argument.starts_with("--")) {
        let boundary = read(&model)?;
        let domain = model.split(':').next().unwrap_or(&model);
        let name = Path::new(domain).file_stem().unwrap_or_default();
        for &count in &counts {
            rows.push(measure(&name.to_string_lossy(), &boundary, count, ratio)?);
        }
    }
    if let Some(picture) = option("svg") {
        std::fs::write(picture, svg(&rows))?;
    }
    Ok(())
}

fn read(model: &str) -> Result<BoundaryMap, Failure> {
    let Some((domain, image)) = model.split_once(':') else {
        return Ok(read_boundary(Path::new(model))?.boundary);
    };
    Ok(match (read_solid(domain)?, read_solid(image)?) {
        (SolidMesh::Cells(domain), SolidMesh::Cells(image)) => BoundaryMap::between_cells(&domain, &image)?,
        (domain, image) => BoundaryMap::between(domain.into_surface(), &image.into_surface())?,
    })
}

fn measure(model: &str, boundary: &BoundaryMap, count: usize, ratio: f64) -> Result<Row, Failure> {
    let options = |free_sources| FitOptions {
        max_sources: count,
        collocation_ratio: ratio,
        free_sources,
        ..FitOptions::dense()
    };
    let (fixed, fixed_seconds) = timed(boundary, &options(false))?;
    let (free, free_seconds) = timed(boundary, &options(true))?;
    let moved = free.report.free_sources.ok_or("no free sources")?;
    let (before, after) = (fixed.report.boundary_error, free.report.boundary_error);
    let as_good = as_good_fixed(boundary, count, after.rms)?;
    let as_good = as_good.map_or("– | –".into(), |(count, seconds)| format!("{count} | {seconds:.2}"));
    let error = |error: &BoundaryError| format!("{:.2e} | {:.2e}", error.rms, error.p99);
    println!(
        "| {model} | {} | {} | {fixed_seconds:.2} | {} | {free_seconds:.2} | {}{} | {:.2e} to {:.2e} | {as_good} |",
        fixed.report.sources,
        error(&before),
        error(&after),
        moved.rounds,
        if moved.kept { "" } else { ", not kept" },
        moved.residual_before,
        moved.residual_after,
    );
    Ok(Row {
        model: model.to_owned(),
        sources: fixed.report.sources,
        fixed: before.rms,
        free: after.rms,
        fixed_seconds,
        free_seconds,
    })
}

/// How many fixed sources have an error of at most `rms`, to a quarter of their number, and the processor seconds of their fit.
fn as_good_fixed(boundary: &BoundaryMap, from: usize, rms: f64) -> Result<Option<(usize, f64)>, Failure> {
    let mut max_sources = from;
    while max_sources < boundary.domain().vertices().len() {
        max_sources += max_sources / 4;
        let options = FitOptions {
            max_sources,
            refine: false,
            ..FitOptions::default()
        };
        let (fixed, seconds) = timed(boundary, &options)?;
        if fixed.report.boundary_error.rms <= rms {
            return Ok(Some((fixed.report.sources, seconds)));
        }
    }
    Ok(None)
}

fn timed(boundary: &BoundaryMap, options: &FitOptions) -> Result<(Fit, f64), Failure> {
    let used = processor_seconds();
    let fitted = fit(boundary, options, &|_| {})?;
    Ok((fitted, processor_seconds() - used))
}

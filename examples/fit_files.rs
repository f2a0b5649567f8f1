//! Fits the harmonic map of a solid to a map of its boundary, from files and into a file.
//!
//! `cargo run --release --example fit_files -- DOMAIN IMAGE MAP`: two surfaces with the same vertices and triangles in
//! the same order, and the map file to write (safetensors). `docs/fit.md` says what the errors mean.

use solidmap::boundary_map::BoundaryMap;
use solidmap::files::{self, MapFile, MapMetadata};
use solidmap::fit::{FitOptions, Phase, fit};
use solidmap::io;

fn main() {
    if let Err(error) = run() {
        eprintln!("error: {error}");
        std::process::exit(1);
    }
}

fn run() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [domain, image, output] = &arguments[..] else {
        return Err("usage: fit_files DOMAIN IMAGE MAP".into());
    };
    let boundary = BoundaryMap::between(io::read_surface(domain)?, &io::read_surface(image)?)?;

    let options = FitOptions {
        tolerance: 1e-3, // of the target's diagonal, on 99 % of the boundary
        ..FitOptions::default()
    };
    let fit = fit(&boundary, &options, &|phase| {
        if let Phase::Refining { round, error, .. } = phase {
            eprintln!("round {round}: 99 % of the boundary within {error:.1e} of the diagonal");
        }
    })?;

    let report = &fit.report;
    for warning in &report.warnings {
        eprintln!("warning: {warning}");
    }
    println!(
        "{} sources; boundary error {:.1e} rms, {:.1e} on 99 %, {:.1e} at most",
        report.sources, report.boundary_error.rms, report.boundary_error.p99, report.boundary_error.max
    );
    let file = MapFile {
        metadata: MapMetadata::new(fit.report, Vec::new()),
        map: fit.map,
        boundary: Some(fit.boundary),
        bijective: None,
    };
    files::write_map(output.as_ref(), &file)?;
    Ok(())
}

//! `solidmap remesh`: a regular mesh of a polycube, or a given mesh, carried into the target without inverted cells.

mod crossings;
mod pictures;
mod summary;
mod write;

pub use pictures::remeshed as picture_of;
pub use write::mesh as write_mesh;

use std::path::{Path, PathBuf};

use anyhow::{Context, ensure};
use serde::Serialize;
use solidmap::io;
use solidmap::remesh::{CellKind, CellSize, RemeshOptions, RemeshPhase, RemeshReport, RemeshSource, Remeshed, remesh};

use crossings::Crossings;
use summary::Reasons;

use super::args::{CellShape, RemeshArgs};
use super::output::{Output, peak_rss_bytes};
use super::{Outcome, input};

/// Extensions of meshes that can be written.
const OUTPUTS: [&str; 4] = ["vtu", "vtk", "mesh", "msh"];

/// What `remesh --json` prints.
#[derive(Serialize)]
struct Report {
    map: PathBuf,
    mesh: Option<PathBuf>,
    output: PathBuf,
    domain_mesh: Option<PathBuf>,
    /// Bad cells of the result.
    flipped_cells: usize,
    /// Why they are, and how many for each reason.
    reasons: Reasons,
    /// Of the result.
    min_scaled_jacobian: Option<f64>,
    /// Where the boundary passes through itself.
    crossings: Crossings,
    #[serde(flatten)]
    remesh: RemeshReport,
    peak_rss_bytes: u64,
}

/// Meshes, repairs, counts again and writes.
pub fn run(args: &RemeshArgs, output: &Output) -> anyhow::Result<Outcome> {
    let meshes = std::iter::once(&args.output).chain(&args.domain_mesh);
    let meshes = meshes.map(|path| (path.as_path(), &OUTPUTS[..]));
    let written: Vec<(&Path, &[&str])> = meshes
        .chain(args.png.iter().map(|path| (path.as_path(), &["png"][..])))
        .collect();
    for (i, (path, extensions)) in written.iter().enumerate() {
        let others: Vec<&Path> = std::iter::once(&args.map)
            .chain(&args.mesh)
            .map(PathBuf::as_path)
            .chain(written[..i].iter().map(|(path, _)| *path))
            .collect();
        input::require_writable(path, extensions, &others)?;
    }
    ensure!(args.cells > 0, "--cells is 0, but must be at least 1");
    let options = RemeshOptions {
        repair: !args.no_repair,
        slide: !args.fix_boundary,
        polish: args.polish,
        memory: args.memory.or_else(input::most_memory),
    };
    output.progress("reading");
    let source = source(args)?;
    let (file, boundary) = input::read_fitted_map(&args.map)?;
    let told = |phase| show(phase, output);
    let remeshed = remesh(&boundary, &file.map, source, &options, &told).with_context(|| match &args.mesh {
        Some(mesh) => format!("cannot carry `{}` by `{}`", mesh.display(), args.map.display()),
        None => format!("cannot remesh by `{}`", args.map.display()),
    })?;
    output.progress("writing");
    let origin = write::origin(args, &file.metadata)?;
    write::mesh(&args.output, &remeshed, &remeshed.images, &origin)?;
    if let Some(path) = &args.domain_mesh {
        write::mesh(path, &remeshed, remeshed.mesh.nodes(), &origin)?;
    }
    let flipped = remeshed.report.after.cells.len();
    let reasons = Reasons::of(&remeshed.report);
    if flipped > 0 {
        output.warn(format!(
            "{flipped} cells stay inverted: {}. In {}, {}. Smaller cells may help, or a boundary map that distorts less there",
            reasons.words(),
            args.output.display(),
            match write::extension(&args.output).as_str() {
                "msh" => "groups called \"inverted\" hold them",
                "mesh" => "they have references that its head explains",
                _ => "`inverted` is 1 there",
            }
        ));
    }
    let crossings = Crossings::of(&remeshed);
    if let Some(warning) = crossings.warning() {
        output.warn(warning);
    }
    let picture = args.png.as_ref().and_then(|_| picture(&remeshed, args, output));
    let report = Report {
        map: args.map.clone(),
        mesh: args.mesh.clone(),
        output: args.output.clone(),
        domain_mesh: args.domain_mesh.clone(),
        flipped_cells: flipped,
        reasons,
        min_scaled_jacobian: remeshed.report.quality.map(|q| q.min_scaled_jacobian),
        crossings,
        remesh: remeshed.report,
        peak_rss_bytes: peak_rss_bytes(),
    };
    output.result(&report, || summary::table(&report))?;
    if let (Some(path), Some(png)) = (&args.png, picture) {
        io::atomic_write(path, |writer| writer.write_all(&png))?;
        output.note(format_args!("picture in {}", path.display()));
    }
    Ok(if flipped > 0 || report.crossings.found() {
        Outcome::CheckFailed
    } else {
        Outcome::Done
    })
}

/// Shows how far a remeshing is.
pub fn show(phase: RemeshPhase, output: &Output) {
    output.progress(match phase {
        RemeshPhase::Meshing => "meshing the domain".into(),
        RemeshPhase::Mapping { nodes } => format!("mapping {nodes} nodes"),
        RemeshPhase::Repairing { round, inverted } => {
            format!("repairing: round {round}, {inverted} inverted")
        }
        RemeshPhase::Verifying => "counting and measuring".into(),
    });
}

/// A mesh with nodes that are nowhere has no picture; that is no reason to withhold the rest.
fn picture(remeshed: &Remeshed, args: &RemeshArgs, output: &Output) -> Option<Vec<u8>> {
    let repaired = if args.no_repair { "Not repaired" } else { "Repaired" };
    let drawn = pictures::remeshed(remeshed, repaired, args.up).and_then(|figure| Ok(figure.to_png()?));
    drawn
        .inspect_err(|error| output.warn(format_args!("no picture: {error}")))
        .ok()
}

/// What is carried.
fn source(args: &RemeshArgs) -> anyhow::Result<RemeshSource> {
    Ok(match &args.mesh {
        Some(path) => RemeshSource::Given(io::read_cells(path)?),
        None => RemeshSource::Regular {
            kind: match args.kind {
                CellShape::Tet => CellKind::Tets,
                CellShape::Hex => CellKind::Hexes,
            },
            size: match args.cell_size {
                Some(length) => CellSize::Length(length),
                None => CellSize::Along(args.cells),
            },
            most_cells: args.max_cells,
        },
    })
}

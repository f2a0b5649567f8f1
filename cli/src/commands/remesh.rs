//! `solidmap remesh`: a regular mesh of a polycube, or a given mesh, carried into the target without inverted cells.

use std::path::{Path, PathBuf};

use anyhow::{Context, ensure};
use serde::Serialize;
use solidmap::files::MapMetadata;
use solidmap::io;
use solidmap::remesh::{CellSize, PolishOutcome, RemeshOptions, RemeshSource, Remeshed, remesh};

use crate::CommandOutcome;
use crate::args::RemeshArgs;
use crate::shared::carried_mesh_file;
use crate::shared::carried_mesh_picture;
use crate::shared::carried_mesh_report::{self, CarriedMeshReport};
use crate::shared::input;
use crate::shared::json::{FileName, file_name};
use crate::shared::mesh_page;
use crate::shared::output::{Output, peak_rss_bytes, two_columns, write_file, written_row};
use crate::shared::page;
use crate::shared::places::with_places;
use crate::shared::remeshing::{remesh_options, show_phase};

/// Extensions of meshes that can be written.
const OUTPUTS: [&str; 4] = ["vtu", "vtk", "mesh", "msh"];

/// What `remesh --json` prints.
#[derive(Serialize)]
struct RemeshSummary {
    map: FileName,
    mesh: Option<FileName>,
    output: FileName,
    domain_mesh: Option<FileName>,
    /// The picture; none where there was nothing to draw.
    picture: Option<FileName>,
    page: Option<FileName>,
    #[serde(flatten)]
    carried: CarriedMeshReport,
    peak_rss_bytes: u64,
}

/// Carries and repairs the mesh, and writes it.
pub fn run(args: &RemeshArgs, output: &Output) -> anyhow::Result<CommandOutcome> {
    let outputs: [(Option<&PathBuf>, &[&str]); 4] = [
        (Some(&args.output), &OUTPUTS),
        (args.domain_mesh.as_ref(), &OUTPUTS),
        (args.png.as_ref(), &["png"]),
        (args.html.as_ref(), &page::EXTENSIONS),
    ];
    let inputs: Vec<&Path> = std::iter::once(&args.map)
        .chain(&args.mesh)
        .map(PathBuf::as_path)
        .collect();
    input::require_all_writable(&outputs, &inputs)?;
    ensure!(args.cells > 0, "--cells is 0, but must be at least 1");
    let options = RemeshOptions {
        repair: !args.no_repair,
        keep_boundary_map: args.keep_boundary_map,
        polish: args.polish.unwrap_or(RemeshOptions::default().polish),
        polish_valid: args.polish.is_some(),
        ..remesh_options(&args.repair)
    };
    output.progress("reading");
    let source = source(args)?;
    let (file, boundary) = input::read_fitted_map(&args.map)?;
    let progress = |phase| show_phase(phase, "", output);
    let remeshed = remesh(&boundary, &file.map, source, &options, &progress).with_context(|| match &args.mesh {
        Some(mesh) => format!("cannot carry `{}` by `{}`", mesh.display(), args.map.display()),
        None => format!("cannot remesh by `{}`", args.map.display()),
    })?;
    output.progress("writing");
    let origin = origin(args, &file.metadata)?;
    carried_mesh_file::write(&args.output, &remeshed, &remeshed.images, &origin)?;
    if let Some(path) = &args.domain_mesh {
        carried_mesh_file::write(path, &remeshed, remeshed.mesh.nodes(), &origin)?;
    }
    let mesh = CarriedMeshReport::new(&remeshed, args.places.worst);
    mesh.warn(
        &args.output,
        args.repair.split_stuck != Some(0),
        !args.no_repair,
        output,
    );
    if let Some(warning) = poor_cells(args, &remeshed) {
        output.warn(warning);
    }
    let ups = [args.up, args.target_up.or(args.up)];
    let picture = args
        .png
        .as_ref()
        .and_then(|_| carried_mesh_picture::png(&remeshed, args.no_repair, ups, output));
    let report = RemeshSummary {
        map: (&args.map).into(),
        mesh: file_name(args.mesh.as_ref()),
        output: (&args.output).into(),
        domain_mesh: file_name(args.domain_mesh.as_ref()),
        picture: file_name(args.png.as_ref().filter(|_| picture.is_some())),
        page: file_name(args.html.as_ref()),
        carried: mesh,
        peak_rss_bytes: peak_rss_bytes(),
    };
    if let (Some(path), Some(png)) = (&args.png, picture) {
        write_file(path, &png)?;
    }
    if let Some(path) = &args.html {
        mesh_page::write_of_file(path, &args.output, args.target_up.or(args.up), &args.page)?;
    }
    output.result(&report, || with_places(summary(&report), &report.carried.worst_places))?;
    Ok(CommandOutcome::from_check(report.carried.is_valid()))
}

/// A warning of poor hexahedra; `None` where cells are as they were mapped, because that was asked for.
fn poor_cells(args: &RemeshArgs, remeshed: &Remeshed) -> Option<String> {
    if args.no_repair {
        return None;
    }
    let hint = match (&args.mesh, remeshed.report.repair.polish.outcome) {
        (_, PolishOutcome::NotAsked | PolishOutcome::NothingInverted) => "--polish 200 may help",
        (None, _) => "Another size of cells may help, or a boundary map that distorts less there",
        (Some(_), _) => "Other cells there may help, or a boundary map that distorts less",
    };
    carried_mesh_report::poor_cells(remeshed, hint)
}

/// The report as text.
fn summary(report: &RemeshSummary) -> String {
    let mut rows = carried_mesh_report::rows(&report.carried, report.mesh.is_some());
    rows.push(carried_mesh_report::memory_row(
        &report.carried.remesh,
        report.peak_rss_bytes,
    ));
    let files = [
        Some(&report.output),
        report.domain_mesh.as_ref(),
        report.picture.as_ref(),
        report.page.as_ref(),
    ];
    rows.push(written_row(files));
    two_columns(rows)
}

/// The mesh that is carried.
fn source(args: &RemeshArgs) -> anyhow::Result<RemeshSource> {
    Ok(match &args.mesh {
        Some(path) => RemeshSource::Given(io::read_cells(path)?),
        None => RemeshSource::Regular {
            kind: args.kind.into(),
            size: match args.cell_size {
                Some(length) => CellSize::Length(length),
                None => CellSize::Along(args.cells),
            },
            most_cells: args.repair.max_cells,
        },
    })
}

/// Where the mesh comes from, in one line: its files and their hashes.
fn origin(args: &RemeshArgs, map: &MapMetadata) -> anyhow::Result<String> {
    let mut origin = format!("solidmap {}: mesh", env!("CARGO_PKG_VERSION"));
    let mut add = |role: &str, file: &str, sha256: &str| {
        origin += &format!(" {role} {file} (SHA-256 {})", sha256.get(..16).unwrap_or(sha256));
    };
    if let Some(path) = &args.mesh {
        let mesh = input::provenance("mesh", path)?;
        add("from", &mesh.file, &mesh.sha256);
    }
    let by = input::provenance("map", &args.map)?;
    add("carried by", &by.file, &by.sha256);
    for input in &map.inputs {
        add(&format!("of {}", input.role), &input.file, &input.sha256);
    }
    Ok(origin)
}

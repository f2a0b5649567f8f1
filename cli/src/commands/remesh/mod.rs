//! `solidmap remesh`: a regular mesh of a polycube, or a given mesh, carried into the target without inverted cells.

mod summary;

use std::path::{Path, PathBuf};

use anyhow::{Context, ensure};
use serde::Serialize;
use solidmap::files::MapMetadata;
use solidmap::io;
use solidmap::remesh::{
    BoundaryIntersections, CellKind, CellSize, RemeshOptions, RemeshReport, RemeshSource, Remeshed, remesh,
};
use solidmap::worst_places::WorstPlace;

use summary::Reasons;

use crate::CommandOutcome;
use crate::args::{CellShape, RemeshArgs};
use crate::shared::carried_mesh_file;
use crate::shared::carried_mesh_picture::{self, show_phase};
use crate::shared::input::{self, extension};
use crate::shared::json::{FileName, file_name};
use crate::shared::output::{Output, peak_rss_bytes, write_file};
use crate::shared::places::with_places;
use crate::shared::self_intersections::finder;

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
    /// Inverted cells of the result.
    inverted_cells: usize,
    /// How many of them there are for each reason.
    reasons: Reasons,
    /// The least scaled Jacobian of the result.
    min_scaled_jacobian: Option<f64>,
    /// Where the boundary passes through itself.
    crossings: BoundaryIntersections,
    /// Where cells stay inverted, in the target.
    worst_places: Vec<WorstPlace>,
    #[serde(flatten)]
    remesh: RemeshReport,
    peak_rss_bytes: u64,
}

/// Carries and repairs the mesh, and writes it.
pub fn run(args: &RemeshArgs, output: &Output) -> anyhow::Result<CommandOutcome> {
    let outputs: [(Option<&PathBuf>, &[&str]); 3] = [
        (Some(&args.output), &OUTPUTS),
        (args.domain_mesh.as_ref(), &OUTPUTS),
        (args.png.as_ref(), &["png"]),
    ];
    let inputs: Vec<&Path> = std::iter::once(&args.map)
        .chain(&args.mesh)
        .map(PathBuf::as_path)
        .collect();
    input::require_all_writable(&outputs, &inputs)?;
    ensure!(args.cells > 0, "--cells is 0, but must be at least 1");
    let options = RemeshOptions {
        repair: !args.no_repair,
        slide: !args.fix_boundary,
        most_added: args.split_stuck,
        effort: args.effort,
        polish: args.polish.unwrap_or(RemeshOptions::default().polish),
        polish_valid: args.polish.is_some(),
        memory: args.memory.or_else(input::most_memory),
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
    let inverted = remeshed.report.after.cells.len();
    let reasons = Reasons::of(&remeshed.report);
    if inverted > 0 {
        output.warn(format!(
            "{}: {}. In {}, {}. {}",
            if inverted == 1 {
                "1 cell stays inverted".into()
            } else {
                format!("{inverted} cells stay inverted")
            },
            reasons.words(!args.no_repair),
            args.output.display(),
            match extension(&args.output).as_str() {
                "msh" => "groups called \"inverted\" hold them",
                "mesh" => "their references are explained in its header",
                _ => "`inverted` is 1 there",
            },
            match (args.split_stuck, remeshed.report.kind) {
                (Some(0), CellKind::Tets) => "Leave out --split-stuck off: nodes that splitting adds may help",
                _ if remeshed.report.repair.exhausted => {
                    "The repair ended at its limit: more --effort may help, smaller cells, or a boundary map that distorts \
                     less there"
                }
                _ => "Smaller cells may help, or a boundary map that distorts less there",
            }
        ));
    }
    let crossings = remeshed.boundary_intersections(finder());
    if let Some(warning) = summary::warning(&crossings) {
        output.warn(warning);
    }
    let picture = args.png.as_ref().and_then(|_| picture(&remeshed, args, output));
    let report = RemeshSummary {
        map: (&args.map).into(),
        mesh: file_name(args.mesh.as_ref()),
        output: (&args.output).into(),
        domain_mesh: file_name(args.domain_mesh.as_ref()),
        picture: file_name(args.png.as_ref().filter(|_| picture.is_some())),
        inverted_cells: inverted,
        reasons,
        min_scaled_jacobian: remeshed.report.quality.map(|q| q.min_scaled_jacobian),
        crossings,
        worst_places: remeshed.worst_places(args.places.worst),
        remesh: remeshed.report,
        peak_rss_bytes: peak_rss_bytes(),
    };
    if let (Some(path), Some(png)) = (&args.png, picture) {
        write_file(path, &png)?;
    }
    output.result(&report, || with_places(summary::table(&report), &report.worst_places))?;
    Ok(CommandOutcome::from_check(inverted == 0 && !report.crossings.found()))
}

/// The picture. A mesh with nodes that are not finite has none, which is a warning only.
fn picture(remeshed: &Remeshed, args: &RemeshArgs, output: &Output) -> Option<Vec<u8>> {
    let now = if args.no_repair {
        "Not repaired"
    } else if remeshed.images == remeshed.carried {
        "Unchanged"
    } else if remeshed.report.before.cells.is_empty() {
        "Polished"
    } else {
        "Repaired"
    };
    let ups = [args.up, args.target_up.or(args.up)];
    let drawn = carried_mesh_picture::figure(remeshed, now, ups).and_then(|figure| Ok(figure.to_png()?));
    drawn
        .inspect_err(|error| output.warn(format_args!("no picture: {error}")))
        .ok()
}

/// The mesh that is carried.
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

//! `solidmap remesh`: a regular mesh of a polycube, or a given mesh, carried into the target without inverted cells.

use std::path::{Path, PathBuf};

use anyhow::{Context, ensure};
use serde::Serialize;
use solidmap::Point;
use solidmap::io::{self, CellGroup, Cells, Field, MapMetadata, VtkFields};
use solidmap::remesh::{
    BadCells, CellKind, CellQuality, CellSize, MeshSource, Obstacle, Obstacles, RemeshOptions, RemeshPhase,
    RemeshReport, Remeshed, remesh, scaled_jacobians,
};
use solidmap::report::significant;

use super::args::{CellShape, RemeshArgs};
use super::output::{Output, pairs, peak_rss_bytes};
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
    /// Of the result.
    min_scaled_jacobian: Option<f64>,
    #[serde(flatten)]
    remesh: RemeshReport,
    peak_rss_bytes: u64,
}

/// Meshes, repairs, counts again and writes.
pub fn run(args: &RemeshArgs, output: &Output) -> anyhow::Result<Outcome> {
    let written: Vec<&Path> = std::iter::once(&args.output)
        .chain(&args.domain_mesh)
        .map(PathBuf::as_path)
        .collect();
    for (i, path) in written.iter().enumerate() {
        let others: Vec<&Path> = std::iter::once(&args.map)
            .chain(&args.mesh)
            .map(PathBuf::as_path)
            .chain(written[..i].iter().copied())
            .collect();
        input::require_writable(path, &OUTPUTS, &others)?;
    }
    ensure!(args.cells > 0, "--cells is 0, but must be at least 1");
    let options = RemeshOptions {
        repair: !args.no_repair,
        slide: !args.fix_boundary,
        polish: args.polish,
    };
    output.progress("reading");
    let source = source(args)?;
    let (file, boundary) = input::read_fitted_map(&args.map)?;
    let told = |phase| {
        output.progress(match phase {
            RemeshPhase::Meshing if args.mesh.is_some() => "examining the mesh".into(),
            RemeshPhase::Meshing => "meshing the polycube".into(),
            RemeshPhase::Mapping { nodes } => format!("mapping {nodes} nodes"),
            RemeshPhase::Repairing { round, inverted } => {
                format!("repairing: round {round}, {inverted} inverted")
            }
            RemeshPhase::Verifying => "counting and measuring".into(),
        });
    };
    let remeshed = remesh(&boundary, &file.map, source, &options, &told).with_context(|| match &args.mesh {
        Some(mesh) => format!("cannot carry `{}` by `{}`", mesh.display(), args.map.display()),
        None => format!("cannot remesh by `{}`", args.map.display()),
    })?;
    output.progress("writing");
    let origin = origin(args, &file.metadata)?;
    write(&args.output, &remeshed, &remeshed.images, &origin)?;
    if let Some(path) = &args.domain_mesh {
        write(path, &remeshed, &remeshed.mesh.nodes, &origin)?;
    }
    let flipped = remeshed.report.after.cells.len();
    if flipped > 0 {
        output.warn(format!(
            "{flipped} cells stay inverted: {}. In a .vtu they have `inverted` 1. Smaller cells may help, or a boundary map \
             that distorts less there",
            reasons(&remeshed.report)
        ));
    }
    let report = Report {
        map: args.map.clone(),
        mesh: args.mesh.clone(),
        output: args.output.clone(),
        domain_mesh: args.domain_mesh.clone(),
        flipped_cells: flipped,
        min_scaled_jacobian: remeshed.report.quality.map(|q| q.min_scaled_jacobian),
        remesh: remeshed.report,
        peak_rss_bytes: peak_rss_bytes(),
    };
    output.result(&report, || summary(&report))?;
    Ok(if flipped > 0 {
        Outcome::CheckFailed
    } else {
        Outcome::Done
    })
}

/// What is carried.
fn source(args: &RemeshArgs) -> anyhow::Result<MeshSource> {
    Ok(match &args.mesh {
        Some(path) => MeshSource::Given(io::read_cells(path)?),
        None => MeshSource::Regular {
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

/// Where the mesh comes from, in one line.
fn origin(args: &RemeshArgs, map: &MapMetadata) -> anyhow::Result<String> {
    let name = |path: &Path| path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let mut origin = format!("solidmap {}: mesh", env!("CARGO_PKG_VERSION"));
    let mut add = |role: &str, file: &str, sha256: &str| {
        origin += &format!(" {role} {file} (SHA-256 {})", sha256.get(..16).unwrap_or(sha256));
    };
    if let Some(path) = &args.mesh {
        let mesh = io::Provenance::of("mesh", path).with_context(|| format!("cannot read `{}`", path.display()))?;
        add("from", &mesh.file, &mesh.sha256);
    }
    let by = io::Provenance::of("map", &args.map).with_context(|| format!("cannot read `{}`", name(&args.map)))?;
    add("carried by", &by.file, &by.sha256);
    for input in &map.inputs {
        add(&format!("of {}", input.role), &input.file, &input.sha256);
    }
    Ok(origin)
}

/// The mesh with its nodes at `positions`.
fn write(path: &Path, remeshed: &Remeshed, positions: &[Point], origin: &str) -> anyhow::Result<()> {
    let mesh = &remeshed.mesh;
    let cells = Cells::from(&mesh.cells);
    let extension = path.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase);
    if matches!(extension.as_deref(), Some("mesh" | "msh")) {
        let (quads, names) = (mesh.quads(), names(&mesh.part_names));
        let (faces, of_faces): (Cells, Vec<i32>) = match &quads {
            // Two triangles stand for each quad.
            Some(quads) => (Cells::Quads(quads), mesh.parts.iter().step_by(2).copied().collect()),
            None => (Cells::Triangles(&mesh.boundary), mesh.parts.clone()),
        };
        let faces = CellGroup {
            cells: faces,
            labels: &of_faces,
            names: &names,
        };
        let solid = CellGroup {
            cells,
            labels: &mesh.regions,
            names: &[],
        };
        return Ok(io::write_groups(path, positions, &[faces, solid], origin)?);
    }
    let report = &remeshed.report;
    let mut inverted = vec![0.0; cells.count()];
    let mut obstacle = vec![0.0; cells.count()];
    for &cell in &report.after.cells {
        inverted[cell as usize] = 1.0;
        obstacle[cell as usize] = match report.obstacles_after.of_cells[cell as usize] {
            Obstacle::Unknown => 0.0,
            Obstacle::Boundary => 1.0,
            Obstacle::BlockedNode => 2.0,
            Obstacle::FoldedQuad => 3.0,
        };
    }
    let field = |name: &str, components, values| Field {
        name: name.into(),
        components,
        values,
    };
    let on_boundary = mesh.on_boundary.iter().map(|&is| f64::from(u8::from(is))).collect();
    let fields = VtkFields {
        point: vec![
            field("domain", 3, flat(&mesh.nodes)),
            field("image", 3, flat(&remeshed.images)),
            field("on_boundary", 1, on_boundary),
        ],
        cell: vec![
            field("region", 1, mesh.regions.iter().map(|&r| f64::from(r)).collect()),
            field("scaled_jacobian", 1, scaled_jacobians(&mesh.cells, positions)),
            field("inverted", 1, inverted),
            field("obstacle", 1, obstacle),
        ],
        comment: origin.to_owned(),
    };
    if extension.as_deref() == Some("vtk") {
        io::write_vtk(path, positions, cells, &fields, io::VtkEncoding::Binary)?;
    } else {
        io::write_vtu(path, positions, cells, &fields)?;
    }
    Ok(())
}

/// Names with their numbers, from 1.
fn names(names: &[String]) -> Vec<(i32, String)> {
    (1..).zip(names.iter().cloned()).collect()
}

/// What keeps the cells that stay inverted, in words.
fn reasons(report: &RemeshReport) -> String {
    let of_cells = &report.obstacles_after.of_cells;
    let count = |obstacle| {
        let cells = report.after.cells.iter();
        cells.filter(|c| of_cells[**c as usize] == obstacle).count()
    };
    let known = [
        (Obstacle::Boundary, "have a corner on the boundary alone (proved)"),
        (
            Obstacle::BlockedNode,
            "have an inner node for which no place is right (proved)",
        ),
        (Obstacle::FoldedQuad, "stand on a folded boundary quad"),
        (Obstacle::Unknown, "for no reason known"),
    ];
    let known = known.map(|(obstacle, words)| (count(obstacle), words));
    let known = known.into_iter().filter(|(count, _)| *count > 0);
    known
        .map(|(count, words)| format!("{count} {words}"))
        .collect::<Vec<_>>()
        .join(", ")
}

/// What stands in the way, in words; empty when nothing does.
fn obstacles(found: &Obstacles) -> String {
    let of = [
        (
            found.boundary_cells,
            "cells with an inverted corner on the boundary alone",
        ),
        (found.blocked_nodes, "inner nodes for which no place is right"),
        (found.folded_quads, "folded boundary quads"),
    ];
    let of = of.into_iter().filter(|(count, _)| *count > 0);
    of.map(|(count, words)| format!("{count} {words}"))
        .collect::<Vec<_>>()
        .join(", ")
}

fn flat(points: &[Point]) -> Vec<f64> {
    points.iter().flat_map(|p| [p.x, p.y, p.z]).collect()
}

fn summary(report: &Report) -> String {
    let found = &report.remesh;
    let (cells, per_cell) = match found.kind {
        CellKind::Tets => ("tetrahedra", ""),
        CellKind::Hexes => (
            "hexahedra",
            " at their corners, and at 125 points of each in floating point",
        ),
    };
    let seconds = found.seconds;
    let bad = |bad: &BadCells| {
        let inside = match bad.inverted_inside {
            0 => String::new(),
            count => format!(" and {count} inside only"),
        };
        format!("{}{inside}", bad.inverted)
    };
    let mut rows = vec![
        [
            "mesh".to_owned(),
            format!(
                "{} {cells}, {} nodes, {} of them on the boundary",
                found.cells, found.nodes, found.boundary_nodes
            ),
        ],
        [
            "inverted".into(),
            format!(
                "{} as mapped, {} now, decided exactly{per_cell}",
                bad(&found.before),
                bad(&found.after)
            ),
        ],
    ];
    if report.mesh.is_some() {
        rows.push([
            "given".into(),
            format!(
                "{} tetrahedra with all nodes on the boundary split; boundary within {} of the domain's diagonal",
                found.split_cells,
                significant(found.off_surface, 2)
            ),
        ]);
    }
    let in_the_way = obstacles(&found.obstacles);
    if !in_the_way.is_empty() {
        rows.push(["in the way".into(), in_the_way]);
    }
    let quality = |q: &CellQuality| {
        format!(
            "at least {}, 1 % below {}, mean {}; dihedral angles {:.1}° to {:.1}°",
            significant(q.min_scaled_jacobian, 3),
            significant(q.p01_scaled_jacobian, 3),
            significant(q.mean_scaled_jacobian, 3),
            q.min_dihedral,
            q.max_dihedral
        )
    };
    for (name, of) in [
        ("scaled Jacobian", &found.quality),
        ("in the domain", &found.domain_quality),
    ] {
        rows.extend(of.as_ref().map(|of| [name.to_owned(), quality(of)]));
    }
    if let Some([least, _, low, middle, high, _, most]) = found.determinants {
        rows.push([
            "det J".into(),
            format!(
                "over its mean: {} to {}, 10 % {}, 50 % {}, 90 % {}",
                significant(least, 3),
                significant(most, 3),
                significant(low, 3),
                significant(middle, 3),
                significant(high, 3)
            ),
        ]);
    }
    if found.repair.iterations + found.repair.polish_iterations > 0 {
        let repair = &found.repair;
        rows.push([
            "repair".into(),
            format!(
                "{} rounds, {} iterations, {} to polish; inner nodes moved by {} of the diagonal at most",
                repair.rounds + repair.slide.rounds,
                repair.iterations + repair.slide.iterations,
                repair.polish_iterations,
                significant(found.largest_shift, 2)
            ),
        ]);
        rows.push([
            "boundary".into(),
            match found.slid_nodes {
                0 => "every node exactly where the boundary map puts it".into(),
                slid => format!(
                    "{slid} nodes slid along the target, by {} of a cell at most, {} of the diagonal; the others did not move",
                    significant(found.largest_slide_in_cells, 2),
                    significant(found.largest_slide, 2)
                ),
            },
        ]);
    }
    rows.push([
        "target".into(),
        format!(
            "to the mesh {} of the diagonal at most, {} in the mean; from it {} and {}; volume {} of {}",
            significant(found.target_to_mesh.max, 2),
            significant(found.target_to_mesh.mean, 2),
            significant(found.mesh_to_target.max, 2),
            significant(found.mesh_to_target.mean, 2),
            significant(found.volume, 5),
            significant(found.target_volume, 5)
        ),
    ]);
    rows.push([
        "time".into(),
        format!(
            "{:.1} s: mesh {:.1}, map {:.1}, repair {:.1}, counting {:.1}",
            seconds.total, seconds.mesh, seconds.map, seconds.repair, seconds.verify
        ),
    ]);
    rows.push([
        "memory".into(),
        format!("{:.0} MiB at most", report.peak_rss_bytes as f64 / 1_048_576.0),
    ]);
    rows.push(["written".into(), report.output.display().to_string()]);
    pairs(rows)
}

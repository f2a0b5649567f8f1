//! `solidmap remesh`: a regular mesh of a polycube, carried into the target without inverted cells.

use std::path::{Path, PathBuf};

use anyhow::{Context, ensure};
use serde::Serialize;
use solidmap::Point;
use solidmap::io::{self, Cells, Field, VtkFields};
use solidmap::remesh::{
    BadCells, CellKind, CellList, CellQuality, CellSize, RemeshOptions, RemeshPhase, RemeshReport, Remeshed, remesh,
    scaled_jacobians,
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
        let others: Vec<&Path> = [args.map.as_path()]
            .into_iter()
            .chain(written[..i].iter().copied())
            .collect();
        input::require_writable(path, &OUTPUTS, &others)?;
    }
    ensure!(args.cells > 0, "--cells is 0, but must be at least 1");
    let size = match args.cell_size {
        Some(length) => CellSize::Length(length),
        None => CellSize::Along(args.cells),
    };
    let options = RemeshOptions {
        kind: match args.kind {
            CellShape::Tet => CellKind::Tets,
            CellShape::Hex => CellKind::Hexes,
        },
        size,
        repair: !args.no_repair,
        slide: !args.fix_boundary,
        polish: args.polish,
        most_cells: args.max_cells,
    };
    output.progress("reading");
    let (file, boundary) = input::read_fitted_map(&args.map)?;
    let told = |phase| {
        output.progress(match phase {
            RemeshPhase::Meshing => "meshing the polycube".into(),
            RemeshPhase::Mapping { nodes } => format!("mapping {nodes} nodes"),
            RemeshPhase::Repairing { round, inverted } => {
                format!("repairing: round {round}, {inverted} inverted")
            }
            RemeshPhase::Verifying => "counting and measuring".into(),
        });
    };
    let remeshed = remesh(&boundary, &file.map, &options, &told)
        .with_context(|| format!("cannot remesh by `{}`", args.map.display()))?;
    output.progress("writing");
    let origin = format!(
        "solidmap {}, carried by {}",
        env!("CARGO_PKG_VERSION"),
        args.map.display()
    );
    write(&args.output, &remeshed, &remeshed.images, &origin)?;
    if let Some(path) = &args.domain_mesh {
        write(path, &remeshed, &remeshed.mesh.nodes, &origin)?;
    }
    let flipped = remeshed.report.after.cells.len();
    if flipped > 0 {
        output.warn(format!(
            "{flipped} cells stay inverted; in a .vtu they have `inverted` 1. Smaller cells may help, or a boundary map that \
             distorts less there"
        ));
    }
    let report = Report {
        map: args.map.clone(),
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

/// The mesh with its nodes at `positions`.
fn write(path: &Path, remeshed: &Remeshed, positions: &[Point], origin: &str) -> anyhow::Result<()> {
    let mesh = &remeshed.mesh;
    let cells = match &mesh.cells {
        CellList::Tets(cells) => Cells::Tets(cells),
        CellList::Hexes(cells) => Cells::Hexes(cells),
    };
    match path
        .extension()
        .and_then(|e| e.to_str())
        .map(str::to_ascii_lowercase)
        .as_deref()
    {
        Some("vtu") => {
            let mut inverted = vec![0.0; cells.count()];
            for &cell in &remeshed.report.after.cells {
                inverted[cell as usize] = 1.0;
            }
            let field = |name: &str, components, values| Field {
                name: name.into(),
                components,
                values,
            };
            let fields = VtkFields {
                point: vec![
                    field("domain", 3, flat(&mesh.nodes)),
                    field("image", 3, flat(&remeshed.images)),
                    field(
                        "on_boundary",
                        1,
                        mesh.on_boundary.iter().map(|&is| f64::from(u8::from(is))).collect(),
                    ),
                ],
                cell: vec![
                    field("scaled_jacobian", 1, scaled_jacobians(&mesh.cells, positions)),
                    field("inverted", 1, inverted),
                ],
            };
            io::write_vtu(path, positions, cells, &fields)?;
        }
        Some("msh") => io::write_msh(path, positions, cells, &mesh.boundary, origin)?,
        _ => io::write_cells(path, positions, cells)?,
    }
    Ok(())
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

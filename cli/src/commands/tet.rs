//! `solidmap tet`: a closed surface filled with tetrahedra.

use std::time::Instant;

use anyhow::Context;
use serde::Serialize;
use solidmap::cgal_tetgen::{self, Mesh3Options, TetOptions};
use solidmap::io;

use crate::CommandOutcome;
use crate::args::{Mesher, TetArgs};
use crate::drawing::significant;
use crate::shared::input;
use crate::shared::json::FileName;
use crate::shared::output::{Output, two_columns};

/// What `tet --json` prints.
#[derive(Serialize)]
struct TetSummary {
    model: FileName,
    output: FileName,
    mesher: &'static str,
    vertices: usize,
    tets: usize,
    volume: f64,
    surface_volume: f64,
    #[serde(serialize_with = "crate::shared::json::total_seconds")]
    seconds: f64,
}

/// Fills a surface with tetrahedra.
pub fn run(args: &TetArgs, output: &Output) -> anyhow::Result<CommandOutcome> {
    input::require_writable(&args.output, &["mesh", "vtk", "vtu"], &[&args.model])?;
    anyhow::ensure!(
        args.quality == 0.0 || args.quality >= 1.1,
        "--quality is {}, but must be 0 (no refinement) or at least 1.1",
        args.quality
    );
    output.progress("reading");
    let surface = input::read_surface(&args.model)?;
    output.progress("tetrahedralising");
    let memory = args.memory.or_else(input::most_memory);
    let start = Instant::now();
    let (mesher, result) = match args.mesher {
        Mesher::Tetgen => {
            let options = TetOptions {
                radius_edge_ratio: (args.quality > 0.0).then_some(args.quality),
                max_volume: args.max_volume,
                memory,
                ..TetOptions::default()
            };
            ("tetgen", cgal_tetgen::tetrahedralize(&surface, &options))
        }
        Mesher::Cgal => {
            let options = Mesh3Options {
                cell_size: args.max_volume.map(cgal_tetgen::regular_tet_circumradius),
                memory,
                ..Mesh3Options::default()
            };
            ("cgal", cgal_tetgen::tetrahedralize_mesh3(&surface, &options))
        }
    };
    let mesh = result.with_context(|| format!("cannot tetrahedralise `{}`", args.model.display()))?;
    let seconds = start.elapsed().as_secs_f64();
    io::write_tets(&args.output, &mesh)?;
    let report = TetSummary {
        model: (&args.model).into(),
        output: (&args.output).into(),
        mesher,
        vertices: mesh.vertices().len(),
        tets: mesh.tets().len(),
        volume: mesh.volume(),
        surface_volume: solidmap::check::repair(&surface).0.volume(),
        seconds,
    };
    output.result(&report, || {
        two_columns(vec![
            [
                "tets".into(),
                format!("{} with {} vertices, in {seconds:.2} s", report.tets, report.vertices),
            ],
            [
                "volume".into(),
                format!(
                    "{} (surface {})",
                    significant(report.volume, 7),
                    significant(report.surface_volume, 7)
                ),
            ],
            ["written".into(), report.output.display().to_string()],
        ])
    })?;
    Ok(CommandOutcome::Done)
}

//! `solidmap tet` and `solidmap offset`: what CGAL and TetGen do, and the process that they do it in.

use std::path::PathBuf;
use std::time::Instant;

use crate::drawing::significant;
use anyhow::Context;
use serde::Serialize;
use solidmap::cgal_tetgen::{self, Isolation, Mesh3Options, OffsetOptions, TetOptions};
use solidmap::io;

use super::args::{Cli, Command, Mesher, OffsetArgs, TetArgs};
use super::output::{Output, pairs};
use super::{Outcome, input};

/// From now on CGAL and TetGen run in a process of their own. The processes of `compare` are that already.
pub fn isolate(cli: &Cli) -> anyhow::Result<()> {
    if matches!(cli.command, Command::CompareWorker(_)) {
        return Ok(());
    }
    let program = std::env::current_exe().context("cannot find the program itself, to run CGAL and TetGen in it")?;
    let threads = cli.threads.map(|n| ["--threads".to_owned(), n.to_string()]);
    cgal_tetgen::isolate(Some(Isolation {
        program,
        arguments: threads.into_iter().flatten().chain(["native-worker".into()]).collect(),
        time_limit: None,
    }));
    Ok(())
}

/// The other side of [`isolate`].
pub fn serve() -> anyhow::Result<()> {
    cgal_tetgen::serve_calls().context("`native-worker` is for solidmap itself: it serves the process that starts it")
}

/// What `tet --json` prints.
#[derive(Serialize)]
struct TetReport {
    model: PathBuf,
    output: PathBuf,
    mesher: &'static str,
    vertices: usize,
    tets: usize,
    volume: f64,
    surface_volume: f64,
    seconds: f64,
}

/// Fills a surface with tetrahedra.
pub fn tet(args: &TetArgs, output: &Output) -> anyhow::Result<Outcome> {
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
            // A regular tetrahedron of circumradius r has the volume 8√3/27 r³.
            let cell_size = args.max_volume.map(|v| (v * 27.0 / (8.0 * 3f64.sqrt())).cbrt());
            let options = Mesh3Options {
                cell_size,
                memory,
                ..Mesh3Options::default()
            };
            ("cgal", cgal_tetgen::tetrahedralize_mesh3(&surface, &options))
        }
    };
    let mesh = result.with_context(|| format!("cannot tetrahedralise `{}`", args.model.display()))?;
    let seconds = start.elapsed().as_secs_f64();
    io::write_tets(&args.output, &mesh)?;
    let report = TetReport {
        model: args.model.clone(),
        output: args.output.clone(),
        mesher,
        vertices: mesh.vertices().len(),
        tets: mesh.tets().len(),
        volume: mesh.volume(),
        surface_volume: solidmap::check::repair(&surface).0.volume(),
        seconds,
    };
    output.result(&report, || {
        pairs(vec![
            [
                "tets".into(),
                format!("{} over {} vertices, in {seconds:.2} s", report.tets, report.vertices),
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
    Ok(Outcome::Done)
}

/// What `offset --json` prints.
#[derive(Serialize)]
struct OffsetReport {
    model: PathBuf,
    output: PathBuf,
    distance: f64,
    vertices: usize,
    triangles: usize,
    vertex_error: f64,
    centroid_error: f64,
    min_distance: f64,
    genus: usize,
    model_genus: Option<usize>,
    components: usize,
    raw_wrap: bool,
    seconds: f64,
}

/// Makes the surface at a distance.
pub fn offset(args: &OffsetArgs, output: &Output) -> anyhow::Result<Outcome> {
    input::require_writable(
        &args.output,
        &["obj", "ply", "off", "mesh", "vtk", "vtu"],
        &[&args.model],
    )?;
    output.progress("reading");
    let surface = input::read_surface(&args.model)?;
    let distance = if args.relative {
        args.distance * surface.diagonal()
    } else {
        args.distance
    };
    output.progress("wrapping");
    let start = Instant::now();
    let offset = cgal_tetgen::offset_surface(&surface, distance, &OffsetOptions::default())
        .with_context(|| format!("cannot offset `{}`", args.model.display()))?;
    let seconds = start.elapsed().as_secs_f64();
    io::write_surface(&args.output, &offset.mesh)?;
    if offset.raw_wrap {
        output.warn("no smoothed surface passed its checks; the wrap as it came is about 1 % off the distance");
    }
    if offset.model_genus.is_some_and(|genus| genus != offset.genus) {
        output.warn("the offset has another genus than the model: its distance, or its resolution, closes holes");
    }
    let report = OffsetReport {
        model: args.model.clone(),
        output: args.output.clone(),
        distance,
        vertices: offset.mesh.vertices().len(),
        triangles: offset.mesh.triangles().len(),
        vertex_error: offset.vertex_error,
        centroid_error: offset.centroid_error,
        min_distance: offset.min_distance,
        genus: offset.genus,
        model_genus: offset.model_genus,
        components: offset.components,
        raw_wrap: offset.raw_wrap,
        seconds,
    };
    output.result(&report, || {
        pairs(vec![
            [
                "offset".into(),
                format!("{} triangles at {distance:.6}, in {seconds:.2} s", report.triangles),
            ],
            [
                "error".into(),
                format!(
                    "{:.2e} at vertices, {:.2e} at centroids",
                    report.vertex_error, report.centroid_error
                ),
            ],
            [
                "genus".into(),
                format!("{} in {} component(s)", report.genus, report.components),
            ],
            ["written".into(), report.output.display().to_string()],
        ])
    })?;
    Ok(Outcome::Done)
}

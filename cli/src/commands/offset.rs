//! `solidmap offset`: the surface at a distance from a model.

use std::time::Instant;

use anyhow::Context;
use serde::Serialize;
use solidmap::cgal_tetgen::{self, OffsetOptions};
use solidmap::io;

use crate::CommandOutcome;
use crate::args::OffsetArgs;
use crate::shared::input;
use crate::shared::json::FileName;
use crate::shared::output::{Output, two_columns};

/// What `offset --json` prints.
#[derive(Serialize)]
struct OffsetSummary {
    model: FileName,
    output: FileName,
    distance: f64,
    vertices: usize,
    faces: usize,
    vertex_error: f64,
    centroid_error: f64,
    min_distance: f64,
    genus: usize,
    model_genus: Option<usize>,
    components: usize,
    raw_wrap: bool,
    #[serde(serialize_with = "crate::shared::json::total_seconds")]
    seconds: f64,
}

/// Makes and writes the surface.
pub fn run(args: &OffsetArgs, output: &Output) -> anyhow::Result<CommandOutcome> {
    input::require_writable(
        &args.output,
        &["obj", "ply", "off", "stl", "mesh", "msh", "vtk", "vtu"],
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
        output
            .warn("no smoothed surface passed its checks; the unsmoothed one, about 1 % off the distance, was written");
    }
    if offset.model_genus.is_some_and(|genus| genus != offset.genus) {
        output.warn(
            "the offset surface has another genus than the model: the distance, or the resolution of the wrap, closes \
             holes",
        );
    }
    let report = OffsetSummary {
        model: (&args.model).into(),
        output: (&args.output).into(),
        distance,
        vertices: offset.mesh.vertices().len(),
        faces: offset.mesh.triangles().len(),
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
        two_columns(vec![
            [
                "offset".into(),
                format!("{} triangles at {distance:.6}, in {seconds:.2} s", report.faces),
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
    Ok(CommandOutcome::Done)
}

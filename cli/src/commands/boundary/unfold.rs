//! `solidmap boundary unfold`: a surface with handles laid out in the plane.

use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::Context;
use serde::Serialize;
use solidmap::Point;
use solidmap::boundary_map::{SurfaceDistortion, fundamental_domain};
use solidmap::io;

use super::pictures;
use super::unfold_page::UnfoldPage;
use crate::CommandOutcome;
use crate::args::BoundaryUnfoldArgs;
use crate::drawing::significant;
use crate::shared::input;
use crate::shared::json::{FileName, file_name};
use crate::shared::output::{Output, two_columns, write_file, written_row};
use crate::shared::page;

/// What `boundary unfold --json` prints.
#[derive(Serialize)]
struct UnfoldSummary {
    model: FileName,
    vertices: usize,
    faces: usize,
    layout: Option<FileName>,
    png: Option<FileName>,
    page: Option<FileName>,
    genus: u64,
    /// Sides of the polygon.
    sides: usize,
    /// Vertices of the layout.
    layout_vertices: usize,
    /// Ratio of the stretches of the triangles, 1 where angles are kept: over half and 99 % of the area.
    angle_p50: f64,
    angle_p99: f64,
    #[serde(serialize_with = "crate::shared::json::total_seconds")]
    seconds: f64,
}

/// Lays out, measures and writes.
pub fn run(args: &BoundaryUnfoldArgs, output: &Output) -> anyhow::Result<CommandOutcome> {
    let start = Instant::now();
    let outputs: [(Option<&PathBuf>, &[&str]); 3] = [
        (args.output.as_ref(), &["obj", "ply", "off"]),
        (args.png.as_ref(), &["png"]),
        (args.html.as_ref(), &page::EXTENSIONS),
    ];
    let inputs: [&Path; 1] = [&args.model];
    input::require_all_writable(&outputs, &inputs)?;
    output.progress("reading");
    let surface = input::read_surface(&args.model)?;
    output.progress("laying out");
    let domain = fundamental_domain(&surface).with_context(|| format!("cannot unfold `{}`", args.model.display()))?;
    let (layout, origins) = domain.mesh();
    let points = domain.surface.vertices();
    let cut: Vec<Point> = origins.iter().map(|&vertex| points[vertex as usize]).collect();
    let cut = layout
        .with_vertices(cut)
        .context("a vertex of the layout has no origin")?;
    let distortion = SurfaceDistortion::of(&cut, layout.vertices()).context("the model has no area")?;
    let [angle_p50, angle_p99] = [distortion.angle.p50, distortion.angle.p99];
    output.progress("writing");
    if let Some(path) = &args.output {
        io::write_surface(path, &layout)?;
    }
    if let Some(path) = &args.png {
        write_file(path, &pictures::unfolded(&domain, args.up)?.to_png()?)?;
    }
    if let Some(path) = &args.html {
        let made = UnfoldPage {
            path: &args.model,
            domain: &domain,
            cut: &cut,
            layout: &layout,
            angles: [angle_p50, angle_p99],
            up: args.up,
        };
        page::write(path, &made.html(&args.page)?)?;
    }
    let report = UnfoldSummary {
        model: (&args.model).into(),
        vertices: domain.surface.vertices().len(),
        faces: domain.surface.triangles().len(),
        layout: file_name(args.output.as_ref()),
        png: file_name(args.png.as_ref()),
        page: file_name(args.html.as_ref()),
        genus: domain.genus,
        sides: domain.sides.len(),
        layout_vertices: layout.vertices().len(),
        angle_p50,
        angle_p99,
        seconds: start.elapsed().as_secs_f64(),
    };
    output.result(&report, || summary(&report))?;
    Ok(CommandOutcome::Done)
}

fn summary(report: &UnfoldSummary) -> String {
    let polygon = match report.genus {
        1 => "a parallelogram of area 1, opposite sides glued".into(),
        genus => format!(
            "a polygon of {} sides in the hyperbolic disk, glued in pairs: genus {genus}",
            report.sides
        ),
    };
    two_columns(vec![
        [
            "surface".into(),
            format!("{} vertices, {} triangles", report.vertices, report.faces),
        ],
        ["laid out in".into(), polygon],
        [
            "angles".into(),
            format!(
                "σ₁/σ₂ {} over half of the area, {} over 99 % of it; 1 where angles are kept",
                significant(report.angle_p50, 4),
                significant(report.angle_p99, 4)
            ),
        ],
        ["time".into(), format!("{:.1} s", report.seconds)],
        written_row([report.layout.as_ref(), report.png.as_ref(), report.page.as_ref()]),
    ])
}

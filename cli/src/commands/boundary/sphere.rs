//! `solidmap boundary sphere`: a surface of genus 0 mapped to the unit sphere, one to one.

use std::time::Instant;

use anyhow::Context;
use serde::Serialize;
use solidmap::boundary_map::{BoundaryMap, SurfaceDistortion};
use solidmap::spherical::{EmbeddingCheck, SphereEnergy, SphereOptions, SphereReport, SphereStart, check_embedding};

use super::write;
use crate::CommandOutcome;
use crate::args::{BoundarySphereArgs, SphereEnergyKind, SphereStartKind};
use crate::shared::json::{FileName, file_name};
use crate::shared::output::{Output, memory_row, peak_rss_bytes, two_columns};
use crate::shared::{boundary_map, input, interrupt};

/// What `boundary sphere --json` prints.
#[derive(Serialize)]
struct SphereSummary {
    model: FileName,
    vertices: usize,
    faces: usize,
    image: FileName,
    boundary_file: Option<FileName>,
    png: Option<FileName>,
    vtu: Option<FileName>,
    page: Option<FileName>,
    #[serde(flatten)]
    sphere: SphereReport,
    certificate: EmbeddingCheck,
    distortion: Option<SurfaceDistortion>,
    #[serde(serialize_with = "crate::shared::json::total_seconds")]
    seconds: f64,
    peak_rss_bytes: u64,
}

/// Maps, measures and writes.
pub fn run(args: &BoundarySphereArgs, output: &Output) -> anyhow::Result<CommandOutcome> {
    let start = Instant::now();
    args.outputs.require_writable(&[&args.model])?;
    output.progress("reading");
    let surface = input::read_surface(&args.model)?;
    let options = SphereOptions {
        energy: args.energy.into(),
        start: args.start.into(),
        ..SphereOptions::default()
    };
    let (map, sphere) = boundary_map::to_sphere(&surface, &args.model, &options, 1.0, output)?;
    if args.start == SphereStartKind::Flow && sphere.start != SphereStart::Flow {
        output.warn(
            "the flow folds this surface, or shrinks its limbs to specks; the progressive start was used instead",
        );
    }
    if !sphere.converged && !sphere.concluded {
        output.warn(format!(
            "the optimisation was stopped after {} iterations, before it converged; the map is one to one all the same",
            sphere.iterations
        ));
    }
    let certificate = check_embedding(map.surface().triangles(), map.directions());
    let boundary = BoundaryMap::onto_sphere(map).with_context(|| boundary_map::cannot_map(&args.model))?;
    output.progress("measuring");
    let distortion = SurfaceDistortion::of(boundary.domain(), boundary.image());
    output.progress("writing");
    write::outputs(
        &boundary,
        None,
        &args.outputs,
        &[("domain", &args.model)],
        args.outputs.up,
        output,
    )?;
    let report = SphereSummary {
        model: (&args.model).into(),
        vertices: boundary.domain().vertices().len(),
        faces: boundary.domain().triangles().len(),
        image: (&args.outputs.output).into(),
        boundary_file: file_name(args.outputs.boundary.as_ref()),
        png: file_name(args.outputs.png.as_ref()),
        vtu: file_name(args.outputs.vtu.as_ref()),
        page: file_name(args.outputs.html.as_ref()),
        sphere,
        certificate,
        distortion,
        seconds: start.elapsed().as_secs_f64(),
        peak_rss_bytes: peak_rss_bytes(),
    };
    output.result(&report, || summary(&report))?;
    if report.sphere.concluded {
        output.warn(interrupt::concluded("boundary map"));
        return Ok(CommandOutcome::CheckFailed);
    }
    Ok(CommandOutcome::Done)
}

fn summary(report: &SphereSummary) -> String {
    let sphere = &report.sphere;
    let mut rows = vec![
        [
            "surface".into(),
            format!("{} vertices, {} triangles", report.vertices, report.faces),
        ],
        [
            "one to one".into(),
            format!(
                "yes, decided exactly: {} flipped triangles, degree {:.6}",
                report.certificate.flipped, report.certificate.degree
            ),
        ],
        ["preserved".into(), preserved(sphere.energy).into()],
        [
            "energy".into(),
            format!(
                "{:.4} before, {:.4} after {} iterations of Newton's method; {} at best",
                sphere.energy_before,
                sphere.energy_after,
                sphere.iterations,
                least(sphere.energy)
            ),
        ],
        ["start".into(), start(sphere.start).into()],
        ["time".into(), format!("{:.2} s", report.seconds)],
        memory_row(report.peak_rss_bytes),
        ["image".into(), report.image.display().to_string()],
    ];
    for (name, path) in [
        ("boundary", &report.boundary_file),
        ("picture", &report.png),
        ("fields", &report.vtu),
        ("page", &report.page),
    ] {
        rows.extend(path.as_ref().map(|path| [name.into(), path.display().to_string()]));
    }
    let distortion = report.distortion.map_or(String::new(), |d| format!("\n\n{d}"));
    two_columns(rows) + &distortion
}

fn preserved(energy: SphereEnergy) -> &'static str {
    match energy {
        SphereEnergy::Balanced => "angles, with the distortion of areas bounded",
        SphereEnergy::Conformal => "angles",
    }
}

/// The energy of a map without distortion.
fn least(energy: SphereEnergy) -> &'static str {
    match energy {
        SphereEnergy::Balanced => "1.1",
        SphereEnergy::Conformal => "1",
    }
}

fn start(start: SphereStart) -> &'static str {
    match start {
        SphereStart::Progressive => "embedded level by level",
        SphereStart::Flow => "conformalised mean curvature flow",
    }
}

impl From<SphereEnergyKind> for SphereEnergy {
    fn from(kind: SphereEnergyKind) -> Self {
        match kind {
            SphereEnergyKind::Balanced => Self::Balanced,
            SphereEnergyKind::Conformal => Self::Conformal,
        }
    }
}

impl From<SphereStartKind> for SphereStart {
    fn from(kind: SphereStartKind) -> Self {
        match kind {
            SphereStartKind::Progressive => Self::Progressive,
            SphereStartKind::Flow => Self::Flow,
        }
    }
}

//! `solidmap boundary sphere`: a surface of genus 0 mapped to the unit sphere, one to one.

use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::Context;
use serde::Serialize;
use solidmap::boundary_map::{BoundaryMap, SurfaceDistortion};
use solidmap::mesh::SurfaceMesh;
use solidmap::spherical::{
    EmbeddingCheck, SphereEnergy, SphereOptions, SpherePhase, SphereReport, SphereStart, SphericalEmbedding,
    check_embedding, map_to_sphere,
};

use super::write;
use crate::args::{BoundarySphereArgs, SphereEnergyKind, SphereStartKind};
use crate::output::{Output, pairs, peak_rss_bytes};
use crate::{Outcome, input};

/// What `boundary sphere --json` prints.
#[derive(Serialize)]
struct Report {
    model: PathBuf,
    vertices: usize,
    faces: usize,
    image: PathBuf,
    boundary_file: Option<PathBuf>,
    png: Option<PathBuf>,
    vtu: Option<PathBuf>,
    #[serde(flatten)]
    sphere: SphereReport,
    certificate: EmbeddingCheck,
    distortion: Option<SurfaceDistortion>,
    seconds: f64,
    peak_rss_bytes: u64,
}

/// Maps, measures and writes.
pub fn run(args: &BoundarySphereArgs, output: &Output) -> anyhow::Result<Outcome> {
    let start = Instant::now();
    args.outputs.require_writable(&[&args.model])?;
    output.progress("reading");
    let surface = input::read_surface(&args.model)?;
    let options = SphereOptions {
        energy: args.energy.into(),
        start: args.start.into(),
        ..SphereOptions::default()
    };
    let (map, sphere) = map_with_progress(&surface, &args.model, &options, output)?;
    if args.start == SphereStartKind::Flow && sphere.start != SphereStart::Flow {
        output.warn("the flow folds this surface, or shrinks its limbs to specks; the progressive start was taken");
    }
    if !sphere.converged {
        output.warn(format!(
            "the optimisation was ended after {} iterations; the map is one to one all the same",
            sphere.iterations
        ));
    }
    let certificate = check_embedding(map.surface().triangles(), map.directions());
    let boundary = BoundaryMap::onto_sphere(map).with_context(|| cannot_map(&args.model))?;
    output.progress("measuring");
    let distortion = SurfaceDistortion::of(boundary.domain(), boundary.image());
    output.progress("writing");
    write::outputs(&boundary, &args.outputs, &[("domain", &args.model)], output)?;
    let report = Report {
        model: args.model.clone(),
        vertices: boundary.domain().vertices().len(),
        faces: boundary.domain().triangles().len(),
        image: args.outputs.output.clone(),
        boundary_file: args.outputs.boundary.clone(),
        png: args.outputs.png.clone(),
        vtu: args.outputs.vtu.clone(),
        sphere,
        certificate,
        distortion,
        seconds: start.elapsed().as_secs_f64(),
        peak_rss_bytes: peak_rss_bytes(),
    };
    output.result(&report, || summary(&report))?;
    Ok(Outcome::Done)
}

/// The map of a model to the sphere, with the phases shown.
pub fn map_with_progress(
    surface: &SurfaceMesh,
    model: &Path,
    options: &SphereOptions,
    output: &Output,
) -> anyhow::Result<(SphericalEmbedding, SphereReport)> {
    let progress = |phase| match phase {
        SpherePhase::Coarsening => output.progress("coarsening"),
        SpherePhase::Embedding { vertices, total } => output.progress_of("drawing on the sphere", vertices, total),
        SpherePhase::Flowing => output.progress("flowing to the sphere"),
        SpherePhase::Optimising => output.progress("optimising"),
    };
    map_to_sphere(surface, options, &progress).with_context(|| cannot_map(model))
}

fn cannot_map(model: &Path) -> String {
    format!("cannot map `{}` to the sphere", model.display())
}

fn summary(report: &Report) -> String {
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
        ["kept".into(), kept(sphere.energy).into()],
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
        [
            "memory".into(),
            format!("{:.0} MiB at most", report.peak_rss_bytes as f64 / 1_048_576.0),
        ],
        ["image".into(), report.image.display().to_string()],
    ];
    for (name, path) in [
        ("boundary", &report.boundary_file),
        ("picture", &report.png),
        ("fields", &report.vtu),
    ] {
        rows.extend(path.as_ref().map(|path| [name.into(), path.display().to_string()]));
    }
    let distortion = report.distortion.map_or(String::new(), |d| format!("\n\n{d}"));
    pairs(rows) + &distortion
}

fn kept(energy: SphereEnergy) -> &'static str {
    match energy {
        SphereEnergy::Balanced => "angles, with areas in bounds",
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
        SphereStart::Progressive => "drawn level by level",
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

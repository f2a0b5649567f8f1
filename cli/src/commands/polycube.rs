//! `solidmap polycube`: a polycube of a model, with the model's triangles.

use std::cell::Cell;
use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::Context;
use serde::Serialize;
use solidmap::io;
use solidmap::mesh::TetMesh;
use solidmap::polycube::{
    LabelSource, MakePolycubeError, PolycubeMap, PolycubeOptions, PolycubePhase, PolycubeReport, make_polycube,
};

use crate::CommandOutcome;
use crate::args::PolycubeArgs;
use crate::shared::bijective::own_tets;
use crate::shared::input;
use crate::shared::json::{FileName, file_name};
use crate::shared::output::{Output, memory_row, peak_rss_bytes, two_columns};

/// What `polycube --json` prints.
#[derive(Serialize)]
struct Summary {
    model: FileName,
    /// None where no polycube was found.
    output: Option<FileName>,
    image: Option<FileName>,
    tets: Option<FileName>,
    model_tets: Option<FileName>,
    /// Why no polycube was found.
    problem: Option<String>,
    polycube: Option<PolycubeReport>,
    #[serde(serialize_with = "crate::shared::json::total_seconds")]
    seconds: f64,
    peak_rss_bytes: u64,
}

/// Makes the polycube, and writes it and the model.
pub fn run(args: &PolycubeArgs, output: &Output) -> anyhow::Result<CommandOutcome> {
    let (surface, tets): (&[&str], &[&str]) = (&["obj", "ply"], &["mesh", "vtk", "vtu"]);
    let outputs: [(Option<&PathBuf>, &[&str]); 4] = [
        (Some(&args.output), surface),
        (Some(&args.image), surface),
        (args.tets.as_ref(), tets),
        (args.model_tets.as_ref(), tets),
    ];
    input::require_all_writable(&outputs, &[&args.model])?;
    output.progress("reading");
    let start = Instant::now();
    let mesh = tetrahedra(&args.model, output)?;
    let options = PolycubeOptions {
        smoothness: args.smoothness.unwrap_or(PolycubeOptions::default().smoothness),
        ..PolycubeOptions::default()
    };
    let attempt = Cell::new(1);
    let show = |phase| show_phase(phase, &attempt, output);
    let (found, problem) = match make_polycube(&mesh, &options, &show) {
        Ok(found) => (Some(found), None),
        Err(error @ MakePolycubeError::NotFound { .. }) => (None, Some(error.to_string())),
        Err(error) => return Err(error).with_context(|| format!("cannot use `{}`", args.model.display())),
    };
    let seconds = start.elapsed().as_secs_f64();
    match (&found, &problem) {
        (Some(found), _) => write(found, args, output)?,
        (None, Some(problem)) => output.warn(format!("nothing was written: {problem}")),
        (None, None) => {}
    }
    let is_written = found.is_some();
    let written = |file: Option<&PathBuf>| file_name(file.filter(|_| is_written));
    let report = Summary {
        model: (&args.model).into(),
        output: written(Some(&args.output)),
        image: written(Some(&args.image)),
        tets: written(args.tets.as_ref()),
        model_tets: written(args.model_tets.as_ref()),
        problem,
        polycube: found.map(|found| found.report),
        seconds,
        peak_rss_bytes: peak_rss_bytes(),
    };
    output.result(&report, || two_columns(rows(&report)))?;
    Ok(CommandOutcome::from_check(is_written))
}

/// The model's own tetrahedra, or TetGen's.
fn tetrahedra(model: &Path, output: &Output) -> anyhow::Result<TetMesh> {
    let solid = input::read_solid(model)?;
    if let Some(mesh) = own_tets(solid)? {
        return Ok(mesh);
    }
    output.progress("tetrahedralising");
    filled(model).with_context(|| format!("cannot fill `{}` with tetrahedra", model.display()))
}

#[cfg(feature = "native")]
fn filled(model: &Path) -> anyhow::Result<TetMesh> {
    use solidmap::cgal_tetgen::{TetOptions, tetrahedralize};
    let options = TetOptions {
        memory: input::most_memory(),
        ..TetOptions::default()
    };
    Ok(tetrahedralize(&input::read_surface(model)?, &options)?)
}

#[cfg(not(feature = "native"))]
fn filled(_: &Path) -> anyhow::Result<TetMesh> {
    anyhow::bail!("it needs TetGen, and this solidmap was built without it; give a tet mesh in place of its surface")
}

fn show_phase(phase: PolycubePhase, attempt: &Cell<usize>, output: &Output) {
    match phase {
        PolycubePhase::Attempting { attempt: number } => attempt.set(number),
        PolycubePhase::Labelling { round } => {
            output.progress_in("directions", format!("attempt {}, round {round} of 4", attempt.get()));
        }
        PolycubePhase::Deforming { inverted } => {
            output.progress_in("deforming", format!("attempt {}, {inverted} inverted", attempt.get()));
        }
    }
}

fn write(found: &PolycubeMap, args: &PolycubeArgs, output: &Output) -> anyhow::Result<()> {
    output.progress("writing");
    let [polycube, model] = found.surfaces();
    io::write_surface(&args.output, &polycube)?;
    io::write_surface(&args.image, &model)?;
    for (file, mesh) in [(&args.tets, &found.polycube), (&args.model_tets, &found.model)] {
        if let Some(file) = file {
            io::write_tets(file, mesh)?;
        }
    }
    Ok(())
}

fn rows(report: &Summary) -> Vec<[String; 2]> {
    let mut rows = vec![];
    if let Some(found) = &report.polycube {
        let directions = match found.labels {
            LabelSource::Cut => format!("graph cut with smoothness {}", found.smoothness),
            LabelSource::Sphere => "from the map to the sphere: no cut led to a polycube".into(),
        };
        let [x, y, z] = found.planes;
        rows.push(["directions".into(), format!("{directions}, attempt {}", found.attempts)]);
        rows.push([
            "polycube".into(),
            format!(
                "{} charts, {} corners, {x}, {y} and {z} planes across x, y and z",
                found.charts, found.corners
            ),
        ]);
        rows.push([
            "tets".into(),
            format!(
                "{}, {} of them by splitting; none inverted, no triangle against its direction, decided exactly",
                found.tets,
                found.tets - found.tets_given
            ),
        ]);
        if let Some(distortion) = &found.distortion {
            let of =
                |q: &solidmap::boundary_map::DistortionQuantiles| format!("{:.2}, {:.2}, {:.2}", q.p50, q.p90, q.p99);
            rows.push([
                "distortion".into(),
                format!(
                    "ratio of stretches {}, of areas {} (50, 90 and 99 % of the area)",
                    of(&distortion.angle),
                    of(&distortion.area)
                ),
            ]);
        }
    }
    rows.push(["time".into(), format!("{:.1} s", report.seconds)]);
    rows.push(memory_row(report.peak_rss_bytes));
    let files = [&report.output, &report.image, &report.tets, &report.model_tets];
    let files: Vec<String> = files
        .into_iter()
        .flatten()
        .map(|file| file.display().to_string())
        .collect();
    if !files.is_empty() {
        rows.push(["written".into(), files.join(", ")]);
    }
    rows
}

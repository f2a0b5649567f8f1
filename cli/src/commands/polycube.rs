//! `solidmap polycube`: a polycube of a model, with the model's triangles.

use std::cell::Cell;
use std::iter;
use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::Context;
use serde::Serialize;
use solidmap::io;
use solidmap::polycube::{
    MakePolycubeError, PolycubeMap, PolycubeOptions, PolycubeReport, make_polycube, make_polycube_with_labels,
};
use solidmap::remesh::CellSize;

use crate::CommandOutcome;
use crate::args::PolycubeArgs;
use crate::shared::input;
use crate::shared::json::{FileName, file_name};
use crate::shared::output::{Output, memory_row, peak_rss_bytes, two_columns, written_row};
use crate::shared::polycubes::{self, Model, model, show_phase};

/// What `polycube --json` prints.
#[derive(Serialize)]
struct Summary {
    model: FileName,
    /// None where no polycube was found.
    output: Option<FileName>,
    image: Option<FileName>,
    tets: Option<FileName>,
    model_tets: Option<FileName>,
    labels: Option<FileName>,
    model_labels: Option<FileName>,
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
    let outputs: [(Option<&PathBuf>, &[&str]); 6] = [
        (Some(&args.output), surface),
        (Some(&args.image), surface),
        (args.tets.as_ref(), tets),
        (args.model_tets.as_ref(), tets),
        (args.write_labels.as_ref(), &[]),
        (args.write_model_labels.as_ref(), &[]),
    ];
    let inputs: Vec<&Path> = iter::once(&args.model)
        .chain(&args.labels)
        .map(PathBuf::as_path)
        .collect();
    input::require_all_writable(&outputs, &inputs)?;
    output.progress("reading");
    let start = Instant::now();
    let Model { mesh, triangles } = model(&args.model, output)?;
    let options = PolycubeOptions {
        smoothness: args.smoothness.smoothness,
        lattice: args.lattice.map(CellSize::Length),
        orientation: args.orient.into(),
        ..PolycubeOptions::default()
    };
    let attempt = Cell::new(1);
    let show = |phase| show_phase(phase, &attempt, output);
    let labels = args
        .labels
        .as_ref()
        .map(|file| read_labels(file, &triangles, &args.model));
    let made = match labels.transpose()? {
        Some(labels) => make_polycube_with_labels(&mesh, &labels, &options, &show),
        None => make_polycube(&mesh, &options, &show),
    };
    let (found, problem) = match made {
        Ok(found) => (Some(found), None),
        Err(error @ (MakePolycubeError::NotFound { .. } | MakePolycubeError::NoLabels)) => {
            (None, Some(error.to_string()))
        }
        Err(error) => return Err(unusable(error, args)),
    };
    let seconds = start.elapsed().as_secs_f64();
    match (&found, &problem) {
        (Some(found), _) => write(found, &triangles, args, output)?,
        (None, Some(problem)) => output.warn(format!("nothing was written: {problem}")),
        (None, None) => {}
    }
    let is_written = found.is_some();
    let is_on_lattice = args.lattice.is_none() || found.as_ref().is_some_and(|found| found.report.lattice.is_some());
    if is_written && !is_on_lattice {
        output.warn(
            "no polycube was found with its planes on this lattice; one that is not on it was written. Smaller cells of the \
             lattice may help",
        );
    }
    let written = |file: Option<&PathBuf>| file_name(file.filter(|_| is_written));
    let report = Summary {
        model: (&args.model).into(),
        output: written(Some(&args.output)),
        image: written(Some(&args.image)),
        tets: written(args.tets.as_ref()),
        model_tets: written(args.model_tets.as_ref()),
        labels: written(args.write_labels.as_ref()),
        model_labels: written(args.write_model_labels.as_ref()),
        problem,
        polycube: found.map(|found| found.report),
        seconds,
        peak_rss_bytes: peak_rss_bytes(),
    };
    output.result(&report, || two_columns(rows(&report)))?;
    Ok(CommandOutcome::from_check(is_written && is_on_lattice))
}

/// Labels of the model's triangles.
fn read_labels(file: &Path, triangles: &[[u32; 3]], model: &Path) -> anyhow::Result<Vec<([u32; 3], u8)>> {
    let labels = io::read_triangle_labels(file, triangles.len());
    let labels = labels.with_context(|| format!("cannot use the labels for `{}`", model.display()))?;
    Ok(triangles.iter().copied().zip(labels).collect())
}

/// The error for a model, or for labels, that cannot be used.
fn unusable(error: MakePolycubeError, args: &PolycubeArgs) -> anyhow::Error {
    let file = match (&error, &args.labels) {
        // There is a line for each triangle.
        (MakePolycubeError::Labels { triangle, .. }, Some(labels)) => {
            format!("cannot use line {} of `{}`", triangle + 1, labels.display())
        }
        (MakePolycubeError::MirroredLabels, Some(labels)) => format!("cannot use `{}`", labels.display()),
        _ => format!("cannot use `{}`", args.model.display()),
    };
    anyhow::Error::new(error).context(file)
}

fn write(found: &PolycubeMap, triangles: &[[u32; 3]], args: &PolycubeArgs, output: &Output) -> anyhow::Result<()> {
    output.progress("writing");
    let [polycube, model] = found.surfaces();
    io::write_surface(&args.output, &polycube)?;
    io::write_surface(&args.image, &model)?;
    for (file, mesh) in [(&args.tets, &found.polycube), (&args.model_tets, &found.model)] {
        if let Some(file) = file {
            io::write_tets(file, mesh)?;
        }
    }
    if let Some(file) = &args.write_labels {
        io::write_triangle_labels(file, &found.labels)?;
    }
    if let Some(file) = &args.write_model_labels {
        let labels = polycubes::in_order_of(&found.given_labels, triangles);
        io::write_triangle_labels(file, &labels)?;
    }
    Ok(())
}

fn rows(report: &Summary) -> Vec<[String; 2]> {
    let mut rows = report.polycube.as_ref().map_or(vec![], polycubes::rows);
    rows.push(["time".into(), format!("{:.1} s", report.seconds)]);
    rows.push(memory_row(report.peak_rss_bytes));
    if report.output.is_some() {
        let files = [
            &report.output,
            &report.image,
            &report.tets,
            &report.model_tets,
            &report.labels,
            &report.model_labels,
        ];
        rows.push(written_row(files.map(Option::as_ref)));
    }
    rows
}

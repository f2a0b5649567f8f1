//! `solidmap polycube`: a polycube of a model, with the model's triangles.

use std::cell::Cell;
use std::iter;
use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::Context;
use serde::Serialize;
use solidmap::files;
use solidmap::io::{self, Cells, Field, VtkFields};
use solidmap::mesh::TetMesh;
use solidmap::polycube::{
    BadPlace, BestAttempt, MakePolycubeError, PolycubeMap, PolycubeOptions, PolycubeReport, make_polycube,
    make_polycube_with_labels,
};
use solidmap::remesh::CellSize;
use solidmap::spherical::require_genus_0;

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
    /// None where a polycube was found, or no attempt came to tetrahedra.
    best_attempt: Option<FileName>,
    /// Why no polycube was found.
    problem: Option<String>,
    /// Where it has bad cells.
    bad_places: Vec<BadPlace>,
    polycube: Option<PolycubeReport>,
    #[serde(serialize_with = "crate::shared::json::total_seconds")]
    seconds: f64,
    peak_rss_bytes: u64,
}

/// Makes the polycube, and writes it and the model.
pub fn run(args: &PolycubeArgs, output: &Output) -> anyhow::Result<CommandOutcome> {
    let (surface, tets): (&[&str], &[&str]) = (&["obj", "ply"], &["mesh", "vtk", "vtu"]);
    let outputs: [(Option<&PathBuf>, &[&str]); 7] = [
        (Some(&args.output), surface),
        (Some(&args.image), surface),
        (args.tets.as_ref(), tets),
        (args.model_tets.as_ref(), tets),
        (args.best_attempt.as_ref(), &["vtu", "vtk"]),
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
        orientation: args.orient.orient.into(),
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
    let (found, failed) = match made {
        Ok(found) => (Some(found), None),
        Err(error @ (MakePolycubeError::NotFound { .. } | MakePolycubeError::NoLabels)) => (None, Some(error)),
        Err(error) => return Err(unusable(error, args)),
    };
    let seconds = start.elapsed().as_secs_f64();
    let problem = failed.as_ref().map(|error| problem(error, &mesh));
    let best = match &failed {
        Some(MakePolycubeError::NotFound { best, .. }) => Some(best.as_ref()),
        _ => None,
    };
    let best_attempt = args.best_attempt.as_ref().filter(|_| best.is_some());
    if let Some(found) = &found {
        write(found, &triangles, args, output)?;
    }
    if let Some((file, best)) = best_attempt.zip(best) {
        write_attempt(file, best)?;
    }
    if let Some(problem) = &problem {
        let written = match (best_attempt, &args.best_attempt) {
            (Some(file), _) => format!("only the best attempt was written, to `{}`", file.display()),
            (None, Some(_)) => "nothing was written, as no attempt came to tetrahedra".into(),
            (None, None) => "nothing was written".into(),
        };
        output.warn(format!("{written}: {problem}"));
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
        best_attempt: file_name(best_attempt),
        problem,
        bad_places: best.map(|best| best.places.clone()).unwrap_or_default(),
        polycube: found.map(|found| found.report),
        seconds,
        peak_rss_bytes: peak_rss_bytes(),
    };
    output.result(&report, || two_columns(rows(&report)))?;
    Ok(CommandOutcome::from_check(is_written && is_on_lattice))
}

/// Why no polycube was found, and what can be done.
fn problem(error: &MakePolycubeError, model: &TetMesh) -> String {
    // A model without handles has another kind of polycube.
    match require_genus_0(&model.boundary().surface) {
        Ok(_) => format!("{error}. `solidmap hexmesh --polycube voxels` makes hexahedra of this model all the same"),
        Err(_) => error.to_string(),
    }
}

fn write_attempt(file: &Path, best: &BestAttempt) -> anyhow::Result<()> {
    let fields = VtkFields {
        point: vec![Field::positions("model", best.model.vertices())],
        cell: files::attempt_fields(best),
        ..VtkFields::default()
    };
    let (points, cells) = (best.polycube.vertices(), Cells::Tets(best.polycube.tets()));
    Ok(files::write_fields(file, points, cells, &fields)?)
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
        let labels = found.given_labels_of(triangles);
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

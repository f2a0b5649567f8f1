//! `solidmap polycube`: a polycube of a model, with the model's triangles.

use std::cell::Cell;
use std::iter;
use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context, ensure};
use serde::Serialize;
use solidmap::files;
use solidmap::io::{self, Cells, Field, VtkFields};
use solidmap::mesh::{SurfaceMesh, TetMesh};
use solidmap::model_polycube::{
    ModelPolycube, ModelPolycubeError, ModelPolycubeOptions, Polycube, PolycubeKind, VoxelReport, make_model_polycube,
};
use solidmap::polycube::{BadPlace, BestAttempt, MakePolycubeError, PolycubeOptions, make_polycube_with_labels};
use solidmap::remesh::CellSize;

use super::boundary::write;
use crate::CommandOutcome;
use crate::args::{BoundaryOutputs, PolycubeArgs};
use crate::drawing::significant;
use crate::shared::json::{FileName, file_name};
use crate::shared::output::{Output, memory_row, peak_rss_bytes, two_columns, written_row};
use crate::shared::polycubes::{Model, PolycubeSummary, model, show_deformation, show_phase};
use crate::shared::{input, page};

/// What `polycube --json` prints.
#[derive(Serialize)]
struct Summary {
    model: FileName,
    /// None where no polycube was found.
    output: Option<FileName>,
    image: Option<FileName>,
    boundary_file: Option<FileName>,
    tets: Option<FileName>,
    model_tets: Option<FileName>,
    labels: Option<FileName>,
    model_labels: Option<FileName>,
    png: Option<FileName>,
    page: Option<FileName>,
    /// None where a polycube was found, or no attempt came to tetrahedra.
    best_attempt: Option<FileName>,
    /// Why no polycube was found.
    problem: Option<String>,
    /// Where it has bad cells.
    bad_places: Vec<BadPlace>,
    #[serde(flatten)]
    found: PolycubeSummary,
    #[serde(serialize_with = "crate::shared::json::total_seconds")]
    seconds: f64,
    peak_rss_bytes: u64,
}

/// Makes the polycube, and writes it and the model.
pub fn run(args: &PolycubeArgs, output: &Output) -> anyhow::Result<CommandOutcome> {
    let (surface, tets): (&[&str], &[&str]) = (&["obj", "ply"], &["mesh", "vtk", "vtu"]);
    let outputs: [(Option<&PathBuf>, &[&str]); 10] = [
        (Some(&args.output), surface),
        (Some(&args.image), surface),
        (args.boundary.as_ref(), &["safetensors"]),
        (args.tets.as_ref(), tets),
        (args.model_tets.as_ref(), tets),
        (args.best_attempt.as_ref(), &["vtu", "vtk"]),
        (args.write_labels.as_ref(), &[]),
        (args.write_model_labels.as_ref(), &[]),
        (args.png.as_ref(), &["png"]),
        (args.html.as_ref(), &page::EXTENSIONS),
    ];
    let inputs: Vec<&Path> = iter::once(&args.model)
        .chain(&args.labels)
        .map(PathBuf::as_path)
        .collect();
    input::require_all_writable(&outputs, &inputs)?;
    output.progress("reading");
    let start = Instant::now();
    let Model { mesh, triangles } = model(&args.model, output)?;
    let attempt = Cell::new(1);
    let options = options(args)?;
    let made = match &args.labels {
        Some(file) => {
            let labels = read_labels(file, &triangles, &args.model)?;
            let show = |phase| show_deformation(phase, &attempt, output);
            let made = make_polycube_with_labels(&mesh, &labels, &options.deformation, &show);
            made.map_err(ModelPolycubeError::from)
                .and_then(|made| Ok(ModelPolycube::of_deformed(made)?))
        }
        None => make_model_polycube(&mesh, &options, &|phase| show_phase(phase, &attempt, output)),
    };
    let (found, failed) = match made {
        Ok(found) => (Some(found), None),
        Err(error) if error.is_without_polycube() => (None, Some(error)),
        Err(error) => return Err(unusable(error, args)),
    };
    let seconds = start.elapsed().as_secs_f64();
    let problem = failed
        .as_ref()
        .map(|error| problem(error, options.kind, args.labels.is_some()));
    let best = failed.as_ref().and_then(best_attempt_of);
    let best_attempt = args.best_attempt.as_ref().filter(|_| best.is_some());
    if let Some(found) = &found {
        write_all(found, &mesh, &triangles, args, output)?;
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
    let is_on_lattice = args.lattice.is_none() || found.as_ref().is_some_and(is_on_lattice);
    if is_written && !is_on_lattice {
        output.warn(
            "no polycube was found with its planes on this lattice; one that is not on it was written. Smaller cells of the \
             lattice may help",
        );
    }
    if let Some(Polycube::Voxels(_, report)) = found.as_ref().map(|found| &found.polycube) {
        poor_voxels(report).into_iter().for_each(|problem| output.warn(problem));
    }
    let written = |file: Option<&PathBuf>| file_name(file.filter(|_| is_written));
    let report = Summary {
        model: (&args.model).into(),
        output: written(Some(&args.output)),
        image: written(Some(&args.image)),
        boundary_file: written(args.boundary.as_ref()),
        tets: written(args.tets.as_ref()),
        model_tets: written(args.model_tets.as_ref()),
        labels: written(args.write_labels.as_ref()),
        model_labels: written(args.write_model_labels.as_ref()),
        png: written(args.png.as_ref()),
        page: written(args.html.as_ref()),
        best_attempt: file_name(best_attempt),
        problem,
        bad_places: best.map(|best| best.places.clone()).unwrap_or_default(),
        found: found.map_or(PolycubeSummary::default(), |found| PolycubeSummary::of(&found.polycube)),
        seconds,
        peak_rss_bytes: peak_rss_bytes(),
    };
    output.result(&report, || two_columns(rows(&report)))?;
    Ok(CommandOutcome::from_check(is_written && is_on_lattice))
}

/// The ratio of stretches, exceeded on 1 % of the area, above which a polycube of voxels is said to be poor. Of those in
/// `docs/polycubes.md` one has more, and no other more than 5.
const MOST_DISTORTED: f64 = 10.0;

/// The library's options: tetrahedra that are asked for are those of a deformation.
fn options(args: &PolycubeArgs) -> anyhow::Result<ModelPolycubeOptions> {
    let has_tets = args.tets.is_some() || args.model_tets.is_some();
    let kind = match args.polycube.into() {
        PolycubeKind::Auto if has_tets => PolycubeKind::Deformed,
        kind => kind,
    };
    ensure!(
        kind != PolycubeKind::Voxels || !has_tets,
        "a polycube of voxels has no tetrahedra; leave out --tets and --model-tets, or --polycube voxels"
    );
    Ok(ModelPolycubeOptions {
        kind,
        most_vertices: args.max_vertices,
        deformation: PolycubeOptions {
            smoothness: args.smoothness.smoothness,
            feature_angle: args.smoothness.features,
            lattice: args.lattice.map(CellSize::Length),
            orientation: args.orient.orient.into(),
            ..PolycubeOptions::default()
        },
    })
}

/// What is bad about a polycube of voxels, if anything.
fn poor_voxels(report: &VoxelReport) -> Vec<String> {
    let hint = "`--polycube deformed` makes more attempts at a deformation, which distorts less where it succeeds";
    let missed = (report.missed > 0).then(|| {
        format!(
            "{} vertices of the model are farther than a voxel from the polycube, so that thin parts may be missing. {hint}",
            report.missed
        )
    });
    let distorted = (report.distortion.angle.p99 > MOST_DISTORTED).then(|| {
        format!(
            "on 1 % of the area the map from the polycube stretches more than {} times as far along one direction as along the other: \
             cells carried there will be poor. {hint}",
            significant(report.distortion.angle.p99, 2)
        )
    });
    missed.into_iter().chain(distorted).collect()
}

/// Voxels are made on the lattice.
fn is_on_lattice(found: &ModelPolycube) -> bool {
    match &found.polycube {
        Polycube::Deformed(found, _) => found.report.lattice.is_some(),
        Polycube::Voxels(..) => true,
    }
}

/// Why no polycube was found, and what can be done.
fn problem(error: &ModelPolycubeError, kind: PolycubeKind, has_labels: bool) -> String {
    match error {
        ModelPolycubeError::Deformation(_) if has_labels => {
            format!("{error}. `--polycube voxels`, without labels, makes another kind of polycube")
        }
        ModelPolycubeError::Deformation(_) if kind == PolycubeKind::Deformed => {
            format!("{error}. `--polycube voxels` makes another kind of polycube")
        }
        ModelPolycubeError::Neither { .. } => {
            format!("{error}. `--polycube deformed` makes more attempts at a deformation")
        }
        _ => error.to_string(),
    }
}

fn best_attempt_of(error: &ModelPolycubeError) -> Option<&BestAttempt> {
    match error {
        ModelPolycubeError::Deformation(MakePolycubeError::NotFound { best, .. }) => Some(best),
        ModelPolycubeError::Neither { deformed, .. } => best_attempt_of(deformed),
        _ => None,
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
fn unusable(error: ModelPolycubeError, args: &PolycubeArgs) -> anyhow::Error {
    let file = match (&error, &args.labels) {
        // There is a line for each triangle.
        (ModelPolycubeError::Deformation(MakePolycubeError::Labels { triangle, .. }), Some(labels)) => {
            format!("cannot use line {} of `{}`", triangle + 1, labels.display())
        }
        (ModelPolycubeError::Deformation(MakePolycubeError::MirroredLabels), Some(labels)) => {
            format!("cannot use `{}`", labels.display())
        }
        (ModelPolycubeError::Voxels(_), _) => format!("cannot fill `{}` with voxels", args.model.display()),
        _ => format!("cannot use `{}`", args.model.display()),
    };
    anyhow::Error::new(error).context(file)
}

/// Writes what is asked for; `triangles` are those of the file by their nodes in `mesh`.
fn write_all(
    found: &ModelPolycube,
    mesh: &TetMesh,
    triangles: &[[u32; 3]],
    args: &PolycubeArgs,
    output: &Output,
) -> anyhow::Result<()> {
    output.progress("writing");
    let of_map = BoundaryOutputs {
        output: args.image.clone(),
        boundary: args.boundary.clone(),
        png: args.png.clone(),
        vtu: None,
        html: args.html.clone(),
        page: args.page,
        up: args.up,
    };
    write::outputs(
        &found.boundary,
        None,
        &of_map,
        &[("model", &args.model)],
        args.up,
        output,
    )?;
    io::write_surface(&args.output, found.boundary.domain())?;
    if let Polycube::Deformed(made, _) = &found.polycube {
        for (file, mesh) in [(&args.tets, &made.polycube), (&args.model_tets, &made.model)] {
            if let Some(file) = file {
                io::write_tets(file, mesh)?;
            }
        }
    }
    if let Some(file) = &args.write_labels {
        write_labels(file, &found.boundary.target(), &found.labels())?;
    }
    if let Some(file) = &args.write_model_labels {
        let labels = found.labels_of(mesh, triangles);
        let labels = labels.context("the model has triangles that are not on its boundary")?;
        write_labels(file, &surface_of(mesh, triangles)?, &labels)?;
    }
    Ok(())
}

/// Writes labels beside the surface where the file is one that holds surfaces, else alone.
fn write_labels(file: &Path, surface: &SurfaceMesh, labels: &[u8]) -> anyhow::Result<()> {
    if io::holds_labelled_surface(file) {
        io::write_labelled_surface(file, surface, labels)?;
    } else {
        io::write_triangle_labels(file, labels)?;
    }
    Ok(())
}

/// These triangles, by nodes of a mesh, without the other nodes.
fn surface_of(mesh: &TetMesh, triangles: &[[u32; 3]]) -> anyhow::Result<SurfaceMesh> {
    let mut used: Vec<u32> = triangles.iter().flatten().copied().collect();
    used.sort_unstable();
    used.dedup();
    let vertices = used.iter().map(|&v| mesh.vertices()[v as usize]).collect();
    let number = |v: u32| used.partition_point(|&w| w < v) as u32;
    Ok(SurfaceMesh::new(
        vertices,
        triangles.iter().map(|t| t.map(number)).collect(),
    )?)
}

fn rows(report: &Summary) -> Vec<[String; 2]> {
    let mut rows = report.found.rows();
    rows.push(["time".into(), format!("{:.1} s", report.seconds)]);
    rows.push(memory_row(report.peak_rss_bytes));
    if report.output.is_some() {
        let files = [
            &report.output,
            &report.image,
            &report.boundary_file,
            &report.tets,
            &report.model_tets,
            &report.labels,
            &report.model_labels,
            &report.png,
            &report.page,
        ];
        rows.push(written_row(files.map(Option::as_ref)));
    }
    rows
}

//! `solidmap eval --inverse`: preimages of points.

use std::path::Path;

use anyhow::{Context, bail};
use serde::Serialize;
use solidmap::inverse::{InverseOptions, InverseReport, Preimage};
use solidmap::io::{self, Field, SolidMesh, VtkEncoding, VtkFields};
use solidmap::{Matrix3, Point};

use super::JACOBIAN;
use crate::CommandOutcome;
use crate::args::EvalArgs;
use crate::shared::chosen_map::{ChosenInverse, ChosenMap, MapName};
use crate::shared::input::{self, extension};
use crate::shared::json::FileName;
use crate::shared::output::{Output, two_columns};
use crate::shared::points::{is_table, read_points, status_number, warn_of_preimages, write_table};

/// What `eval --inverse --json` prints.
#[derive(Serialize)]
struct InverseSummary {
    map: FileName,
    map_kind: MapName,
    output: FileName,
    #[serde(flatten)]
    inverse: InverseReport,
}

/// Finds the preimages of points, and writes them.
pub fn run(args: &EvalArgs, output: &Output) -> anyhow::Result<CommandOutcome> {
    output.progress("reading");
    let (file, boundary) = input::read_fitted_map(&args.map)?;
    let (solid, points) = read_points(&args.points)?;

    output.progress(format!("searching the preimages of {} points", points.len()));
    let options = InverseOptions {
        tolerance: args.tolerance,
        ..InverseOptions::default()
    };
    let chosen = ChosenMap::of(&file, &args.map, &args.choice)?;
    let inverse = ChosenInverse::of(chosen, &boundary, options);
    let (preimages, report) = inverse.prepared(&args.map)?.preimages(&points);
    if solid.is_some() && !is_table(&args.output) {
        require_status_if_incomplete(args, &preimages)?;
    }

    output.progress(format!("writing {}", args.output.display()));
    match &solid {
        Some(solid) if !is_table(&args.output) => write_mesh(&args.output, solid, &preimages)?,
        _ => {
            let places: Vec<Point> = preimages.iter().map(Preimage::position).collect();
            let jacobians = args.jacobian.then(|| inverse.map().jacobian(&places));
            write_preimages(&args.output, &points, &preimages, jacobians.as_deref())?;
        }
    }
    warn_of_preimages(output, &report);
    let complete = report.folded + report.not_converged == 0;
    let report = InverseSummary {
        map: (&args.map).into(),
        map_kind: chosen.name(),
        output: (&args.output).into(),
        inverse: report,
    };
    output.result(&report, || two_columns(rows(&report)))?;
    Ok(CommandOutcome::from_check(complete))
}

/// Refuses mesh formats that cannot say which vertices have no preimage.
fn require_status_if_incomplete(args: &EvalArgs, preimages: &[Preimage]) -> anyhow::Result<()> {
    let missing = preimages
        .iter()
        .filter(|preimage| !preimage.position().x.is_finite())
        .count();
    if missing > 0 && !["vtu", "vtk"].contains(&extension(&args.output).as_str()) {
        bail!(
            "{missing} of {} vertices of `{}` have no preimage, and `{}` cannot say which; write a .vtu, whose field \
             `status` names them",
            preimages.len(),
            args.points.display(),
            args.output.display()
        );
    }
    Ok(())
}

fn rows(report: &InverseSummary) -> Vec<[String; 2]> {
    let found = &report.inverse;
    let mut rows = vec![
        [
            "points".into(),
            match report.map_kind {
                MapName::Harmonic => format!(
                    "{} in {:.3} s ({:.3} s for the seed mesh, {} rounds)",
                    found.points, found.seconds, found.seed_seconds, found.iterations
                ),
                MapName::Bijective => format!("{} in {:.3} s, by point location", found.points, found.seconds),
            },
        ],
        ["ok".into(), found.ok.to_string()],
        [
            "folded".into(),
            format!("{} ({} with several preimages)", found.folded, found.several),
        ],
        ["outside".into(), found.outside.to_string()],
        ["not found".into(), found.not_converged.to_string()],
    ];
    if found.not_finite > 0 {
        rows.push(["not finite".into(), found.not_finite.to_string()]);
    }
    rows.push([
        "beyond boundary".into(),
        format!(
            "{} preimages, by {:.1e} of the domain's diagonal at most (boundary error {:.1e})",
            found.beyond_boundary, found.farthest_beyond, found.boundary_error
        ),
    ]);
    rows.push([
        "round trip".into(),
        format!(
            "{:.1e} max, {:.1e} rms of the target's diagonal",
            found.round_trip_max, found.round_trip_rms
        ),
    ]);
    rows.push(["written".into(), report.output.display().to_string()]);
    rows
}

/// CSV: the columns of `eval`, with status and round trip. NPY has no names: preimage, status, round trip.
fn write_preimages(
    path: &Path,
    points: &[Point],
    preimages: &[Preimage],
    jacobians: Option<&[Matrix3]>,
) -> anyhow::Result<()> {
    let csv = extension(path) == "csv";
    let mut names = vec!["x", "y", "z"];
    if csv {
        names.extend(["fx", "fy", "fz"]);
    }
    names.extend(["status", "round_trip"]);
    if jacobians.is_some() {
        names.extend(JACOBIAN);
    }
    let mut values = Vec::with_capacity(points.len() * names.len());
    for (p, (point, preimage)) in points.iter().zip(preimages).enumerate() {
        values.extend_from_slice(preimage.position().coords.as_slice());
        if csv {
            values.extend_from_slice(point.coords.as_slice());
        }
        values.extend([status_number(preimage), preimage.round_trip]);
        if let Some(all) = jacobians {
            // Matrices are stored by columns.
            values.extend_from_slice(all[p].transpose().as_slice());
        }
    }
    write_table(path, &names, &values)
}

/// The mesh with its vertices at their preimages. A vertex without one lies at the node of the seed mesh whose image is
/// nearest, and its status says so.
fn write_mesh(path: &Path, solid: &SolidMesh, preimages: &[Preimage]) -> anyhow::Result<()> {
    let places: Vec<Point> = preimages.iter().map(|preimage| preimage.point).collect();
    let cells = solid.elements();
    let field = |name: &str, value: fn(&Preimage) -> f64| Field::scalar(name, preimages.iter().map(value).collect());
    let fields = VtkFields {
        point: vec![
            field("status", status_number),
            field("round_trip", |preimage| preimage.round_trip),
        ],
        cell: vec![],
        ..VtkFields::default()
    };
    match extension(path).as_str() {
        "vtu" => io::write_vtu(path, &places, cells, &fields)?,
        "vtk" => io::write_vtk(path, &places, cells, &fields, VtkEncoding::Binary)?,
        _ => {
            let moved = solid.with_vertices(places);
            io::write_solid(path, &moved.context("another number of preimages than points")?)?;
        }
    }
    Ok(())
}

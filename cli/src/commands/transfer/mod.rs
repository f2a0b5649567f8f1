//! `solidmap transfer`: fields carried by a map, or evaluated at given points of its target.

mod checks;
mod fields;
mod picture;
mod summary;

use std::path::{Path, PathBuf};

use anyhow::Context;
use serde::Serialize;
use solidmap::Point;
use solidmap::boundary_map::BoundaryMap;
use solidmap::geometry::count_outside;
use solidmap::inverse::{Inverse, InverseOptions, InverseReport, Preimage};
use solidmap::io::{self, Field, SolidMesh};
use solidmap::map::VolumeMap;
use solidmap::mesh::CellList;
use solidmap::transfer::{FieldMesh, VolumeCheck, resample};

use crate::CommandOutcome;
use crate::args::TransferArgs;
use crate::shared::chosen_map::{ChosenInverse, ChosenMap, MapName};
use crate::shared::fields::{MeshWithFields, fields_of};
use crate::shared::input;
use crate::shared::json::{FileName, file_name};
use crate::shared::output::{Output, write_file};
use crate::shared::page;
use crate::shared::points::{is_table, read_points, status_number, warn_of_preimages};
use checks::{FieldSummary, TransferChecks};

/// What `transfer --json` prints.
#[derive(Serialize)]
struct TransferSummary {
    map: FileName,
    map_kind: MapName,
    output: FileName,
    picture: Option<FileName>,
    page: Option<FileName>,
    /// Points that carry the fields.
    points: usize,
    /// Tetrahedra between them.
    tets: usize,
    /// Hexahedra between them.
    hexes: usize,
    /// Points that got values: images, or those of `--at`.
    written_points: usize,
    /// Points without a finite image or without a preimage.
    without_value: usize,
    /// Points of FIELD outside the domain, where values of the map mean nothing. Not with `--at`.
    outside: Option<usize>,
    fields: Vec<FieldSummary>,
    volume: VolumeCheck,
    /// Share of the domain's volume outside FIELD's cells, which labels and distributions leave out.
    volume_beyond_field: f64,
    /// The preimages of the points of `--at`.
    inverse: Option<InverseReport>,
    /// Preimages of `--at` beyond FIELD's cells, which got the value at the closest point of their boundary.
    beyond_carrier: usize,
    #[serde(serialize_with = "crate::shared::json::total_seconds")]
    seconds: f64,
}

/// Fields at points of the target, with the mesh of the points.
struct CarriedFields {
    mesh: MeshWithFields,
    preimages: Option<Vec<Preimage>>,
    inverse: Option<InverseReport>,
    beyond_carrier: usize,
}

/// Carries fields through a map.
pub fn run(args: &TransferArgs, output: &Output) -> anyhow::Result<CommandOutcome> {
    args.section.require_valid()?;
    let inputs: Vec<&Path> = std::iter::once(&args.map)
        .chain(&args.field)
        .chain(&args.at)
        .map(PathBuf::as_path)
        .collect();
    let outputs: [(Option<&PathBuf>, &[&str]); 3] = [
        (Some(&args.output), &["csv", "vtu", "vtk"]),
        (args.png.as_ref(), &["png"]),
        (args.html.as_ref(), &page::EXTENSIONS),
    ];
    input::require_all_writable(&outputs, &inputs)?;
    output.progress("reading");
    let (file, boundary) = input::read_fitted_map(&args.map)?;
    let chosen = ChosenMap::of(&file, &args.map, &args.choice)?;
    let given = fields::read(args, &boundary)?;
    let is_shown = args.png.is_some() || args.html.is_some();
    let drawn = is_shown.then(|| fields::drawn(args, &given.carrier)).transpose()?;
    let carrier = &given.carrier;

    output.progress(format!("carrying {} points", carrier.points.len()));
    let start = std::time::Instant::now();
    let to_invert = ChosenInverse::of(chosen, &boundary, InverseOptions::default());
    let inverse = (args.at.is_some() || args.png.is_some())
        .then(|| to_invert.prepared(&args.map))
        .transpose()?;
    let carried = match (&args.at, &inverse) {
        (Some(at), Some(inverse)) => resampled(at, args, chosen.map(), &**inverse, &boundary, carrier)?,
        _ => CarriedFields {
            mesh: given.carried(chosen.map())?,
            preimages: None,
            inverse: None,
            beyond_carrier: 0,
        },
    };
    let seconds = start.elapsed().as_secs_f64();
    let outside = (args.field.is_some() && args.at.is_none())
        .then(|| count_outside(boundary.domain(), &carrier.points))
        .transpose()?;

    output.progress("checking volumes");
    let checks = checks::check(args, chosen.map(), &boundary, carrier)?;
    let png = match (drawn, &inverse) {
        (Some(which), Some(inverse)) if args.png.is_some() => {
            output.progress("drawing");
            Some(picture::draw(which, args, &boundary, &**inverse, carrier)?)
        }
        _ => None,
    };
    let html = args
        .html
        .is_some()
        .then(|| picture::page(args, chosen, &boundary, &file.metadata, carrier, output))
        .transpose()?;
    output.progress("writing");
    write(&args.output, &carried)?;
    if let (Some(path), Some(png)) = (&args.png, png) {
        write_file(path, &png)?;
    }
    if let (Some(path), Some(html)) = (&args.html, html) {
        page::write(path, &html)?;
    }
    let without_value = match &carried.preimages {
        Some(preimages) => preimages.iter().filter(|p| !p.position().x.is_finite()).count(),
        None => carried.mesh.carrier.points.iter().filter(|p| !is_finite(p)).count(),
    };
    let mut complete = true;
    match &carried.inverse {
        Some(report) => {
            warn_of_preimages(output, report);
            complete = report.folded + report.not_converged == 0;
        }
        None if without_value > 0 => output.warn(format!(
            "{without_value} points have no finite image: their coordinates are not finite, or they lie at sources"
        )),
        None => {}
    }
    warn(output, args, outside.unwrap_or(0), &checks);
    warn_of_values(output, carrier);
    let (tets, hexes) = match &carrier.cells {
        CellList::Tets(tets) => (tets.len(), 0),
        CellList::Hexes(hexes) => (0, hexes.len()),
    };
    let report = TransferSummary {
        map: (&args.map).into(),
        map_kind: chosen.name(),
        output: (&args.output).into(),
        picture: file_name(args.png.as_ref()),
        page: file_name(args.html.as_ref()),
        points: carrier.points.len(),
        tets,
        hexes,
        written_points: carried.mesh.carrier.points.len(),
        without_value,
        outside,
        fields: checks.fields,
        volume: checks.volume,
        volume_beyond_field: checks.volume_beyond_field,
        inverse: carried.inverse,
        beyond_carrier: carried.beyond_carrier,
        seconds,
    };
    output.result(&report, || summary::text(&report))?;
    Ok(CommandOutcome::from_check(complete))
}

/// Warns of points carried without meaning, and of what is not written.
fn warn(output: &Output, args: &TransferArgs, outside: usize, checks: &TransferChecks) {
    if outside > 0 {
        output.warn(format!(
            "{outside} points of FIELD lie outside the domain, where values of the map mean nothing"
        ));
    }
    let lost: Vec<&str> = checks
        .fields
        .iter()
        .filter(|field| !field.written)
        .map(|field| field.name.as_str())
        .collect();
    if !lost.is_empty() {
        output.warn(format!(
            "cell data are not written: {}; `{}` holds points only, write a .vtu or .vtk",
            lost.join(", "),
            args.output.display()
        ));
    }
    if checks.volume.not_finite > 0 {
        output.warn(format!(
            "the map has no finite Jacobian at {} points of the grid; the volumes leave them out",
            checks.volume.not_finite
        ));
    }
}

/// Warns of values that means and distributions leave out.
fn warn_of_values(output: &Output, carrier: &FieldMesh) {
    for (_, field) in fields::all_fields(carrier) {
        let count = field.values.iter().filter(|value| !value.is_finite()).count();
        if count > 0 {
            output.warn(format!(
                "{count} of {} values of `{}` are not finite: they are carried, and left out of its mean and distribution",
                field.values.len(),
                field.name
            ));
        }
    }
}

/// The fields at given points of the target.
fn resampled(
    at: &Path,
    args: &TransferArgs,
    map: &dyn VolumeMap,
    inverse: &dyn Inverse,
    boundary: &BoundaryMap,
    carrier: &FieldMesh,
) -> anyhow::Result<CarriedFields> {
    let (solid, points) = read_points(at)?;
    let found = resample(map, inverse, carrier, &points);
    let mut found = found.with_context(|| format!("cannot carry `{}`", fields::shown(args)))?;
    if let Some(field) = found.fields.iter_mut().find(|field| fields::is_distance(args, field)) {
        let places: Vec<Point> = found.preimages.iter().map(Preimage::position).collect();
        field.values = fields::distances(boundary, &places)?;
    }
    let (cells, triangles) = match solid {
        Some(SolidMesh::Cells(mesh)) => (mesh.into_parts().1, vec![]),
        Some(SolidMesh::Surface(mesh)) => (CellList::default(), mesh.triangles().to_vec()),
        None => (CellList::default(), vec![]),
    };
    Ok(CarriedFields {
        mesh: MeshWithFields {
            carrier: FieldMesh {
                points,
                cells,
                point_fields: found.fields,
                cell_fields: vec![],
            },
            triangles,
        },
        preimages: Some(found.preimages),
        inverse: Some(found.inverse),
        // The mesh made for --distance covers the domain.
        beyond_carrier: args.field.as_ref().map_or(0, |_| found.outside_mesh),
    })
}

/// A table of points, or a mesh with fields.
fn write(path: &Path, carried: &CarriedFields) -> anyhow::Result<()> {
    let preimages = carried.preimages.as_ref();
    let status =
        preimages.map(|preimages| Field::scalar(fields::STATUS, preimages.iter().map(status_number).collect()));
    let carrier = &carried.mesh.carrier;
    if is_table(path) {
        let fields: Vec<Field> = fields_of(&carrier.point_fields).chain(status).collect();
        return write_table(path, &carrier.points, &fields);
    }
    carried.mesh.write_mesh(path, status.into_iter().collect())
}

/// Columns x, y, z, and those of each field.
fn write_table(path: &Path, points: &[Point], fields: &[Field]) -> anyhow::Result<()> {
    let mut names: Vec<String> = ["x", "y", "z"].map(String::from).to_vec();
    names.extend(
        fields
            .iter()
            .flat_map(|field| fields::columns(&field.name, field.components)),
    );
    let mut values = Vec::with_capacity(points.len() * names.len());
    for (row, point) in points.iter().enumerate() {
        values.extend_from_slice(point.coords.as_slice());
        for field in fields {
            values.extend_from_slice(&field.values[row * field.components..][..field.components]);
        }
    }
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    Ok(io::write_csv(path, &names, &values)?)
}

fn is_finite(p: &Point) -> bool {
    p.iter().all(|c| c.is_finite())
}

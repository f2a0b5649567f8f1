//! `solidmap transfer`

use std::path::{Path, PathBuf};

use crate::drawing::{ColourBar, Figure, Panel, Plane, Scale, Section, ValueRange, significant};
use anyhow::{Context, bail, ensure};
use serde::Serialize;
use solidmap::Point;
use solidmap::boundary_map::BoundaryMap;
use solidmap::energy::{GridResolution, clipped_grid};
use solidmap::inverse::{InverseMap, InverseOptions, InverseReport, Preimage, PreimageStatus, lattice_mesh};
use solidmap::io::{self, Cells, Field, FieldFile, Solid, VtkEncoding, VtkFields};
use solidmap::map::VolumeMap;
use solidmap::transfer::{
    DistributionCheck, FieldKind, FieldMesh, FieldSampler, LabelShare, TransferField, VolumeCheck, distribution_check,
    label_shares, push_forward, resample, volume_check,
};

use super::args::TransferArgs;
use super::eval::{is_table, outside, read_points};
use super::output::{Output, pairs};
use super::pictures::depths;
use super::{Outcome, input, inverse};

/// What `transfer --json` prints.
#[derive(Serialize)]
struct Report {
    map: PathBuf,
    output: PathBuf,
    /// Points that carry the fields.
    points: usize,
    /// Tetrahedra between them.
    tets: usize,
    /// Points that got values: images, or those of `--at`.
    written_points: usize,
    /// Points without a finite image or without a preimage.
    without_value: usize,
    /// Points of FIELD outside the domain, where the formula still has a value but it means nothing. Not with `--at`.
    outside: Option<usize>,
    fields: Vec<FieldReport>,
    volume: VolumeCheck,
    /// Share of the domain's volume beyond FIELD's tetrahedra, which shares and distributions leave out.
    volume_beyond_field: f64,
    /// Of `--at`.
    inverse: Option<InverseReport>,
    /// Of `--at`: preimages beyond FIELD's tetrahedra, which got what is at the closest point of their boundary.
    beyond_carrier: usize,
    seconds: f64,
}

#[derive(Serialize)]
struct FieldReport {
    name: String,
    components: usize,
    /// `point` or `cell`.
    over: &'static str,
    /// `values`, `vector` or `label`.
    carry: &'static str,
    /// Whether the output has it: a table holds no cell data.
    written: bool,
    /// Of fields of one component that are no labels.
    distribution: Option<DistributionCheck>,
    labels: Option<Vec<LabelShare>>,
}

/// Nodes of the mesh that carries the distance field when no other is given.
const MESH_NODES: usize = 60_000;
const SECTION_PIXELS: usize = 480;
const DISTANCE: &str = "distance";
const STATUS: &str = "status";
/// Fields of three components that are no vectors of the material, in small letters.
const NO_VECTORS: [&str; 7] = ["rgb", "color", "colors", "colour", "colours", "normal", "normals"];

/// What is read: the carrier, and triangles between its points where it has no tetrahedra.
pub struct Given {
    pub carrier: FieldMesh,
    pub triangles: Vec<[u32; 3]>,
}

impl Given {
    /// Fields that are carried as their names say, but for those named here.
    fn of(file: FieldFile, labels: &[String], plain_vectors: Option<&[String]>) -> Self {
        let is_plain = |name: &String| {
            plain_vectors.is_some_and(|names| names.is_empty() || names.contains(name))
                || NO_VECTORS.contains(&name.to_lowercase().as_str())
        };
        let named = |field: Field| TransferField {
            kind: match field.components {
                _ if labels.contains(&field.name) => FieldKind::Label,
                3 if !is_plain(&field.name) => FieldKind::Vector,
                _ => FieldKind::Values,
            },
            name: field.name,
            components: field.components,
            values: field.values,
        };
        Self {
            carrier: FieldMesh {
                points: file.points,
                tets: file.tets,
                point_fields: file.point.into_iter().map(named).collect(),
                cell_fields: file.cell.into_iter().map(named).collect(),
            },
            triangles: file.triangles,
        }
    }

    /// Fields on a mesh.
    pub fn read_mesh(path: &Path) -> anyhow::Result<Self> {
        let given = Self::of(io::read_fields(path)?, &[], None);
        let (carrier, shown) = (&given.carrier, path.display());
        ensure!(
            !(carrier.tets.is_empty() && given.triangles.is_empty()),
            "`{shown}` has no triangles and no tetrahedra between its points; give a .vtu or .vtk that has"
        );
        carrier.check().with_context(|| format!("cannot carry `{shown}`"))?;
        Ok(given)
    }

    /// The same moved by a map.
    pub fn carried(&self, map: &dyn VolumeMap) -> anyhow::Result<Self> {
        Ok(Self {
            carrier: push_forward(map, &self.carrier)?,
            triangles: self.triangles.clone(),
        })
    }

    /// Writes the mesh with its fields and these at the points.
    pub fn write_mesh(&self, path: &Path, more: Vec<Field>) -> anyhow::Result<()> {
        let fields = VtkFields {
            point: fields_of(&self.carrier.point_fields).chain(more).collect(),
            cell: fields_of(&self.carrier.cell_fields).collect(),
            ..VtkFields::default()
        };
        let cells = match self.carrier.tets.is_empty() {
            true => Cells::Triangles(&self.triangles),
            false => Cells::Tets(&self.carrier.tets),
        };
        let points = &self.carrier.points;
        if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("vtk")) {
            io::write_vtk(path, points, cells, &fields, VtkEncoding::Binary)?;
        } else {
            io::write_vtu(path, points, cells, &fields)?;
        }
        Ok(())
    }
}

fn fields_of(fields: &[TransferField]) -> impl Iterator<Item = Field> {
    fields.iter().map(|field| Field {
        name: field.name.clone(),
        components: field.components,
        values: field.values.clone(),
    })
}

/// Values at points of the target, and what joins the points.
struct Carried {
    on: Given,
    preimages: Option<Vec<Preimage>>,
    inverse: Option<InverseReport>,
    beyond_carrier: usize,
}

/// Carries fields through a map.
pub fn run(args: &TransferArgs, output: &Output) -> anyhow::Result<Outcome> {
    args.section.require_valid()?;
    let inputs: Vec<&Path> = std::iter::once(&args.map)
        .chain(&args.field)
        .chain(&args.at)
        .map(PathBuf::as_path)
        .collect();
    input::require_writable(&args.output, &["csv", "vtu", "vtk"], &inputs)?;
    if let Some(png) = &args.png {
        let others: Vec<&Path> = inputs.iter().copied().chain([args.output.as_path()]).collect();
        input::require_writable(png, &["png"], &others)?;
    }
    output.progress("reading");
    let (file, boundary) = input::read_fitted_map(&args.map)?;
    let given = read(args, &boundary)?;
    require_matching_output(args, &given)?;
    require_distinct_names(args, &given.carrier)?;
    let drawn = args
        .png
        .is_some()
        .then(|| drawn_field(args, &given.carrier))
        .transpose()?;
    let carrier = &given.carrier;

    output.progress(format!("carrying {} points", carrier.points.len()));
    let start = std::time::Instant::now();
    // Sums that err by no more than an inverse is to leave.
    let exact = (args.at.is_some() || args.png.is_some()).then(|| file.map.clone().with_error(0.0));
    let inverse = exact
        .as_ref()
        .map(|map| InverseMap::new(map, &boundary, &InverseOptions::default()))
        .transpose()
        .with_context(|| format!("cannot invert `{}`", args.map.display()))?;
    let carried = match (&args.at, &inverse) {
        (Some(at), Some(inverse)) => carried_at(at, args, &file.map, inverse, &boundary, carrier)?,
        _ => Carried {
            on: given.carried(&file.map)?,
            preimages: None,
            inverse: None,
            beyond_carrier: 0,
        },
    };
    let seconds = start.elapsed().as_secs_f64();
    let outside = (args.field.is_some() && args.at.is_none())
        .then(|| outside(boundary.domain(), &carrier.points))
        .transpose()?;

    output.progress("checking volumes");
    let checks = check(args, &file.map, &boundary, carrier)?;
    let png = match (drawn, &inverse) {
        (Some(which), Some(inverse)) => {
            output.progress("drawing");
            Some(draw(which, args, &boundary, inverse, carrier)?)
        }
        _ => None,
    };
    output.progress("writing");
    write(&args.output, &carried)?;
    if let (Some(path), Some(png)) = (&args.png, png) {
        io::atomic_write(path, |writer| writer.write_all(&png))?;
    }
    let without_value = match &carried.preimages {
        Some(preimages) => preimages.iter().filter(|p| !inverse::place(p).x.is_finite()).count(),
        None => carried.on.carrier.points.iter().filter(|p| !is_finite(p)).count(),
    };
    let mut complete = true;
    match &carried.inverse {
        Some(report) => {
            inverse::warn(output, report);
            complete = report.folded + report.not_converged == 0;
        }
        None if without_value > 0 => output.warn(format!(
            "{without_value} points have no finite image: their coordinates are not finite, or they lie at sources"
        )),
        None => {}
    }
    warn(output, args, outside.unwrap_or(0), &checks);
    let report = Report {
        map: args.map.clone(),
        output: args.output.clone(),
        points: carrier.points.len(),
        tets: carrier.tets.len(),
        written_points: carried.on.carrier.points.len(),
        without_value,
        outside,
        fields: checks.fields,
        volume: checks.volume,
        volume_beyond_field: checks.volume_beyond_field,
        inverse: carried.inverse,
        beyond_carrier: carried.beyond_carrier,
        seconds,
    };
    output.result(&report, || pairs(rows(&report)))?;
    Ok(if complete { Outcome::Done } else { Outcome::CheckFailed })
}

/// Says what was carried without meaning, or not at all.
fn warn(output: &Output, args: &TransferArgs, outside: usize, checks: &Checks) {
    if outside > 0 {
        output.warn(format!(
            "{outside} points of FIELD lie outside the domain; the formula has values there, but they are no map"
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

/// The fields to carry.
fn read(args: &TransferArgs, boundary: &BoundaryMap) -> anyhow::Result<Given> {
    let file = match &args.field {
        Some(path) => io::read_fields(path)?,
        None => {
            let mesh = lattice_mesh(boundary.domain(), MESH_NODES)?;
            FieldFile {
                points: mesh.vertices().to_vec(),
                tets: mesh.tets().to_vec(),
                ..FieldFile::default()
            }
        }
    };
    let mut given = Given::of(file, &args.label, args.plain_vectors.as_deref());
    let carrier = &mut given.carrier;
    let shown = shown(args);
    if args.distance {
        let values = depths(boundary.domain(), &carrier.points)?;
        carrier.point_fields.push(TransferField {
            name: DISTANCE.into(),
            components: 1,
            values,
            kind: FieldKind::Values,
        });
    }
    let names: Vec<&str> = all_fields(carrier).map(|(_, field)| field.name.as_str()).collect();
    ensure!(
        !names.is_empty(),
        "`{shown}` has no fields; give a .csv with columns beside x, y and z, or a .vtu or .vtk with point or cell data, \
         or ask for --distance"
    );
    for name in args.label.iter().chain(args.plain_vectors.iter().flatten()) {
        ensure!(
            names.contains(&name.as_str()),
            "`{shown}` has no field `{name}`; its fields are {}",
            names.join(", ")
        );
    }
    carrier.check().with_context(|| format!("cannot carry `{shown}`"))?;
    Ok(given)
}

/// The file that the fields come from.
fn shown(args: &TransferArgs) -> std::path::Display<'_> {
    args.field.as_deref().unwrap_or(&args.map).display()
}

/// Refuses a mesh format where there is no mesh.
fn require_matching_output(args: &TransferArgs, given: &Given) -> anyhow::Result<()> {
    let has_mesh = match &args.at {
        Some(at) => !is_table(at),
        None => !(given.carrier.tets.is_empty() && given.triangles.is_empty()),
    };
    if !has_mesh && !is_table(&args.output) {
        bail!(
            "`{}` would hold points without a mesh; write them to .csv",
            args.output.display()
        );
    }
    Ok(())
}

/// Refuses fields that would have one name.
fn require_distinct_names(args: &TransferArgs, carrier: &FieldMesh) -> anyhow::Result<()> {
    let status = args.at.iter().map(|_| STATUS.to_owned());
    let names = all_fields(carrier).map(|(_, field)| field.name.clone());
    let mut all = vec![names.chain(status.clone()).collect::<Vec<_>>()];
    if is_table(&args.output) {
        let of_fields = all_fields(carrier).flat_map(|(_, field)| columns(&field.name, field.components));
        all.push(
            ["x", "y", "z"]
                .map(String::from)
                .into_iter()
                .chain(of_fields)
                .chain(status)
                .collect(),
        );
    }
    for mut names in all {
        names.sort_unstable();
        if let Some(pair) = names.windows(2).find(|pair| pair[0] == pair[1]) {
            bail!(
                "the name `{}` would stand for two fields (point and cell data, `{DISTANCE}` of --distance, `{STATUS}` of \
                 --at and the columns of a table share their names); rename one in `{}`",
                pair[0],
                shown(args)
            );
        }
    }
    Ok(())
}

/// The field for the picture, counted as by [`all_fields`].
fn drawn_field(args: &TransferArgs, carrier: &FieldMesh) -> anyhow::Result<usize> {
    let scalars = || {
        let all = all_fields(carrier).enumerate();
        all.filter(|(_, (_, field))| field.components == 1)
    };
    let shown = scalars().find(|(_, (_, field))| is_distance(args, field));
    let (which, _) = shown
        .or_else(|| scalars().next())
        .context("there is no field of one component to draw; leave out --png")?;
    Ok(which)
}

/// Whether the field is the one made here.
fn is_distance(args: &TransferArgs, field: &TransferField) -> bool {
    args.distance && field.name == DISTANCE
}

/// The distance from the boundary of the domain, exact where a carrier has it at its points only. What comes from beyond
/// the boundary lies on it, but for the boundary error.
fn distances(boundary: &BoundaryMap, points: &[Point]) -> anyhow::Result<Vec<f64>> {
    let depths = depths(boundary.domain(), points)?;
    // Not `f64::max`, which makes a number of NaN.
    Ok(depths.into_iter().map(|d| if d < 0.0 { 0.0 } else { d }).collect())
}

/// The fields at given points of the target.
fn carried_at(
    at: &Path,
    args: &TransferArgs,
    map: &dyn VolumeMap,
    inverse: &InverseMap,
    boundary: &BoundaryMap,
    carrier: &FieldMesh,
) -> anyhow::Result<Carried> {
    let (solid, points) = read_points(at)?;
    let found = resample(map, inverse, carrier, &points);
    let mut found = found.with_context(|| format!("cannot carry `{}`", shown(args)))?;
    if let Some(field) = found.fields.iter_mut().find(|field| is_distance(args, field)) {
        let places: Vec<Point> = found.preimages.iter().map(inverse::place).collect();
        field.values = distances(boundary, &places)?;
    }
    let (tets, triangles) = match solid {
        Some(Solid::Tets(mesh)) => (mesh.tets().to_vec(), vec![]),
        Some(Solid::Surface(mesh)) => (vec![], mesh.triangles().to_vec()),
        None => (vec![], vec![]),
    };
    Ok(Carried {
        on: Given {
            carrier: FieldMesh {
                points,
                tets,
                point_fields: found.fields,
                cell_fields: vec![],
            },
            triangles,
        },
        preimages: Some(found.preimages),
        inverse: Some(found.inverse),
        // The mesh made for --distance is no field.
        beyond_carrier: args.field.as_ref().map_or(0, |_| found.outside_mesh),
    })
}

/// A table of points, or a mesh with fields.
fn write(path: &Path, carried: &Carried) -> anyhow::Result<()> {
    let status = carried.preimages.as_ref().map(|preimages| Field {
        name: STATUS.into(),
        components: 1,
        values: preimages
            .iter()
            .map(|preimage| inverse::code(preimage.status))
            .collect(),
    });
    let carrier = &carried.on.carrier;
    if is_table(path) {
        let fields: Vec<Field> = fields_of(&carrier.point_fields).chain(status).collect();
        return write_table(path, &carrier.points, &fields);
    }
    carried.on.write_mesh(path, status.into_iter().collect())
}

/// The columns of a field in a table: `name`, `name_x` to `name_z`, or `name_0` onward.
fn columns(name: &str, components: usize) -> Vec<String> {
    match components {
        1 => vec![name.to_owned()],
        3 => ["x", "y", "z"].map(|axis| format!("{name}_{axis}")).to_vec(),
        n => (0..n).map(|k| format!("{name}_{k}")).collect(),
    }
}

/// Columns x, y, z, and those of each field.
fn write_table(path: &Path, points: &[Point], fields: &[Field]) -> anyhow::Result<()> {
    let mut names: Vec<String> = ["x", "y", "z"].map(String::from).to_vec();
    names.extend(fields.iter().flat_map(|field| columns(&field.name, field.components)));
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

/// What the map does to volumes, and to the distribution of each field.
struct Checks {
    volume: VolumeCheck,
    volume_beyond_field: f64,
    fields: Vec<FieldReport>,
}

fn check(
    args: &TransferArgs,
    map: &dyn VolumeMap,
    boundary: &BoundaryMap,
    carrier: &FieldMesh,
) -> anyhow::Result<Checks> {
    let quadrature = clipped_grid(
        boundary.domain(),
        GridResolution::CellsAlongLongestSide(args.resolution),
    )?;
    let (volume, after) = volume_check(map, &quadrature, boundary.target_volume());
    let sampler = FieldSampler::new(carrier).with_context(|| format!("cannot carry `{}`", shown(args)))?;
    let (mut fields, beyond) = sampler.sample(quadrature.points());
    for field in &mut fields {
        if is_distance(args, field) {
            field.values = distances(boundary, quadrature.points())?;
            continue;
        }
        let rows = field.values.chunks_mut(field.components.max(1)).zip(&beyond);
        rows.filter(|(_, beyond)| **beyond)
            .for_each(|(row, _)| row.fill(f64::NAN));
    }
    let beyond: Vec<f64> = beyond.iter().map(|&beyond| f64::from(u8::from(beyond))).collect();
    let has_field = args.field.is_some();
    let before = quadrature.weights();
    let reports = all_fields(carrier).zip(&fields).map(|((over, _), field)| FieldReport {
        name: field.name.clone(),
        components: field.components,
        over,
        carry: match field.kind {
            FieldKind::Values => "values",
            FieldKind::Vector => "vector",
            FieldKind::Label => "label",
        },
        written: over == "point" || args.at.is_some() || !is_table(&args.output),
        distribution: (field.components == 1 && field.kind != FieldKind::Label)
            .then(|| distribution_check(&field.values, before, &after))
            .flatten(),
        labels: (field.components == 1 && field.kind == FieldKind::Label)
            .then(|| label_shares(&field.values, before, &after)),
    });
    Ok(Checks {
        volume,
        volume_beyond_field: if has_field {
            quadrature.integrate(&beyond) / quadrature.volume()
        } else {
            0.0
        },
        fields: reports.collect(),
    })
}

fn all_fields(carrier: &FieldMesh) -> impl Iterator<Item = (&'static str, &TransferField)> {
    let over_points = carrier.point_fields.iter().map(|field| ("point", field));
    over_points.chain(carrier.cell_fields.iter().map(|field| ("cell", field)))
}

/// Cross-sections of domain and target in the colours of one bar, as a PNG.
fn draw(
    which: usize,
    args: &TransferArgs,
    boundary: &BoundaryMap,
    inverse: &InverseMap,
    carrier: &FieldMesh,
) -> anyhow::Result<Vec<u8>> {
    let (_, field) = all_fields(carrier).nth(which).context("there is no such field")?;
    let sampler = FieldSampler::new(carrier)?;
    let values_at = |points: &[Point]| -> anyhow::Result<Vec<f64>> {
        Ok(match is_distance(args, field) {
            true => distances(boundary, points)?,
            false => sampler.sample(points).0.swap_remove(which).values,
        })
    };
    let target = boundary.outward_target();
    let plane: Plane = args.section.plane(boundary.domain());
    let of_domain = Section::with_up(boundary.domain(), plane, args.section.up.into(), SECTION_PIXELS)?;
    let of_target = Section::with_up(
        &target,
        args.section.plane(&target),
        args.section.up.into(),
        SECTION_PIXELS,
    )?;
    let before = values_at(of_domain.points())?;
    let (preimages, _) = inverse.preimages(of_target.points());
    let places: Vec<Point> = preimages
        .iter()
        .map(|preimage| match preimage.status {
            PreimageStatus::NotFinite => Point::from([f64::NAN; 3]),
            // On the rim of the picture: the nearest there is.
            _ => preimage.point,
        })
        .collect();
    let after = values_at(&places)?;
    let all = before.iter().chain(&after).copied();
    let bar = ColourBar::new(&field.name, all, ValueRange::Quantiles(0.0, 1.0), Scale::Linear)?;
    let domain = Panel::of_section(&of_domain, &before, &bar)?
        .titled("domain")
        .with_bar(&bar);
    let target = Panel::of_section(&of_target, &after, &bar)?
        .titled("target")
        .with_bar(&bar);
    Ok(Figure::row(vec![domain, target]).to_png()?)
}

fn is_finite(p: &Point) -> bool {
    p.iter().all(|c| c.is_finite())
}

fn rows(report: &Report) -> Vec<[String; 2]> {
    let volume = &report.volume;
    let mut rows = vec![
        [
            "points".into(),
            format!(
                "{} with {} tetrahedra; {} written in {:.3} s",
                report.points, report.tets, report.written_points, report.seconds
            ),
        ],
        ["written".into(), report.output.display().to_string()],
        [
            "volume".into(),
            format!(
                "{} → {}, the target has {} ({:+.2e}); {:.2} % folded",
                significant(volume.domain, 6),
                significant(volume.carried, 6),
                significant(volume.target, 6),
                volume.relative_error,
                100.0 * volume.folded_share
            ),
        ],
    ];
    if report.volume_beyond_field > 0.0 {
        let share = 100.0 * report.volume_beyond_field;
        rows.push([
            "beyond FIELD".into(),
            format!("{share:.2} % of the domain's volume, left out below"),
        ]);
    }
    if report.inverse.is_some() {
        rows.push(["without value".into(), report.without_value.to_string()]);
        rows.push(["points beyond FIELD".into(), report.beyond_carrier.to_string()]);
    }
    for field in &report.fields {
        let lost = if field.written { "" } else { ", not written" };
        let name = format!("`{}` ({} {}{lost})", field.name, field.over, field.carry);
        if let Some(check) = &field.distribution {
            rows.push([
                name,
                format!(
                    "median {} → {}, mean {} → {}, largest shift of the distribution {:.3}",
                    significant(check.before.quantiles[2], 4),
                    significant(check.after.quantiles[2], 4),
                    significant(check.before.mean, 4),
                    significant(check.after.mean, 4),
                    check.largest_shift
                ),
            ]);
        } else if let Some(labels) = &field.labels {
            let shares = labels.iter().take(8).map(|share| {
                format!(
                    "{}: {:.1} % → {:.1} %",
                    share.label,
                    100.0 * share.before,
                    100.0 * share.after
                )
            });
            let more = if labels.len() > 8 { ", …" } else { "" };
            rows.push([name, format!("{}{more}", shares.collect::<Vec<_>>().join(", "))]);
        } else {
            rows.push([name, format!("{} components", field.components)]);
        }
    }
    rows
}

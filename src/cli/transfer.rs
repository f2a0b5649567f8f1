//! `solidmap transfer`

use std::path::{Path, PathBuf};

use anyhow::{Context, bail, ensure};
use serde::Serialize;
use solidmap::Point;
use solidmap::boundary_map::BoundaryMap;
use solidmap::energy::{Resolution, clipped_grid};
use solidmap::inverse::{InverseMap, InverseOptions, InverseReport, Preimage, PreimageStatus, lattice_mesh};
use solidmap::io::{self, Cells, Field, FieldFile, Solid, VtkEncoding, VtkFields};
use solidmap::map::VolumeMap;
use solidmap::report::{ColourBar, Figure, Panel, Plane, Scale, Section, ValueRange, significant};
use solidmap::transfer::{
    Carrier, Carry, DistributionCheck, LabelShare, Sampler, TransferField, VolumeCheck, carry, distribution_check,
    label_shares, resample, volume_check,
};

use super::args::TransferArgs;
use super::eval::{is_table, read_points};
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
    fields: Vec<FieldReport>,
    volume: VolumeCheck,
    /// Of `--at`.
    inverse: Option<InverseReport>,
    /// Of `--at`: preimages outside of FIELD's tetrahedra, which got the values of the nearest node.
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
    /// Of fields of one component that are no labels.
    distribution: Option<DistributionCheck>,
    labels: Option<Vec<LabelShare>>,
}

/// Nodes of the mesh that carries the distance field when no other is given.
const MESH_NODES: usize = 60_000;
const SECTION_PIXELS: usize = 480;
const DISTANCE: &str = "distance";

/// What is read: the carrier, and triangles between its points where it has no tetrahedra.
struct Given {
    carrier: Carrier,
    triangles: Vec<[u32; 3]>,
}

/// Values at points of the target, and what joins the points.
struct Carried {
    carrier: Carrier,
    triangles: Vec<[u32; 3]>,
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
    // Sums that err by no more than an inverse is to leave.
    let map = if args.at.is_some() || args.png.is_some() {
        file.map.clone().with_error(0.0)
    } else {
        file.map.clone()
    };
    let given = read(args, &boundary)?;
    require_matching_output(args, &given)?;

    output.progress(format!("carrying {} points", given.carrier.points.len()));
    let start = std::time::Instant::now();
    let inverse = if args.at.is_some() || args.png.is_some() {
        let inverse = InverseMap::new(&map, &boundary, &InverseOptions::default());
        Some(inverse.with_context(|| format!("cannot invert `{}`", args.map.display()))?)
    } else {
        None
    };
    let carried = match (&args.at, &inverse) {
        (Some(at), Some(inverse)) => carried_at(at, &map, inverse, &given.carrier)?,
        _ => Carried {
            carrier: carry(&map, &given.carrier)?,
            triangles: given.triangles.clone(),
            preimages: None,
            inverse: None,
            beyond_carrier: 0,
        },
    };
    let seconds = start.elapsed().as_secs_f64();

    output.progress("writing");
    write(&args.output, &carried)?;
    output.progress("checking volumes");
    let (volume, fields) = check(&map, &boundary, &given.carrier, args.resolution)?;
    if let (Some(png), Some(inverse)) = (&args.png, &inverse) {
        output.progress("drawing");
        draw(png, args, &boundary, inverse, &given.carrier)?;
    }
    let without_value = match &carried.preimages {
        Some(preimages) => preimages.iter().filter(|p| !inverse::place(p).x.is_finite()).count(),
        None => carried.carrier.points.iter().filter(|p| !is_finite(p)).count(),
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
    let report = Report {
        map: args.map.clone(),
        output: args.output.clone(),
        points: given.carrier.points.len(),
        tets: given.carrier.tets.len(),
        written_points: carried.carrier.points.len(),
        without_value,
        fields,
        volume,
        inverse: carried.inverse,
        beyond_carrier: carried.beyond_carrier,
        seconds,
    };
    output.result(&report, || pairs(rows(&report)))?;
    Ok(if complete { Outcome::Done } else { Outcome::CheckFailed })
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
    let named = |field: Field| TransferField {
        carry: match field.components {
            _ if args.label.contains(&field.name) => Carry::Label,
            3 if !args.plain_vectors => Carry::Vector,
            _ => Carry::Values,
        },
        name: field.name,
        components: field.components,
        values: field.values,
    };
    let mut carrier = Carrier {
        points: file.points,
        tets: file.tets,
        point_fields: file.point.into_iter().map(named).collect(),
        cell_fields: file.cell.into_iter().map(named).collect(),
    };
    let shown = args.field.as_deref().unwrap_or(&args.map).display();
    if args.distance {
        let values = depths(boundary.domain(), &carrier.points)?;
        carrier.point_fields.retain(|field| field.name != DISTANCE);
        carrier.point_fields.push(TransferField {
            name: DISTANCE.into(),
            components: 1,
            values,
            carry: Carry::Values,
        });
    }
    let names: Vec<&str> = all_fields(&carrier).map(|(_, field)| field.name.as_str()).collect();
    ensure!(
        !names.is_empty(),
        "`{shown}` has no fields; give a .csv with columns beside x, y and z, or a .vtu or .vtk with point or cell data, \
         or ask for --distance"
    );
    for label in &args.label {
        ensure!(
            names.contains(&label.as_str()),
            "`{shown}` has no field `{label}`; its fields are {}",
            names.join(", ")
        );
    }
    carrier.check().with_context(|| format!("cannot carry `{shown}`"))?;
    Ok(Given {
        carrier,
        triangles: file.triangles,
    })
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

/// The fields at given points of the target.
fn carried_at(at: &Path, map: &dyn VolumeMap, inverse: &InverseMap, carrier: &Carrier) -> anyhow::Result<Carried> {
    let (solid, points) = read_points(at)?;
    let found = resample(map, inverse, carrier, &points)?;
    let (tets, triangles) = match solid {
        Some(Solid::Tets(mesh)) => (mesh.tets().to_vec(), vec![]),
        Some(Solid::Surface(mesh)) => (vec![], mesh.triangles().to_vec()),
        None => (vec![], vec![]),
    };
    Ok(Carried {
        carrier: Carrier {
            points,
            tets,
            point_fields: found.fields,
            cell_fields: vec![],
        },
        triangles,
        preimages: Some(found.preimages),
        inverse: Some(found.inverse),
        beyond_carrier: found.beyond_carrier,
    })
}

/// A table of points, or a mesh with fields.
fn write(path: &Path, carried: &Carried) -> anyhow::Result<()> {
    let field = |field: &TransferField| Field {
        name: field.name.clone(),
        components: field.components,
        values: field.values.clone(),
    };
    let mut point: Vec<Field> = carried.carrier.point_fields.iter().map(field).collect();
    if let Some(preimages) = &carried.preimages {
        point.push(Field {
            name: "status".into(),
            components: 1,
            values: preimages
                .iter()
                .map(|preimage| inverse::code(preimage.status))
                .collect(),
        });
    }
    let points = &carried.carrier.points;
    if is_table(path) {
        return write_table(path, points, &point);
    }
    let fields = VtkFields {
        point,
        cell: carried.carrier.cell_fields.iter().map(field).collect(),
        ..VtkFields::default()
    };
    let cells = match carried.carrier.tets.is_empty() {
        true => Cells::Triangles(&carried.triangles),
        false => Cells::Tets(&carried.carrier.tets),
    };
    if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("vtk")) {
        io::write_vtk(path, points, cells, &fields, VtkEncoding::Binary)?;
    } else {
        io::write_vtu(path, points, cells, &fields)?;
    }
    Ok(())
}

/// Columns x, y, z, and those of each field: `name`, `name_x` to `name_z`, or `name_0` onward.
fn write_table(path: &Path, points: &[Point], fields: &[Field]) -> anyhow::Result<()> {
    let mut names: Vec<String> = ["x", "y", "z"].map(String::from).to_vec();
    for field in fields {
        match field.components {
            1 => names.push(field.name.clone()),
            3 => names.extend(["x", "y", "z"].map(|axis| format!("{}_{axis}", field.name))),
            n => names.extend((0..n).map(|k| format!("{}_{k}", field.name))),
        }
    }
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
fn check(
    map: &dyn VolumeMap,
    boundary: &BoundaryMap,
    carrier: &Carrier,
    resolution: usize,
) -> anyhow::Result<(VolumeCheck, Vec<FieldReport>)> {
    let quadrature = clipped_grid(boundary.domain(), Resolution::CellsAlongLongestSide(resolution))?;
    let (volume, after) = volume_check(map, &quadrature, boundary.target_volume());
    let (fields, _) = Sampler::new(carrier)?.sample(quadrature.points());
    let before = quadrature.weights();
    let reports = all_fields(carrier).zip(&fields).map(|((over, _), field)| FieldReport {
        name: field.name.clone(),
        components: field.components,
        over,
        carry: match field.carry {
            Carry::Values => "values",
            Carry::Vector => "vector",
            Carry::Label => "label",
        },
        distribution: (field.components == 1 && field.carry != Carry::Label)
            .then(|| distribution_check(&field.values, before, &after))
            .flatten(),
        labels: (field.components == 1 && field.carry == Carry::Label)
            .then(|| label_shares(&field.values, before, &after)),
    });
    Ok((volume, reports.collect()))
}

fn all_fields(carrier: &Carrier) -> impl Iterator<Item = (&'static str, &TransferField)> {
    let over_points = carrier.point_fields.iter().map(|field| ("point", field));
    over_points.chain(carrier.cell_fields.iter().map(|field| ("cell", field)))
}

/// Cross-sections of domain and target in the colours of one bar.
fn draw(
    path: &Path,
    args: &TransferArgs,
    boundary: &BoundaryMap,
    inverse: &InverseMap,
    carrier: &Carrier,
) -> anyhow::Result<()> {
    let scalars = || {
        all_fields(carrier)
            .enumerate()
            .filter(|(_, (_, field))| field.components == 1)
    };
    let shown = scalars().find(|(_, (_, field))| args.distance && field.name == DISTANCE);
    let (which, (_, field)) = shown
        .or_else(|| scalars().next())
        .context("there is no field of one component to draw; leave out --png")?;
    let sampler = Sampler::new(carrier)?;
    let values_at = |points: &[Point]| -> anyhow::Result<Vec<f64>> {
        Ok(match args.distance && field.name == DISTANCE {
            // Exact, where the carrier has it at its points only. What comes from beyond the boundary lies on it, but for
            // the boundary error.
            true => depths(boundary.domain(), points)?
                .into_iter()
                .map(|d| d.max(0.0))
                .collect(),
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
    let png = Figure::row(vec![domain, target]).to_png()?;
    io::atomic_write(path, |writer| writer.write_all(&png))?;
    Ok(())
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
    if report.inverse.is_some() {
        rows.push(["without value".into(), report.without_value.to_string()]);
        rows.push(["beyond FIELD's mesh".into(), report.beyond_carrier.to_string()]);
    }
    for field in &report.fields {
        let name = format!("`{}` ({} {})", field.name, field.over, field.carry);
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

//! `solidmap eval`: images of points, or with `--inverse` their preimages.

mod inverse;

use std::path::Path;

use anyhow::{Context, bail, ensure};
use serde::Serialize;
use solidmap::files;
use solidmap::geometry::{QueryError, are_outside, distance_field, flipped_cells};
use solidmap::io::{self, SolidMesh};
use solidmap::mesh::SurfaceMesh;
use solidmap::{Matrix3, Point};

use crate::CommandOutcome;
use crate::args::EvalArgs;
use crate::shared::chosen_map::{ChosenMap, MapName};
use crate::shared::input::{self, extension};
use crate::shared::json::FileName;
use crate::shared::output::{Output, two_columns};
use crate::shared::points::{is_table, read_points, write_table};

/// Columns of a Jacobian's entries.
const JACOBIAN: [&str; 9] = ["j00", "j01", "j02", "j10", "j11", "j12", "j20", "j21", "j22"];
/// Extensions that results are written to.
const OUTPUTS: [&str; 10] = ["csv", "npy", "obj", "ply", "off", "stl", "mesh", "msh", "vtk", "vtu"];

/// What `eval --json` prints.
#[derive(Serialize)]
struct EvalSummary {
    map: FileName,
    map_kind: MapName,
    points: usize,
    output: FileName,
    /// Points with NaN or infinite coordinates, and points at sources: they have no image.
    not_finite: usize,
    /// Points outside the domain, where values of the formula mean nothing. `None` if the file has no domain.
    outside: Option<usize>,
    /// Cells of a carried mesh of tetrahedra or hexahedra that the map inverts or flattens.
    inverted_cells: Option<usize>,
    #[serde(serialize_with = "crate::shared::json::total_seconds")]
    seconds: f64,
}

/// Maps points and writes their images.
pub fn run(args: &EvalArgs, output: &Output) -> anyhow::Result<CommandOutcome> {
    input::require_writable(&args.output, &OUTPUTS, &[&args.map, &args.points])?;
    require_matching_output(args)?;
    if args.inverse {
        return inverse::run(args, output);
    }
    output.progress("reading");
    let file = files::read_map(&args.map)?;
    let chosen = ChosenMap::of(&file, &args.map, &args.choice)?;
    let writes_mesh = !is_table(&args.output);
    let (solid, points) = read_points(&args.points)?;

    output.progress(format!("mapping {} points", points.len()));
    let start = std::time::Instant::now();
    let images = chosen.map().evaluate(&points);
    let jacobians = args.jacobian.then(|| chosen.map().jacobian(&points));
    let seconds = start.elapsed().as_secs_f64();
    let not_finite = images.iter().filter(|p| !is_finite(p)).count();

    output.progress("looking for points outside the domain");
    let location = file
        .boundary
        .as_ref()
        .map(|boundary| Location::of(&points, boundary.domain(), args.distance))
        .transpose()
        .with_context(|| format!("the domain in `{}` cannot be searched", args.map.display()))?;
    ensure!(
        location.is_some() || !args.distance,
        "`{}` has no domain that --distance could be measured from",
        args.map.display()
    );
    let outside = location.as_ref().map(|location| {
        let beyond = location.is_outside.iter().zip(&points);
        beyond.filter(|(outside, point)| **outside && is_finite(point)).count()
    });

    output.progress(format!("writing {}", args.output.display()));
    let mut inverted_cells = None;
    match solid {
        Some(solid) if writes_mesh => inverted_cells = write_mesh(&args.output, &solid, images.clone())?,
        _ => write_images(&args.output, &points, &images, jacobians.as_deref(), location.as_ref())?,
    }
    if not_finite > 0 {
        let first = images.iter().position(|p| !is_finite(p)).unwrap_or_default();
        output.warn(format!(
            "{not_finite} points have no finite image, the first is point {first} (from 0): their coordinates are not \
             finite, or they lie at sources"
        ));
    }
    if outside.is_some_and(|count| count > 0) {
        output.warn(format!(
            "outside the domain, where values of the map mean nothing: {} of the points",
            outside.unwrap_or_default()
        ));
    }
    let report = EvalSummary {
        map: (&args.map).into(),
        map_kind: chosen.name(),
        points: points.len(),
        output: (&args.output).into(),
        not_finite,
        outside,
        inverted_cells,
        seconds,
    };
    output.result(&report, || two_columns(rows(&report)))?;
    Ok(CommandOutcome::Done)
}

/// Where points are with respect to the domain.
struct Location {
    is_outside: Vec<bool>,
    /// Distances from its boundary, negative outside.
    distances: Option<Vec<f64>>,
}

impl Location {
    fn of(points: &[Point], domain: &SurfaceMesh, with_distances: bool) -> Result<Self, QueryError> {
        Ok(Self {
            is_outside: are_outside(domain, points)?,
            distances: with_distances.then(|| distance_field(domain, points)).transpose()?,
        })
    }
}

/// Refuses an output that cannot hold what is to be written.
fn require_matching_output(args: &EvalArgs) -> anyhow::Result<()> {
    let writes_mesh = !is_table(&args.output);
    if writes_mesh && is_table(&args.points) {
        bail!(
            "`{}` holds points without a mesh; write them to .csv or .npy instead of `{}`",
            args.points.display(),
            args.output.display()
        );
    }
    for (asked, what) in [(args.jacobian, "Jacobians"), (args.distance, "Distances")] {
        ensure!(
            !(writes_mesh && asked),
            "{what} go into .csv or .npy; `{}` would lose them",
            args.output.display()
        );
    }
    Ok(())
}

fn is_finite(p: &Point) -> bool {
    p.iter().all(|c| c.is_finite())
}

fn rows(report: &EvalSummary) -> Vec<[String; 2]> {
    let mut rows = vec![
        ["points".into(), format!("{} in {:.3} s", report.points, report.seconds)],
        ["written".into(), report.output.display().to_string()],
    ];
    if let Some(outside) = report.outside {
        rows.push(["outside".into(), format!("{outside} of {} points", report.points)]);
    }
    if let Some(flipped) = report.inverted_cells {
        rows.push(["inverted cells".into(), flipped.to_string()]);
    }
    rows
}

/// Writes the mesh with its vertices at their images; counts the cells whose orientation is not that of the majority.
fn write_mesh(path: &Path, solid: &SolidMesh, images: Vec<Point>) -> anyhow::Result<Option<usize>> {
    let mismatch = "the map gave another number of images than points";
    let flipped = match solid {
        SolidMesh::Surface(_) => None,
        SolidMesh::Cells(mesh) => {
            let flipped = flipped_cells(mesh, &images).context(mismatch)?;
            Some(flipped.against_most(mesh.cells().len()))
        }
    };
    io::write_solid(path, &solid.with_vertices(images).context(mismatch)?)?;
    Ok(flipped)
}

/// CSV: the points, their images, the Jacobians' entries, and where the points are. NPY has no names: the images, the
/// entries, and the distances if they are asked for.
fn write_images(
    path: &Path,
    points: &[Point],
    images: &[Point],
    jacobians: Option<&[Matrix3]>,
    location: Option<&Location>,
) -> anyhow::Result<()> {
    let csv = extension(path) == "csv";
    let mut names = if csv { vec!["x", "y", "z"] } else { vec![] };
    names.extend(["fx", "fy", "fz"]);
    if jacobians.is_some() {
        names.extend(JACOBIAN);
    }
    let is_outside = location.filter(|_| csv).map(|location| &location.is_outside);
    names.extend(is_outside.map(|_| "inside"));
    let distances = location.and_then(|location| location.distances.as_ref());
    names.extend(distances.map(|_| "distance"));
    let mut values = Vec::with_capacity(points.len() * names.len());
    for (p, (point, image)) in points.iter().zip(images).enumerate() {
        if csv {
            values.extend_from_slice(point.coords.as_slice());
        }
        values.extend_from_slice(image.coords.as_slice());
        if let Some(all) = jacobians {
            // Matrices are stored by columns.
            values.extend_from_slice(all[p].transpose().as_slice());
        }
        values.extend(is_outside.map(|all| if all[p] { 0.0 } else { 1.0 }));
        values.extend(distances.map(|all| all[p]));
    }
    write_table(path, &names, &values)
}

//! `solidmap boundary torus`: a surface of genus 1 mapped to a torus of revolution, one to one.

use serde::Serialize;
use solidmap::boundary_map::check::{BoundaryCheckOptions, check};
use solidmap::boundary_map::pair::{PairMaps, TorusReport};
use solidmap::boundary_map::{BoundaryMap, SurfaceDistortion};

use super::{pair, write};
use crate::CommandOutcome;
use crate::args::BoundaryTorusArgs;
use crate::drawing::significant;
use crate::shared::json::{FileName, file_name};
use crate::shared::output::{Output, memory_row, peak_rss_bytes, two_columns, written_row};
use crate::shared::{boundary_map, input, interrupt};

/// What `boundary torus --json` prints.
#[derive(Serialize)]
struct TorusSummary {
    model: FileName,
    vertices: usize,
    faces: usize,
    image: FileName,
    boundary_file: Option<FileName>,
    png: Option<FileName>,
    vtu: Option<FileName>,
    page: Option<FileName>,
    /// Radius of the circle around which the tube runs.
    major: f64,
    /// Radius of the tube.
    minor: f64,
    /// How far the surface's flat torus leans, and how high it is, over the side that bounds a disk.
    modulus: [f64; 2],
    torus: Option<TorusReport>,
    distortion: SurfaceDistortion,
    /// Whether the map is the best so far at the time limit.
    concluded: bool,
    #[serde(serialize_with = "crate::shared::json::total_seconds")]
    seconds: f64,
    peak_rss_bytes: u64,
}

/// Maps, measures and writes.
pub fn run(args: &BoundaryTorusArgs, output: &Output) -> anyhow::Result<CommandOutcome> {
    let start = std::time::Instant::now();
    let outputs = &args.outputs;
    outputs.require_writable(&[&args.model])?;
    output.progress("reading");
    let surface = input::read_surface(&args.model)?;
    let (PairMaps { map, report: made, .. }, torus) = boundary_map::to_torus(&surface, &args.model, 1.0, output)?;
    output.progress("writing");
    let checked = check(&map, None, &BoundaryCheckOptions::default(), None)?;
    let read = [("domain", args.model.as_path())];
    write::outputs(&map, Some(&checked), outputs, &read, outputs.up, output)?;
    pair::note_flipped(&checked, outputs, output);
    let report = TorusSummary {
        model: (&args.model).into(),
        vertices: map.domain().vertices().len(),
        faces: map.domain().triangles().len(),
        image: (&outputs.output).into(),
        boundary_file: file_name(outputs.boundary.as_ref()),
        png: file_name(outputs.png.as_ref()),
        vtu: file_name(outputs.vtu.as_ref()),
        page: file_name(outputs.html.as_ref()),
        major: torus.major,
        minor: torus.minor,
        modulus: torus.modulus,
        torus: made.torus,
        distortion: made.after,
        concluded: made.concluded,
        seconds: start.elapsed().as_secs_f64(),
        peak_rss_bytes: peak_rss_bytes(),
    };
    output.result(&report, || summary(&report, &map, pair::torus_method(&made)))?;
    if report.concluded {
        output.warn(interrupt::concluded("boundary map"));
    }
    Ok(CommandOutcome::from_check(!report.concluded && !made.looks_wrong()))
}

fn summary(report: &TorusSummary, map: &BoundaryMap, method: String) -> String {
    let [leans, height] = report.modulus.map(|part| significant(part, 3));
    let rows = vec![
        [
            "surface".into(),
            format!("{} vertices, {} triangles", report.vertices, report.faces),
        ],
        [
            "torus".into(),
            format!(
                "about the z axis, radii {} and {}, as large as the solid; {} vertices",
                significant(report.major, 4),
                significant(report.minor, 4),
                map.target().vertices().len()
            ),
        ],
        [
            "flat torus".into(),
            format!("{height} times as high as wide, leaning by {leans} of its width"),
        ],
        [
            "map".into(),
            "one to one: no triangle flipped on the flat torus, degree 1, decided exactly".into(),
        ],
        ["method".into(), method],
        ["time".into(), format!("{:.1} s", report.seconds)],
        memory_row(report.peak_rss_bytes),
        written_row([
            Some(&report.image),
            report.boundary_file.as_ref(),
            report.png.as_ref(),
            report.vtu.as_ref(),
            report.page.as_ref(),
        ]),
    ];
    format!("{}\n\n{}", two_columns(rows), report.distortion)
}

//! `solidmap boundary pair`: a bijection between the boundaries of two solids.

use std::path::{Path, PathBuf};

use serde::Serialize;
use solidmap::boundary_map::check::{BoundaryCheckOptions, check};
use solidmap::boundary_map::pair::{PairMethod, PairReport};

use super::write;
use crate::CommandOutcome;
use crate::args::BoundaryPairArgs;
use crate::shared::json::{FileName, file_name};
use crate::shared::output::{Output, memory_row, peak_rss_bytes, two_columns};
use crate::shared::{boundary_map, input, interrupt};

/// What `boundary pair --json` prints.
#[derive(Serialize)]
struct PairSummary {
    domain: FileName,
    target: FileName,
    image: FileName,
    boundary_file: Option<FileName>,
    png: Option<FileName>,
    vtu: Option<FileName>,
    #[serde(flatten)]
    pair: PairReport,
    peak_rss_bytes: u64,
}

/// Maps the pair, and writes the image and whatever else is asked for.
pub fn run(args: &BoundaryPairArgs, output: &Output) -> anyhow::Result<CommandOutcome> {
    let mut inputs: Vec<&Path> = vec![&args.domain, &args.target];
    inputs.extend(args.pair.landmarks.iter().map(PathBuf::as_path));
    args.outputs.require_writable(&inputs)?;
    output.progress("reading");
    let domain = input::read_surface(&args.domain)?;
    let (map, report) = boundary_map::to_model(&domain, [&args.domain, &args.target], &args.pair, 1.0, output)?;
    output.progress("writing");
    let mut read: Vec<(&str, &Path)> = vec![("domain", &args.domain), ("target", &args.target)];
    read.extend(args.pair.landmarks.iter().map(|file| ("landmarks", file.as_path())));
    let checked = check(&map, None, &BoundaryCheckOptions::default(), None)?;
    write::outputs(
        &map,
        Some(&checked),
        &args.outputs,
        &read,
        args.target_up.or(args.outputs.up),
        output,
    )?;
    let flipped = checked.composition.map_or(0, |found| found.plain_image_flipped);
    if flipped > 0 {
        let instead = match &args.outputs.boundary {
            Some(path) => format!("use `{}`", path.display()),
            None => "write it with --boundary".into(),
        };
        output.note(format_args!(
            "the plain image, linear between the images of vertices, has {flipped} triangles that face against the \
             target; the boundary map has none: {instead}"
        ));
    }
    let report = PairSummary {
        domain: (&args.domain).into(),
        target: (&args.target).into(),
        image: (&args.outputs.output).into(),
        boundary_file: file_name(args.outputs.boundary.as_ref()),
        png: file_name(args.outputs.png.as_ref()),
        vtu: file_name(args.outputs.vtu.as_ref()),
        pair: report,
        peak_rss_bytes: peak_rss_bytes(),
    };
    output.result(&report, || summary(&report))?;
    if report.pair.concluded {
        output.warn(interrupt::concluded("boundary map"));
        return Ok(CommandOutcome::CheckFailed);
    }
    Ok(CommandOutcome::Done)
}

fn summary(report: &PairSummary) -> String {
    let pair = &report.pair;
    let seconds = pair.timings;
    let method = match (pair.method, pair.schedule) {
        (PairMethod::SoftTargets, Some(schedule)) => format!(
            "the best of {} coarse embeddings for {} alignments: alignment {}, soft targets of weight {} up to {} \
             vertices",
            pair.coarse_embeddings,
            pair.alignments.len(),
            pair.alignment + 1,
            schedule.strength,
            schedule.until_vertices
        ),
        _ => format!(
            "conformal maps of both; the best of {} rotations, by areas",
            pair.rotations.len()
        ),
    };
    let mut rows = vec![
        [
            "map".into(),
            "one to one: no triangle flipped on the sphere, degree 1, decided exactly".into(),
        ],
        ["method".into(), method],
    ];
    if pair.landmarks > 0 {
        rows.push(["landmarks".into(), format!("{}, all met exactly", pair.landmarks)]);
    }
    rows.push([
        "time".into(),
        format!(
            "{:.1} s: spheres {:.1}, alignment {:.1}, coarse embeddings {:.1}, refinement {:.1}",
            seconds.total, seconds.sphere, seconds.align, seconds.coarse, seconds.improve
        ),
    ]);
    rows.push(memory_row(report.peak_rss_bytes));
    rows.push(["image".into(), report.image.display().to_string()]);
    if let Some(file) = &report.boundary_file {
        rows.push([
            "boundary map".into(),
            format!("{}, for `solidmap fit --boundary`", file.display()),
        ]);
    }
    let (table, before, after) = (two_columns(rows), &pair.before, &pair.after);
    format!("{table}\n\nbefore\n{before}\nafter\n{after}")
}

//! `solidmap boundary improve`: a boundary map that lowers the energy of the volume.

use std::time::Instant;

use anyhow::Context;
use serde::Serialize;
use solidmap::files;
use solidmap::improve::{ImproveEnd, ImproveOptions, ImprovePhase, ImproveReport, improve_boundary};
use solidmap::io;

use super::write;
use crate::CommandOutcome;
use crate::args::BoundaryImproveArgs;
use crate::drawing::significant;
use crate::shared::json::{FileName, file_name};
use crate::shared::output::{Output, memory_row, peak_rss_bytes, two_columns};
use crate::shared::{fitting, interrupt};

/// What `boundary improve --json` prints.
#[derive(Serialize)]
struct ImproveSummary {
    start: FileName,
    image: FileName,
    boundary_file: Option<FileName>,
    png: Option<FileName>,
    vtu: Option<FileName>,
    page: Option<FileName>,
    #[serde(flatten)]
    improved: ImproveReport,
    #[serde(serialize_with = "crate::shared::json::total_seconds")]
    seconds: f64,
    peak_rss_bytes: u64,
}

/// Reads, improves, writes and reports.
pub fn run(args: &BoundaryImproveArgs, output: &Output) -> anyhow::Result<CommandOutcome> {
    let start = Instant::now();
    args.outputs.require_writable(&[&args.file])?;
    anyhow::ensure!(
        !io::is_mesh(&args.file),
        "`{}` is a mesh; `boundary improve` takes a boundary file, as `boundary pair --boundary` writes it",
        args.file.display()
    );
    output.progress("reading");
    let map = files::read_boundary(&args.file)?.boundary;
    let mut options = ImproveOptions {
        most_distortion: args.max_distortion,
        most_rounds: args.rounds,
        ..ImproveOptions::default()
    };
    options.fit.tolerance = args.tolerance;
    let progress = |phase| {
        match phase {
            ImprovePhase::Fitting(phase) => fitting::show_phase(phase, "", output),
            ImprovePhase::Moving {
                rounds,
                most_rounds,
                energy,
            } => output.progress_of(
                format!("lowering the energy, {}", significant(energy, 5)),
                rounds,
                most_rounds,
            ),
        }
        interrupt::control(matches!(phase, ImprovePhase::Moving { .. }))
    };
    let (map, improved) = improve_boundary(&map, &options, &progress)
        .with_context(|| format!("cannot improve `{}`", args.file.display()))?;
    improved.warnings.iter().for_each(|warning| output.warn(warning));
    output.progress("writing");
    write::outputs(
        &map,
        None,
        &args.outputs,
        &[("start", &args.file)],
        args.outputs.up,
        output,
    )?;
    let report = ImproveSummary {
        start: (&args.file).into(),
        image: (&args.outputs.output).into(),
        boundary_file: file_name(args.outputs.boundary.as_ref()),
        png: file_name(args.outputs.png.as_ref()),
        vtu: file_name(args.outputs.vtu.as_ref()),
        page: file_name(args.outputs.html.as_ref()),
        improved,
        seconds: start.elapsed().as_secs_f64(),
        peak_rss_bytes: peak_rss_bytes(),
    };
    output.result(&report, || summary(&report))?;
    if report.improved.end == ImproveEnd::Concluded {
        output.warn(interrupt::concluded("boundary map"));
        return Ok(CommandOutcome::CheckFailed);
    }
    Ok(CommandOutcome::Done)
}

fn summary(report: &ImproveSummary) -> String {
    let improved = &report.improved;
    let (first, last) = (improved.energies.first(), improved.energies.last());
    let (first, last) = (first.copied().unwrap_or(f64::NAN), last.copied().unwrap_or(f64::NAN));
    let mut rows = vec![
        [
            "harmonic energy".into(),
            format!(
                "{} before, {} after ({} %)",
                significant(first, 5),
                significant(last, 5),
                significant(100.0 * (last / first - 1.0), 2)
            ),
        ],
        [
            "surface".into(),
            format!(
                "symmetric Dirichlet energy at 99.9 % of the area {} before, {} after",
                significant(improved.distortions[0], 3),
                significant(improved.distortions[1], 3)
            ),
        ],
        [
            "rounds".into(),
            format!(
                "{}, {} of which lowered the energy; ended {}",
                improved.rounds,
                improved.energies.len() - 1,
                end_words(improved.end)
            ),
        ],
        ["time".into(), format!("{:.1} s", report.seconds)],
        memory_row(report.peak_rss_bytes),
        ["image".into(), report.image.display().to_string()],
    ];
    if let Some(file) = &report.boundary_file {
        rows.push([
            "boundary map".into(),
            format!("{}, for `solidmap fit --boundary`", file.display()),
        ]);
    }
    let (table, before, after) = (two_columns(rows), &improved.before, &improved.after);
    format!("{table}\n\nbefore\n{before}\nafter\n{after}")
}

fn end_words(end: ImproveEnd) -> &'static str {
    match end {
        ImproveEnd::Distortion => "at the bound of distortion (--max-distortion)",
        ImproveEnd::Converged => "where no step lowers the energy",
        ImproveEnd::Rounds => "after as many rounds as allowed (--rounds)",
        ImproveEnd::Concluded => "early",
    }
}

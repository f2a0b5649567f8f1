//! `solidmap certify`: where a map is proved to be one to one, and where it is proved to fold.

use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::Context;
use serde::Serialize;
use solidmap::certificate::{
    Certificate, CertificateCell, CertificateOptions, CertificateReport, StopReason, Verdict, VerdictTotals, certify,
};
use solidmap::geometry::PlaneSection;
use solidmap::io::{self, Cells, VtkFields};

use crate::CommandOutcome;
use crate::args::{CertifyArgs, UpKind};
use crate::drawing::{ColourBar, Figure, Panel, Scale, ValueRange, significant};
use crate::shared::fields::scalar;
use crate::shared::input;
use crate::shared::json::FileName;
use crate::shared::output::{Output, peak_rss_bytes, two_columns, write_file};

/// Pixels along the longer side of a section.
const SECTION_PIXELS: usize = 640;

/// What `certify --json` prints.
#[derive(Serialize)]
struct CertifySummary {
    map: FileName,
    cells: usize,
    /// Proved for the whole domain.
    locally_one_to_one: bool,
    #[serde(flatten)]
    certificate: CertificateReport,
    #[serde(serialize_with = "crate::shared::json::total_seconds")]
    seconds: f64,
    peak_rss_bytes: u64,
}

/// Certifies and writes.
pub fn run(args: &CertifyArgs, output: &Output) -> anyhow::Result<CommandOutcome> {
    args.section.require_valid()?;
    let outputs: [(Option<&PathBuf>, &[&str]); 2] = [(args.output.as_ref(), &["vtu"]), (args.png.as_ref(), &["png"])];
    input::require_all_writable(&outputs, &[&args.map])?;
    let options = CertificateOptions {
        finest: args.finest,
        max_cells: args.max_cells,
        undecided: args.undecided,
    };
    output.progress("reading");
    let (file, boundary) = input::read_fitted_map(&args.map)?;
    let plane = args.section.plane(boundary.domain());
    let section = args.png.as_ref().map(|_| {
        let up = args.section.up.into();
        PlaneSection::new(boundary.domain(), plane, up, SECTION_PIXELS)
    });
    let section = section.transpose()?;
    let clock = Instant::now();
    let certificate = certify(
        &file.map,
        boundary.domain(),
        boundary.target_volume(),
        &options,
        &|at| {
            let step = format!("level {}, {:.2} % undecided", at.level, 100.0 * at.undecided);
            output.progress_of(step, at.done, at.of);
        },
    )
    .with_context(|| format!("cannot certify `{}`", args.map.display()))?;
    let seconds = clock.elapsed().as_secs_f64();

    if let Some(path) = &args.output {
        output.progress("writing");
        write(path, &certificate)?;
    }
    if let (Some(path), Some(section)) = (&args.png, &section) {
        output.progress("drawing");
        write_file(
            path,
            &Figure::row(panels(&certificate, section, args.section.up)?).to_png()?,
        )?;
    }
    let found = certificate.report;
    let report = CertifySummary {
        map: (&args.map).into(),
        cells: certificate.cells().len(),
        locally_one_to_one: found.stop_reason == StopReason::AllDecided && found.folded.cells == 0,
        certificate: found,
        seconds,
        peak_rss_bytes: peak_rss_bytes(),
    };
    output.result(&report, || summary(&report))?;
    Ok(CommandOutcome::from_check(found.folded.cells == 0))
}

fn write(path: &Path, certificate: &Certificate) -> anyhow::Result<()> {
    let (points, hexahedra) = certificate.hexahedra();
    let field =
        |name: &str, value: fn(&CertificateCell) -> f64| scalar(name, certificate.cells().iter().map(value).collect());
    let cell = vec![
        field("verdict", |leaf| match leaf.verdict {
            Verdict::Positive => 1.0,
            Verdict::Undecided => 0.0,
            Verdict::Folded => -1.0,
        }),
        field("sigma_min_bound", |leaf| leaf.sigma_min),
        field("det_bound", |leaf| leaf.det_bound),
        field("det_centre", |leaf| leaf.det_centre),
        field("level", |leaf| f64::from(leaf.level)),
        field("volume_inside", |leaf| leaf.volume),
    ];
    io::write_vtu(
        path,
        &points,
        Cells::Hexes(&hexahedra),
        &VtkFields {
            cell,
            ..VtkFields::default()
        },
    )?;
    Ok(())
}

/// The verdicts, and the lower bounds of the least singular value.
fn panels(certificate: &Certificate, section: &PlaneSection, up: UpKind) -> anyhow::Result<Vec<Panel>> {
    let leaves: Vec<_> = section.points().iter().map(|p| certificate.cell_at(p)).collect();
    let verdicts: Vec<f64> = leaves
        .iter()
        .map(|leaf| match leaf.map(|leaf| leaf.verdict) {
            Some(Verdict::Positive) => 0.0,
            Some(Verdict::Folded) => 1.0,
            // NaN is drawn grey.
            Some(Verdict::Undecided) | None => f64::NAN,
        })
        .collect();
    let colours = ColourBar::new("verdict", [0.0, 1.0], ValueRange::Full, Scale::Linear)?;
    let mut panels = vec![
        Panel::of_section(section, &verdicts, &colours)?
            .titled("What is proved")
            .captioned("blue: locally one to one")
            .captioned("red: folded, grey: undecided"),
    ];
    let bounds: Vec<f64> = leaves
        .iter()
        .map(|leaf| leaf.map_or(f64::NAN, |leaf| leaf.sigma_min))
        .map(|bound| if bound > 0.0 { bound } else { f64::NAN })
        .collect();
    if bounds.iter().any(|bound| bound.is_finite()) {
        let range = ValueRange::Quantiles(0.01, 1.0);
        let bar = ColourBar::new("lower bound", bounds.iter().copied(), range, Scale::Log)?;
        let panel = Panel::of_section(section, &bounds, &bar)?
            .titled("Least singular value of J, proved")
            .with_bar(&bar);
        panels.push(panel);
    }
    let turned = panels.into_iter().map(|panel| panel.turned_if(up.is_upside_down()));
    Ok(turned.collect())
}

fn summary(report: &CertifySummary) -> String {
    let found = &report.certificate;
    let row = |name: &str, share: &VerdictTotals| {
        [
            name.to_owned(),
            format!("{:>10} of the volume, {} cells", percent(share.fraction), share.cells),
        ]
    };
    let mut rows = vec![
        row("locally one to one", &found.positive),
        row("folded", &found.folded),
        row("undecided", &found.undecided),
    ];
    if found.undecided.cells > 0 {
        rows.push([
            String::new(),
            format!(
                "{:>10} in cells folded at their centre",
                percent(found.undecided_negative)
            ),
        ]);
    }
    if let Some(sigma) = found.sigma_min_99 {
        let text = format!("{:>10} or more over 99 % of the volume", significant(sigma, 3));
        rows.push(["singular values".into(), text]);
    }
    rows.push([
        "cells".into(),
        format!(
            "{}, the smallest {} wide; {}",
            report.cells,
            significant(found.finest_cell, 3),
            match found.stop_reason {
                StopReason::AllDecided => "all are decided",
                StopReason::EnoughDecided => "enough is decided (--undecided)",
                StopReason::Finest => "the undecided ones are of the smallest size (--finest)",
                StopReason::CellLimit => "dividing the undecided ones would exceed --max-cells",
            }
        ),
    ]);
    rows.push([
        "volume".into(),
        format!(
            "{}; that of all cells differs by {:.0e} of it",
            significant(found.volume, 6),
            found.volume_error.abs()
        ),
    ]);
    rows.push(["time".into(), format!("{:.1} s", report.seconds)]);
    format!("{}\n\n{}", two_columns(rows), conclusion(found))
}

/// The conclusion, in words.
fn conclusion(found: &CertificateReport) -> &'static str {
    match [found.positive, found.folded, found.undecided].map(|share| share.cells) {
        [_, 0, 0] => {
            "The map is locally one to one everywhere. If its boundary map has degree one (`solidmap boundary \
             check`), every point of\nthe target deeper than the boundary error has exactly one preimage."
        }
        [_, 0, _] => "No fold is proved, and none is excluded in undecided cells.",
        [0, _, _] => "The map inverts the solid wherever it is decided.",
        _ => "The map folds: it is not one to one.",
    }
}

/// A percentage; shares near 0 and 100 % keep their digits.
fn percent(fraction: f64) -> String {
    match 100.0 * fraction {
        0.0 => "0 %".into(),
        share if share < 0.01 => format!("{share:.1e} %"),
        share if share > 99.99 && share < 100.0 => format!("{:.6} %", share.min(99.999_999)),
        share => format!("{share:.3} %"),
    }
}

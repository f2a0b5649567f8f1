//! `solidmap certify` of a bijective map: its tetrahedra and its boundaries are checked again.

use std::time::Instant;

use anyhow::ensure;
use serde::Serialize;
use solidmap::bijective::{BijectiveMap, BijectivityCertificate};
use solidmap::fit::self_intersection_finder;

use crate::CommandOutcome;
use crate::args::CertifyArgs;
use crate::shared::chosen_map::MapName;
use crate::shared::json::FileName;
use crate::shared::output::{Output, peak_rss_bytes, two_columns};

/// What `certify --json` prints for a bijective map.
#[derive(Serialize)]
struct Summary {
    map: FileName,
    map_kind: MapName,
    /// Proved for the whole domain.
    one_to_one: bool,
    #[serde(flatten)]
    certificate: BijectivityCertificate,
    #[serde(serialize_with = "crate::shared::json::total_seconds")]
    seconds: f64,
    peak_rss_bytes: u64,
}

pub fn run(args: &CertifyArgs, map: &BijectiveMap, output: &Output) -> anyhow::Result<CommandOutcome> {
    ensure!(
        args.output.is_none() && args.png.is_none() && args.html.is_none(),
        "the bijective map of `{}` has no undecided places that --output, --png or --html could show; add --map harmonic",
        args.map.display()
    );
    output.progress("looking for self-intersections");
    let clock = Instant::now();
    let certificate = map.certificate(self_intersection_finder());
    let report = Summary {
        map: (&args.map).into(),
        map_kind: MapName::Bijective,
        one_to_one: certificate.is_one_to_one(),
        certificate,
        seconds: clock.elapsed().as_secs_f64(),
        peak_rss_bytes: peak_rss_bytes(),
    };
    output.result(&report, || text(&report))?;
    let found = &report.certificate;
    Ok(CommandOutcome::from_check(
        found.domain_problems.is_empty() && found.target_problems.is_empty(),
    ))
}

fn text(report: &Summary) -> String {
    let found = &report.certificate;
    let boundary = |problems: &[String]| match problems {
        [] if found.boundary_checked => "bounds a solid, and does not meet itself".into(),
        [] => "bounds a solid; whether it meets itself was not looked for, which needs CGAL".into(),
        problems => problems.join("; "),
    };
    let mirrored = if found.mirrored { ", mirrored as a whole" } else { "" };
    let rows = vec![
        [
            "tetrahedra".into(),
            format!("{}, none inverted or flat, decided exactly{mirrored}", found.tets),
        ],
        ["domain".into(), boundary(&found.domain_problems)],
        ["target".into(), boundary(&found.target_problems)],
        ["time".into(), format!("{:.2} s", report.seconds)],
    ];
    let conclusion = match (report.one_to_one, found.boundary_checked) {
        (true, _) => "The map is one to one: every point of the image has exactly one preimage.",
        (_, false) => "The map is one to one if its boundary does not meet itself.",
        _ => "The map is not proved to be one to one.",
    };
    format!("{}\n\n{conclusion}", two_columns(rows))
}

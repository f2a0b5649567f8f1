//! `solidmap check`

use std::path::{Path, PathBuf};

use serde::Serialize;
use solidmap::check::{CheckReport, check};
use solidmap::mesh::SurfaceMesh;

use super::args::CheckArgs;
use super::output::Output;
use super::{Outcome, input};

/// What `check --json` prints.
#[derive(Serialize)]
struct Report {
    models: Vec<ModelReport>,
}

/// A model's sheet, or why it could not be read.
#[derive(Serialize)]
struct ModelReport {
    model: PathBuf,
    #[serde(flatten)]
    report: Option<CheckReport>,
    unreadable: Option<String>,
}

/// Looks at every model; one that cannot be read does not stop the others.
pub fn run(args: &CheckArgs, output: &Output) -> anyhow::Result<Outcome> {
    let mut models = Vec::new();
    for model in &args.models {
        output.progress(format!("looking at {}", model.display()));
        let (report, unreadable) = match examine(model) {
            Ok(report) => (Some(report), None),
            Err(error) => (None, Some(super::describe(&error))),
        };
        models.push(ModelReport {
            model: model.clone(),
            report,
            unreadable,
        });
    }
    let report = Report { models };
    output.result(&report, || {
        report.models.iter().map(sheet).collect::<Vec<_>>().join("\n")
    })?;

    let unreadable = report.models.iter().filter(|m| m.unreadable.is_some()).count();
    if unreadable > 0 {
        anyhow::bail!("{unreadable} of {} models could not be read", report.models.len());
    }
    let healthy = report
        .models
        .iter()
        .flat_map(|m| &m.report)
        .all(|r| r.findings.is_empty());
    Ok(if healthy { Outcome::Done } else { Outcome::CheckFailed })
}

fn examine(model: &Path) -> anyhow::Result<CheckReport> {
    let surface = input::read_surface(model)?;
    Ok(examine_surface(&surface))
}

#[cfg(feature = "native")]
fn examine_surface(surface: &SurfaceMesh) -> CheckReport {
    let find = |mesh: &SurfaceMesh| solidmap::cgal_tetgen::self_intersections(mesh).map_err(|e| e.to_string());
    check(surface, Some(&find))
}

#[cfg(not(feature = "native"))]
fn examine_surface(surface: &SurfaceMesh) -> CheckReport {
    check(surface, None)
}

fn sheet(model: &ModelReport) -> String {
    let name = model.model.display();
    match (&model.report, &model.unreadable) {
        (Some(report), _) => format!("{name}\n{report}"),
        (None, reason) => format!("{name}\n  cannot be read: {}\n", reason.as_deref().unwrap_or_default()),
    }
}

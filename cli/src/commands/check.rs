//! `solidmap check`: what is wrong with models, and how to repair them.

use std::path::Path;

use serde::Serialize;
use solidmap::check::{CheckReport, check};

use crate::CommandOutcome;
use crate::args::CheckArgs;
use crate::shared::input;
use crate::shared::json::FileName;
use crate::shared::output::{Output, describe};
use crate::shared::self_intersections::finder;

/// What `check --json` prints.
#[derive(Serialize)]
struct CheckSummary {
    models: Vec<ModelReport>,
}

/// What was found in a model, or why it could not be read.
#[derive(Serialize)]
struct ModelReport {
    model: FileName,
    #[serde(flatten)]
    report: Option<CheckReport>,
    unreadable: Option<String>,
}

/// Checks every model; one that cannot be read does not stop the others.
pub fn run(args: &CheckArgs, output: &Output) -> anyhow::Result<CommandOutcome> {
    let mut models = Vec::new();
    for model in &args.models {
        output.progress(format!("checking {}", model.display()));
        let (report, unreadable) = match examine(model) {
            Ok(report) => (Some(report), None),
            Err(error) => (None, Some(describe(&error))),
        };
        models.push(ModelReport {
            model: model.into(),
            report,
            unreadable,
        });
    }
    let report = CheckSummary { models };
    output.result(&report, || {
        report.models.iter().map(text).collect::<Vec<_>>().join("\n")
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
    Ok(CommandOutcome::from_check(healthy))
}

fn examine(model: &Path) -> anyhow::Result<CheckReport> {
    let surface = input::read_surface(model)?;
    Ok(check(&surface, finder()))
}

fn text(model: &ModelReport) -> String {
    let name = model.model.display();
    match (&model.report, &model.unreadable) {
        (Some(report), _) => format!("{name}\n{report}"),
        (None, reason) => format!("{name}\n  {}\n", reason.as_deref().unwrap_or_default()),
    }
}

//! `solidmap check`: what is wrong with models, and how to repair them.

use std::path::Path;

use serde::Serialize;
use solidmap::check::{CellReport, CheckReport, check, examine_cells};
use solidmap::fit::self_intersection_finder;
use solidmap::io::SolidMesh;

use crate::CommandOutcome;
use crate::args::CheckArgs;
use crate::shared::input;
use crate::shared::json::FileName;
use crate::shared::output::{Output, describe};

/// What `check --json` prints.
#[derive(Serialize)]
struct CheckSummary {
    models: Vec<ModelReport>,
}

/// What was found in a model, or why it could not be read.
#[derive(Serialize)]
struct ModelReport {
    model: FileName,
    /// What was found in the cells of a tet or hex mesh; `None` for a surface.
    cell_mesh: Option<CellReport>,
    /// What was found in the surface, or in the boundary of the cells.
    #[serde(flatten)]
    report: Option<CheckReport>,
    unreadable: Option<String>,
}

/// Checks every model; one that cannot be read does not stop the others.
pub fn run(args: &CheckArgs, output: &Output) -> anyhow::Result<CommandOutcome> {
    let mut models = Vec::new();
    for model in &args.models {
        output.progress(format!("checking {}", model.display()));
        models.push(examine(model).unwrap_or_else(|error| ModelReport {
            model: model.into(),
            cell_mesh: None,
            report: None,
            unreadable: Some(describe(&error)),
        }));
    }
    let report = CheckSummary { models };
    output.result(&report, || {
        report.models.iter().map(text).collect::<Vec<_>>().join("\n")
    })?;

    let unreadable = report.models.iter().filter(|m| m.unreadable.is_some()).count();
    if unreadable > 0 {
        anyhow::bail!("{unreadable} of {} models could not be read", report.models.len());
    }
    Ok(CommandOutcome::from_check(
        report.models.iter().all(ModelReport::is_healthy),
    ))
}

fn examine(model: &Path) -> anyhow::Result<ModelReport> {
    let solid = input::read_solid(model)?;
    let cell_mesh = match &solid {
        SolidMesh::Surface(_) => None,
        SolidMesh::Cells(mesh) => Some(examine_cells(mesh)),
    };
    Ok(ModelReport {
        model: model.into(),
        cell_mesh,
        report: Some(check(&solid.into_surface(), self_intersection_finder())),
        unreadable: None,
    })
}

impl ModelReport {
    /// Whether nothing is wrong with the surface, and no cell is invalid. Notes are no defects.
    fn is_healthy(&self) -> bool {
        self.report.as_ref().is_some_and(|report| report.findings.is_empty())
            && self.cell_mesh.as_ref().is_none_or(CellReport::is_valid)
    }
}

fn text(model: &ModelReport) -> String {
    let name = model.model.display();
    match (&model.report, &model.cell_mesh, &model.unreadable) {
        (Some(report), Some(cells), _) => {
            format!("{name}\n{cells}\nThe boundary of the cells, as a surface with vertices of its own:\n{report}")
        }
        (Some(report), None, _) => format!("{name}\n{report}"),
        (None, _, reason) => format!("{name}\n  {}\n", reason.as_deref().unwrap_or_default()),
    }
}

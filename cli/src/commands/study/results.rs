//! The rows of a study: taken from its table, or measured and added to it.

use std::path::Path;
use std::time::Instant;

use serde::Serialize;
use solidmap::boundary_map::BoundaryMap;
use solidmap::energy::{AdaptiveOptions, EnergyOptions, adaptive_energies};
use solidmap::files::Provenance;
use solidmap::fit::{Fit, FitOptions, fit};

use super::measured::Measured;
use super::table::StudyTable;
use crate::shared::fitting::show_one_of_many;
use crate::shared::input;
use crate::shared::output::{Output, describe};

/// A row: what was varied, and what was measured or why nothing was.
#[derive(Debug, Serialize)]
pub struct Row<S> {
    #[serde(flatten)]
    pub setting: S,
    /// Whether the table had it already.
    pub reused: bool,
    #[serde(flatten)]
    pub found: Option<Measured>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub error: Option<String>,
}

/// What is varied in a row.
pub struct Varied<S> {
    pub setting: S,
    /// Its cells in the table.
    pub cells: Vec<String>,
    /// The same in words.
    pub label: String,
    /// The input files, by [`hashes`].
    pub inputs: String,
}

/// Makes the rows of a study.
pub struct Rows<'a> {
    study: &'static str,
    settings: String,
    table: StudyTable,
    output: &'a Output,
    told: Vec<String>,
}

impl<'a> Rows<'a> {
    /// No rows yet; `settings` are what all rows have in common.
    pub fn new(study: &'static str, settings: &str, table: StudyTable, output: &'a Output) -> Self {
        Self {
            study,
            settings: format!("{settings} solidmap={}", env!("CARGO_PKG_VERSION")),
            table,
            output,
            told: Vec::new(),
        }
    }

    /// The row of the table, if it has that and `may_reuse`; otherwise what `measure` returns, with warnings. That
    /// something cannot be measured is a row, too.
    pub fn row<S>(
        &mut self,
        varied: Varied<S>,
        may_reuse: bool,
        measure: impl FnOnce() -> anyhow::Result<(Measured, Vec<String>)>,
    ) -> anyhow::Result<Row<S>> {
        let Varied {
            setting,
            cells,
            label,
            inputs,
        } = varied;
        let head = [self.study.to_owned(), inputs, self.settings.clone()];
        let key: Vec<String> = head.into_iter().chain(cells).collect();
        if let Some(found) = self.table.find(&key).filter(|_| may_reuse) {
            return Ok(Row {
                setting,
                reused: true,
                found: Some(found),
                error: None,
            });
        }
        let (found, error) = match measure() {
            Ok((found, warnings)) => {
                self.tell(&label, warnings);
                self.table.put(key, Ok(&found))?;
                (Some(found), None)
            }
            Err(error) => {
                let error = describe(&error);
                self.output.warn(format!("{label}: {error}"));
                self.table.put(key, Err(&error))?;
                (None, Some(error))
            }
        };
        Ok(Row {
            setting,
            reused: false,
            found,
            error,
        })
    }

    /// Tells each warning once, however many rows have it.
    fn tell(&mut self, label: &str, warnings: Vec<String>) {
        for warning in warnings {
            if !self.told.contains(&warning) {
                self.output.warn_of_fit(format!("{label}: {warning}"));
                self.told.push(warning);
            }
        }
    }
}

/// Fits one map and measures it; `what` names it where progress is shown.
pub fn measured_fit(
    boundary: &BoundaryMap,
    options: &FitOptions,
    (energy, accuracy): (&EnergyOptions, &AdaptiveOptions),
    what: &str,
    output: &Output,
) -> anyhow::Result<(Fit, Measured)> {
    let start = Instant::now();
    let fit = fit(boundary, options, &|phase| show_one_of_many(phase, what, output))?;
    output.progress_in(what, "integrating");
    let target = boundary.target_volume();
    let (_, energies) = adaptive_energies(&fit.map, fit.boundary.domain(), target, energy, accuracy)?;
    let measured = Measured::new(&fit.report, &energies, start.elapsed().as_secs_f64());
    Ok((fit, measured))
}

/// Files by their roles, with hashes.
pub fn provenances(files: &[(&'static str, &Path)]) -> anyhow::Result<Vec<Provenance>> {
    files.iter().map(|(role, path)| input::provenance(role, path)).collect()
}

/// What tells input files from others in a table: the first 16 digits of their hashes.
pub fn hashes(files: &[Provenance]) -> String {
    const DIGITS: usize = 16;
    let short = |file: &Provenance| file.sha256.chars().take(DIGITS).collect::<String>();
    files.iter().map(short).collect::<Vec<_>>().join("+")
}

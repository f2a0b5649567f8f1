//! The report on a study of placements or ratios, as JSON and in words.

use std::time::Instant;

use serde::Serialize;

use super::measured::Measured;
use super::results::Row;
use super::setting::Setting;
use super::sweep::SweepKind;
use crate::CommandOutcome;
use crate::args::StudyOutputs;
use crate::drawing::{Align, Table, significant};
use crate::shared::input::BoundarySource;
use crate::shared::json::{FileName, file_name};
use crate::shared::output::{Output, memory_row, peak_rss_bytes, two_columns, written_row};
use crate::shared::places::percent;

/// What `study placement --json` and `study ratios --json` print.
#[derive(Serialize)]
pub struct SweepSummary {
    study: &'static str,
    domain: Option<FileName>,
    image: Option<FileName>,
    boundary_file: Option<FileName>,
    #[serde(flatten)]
    written: WrittenFiles,
    vertices: usize,
    /// Boundary points that ratios are of.
    points: usize,
    rows: Vec<Row<Setting>>,
    reused: usize,
    failed: usize,
    /// The setting of least C-Error, and that of least boundary error (rms).
    least_c_error: Option<Setting>,
    least_boundary_error: Option<Setting>,
    /// Spearman's, of C-Error and boundary error over all rows.
    rank_correlation: Option<f64>,
    #[serde(serialize_with = "crate::shared::json::total_seconds")]
    seconds: f64,
    peak_rss_bytes: u64,
}

/// The files that a study has written.
#[derive(Serialize)]
pub struct WrittenFiles {
    output: Option<FileName>,
    png: Option<FileName>,
    page: Option<FileName>,
}

impl WrittenFiles {
    /// Those that were asked for.
    pub fn new(outputs: &StudyOutputs) -> Self {
        Self {
            output: file_name(outputs.output.as_ref()),
            png: file_name(outputs.png.as_ref()),
            page: file_name(outputs.html.as_ref()),
        }
    }

    /// The lines of a summary that name them.
    pub fn lines(&self) -> Vec<[String; 2]> {
        let files = [&self.output, &self.png, &self.page];
        match files.iter().any(|file| file.is_some()) {
            true => vec![written_row(files.map(Option::as_ref))],
            false => vec![],
        }
    }
}

impl SweepSummary {
    /// The report; `(vertices, points)` are those of the domain and those that ratios are of.
    pub fn new(
        kind: SweepKind,
        source: &BoundarySource,
        outputs: &StudyOutputs,
        (vertices, points): (usize, usize),
        rows: Vec<Row<Setting>>,
    ) -> Self {
        let role = |name: &str| {
            let files = source.files_by_role();
            files
                .iter()
                .find(|(role, _)| *role == name)
                .map(|(_, path)| FileName::from(path))
        };
        Self {
            study: kind.name(),
            domain: role("domain"),
            image: role("image"),
            boundary_file: role("boundary"),
            written: WrittenFiles::new(outputs),
            vertices,
            points,
            reused: rows.iter().filter(|row| row.reused).count(),
            failed: rows.iter().filter(|row| row.error.is_some()).count(),
            least_c_error: least(&rows, c_error),
            least_boundary_error: least(&rows, boundary_error),
            rank_correlation: rank_correlation(&rows),
            rows,
            seconds: 0.0,
            peak_rss_bytes: 0,
        }
    }

    /// Prints the report.
    pub fn finish(mut self, start: Instant, output: &Output) -> anyhow::Result<CommandOutcome> {
        self.seconds = start.elapsed().as_secs_f64();
        self.peak_rss_bytes = peak_rss_bytes();
        output.result(&self, || format!("{}\n{}", self.table(), two_columns(self.lines())))?;
        Ok(CommandOutcome::from_check(self.failed == 0))
    }

    fn table(&self) -> Table<13> {
        let right = |name, unit| (name, unit, Align::Right);
        let mut table = Table::new([
            ("placement", "", Align::Left),
            right("parameter", ""),
            right("s-ratio", ""),
            right("c-ratio", ""),
            right("sources", ""),
            right("C-Error", ""),
            right("residual", "rms"),
            right("boundary", "error, rms"),
            right("harmonic", "energy"),
            right("deformation", "energy"),
            right("folded", ""),
            right("condition", ""),
            right("rank", "of unknowns"),
        ]);
        for row in &self.rows {
            let [placement, parameter, s_ratio, c_ratio] = row.setting.cells();
            let small = |value: f64| format!("{value:.2e}");
            let measured = row.found.as_ref().map(|m| {
                [
                    m.sources.to_string(),
                    small(m.c_error),
                    small(m.residual_rms),
                    small(m.boundary_error.rms),
                    significant(m.harmonic_energy, 5),
                    significant(m.deformation_energy, 4),
                    percent(m.folded_fraction),
                    m.condition
                        .map_or("singular".into(), |condition| format!("{condition:.1e}")),
                    m.rank.map_or(String::new(), |rank| format!("{rank} of {}", m.unknowns)),
                ]
            });
            let [a, b, c, d, e, f, g, h, i] = measured.unwrap_or_else(|| {
                let mut cells: [String; 9] = Default::default();
                cells[0] = "failed".into();
                cells
            });
            table.row([placement, parameter, s_ratio, c_ratio, a, b, c, d, e, f, g, h, i]);
        }
        table
    }

    fn lines(&self) -> Vec<[String; 2]> {
        let mut lines = vec![[
            "boundary points".into(),
            format!("{} of {} vertices, which the ratios are of", self.points, self.vertices),
        ]];
        let best = |setting: &Option<Setting>| {
            let found = self.rows.iter().find(|row| Some(row.setting) == *setting);
            found.and_then(|row| Some((row.setting.label(), row.found.as_ref()?)))
        };
        if let Some((label, found)) = best(&self.least_c_error) {
            let error = format!(
                "{:.2e}, and a boundary error of {:.2e}",
                found.c_error, found.boundary_error.rms
            );
            lines.push(["least C-Error".into(), format!("{label}: {error}")]);
        }
        if let Some((label, found)) = best(&self.least_boundary_error) {
            let error = format!(
                "{:.2e}, and a C-Error of {:.2e}",
                found.boundary_error.rms, found.c_error
            );
            lines.push(["least boundary error".into(), format!("{label}: {error}")]);
        }
        if let Some(correlation) = self.rank_correlation {
            lines.push([
                "rank correlation".into(),
                format!("{correlation:.2} of C-Error and boundary error (1: they order the settings alike)"),
            ]);
        }
        if self.failed > 0 || self.reused > 0 {
            let measured = self.rows.len() - self.failed - self.reused;
            let counts = format!(
                "{measured} measured, {} taken from the table, {} failed",
                self.reused, self.failed
            );
            lines.push(["rows".into(), counts]);
        }
        lines.push(["time".into(), format!("{:.1} s", self.seconds)]);
        lines.push(memory_row(self.peak_rss_bytes));
        lines.extend(self.written.lines());
        lines
    }
}

fn c_error(measured: &Measured) -> f64 {
    measured.c_error
}

fn boundary_error(measured: &Measured) -> f64 {
    measured.boundary_error.rms
}

fn least(rows: &[Row<Setting>], of: fn(&Measured) -> f64) -> Option<Setting> {
    let found = rows
        .iter()
        .filter_map(|row| Some((row.setting, of(row.found.as_ref()?))));
    found.min_by(|a, b| a.1.total_cmp(&b.1)).map(|(setting, _)| setting)
}

/// Spearman's rank correlation of C-Error and boundary error; `None` for fewer than three rows, or where all are alike.
fn rank_correlation(rows: &[Row<Setting>]) -> Option<f64> {
    let found: Vec<&Measured> = rows.iter().filter_map(|row| row.found.as_ref()).collect();
    if found.len() < 3 {
        return None;
    }
    let values = |of: fn(&Measured) -> f64| found.iter().map(|m| of(m)).collect::<Vec<f64>>();
    correlation(&ranks(&values(c_error)), &ranks(&values(boundary_error)))
}

/// The rank of each value; equal ones share the mean of theirs.
fn ranks(values: &[f64]) -> Vec<f64> {
    let rank = |value: &f64| {
        let below = values.iter().filter(|other| *other < value).count();
        let equal = values.iter().filter(|other| *other == value).count();
        below as f64 + 0.5 * (equal as f64 - 1.0)
    };
    values.iter().map(rank).collect()
}

/// Pearson's correlation; `None` where one of the two does not vary.
fn correlation(a: &[f64], b: &[f64]) -> Option<f64> {
    let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
    let (mean_a, mean_b) = (mean(a), mean(b));
    let product = |x: &[f64], mean_x: f64, y: &[f64], mean_y: f64| -> f64 {
        x.iter().zip(y).map(|(x, y)| (x - mean_x) * (y - mean_y)).sum()
    };
    let scale = (product(a, mean_a, a, mean_a) * product(b, mean_b, b, mean_b)).sqrt();
    (scale > 0.0).then(|| product(a, mean_a, b, mean_b) / scale)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranks_correlate_whatever_the_size_of_values() {
        let ranked = |a: &[f64], b: &[f64]| correlation(&ranks(a), &ranks(b));
        let rising = [1e-9, 1e-3, 0.5, 7.0];
        assert!((ranked(&rising, &[1.0, 2.0, 3.0, 4e9]).unwrap() - 1.0).abs() < 1e-12);
        assert!((ranked(&rising, &[4.0, 3.0, 2.0, 1.0]).unwrap() + 1.0).abs() < 1e-12);
        // By hand: ranks 0 1.5 1.5 3 beside 0 1 2 3.
        assert!((ranked(&[1.0, 2.0, 2.0, 3.0], &rising).unwrap() - 4.5 / (4.5f64 * 5.0).sqrt()).abs() < 1e-12);
        assert_eq!(ranked(&[1.0; 4], &rising), None);
    }
}

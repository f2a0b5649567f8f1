//! The comparison as text, Markdown, CSV and JSON.

use std::fmt::Write;
use std::path::Path;

use super::Comparison;
use super::job::Figures;
use super::tables::{Part, parts};
use crate::shared::json;
use crate::shared::output::write_file;

/// Writes `comparison.txt`, `.md`, `.csv` and `.json`.
pub fn write(folder: &Path, comparison: &Comparison) -> anyhow::Result<()> {
    let json = json::document(comparison)?;
    for (name, text) in [
        ("comparison.txt", text(comparison)),
        ("comparison.md", markdown(comparison)),
        ("comparison.csv", csv(comparison)),
        ("comparison.json", json + "\n"),
    ] {
        write_file(folder.join(name), text.as_bytes())?;
    }
    let times: serde_json::Map<_, _> = comparison
        .methods
        .iter()
        .filter_map(|row| {
            Some((
                row.name.clone(),
                serde_json::to_value(row.figures.as_ref()?.seconds).ok()?,
            ))
        })
        .collect();
    write_file(folder.join("times.json"), &serde_json::to_vec_pretty(&times)?)
}

/// For a terminal.
pub fn text(comparison: &Comparison) -> String {
    let mut text = String::new();
    for part in parts(comparison) {
        let _ = match part {
            Part::Title(_) => Ok(()),
            Part::Words(words) => writeln!(text, "{}\n", wrapped(&words)),
            Part::Table(table) => writeln!(text, "{table}"),
        };
    }
    text
}

/// Lines of at most [`WIDTH`] characters, broken between words.
fn wrapped(words: &str) -> String {
    let wrap = |line: &str| {
        let mut text = String::new();
        let mut width = 0;
        for word in line.split(' ') {
            let length = word.chars().count();
            if width > 0 && width + 1 + length > WIDTH {
                text.push('\n');
                width = 0;
            } else if width > 0 {
                text.push(' ');
                width += 1;
            }
            text.push_str(word);
            width += length;
        }
        text
    };
    words.lines().map(wrap).collect::<Vec<_>>().join("\n")
}

/// Characters of a line of words.
const WIDTH: usize = 110;

fn markdown(comparison: &Comparison) -> String {
    let mut text = String::new();
    for part in parts(comparison) {
        let _ = match part {
            Part::Title(_) => Ok(()),
            Part::Words(words) => writeln!(text, "{words}\n"),
            Part::Table(table) => writeln!(text, "{}", table.to_markdown()),
        };
    }
    text
}

/// One line per map, all figures.
fn csv(comparison: &Comparison) -> String {
    let mut text = String::new();
    // The first is the method's own row.
    let steps = comparison.equal_accuracy.iter().skip(1);
    let named = comparison
        .methods
        .iter()
        .map(|row| (row.name.clone(), row))
        .chain(steps.map(|step| (format!("{} ({})", step.row.name, step.what), &step.row)))
        .chain(comparison.mesh_study.iter().flat_map(|study| {
            let runs = study.runs.iter();
            runs.map(|run| (format!("{} ({})", study.method.name(), run.what), &run.row))
        }));
    for (k, (name, row)) in named.enumerate() {
        let fields = fields(row.figures.as_ref());
        if k == 0 {
            let names: Vec<&str> = fields.iter().map(|(name, _)| *name).collect();
            let _ = writeln!(text, "method,{},error", names.join(","));
        }
        let values: Vec<String> = fields
            .iter()
            .map(|(_, value)| value.map_or(String::new(), |v| v.to_string()))
            .collect();
        let quoted = |s: &str| format!("\"{}\"", s.replace('"', "\"\""));
        let error = row.error.as_deref().map_or(String::new(), quoted);
        let _ = writeln!(text, "{},{},{error}", quoted(&name), values.join(","));
    }
    text
}

fn fields(figures: Option<&Figures>) -> Vec<(&'static str, Option<f64>)> {
    let of = |value: &dyn Fn(&Figures) -> Option<f64>| figures.and_then(value);
    let some = |value: &dyn Fn(&Figures) -> f64| figures.map(value);
    vec![
        ("mesh_seconds", some(&|f| f.seconds.mesh)),
        ("factor_seconds", some(&|f| f.seconds.factor)),
        ("solve_seconds", some(&|f| f.seconds.solve)),
        ("evaluate_seconds", some(&|f| f.seconds.evaluate)),
        ("peak_rss_bytes", some(&|f| f.peak_rss_bytes as f64)),
        ("tets", of(&|f| Some(f.tets? as f64))),
        ("unknowns", some(&|f| f.unknowns as f64)),
        ("iterations", of(&|f| Some(f.iterations? as f64))),
        ("boundary_error_rms", some(&|f| f.boundary_error.rms)),
        ("boundary_error_p99", some(&|f| f.boundary_error.p99)),
        ("boundary_error_max", some(&|f| f.boundary_error.max)),
        ("interior_difference_rms", of(&|f| Some(f.interior_difference?.rms))),
        ("interior_difference_p99", of(&|f| Some(f.interior_difference?.p99))),
        ("interior_difference_max", of(&|f| Some(f.interior_difference?.max))),
        ("harmonic_energy", some(&|f| f.harmonic_energy)),
        ("deformation_energy", some(&|f| f.deformation_energy)),
        ("harmonic_energy_error", of(&|f| Some(f.errors?.harmonic))),
        ("deformation_energy_error", of(&|f| Some(f.errors?.deformation))),
        ("harmonic_density_median", some(&|f| f.harmonic_density.median)),
        ("harmonic_density_p99", some(&|f| f.harmonic_density.p99)),
        ("harmonic_density_max", some(&|f| f.harmonic_density.max)),
        ("inverted_tets", of(&|f| Some(f.inverted_tets? as f64))),
        ("folded_fraction", some(&|f| f.folded_fraction)),
        ("det_jacobian_min", some(&|f| f.min_det_jacobian)),
        ("det_jacobian_p1", of(&|f| Some(f.det_jacobian.as_ref()?.p1))),
        ("det_jacobian_median", of(&|f| Some(f.det_jacobian.as_ref()?.median))),
        ("conformal", of(&|f| Some(f.distortion.as_ref()?.conformal))),
        ("dirichlet", of(&|f| Some(f.distortion.as_ref()?.dirichlet))),
        (
            "symmetric_dirichlet",
            of(&|f| Some(f.distortion.as_ref()?.symmetric_dirichlet)),
        ),
        ("arap", of(&|f| Some(f.distortion.as_ref()?.arap))),
        ("mips", of(&|f| Some(f.distortion.as_ref()?.mips))),
    ]
}

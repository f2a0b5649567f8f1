//! The tables of a comparison, and notes on them.

use std::fmt::Write;

use super::job::{Figures, MethodRow};
use super::verdict::verdict;
use super::{Comparison, SequenceRow, Step, Study, StudyRun};
use crate::drawing::{Align, Table, TableContent, significant};
use crate::shared::output::mebibytes;

/// A piece of the text.
pub enum Part {
    /// The heading of what follows, on the page alone: text and Markdown go without.
    Title(&'static str),
    Words(String),
    Table(TableContent),
}

fn table<const N: usize>(columns: [(&str, &str, Align); N], rows: Vec<[String; N]>) -> Part {
    let mut table = Table::new(columns);
    rows.into_iter().for_each(|row| table.row(row));
    Part::Table(table.into_content())
}

/// The text and tables of a comparison, in order.
pub fn parts(comparison: &Comparison) -> Vec<Part> {
    let rows = &comparison.methods;
    let mut parts = vec![
        Part::Title("Time and memory"),
        cost(rows),
        Part::Title("Errors and energies"),
        accuracy(rows),
        Part::Title("Folds and distortion"),
        quality(rows),
        Part::Title("What the numbers are"),
        Part::Words(notes(comparison)),
    ];
    let errors = rows.iter().map(|row| (row.name.clone(), &row.error));
    if let Some(failures) = failures(errors) {
        parts.extend([Part::Title("Without a map"), failures]);
    }
    if !comparison.equal_accuracy.is_empty() {
        parts.push(Part::Title("Equal accuracy"));
        parts.push(Part::Words(verdict(&comparison.equal_accuracy)));
        parts.push(refinement(&comparison.equal_accuracy));
        let steps = comparison.equal_accuracy.iter();
        parts.extend(failures(
            steps.map(|step| (format!("{}, {}", step.row.name, step.what), &step.row.error)),
        ));
    }
    if !comparison.mesh_study.is_empty() {
        parts.push(Part::Title("Other meshes and source distances"));
        parts.push(Part::Words(
            "How far maps depend on meshes and source distances: distances inside from the mean of all maps of a \
             method, as fractions of the target's diagonal. The maps of variational differ also by where its descent \
             stops."
                .into(),
        ));
        parts.push(study(&comparison.mesh_study));
        let runs = comparison.mesh_study.iter().flat_map(|study| {
            let name = |run: &StudyRun| format!("{}, {}", study.method.name(), run.what);
            study.runs.iter().map(move |run| (name(run), &run.row.error))
        });
        parts.extend(failures(runs));
    }
    if !comparison.sequence.is_empty() {
        parts.push(Part::Title("A sequence"));
        parts.push(Part::Words(
            "A sequence. Together: mfs and fem solve all frames in a block, variational starts each from the frame \
             before. Setup: meshing, placing sources, factoring. The seconds of mfs include measuring its boundary \
             error; fem and variational have no boundary error but that of their mesh."
                .into(),
        ));
        parts.push(sequence(&comparison.sequence));
        let rows = comparison.sequence.iter();
        parts.extend(failures(rows.map(|row| (row.method.name().to_owned(), &row.error))));
        let skipped = comparison.sequence.iter().find_map(|row| row.figures.as_ref());
        let skipped = skipped.map(|figures| figures.skipped.join("\n")).unwrap_or_default();
        if !skipped.is_empty() {
            parts.push(Part::Words(format!("Frames left out:\n{skipped}")));
        }
    }
    parts
}

/// The errors of rows without figures, if there are any.
fn failures<'a>(rows: impl Iterator<Item = (String, &'a Option<String>)>) -> Option<Part> {
    let lines = rows.filter_map(|(name, error)| Some(format!("{name}: {}", error.as_ref()?)));
    let lines: Vec<String> = lines.collect();
    (!lines.is_empty()).then(|| Part::Words(lines.join("\n")))
}

const DASH: &str = "-";

/// A number, or a dash.
pub fn count(n: Option<usize>) -> String {
    n.map_or(DASH.into(), |n| n.to_string())
}

fn error(value: f64) -> String {
    format!("{value:.1e}")
}

/// Seconds, with as many digits as are significant.
pub fn seconds(value: f64) -> String {
    match value {
        0.0 => DASH.into(),
        v if v < 0.0095 => format!("{v:.4}"),
        v if v < 0.095 => format!("{v:.3}"),
        v => format!("{v:.2}"),
    }
}

/// A row: the method's name and `N − 1` entries, dashes for a method without figures.
fn line<const N: usize>(row: &MethodRow, cells: impl Fn(&Figures) -> Vec<String>) -> [String; N] {
    let mut line = vec![row.name.clone()];
    line.extend(row.figures.as_ref().map(cells).unwrap_or_default());
    std::array::from_fn(|k| line.get(k).cloned().unwrap_or(DASH.into()))
}

fn cost(rows: &[MethodRow]) -> Part {
    let cells = |f: &Figures| {
        let s = f.seconds;
        vec![
            // The other methods need no tets: theirs are carried to count inverted ones.
            if s.mesh > 0.0 { count(f.tets) } else { DASH.into() },
            if f.unknowns == 0 {
                DASH.into()
            } else {
                f.unknowns.to_string()
            },
            count(f.iterations),
            seconds(s.mesh),
            seconds(s.factor),
            seconds(s.solve),
            seconds(f.total_seconds()),
            seconds(s.evaluate),
            format!("{:.0}", mebibytes(f.peak_rss_bytes)),
        ]
    };
    table(
        [
            ("method", "", Align::Left),
            ("tets", "", Align::Right),
            ("unknowns", "", Align::Right),
            ("iterations", "", Align::Right),
            ("mesh", "s", Align::Right),
            ("factor", "s", Align::Right),
            ("solve", "s", Align::Right),
            ("sum", "s", Align::Right),
            ("evaluate", "s", Align::Right),
            ("peak", "MiB", Align::Right),
        ],
        rows.iter().map(|row| line(row, cells)).collect(),
    )
}

fn accuracy(rows: &[MethodRow]) -> Part {
    let cells = |f: &Figures| {
        let mut cells = vec![
            error(f.boundary_error.rms),
            error(f.boundary_error.p99),
            error(f.boundary_error.max),
        ];
        match f.interior_difference {
            Some(d) => cells.extend([d.rms, d.p99, d.max].map(error)),
            None => cells.extend([DASH; 3].map(String::from)),
        }
        cells.extend([
            format!("{:.5}", f.harmonic_energy),
            f.errors.map_or(DASH.into(), |e| format!("{:.5}", e.harmonic)),
            format!("{:.3}", f.harmonic_density.median),
            format!("{:.3}", f.harmonic_density.p99),
            format!("{:.3}", f.harmonic_density.max),
        ]);
        cells
    };
    table(
        [
            ("method", "", Align::Left),
            ("boundary error", "rms", Align::Right),
            ("", "99 %", Align::Right),
            ("", "max", Align::Right),
            ("difference inside", "rms", Align::Right),
            ("", "99 %", Align::Right),
            ("", "max", Align::Right),
            ("harmonic energy", "", Align::Right),
            ("", "±", Align::Right),
            ("density", "median", Align::Right),
            ("", "99 %", Align::Right),
            ("", "max", Align::Right),
        ],
        rows.iter().map(|row| line(row, cells)).collect(),
    )
}

fn quality(rows: &[MethodRow]) -> Part {
    let cells = |f: &Figures| {
        let mut cells = vec![count(f.inverted_tets), format!("{:.3}", 100.0 * f.folded_fraction)];
        match &f.det_jacobian {
            Some(d) => cells.extend([d.min, d.p1, d.median].map(|v| significant(v, 3))),
            None => cells.extend([DASH; 3].map(String::from)),
        }
        match &f.distortion {
            Some(d) => cells
                .extend([d.conformal, d.dirichlet, d.symmetric_dirichlet, d.arap, d.mips].map(|v| format!("{v:.3}"))),
            None => cells.extend([DASH; 5].map(String::from)),
        }
        cells
    };
    table(
        [
            ("method", "", Align::Left),
            ("flipped tets", "", Align::Right),
            ("folded", "% volume", Align::Right),
            ("det J", "min", Align::Right),
            ("", "1 %", Align::Right),
            ("", "median", Align::Right),
            ("conformal", "1", Align::Right),
            ("Dirichlet", "3", Align::Right),
            ("sym. D.", "6", Align::Right),
            ("ARAP", "0", Align::Right),
            ("MIPS", "1", Align::Right),
        ],
        rows.iter().map(|row| line(row, cells)).collect(),
    )
}

fn notes(comparison: &Comparison) -> String {
    let mut notes = String::from(
        "Boundary errors, at held-out points, and differences inside are fractions of the target's diagonal. Energies \
         and distortions are with both solids at unit volume, integrated to 1 % where that takes at most four times the \
         points of the grid (±: estimated error), det J is in model units; \
         under each distortion stands that of a rigid motion, and folded volume is left out of them. Flipped tets: \
         mfs and mean_value carry the mesh that fem solves on, its boundary by the boundary map, and need none \
         themselves. Evaluate: images and Jacobians at the points of the grid; it is all that mean_value costs, and \
         not in the sum. Peaks are those of whole processes. variational ends with the step that gains less than \
         --threshold, not at the minimum. mean_value is not harmonic. bijective is the map by mfs, \
         repaired over tetrahedra; its boundary error is that of triangles.",
    );
    if let Some(reference) = &comparison.reference {
        let _ = write!(
            notes,
            "\nThe reference inside is {}. From one with triangles four times as large it differs by {:.1e} rms and \
             {:.1e} at most; its own error is smaller, and differences of that order mean nothing. Its boundary error \
             is {:.1e} rms and {:.1e} at most.",
            reference.description,
            reference.difference_to_coarser.rms,
            reference.difference_to_coarser.max,
            reference.boundary_error.rms,
            reference.boundary_error.max
        );
    }
    notes
}

fn refinement(steps: &[Step]) -> Part {
    let rows = steps.iter().map(|step| {
        let mut cells = vec![step.row.name.clone(), step.what.clone()];
        match &step.row.figures {
            Some(f) => {
                let difference = f.interior_difference.unwrap_or_default();
                cells.extend([
                    count(f.tets.filter(|_| step.row.name != "mfs")),
                    seconds(f.seconds.mesh),
                    seconds(f.seconds.factor + f.seconds.solve),
                    seconds(f.total_seconds()),
                    format!("{:.0}", mebibytes(f.peak_rss_bytes)),
                    error(f.boundary_error.rms),
                    error(difference.rms),
                    error(difference.max),
                    format!("{:.5}", f.harmonic_energy),
                ]);
            }
            None => cells.extend([DASH; 9].map(String::from)),
        }
        std::array::from_fn(|k| cells.get(k).cloned().unwrap_or_default())
    });
    table(
        [
            ("method", "", Align::Left),
            ("refined to", "", Align::Left),
            ("tets", "", Align::Right),
            ("mesh", "s", Align::Right),
            ("factor and solve", "s", Align::Right),
            ("sum", "s", Align::Right),
            ("peak", "MiB", Align::Right),
            ("boundary error", "rms", Align::Right),
            ("difference inside", "rms", Align::Right),
            ("", "max", Align::Right),
            ("harmonic energy", "", Align::Right),
        ],
        rows.collect(),
    )
}

fn study(studies: &[Study]) -> Part {
    let mut rows: Vec<[String; 9]> = Vec::new();
    for study in studies {
        for run in &study.runs {
            let mut cells = vec![study.method.name().to_owned(), run.what.clone()];
            match &run.row.figures {
                Some(f) => {
                    let difference = f.interior_difference;
                    cells.extend([
                        count(f.tets.filter(|_| study.method.is_on_tets())),
                        error(f.boundary_error.rms),
                        difference.map_or(DASH.into(), |d| error(d.rms)),
                        difference.map_or(DASH.into(), |d| error(d.max)),
                        format!("{:.5}", f.harmonic_energy),
                    ]);
                }
                None => cells.extend([DASH; 5].map(String::from)),
            }
            rows.push(std::array::from_fn(|k| cells.get(k).cloned().unwrap_or_default()));
        }
        if let Some(spread) = study.spread {
            let mut cells: [String; 9] = Default::default();
            cells[0] = study.method.name().to_owned();
            cells[1] = "spread".into();
            cells[7] = error(spread.rms);
            cells[8] = error(spread.max);
            rows.push(cells);
        }
    }
    table(
        [
            ("method", "", Align::Left),
            ("varied", "", Align::Left),
            ("tets", "", Align::Right),
            ("boundary error", "rms", Align::Right),
            ("to reference", "rms", Align::Right),
            ("", "max", Align::Right),
            ("harmonic energy", "", Align::Right),
            ("from mean", "rms", Align::Right),
            ("", "max", Align::Right),
        ],
        rows,
    )
}

fn sequence(rows: &[SequenceRow]) -> Part {
    let lines = rows.iter().map(|row| {
        let mut cells = vec![row.method.name().to_owned()];
        match &row.figures {
            Some(f) => {
                let frames = f.frame_seconds.len();
                let alone = f.frame_seconds.iter().sum::<f64>() / frames as f64;
                cells.extend([
                    frames.to_string(),
                    f.skipped.len().to_string(),
                    seconds(f.setup_seconds),
                    seconds(alone),
                    seconds(f.together_seconds / frames as f64),
                    seconds(f.setup_seconds + f.together_seconds),
                    format!("{:.0}", mebibytes(f.peak_rss_bytes)),
                    error(f.boundary_error_p99),
                ]);
            }
            None => cells.extend([DASH; 8].map(String::from)),
        }
        std::array::from_fn(|k| cells.get(k).cloned().unwrap_or_default())
    });
    table(
        [
            ("method", "", Align::Left),
            ("frames", "", Align::Right),
            ("skipped", "", Align::Right),
            ("setup", "s", Align::Right),
            ("a frame alone", "s", Align::Right),
            ("together", "s", Align::Right),
            ("setup and all", "s", Align::Right),
            ("peak", "MiB", Align::Right),
            ("boundary error", "99 %, worst frame", Align::Right),
        ],
        lines.collect(),
    )
}

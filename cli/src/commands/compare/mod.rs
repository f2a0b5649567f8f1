//! `solidmap compare`: one boundary map through every method, measured alike.

mod export;
mod job;
mod metrics;
mod page;
mod pictures;
mod process;
mod runner;
mod tables;
mod verdict;
pub mod worker;
mod worker_sequence;

use std::path::Path;

use anyhow::{Context, ensure};
use serde::Serialize;
use solidmap::boundary_map::BoundaryMapError;
use solidmap::compare::{ComparedMethod, MapDifference, Reference, outward};

use crate::CommandOutcome;
use crate::args::{CompareArgs, MapMethod};
use crate::shared::input;
use crate::shared::interrupt;
use crate::shared::json::{FileName, file_name};
use crate::shared::made_folder::MadeFolder;
use crate::shared::output::{Output, describe, write_file};
use job::{Figures, MethodRow, SequenceFigures};
use runner::{Runner, methods_of};

/// The results of a comparison.
#[derive(Serialize)]
struct Comparison {
    domain: Option<FileName>,
    image: Option<FileName>,
    #[serde(skip_serializing_if = "Option::is_none")]
    boundary_file: Option<FileName>,
    reference: Option<Reference>,
    methods: Vec<MethodRow>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    equal_accuracy: Vec<Step>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    mesh_study: Vec<Study>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    sequence: Vec<SequenceRow>,
}

/// A map by finer finite elements, or by mfs at a tighter tolerance.
#[derive(Serialize)]
struct Step {
    what: String,
    #[serde(flatten)]
    row: MethodRow,
}

/// How much the maps of one method differ when meshes or source distances are varied, which should not matter.
#[derive(Serialize)]
struct Study {
    method: ComparedMethod,
    /// One run for each variation.
    runs: Vec<StudyRun>,
    /// Distances of the maps from their mean.
    spread: Option<MapDifference>,
}

#[derive(Serialize)]
struct StudyRun {
    what: String,
    #[serde(flatten)]
    row: MethodRow,
}

#[derive(Serialize)]
struct SequenceRow {
    method: ComparedMethod,
    error: Option<String>,
    #[serde(flatten)]
    figures: Option<SequenceFigures>,
}

/// Compares the methods on one boundary map.
pub fn run(args: &CompareArgs, threads: Option<u16>, output: &Output) -> anyhow::Result<CommandOutcome> {
    if let Some(table) = &args.metrics {
        return metrics::run(args, table, output);
    }
    require_valid(args)?;
    output.progress("reading");
    let source = args
        .files
        .source()
        .context("name a DOMAIN with its --image, or a --boundary")?;
    let boundary = match source.read() {
        // The files can be read, but are no boundary map: every row says so.
        Err(error) if error.is::<BoundaryMapError>() => return none_possible(args, &error, output),
        read => outward(read?)?,
    };
    input::require_solvable(boundary.domain(), source.domain())?;
    let _made = args.out.as_deref().map(MadeFolder::new).transpose()?;
    if let Some(folder) = &args.out {
        // Fails before the work, not after it. The file has no name, and is gone when it is dropped.
        tempfile::tempfile_in(folder).with_context(|| format!("cannot write to the folder `{}`", folder.display()))?;
    }
    let scratch = tempfile::tempdir().context("cannot make a temporary folder")?;
    interrupt::remove_folder_too(scratch.path());
    let runner = Runner {
        args,
        source: &source,
        threads,
        output,
        domain: boundary.domain(),
        diagonal: boundary.target_diagonal(),
        scratch: scratch.path(),
    };
    let section = match &args.out {
        Some(folder) => {
            clear(folder)?;
            Some(pictures::section(runner.section_view(), &boundary)?)
        }
        None => None,
    };
    let reference = if args.measure.no_reference {
        None
    } else {
        runner.reference()
    };
    let methods: Vec<MethodRow> = runner
        .methods()
        .map(|method| runner.row(method, reference.is_some()))
        .collect();
    let comparison = Comparison {
        domain: file_name(args.files.domain.as_ref()),
        image: file_name(args.files.image.as_ref()),
        boundary_file: file_name(args.files.boundary.as_ref()),
        equal_accuracy: runner.equal_accuracy(&methods),
        mesh_study: runner.mesh_study(reference.is_some()),
        sequence: runner.sequence(),
        reference,
        methods,
    };
    output.progress("writing");
    if let Some(folder) = &args.out {
        export::write(folder, &comparison)?;
    }
    output.result(&comparison, || export::text(&comparison))?;
    let notes = comparison.notes();
    notes.iter().for_each(|note| output.warn(note));
    if let (Some(folder), Some(section)) = (&args.out, &section) {
        let picture = pictures::draw(section, &runner, &comparison)?;
        if let Some(picture) = &picture {
            write_file(folder.join("comparison.png"), &picture.png)?;
        }
        let path = folder.join("comparison.html");
        write_file(
            &path,
            page::html(&runner, &comparison, picture.as_ref(), notes)?.as_bytes(),
        )?;
        output.note(format!("Look at {}", path.display()));
    }
    Ok(CommandOutcome::from_check(comparison.has_all(args)))
}

/// A table whose rows all have the same error.
fn none_possible(args: &CompareArgs, error: &anyhow::Error, output: &Output) -> anyhow::Result<CommandOutcome> {
    let error = describe(error);
    let row = |method: ComparedMethod| MethodRow {
        name: method.name().to_owned(),
        error: Some(error.clone()),
        figures: None,
    };
    let rows: Vec<MethodRow> = methods_of(args).map(row).collect();
    output.warn(&error);
    let comparison = Comparison {
        domain: file_name(args.files.domain.as_ref()),
        image: file_name(args.files.image.as_ref()),
        boundary_file: file_name(args.files.boundary.as_ref()),
        reference: None,
        methods: rows,
        equal_accuracy: vec![],
        mesh_study: vec![],
        sequence: vec![],
    };
    output.result(&comparison, || {
        let line = |row: &MethodRow| format!("{}: {error}", row.name);
        comparison.methods.iter().map(line).collect::<Vec<_>>().join("\n")
    })?;
    Ok(CommandOutcome::CheckFailed)
}

/// Removes the results of an earlier comparison, so that its maps do not stand among the new ones.
fn clear(folder: &Path) -> anyhow::Result<()> {
    let tables = ["txt", "md", "csv", "json", "png", "html"].map(|extension| format!("comparison.{extension}"));
    let maps = ComparedMethod::ALL.map(|method| method.name());
    let maps = maps.iter().flat_map(|name| {
        [
            format!("{name}.csv"),
            format!("{name}.vtu"),
            format!("{name}_energies.csv"),
        ]
    });
    let others = ["points.csv", "times.json"].map(String::from);
    for name in tables.into_iter().chain(maps).chain(others) {
        let path = folder.join(name);
        match std::fs::remove_file(&path) {
            Err(error) if error.kind() != std::io::ErrorKind::NotFound => {
                return Err(error).with_context(|| format!("cannot remove `{}`", path.display()));
            }
            _ => {}
        }
    }
    Ok(())
}

fn require_valid(args: &CompareArgs) -> anyhow::Result<()> {
    let measure = &args.measure;
    measure.section.require_valid()?;
    ensure!(
        measure.threshold > 0.0 && measure.threshold < 1.0,
        "--threshold is {}, but must be a fraction between 0 and 1",
        measure.threshold
    );
    ensure!(
        (1..=1000).contains(&measure.resolution),
        "--resolution is {}, but must be from 1 to 1000",
        measure.resolution
    );
    ensure!(
        args.tets.quality >= 1.1 && args.tets.quality.is_finite(),
        "--quality is {}, but must be a ratio of at least 1.1 (1.4 to 2 is usual)",
        args.tets.quality
    );
    ensure!(
        !args.equal_accuracy || args.methods.contains(&MapMethod::Mfs),
        "--equal-accuracy compares finite elements with mfs, which must be among the --methods"
    );
    ensure!(
        measure.tolerance > 0.0 && measure.tolerance.is_finite(),
        "--tolerance is {}, but must be a positive fraction of the target's diagonal",
        measure.tolerance
    );
    ensure!(
        (1..=10_000_000).contains(&measure.interior),
        "--interior is {}, but must be from 1 to 10 million",
        measure.interior
    );
    if let Some(size) = args.tets.mesh_size {
        ensure!(
            size > 0.0 && size.is_finite(),
            "--mesh-size is {size}, but must be a positive fraction of the domain's diagonal"
        );
    }
    Ok(())
}

impl Comparison {
    /// Whether every figure that was asked for is there. A refinement may end with a mesh over budget.
    fn has_all(&self, args: &CompareArgs) -> bool {
        let runs = self
            .mesh_study
            .iter()
            .flat_map(|study| study.runs.iter().map(|run| &run.row));
        let mut rows = self.methods.iter().chain(runs);
        let mut frames = self.sequence.iter();
        rows.all(|row| row.error.is_none())
            && (self.reference.is_some() || args.measure.no_reference)
            && (!self.equal_accuracy.is_empty() || !args.equal_accuracy)
            && frames.all(|row| row.figures.as_ref().is_some_and(|f| f.skipped.is_empty()))
    }

    /// What readers of the tables must know: remarks on the maps, and a reference that is no better than they are.
    fn notes(&self) -> Vec<String> {
        let found = self
            .methods
            .iter()
            .filter_map(|row| Some((&row.name, row.figures.as_ref()?)));
        let mut notes: Vec<String> = found
            .flat_map(|(name, figures)| figures.remarks.iter().map(move |remark| format!("{name}: {remark}")))
            .collect();
        if self.is_reference_poor() {
            notes.push(
                "the boundary error of the reference is larger than that of mfs; differences to it mean little".into(),
            );
        }
        notes
    }

    /// Whether the boundary error of the reference is larger than that of mfs.
    fn is_reference_poor(&self) -> bool {
        let mfs = self.methods.iter().find(|row| row.name == ComparedMethod::Mfs.name());
        let mfs = mfs.and_then(|row| row.figures.as_ref());
        let worse = |(reference, mfs): (&Reference, &Figures)| reference.boundary_error.rms > mfs.boundary_error.rms;
        self.reference.as_ref().zip(mfs).is_some_and(worse)
    }
}

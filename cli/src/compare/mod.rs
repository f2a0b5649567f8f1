//! `solidmap compare`

mod job;
mod pictures;
mod process;
mod tables;
pub mod worker;

use std::path::{Path, PathBuf};

use crate::drawing::Axis;
use anyhow::{Context, ensure};
use serde::Serialize;
use solidmap::boundary_map::BoundaryMapError;
use solidmap::compare::{ComparedMethod, InteriorImages, MapDifference, MeshSpec, TetMesher, spread};
use solidmap::io;
use solidmap::mesh::SurfaceMesh;

use super::args::{CompareArgs, MapMethod, Mesher};
use super::input::BoundarySource;
use super::output::Output;
use super::{Outcome, interrupt};
use job::{Cut, Figures, Job, Row, SAMPLES, SECTION_IMAGES, SequenceFigures, Task};
use worker::Reference;

/// Finite elements are refined so often at most, each time to about twice the tetrahedra.
const MOST_REFINEMENTS: usize = 14;
/// Tolerances of mfs beside them, over the one asked for.
const TIGHTER: [f64; 2] = [0.5, 0.25];
/// Qualities of TetGen's meshes in the study of what they matter.
const QUALITIES: [f64; 3] = [2.0, 1.414, 1.15];
/// Source distances of the same study, over the sources' spacing.
const ALPHAS: [f64; 4] = [0.8, 1.0, 1.25, 1.5];

/// All that was found.
#[derive(Serialize)]
struct Comparison {
    domain: Option<PathBuf>,
    image: Option<PathBuf>,
    #[serde(skip_serializing_if = "Option::is_none")]
    boundary_file: Option<PathBuf>,
    reference: Option<Reference>,
    methods: Vec<Row>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    equal_accuracy: Vec<Step>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    mesh_study: Vec<Study>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    sequence: Vec<SequenceRow>,
}

/// A refinement of the finite elements, or of mfs.
#[derive(Serialize)]
struct Step {
    what: String,
    #[serde(flatten)]
    row: Row,
}

/// How much the maps of one method differ.
#[derive(Serialize)]
struct Study {
    method: ComparedMethod,
    /// What was varied, and what came of it.
    runs: Vec<StudyRun>,
    /// Distances of the maps from their mean.
    spread: Option<MapDifference>,
}

#[derive(Serialize)]
struct StudyRun {
    what: String,
    #[serde(flatten)]
    row: Row,
}

#[derive(Serialize)]
struct SequenceRow {
    method: ComparedMethod,
    error: Option<String>,
    #[serde(flatten)]
    figures: Option<SequenceFigures>,
}

/// Compares the methods on one boundary map.
pub fn run(args: &CompareArgs, threads: Option<u16>, output: &Output) -> anyhow::Result<Outcome> {
    require_valid(args)?;
    output.progress("reading");
    let source = source(args)?;
    let boundary = match source.read() {
        // Files that can be read, but no map between them: every row says so.
        Err(error) if error.is::<BoundaryMapError>() => return none_possible(args, &error, output),
        read => worker::outward(read?)?,
    };
    require_solvable(boundary.domain(), source.domain())?;
    if let Some(folder) = &args.out {
        std::fs::create_dir_all(folder).with_context(|| format!("cannot make the folder `{}`", folder.display()))?;
        // Before the work, not after it. This file has no name.
        tempfile::tempfile_in(folder).with_context(|| format!("cannot write to the folder `{}`", folder.display()))?;
    }
    let scratch = tempfile::tempdir().context("cannot make a temporary folder")?;
    interrupt::remove_folder(scratch.path());
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
            Some(pictures::section(runner.cut(), &boundary)?)
        }
        None => None,
    };
    let reference = if args.measure.no_reference {
        None
    } else {
        runner.reference()
    };
    let methods: Vec<Row> = runner
        .methods()
        .map(|method| runner.row(method, reference.is_some()))
        .collect();
    let comparison = Comparison {
        domain: args.domain.clone(),
        image: args.image.clone(),
        boundary_file: args.boundary.clone(),
        equal_accuracy: runner.equal_accuracy(&methods),
        mesh_study: runner.mesh_study(reference.is_some()),
        sequence: runner.sequence(),
        reference,
        methods,
    };
    output.progress("writing");
    if let Some(folder) = &args.out {
        tables::write(folder, &comparison)?;
    }
    // The contract: a list of the methods. All else is in the folder.
    output.result(&comparison.methods, || tables::text(&comparison))?;
    let remarks = comparison
        .methods
        .iter()
        .filter_map(|row| Some((&row.name, row.figures.as_ref()?)));
    for (name, figures) in remarks {
        figures
            .remarks
            .iter()
            .for_each(|remark| output.warn(format!("{name}: {remark}")));
    }
    if comparison.is_reference_poor() {
        output.warn("the reference meets the boundary no better than mfs; differences to it mean little");
    }
    if let (Some(folder), Some(section)) = (&args.out, &section) {
        let path = folder.join("comparison.png");
        if pictures::write(&path, section, &runner, &boundary, &comparison)? {
            output.note(format!("Look at {}", path.display()));
        }
    }
    Ok(if comparison.has_all(args) {
        Outcome::Done
    } else {
        Outcome::CheckFailed
    })
}

fn source(args: &CompareArgs) -> anyhow::Result<BoundarySource> {
    match (args.domain.clone(), args.image.clone(), args.boundary.clone()) {
        (domain, None, Some(file)) => Ok(BoundarySource::File { file, domain }),
        (Some(domain), Some(image), None) => Ok(BoundarySource::Image { domain, image }),
        _ => anyhow::bail!("name a DOMAIN with its --image, or a --boundary"),
    }
}

/// A table of rows that all have the same reason to be empty.
fn none_possible(args: &CompareArgs, error: &anyhow::Error, output: &Output) -> anyhow::Result<Outcome> {
    let error = super::describe(error);
    let row = |method: ComparedMethod| Row {
        name: method.name().to_owned(),
        error: Some(error.clone()),
        figures: None,
    };
    let rows: Vec<Row> = methods_of(args).map(row).collect();
    output.warn(&error);
    output.result(&rows, || {
        let line = |row: &Row| format!("{}: {error}", row.name);
        rows.iter().map(line).collect::<Vec<_>>().join("\n")
    })?;
    Ok(Outcome::CheckFailed)
}

/// Removes what an earlier comparison left: its maps would stand among the new ones.
fn clear(folder: &Path) -> anyhow::Result<()> {
    let tables = ["txt", "md", "csv", "json", "png"].map(|extension| format!("comparison.{extension}"));
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
        "--equal-accuracy holds finite elements against mfs, which must be among the --methods"
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

/// No method can do anything with a surface that bounds no solid.
fn require_solvable(domain: &SurfaceMesh, path: &Path) -> anyhow::Result<()> {
    let report = solidmap::check::check(domain, None);
    ensure!(
        report.is_solvable(),
        "cannot map `{}`: {}",
        path.display(),
        solidmap::fit::FitError::DefectiveDomain(Box::new(report))
    );
    Ok(())
}

impl Comparison {
    /// Whether every figure that was asked for is there. Refinement may end with a mesh over budget: that is its way to end.
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

    /// Whether the reference is further from the boundary map than a map that is held against it.
    fn is_reference_poor(&self) -> bool {
        let mfs = self.methods.iter().find(|row| row.name == ComparedMethod::Mfs.name());
        let mfs = mfs.and_then(|row| row.figures.as_ref());
        let worse = |(reference, mfs): (&Reference, &Figures)| reference.boundary_error.rms > mfs.boundary_error.rms;
        self.reference.as_ref().zip(mfs).is_some_and(worse)
    }
}

/// Those asked for, in the order of tables.
fn methods_of(args: &CompareArgs) -> impl Iterator<Item = ComparedMethod> + use<> {
    let asked: Vec<ComparedMethod> = args.methods.iter().map(|&method| method.into()).collect();
    ComparedMethod::ALL
        .into_iter()
        .filter(move |method| asked.contains(method))
}

/// Sends jobs out, one at a time: they take all cores.
struct Runner<'a> {
    args: &'a CompareArgs,
    source: &'a BoundarySource,
    threads: Option<u16>,
    output: &'a Output,
    domain: &'a SurfaceMesh,
    /// Of the target.
    diagonal: f64,
    scratch: &'a Path,
}

impl Runner<'_> {
    fn methods(&self) -> impl Iterator<Item = ComparedMethod> {
        methods_of(self.args)
    }

    fn job(&self, task: Task, name: &str) -> Job {
        let (args, measure) = (self.args, &self.args.measure);
        Job {
            source: self.source.clone(),
            task,
            mesh: Some(self.mesh_spec()),
            given: args.tets.mesh.clone(),
            tolerance: measure.tolerance,
            alpha: 1.0,
            memory: args.budget.memory,
            threshold: measure.threshold,
            resolution: measure.resolution,
            interior: measure.interior,
            seed: measure.seed,
            section: args.out.as_ref().map(|_| self.cut()),
            reference: None,
            scratch: self.scratch.join(name),
            keep: None,
        }
    }

    fn cut(&self) -> Cut {
        let section = &self.args.measure.section;
        let plane = section.plane(self.domain);
        Cut {
            axis: plane.axis.index(),
            up: Axis::from(section.up).index(),
            position: plane.position,
        }
    }

    fn mesh_spec(&self) -> MeshSpec {
        let default = MeshSpec::of(self.domain);
        let tets = &self.args.tets;
        MeshSpec {
            source: match tets.mesher {
                Mesher::Tetgen => TetMesher::Tetgen,
                Mesher::Cgal => TetMesher::Mesh3,
            },
            edge: tets.mesh_size.or(default.edge),
            quality: tets.quality,
            most_tets: self.args.budget.max_tets,
            ..default
        }
    }

    fn run<T: serde::de::DeserializeOwned>(&self, job: &Job, label: &str) -> Result<T, String> {
        process::run(job, label, self.threads, self.args.budget.time_limit, self.output)
    }

    fn reference(&self) -> Option<Reference> {
        let mut job = self.job(Task::Reference, "reference");
        job.keep = self.args.out.clone();
        match self.run(&job, "reference") {
            Ok(reference) => Some(reference),
            Err(error) => {
                self.output
                    .warn(format!("there is no reference to hold maps against inside: {error}"));
                None
            }
        }
    }

    fn reference_files(&self) -> [PathBuf; 2] {
        let folder = self.scratch.join("reference");
        [folder.join(SAMPLES), folder.join(SECTION_IMAGES)]
    }

    /// Does a job of one method, which writes its figures.
    fn figures(&self, job: &Job, label: &str) -> Row {
        let method = match &job.task {
            Task::Method(method) => method.name(),
            _ => "",
        };
        let found: Result<Figures, String> = self.run(job, label);
        let name = method.to_owned();
        match found {
            Ok(figures) => Row {
                name,
                error: None,
                figures: Some(figures),
            },
            Err(error) => {
                self.output.warn(format!("{label}: {error}"));
                Row {
                    name,
                    error: Some(error),
                    figures: None,
                }
            }
        }
    }

    fn row(&self, method: ComparedMethod, has_reference: bool) -> Row {
        let mut job = self.job(Task::Method(method), method.name());
        job.reference = has_reference.then(|| self.reference_files());
        job.keep = self.args.out.clone();
        self.figures(&job, method.name())
    }

    /// Finer and finer elements, until they are as near to the reference as the method of fundamental solutions is; and
    /// that method at tighter tolerances.
    fn equal_accuracy(&self, methods: &[Row]) -> Vec<Step> {
        if !self.args.equal_accuracy {
            return Vec::new();
        }
        let difference = |row: &Row| Some(row.figures.as_ref()?.interior_difference?.rms);
        let mfs = methods.iter().find(|row| row.name == ComparedMethod::Mfs.name());
        let Some((mfs, goal)) = mfs.and_then(|row| Some((row, difference(row)?))) else {
            self.output
                .warn("there is no difference of mfs to the reference that finite elements could reach");
            return Vec::new();
        };
        let tolerance = self.args.measure.tolerance;
        let at = |tolerance: f64| format!("tolerance {tolerance:.1e}");
        let mut steps = vec![Step {
            what: at(tolerance),
            row: mfs.clone(),
        }];
        for factor in TIGHTER {
            let mut job = self.refined(ComparedMethod::Mfs, steps.len());
            job.tolerance = factor * tolerance;
            let what = at(job.tolerance);
            let row = self.figures(&job, &format!("mfs, {what}"));
            steps.push(Step { what, row });
        }
        for k in 0..MOST_REFINEMENTS {
            let (what, spec) = self.finer_mesh(k);
            let mut job = self.refined(ComparedMethod::Fem, steps.len());
            job.mesh = Some(spec);
            let row = self.figures(&job, &format!("fem, {what}"));
            let is_last = difference(&row).is_none_or(|rms| rms <= goal);
            let tets = |row: &Row| Some((row.name.clone(), row.figures.as_ref()?.tets));
            if !is_last && steps.last().is_some_and(|before| tets(&before.row) == tets(&row)) {
                continue;
            }
            steps.push(Step { what, row });
            if is_last {
                break;
            }
        }
        steps
    }

    fn refined(&self, method: ComparedMethod, number: usize) -> Job {
        let mut job = self.job(Task::Method(method), &format!("refined-{number}"));
        job.reference = Some(self.reference_files());
        job.section = None;
        job
    }

    /// Coarse inside at first, then with edges that shrink so that the tetrahedra double. A mesh keeps the triangles of the
    /// surface, which are cut where they are larger than the tetrahedra.
    fn finer_mesh(&self, k: usize) -> (String, MeshSpec) {
        let spec = self.mesh_spec();
        if k == 0 {
            let coarse = MeshSpec { edge: None, ..spec };
            return ("as coarse as can be".into(), coarse);
        }
        let coarsest = MeshSpec::of(self.domain).edge.unwrap_or(0.1);
        let edge = coarsest * 0.5f64.powf((k - 1) as f64 / 3.0);
        let surface = 0.5 * coarsest;
        let subdivisions = (surface / edge).log2().ceil().max(0.0) as u32;
        let spec = MeshSpec {
            subdivisions,
            edge: Some(edge),
            ..spec
        };
        (format!("edge {edge:.2e}"), spec)
    }

    /// The same solid on several meshes.
    fn mesh_study(&self, has_reference: bool) -> Vec<Study> {
        if !self.args.mesh_study {
            return Vec::new();
        }
        let on_meshes = |job: &mut Job, k: usize| {
            let spec = self.mesh_spec();
            let (spec, what) = match QUALITIES.get(k) {
                Some(&quality) => (
                    MeshSpec {
                        source: TetMesher::Tetgen,
                        quality,
                        ..spec
                    },
                    format!("TetGen, quality {quality}"),
                ),
                None => (
                    MeshSpec {
                        source: TetMesher::Mesh3,
                        ..spec
                    },
                    "Mesh_3".into(),
                ),
            };
            job.mesh = Some(spec);
            what
        };
        let with_sources = |job: &mut Job, k: usize| {
            job.alpha = ALPHAS[k];
            format!("sources at {} spacings", ALPHAS[k])
        };
        self.methods()
            .filter(|&method| method != ComparedMethod::MeanValue)
            .map(|method| {
                let runs = (0..4).map(|k| {
                    let mut job = self.job(Task::Method(method), &format!("study-{}-{k}", method.name()));
                    job.section = None;
                    job.reference = has_reference.then(|| self.reference_files());
                    let what = match method {
                        ComparedMethod::Mfs => with_sources(&mut job, k),
                        _ => on_meshes(&mut job, k),
                    };
                    let row = self.figures(&job, &format!("{}, {what}", method.name()));
                    let samples = row
                        .figures
                        .as_ref()
                        .and_then(|_| io::read_points(job.scratch.join(SAMPLES)).ok());
                    (StudyRun { what, row }, samples)
                });
                let (runs, samples): (Vec<_>, Vec<_>) = runs.unzip();
                let samples: Vec<InteriorImages> = samples
                    .into_iter()
                    .flatten()
                    .map(|images| InteriorImages { images })
                    .collect();
                Study {
                    method,
                    runs,
                    spread: spread(&samples, self.diagonal),
                }
            })
            .collect()
    }

    fn sequence(&self) -> Vec<SequenceRow> {
        if self.args.frames.is_empty() {
            return Vec::new();
        }
        let frames = &self.args.frames;
        let methods = self.methods().filter(|&method| method != ComparedMethod::MeanValue);
        methods
            .map(|method| {
                let job = self.job(
                    Task::Sequence(method, frames.clone()),
                    &format!("sequence-{}", method.name()),
                );
                let label = format!("sequence, {}", method.name());
                let (figures, error) = match self.run::<SequenceFigures>(&job, &label) {
                    Ok(figures) => (Some(figures), None),
                    Err(error) => {
                        self.output.warn(format!("{label}: {error}"));
                        (None, Some(error))
                    }
                };
                SequenceRow { method, error, figures }
            })
            .collect()
    }
}

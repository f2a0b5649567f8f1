//! `solidmap compare`

mod job;
mod pictures;
mod process;
mod tables;
pub mod worker;

use std::path::{Path, PathBuf};

use anyhow::{Context, ensure};
use serde::Serialize;
use solidmap::compare::{Difference, MeshSource, MeshSpec, Method, Samples, spread};
use solidmap::io;
use solidmap::mesh::SurfaceMesh;
use solidmap::report::Axis;

use super::args::{CompareArgs, Mesher};
use super::output::Output;
use super::{Outcome, input};
use job::{Cut, Figures, Job, Row, SAMPLES, SECTION_IMAGES, SequenceFigures, Task};
use worker::Reference;

/// Finite elements are refined so often at most, each time with about four times the tetrahedra.
const MOST_REFINEMENTS: usize = 8;
/// Qualities of TetGen's meshes in the study of what they matter.
const QUALITIES: [f64; 3] = [2.0, 1.414, 1.15];
/// Source distances of the same study, over the sources' spacing.
const ALPHAS: [f64; 4] = [0.8, 1.0, 1.25, 1.5];

/// All that was found.
#[derive(Serialize)]
struct Comparison {
    domain: PathBuf,
    image: PathBuf,
    reference: Option<Reference>,
    methods: Vec<Row>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    equal_accuracy: Vec<Step>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    mesh_study: Vec<Study>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    sequence: Vec<SequenceRow>,
}

/// A refinement of the finite elements.
#[derive(Serialize)]
struct Step {
    subdivisions: u32,
    /// Over the domain's diagonal.
    edge: Option<f64>,
    #[serde(flatten)]
    row: Row,
}

/// How much the maps of one method differ.
#[derive(Serialize)]
struct Study {
    method: Method,
    /// What was varied, and what came of it.
    runs: Vec<StudyRun>,
    /// Distances of the maps from their mean.
    spread: Option<Difference>,
}

#[derive(Serialize)]
struct StudyRun {
    what: String,
    #[serde(flatten)]
    row: Row,
}

#[derive(Serialize)]
struct SequenceRow {
    method: Method,
    error: Option<String>,
    #[serde(flatten)]
    figures: Option<SequenceFigures>,
}

/// Compares the methods on one boundary map.
pub fn run(args: &CompareArgs, threads: Option<u16>, output: &Output) -> anyhow::Result<Outcome> {
    require_valid(args)?;
    output.progress("reading");
    let boundary = worker::outward(input::read_boundary_map(&args.domain, &args.image)?)?;
    require_solvable(boundary.domain(), &args.domain)?;
    if let Some(folder) = &args.out {
        std::fs::create_dir_all(folder).with_context(|| format!("cannot make the folder `{}`", folder.display()))?;
        // Before the work, not after it. This file has no name.
        tempfile::tempfile_in(folder).with_context(|| format!("cannot write to the folder `{}`", folder.display()))?;
    }
    let scratch = tempfile::tempdir().context("cannot make a temporary folder")?;
    let runner = Runner {
        args,
        threads,
        output,
        domain: boundary.domain(),
        diagonal: boundary.target_diagonal(),
        scratch: scratch.path(),
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
        equal_accuracy: runner.equal_accuracy(&methods),
        mesh_study: runner.mesh_study(reference.is_some()),
        sequence: runner.sequence(),
        reference,
        methods,
    };
    output.progress("writing");
    if let Some(folder) = &args.out {
        tables::write(folder, &comparison)?;
        pictures::write(folder, &runner, &boundary, &comparison)?;
    }
    // The contract: a list of the methods. All else is in the folder.
    output.result(&comparison.methods, || tables::text(&comparison))?;
    if let Some(folder) = &args.out {
        output.note(format!("Look at {}", folder.join("comparison.png").display()));
    }
    let has_reference = args.measure.no_reference || comparison.reference.is_some();
    Ok(if has_reference && comparison.is_whole() {
        Outcome::Done
    } else {
        Outcome::CheckFailed
    })
}

fn require_valid(args: &CompareArgs) -> anyhow::Result<()> {
    let budget = &args.budget;
    ensure!(
        budget.time_limit > 0.0 && budget.time_limit.is_finite(),
        "--time-limit is {}, but must be a positive number of seconds",
        budget.time_limit
    );
    let measure = &args.measure;
    measure.section.require_valid()?;
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
    /// Whether every figure that was asked for is there.
    fn is_whole(&self) -> bool {
        let rows = self
            .methods
            .iter()
            .chain(self.equal_accuracy.iter().map(|step| &step.row));
        let runs = self
            .mesh_study
            .iter()
            .flat_map(|study| study.runs.iter().map(|run| &run.row));
        rows.chain(runs).all(|row| row.error.is_none())
            && self.sequence.iter().all(|row| row.error.is_none())
            && self
                .sequence
                .iter()
                .flat_map(|row| &row.figures)
                .all(|f| f.skipped.is_empty())
    }
}

/// Sends jobs out, one at a time: they take all cores.
struct Runner<'a> {
    args: &'a CompareArgs,
    threads: Option<u16>,
    output: &'a Output,
    domain: &'a SurfaceMesh,
    /// Of the target.
    diagonal: f64,
    scratch: &'a Path,
}

impl Runner<'_> {
    fn methods(&self) -> impl Iterator<Item = Method> {
        let asked: Vec<Method> = self.args.methods.iter().map(|&method| method.into()).collect();
        Method::ALL.into_iter().filter(move |method| asked.contains(method))
    }

    fn job(&self, task: Task, name: &str) -> Job {
        let (args, measure) = (self.args, &self.args.measure);
        Job {
            domain: args.domain.clone(),
            image: args.image.clone(),
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
                Mesher::Tetgen => MeshSource::Tetgen,
                Mesher::Cgal => MeshSource::Mesh3,
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

    fn row(&self, method: Method, has_reference: bool) -> Row {
        let mut job = self.job(Task::Method(method), method.name());
        job.reference = has_reference.then(|| self.reference_files());
        job.keep = self.args.out.clone();
        self.figures(&job, method.name())
    }

    /// Finer and finer elements, until they are as near to the reference as the method of fundamental solutions is.
    fn equal_accuracy(&self, methods: &[Row]) -> Vec<Step> {
        let difference = |row: &Row| Some(row.figures.as_ref()?.interior_difference?.rms);
        let mfs = methods
            .iter()
            .find(|row| row.name == Method::Mfs.name())
            .and_then(difference);
        let (true, Some(goal)) = (self.args.equal_accuracy, mfs) else {
            if self.args.equal_accuracy {
                self.output
                    .warn("there is no difference of mfs to the reference that finite elements could reach");
            }
            return Vec::new();
        };
        let mut steps: Vec<Step> = Vec::new();
        let mean = MeshSpec::of(self.domain).edge.unwrap_or(0.1);
        for k in 0..MOST_REFINEMENTS {
            // Coarse inside at first; then as fine as the surface; then the surface too.
            let (subdivisions, edge) = match k {
                0 => (0, None),
                1 => (0, Some(2.0 * mean)),
                2 => (0, Some(mean)),
                k => ((k - 2) as u32, Some(mean * 0.5f64.powi(k as i32 - 2))),
            };
            let mut job = self.job(Task::Method(Method::Fem), &format!("fem-{k}"));
            job.mesh = Some(MeshSpec {
                subdivisions,
                edge,
                ..self.mesh_spec()
            });
            job.reference = Some(self.reference_files());
            job.section = None;
            let row = self.figures(&job, &format!("fem, refinement {k}"));
            let reached = difference(&row).is_none_or(|rms| rms <= goal);
            steps.push(Step {
                subdivisions,
                edge,
                row,
            });
            if reached {
                break;
            }
        }
        steps
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
                        source: MeshSource::Tetgen,
                        quality,
                        ..spec
                    },
                    format!("TetGen, quality {quality}"),
                ),
                None => (
                    MeshSpec {
                        source: MeshSource::Mesh3,
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
            .filter(|&method| method != Method::MeanValue)
            .map(|method| {
                let runs = (0..4).map(|k| {
                    let mut job = self.job(Task::Method(method), &format!("study-{}-{k}", method.name()));
                    job.section = None;
                    job.reference = has_reference.then(|| self.reference_files());
                    let what = match method {
                        Method::Mfs => with_sources(&mut job, k),
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
                let samples: Vec<Samples> = samples.into_iter().flatten().map(|images| Samples { images }).collect();
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
        let methods = self.methods().filter(|&method| method != Method::MeanValue);
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

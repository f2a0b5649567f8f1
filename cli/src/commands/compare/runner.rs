//! The jobs of a comparison, one at a time, since each uses all cores.

use std::iter;
use std::path::{Path, PathBuf};

use solidmap::compare::{
    ComparedMethod, InteriorImages, MeshSpec, Reference, TetMesher, Variation, equal_accuracy, spread,
};
use solidmap::geometry::Axis;
use solidmap::io;
use solidmap::mesh::SurfaceMesh;

use super::job::{Figures, Job, MethodRow, SAMPLES, SECTION_IMAGES, SectionView, SequenceFigures, Task};
use super::process;
use super::{SequenceRow, Step, Study, StudyRun};
use crate::args::{CompareArgs, Mesher};
use crate::shared::input::BoundarySource;
use crate::shared::output::Output;

/// The methods asked for, in the order of tables.
pub fn methods_of(args: &CompareArgs) -> impl Iterator<Item = ComparedMethod> + use<> {
    let asked: Vec<ComparedMethod> = args.methods.iter().map(|&method| method.into()).collect();
    ComparedMethod::ALL
        .into_iter()
        .filter(move |method| asked.contains(method))
}

/// Runs jobs in processes of their own.
pub struct Runner<'a> {
    pub args: &'a CompareArgs,
    pub source: &'a BoundarySource,
    pub threads: Option<u16>,
    pub output: &'a Output,
    pub domain: &'a SurfaceMesh,
    /// Diagonal of the target.
    pub diagonal: f64,
    pub scratch: &'a Path,
}

impl Runner<'_> {
    /// The methods asked for.
    pub fn methods(&self) -> impl Iterator<Item = ComparedMethod> {
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
            section: args.out.as_ref().map(|_| self.section_view()),
            reference: None,
            scratch: self.scratch.join(name),
            keep: None,
        }
    }

    /// The section that pictures show.
    pub fn section_view(&self) -> SectionView {
        let section = &self.args.measure.section;
        let plane = section.plane(self.domain);
        SectionView {
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

    /// Makes a finer map that the others are compared with.
    pub fn reference(&self) -> Option<Reference> {
        let mut job = self.job(Task::Reference, "reference");
        job.keep = self.args.out.clone();
        match self.run(&job, "reference") {
            Ok(reference) => Some(reference),
            Err(error) => {
                self.output.warn(format!(
                    "no reference could be made, so maps are not compared inside: {error}"
                ));
                None
            }
        }
    }

    /// Files of images by the reference: of the points inside, and of those of the section.
    pub fn reference_files(&self) -> [PathBuf; 2] {
        let folder = self.scratch.join("reference");
        [folder.join(SAMPLES), folder.join(SECTION_IMAGES)]
    }

    /// Runs a job of one method.
    fn figures(&self, job: &Job, label: &str) -> MethodRow {
        let method = match &job.task {
            Task::Method(method) => method.name(),
            _ => "",
        };
        let found: Result<Figures, String> = self.run(job, label);
        let name = method.to_owned();
        match found {
            Ok(figures) => MethodRow {
                name,
                error: None,
                figures: Some(figures),
            },
            Err(error) => {
                self.output.warn_of_fit(format!("{label}: {error}"));
                MethodRow {
                    name,
                    error: Some(error),
                    figures: None,
                }
            }
        }
    }

    /// The figures of a method.
    pub fn row(&self, method: ComparedMethod, has_reference: bool) -> MethodRow {
        let mut job = self.job(Task::Method(method), method.name());
        job.reference = has_reference.then(|| self.reference_files());
        job.keep = self.args.out.clone();
        self.figures(&job, method.name())
    }

    /// Finer and finer elements, until their difference to the reference is no larger than that of mfs; and mfs at
    /// tighter tolerances.
    pub fn equal_accuracy(&self, methods: &[MethodRow]) -> Vec<Step> {
        if !self.args.equal_accuracy {
            return Vec::new();
        }
        let difference = |row: &MethodRow| Some(row.figures.as_ref()?.interior_difference?.rms);
        let mfs = methods.iter().find(|row| row.name == ComparedMethod::Mfs.name());
        let Some((mfs, goal)) = mfs.and_then(|row| Some((row, difference(row)?))) else {
            self.output
                .warn("mfs has no difference to the reference that finite elements could reach");
            return Vec::new();
        };
        let base = self.variation(ComparedMethod::Mfs);
        let mut number = 0;
        let mut run = |varied: &Variation| {
            number += 1;
            let mut job = self.varied_job(varied, &format!("refined-{number}"));
            job.reference = Some(self.reference_files());
            self.figures(&job, &format!("{}, {}", varied.method.name(), varied.what))
        };
        let first = Step {
            what: base.what.clone(),
            row: mfs.clone(),
        };
        let refined = equal_accuracy(self.domain, &base, goal, &mut run, MethodRow::map_figures);
        let refined = refined
            .into_iter()
            .map(|(Variation { what, .. }, row)| Step { what, row });
        iter::once(first).chain(refined).collect()
    }

    /// A method as it is run for the tables.
    fn variation(&self, method: ComparedMethod) -> Variation {
        Variation::of(method, self.args.measure.tolerance, self.mesh_spec())
    }

    fn varied_job(&self, varied: &Variation, name: &str) -> Job {
        let mut job = self.job(Task::Method(varied.method), name);
        job.tolerance = varied.tolerance;
        job.alpha = varied.alpha;
        job.mesh = Some(varied.mesh);
        job.section = None;
        job
    }

    /// Maps of the same boundary map on several meshes, and with several source distances.
    pub fn mesh_study(&self, has_reference: bool) -> Vec<Study> {
        if !self.args.mesh_study {
            return Vec::new();
        }
        self.methods()
            .filter(|method| method.is_prepared())
            .map(|method| {
                let varied = self.variation(method).study().into_iter().enumerate();
                let runs = varied.map(|(k, varied)| {
                    let mut job = self.varied_job(&varied, &format!("study-{}-{k}", method.name()));
                    job.reference = has_reference.then(|| self.reference_files());
                    let what = varied.what;
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

    /// The time of each frame, by each method.
    pub fn sequence(&self) -> Vec<SequenceRow> {
        if self.args.frames.is_empty() {
            return Vec::new();
        }
        let frames = &self.args.frames;
        let methods = self.methods().filter(|method| method.is_prepared());
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
                        self.output.warn_of_fit(format!("{label}: {error}"));
                        (None, Some(error))
                    }
                };
                SequenceRow { method, error, figures }
            })
            .collect()
    }
}

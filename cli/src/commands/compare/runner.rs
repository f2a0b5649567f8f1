//! The jobs of a comparison, one at a time, since each uses all cores.

use std::path::{Path, PathBuf};

use solidmap::compare::{ComparedMethod, InteriorImages, MeshSpec, TetMesher, spread};
use solidmap::geometry::Axis;
use solidmap::io;
use solidmap::mesh::SurfaceMesh;

use super::job::{Figures, Job, MethodRow, SAMPLES, SECTION_IMAGES, SectionView, SequenceFigures, Task};
use super::process;
use super::worker::Reference;
use super::{SequenceRow, Step, Study, StudyRun};
use crate::args::{CompareArgs, Mesher};
use crate::shared::input::BoundarySource;
use crate::shared::output::Output;

/// Refinements of the finite elements at most, each to about twice the tetrahedra.
const MOST_REFINEMENTS: usize = 14;
/// Tighter tolerances of mfs, as fractions of the one asked for.
const TIGHTER: [f64; 2] = [0.5, 0.25];
/// Radius-edge ratios of TetGen's meshes in the mesh study.
const QUALITIES: [f64; 3] = [2.0, 1.414, 1.15];
/// Source distances in the mesh study, over the sources' spacing.
const ALPHAS: [f64; 4] = [0.8, 1.0, 1.25, 1.5];

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
        let tolerance = self.args.measure.tolerance;
        let at = |tolerance: f64| format!("tolerance {tolerance:.1e}");
        let mut steps = vec![Step {
            what: at(tolerance),
            row: mfs.clone(),
        }];
        for factor in TIGHTER {
            let mut job = self.refinement_job(ComparedMethod::Mfs, steps.len());
            job.tolerance = factor * tolerance;
            let what = at(job.tolerance);
            let row = self.figures(&job, &format!("mfs, {what}"));
            steps.push(Step { what, row });
        }
        for k in 0..MOST_REFINEMENTS {
            let (what, spec) = self.finer_mesh(k);
            let mut job = self.refinement_job(ComparedMethod::Fem, steps.len());
            job.mesh = Some(spec);
            let row = self.figures(&job, &format!("fem, {what}"));
            let is_last = difference(&row).is_none_or(|rms| rms <= goal);
            let tets = |row: &MethodRow| Some((row.name.clone(), row.figures.as_ref()?.tets));
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

    fn refinement_job(&self, method: ComparedMethod, number: usize) -> Job {
        let mut job = self.job(Task::Method(method), &format!("refined-{number}"));
        job.reference = Some(self.reference_files());
        job.section = None;
        job
    }

    /// The mesh of refinement `k`: coarse inside at first, then with edges so much shorter that the tetrahedra double.
    /// A mesh keeps the triangles of the surface, which are cut when they are larger than the tetrahedra.
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

    /// Maps of the same boundary map on several meshes, and with several source distances.
    pub fn mesh_study(&self, has_reference: bool) -> Vec<Study> {
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
            .filter(|method| method.is_prepared())
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

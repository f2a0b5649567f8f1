//! The worker process, which makes and measures one map.

use std::io::{Read, Write};
use std::path::Path;

use serde::Serialize;
use solidmap::baseline::{DescentOptions, HarmonicOptions, TetMap};
use solidmap::boundary_map::BoundaryMap;
use solidmap::compare::{
    self, BuildOptions, ComparedMethod, EvaluationOptions, InteriorImages, MapEvaluator, MeshSpec, Reference, build,
    measured_map,
};
use solidmap::energy::{EnergyOptions, densities, harmonic_density};
use solidmap::fit::{FitMethod, FitOptions};
use solidmap::geometry::PlaneSection;
use solidmap::io::{self, Cells, Field, VtkFields};
use solidmap::map::VolumeMap;
use solidmap::mesh::TetMesh;
use solidmap::solver::SchwarzOptions;
use solidmap::{Matrix3, Point};

use super::job::{Figures, Job, RESULT, SAMPLES, SECTION_DENSITY, SECTION_IMAGES, Task};
use super::pictures;
use super::worker_sequence::sequence;
use crate::CommandOutcome;
use crate::args::CompareWorkerArgs;
use crate::shared::output::{peak_rss_bytes, write_file};

/// Runs the job in a file, and writes the result to its scratch folder.
pub fn run(args: &CompareWorkerArgs) -> anyhow::Result<CommandOutcome> {
    end_with_parent();
    let text = std::fs::read_to_string(&args.job)?;
    let job: Job = serde_json::from_str(&text)?;
    let boundary = compare::outward(job.source.read()?)?;
    match &job.task {
        Task::Method(method) => write_result(&job, &measured(&job, &boundary, *method)?)?,
        Task::Reference => write_result(&job, &reference(&job, &boundary)?)?,
        Task::Sequence(method, frames) => write_result(&job, &sequence(&job, &boundary, *method, frames)?)?,
    }
    Ok(CommandOutcome::Done)
}

/// Ends this process when the one that started it has ended, which closes standard input.
fn end_with_parent() {
    std::thread::spawn(|| {
        let _ = std::io::stdin().read_to_end(&mut Vec::new());
        io::abandon_writes();
        std::process::exit(2);
    });
}

/// Prints progress, which the process that waits shows.
pub fn tell(what: String) {
    let mut stdout = std::io::stdout().lock();
    let _ = writeln!(stdout, "{what}").and_then(|()| stdout.flush());
}

fn write_result(job: &Job, result: &impl Serialize) -> anyhow::Result<()> {
    write_file(job.scratch.join(RESULT), &serde_json::to_vec(result)?)
}

/// The settings of mfs.
pub fn fit_options(job: &Job) -> FitOptions {
    FitOptions {
        tolerance: job.tolerance,
        method: FitMethod::Schwarz {
            alpha: job.alpha,
            options: SchwarzOptions::default(),
        },
        memory: job.memory,
        seed: job.seed,
        ..FitOptions::default()
    }
}

fn evaluator<'a>(job: &Job, boundary: &'a BoundaryMap) -> anyhow::Result<MapEvaluator<'a>> {
    tell("placing sample points".into());
    let options = EvaluationOptions {
        resolution: job.resolution,
        interior: job.interior,
        seed: job.seed,
        ..EvaluationOptions::default()
    };
    Ok(MapEvaluator::new(boundary, &options)?)
}

/// The settings of a map by `method`, over the tetrahedra that are `given` if any are.
pub fn build_options<'a>(
    job: &Job,
    boundary: &BoundaryMap,
    method: ComparedMethod,
    given: Option<&'a TetMesh>,
) -> BuildOptions<'a> {
    BuildOptions {
        method,
        fit: fit_options(job),
        harmonic: HarmonicOptions::default(),
        descent: DescentOptions {
            threshold: job.threshold,
            ..DescentOptions::default()
        },
        mesh: job.mesh.unwrap_or_else(|| MeshSpec::of(boundary.domain())),
        given,
    }
}

fn measured(job: &Job, boundary: &BoundaryMap, method: ComparedMethod) -> anyhow::Result<Figures> {
    let given = job.given.as_ref().map(io::read_tets).transpose()?;
    let options = build_options(job, boundary, method, given.as_ref());
    let built = build(boundary, &options, &tell)?;
    let peak_rss_bytes = peak_rss_bytes();
    let evaluator = evaluator(job, boundary)?;
    let reference = job.reference.as_ref().map(|[images, _]| io::read_points(images));
    let reference = reference.transpose()?.map(|images| InteriorImages { images });
    let found = measured_map(boundary, &options, built, &evaluator, reference.as_ref(), &tell)?;
    write_points(&job.scratch.join(SAMPLES), &found.interior.images)?;
    if let Some(view) = job.section {
        write_section(job, &pictures::section(view, boundary)?, boundary, &*found.built.map)?;
    }
    if let Some(folder) = &job.keep {
        tell("writing".into());
        keep(folder, method, &evaluator, &found.interior, found.on_tets.as_ref())?;
        let energies = &found.built.energies;
        if !energies.is_empty() {
            let history: Vec<f64> = energies.iter().enumerate().flat_map(|(i, &e)| [i as f64, e]).collect();
            let path = folder.join(format!("{}_energies.csv", method.name()));
            io::write_csv(path, &["step", "energy"], &history)?;
        }
    }
    Ok(Figures {
        map: found.figures,
        peak_rss_bytes,
    })
}

/// Writes images and the harmonic energy density on the section, with both solids at unit volume as in the tables.
fn write_section(job: &Job, section: &PlaneSection, boundary: &BoundaryMap, map: &dyn VolumeMap) -> anyhow::Result<()> {
    write_points(&job.scratch.join(SECTION_IMAGES), &map.evaluate(section.points()))?;
    let volumes = [boundary.domain().volume(), boundary.target_volume()];
    let options = EnergyOptions::default();
    let densities = densities(map, section.points(), volumes[0], volumes[1], &options)?;
    Ok(io::write_npy(
        job.scratch.join(SECTION_DENSITY),
        1,
        &densities.harmonic,
    )?)
}

fn write_points(path: &Path, points: &[Point]) -> anyhow::Result<()> {
    let coordinates: Vec<f64> = points.iter().flat_map(|p| p.iter().copied()).collect();
    Ok(io::write_npy(path, 3, &coordinates)?)
}

/// Writes the map's values at the points inside and the carried tet mesh, for the user.
fn keep(
    folder: &Path,
    method: ComparedMethod,
    evaluator: &MapEvaluator,
    samples: &InteriorImages,
    carried: Option<&(TetMesh, Vec<Point>)>,
) -> anyhow::Result<()> {
    let name = method.name();
    let pairs = evaluator.interior().iter().zip(&samples.images);
    let table: Vec<f64> = pairs.flat_map(|(p, f)| [p.x, p.y, p.z, f.x, f.y, f.z]).collect();
    io::write_csv(
        folder.join(format!("{name}.csv")),
        &["x", "y", "z", "fx", "fy", "fz"],
        &table,
    )?;
    let Some((mesh, images)) = carried else { return Ok(()) };
    let jacobians = TetMap::new(mesh.clone(), images.clone())?.jacobians();
    let fields = VtkFields {
        point: vec![Field::positions("image", images)],
        cell: vec![
            Field::scalar("harmonic_energy", jacobians.iter().map(harmonic_density).collect()),
            Field::scalar("det_jacobian", jacobians.iter().map(Matrix3::determinant).collect()),
        ],
        ..VtkFields::default()
    };
    let path = folder.join(format!("{name}.vtu"));
    Ok(io::write_vtu(path, mesh.vertices(), Cells::Tets(mesh.tets()), &fields)?)
}

fn reference(job: &Job, boundary: &BoundaryMap) -> anyhow::Result<Reference> {
    let evaluator = evaluator(job, boundary)?;
    let (fit, found) = compare::reference(boundary, &fit_options(job), &evaluator, &tell)?;
    write_points(&job.scratch.join(SAMPLES), &evaluator.interior_images(&fit.map)?.images)?;
    if let Some(view) = job.section {
        write_section(job, &pictures::section(view, boundary)?, boundary, &fit.map)?;
    }
    if let Some(folder) = &job.keep {
        let points: Vec<f64> = evaluator.interior().iter().flat_map(|p| p.iter().copied()).collect();
        io::write_csv(folder.join("points.csv"), &["x", "y", "z"], &points)?;
    }
    Ok(found)
}

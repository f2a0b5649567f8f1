//! The worker process, which makes and measures one map.

use std::io::{Read, Write};
use std::path::Path;
use std::time::Instant;

use serde::Serialize;
use solidmap::baseline::{DescentOptions, HarmonicOptions, TetMap};
use solidmap::boundary_map::BoundaryMap;
use solidmap::check;
use solidmap::compare::{
    BuildOptions, BuiltMap, ComparedMethod, EvaluationOptions, FoldCount, InteriorImages, MapDifference, MapEvaluator,
    MeshSpec, build, carried, mesh_for,
};
use solidmap::energy::{EnergyOptions, densities, harmonic_density};
use solidmap::fit::{FitMethod, FitOptions};
use solidmap::geometry::PlaneSection;
use solidmap::io::{self, Cells, VtkFields};
use solidmap::map::VolumeMap;
use solidmap::mesh::TetMesh;
use solidmap::solver::SchwarzOptions;
use solidmap::{Matrix3, Point};

use super::job::{Figures, Job, RESULT, SAMPLES, SECTION_DENSITY, SECTION_IMAGES, Task};
use super::pictures;
use super::worker_sequence::sequence;
use crate::CommandOutcome;
use crate::args::CompareWorkerArgs;
use crate::shared::fields::{positions, scalar};
use crate::shared::output::{describe, peak_rss_bytes, write_file};

/// With fewer vertices, the triangles of the reference are cut into four once more.
const MOST_REFERENCE_VERTICES: usize = 25_000;

/// Runs the job in a file, and writes the result to its scratch folder.
pub fn run(args: &CompareWorkerArgs) -> anyhow::Result<CommandOutcome> {
    end_with_parent();
    let text = std::fs::read_to_string(&args.job)?;
    let job: Job = serde_json::from_str(&text)?;
    let boundary = outward(job.source.read()?)?;
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

/// The boundary map over its domain with outward faces.
pub fn outward(boundary: BoundaryMap) -> anyhow::Result<BoundaryMap> {
    let (repaired, repairs) = check::repair(boundary.domain());
    if repairs.is_empty() {
        return Ok(boundary);
    }
    Ok(boundary.over(repaired)?)
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

/// The settings of the variational method.
pub fn descent(job: &Job) -> DescentOptions {
    DescentOptions {
        threshold: job.threshold,
        ..DescentOptions::default()
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

/// How the domain is meshed.
pub fn mesh_spec(job: &Job, boundary: &BoundaryMap) -> MeshSpec {
    job.mesh.unwrap_or_else(|| MeshSpec::of(boundary.domain()))
}

fn measured(job: &Job, boundary: &BoundaryMap, method: ComparedMethod) -> anyhow::Result<Figures> {
    let given = job.given.as_ref().map(io::read_tets).transpose()?;
    let spec = mesh_spec(job, boundary);
    let options = BuildOptions {
        method,
        fit: fit_options(job),
        harmonic: HarmonicOptions::default(),
        descent: descent(job),
        mesh: spec,
        given: given.as_ref(),
    };
    let BuiltMap {
        map,
        tets,
        unknowns,
        iterations,
        energies,
        mut seconds,
        ..
    } = build(boundary, &options, &tell)?;
    let peak = peak_rss_bytes();

    let evaluator = evaluator(job, boundary)?;
    tell(format!(
        "measuring from {} points on",
        evaluator.quadrature().points().len()
    ));
    let found = evaluator.measure(&*map)?;
    seconds.evaluate = found.evaluate_seconds;
    let samples = evaluator.interior_images(&*map)?;
    let interior_difference = match &job.reference {
        Some([reference, _]) => {
            let images = io::read_points(reference)?;
            Some(evaluator.difference(&samples, &InteriorImages { images }))
        }
        None => None,
    };
    write_points(&job.scratch.join(SAMPLES), &samples.images)?;
    if let Some(view) = job.section {
        write_section(job, &pictures::section(view, boundary)?, boundary, &*map)?;
    }
    // A mesh to count inverted tets of; without a mesher there are no counts.
    let mut remarks = Vec::new();
    if found.energy.errors.is_none() {
        remarks.push("no error of the energies: the map has no values at points of a finer grid".into());
    }
    let on_tets = match tets {
        Some(own) => Some(own),
        None => match carried_mesh(boundary, &spec, given.as_ref(), &*map) {
            Ok(carried) => Some(carried),
            Err(error) => {
                remarks.push(format!("no tets could be carried: {}", describe(&error)));
                None
            }
        },
    };
    let folds = on_tets.as_ref().map(|(mesh, images)| FoldCount::of(mesh, images));
    if let Some(folder) = &job.keep {
        tell("writing".into());
        keep(folder, method, &evaluator, &samples, on_tets.as_ref())?;
        if !energies.is_empty() {
            let history: Vec<f64> = energies.iter().enumerate().flat_map(|(i, &e)| [i as f64, e]).collect();
            let path = folder.join(format!("{}_energies.csv", method.name()));
            io::write_csv(path, &["step", "energy"], &history)?;
        }
    }
    let determinants = found.distortion.determinants;
    Ok(Figures {
        seconds,
        peak_rss_bytes: peak,
        tets: folds.map(|f| f.tets),
        inverted_tets: folds.map(|f| f.flipped),
        unknowns,
        iterations,
        boundary_error: found.boundary_error,
        interior_difference,
        harmonic_energy: found.energy.harmonic,
        deformation_energy: found.energy.deformation,
        errors: found.energy.errors,
        harmonic_density: found.energy.harmonic_density,
        min_det_jacobian: determinants.map_or(f64::NAN, |d| d.min),
        det_jacobian: determinants,
        folded_fraction: found.energy.folded.fraction,
        distortion: found.distortion.mean_normalized,
        volmap: found.distortion.volmap,
        quadrature_points: found.quadrature_points,
        remarks,
    })
}

/// The mesh for counting inverted tets, and the images of its vertices.
fn carried_mesh(
    boundary: &BoundaryMap,
    spec: &MeshSpec,
    given: Option<&TetMesh>,
    map: &dyn VolumeMap,
) -> anyhow::Result<(TetMesh, Vec<Point>)> {
    tell("carrying a tet mesh".into());
    let (mesh, boundary) = mesh_for(boundary, spec, given)?;
    let images = carried(&mesh, &boundary, map)?;
    Ok((mesh, images))
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
        point: vec![positions("image", images)],
        cell: vec![
            scalar("harmonic_energy", jacobians.iter().map(harmonic_density).collect()),
            scalar("det_jacobian", jacobians.iter().map(Matrix3::determinant).collect()),
        ],
        ..VtkFields::default()
    };
    let path = folder.join(format!("{name}.vtu"));
    Ok(io::write_vtu(path, mesh.vertices(), Cells::Tets(mesh.tets()), &fields)?)
}

/// The reference, and how accurate it is.
#[derive(Debug, Clone, Serialize, serde::Deserialize)]
pub struct Reference {
    pub description: String,
    pub boundary_error: solidmap::fit::BoundaryError,
    /// Difference to a reference on triangles four times as large, an estimate of the error of that one inside; its own
    /// is smaller.
    pub difference_to_coarser: MapDifference,
    pub sources: usize,
    pub seconds: f64,
}

fn reference(job: &Job, boundary: &BoundaryMap) -> anyhow::Result<Reference> {
    let start = Instant::now();
    let mut coarser = boundary.clone();
    let mut parts = 4;
    if boundary.domain().vertices().len() < MOST_REFERENCE_VERTICES {
        coarser = coarser.subdivided();
        parts = 16;
    }
    tell("fitting the reference".into());
    let options = FitOptions {
        tolerance: 0.1 * job.tolerance,
        refine: false,
        ..fit_options(job)
    };
    let before = solidmap::fit::fit(&coarser, &options, &|_| {})?;
    let fit = solidmap::fit::fit(&coarser.subdivided(), &options, &|_| {})?;
    let evaluator = evaluator(job, boundary)?;
    let samples = evaluator.interior_images(&fit.map)?;
    let difference_to_coarser = evaluator.difference(&samples, &evaluator.interior_images(&before.map)?);
    write_points(&job.scratch.join(SAMPLES), &samples.images)?;
    if let Some(view) = job.section {
        write_section(job, &pictures::section(view, boundary)?, boundary, &fit.map)?;
    }
    if let Some(folder) = &job.keep {
        let points: Vec<f64> = evaluator.interior().iter().flat_map(|p| p.iter().copied()).collect();
        io::write_csv(folder.join("points.csv"), &["x", "y", "z"], &points)?;
    }
    let error = fit.report.boundary_error;
    Ok(Reference {
        description: format!(
            "mfs with every triangle cut into {parts}, {} sources",
            fit.report.sources
        ),
        boundary_error: error,
        difference_to_coarser,
        sources: fit.report.sources,
        seconds: start.elapsed().as_secs_f64(),
    })
}

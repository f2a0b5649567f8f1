//! `solidmap boundary pair`: a bijection between the boundaries of two solids.

use std::path::{Path, PathBuf};

use anyhow::Context;
use serde::Serialize;
use solidmap::boundary_map::check::{BoundaryCheckOptions, check};
use solidmap::boundary_map::pair::{Landmarks, PairMethod, PairOptions, PairPhase, PairReport, map_pair};
use solidmap::boundary_map::{BoundaryMap, SurfaceDistortion};
use solidmap::files;
use solidmap::mesh::SurfaceMesh;
use solidmap::spherical::SpherePhase;

use super::write;
use crate::args::{BoundaryPairArgs, PairArgs, ViaKind};
use crate::output::{Output, pairs, peak_rss_bytes};
use crate::{Outcome, input};

/// What `boundary pair --json` prints.
#[derive(Serialize)]
struct Report {
    domain: PathBuf,
    target: PathBuf,
    image: PathBuf,
    boundary_file: Option<PathBuf>,
    png: Option<PathBuf>,
    vtu: Option<PathBuf>,
    #[serde(flatten)]
    pair: PairReport,
    peak_rss_bytes: u64,
}

/// Maps the pair and writes the image, and the map itself where it is asked for.
pub fn run(args: &BoundaryPairArgs, output: &Output) -> anyhow::Result<Outcome> {
    let mut inputs: Vec<&Path> = vec![&args.domain, &args.target];
    inputs.extend(args.pair.landmarks.iter().map(PathBuf::as_path));
    args.outputs.require_writable(&inputs)?;
    output.progress("reading");
    let domain = input::read_surface(&args.domain)?;
    let (map, report) = map_to(&domain, [&args.domain, &args.target], &args.pair, output)?;
    output.progress("writing");
    let mut read: Vec<(&str, &Path)> = vec![("domain", &args.domain), ("target", &args.target)];
    read.extend(args.pair.landmarks.iter().map(|file| ("landmarks", file.as_path())));
    write::outputs(&map, &args.outputs, &read, output)?;
    let folded = plain_image_flipped(&map)?;
    if folded > 0 {
        output.note(format_args!(
            "the plain image, straight between the images of vertices, has {folded} triangles that face against the \
             target; the map has none: write it with --boundary"
        ));
    }
    let report = Report {
        domain: args.domain.clone(),
        target: args.target.clone(),
        image: args.outputs.output.clone(),
        boundary_file: args.outputs.boundary.clone(),
        png: args.outputs.png.clone(),
        vtu: args.outputs.vtu.clone(),
        pair: report,
        peak_rss_bytes: peak_rss_bytes(),
    };
    output.result(&report, || summary(&report))?;
    Ok(Outcome::Done)
}

/// The map from a domain that was read already to the model in a file; `files` are those of the domain and the target.
pub fn map_to(
    domain: &SurfaceMesh,
    files: [&Path; 2],
    args: &PairArgs,
    output: &Output,
) -> anyhow::Result<(BoundaryMap, PairReport)> {
    let target = input::read_surface(files[1])?;
    let options = PairOptions {
        method: match args.via {
            ViaKind::Targets => PairMethod::SoftTargets,
            ViaKind::Conformal => PairMethod::Conformal,
        },
        landmarks: landmarks(&args.landmarks, domain, &target)?,
        improve: !args.no_improve,
    };
    let told = |phase| tell(phase, output);
    let (map, report) = map_pair(domain, &target, &options, &told)
        .with_context(|| format!("cannot map `{}` to `{}`", files[0].display(), files[1].display()))?;
    report.warnings.iter().for_each(|warning| output.warn(warning));
    Ok((map, report))
}

fn landmarks(files: &[PathBuf], domain: &SurfaceMesh, target: &SurfaceMesh) -> anyhow::Result<Landmarks> {
    let (vertices, of_target) = (domain.vertices().len(), target.vertices().len());
    Ok(match files {
        [] => Landmarks::default(),
        [both] => files::read_landmarks(both, vertices, of_target)?,
        [first, second] => files::read_landmark_files(first, second, vertices, of_target)?,
        more => anyhow::bail!("--landmarks is given {} times, but names one file or two", more.len()),
    })
}

fn tell(phase: PairPhase, output: &Output) {
    output.progress(match phase {
        PairPhase::Sphere(side, SpherePhase::Embedding { vertices, total }) => {
            return output.progress_of(format!("mapping the {side} to the sphere"), vertices, total);
        }
        PairPhase::Sphere(side, SpherePhase::Coarsening) => format!("coarsening the {side}"),
        PairPhase::Sphere(side, _) => format!("mapping the {side} to the sphere: optimising"),
        PairPhase::Aligning => "aligning".into(),
        PairPhase::CoarseEmbeddings { count } => format!("trying {count} coarse drawings"),
        PairPhase::Refining { vertices, total, .. } => return output.progress_of("drawing", vertices, total),
        PairPhase::Improving => "lowering the distortion".into(),
        PairPhase::Measuring => "measuring".into(),
    });
}

/// Triangles of the plain image that face against the target.
fn plain_image_flipped(map: &BoundaryMap) -> anyhow::Result<usize> {
    let checked = check(map, None, &BoundaryCheckOptions::default(), None)?;
    Ok(checked.composition.map_or(0, |found| found.plain_image_flipped))
}

fn summary(report: &Report) -> String {
    let pair = &report.pair;
    let seconds = pair.timings;
    let way = match (pair.method, pair.schedule) {
        (PairMethod::SoftTargets, Some(schedule)) => format!(
            "{} coarse drawings over {} alignments; taken: alignment {}, springs of {} up to {} vertices",
            pair.coarse_embeddings,
            pair.alignments.len(),
            pair.alignment + 1,
            schedule.strength,
            schedule.until_vertices
        ),
        _ => format!(
            "conformal maps of both; the best of {} rotations, by areas",
            pair.rotations.len()
        ),
    };
    let mut rows = vec![
        [
            "map".into(),
            "one to one: no triangle flipped on the sphere, degree 1, decided exactly".into(),
        ],
        ["way".into(), way],
    ];
    if pair.landmarks > 0 {
        rows.push(["landmarks".into(), format!("{}, all met exactly", pair.landmarks)]);
    }
    rows.push([
        "time".into(),
        format!(
            "{:.1} s: spheres {:.1}, alignment {:.1}, coarse drawings {:.1}, refinement {:.1}",
            seconds.total, seconds.sphere, seconds.align, seconds.coarse, seconds.improve
        ),
    ]);
    rows.push([
        "memory".into(),
        format!("{:.0} MiB at most", report.peak_rss_bytes as f64 / 1048576.0),
    ]);
    rows.push(["image".into(), report.image.display().to_string()]);
    if let Some(file) = &report.boundary_file {
        rows.push([
            "boundary map".into(),
            format!("{}, for `solidmap fit --boundary`", file.display()),
        ]);
    }
    format!(
        "{}\n\n{}",
        pairs(rows),
        distortions(&[("before", &pair.before), ("after", &pair.after)])
    )
}

/// Distortion of several maps, side by side.
pub fn distortions(maps: &[(&str, &SurfaceDistortion)]) -> String {
    maps.iter()
        .map(|(name, distortion)| format!("{name}\n{distortion}"))
        .collect::<Vec<_>>()
        .join("\n")
}

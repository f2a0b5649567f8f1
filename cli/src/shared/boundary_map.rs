//! Making boundary maps, with their progress shown.

use std::path::{Path, PathBuf};

use anyhow::Context;
use solidmap::boundary_map::BoundaryMap;
use solidmap::boundary_map::pair::{Landmarks, PairMethod, PairOptions, PairPhase, PairReport, map_pair};
use solidmap::files;
use solidmap::mesh::SurfaceMesh;
use solidmap::spherical::{SphereOptions, SpherePhase, SphereReport, SphericalEmbedding, map_to_sphere};

use super::input;
use super::output::Output;
use crate::args::{PairArgs, ViaKind};

/// The map of a model to the sphere.
pub fn to_sphere(
    surface: &SurfaceMesh,
    model: &Path,
    options: &SphereOptions,
    output: &Output,
) -> anyhow::Result<(SphericalEmbedding, SphereReport)> {
    let progress = |phase| match phase {
        SpherePhase::Coarsening => output.progress("coarsening"),
        SpherePhase::Embedding { vertices, total } => output.progress_of("embedding in the sphere", vertices, total),
        SpherePhase::Flowing => output.progress("flowing to the sphere"),
        SpherePhase::Optimising => output.progress("optimising"),
    };
    map_to_sphere(surface, options, &progress).with_context(|| cannot_map(model))
}

/// The context of errors in mapping a model to the sphere.
pub fn cannot_map(model: &Path) -> String {
    format!("cannot map `{}` to the sphere", model.display())
}

/// The map from `domain`, which was read from the first of the two files, to the surface in the second.
pub fn to_model(
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
    let progress = |phase| show_phase(phase, output);
    let (map, report) = map_pair(domain, &target, &options, &progress)
        .with_context(|| format!("cannot map `{}` to `{}`", files[0].display(), files[1].display()))?;
    report.warnings.iter().for_each(|warning| output.warn(warning));
    Ok((map, report))
}

fn landmarks(files: &[PathBuf], domain: &SurfaceMesh, target: &SurfaceMesh) -> anyhow::Result<Landmarks> {
    let (domain, target) = (domain.vertices().len(), target.vertices().len());
    Ok(match files {
        [] => Landmarks::default(),
        [both] => files::read_landmarks(both, domain, target)?,
        [first, second] => files::read_landmark_files(first, second, domain, target)?,
        more => anyhow::bail!(
            "--landmarks is given {} times; give it once, or twice with a file for each surface",
            more.len()
        ),
    })
}

fn show_phase(phase: PairPhase, output: &Output) {
    output.progress(match phase {
        PairPhase::Sphere(side, SpherePhase::Embedding { vertices, total }) => {
            return output.progress_of(format!("mapping the {side} to the sphere"), vertices, total);
        }
        PairPhase::Sphere(side, SpherePhase::Coarsening) => format!("coarsening the {side}"),
        PairPhase::Sphere(side, _) => format!("mapping the {side} to the sphere: optimising"),
        PairPhase::Aligning => "aligning".into(),
        PairPhase::CoarseEmbeddings { count } => format!("trying {count} coarse embeddings"),
        PairPhase::Refining { vertices, total, .. } => {
            return output.progress_of("refining the embedding", vertices, total);
        }
        PairPhase::Improving => "lowering the distortion".into(),
        PairPhase::Measuring => "measuring".into(),
    });
}

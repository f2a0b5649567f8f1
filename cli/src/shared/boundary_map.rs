//! Making boundary maps, with their progress shown.

use std::path::{Path, PathBuf};

use anyhow::{Context, ensure};
use solidmap::Vector;
use solidmap::boundary_map::BoundaryMap;
use solidmap::boundary_map::pair::{
    FittingTorus, Landmarks, PairError, PairMaps, PairMethod, PairOptions, PairPhase, PairReport, Stretch,
    StretchedArea, fitting_torus, map_pair_with_alternatives,
};
use solidmap::files;
use solidmap::fit::self_intersection_warning;
use solidmap::mesh::SurfaceMesh;
use solidmap::spherical::{SphereOptions, SpherePhase, SphereReport, SphericalEmbedding, map_to_sphere};

use super::output::Output;
use super::{input, interrupt};
use crate::args::{PairArgs, UpKind, ViaKind};
use crate::drawing::significant;

/// The map of a model to the sphere. At this share of the time limit the best map so far is taken, if there
/// is one.
pub fn to_sphere(
    surface: &SurfaceMesh,
    model: &Path,
    options: &SphereOptions,
    share: f64,
    output: &Output,
) -> anyhow::Result<(SphericalEmbedding, SphereReport)> {
    let show = |phase| match phase {
        SpherePhase::Coarsening => output.progress("coarsening"),
        SpherePhase::Embedding { vertices, total } => output.progress_of("embedding in the sphere", vertices, total),
        SpherePhase::Flowing => output.progress("flowing to the sphere"),
        SpherePhase::Optimising {
            iterations,
            most_iterations,
        } => output.progress_of("optimising", iterations, most_iterations),
    };
    let progress = |phase| {
        show(phase);
        interrupt::control_until(share, matches!(phase, SpherePhase::Optimising { .. }))
    };
    map_to_sphere(surface, options, &progress).with_context(|| cannot_map(model))
}

/// The context of errors in mapping a model to the sphere.
pub fn cannot_map(model: &Path) -> String {
    format!("cannot map `{}` to the sphere", model.display())
}

/// The map from `domain`, which was read from the first of the two files, to the surface in the second, and as many others
/// as are asked for. At this share of the time limit the best map so far is taken, if there is one.
pub fn to_model(
    domain: &SurfaceMesh,
    files: [&Path; 2],
    args: &PairArgs,
    alternatives: usize,
    share: f64,
    output: &Output,
) -> anyhow::Result<PairMaps> {
    ensure!(
        !args.aligned || args.via == ViaKind::Targets,
        "--aligned says where closest points are sought, and --via conformal seeks none; leave one of them out"
    );
    let target = input::read_surface(files[1])?;
    let options = PairOptions {
        method: match args.via {
            ViaKind::Targets => PairMethod::SoftTargets,
            ViaKind::Conformal => PairMethod::Conformal,
        },
        landmarks: landmarks(&args.landmarks, domain, &target)?,
        landmarks_weight: args.landmarks_weight,
        curves: match &args.landmark_curves {
            Some(file) => files::read_landmark_curves(file)?,
            None => vec![],
        },
        loops: match &args.loops {
            Some(file) => files::read_landmark_curves(file)?,
            None => vec![],
        },
        components: match &args.components {
            Some(file) => files::read_components(file)?,
            None => vec![],
        },
        up: args
            .domain_up
            .zip(args.target_up)
            .map(|(domain, target)| [direction(domain), direction(target)]),
        start: match &args.start {
            Some(file) => Some(start(file, domain, files[0])?),
            None => None,
        },
        alternatives,
        most_stretched: args.max_stretched,
        aligned: args.aligned,
        improve: !args.no_improve,
        ..PairOptions::default()
    };
    let intersections = self_intersections(&target, files[1], output);
    let names = [format!("`{}`", files[0].display()), format!("`{}`", files[1].display())];
    let made = paired(domain, &target, &options, &names, share, output);
    let mut made = made.map_err(|error| {
        let file = match error.downcast_ref() {
            Some(PairError::Curves(_)) => &args.landmark_curves,
            Some(PairError::Loops(_)) => &args.loops,
            Some(PairError::Components(_)) => &args.components,
            _ => &None,
        };
        match file {
            Some(file) => error.context(format!("cannot use `{}`", file.display())),
            None => error,
        }
    })?;
    made.report.warnings.extend(intersections);
    made.report.warnings.iter().for_each(|warning| output.warn(warning));
    warn_of_looks(&made.report, output);
    Ok(made)
}

/// A warning of a model that intersects itself, which no map of its boundary shows.
pub fn self_intersections(surface: &SurfaceMesh, model: &Path, output: &Output) -> Option<String> {
    output.progress("looking for self-intersections");
    self_intersection_warning(surface, &model.display().to_string())
}

/// The map of a model to the torus of revolution that fits it best, and that torus.
pub fn to_torus(
    surface: &SurfaceMesh,
    model: &Path,
    share: f64,
    output: &Output,
) -> anyhow::Result<(PairMaps, FittingTorus)> {
    output.progress("laying out on a flat torus");
    let model = format!("`{}`", model.display());
    let torus = fitting_torus(surface).with_context(|| format!("cannot map {model} to a torus"))?;
    let names = [model, "the torus".into()];
    let made = paired(surface, &torus.surface, &PairOptions::default(), &names, share, output)?;
    // Not that classes are as good as each other: a torus of revolution is its own mirror image.
    warn_of_looks(&made.report, output);
    Ok((made, torus))
}

/// The map of a pair whose surfaces are known by these names.
fn paired(
    domain: &SurfaceMesh,
    target: &SurfaceMesh,
    options: &PairOptions,
    names: &[String; 2],
    share: f64,
    output: &Output,
) -> anyhow::Result<PairMaps> {
    let progress = |phase| {
        show_phase(phase, output);
        // Any one of the coarse embeddings becomes a map by inserting the rest of the vertices.
        let has_result = !matches!(
            phase,
            PairPhase::Sphere(..)
                | PairPhase::Tori
                | PairPhase::HyperbolicSurface
                | PairPhase::Reversed
                | PairPhase::Shell { .. }
                | PairPhase::Aligning { .. }
                | PairPhase::Intrinsic { .. }
        );
        interrupt::control_until(share, has_result)
    };
    // Only one of the two is at fault.
    let of_side = |side: &str, error: anyhow::Error, onto: &str| {
        let name = &names[usize::from(side == "target")];
        error.context(format!("cannot map {name} to {onto}"))
    };
    map_pair_with_alternatives(domain, target, options, &progress).map_err(|error| match error {
        PairError::Sphere { side, error } => of_side(side, error.into(), "the sphere"),
        PairError::Torus { side, error } => of_side(side, error.into(), "a flat torus"),
        PairError::Hyperbolic { side, error } => of_side(side, error.into(), "a hyperbolic surface"),
        error @ (PairError::Curves(_) | PairError::Loops(_) | PairError::Components(_)) => error.into(),
        error => {
            let [domain, target] = names;
            anyhow::Error::new(error).context(format!("cannot map {domain} to {target}"))
        }
    })
}

/// Warns of a map that looks wrong.
fn warn_of_looks(report: &PairReport, output: &Output) {
    let stretch = &report.stretch;
    let sides = [("domain", &stretch.domain), ("target", &stretch.target)];
    let wrong: Vec<String> = sides
        .iter()
        .filter(|(_, area)| area.is_too_large())
        .map(|(side, area)| stretched_area(side, area, stretch))
        .collect();
    if !wrong.is_empty() {
        let has_handles = report.torus.is_some() || report.hyperbolic.is_some();
        output.warn(format_args!(
            "the boundary map looks wrong: {}. A limb may be in the wrong place: look at it with --png, see whether an alternative \
             is right, or give {}",
            wrong.join("; "),
            if has_handles { "loops (--loops)" } else { "landmarks" }
        ));
    }
    if let (false, Some(shell)) = (stretch.looks_wrong(), report.stretched_shell()) {
        output.warn(shell_looks_wrong(shell, report));
    }
    if let Some(nearer) = &report.nearer_isometry {
        output.warn(format_args!(
            "the boundary map looks wrong: a correspondence by intrinsic shape is nearer to an isometry (defect {}, the map {}) \
             and {} % of the diagonal away in the mean. Limbs may be on wrong limbs: look at it with --png, see whether an \
             alternative is right, or give landmarks",
            significant(nearer.isometry_defect, 2),
            report.isometry_defect.map_or_else(String::new, |defect| significant(defect, 2)),
            significant(100.0 * nearer.distance, 2)
        ));
    }
}

/// How much of the domain or the target is stretched too far, and where.
fn stretched_area(side: &str, area: &StretchedArea, stretch: &Stretch) -> String {
    let around = area.places.first().map_or(String::new(), |place| {
        let [x, y, z] = place.centre.map(|c| significant(c, 3));
        format!(", around ({x}, {y}, {z})")
    });
    format!(
        "{} % of the {side}'s area is stretched or compressed over {} times{around}, where up to {} % is expected ({}--max-stretched {})",
        significant(100.0 * area.share, 2),
        stretch.factor,
        significant(100.0 * area.limit, 2),
        if side == "target" { "four times " } else { "" },
        stretch.domain.limit
    )
}

/// The warning that a map stretches too much of a shell too far, though not of the whole.
fn shell_looks_wrong(shell: usize, report: &PairReport) -> String {
    let (found, stretch) = (&report.shells[shell], &report.stretch);
    let (whose, share, limit, times) = match found.stretched > stretch.domain.limit {
        true => (
            format!("shell {shell}, counted from 0,"),
            found.stretched,
            stretch.domain.limit,
            "",
        ),
        false => (
            format!(
                "shell {} of the target, to which shell {shell} of the domain goes (counted from 0),",
                found.target
            ),
            found.target_stretched,
            stretch.target.limit,
            "four times ",
        ),
    };
    format!(
        "the boundary map looks wrong: {} % of the area of {whose} is stretched or compressed over {} times. Up to {} % is expected \
         ({times}--max-stretched {})",
        significant(100.0 * share, 2),
        stretch.factor,
        significant(100.0 * limit, 2),
        stretch.domain.limit
    )
}

/// The boundary map to start from.
fn start(file: &Path, domain: &SurfaceMesh, model: &Path) -> anyhow::Result<BoundaryMap> {
    let start = files::read_boundary(file)?.boundary;
    ensure!(
        start.domain().vertices().len() == domain.vertices().len() && start.domain().triangles() == domain.triangles(),
        "`{}` is a map of another mesh than `{}`; --start takes a boundary file of the same DOMAIN",
        file.display(),
        model.display()
    );
    Ok(start)
}

fn direction(up: UpKind) -> Vector {
    let (axis, is_negative) = up.axis();
    Vector::ith(axis as usize, if is_negative { -1.0 } else { 1.0 })
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

/// Shows a phase of the mapping of a pair.
pub fn show_phase(phase: PairPhase, output: &Output) {
    match phase {
        PairPhase::Sphere(side, SpherePhase::Embedding { vertices, total }) => {
            output.progress_of(format!("mapping the {side} to the sphere"), vertices, total);
        }
        PairPhase::Sphere(side, SpherePhase::Coarsening) => output.progress(format!("coarsening the {side}")),
        PairPhase::Sphere(side, SpherePhase::Flowing) => {
            output.progress(format!("mapping the {side} to the sphere: flowing"));
        }
        PairPhase::Sphere(
            side,
            SpherePhase::Optimising {
                iterations,
                most_iterations,
            },
        ) => {
            let phase = format!("mapping the {side} to the sphere: optimising");
            output.progress_of(phase, iterations, most_iterations);
        }
        PairPhase::Tori => output.progress("laying both solids out on tori"),
        PairPhase::HyperbolicSurface => output.progress("laying out on a hyperbolic surface"),
        PairPhase::Reversed => output.progress("seeking a map from the target to the domain, too"),
        PairPhase::Shell { shell, of } => output.progress(format!("shell {shell} of {of}")),
        PairPhase::Intrinsic { done, of } => output.progress_of("intrinsic shapes", done, of),
        PairPhase::Aligning { of: 0, .. } => output.progress("aligning"),
        PairPhase::Aligning { done, of } => output.progress_of("aligning", done, of),
        PairPhase::CoarseEmbeddings { vertices, done, of } => {
            output.progress_of(format!("trying coarse embeddings of {vertices} vertices"), done, of);
        }
        PairPhase::Refining { vertices, total, .. } => output.progress_of("refining the embedding", vertices, total),
        PairPhase::Improving { rounds, most_rounds } => {
            output.progress_of("lowering the distortion", rounds, most_rounds);
        }
        PairPhase::Measuring { done, of } => output.progress_of("measuring", done, of),
    }
}

//! `solidmap boundary pair`: a bijection between the boundaries of two solids.

use std::path::{Path, PathBuf};

use serde::Serialize;
use solidmap::boundary_map::BoundaryMap;
use solidmap::boundary_map::check::{BoundaryCheck, BoundaryCheckOptions, check};
use solidmap::boundary_map::pair::{
    PairMaps, PairMethod, PairReport, PairStartKind, ShellReport, Stretch, TorusReport,
};

use super::write;
use crate::CommandOutcome;
use crate::args::{BoundaryOutputs, BoundaryPairArgs};
use crate::drawing::significant;
use crate::shared::json::{FileName, file_name};
use crate::shared::output::{Output, memory_row, peak_rss_bytes, two_columns};
use crate::shared::{boundary_map, input, interrupt};

/// What `boundary pair --json` prints.
#[derive(Serialize)]
struct PairSummary {
    domain: FileName,
    target: FileName,
    image: FileName,
    boundary_file: Option<FileName>,
    png: Option<FileName>,
    vtu: Option<FileName>,
    page: Option<FileName>,
    /// Images under other maps.
    written_alternatives: Vec<FileName>,
    #[serde(flatten)]
    pair: PairReport,
    peak_rss_bytes: u64,
}

/// Maps the pair, and writes the image and whatever else is asked for.
pub fn run(args: &BoundaryPairArgs, output: &Output) -> anyhow::Result<CommandOutcome> {
    let mut inputs: Vec<&Path> = vec![&args.domain, &args.target];
    let files = args.pair.files_by_role();
    inputs.extend(files.iter().map(|(_, path)| *path));
    args.outputs.require_writable(&inputs)?;
    output.progress("reading");
    let domain = input::read_surface(&args.domain)?;
    let models = [args.domain.as_path(), args.target.as_path()];
    let intersections = boundary_map::self_intersections(&domain, &args.domain, output);
    let PairMaps {
        map,
        mut report,
        alternatives,
    } = boundary_map::to_model(&domain, models, &args.pair, args.alternatives, 1.0, output)?;
    intersections.iter().for_each(|warning| output.warn(warning));
    report.warnings.extend(intersections);
    output.progress("writing");
    let mut read: Vec<(&str, &Path)> = vec![("domain", &args.domain), ("target", &args.target)];
    read.extend(files);
    let checked = check(&map, None, &BoundaryCheckOptions::default(), None)?;
    write::outputs(
        &map,
        Some(&checked),
        &args.outputs,
        &read,
        args.pair.target_up.unwrap_or(args.outputs.up),
        output,
    )?;
    let alternatives = write_alternatives(&alternatives, &args.outputs, &read, output)?;
    note_flipped(&checked, &args.outputs, output);
    let report = PairSummary {
        domain: (&args.domain).into(),
        target: (&args.target).into(),
        image: (&args.outputs.output).into(),
        boundary_file: file_name(args.outputs.boundary.as_ref()),
        png: file_name(args.outputs.png.as_ref()),
        vtu: file_name(args.outputs.vtu.as_ref()),
        page: file_name(args.outputs.html.as_ref()),
        written_alternatives: alternatives.iter().map(FileName::from).collect(),
        pair: report,
        peak_rss_bytes: peak_rss_bytes(),
    };
    output.result(&report, || summary(&report))?;
    if report.pair.concluded {
        output.warn(interrupt::concluded("boundary map"));
        return Ok(CommandOutcome::CheckFailed);
    }
    Ok(CommandOutcome::from_check(!report.pair.looks_wrong()))
}

/// Says where the plain image is not one to one.
pub(super) fn note_flipped(checked: &BoundaryCheck, outputs: &BoundaryOutputs, output: &Output) {
    let flipped = checked
        .composition
        .as_ref()
        .map_or(0, |found| found.plain_image_flipped);
    if flipped > 0 {
        let instead = match &outputs.boundary {
            Some(path) => format!("use `{}`", path.display()),
            None => "write it with --boundary".into(),
        };
        output.note(format_args!(
            "the plain image, linear between the images of vertices, has {flipped} triangles that face against the \
             target; the boundary map has none: {instead}"
        ));
    }
}

/// Writes images and boundary files of other maps beside those of the map itself; returns the names of the images.
fn write_alternatives(
    maps: &[BoundaryMap],
    outputs: &BoundaryOutputs,
    inputs: &[(&str, &Path)],
    output: &Output,
) -> anyhow::Result<Vec<PathBuf>> {
    let write_one = |(i, map): (usize, &BoundaryMap)| {
        let numbered = |path: &PathBuf| {
            let extension = path.extension().unwrap_or_default().to_string_lossy();
            path.with_extension(format!("{}.{extension}", i + 2))
        };
        let numbered = BoundaryOutputs {
            output: numbered(&outputs.output),
            boundary: outputs.boundary.as_ref().map(numbered),
            png: None,
            vtu: None,
            html: None,
            page: outputs.page,
            up: outputs.up,
        };
        write::outputs(map, None, &numbered, inputs, outputs.up, output)?;
        Ok(numbered.output)
    };
    maps.iter().enumerate().map(write_one).collect()
}

/// A landmark is met exactly when its image is this close, as a fraction of the diagonal: rounding.
const MET: f64 = 1e-9;

fn start_words(kind: PairStartKind) -> &'static str {
    match kind {
        PairStartKind::Aligned => "the solids as they lie",
        PairStartKind::Alignment => "alignment",
        PairStartKind::Landmarks => "alignment by landmarks",
        PairStartKind::LandmarkWarp => "deformation by landmarks",
        PairStartKind::Loops => "cutting along loops",
        PairStartKind::Intrinsic => "intrinsic shape",
        PairStartKind::Extremities => "intrinsic shape and extremities",
        PairStartKind::Refined => "a first map, refined",
        PairStartKind::WithoutLandmarks => "a map without landmarks",
        PairStartKind::Given => "the map given",
        PairStartKind::Class => "another class",
        _ => "another start",
    }
}

pub(super) fn torus_method(pair: &PairReport) -> String {
    let Some(TorusReport {
        compared,
        is_turned,
        twist,
        runner_up,
    }) = pair.torus
    else {
        return "flat tori of both".into();
    };
    let direction = if is_turned {
        "loops turned round"
    } else {
        "loops as they run"
    };
    let next = match runner_up {
        Some(ratio) => format!("; the next class has {ratio:.2} times its energy"),
        None => String::new(),
    };
    format!(
        "flat tori of both, the best of {compared} classes and translations: {direction}, twisted {twist} times{next}"
    )
}

fn hyperbolic_method(pair: &PairReport) -> String {
    let Some(found) = pair.hyperbolic else {
        return "a hyperbolic surface".into();
    };
    let next = match found.runner_up {
        Some(ratio) => format!("; the next has {ratio:.2} times its energy"),
        None => String::new(),
    };
    format!(
        "a hyperbolic surface of genus {}, the best of {} alignments, {} of which take handles to handles{next}{}",
        found.genus,
        found.alignments,
        found.classes,
        match pair.is_reversed {
            true => "; by a search from the target to the domain",
            false => "",
        }
    )
}

fn shell_row(shell: usize, found: &ShellReport) -> String {
    let kind = match found.is_cavity {
        true => "cavity",
        false => "solid",
    };
    format!(
        "{shell}: {kind} of genus {}, {} vertices, to shell {} of {} vertices; {} % of its area and {} % of the target shell's are stretched",
        found.genus,
        found.vertices,
        found.target,
        found.target_vertices,
        significant(100.0 * found.stretched, 2),
        significant(100.0 * found.target_stretched, 2)
    )
}

fn summary(report: &PairSummary) -> String {
    let pair = &report.pair;
    let seconds = pair.timings;
    let method = match (pair.method, pair.schedule) {
        (PairMethod::SoftTargets, Some(schedule)) => format!(
            "the best of {} coarse embeddings from {} starts: {}, soft targets of weight {} up to {} vertices{}",
            pair.coarse_embeddings,
            pair.starts.len(),
            pair.starts.get(pair.start).map_or("", |start| start_words(start.kind)),
            schedule.strength,
            schedule.until_vertices,
            match pair.is_reversed {
                true => "; but by a search from the target to the domain, which ended better",
                false => "",
            }
        ),
        (PairMethod::FlatTori, _) => torus_method(pair),
        (PairMethod::HyperbolicSurface, _) => hyperbolic_method(pair),
        _ => format!(
            "conformal maps of both; the best of {} rotations, by areas",
            pair.rotations.len()
        ),
    };
    let mut rows = vec![
        [
            "map".into(),
            match pair.method {
                _ if !pair.shells.is_empty() => {
                    "one to one, shell by shell: no triangle flipped on the sphere, torus or hyperbolic surface, each covered once"
                        .into()
                }
                PairMethod::FlatTori => {
                    "one to one: no triangle flipped on the torus, degree 1, decided exactly".into()
                }
                PairMethod::HyperbolicSurface => {
                    "one to one: no triangle flipped on the hyperbolic surface, covered once; words around every edge exact".into()
                }
                _ => "one to one: no triangle flipped on the sphere, degree 1, decided exactly".into(),
            },
        ],
        [
            match pair.shells.is_empty() {
                true => "method".into(),
                false => "largest shell".into(),
            },
            method,
        ],
    ];
    for (shell, found) in pair.shells.iter().enumerate() {
        rows.push([
            match shell {
                0 => "shells".into(),
                _ => String::new(),
            },
            shell_row(shell, found),
        ]);
    }
    if pair.landmarks > 0 {
        let error = significant(100.0 * pair.landmark_error, 2);
        let how = match pair.landmark_error < MET {
            true => "all met exactly".into(),
            false => format!("met to {error} % of the diagonal at worst"),
        };
        rows.push(["landmarks".into(), format!("{}, {how}", pair.landmarks)]);
    }
    let Stretch { factor, domain, target } = &pair.stretch;
    rows.push([
        "stretched".into(),
        format!(
            "{} % of the domain's area and {} % of the target's by more than a factor of {} (up to {} and {} % are expected)",
            significant(100.0 * domain.share, 2),
            significant(100.0 * target.share, 2),
            factor,
            significant(100.0 * domain.limit, 2),
            significant(100.0 * target.limit, 2)
        ),
    ]);
    if let Some(defect) = pair.isometry_defect {
        rows.push([
            "isometry".into(),
            format!(
                "defect {} of the functional map (0 for an isometry)",
                significant(defect, 2)
            ),
        ]);
    }
    for (i, other) in pair.alternatives.iter().enumerate() {
        let written = report
            .written_alternatives
            .get(i)
            .map_or(String::new(), |name| format!(": {}", name.display()));
        rows.push([
            if i == 0 { "other maps".into() } else { String::new() },
            format!(
                "{}by {}, energy {:.2} times this one's{}, {} % of the diagonal away in the mean{written}",
                other
                    .shell
                    .map_or_else(String::new, |shell| format!("of shell {shell} ")),
                start_words(other.kind),
                other.energy_ratio,
                other
                    .isometry_defect
                    .map_or_else(String::new, |defect| format!(", defect {}", significant(defect, 2))),
                significant(100.0 * other.distance, 2)
            ),
        ]);
    }
    rows.push([
        "time".into(),
        format!(
            "{:.1} s: {} {:.1}, {} {:.1}, coarse embeddings {:.1}, refinement {:.1}{}",
            seconds.total,
            match pair.method {
                PairMethod::FlatTori => "tori",
                PairMethod::HyperbolicSurface => "hyperbolic surface",
                PairMethod::SoftTargets => "sphere and alignments",
                PairMethod::Conformal => "spheres",
            },
            seconds.sphere,
            match pair.method {
                PairMethod::SoftTargets => "soft targets",
                _ => "alignment",
            },
            seconds.align,
            seconds.coarse,
            seconds.improve,
            match seconds.reversed > 0.0 {
                true => format!(", further searches {:.1}", seconds.reversed),
                false => String::new(),
            }
        ),
    ]);
    rows.push(memory_row(report.peak_rss_bytes));
    rows.push(["image".into(), report.image.display().to_string()]);
    if let Some(file) = &report.boundary_file {
        rows.push([
            "boundary map".into(),
            format!("{}, for `solidmap fit --boundary`", file.display()),
        ]);
    }
    let (table, before, after) = (two_columns(rows), &pair.before, &pair.after);
    format!("{table}\n\nbefore\n{before}\nafter\n{after}")
}

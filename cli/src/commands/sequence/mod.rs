//! `solidmap sequence`: the deformation energy of frames, one factorisation for all.

mod folder;
mod frame_names;
mod measure;
mod results;
mod series;
mod summary;

use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context, ensure};
use solidmap::check::MOST_RIM_EDGES;
use solidmap::fit::{FitError, self_intersection_finder, self_intersection_warning};
use solidmap::geometry::count_outside;
use solidmap::mesh::TetMesh;
use solidmap::remesh::RemeshOptions;
use solidmap::sequence::{FilledReference, Sequence, SequenceError, SequenceOptions};

use crate::CommandOutcome;
use crate::args::{MapKind, SequenceArgs};
use crate::shared::bijective::{filled, own_tets};
use crate::shared::fields::MeshWithFields;
use crate::shared::fitting::{fit_options, show_phase};
use crate::shared::input;
use crate::shared::output::{Output, with_option_names};
use crate::shared::page;
use crate::shared::sequence_page;
use folder::{CELLS, MATERIAL, ResultFolder, SURFACE};
use measure::Measurement;
use summary::SequenceTimings;

/// Measures every frame, block by block, and writes what was found.
pub fn run(args: &SequenceArgs, output: &Output) -> anyhow::Result<CommandOutcome> {
    let start = Instant::now();
    require_valid(args)?;
    let inputs = std::iter::once(&args.reference)
        .chain(&args.frames)
        .chain(&args.material);
    let read: Vec<&Path> = inputs.clone().map(PathBuf::as_path).collect();
    input::require_all_writable(&[(args.html.as_ref(), &page::EXTENSIONS)], &read)?;
    let energies = if args.no_vtu { &[][..] } else { &[CELLS, SURFACE] };
    let material = if args.material.is_some() { &[MATERIAL][..] } else { &[] };
    let results = ResultFolder::new(&args.output, inputs, &[energies, material].concat(), args.frames.len())?;
    if let Some([before, after]) = frame_names::misordered(&args.frames) {
        output.warn(format!(
            "frames are taken in the order given, and `{}` comes before `{}`; a shell sorts numbers by their digits: \
             give them leading zeros, or sort with `ls -v`",
            before.display(),
            after.display()
        ));
    }
    output.progress("reading the reference");
    let solid = input::read_solid(&args.reference)?;
    let own = match args.map_kind {
        MapKind::Harmonic => None,
        MapKind::Bijective => own_tets(solid.clone())?,
    };
    let reference = solid.into_surface();
    let options = options(args).with_context(|| format!("cannot use `{}`", args.reference.display()))?;
    let sequence = Sequence::new(&reference, &options, &|phase| show_phase(phase, "", output));
    let sequence = sequence.map_err(|error| advised(error, args))?;
    let mut warnings = sequence.warnings().to_vec();
    output.progress("looking for self-intersections");
    warnings.extend(self_intersection_warning(
        sequence.domain(),
        &args.reference.display().to_string(),
    ));
    warnings.iter().for_each(|warning| output.warn_of_fit(warning));
    let material = args
        .material
        .as_deref()
        .map(|path| read_material(path, &sequence, output));
    let material = material.transpose()?;
    for hole in sequence.holes() {
        output.note(format_args!(
            "closed a hole of {} edges at vertex {} by triangles over its rim, in the reference and in all frames",
            hole.rim.len(),
            hole.rim[0]
        ));
    }
    let filled = match args.map_kind {
        MapKind::Harmonic => None,
        MapKind::Bijective => Some(filled_reference(args, own, &sequence, output)?),
    };
    let mut seconds = SequenceTimings {
        setup: start.elapsed().as_secs_f64(),
        ..SequenceTimings::default()
    };
    let mut measurement = Measurement::new(args, results.scratch(), sequence, material, filled, output)?;
    let per_block = measurement.frames_per_block();
    for first in (0..args.frames.len()).step_by(per_block) {
        measurement.block(first..args.frames.len().min(first + per_block), &mut seconds)?;
    }
    measurement.require_one_frame()?;
    let drawing = Instant::now();
    let cycles = measurement.cycles();
    output.progress("drawing");
    measurement.write_results(&cycles)?;
    results.publish()?;
    if let Some(path) = &args.html {
        write_page(path, args, output)?;
    }
    seconds.drawing += drawing.elapsed().as_secs_f64();
    seconds.total = start.elapsed().as_secs_f64();
    measurement.finish(warnings, cycles, per_block, seconds)
}

/// The page of what has just been written, which also names the files that it comes from.
fn write_page(path: &Path, args: &SequenceArgs, output: &Output) -> anyhow::Result<()> {
    output.progress("writing the page");
    let mut files = vec![input::provenance("reference", &args.reference)?];
    // What cannot be read has been skipped.
    files.extend(
        args.frames
            .iter()
            .filter_map(|frame| input::provenance("frame", frame).ok()),
    );
    let made = sequence_page::make(&args.output, &files, args.section.up, &args.page)?;
    if made.shown < made.frames {
        output.note(format_args!(
            "`{}` has {} of {} surfaces, to keep to --max-size",
            path.display(),
            made.shown,
            made.frames
        ));
    }
    page::write(path, &made.html)
}

/// The tetrahedra of the reference, its own where it has any, and how maps over them are repaired.
fn filled_reference(
    args: &SequenceArgs,
    own: Option<TetMesh>,
    sequence: &Sequence,
    output: &Output,
) -> anyhow::Result<FilledReference<'static>> {
    let memory = args.method.memory.or_else(input::most_memory);
    let mesh = filled(sequence.domain(), own, memory, output)
        .with_context(|| format!("cannot use `{}`", args.reference.display()))?;
    let options = RemeshOptions {
        effort: args.effort,
        memory,
        ..RemeshOptions::default()
    };
    FilledReference::new(sequence, mesh, options, self_intersection_finder()).map_err(|error| advised(error, args))
}

/// Reads the mesh of `--material`.
fn read_material(path: &Path, sequence: &Sequence, output: &Output) -> anyhow::Result<MeshWithFields> {
    let given = MeshWithFields::read_mesh(path)?;
    let points = &given.carrier.points;
    let beyond = count_outside(sequence.domain(), points)?;
    if beyond > 0 {
        output.warn(format!(
            "{beyond} of the {} points of `{}` lie outside the reference, where values of the map mean nothing",
            points.len(),
            path.display()
        ));
    }
    Ok(given)
}

fn require_valid(args: &SequenceArgs) -> anyhow::Result<()> {
    args.section.require_valid()?;
    args.lame.constants()?;
    ensure!(
        args.fps > 0.0 && args.fps.is_finite(),
        "--fps is {}, but must be positive",
        args.fps
    );
    ensure!(
        args.frames_per_block != Some(0),
        "--frames-per-block is 0, but must be at least 1"
    );
    ensure!(
        args.close_holes.is_none_or(|edges| edges <= MOST_RIM_EDGES),
        "--close-holes is {}, but must be at most {MOST_RIM_EDGES}",
        args.close_holes.unwrap_or_default()
    );
    let most = args.frames.len();
    let beyond = args.show.iter().find(|&&frame| frame >= most);
    ensure!(
        beyond.is_none(),
        "--show names frame {}, but there are {most}, counted from 0",
        beyond.copied().unwrap_or_default()
    );
    Ok(())
}

fn options(args: &SequenceArgs) -> anyhow::Result<SequenceOptions> {
    Ok(SequenceOptions {
        fit: fit_options(&args.method, args.tolerance)?,
        quadrature: args.accuracy.options(),
        lame: args.lame.constants()?,
        own_volume: args.own_volume,
        close_holes: args.close_holes,
        frames_per_block: args.frames_per_block,
    })
}

/// An error in the reference, with its file and what helps.
fn advised(error: SequenceError, args: &SequenceArgs) -> anyhow::Error {
    let is_open = |report: &solidmap::check::CheckReport| !report.closed;
    let open = matches!(&error, SequenceError::Fit(FitError::DefectiveDomain(report)) if is_open(report));
    let hint = if open && args.close_holes.is_none() {
        "; --close-holes closes small holes and slits, in all frames alike"
    } else {
        ""
    };
    let reason = with_option_names(error);
    anyhow::anyhow!("cannot use `{}`: {reason}{hint}", args.reference.display())
}

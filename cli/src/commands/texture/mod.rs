//! `solidmap texture`: the colours of a surface, extended into the solid.

mod model;
mod page;
mod painted;
mod pictures;
mod samples;
mod summary;
mod through;

use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context, bail, ensure};
use solidmap::files::{self, Provenance, TextureFile, TextureMetadata};
use solidmap::fit::FitOptions;
use solidmap::texture::{
    ColourSource, ColouredSurface, ExtendedQuantity, SeamReport, SolidTexture, TextureError, TextureOptions, VoxelGrid,
    Wrap,
};

use crate::CommandOutcome;
use crate::args::{TextureArgs, TextureOutputArgs};
use crate::shared::fitting::show_phase;
use crate::shared::input;
use crate::shared::json::file_name;
use crate::shared::output::{Output, peak_rss_bytes, write_file};
use crate::shared::page::{EXTENSIONS, write as write_page};
use crate::shared::pictures::require_position;
use model::{Model, is_texture_file};
use page::TexturePage;
use samples::{Colours, PointsToColour, sampled_volume, write_points, write_volume};
use summary::{TextureSummary, TextureTimings, ThroughSummary};
use through::ThroughMap;

/// Points of the surface at which the texture is compared with the picture.
const HELD_OUT: usize = 20_000;
const SEED: u64 = 2;
/// Largest difference that counts as none: one 8-bit code in the darkest colours, in linear light.
const SAME_COLOUR: f64 = 1.0 / 255.0 / 12.92;

/// Makes or reads a texture, and writes the outputs asked for.
pub fn run(args: &TextureArgs, output: &Output) -> anyhow::Result<CommandOutcome> {
    require_valid(args)?;
    output.progress("reading");
    let start = Instant::now();
    let model = Model::read(args)?;
    // Refused before the work, not after it.
    let written = &args.written;
    let to_colour = match (&written.at, &written.colours) {
        (Some(points), Some(path)) => Some(PointsToColour::read(points, path)?),
        _ => None,
    };
    let surface = model.coloured_surface().surface();
    let through = ThroughMap::read(args, surface)?;
    let target = through.as_ref().map(ThroughMap::target);
    let has_voxels = written.output.is_some() || written.html.is_some();
    let grid = has_voxels.then(|| VoxelGrid::of(target.as_ref().unwrap_or(surface), written.resolution));
    let grid = grid
        .transpose()
        .with_context(|| format!("cannot sample `{}`", args.model.display()))?;
    let to_invert = through.as_ref().map(ThroughMap::inverse).transpose()?;
    let inverse = match (&to_invert, &through) {
        (Some((inverse, _)), Some(through)) => Some(inverse.prepared(through.path)?),
        _ => None,
    };
    let texture = texture(model, args, output)?;
    let mut seconds = TextureTimings {
        texture: seconds_since(start),
        ..TextureTimings::default()
    };

    output.progress("measuring");
    let start = Instant::now();
    let seams = texture.coloured_surface().seams();
    let uv_box = texture.coloured_surface().uv_box();
    let [harmonic_error, surface_error] = [
        texture.harmonic_error(HELD_OUT, SEED),
        texture.surface_error(HELD_OUT, SEED),
    ];
    let layer = texture.layer_thickness();
    seconds.measure = seconds_since(start);
    warn(&texture, &seams, uv_box, output);

    let mut colours = Colours::new(&texture, inverse.as_deref());
    let start = Instant::now();
    let voxels = grid.map(|grid| sampled_volume(&mut colours, &grid, output));
    let volume = match (&written.output, &voxels) {
        (Some(path), Some(voxels)) => Some(write_volume(path, voxels, output)?),
        _ => None,
    };
    seconds.volume = seconds_since(start);
    let start = Instant::now();
    let points = to_colour
        .map(|points| write_points(&points, &mut colours, output))
        .transpose()?;
    seconds.points = seconds_since(start);
    let start = Instant::now();
    if let Some(path) = &written.png {
        output.progress("drawing");
        write_file(path, &pictures::figure(&texture, written, output)?.to_png()?)?;
    }
    seconds.picture = seconds_since(start);

    let through = to_invert.as_ref().zip(through.as_ref());
    let through = through.map(|((_, map_kind), through)| ThroughSummary {
        map: through.path.into(),
        map_kind: *map_kind,
        folded: colours.folded,
        not_found: colours.not_found,
    });
    let fit = texture.report().clone();
    let tolerance_met = args
        .extension
        .tolerance
        .map(|tolerance| fit.boundary_error.p99 <= tolerance);
    let report = TextureSummary {
        model: (&args.model).into(),
        image: file_name(args.image.as_ref()),
        extended: texture.extended(),
        fit,
        uv_box,
        seams,
        harmonic_error,
        surface_error,
        layer,
        tolerance: args.extension.tolerance,
        tolerance_met,
        through,
        volume,
        points,
        picture: file_name(written.png.as_ref()),
        page: file_name(written.html.as_ref()),
        map: file_name(written.map.as_ref()),
        seconds,
        peak_rss_bytes: peak_rss_bytes(),
    };
    if let (Some(path), Some(voxels)) = (&written.html, &voxels) {
        let page = TexturePage {
            coloured: texture.coloured_surface(),
            volume: voxels,
            files: provenances(args)?,
            report: &report,
            up: written.up,
        };
        write_page(path, &page.html(written.page)?)?;
    }
    output.result(&report, || summary::text(&report))?;
    outcome(&report, output)
}

fn seconds_since(start: Instant) -> f64 {
    start.elapsed().as_secs_f64()
}

/// Refuses settings and outputs before any work.
fn require_valid(args: &TextureArgs) -> anyhow::Result<()> {
    let TextureOutputArgs {
        output,
        png: picture,
        html,
        map,
        at,
        colours,
        position,
        ..
    } = &args.written;
    require_position(*position)?;
    let outputs: [(Option<&PathBuf>, &[&str]); 5] = [
        (output.as_ref(), &["vti"]),
        (picture.as_ref(), &["png"]),
        (html.as_ref(), &EXTENSIONS),
        (map.as_ref(), &["safetensors"]),
        (colours.as_ref(), &["csv", "npy", "ply", "vtu"]),
    ];
    ensure!(
        outputs.iter().any(|(path, _)| path.is_some()),
        "nothing would be written: name a volume (-o), a --png, a page (--html), a texture file (--map) or points (--at, --colours)"
    );
    let through = args.through.through.as_ref();
    ensure!(
        through.is_none() || picture.is_none() && html.is_none(),
        "--png and --html show the model itself, and not what --through carries it to: leave them out, and write a volume (-o) or the \
         colours of a mesh of the target (--at, --colours), which ParaView shows"
    );
    ensure!(
        through.is_none() || output.is_some() || at.is_some(),
        "--through says where the colours of a volume (-o) or of points (--at) come from, and neither is asked for"
    );
    let inputs: Vec<&Path> = [Some(&args.model), args.image.as_ref(), at.as_ref(), through]
        .into_iter()
        .flatten()
        .map(PathBuf::as_path)
        .collect();
    input::require_all_writable(&outputs, &inputs)?;
    let extension = &args.extension;
    if is_texture_file(&args.model) {
        let given = [
            ("--image", args.image.is_some()),
            ("--checker", args.checker.is_some()),
            ("--wrap", args.wrap.is_some()),
            ("--uv", extension.uv),
            ("--sources", extension.sources.is_some()),
            ("--tolerance", extension.tolerance.is_some()),
            ("--max-sources", extension.max_sources.is_some()),
        ];
        let given: Vec<&str> = given.iter().filter(|option| option.1).map(|option| option.0).collect();
        ensure!(
            given.is_empty(),
            "`{}` is a texture already, which no longer depends on {}: leave out what it was made with, or make it \
             again",
            args.model.display(),
            given.join(", ")
        );
    }
    let most = max_sources(args);
    if let Some(least) = extension.sources.filter(|&least| least > most) {
        bail!(
            "--sources asks for at least {least} sources, and --max-sources allows {most}: raise it to {least} or more"
        );
    }
    Ok(())
}

/// Default of `--max-sources`.
const MOST_SOURCES: usize = 100_000;

fn max_sources(args: &TextureArgs) -> usize {
    args.extension.max_sources.unwrap_or(MOST_SOURCES)
}

/// The texture that was read, or is made now; written if asked for.
fn texture(model: Model, args: &TextureArgs, output: &Output) -> anyhow::Result<SolidTexture> {
    let file = match model {
        Model::Textured(file) => *file,
        Model::Coloured(surface) => fitted(surface, args, output)?,
    };
    if let Some(path) = &args.written.map {
        files::write_texture(path, &file)?;
    }
    Ok(file.texture)
}

fn fitted(surface: ColouredSurface, args: &TextureArgs, output: &Output) -> anyhow::Result<TextureFile> {
    let texture = SolidTexture::fit(surface, &options(args), &|phase| show_phase(phase, "", output))
        .map_err(|error| with_advice(error.into()))
        .with_context(|| format!("cannot texture `{}`", args.model.display()))?;
    let fit = texture.report().clone();
    fit.warnings.iter().for_each(|warning| output.warn_of_fit(warning));
    Ok(TextureFile {
        texture,
        metadata: TextureMetadata::new(fit, provenances(args)?),
    })
}

/// The files that the texture is made from.
fn provenances(args: &TextureArgs) -> anyhow::Result<Vec<Provenance>> {
    let inputs = [("model", Some(&args.model)), ("image", args.image.as_ref())];
    let inputs = inputs.into_iter().filter_map(|(role, path)| Some((role, path?)));
    inputs.map(|(role, path)| input::provenance(role, path)).collect()
}

/// The error, with the option that helps.
fn with_advice(error: anyhow::Error) -> anyhow::Error {
    match error.downcast_ref() {
        Some(TextureError::Seams { .. }) => {
            anyhow::anyhow!("{error} (leave out --uv, or add --across-seams)")
        }
        Some(TextureError::TooManySources { .. }) => anyhow::anyhow!("{error} (--sources)"),
        _ => error,
    }
}

fn options(args: &TextureArgs) -> TextureOptions {
    let extension = &args.extension;
    let default = TextureOptions::default();
    TextureOptions {
        extended: if extension.uv {
            ExtendedQuantity::Coordinates
        } else {
            ExtendedQuantity::Colours
        },
        across_seams: extension.across_seams,
        least_sources: extension
            .sources
            .unwrap_or(default.least_sources.min(max_sources(args))),
        fit: FitOptions {
            refine: extension.tolerance.is_some(),
            tolerance: extension.tolerance.unwrap_or(default.fit.tolerance),
            max_sources: max_sources(args),
            max_source_ratio: f64::INFINITY,
            ..default.fit
        },
    }
}

/// Smallest jump of light that is warned of: three 8-bit codes in the middle of the range.
const VISIBLE: f64 = 0.02;

fn warn(texture: &SolidTexture, seams: &SeamReport, uv_box: Option<[[f64; 2]; 2]>, output: &Output) {
    let beyond = |[low, high]: [[f64; 2]; 2]| low.iter().any(|&x| x < 0.0) || high.iter().any(|&x| x > 1.0);
    if let Some([low, high]) = uv_box.filter(|&uv_box| beyond(uv_box)) {
        let what = match texture.coloured_surface().colour_source() {
            ColourSource::Picture { wrap: Wrap::Clamp, .. } => "continues with the colours of its edges",
            _ => "repeats",
        };
        output.warn(format!(
            "texture coordinates reach beyond the picture, u from {:.3} to {:.3} and v from {:.3} to {:.3}: it {what} \
             there (--wrap)",
            low[0], high[0], low[1], high[1]
        ));
    }
    if uv_box.is_some_and(|[low, high]| low == high) {
        output.warn("all texture coordinates are the same, so that the surface has one colour: unwrap the model first");
    }
    let extends_colours = texture.extended() == ExtendedQuantity::Colours;
    if extends_colours && seams.rms_colour_jump > VISIBLE {
        output.warn(format!(
            "colours differ across seams, by {:.3} rms (1 from black to white) and {:.3} at most: the picture was not \
             made for these seams, and the texture jumps there on the surface",
            seams.rms_colour_jump, seams.largest_colour_jump
        ));
    }
    if !extends_colours && seams.seams > 0 {
        output.warn(format!(
            "texture coordinates jump at {} edges: beside them the whole picture is squeezed between the two sides",
            seams.seams
        ));
    }
}

fn outcome(report: &TextureSummary, output: &Output) -> anyhow::Result<CommandOutcome> {
    let misses = report
        .surface_error
        .is_none_or(|error| !error.max.is_finite() || error.p99 > SAME_COLOUR);
    if misses {
        output.warn(
            "the texture differs from the picture on the surface; see `solidmap check` for what may be wrong with it",
        );
    }
    let missed_tolerance = report.tolerance.filter(|_| report.tolerance_met == Some(false));
    if let Some(tolerance) = missed_tolerance {
        let space = match report.extended {
            ExtendedQuantity::Colours => "the colour cube",
            ExtendedQuantity::Coordinates => "the box of texture coordinates",
        };
        output.warn(format!(
            "the harmonic part alone meets 99 % of the surface only to {:.1e} of the diagonal of {space}, and the \
             tolerance is {tolerance:.1e}; the texture was written all the same. Raise --max-sources, or leave out \
             --tolerance",
            report.fit.boundary_error.p99
        ));
    }
    let through = report.through.as_ref();
    let [not_found, folded] = through.map_or([0; 2], |through| [through.not_found, through.folded]);
    if not_found > 0 {
        output.warn(format!(
            "{not_found} points lie in the target, but no preimage was found: they have no colour"
        ));
    }
    if folded > 0 {
        output.warn(format!(
            "{folded} points lie where the map folds, and have the colour of one of several preimages; `solidmap bijective` \
             makes a map that does not fold"
        ));
    }
    let complete = not_found + folded == 0;
    Ok(CommandOutcome::from_check(
        !misses && missed_tolerance.is_none() && complete,
    ))
}

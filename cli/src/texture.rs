//! `solidmap texture`: the picture on a surface, carried into the solid.

mod pictures;

use std::path::{Path, PathBuf};
use std::time::Instant;

use crate::drawing::significant;
use anyhow::{Context, bail, ensure};
use serde::Serialize;
use solidmap::Point;
use solidmap::files::{self, Provenance, TextureFile, TextureMetadata};
use solidmap::fit::{FitOptions, FitReport};
use solidmap::io::{self, Cells, Field, ImageGrid, Solid, TexturedSurface, VtkFields};
use solidmap::texture::{
    ColourError, ColourSource, ColouredSurface, ExtendedQuantity, LinearRgb, Picture, SeamReport, SolidTexture,
    TextureOptions, VoxelGrid, Wrap, decoded, to_srgb,
};

use super::args::{TextureArgs, TextureOutputArgs, WrapKind};
use super::fit::show;
use super::output::{Output, pairs, peak_rss_bytes};
use super::{Outcome, input};

/// Points of the surface at which the texture is held against the picture.
const HELD_OUT: usize = 20_000;
const SEED: u64 = 2;
/// Part of the surface's light that may differ from the picture: a code of 8 bits, where codes are finest.
const SAME_COLOUR: f64 = 1.0 / 255.0 / 12.92;

/// What `texture --json` prints.
#[derive(Serialize)]
struct Report {
    model: PathBuf,
    image: Option<PathBuf>,
    extended: ExtendedQuantity,
    fit: FitReport,
    /// Lowest and highest texture coordinates.
    uv_box: Option<[[f64; 2]; 2]>,
    seams: SeamReport,
    /// The harmonic part alone against the picture, on the surface.
    harmonic_error: Option<ColourError>,
    /// The texture against the picture, on the surface.
    surface_error: Option<ColourError>,
    /// How thick the layer is that carries the difference, over the diagonal: at the median and at most.
    layer: [f64; 2],
    tolerance: Option<f64>,
    tolerance_met: Option<bool>,
    volume: Option<VolumeReport>,
    points: Option<PointsReport>,
    picture: Option<PathBuf>,
    map: Option<PathBuf>,
    seconds: Seconds,
    peak_rss_bytes: u64,
}

#[derive(Serialize)]
struct VolumeReport {
    file: PathBuf,
    size: [usize; 3],
    spacing: f64,
    inside: usize,
    bytes: u64,
}

#[derive(Serialize)]
struct PointsReport {
    file: PathBuf,
    points: usize,
    outside: usize,
}

#[derive(Serialize, Default)]
struct Seconds {
    texture: f64,
    measure: f64,
    volume: f64,
    points: f64,
    picture: f64,
}

/// Makes or reads a texture, and writes what is asked of it.
pub fn run(args: &TextureArgs, output: &Output) -> anyhow::Result<Outcome> {
    require_valid(args)?;
    output.progress("reading");
    let start = Instant::now();
    let model = Model::read(args)?;
    // Before the work that they could be refused after.
    let written = &args.written;
    let to_colour = match (&written.at, &written.colours) {
        (Some(points), Some(path)) => Some(ToColour::read(points, path)?),
        _ => None,
    };
    let surface = model.skin().surface();
    let grid = written
        .output
        .as_ref()
        .map(|_| VoxelGrid::of(surface, written.resolution));
    let grid = grid
        .transpose()
        .with_context(|| format!("cannot sample `{}`", args.model.display()))?;
    let texture = texture(model, args, output)?;
    let mut seconds = Seconds {
        texture: lap(start),
        ..Seconds::default()
    };

    output.progress("measuring");
    let start = Instant::now();
    let seams = texture.coloured_surface().seams();
    let uv_box = texture.coloured_surface().uv_box();
    let [harmonic_error, surface_error] = [
        texture.harmonic_error(HELD_OUT, SEED),
        texture.surface_error(HELD_OUT, SEED),
    ];
    let layer = layer(&texture);
    seconds.measure = lap(start);
    warn_of(&texture, &seams, uv_box, output);

    let start = Instant::now();
    let volume = match (&written.output, grid) {
        (Some(path), Some(grid)) => Some(write_volume(path, &texture, &grid, output)?),
        _ => None,
    };
    seconds.volume = lap(start);
    let start = Instant::now();
    let points = to_colour
        .map(|points| write_points(&points, &texture, output))
        .transpose()?;
    seconds.points = lap(start);
    let start = Instant::now();
    if let Some(path) = &written.png {
        output.progress("drawing");
        let png = pictures::figure(&texture, written, output)?.to_png()?;
        io::atomic_write(path, |writer| writer.write_all(&png))?;
    }
    seconds.picture = lap(start);

    let fit = texture.report().clone();
    let tolerance_met = args
        .extension
        .tolerance
        .map(|tolerance| fit.boundary_error.p99 <= tolerance);
    let report = Report {
        model: args.model.clone(),
        image: args.image.clone(),
        extended: texture.extended(),
        fit,
        uv_box,
        seams,
        harmonic_error,
        surface_error,
        layer,
        tolerance: args.extension.tolerance,
        tolerance_met,
        volume,
        points,
        picture: written.png.clone(),
        map: written.map.clone(),
        seconds,
        peak_rss_bytes: peak_rss_bytes(),
    };
    output.result(&report, || pairs(rows(&report)))?;
    outcome(&report, output)
}

fn lap(start: Instant) -> f64 {
    start.elapsed().as_secs_f64()
}

/// Refuses settings and outputs before any work.
fn require_valid(args: &TextureArgs) -> anyhow::Result<()> {
    let TextureOutputArgs {
        output,
        png: picture,
        map,
        at,
        colours,
        position,
        ..
    } = &args.written;
    ensure!(
        (0.0..=1.0).contains(position),
        "--position is {position}, but must be from 0 to 1"
    );
    let outputs: [(&Option<PathBuf>, &[&str]); 4] = [
        (output, &["vti"]),
        (picture, &["png"]),
        (map, &["safetensors"]),
        (colours, &["csv", "npy", "ply", "vtu"]),
    ];
    ensure!(
        outputs.iter().any(|(path, _)| path.is_some()),
        "nothing would be written: name a volume (-o), a --png, a texture file (--map) or points (--at, --colours)"
    );
    let mut files: Vec<&Path> = [Some(&args.model), args.image.as_ref(), at.as_ref()]
        .into_iter()
        .flatten()
        .map(PathBuf::as_path)
        .collect();
    for (path, extensions) in outputs {
        if let Some(path) = path {
            input::require_writable(path, extensions, &files)?;
            files.push(path);
        }
    }
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
            "`{}` is a texture already, which no longer depends on {}: leave out what it was made with, or make it again",
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

/// Sources at least, and at most, unless said otherwise.
const LEAST_SOURCES: usize = 2000;
const MOST_SOURCES: usize = 100_000;

fn max_sources(args: &TextureArgs) -> usize {
    args.extension.max_sources.unwrap_or(MOST_SOURCES)
}

fn is_texture_file(path: &Path) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case("safetensors"))
}

/// What the colours come from.
enum Model {
    Textured(Box<TextureFile>),
    Painted(ColouredSurface),
}

impl Model {
    fn read(args: &TextureArgs) -> anyhow::Result<Self> {
        Ok(if is_texture_file(&args.model) {
            Self::Textured(Box::new(files::read_texture(&args.model)?))
        } else {
            Self::Painted(skin(args)?)
        })
    }

    fn skin(&self) -> &ColouredSurface {
        match self {
            Self::Textured(file) => file.texture.coloured_surface(),
            Self::Painted(skin) => skin,
        }
    }
}

/// The texture that was read, or one that is made, and written if asked to.
fn texture(model: Model, args: &TextureArgs, output: &Output) -> anyhow::Result<SolidTexture> {
    let file = match model {
        Model::Textured(file) => *file,
        Model::Painted(skin) => fitted(skin, args, output)?,
    };
    if let Some(path) = &args.written.map {
        files::write_texture(path, &file)?;
    }
    Ok(file.texture)
}

fn fitted(skin: ColouredSurface, args: &TextureArgs, output: &Output) -> anyhow::Result<TextureFile> {
    let texture = SolidTexture::fit(skin, &options(args), &|phase| show(phase, "", output))
        .map_err(|error| with_advice(error.into()))
        .with_context(|| format!("cannot texture `{}`", args.model.display()))?;
    let fit = texture.report().clone();
    fit.warnings.iter().for_each(|warning| output.warn(warning));
    let inputs = [("model", Some(&args.model)), ("image", args.image.as_ref())];
    let inputs = inputs.into_iter().filter_map(|(role, path)| Some((role, path?)));
    let inputs: anyhow::Result<Vec<Provenance>> = inputs
        .map(|(role, path)| Provenance::of(role, path).with_context(|| format!("cannot read `{}`", path.display())))
        .collect();
    Ok(TextureFile {
        texture,
        metadata: TextureMetadata::new(fit, inputs?),
    })
}

/// The error, with the option that gets around it.
fn with_advice(error: anyhow::Error) -> anyhow::Error {
    match error.downcast_ref() {
        Some(solidmap::texture::TextureError::Seams { .. }) => {
            anyhow::anyhow!("{error} (leave out --uv, or add --across-seams)")
        }
        Some(solidmap::texture::TextureError::TooManySources { .. }) => anyhow::anyhow!("{error} (--sources)"),
        _ => error,
    }
}

fn options(args: &TextureArgs) -> TextureOptions {
    let extension = &args.extension;
    let default = TextureOptions::default().fit;
    TextureOptions {
        extended: if extension.uv {
            ExtendedQuantity::Coordinates
        } else {
            ExtendedQuantity::Colours
        },
        across_seams: extension.across_seams,
        least_sources: extension.sources.unwrap_or(LEAST_SOURCES.min(max_sources(args))),
        fit: FitOptions {
            refine: extension.tolerance.is_some(),
            tolerance: extension.tolerance.unwrap_or(default.tolerance),
            max_sources: max_sources(args),
            ..default
        },
    }
}

/// The model with its picture, checker or colours.
fn skin(args: &TextureArgs) -> anyhow::Result<ColouredSurface> {
    let shown = args.model.display();
    let TexturedSurface { surface, uv, colours } = match args.model.extension() {
        Some(extension) if extension.eq_ignore_ascii_case("obj") => io::read_textured_surface(&args.model)?,
        // Tet meshes stand for their boundary; it has no colours, but errors say so.
        _ => TexturedSurface {
            surface: input::read_surface(&args.model)?,
            uv: None,
            colours: None,
        },
    };
    let wrap = match args.wrap {
        None | Some(WrapKind::Repeat) => Wrap::Repeat,
        Some(WrapKind::Clamp) => Wrap::Clamp,
    };
    let picture = match (&args.image, args.checker) {
        (Some(path), _) => Some(crate::picture_file::read_picture(path)?),
        (None, Some(squares)) => Some(Picture::checker(squares)?),
        (None, None) => None,
    };
    let skin = match (picture, uv, colours) {
        (Some(picture), Some(uv), _) => ColouredSurface::from_picture(&surface, uv, picture, wrap),
        (Some(_), None, _) => bail!(
            "`{shown}` has no texture coordinates, so that no picture can be laid on it: unwrap it and save it as OBJ with \
             them (`vt`)"
        ),
        (None, _, Some(_)) if args.wrap.is_some() => bail!(
            "--wrap says what is beyond the edges of a picture, but `{shown}` is coloured by its vertices: leave it out, or \
             name a picture with --image"
        ),
        (None, _, Some(colours)) => {
            require_codes(&colours).with_context(|| format!("cannot texture `{shown}`"))?;
            ColouredSurface::from_vertex_colours(&surface, colours.into_iter().map(decoded).collect())
        }
        (None, Some(_), None) => bail!(
            "`{shown}` has texture coordinates but no colours of its own: name a picture with --image, or take a --checker"
        ),
        (None, None, None) => bail!(
            "`{shown}` has neither texture coordinates nor colours: give an OBJ with `vt` and a picture (--image), or with \
             coloured vertices (`v x y z r g b`)"
        ),
    };
    skin.with_context(|| format!("cannot texture `{shown}`"))
}

/// Colours of vertices may be beyond 0 and 1 by this, as rounding leaves them.
const CODE_SLACK: f64 = 1e-3;

/// Refuses colours that [`decoded`] would cut off.
fn require_codes(colours: &[[f64; 3]]) -> anyhow::Result<()> {
    let allowed = -CODE_SLACK..=1.0 + CODE_SLACK;
    let beyond = |colour: &[f64; 3]| !colour.iter().all(|code| allowed.contains(code));
    if let Some(vertex) = colours.iter().position(beyond) {
        let [r, g, b] = colours[vertex];
        bail!(
            "the colour of vertex {vertex} (0-based) is {r} {g} {b}, but red, green and blue go from 0 to 1; divide colours \
             that go to 255 by 255"
        );
    }
    Ok(())
}

/// Thickness over the diagonal at the surface's vertices: the median and the largest.
fn layer(texture: &SolidTexture) -> [f64; 2] {
    let surface = texture.coloured_surface().surface();
    let mut thickness = texture.layer(surface.vertices());
    thickness.sort_by(f64::total_cmp);
    let diagonal = surface.diagonal();
    let median = thickness.get(thickness.len() / 2).copied().unwrap_or_default();
    [median, thickness.last().copied().unwrap_or_default()].map(|t| t / diagonal)
}

/// Jumps of light below this are not worth a remark: three codes of 255 in the middle of the range.
const VISIBLE: f64 = 0.02;

fn warn_of(texture: &SolidTexture, seams: &SeamReport, uv_box: Option<[[f64; 2]; 2]>, output: &Output) {
    let beyond = |[low, high]: [[f64; 2]; 2]| low.iter().any(|&x| x < 0.0) || high.iter().any(|&x| x > 1.0);
    if let Some([low, high]) = uv_box.filter(|&uv_box| beyond(uv_box)) {
        let what = match texture.coloured_surface().colour_source() {
            ColourSource::Picture { wrap: Wrap::Clamp, .. } => "goes on with the colours of its edges",
            _ => "repeats",
        };
        output.warn(format!(
            "texture coordinates reach beyond the picture, u from {:.3} to {:.3} and v from {:.3} to {:.3}: it {what} there \
             (--wrap)",
            low[0], high[0], low[1], high[1]
        ));
    }
    if uv_box.is_some_and(|[low, high]| low == high) {
        output.warn("all texture coordinates are the same, so that the surface has one colour: unwrap the model first");
    }
    let extends_colours = texture.extended() == ExtendedQuantity::Colours;
    if extends_colours && seams.rms_colour_jump > VISIBLE {
        output.warn(format!(
            "the colours of the two sides of seams differ, by {:.3} in the mean (rms; 1 from black to white) and {:.3} at \
             most: the picture was not made for these seams, and the texture jumps there on the surface",
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

fn write_volume(
    path: &Path,
    texture: &SolidTexture,
    grid: &VoxelGrid,
    output: &Output,
) -> anyhow::Result<VolumeReport> {
    let of = grid.voxels();
    output.progress_of("sampling voxels", 0, of);
    let volume = texture.volume(grid, &|done| output.progress_of("sampling voxels", done, of));
    output.progress(format!("writing {}", path.display()));
    let image = ImageGrid {
        origin: grid.origin,
        spacing: grid.spacing,
        size: grid.size,
    };
    io::write_vti(path, &image, "rgba", 4, volume.rgba.as_flattened())?;
    Ok(VolumeReport {
        file: path.to_owned(),
        size: grid.size,
        spacing: grid.spacing,
        inside: volume.inside,
        bytes: std::fs::metadata(path).map(|file| file.len()).unwrap_or_default(),
    })
}

/// The points of a file, or the vertices of a mesh, and where their colours go.
struct ToColour<'a> {
    points: &'a Path,
    path: &'a Path,
    solid: Option<Solid>,
    positions: Vec<Point>,
}

impl<'a> ToColour<'a> {
    /// Refuses a file of colours that cannot hold them.
    fn read(points: &'a Path, path: &'a Path) -> anyhow::Result<Self> {
        let solid = io::is_mesh(points).then(|| io::read_solid(points)).transpose()?;
        let shown = points.display();
        let positions = match (&solid, extension(path).as_str()) {
            (None, "vtu") => {
                bail!("`{shown}` holds points without a mesh; write their colours to .csv, .npy or .ply")
            }
            (Some(Solid::Tets(_)), "ply") => bail!("`{shown}` holds tetrahedra; write their colours to .vtu"),
            (None, _) => io::read_points(points)?,
            (Some(Solid::Surface(surface)), _) => surface.vertices().to_vec(),
            (Some(Solid::Tets(tets)), _) => tets.vertices().to_vec(),
        };
        Ok(Self {
            points,
            path,
            solid,
            positions,
        })
    }

    fn cells(&self) -> Cells<'_> {
        match &self.solid {
            None => Cells::Triangles(&[]),
            Some(Solid::Surface(surface)) => Cells::Triangles(surface.triangles()),
            Some(Solid::Tets(tets)) => Cells::Tets(tets.tets()),
        }
    }
}

fn write_points(to_colour: &ToColour, texture: &SolidTexture, output: &Output) -> anyhow::Result<PointsReport> {
    let ToColour {
        points,
        path,
        positions,
        ..
    } = to_colour;
    output.progress(format!("colouring {}", points.display()));
    let colours = texture.sample(positions);
    let outside = colours.iter().filter(|colour| colour[0].is_nan()).count();
    match (extension(path).as_str(), to_colour.cells()) {
        ("ply", Cells::Triangles(triangles)) => {
            let rgba: Vec<[u8; 4]> = colours.iter().map(with_opacity).collect();
            io::write_coloured_ply(path, positions, &rgba, triangles)?;
        }
        ("vtu", cells) => write_cells(path, cells, positions, &colours)?,
        (extension, _) => write_table(path, extension == "csv", positions, &colours)?,
    }
    if outside > 0 {
        output.warn(format!(
            "{outside} of {} points lie outside of the solid and have no colour",
            positions.len()
        ));
    }
    Ok(PointsReport {
        file: path.to_path_buf(),
        points: positions.len(),
        outside,
    })
}

fn extension(path: &Path) -> String {
    path.extension().unwrap_or_default().to_string_lossy().to_lowercase()
}

fn with_opacity(light: &LinearRgb) -> [u8; 4] {
    let [r, g, b] = to_srgb(*light);
    if light[0].is_nan() { [0; 4] } else { [r, g, b, 255] }
}

/// sRGB codes from 0 to 1, as programs expect of colours in floating point; NaN outside.
fn codes(light: &LinearRgb) -> [f64; 3] {
    if light[0].is_nan() {
        return [f64::NAN; 3];
    }
    to_srgb(*light).map(|code| f64::from(code) / 255.0)
}

fn write_cells(path: &Path, cells: Cells, positions: &[Point], colours: &[LinearRgb]) -> anyhow::Result<()> {
    let fields = VtkFields {
        point: vec![Field {
            name: "rgb".into(),
            components: 3,
            values: colours.iter().flat_map(codes).collect(),
        }],
        cell: vec![],
        ..VtkFields::default()
    };
    Ok(io::write_vtu(path, positions, cells, &fields)?)
}

/// CSV: the points and their colours. NPY has no names: the colours.
fn write_table(path: &Path, csv: bool, positions: &[Point], colours: &[LinearRgb]) -> anyhow::Result<()> {
    if !csv {
        let values: Vec<f64> = colours.iter().flat_map(codes).collect();
        return Ok(io::write_npy(path, 3, &values)?);
    }
    let rows = positions.iter().zip(colours);
    let values: Vec<f64> = rows
        .flat_map(|(p, light)| {
            let [r, g, b] = codes(light);
            [p.x, p.y, p.z, r, g, b]
        })
        .collect();
    Ok(io::write_csv(path, &["x", "y", "z", "red", "green", "blue"], &values)?)
}

fn rows(report: &Report) -> Vec<[String; 2]> {
    let fit = &report.fit;
    let mut rows = vec![
        [
            "surface".into(),
            format!("{} vertices, {} triangles where it was fitted", fit.vertices, fit.faces),
        ],
        [
            "system".into(),
            format!("{} sources, {} collocation points", fit.sources, fit.collocation),
        ],
    ];
    if report.seams.seams > 0 {
        let seams = &report.seams;
        rows.push([
            "seams".into(),
            format!(
                "{} of {} edges; colours differ by {:.4} in the mean (rms), {:.4} at most",
                seams.seams, seams.edges, seams.rms_colour_jump, seams.largest_colour_jump
            ),
        ]);
    }
    let errors = [
        ("harmonic part", &report.harmonic_error),
        ("texture", &report.surface_error),
    ];
    for (name, error) in errors {
        if let Some(error) = error {
            rows.push([
                name.into(),
                format!("rms {:.2e}   99 % {:.2e}   max {:.2e}", error.rms, error.p99, error.max),
            ]);
        }
    }
    rows.push([
        String::new(),
        "off the picture at held-out points of the surface, as light: 1 from black to white".into(),
    ]);
    let [median, most] = report.layer.map(|t| 100.0 * t);
    rows.push([
        "layer".into(),
        format!("{median:.2} % of the diagonal thick at the median, {most:.2} % at most"),
    ]);
    if let Some(volume) = &report.volume {
        let [x, y, z] = volume.size;
        rows.push([
            "volume".into(),
            format!(
                "{x} × {y} × {z} voxels of {}, {} inside, {:.1} MiB",
                significant(volume.spacing, 4),
                volume.inside,
                volume.bytes as f64 / 1_048_576.0
            ),
        ]);
    }
    if let Some(points) = &report.points {
        rows.push([
            "points".into(),
            format!("{}, {} outside", points.points, points.outside),
        ]);
    }
    let seconds = &report.seconds;
    rows.push([
        "time".into(),
        format!(
            "texture {:.2} s, volume {:.2} s, picture {:.2} s",
            seconds.texture, seconds.volume, seconds.picture
        ),
    ]);
    let files = [
        report.volume.as_ref().map(|volume| &volume.file),
        report.points.as_ref().map(|points| &points.file),
        report.picture.as_ref(),
        report.map.as_ref(),
    ];
    let files: Vec<String> = files
        .into_iter()
        .flatten()
        .map(|path| path.display().to_string())
        .collect();
    rows.push(["written".into(), files.join(", ")]);
    rows
}

fn outcome(report: &Report, output: &Output) -> anyhow::Result<Outcome> {
    let misses = report
        .surface_error
        .is_none_or(|error| !error.max.is_finite() || error.p99 > SAME_COLOUR);
    if misses {
        output
            .warn("the texture misses the picture on the surface; see `solidmap check` for what may be wrong with it");
    }
    let missed_tolerance = report.tolerance.filter(|_| report.tolerance_met == Some(false));
    if let Some(tolerance) = missed_tolerance {
        let space = match report.extended {
            ExtendedQuantity::Colours => "the colour cube",
            ExtendedQuantity::Coordinates => "the box of texture coordinates",
        };
        output.warn(format!(
            "the harmonic part alone meets 99 % of the surface only to {:.1e} of the diagonal of {space}, and the tolerance \
             is {tolerance:.1e}; the texture was written all the same. Raise --max-sources, or leave the rest to the layer",
            report.fit.boundary_error.p99
        ));
    }
    Ok(if misses || missed_tolerance.is_some() {
        Outcome::CheckFailed
    } else {
        Outcome::Done
    })
}

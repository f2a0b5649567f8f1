//! Arguments of `texture`.

use std::path::PathBuf;

use clap::{Args, ValueEnum};

use super::bijective::MapKind;
use super::section::UpKind;
use super::values::squares;
use super::view::PageSizeArgs;

#[derive(Debug, Args)]
#[command(allow_negative_numbers = true, after_help = TEXTURE_HELP)]
pub struct TextureArgs {
    /// Closed surface (.obj with texture coordinates or vertex colours), or a texture file from --map
    pub model: PathBuf,
    /// Picture on the surface (.png, .jpg) [default: the colours of the model's vertices]
    #[arg(long, value_name = "PICTURE")]
    pub image: Option<PathBuf>,
    /// Chequered pattern instead of a picture, of N squares along each side (16 where N is left out)
    #[arg(long, value_name = "N", num_args = 0..=1, default_missing_value = "16", conflicts_with = "image", value_parser = squares)]
    pub checker: Option<usize>,
    /// Which colour texture coordinates outside the picture have [default: repeat]
    #[arg(long, value_enum)]
    pub wrap: Option<WrapKind>,
    #[command(flatten)]
    pub extension: TextureExtensionArgs,
    #[command(flatten)]
    pub through: TextureThroughArgs,
    #[command(flatten)]
    pub written: TextureOutputArgs,
}

/// How colours are extended.
#[derive(Debug, Args)]
#[command(next_help_heading = "Extension")]
pub struct TextureExtensionArgs {
    /// Extend the texture coordinates, and look up the picture inside, instead of extending colours: for coordinates
    /// without seams
    #[arg(long)]
    pub uv: bool,
    /// With --uv: extend coordinates that jump at seams all the same
    #[arg(long, requires = "uv")]
    pub across_seams: bool,
    /// Smallest number of sources; triangles are cut into four until there are as many vertices [default: 2000, or
    /// --max-sources where that is less]
    #[arg(long, value_name = "N")]
    pub sources: Option<usize>,
    /// Add sources until the error of the harmonic part alone is at most this on 99 % of the surface, as a fraction of
    /// the diagonal of the colour cube, or with --uv of the box of the texture coordinates [default: none are added]
    #[arg(long, value_name = "FRACTION")]
    pub tolerance: Option<f64>,
    /// Largest number of sources [default: 100000]
    #[arg(long, value_name = "N")]
    pub max_sources: Option<usize>,
}

/// A map that carries the texture to another solid.
#[derive(Debug, Args)]
#[command(next_help_heading = "Through a map")]
pub struct TextureThroughArgs {
    /// Map file whose domain is MODEL: the volume (-o) and the colours of points (--at) are those of its target, where
    /// each point has the colour of its preimage. Points without a preimage get none, and the exit code is 1 if there are
    /// such points in the target, or points with several preimages
    #[arg(long, value_name = "MAP")]
    pub through: Option<PathBuf>,
    /// Which map of that file to use [default: bijective if the file has it, else harmonic]
    #[arg(long, value_enum, value_name = "KIND", requires = "through")]
    pub through_kind: Option<MapKind>,
}

/// Outputs of a texture.
#[derive(Debug, Args)]
#[command(next_help_heading = "Output (at least one)")]
pub struct TextureOutputArgs {
    /// Volume of colours to write, for ParaView (.vti)
    #[arg(short, long, value_name = "VOLUME")]
    pub output: Option<PathBuf>,
    /// Voxels along the longest side of the model
    #[arg(long, default_value_t = 128, value_name = "N")]
    pub resolution: usize,
    /// Picture to write: the model, the model cut open, and sections across x, y and z (.png)
    #[arg(long, value_name = "PNG")]
    pub png: Option<PathBuf>,
    /// Page to write: the model, cut anywhere (.html). It holds the voxels of --resolution
    #[arg(long, value_name = "PAGE")]
    pub html: Option<PathBuf>,
    #[command(flatten)]
    pub page: PageSizeArgs,
    /// Position of the sections along their axes, from 0 to 1 across the model's bounding box
    #[arg(long, default_value_t = 0.5, value_name = "FRACTION")]
    pub position: f64,
    /// Axis that points up in the picture
    #[arg(long, value_enum, allow_hyphen_values = true, default_value_t = UpKind::Z)]
    pub up: UpKind,
    /// Texture file to write (.safetensors), which may be given as MODEL later
    #[arg(long, value_name = "FILE")]
    pub map: Option<PathBuf>,
    /// Points to colour: .csv with columns x, y, z; .npy (n × 3); or a mesh, which stands for its vertices
    #[arg(long, value_name = "POINTS", requires = "colours")]
    pub at: Option<PathBuf>,
    /// File to write the colours of the points of --at to: .csv, .npy, .ply or .vtu
    #[arg(long, value_name = "FILE", requires = "at")]
    pub colours: Option<PathBuf>,
}

const TEXTURE_HELP: &str = "\
Colours are averaged in linear RGB. On the surface the texture equals the picture exactly; details that are too fine \
for the sources go no deeper than these are apart.

Exit code 1 when --tolerance is missed, when the texture differs from the picture on the surface, or when points of the \
target of --through have no preimage or several.";

/// Which colour texture coordinates outside the picture have.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum WrapKind {
    /// That of the picture, repeated
    Repeat,
    /// That at the nearest edge of the picture
    Clamp,
}

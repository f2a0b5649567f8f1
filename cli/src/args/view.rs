//! Arguments of `view`.

use std::path::PathBuf;

use clap::Args;

use super::bijective::MapChoice;
use super::section::UpKind;

/// The default of `--samples`.
const SAMPLES: u16 = 64;
/// The default of `--max-size`, in bytes.
const MAX_SIZE: u64 = 60_000_000;

#[derive(Debug, Args)]
#[command(
    after_help = "The page holds all that it shows, and is opened from the disk in any browser with WebGL 2; it loads nothing \
                  from a network."
)]
pub struct ViewArgs {
    /// Map file, boundary file, mesh of tetrahedra or hexahedra (.mesh, .msh, .vtk, .vtu), or sequence: a folder that
    /// `sequence` has written, or a .pvd file of surfaces
    pub file: PathBuf,
    /// Page to write (.html)
    #[arg(short, long, value_name = "PAGE")]
    pub output: PathBuf,
    #[command(flatten)]
    pub page: PageArgs,
    #[command(flatten)]
    pub choice: MapChoice,
    /// Axis that points up in the page
    #[arg(long, value_enum, allow_hyphen_values = true, default_value_t = UpKind::Z)]
    pub up: UpKind,
}

/// How much a page holds.
#[derive(Debug, Clone, Copy, Args)]
pub struct PageArgs {
    /// Samples of a map in its page along the longest side of the domain
    #[arg(long, default_value_t = SAMPLES, value_name = "N", value_parser = clap::value_parser!(u16).range(8..=256))]
    pub samples: u16,
    #[command(flatten)]
    pub size: PageSizeArgs,
}

impl Default for PageArgs {
    fn default() -> Self {
        Self {
            samples: SAMPLES,
            size: PageSizeArgs { max_size: MAX_SIZE },
        }
    }
}

/// How large a page may be.
#[derive(Debug, Clone, Copy, Args)]
pub struct PageSizeArgs {
    /// Largest size of a page, such as 20MB: where it would be larger a map is sampled more coarsely, or frames are left
    /// out, and the page says so; the page of a mesh is not written then
    #[arg(long, default_value = "60MB", value_name = "SIZE", value_parser = super::values::bytes)]
    pub max_size: u64,
}

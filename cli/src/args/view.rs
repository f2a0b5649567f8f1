//! Arguments of `view`.

use std::path::PathBuf;

use clap::Args;

use super::bijective::MapChoice;
use super::section::UpKind;

#[derive(Debug, Args)]
#[command(
    after_help = "The page holds all that it shows, and is opened from the disk in any browser with WebGL 2; it loads nothing \
                  from a network."
)]
pub struct ViewArgs {
    /// Map file
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
    /// Samples of the map along the longest side of the domain
    #[arg(long, default_value_t = 64, value_name = "N", value_parser = clap::value_parser!(u16).range(8..=256))]
    pub samples: u16,
    /// Largest size of the page, such as 20MB: where it would be larger the map is sampled more coarsely, and the page says
    /// so
    #[arg(long, default_value = "60MB", value_name = "SIZE", value_parser = super::values::bytes)]
    pub max_size: u64,
}

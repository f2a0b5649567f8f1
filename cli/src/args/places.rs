//! Arguments of commands that list where a map is worst.

use clap::Args;
use solidmap::worst_places::LISTED;

/// How many places are listed.
#[derive(Debug, Args)]
pub struct PlacesArgs {
    /// List at most this many of the places where the map is worst
    #[arg(long, default_value_t = LISTED, value_name = "N")]
    pub worst: usize,
}

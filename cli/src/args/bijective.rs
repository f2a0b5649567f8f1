//! Arguments of `bijective`, and of the choice between the maps of a file.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use solidmap::bijective::RefinementOptions;
use solidmap::remesh::DEFAULT_EFFORT;

use super::values::{bytes, effort, off_or_count};

/// Which map of a solid is used.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum MapKind {
    /// The harmonic map, a sum over sources
    Harmonic,
    /// The one-to-one map, linear over tetrahedra, as `solidmap bijective` makes it
    Bijective,
}

#[derive(Debug, Args)]
pub struct MapChoice {
    /// Which map of the file to use [default: bijective if the file has it, else harmonic]
    #[arg(long = "map", id = "map_kind", value_enum, value_name = "KIND")]
    pub map_kind: Option<MapKind>,
}

#[derive(Debug, Args)]
#[command(
    allow_negative_numbers = true,
    after_help = "Tetrahedra of the domain are carried by the map, and repaired until none is inverted, with the boundary \
                  where the boundary map has it. The map that is linear over them is one to one, and is stored beside the \
                  harmonic map; other commands then use it (--map). The exit code is 1 if tetrahedra stay inverted, or if \
                  the boundary of the image meets itself; then nothing is written."
)]
pub struct BijectiveArgs {
    /// Map file
    pub map: PathBuf,
    /// Map file to write, with both maps [default: MAP itself]
    #[arg(short, long, value_name = "MAP")]
    pub output: Option<PathBuf>,
    /// Mesh of the domain by tetrahedra (.mesh, .msh, .vtk, .vtu) [default: TetGen makes one]
    #[arg(long, value_name = "TETS")]
    pub mesh: Option<PathBuf>,
    #[arg(
        long,
        help = format!(
            "Largest distance of the boundary from the boundary map, as a fraction of the target's diagonal: triangles of the \
             boundary are divided where the map bends more within them [default: {}]",
            RefinementOptions::default().tolerance
        ),
        value_name = "FRACTION",
    )]
    pub tolerance: Option<f64>,
    /// Cells at most that are added where nodes are stuck; `off` never splits [default: a third of the mesh's cells, and
    /// 5000]
    #[arg(long, value_name = "off|N", value_parser = off_or_count)]
    pub split_stuck: Option<usize>,
    /// Work after which the repair ends although cells stay inverted: iterations for each cell in the mean
    #[arg(long, value_name = "N", default_value_t = DEFAULT_EFFORT, value_parser = effort)]
    pub effort: f64,
    /// Limit on the memory, such as 500MB, 4GiB or a number of bytes [default: 9/10 of the available memory]
    #[arg(long, value_name = "SIZE", value_parser = bytes)]
    pub memory: Option<u64>,
}

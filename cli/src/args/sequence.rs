//! Arguments of `sequence`.

use std::path::PathBuf;

use clap::Args;
use solidmap::fit::FitOptions;
use solidmap::remesh::DEFAULT_EFFORT;

use super::bijective::MapKind;
use super::fit::MethodArgs;
use super::map::{AccuracyArgs, LameArgs};
use super::section::SectionArgs;
use super::values::effort;
use super::view::PageSizeArgs;

#[derive(Debug, Args)]
#[command(allow_negative_numbers = true)]
pub struct SequenceArgs {
    /// Boundary of the solid that frames are compared with, or a mesh of it by tetrahedra or hexahedra
    #[arg(value_name = "REF")]
    pub reference: PathBuf,
    /// REF's mesh with its vertices as they are in each frame, in the order of time
    #[arg(required = true, value_name = "FRAME")]
    pub frames: Vec<PathBuf>,
    /// Folder for the chart, the table, pictures, and series for ParaView. Those of an earlier run are replaced when
    /// all new ones are complete; other files in its folders `cells`, `surface` and `material` are never touched
    #[arg(short, long, value_name = "DIR")]
    pub output: PathBuf,
    /// Boundary error to reach over 99 % of the area, as a fraction of each frame's diagonal. Sources are added where
    /// it is larger; frames where it cannot be reached are measured all the same, and the exit code is 1
    #[arg(long, value_name = "FRACTION", default_value_t = FitOptions::adaptive().tolerance)]
    pub tolerance: f64,
    /// Map that frames are measured of. For `bijective` REF is filled with tetrahedra, its own or TetGen's, and the map of
    /// every frame is repaired over them; a frame for which no such map is found is left out, and the exit code is 1
    #[arg(long = "map", id = "map_kind", value_enum, value_name = "KIND", default_value_t = MapKind::Harmonic)]
    pub map_kind: MapKind,
    /// With --map bijective: work after which the repair of a frame ends although tetrahedra stay inverted, in iterations
    /// for each tetrahedron in the mean
    #[arg(long, value_name = "N", default_value_t = DEFAULT_EFFORT, value_parser = effort)]
    pub effort: f64,
    #[command(flatten)]
    pub accuracy: AccuracyArgs,
    #[command(flatten)]
    pub lame: LameArgs,
    /// Scale each frame to REF's volume first, as in Li et al. 2007: change of size has no energy then
    #[arg(long)]
    pub own_volume: bool,
    /// Close holes and slits of REF of up to so many edges (64 where EDGES is left out, 1000 at most), by triangles
    /// over their rims, in all frames alike
    #[arg(long, value_name = "EDGES", num_args = 0..=1, default_missing_value = "64", require_equals = true, alias = "mend")]
    pub close_holes: Option<usize>,
    /// Mesh with fields in REF (.vtu, .vtk), carried by the map of every frame to `material.pvd`: vectors turn and
    /// stretch with the solid, all other fields keep their values. See `solidmap transfer`
    #[arg(long, value_name = "FIELD")]
    pub material: Option<PathBuf>,
    /// Frames per second, for the times in the chart, the table and ParaView [default: the time is the frame's number]
    #[arg(long, default_value_t = 1.0, hide_default_value = true, value_name = "N")]
    pub fps: f64,
    /// Frames that are solved for together [default: 32, fewer where memory is short]
    #[arg(long, value_name = "N")]
    pub frames_per_block: Option<usize>,
    /// Frames to show on the cross-section, counted from 0, besides the mean and the frame of most energy
    #[arg(long, value_name = "FRAME", value_delimiter = ',')]
    pub show: Vec<usize>,
    /// Do not write the series of energies for ParaView
    #[arg(long)]
    pub no_vtu: bool,
    /// Page to play the frames in a browser, as `solidmap view` writes it of DIR (.html)
    #[arg(long, value_name = "PAGE", conflicts_with = "no_vtu")]
    pub html: Option<PathBuf>,
    #[command(flatten)]
    pub page: PageSizeArgs,
    #[command(flatten)]
    pub section: SectionArgs,
    #[command(flatten)]
    pub method: MethodArgs,
}

//! Arguments of `sequence`.

use std::path::PathBuf;

use clap::Args;
use solidmap::fit::FitOptions;

use super::fit::MethodArgs;
use super::section::SectionArgs;

#[derive(Debug, Args)]
#[command(allow_negative_numbers = true)]
pub struct SequenceArgs {
    /// Boundary of the solid that the frames are held against, or a tet mesh of it
    #[arg(value_name = "REF")]
    pub reference: PathBuf,
    /// REF's mesh with its vertices where they are in each frame, in the order of time
    #[arg(required = true, value_name = "FRAME")]
    pub frames: Vec<PathBuf>,
    /// Folder for the chart, the table, pictures, and series for ParaView. Those of an earlier run are replaced when all new
    /// ones are complete; files in `cells`, `surface` and `material` that it has not made are never touched
    #[arg(short, long, value_name = "DIR")]
    pub output: PathBuf,
    /// Boundary error to reach over 99 % of the area, as a fraction of each frame's diagonal. Sources are added where it is
    /// larger; frames where it cannot be reached are measured all the same, and the exit code is 1
    #[arg(long, value_name = "FRACTION", default_value_t = FitOptions::adaptive().tolerance)]
    pub tolerance: f64,
    /// Cells of the integration grid along the longest side of REF, the same for all frames
    #[arg(long, default_value_t = 48, value_name = "N")]
    pub resolution: usize,
    /// Lamé constants of the deformation energy
    #[arg(long, num_args = 2, value_names = ["LAMBDA", "MU"], default_values_t = [0.0335, 0.0224])]
    pub lame: Vec<f64>,
    /// Scale each frame to REF's volume first, as the paper does: change of size has no energy then
    #[arg(long)]
    pub own_volume: bool,
    /// Close holes and slits of REF of up to so many edges (1000 at most), by triangles over their rims, in all frames alike
    #[arg(long, value_name = "EDGES", num_args = 0..=1, default_missing_value = "64", require_equals = true)]
    pub mend: Option<usize>,
    /// Mesh with fields in REF (`.vtu`, `.vtk`), carried by the map of every frame to `material.pvd`: vectors turn and stretch
    /// with the solid, everything else keeps its values. See `solidmap transfer`
    #[arg(long, value_name = "FIELD")]
    pub material: Option<PathBuf>,
    /// Frames in a second, for the times in the chart, the table and ParaView [default: times count frames]
    #[arg(long, default_value_t = 1.0, hide_default_value = true, value_name = "N")]
    pub fps: f64,
    /// Frames that are solved for at once [default: 32, fewer where memory is short]
    #[arg(long, value_name = "N")]
    pub frames_per_block: Option<usize>,
    /// Frames to picture on the cross-section, counted from 0, beside the mean and the one of most energy
    #[arg(long, value_name = "FRAME", value_delimiter = ',')]
    pub show: Vec<usize>,
    /// Leave out the series of energies for ParaView
    #[arg(long)]
    pub no_vtu: bool,
    #[command(flatten)]
    pub section: SectionArgs,
    #[command(flatten)]
    pub method: MethodArgs,
}

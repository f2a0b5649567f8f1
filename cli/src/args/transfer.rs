//! Arguments of `transfer`.

use std::path::PathBuf;

use clap::Args;

use super::bijective::MapChoice;
use super::section::{SectionArgs, TargetUpArgs};
use super::view::PageArgs;

#[derive(Debug, Args)]
#[command(allow_negative_numbers = true, after_help = TRANSFER_HELP)]
pub struct TransferArgs {
    /// Map file
    pub map: PathBuf,
    /// Fields on the domain: a table (.csv with columns x, y, z and others, where three such as vx, vy, vz are a
    /// vector); a mesh (.vtu or .vtk with point or cell data on tetrahedra or hexahedra, or point data on triangles);
    /// or a grid (.vti with image data, .vtk with structured points). May be left out with --distance: a mesh of the
    /// domain is made then
    #[arg(required_unless_present = "distance")]
    pub field: Option<PathBuf>,
    /// Fields on the target, to write: .csv (without cell data), or .vtu or .vtk for a mesh
    #[arg(short, long, value_name = "OUT")]
    pub output: PathBuf,
    /// Points of the target at which fields are evaluated (.csv, .npy, or a mesh, which stands for its vertices),
    /// instead of at the images of FIELD's points. Values are interpolated linearly in tetrahedra, six of which stand
    /// for a hexahedron; outside them, they are those at the closest point of their boundary; without cells, those of
    /// the nearest point; nan where there is no preimage
    #[arg(long, value_name = "POINTS")]
    pub at: Option<PathBuf>,
    /// Field whose values are labels, which are never averaged: that of the corner with the largest weight is taken.
    /// May be given several times
    #[arg(long, value_name = "NAME")]
    pub label: Vec<String>,
    /// Fields of three components to carry as they are, all of them where NAMES is left out; others are vectors, and
    /// pushed forward by the map's Jacobian. Fields called rgb, color(s), colour(s) or normal(s) are never pushed
    /// forward
    #[arg(long, value_name = "NAMES", num_args = 0..=1, require_equals = true, value_delimiter = ',')]
    pub plain_vectors: Option<Vec<String>>,
    #[command(flatten)]
    pub choice: MapChoice,
    /// Add the distance from the domain's boundary as the field `distance`
    #[arg(long)]
    pub distance: bool,
    /// Cells along the longest side of the domain, in the grid on which volumes and distributions are checked
    #[arg(long, default_value_t = 48, value_name = "N")]
    pub resolution: usize,
    /// Write a picture: `distance`, or else the first scalar field, on cross-sections of domain and target
    #[arg(long, value_name = "FILE")]
    pub png: Option<PathBuf>,
    /// Write a page to look into the map, as `view` does, coloured by the scalar fields, too (.html)
    #[arg(long, value_name = "PAGE")]
    pub html: Option<PathBuf>,
    #[command(flatten)]
    pub page: PageArgs,
    #[command(flatten)]
    pub section: SectionArgs,
    #[command(flatten)]
    pub target_up: TargetUpArgs,
}

const TRANSFER_HELP: &str = "\
Points of FIELD outside the domain are carried, and counted in a warning: the map means nothing there. References of \
.mesh files are not carried. Two fields of the same name are refused.

Exit code 1 when --at has points of the target that have no preimage, or where the map folds; 2 when nothing could \
be done, and then nothing is written.";

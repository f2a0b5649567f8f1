//! Arguments of `transfer`.

use std::path::PathBuf;

use clap::Args;

use super::section::SectionArgs;

#[derive(Debug, Args)]
#[command(allow_negative_numbers = true, after_help = TRANSFER_HELP)]
pub struct TransferArgs {
    /// Map file
    pub map: PathBuf,
    /// Fields on the domain: .csv with columns x, y, z and others (three such as vx, vy, vz are a vector), or .vtu or .vtk
    /// with point or cell data on tetrahedra, or point data on triangles, or a grid: .vti with image data, .vtk with
    /// structured points. Without it a mesh of the domain is made, for --distance
    #[arg(required_unless_present = "distance")]
    pub field: Option<PathBuf>,
    /// Fields on the target to write: .csv (without cell data), or .vtu or .vtk for a mesh
    #[arg(short, long, value_name = "OUT")]
    pub output: PathBuf,
    /// Points of the target at which the fields are wanted (.csv, .npy, or a mesh, which stands for its vertices), instead
    /// of the images of FIELD's points. Linear in tetrahedra, beyond them as at the closest point of their boundary; the
    /// nearest point's value without tetrahedra; nan where nothing in the domain goes
    #[arg(long, value_name = "POINTS")]
    pub at: Option<PathBuf>,
    /// Field whose values are labels: never averaged, but those of the corner with the largest weight; may be given several
    /// times
    #[arg(long, value_name = "NAME")]
    pub label: Vec<String>,
    /// Carry these fields of three components as they are, or all of them without NAMES, instead of pushing vectors forward
    /// by the map's Jacobian. Fields called rgb, color, colors or normals (in any case) are never pushed forward
    #[arg(long, value_name = "NAMES", num_args = 0..=1, require_equals = true, value_delimiter = ',')]
    pub plain_vectors: Option<Vec<String>>,
    /// Add the distance from the domain's boundary as the field `distance`
    #[arg(long)]
    pub distance: bool,
    /// Cells along the longest side of the domain of the grid on which volumes are checked
    #[arg(long, default_value_t = 48, value_name = "N")]
    pub resolution: usize,
    /// Write a picture: the first scalar field, or `distance`, on cross-sections of domain and target
    #[arg(long, value_name = "FILE")]
    pub png: Option<PathBuf>,
    #[command(flatten)]
    pub section: SectionArgs,
}

const TRANSFER_HELP: &str = "\
Points of FIELD outside the domain are carried, counted and warned of: the map means nothing there. References of .mesh \
files are not carried. Fields of one name are refused.

Exit code 1 when --at asks for points of the target that have no preimage, or where the map folds; 2 when nothing could be \
done, and then nothing is written.";

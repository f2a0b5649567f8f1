//! Arguments of the commands that examine a map: `eval`, `energy`, `certify`.

use std::path::PathBuf;

use clap::Args;

use super::section::SectionArgs;

#[derive(Debug, Args)]
pub struct EvalArgs {
    /// Map file
    pub map: PathBuf,
    /// Points to map: .csv with columns x, y, z; .npy (n × 3); or a mesh, which stands for its vertices
    pub points: PathBuf,
    /// Images: .csv or .npy, or a mesh format to write POINTS' mesh with its vertices mapped
    #[arg(short, long)]
    pub output: PathBuf,
    /// Also write the Jacobian, columns j00 to j22 (j01 is the derivative of the first coordinate along y)
    #[arg(long)]
    pub jacobian: bool,
    /// POINTS are in the target: find the points of the domain that go there. Tables get columns as without, the preimage
    /// in x, y, z (nan where there is none) and the given point in fx, fy, fz, and: status (0 ok, 1 folded, 2 outside of
    /// the target, 3 not found, 4 not finite) and round_trip, the distance of the preimage's image from the given point
    /// over the target's diagonal; .npy has x, y, z, status, round_trip. Meshes get their vertices at the preimages; .vtu
    /// and .vtk have status and round_trip as fields, and vertices without a preimage at a point of the domain whose image
    /// is near, which other formats refuse. The exit code is 1 if a point of the target has no preimage or
    /// several
    #[arg(long)]
    pub inverse: bool,
    /// With --inverse: distance from the given point, over the target's diagonal, at which a preimage is found; at most
    /// 1e-3, and less than 1e-10 is not reached
    #[arg(long, value_name = "FRACTION", default_value_t = 1e-10, requires = "inverse")]
    pub tolerance: f64,
}

#[derive(Debug, Args)]
#[command(allow_negative_numbers = true)]
pub struct EnergyArgs {
    /// Map file
    pub map: PathBuf,
    /// Cells of the integration grid along the longest side of the domain
    #[arg(long, default_value_t = 48, value_name = "N")]
    pub resolution: usize,
    /// Integrate over this tet mesh of the domain instead of a grid
    #[arg(long, value_name = "TETS")]
    pub mesh: Option<PathBuf>,
    /// Keep the solids at their size instead of scaling both to unit volume
    #[arg(long)]
    pub no_normalize: bool,
    /// Lamé constants of the deformation energy
    #[arg(long, num_args = 2, value_names = ["LAMBDA", "MU"], default_values_t = [0.0335, 0.0224])]
    pub lame: Vec<f64>,
    /// Write the energy densities of all cells, for ParaView (.vtu)
    #[arg(long, value_name = "FILE")]
    pub vtu: Option<PathBuf>,
    /// Write a picture of a cross-section: both energies and the target's distance field seen through the map
    #[arg(long, value_name = "FILE")]
    pub png: Option<PathBuf>,
    #[command(flatten)]
    pub section: SectionArgs,
}

#[derive(Debug, Args)]
#[command(
    allow_negative_numbers = true,
    after_help = "Every cell of an octree is proved to keep the orientation, proved to be turned inside out, or undecided. The exit \
                  code is 1 when a fold is proved, and 0 when none is, also while a part is undecided."
)]
pub struct CertifyArgs {
    /// Map file
    pub map: PathBuf,
    /// Write all cells with what is proved in them, for ParaView (.vtu)
    #[arg(short, long, value_name = "FILE")]
    pub output: Option<PathBuf>,
    /// Write a picture of a cross-section, coloured by what is proved (.png)
    #[arg(long, value_name = "FILE")]
    pub png: Option<PathBuf>,
    /// Cells along the longest side of the domain where they are smallest; rounded up to a power of two
    #[arg(long, default_value_t = 4096, value_name = "N")]
    pub finest: usize,
    /// Limit on the number of cells: 2 KB each while they are being divided
    #[arg(long, default_value_t = 1_000_000, value_name = "N")]
    pub max_cells: usize,
    /// End when no larger share of the volume is undecided
    #[arg(long, default_value_t = 0.0, value_name = "FRACTION")]
    pub undecided: f64,
    #[command(flatten)]
    pub section: SectionArgs,
}

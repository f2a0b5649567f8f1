//! Arguments of the commands that examine a map: `eval`, `energy`, `certify`.

use std::path::PathBuf;

use clap::Args;
use solidmap::energy::{AdaptiveOptions, GridResolution, Lame};

use super::bijective::MapChoice;
use super::places::PlacesArgs;
use super::section::SectionArgs;
use super::view::PageArgs;

#[derive(Debug, Args)]
pub struct EvalArgs {
    /// Map file
    pub map: PathBuf,
    /// Points to map: .csv with columns x, y, z; .npy (n × 3); or a mesh, which stands for its vertices
    pub points: PathBuf,
    /// Images: .csv or .npy, or a mesh format to write POINTS' mesh with its vertices mapped. In .csv, a column `inside` is
    /// 0 for points outside the domain, where values of the map mean nothing
    #[arg(short, long)]
    pub output: PathBuf,
    /// Also write the Jacobian, in columns j00 to j22 (j01 is the derivative of the first coordinate with respect to
    /// y); with --inverse that at the preimage
    #[arg(long)]
    pub jacobian: bool,
    /// Also write the distance from each point to the domain's boundary, negative outside, in a column `distance`
    #[arg(long, conflicts_with = "inverse")]
    pub distance: bool,
    /// Find preimages: POINTS are in the target. A table gets the preimage in x, y, z (nan where there is none), the
    /// given point in fx, fy, fz (not in .npy), and columns status (0 ok, 1 folded, 2 outside the target, 3 not found,
    /// 4 not finite) and round_trip, the distance from the given point to the preimage's image over the target's
    /// diagonal. A mesh gets its vertices at the preimages. In .vtu and .vtk, status and round_trip are fields, and a
    /// vertex without a preimage is put at a point of the domain whose image is near it; other formats are refused
    /// then. The exit code is 1 if a point of the target has no preimage or several
    #[arg(long)]
    pub inverse: bool,
    /// With --inverse: largest distance from the given point to the preimage's image, as a fraction of the target's
    /// diagonal; at most 1e-3, and less than 1e-10 is not reached
    #[arg(long, value_name = "FRACTION", default_value_t = 1e-10, requires = "inverse")]
    pub tolerance: f64,
    #[command(flatten)]
    pub choice: MapChoice,
}

#[derive(Debug, Args)]
pub struct LameArgs {
    /// Lamé constants of the deformation energy
    #[arg(long, num_args = 2, value_names = ["LAMBDA", "MU"], default_values_t = [0.0335, 0.0224])]
    lame: Vec<f64>,
}

impl LameArgs {
    /// The constants; refused where they are not those of a material, whose energy is positive.
    pub fn constants(&self) -> anyhow::Result<Lame> {
        let (lambda, mu) = (self.lame[0], self.lame[1]);
        anyhow::ensure!(
            lambda.is_finite() && mu.is_finite() && mu > 0.0 && 3.0 * lambda + 2.0 * mu > 0.0,
            "--lame is {lambda} {mu}, but both must be finite, MU positive, and 3 LAMBDA + 2 MU too: otherwise the energy \
             of a deformation can be negative"
        );
        Ok(Lame { lambda, mu })
    }
}

#[derive(Debug, Args)]
pub struct AccuracyArgs {
    /// Cells of the integration grid along the longest side of the domain; they are divided where the densities vary
    #[arg(long, default_value_t = 48, value_name = "N")]
    resolution: usize,
    /// Largest error of the energies by integration, as a fraction of them; `inf` to divide no cells
    #[arg(long, default_value_t = AdaptiveOptions::default().tolerance, value_name = "FRACTION")]
    energy_tolerance: f64,
}

impl AccuracyArgs {
    /// How energies are integrated.
    pub fn options(&self) -> AdaptiveOptions {
        AdaptiveOptions {
            resolution: GridResolution::CellsAlongLongestSide(self.resolution),
            tolerance: self.energy_tolerance,
            max_points: None,
        }
    }

    /// Largest error of the energies, as a fraction of them.
    pub fn tolerance(&self) -> f64 {
        self.energy_tolerance
    }
}

#[derive(Debug, Args)]
#[command(
    allow_negative_numbers = true,
    after_help = "The exit code is 1 when the errors of the energies exceed --energy-tolerance."
)]
pub struct EnergyArgs {
    /// Map file
    pub map: PathBuf,
    #[command(flatten)]
    pub accuracy: AccuracyArgs,
    /// Integrate over this mesh of the domain by tetrahedra or hexahedra, instead of over a grid, without an estimate of
    /// the error
    #[arg(long, value_name = "TETS", conflicts_with_all = ["resolution", "energy_tolerance"])]
    pub mesh: Option<PathBuf>,
    /// Do not scale both solids to unit volume
    #[arg(long)]
    pub no_normalize: bool,
    #[command(flatten)]
    pub choice: MapChoice,
    #[command(flatten)]
    pub lame: LameArgs,
    /// Write the energy densities of all cells, for ParaView (.vtu, .vtk)
    #[arg(long, value_name = "FILE")]
    pub vtu: Option<PathBuf>,
    /// Write a picture of a cross-section: both energy densities, and the target's distance field pulled back by the
    /// map
    #[arg(long, value_name = "FILE")]
    pub png: Option<PathBuf>,
    /// Write a page to look into the map, as `view` does (.html)
    #[arg(long, value_name = "PAGE", conflicts_with = "no_normalize")]
    pub html: Option<PathBuf>,
    #[command(flatten)]
    pub page: PageArgs,
    #[command(flatten)]
    pub section: SectionArgs,
    #[command(flatten)]
    pub places: PlacesArgs,
}

#[derive(Debug, Args)]
#[command(
    allow_negative_numbers = true,
    after_help = "The map is proved to preserve orientation in a cell of an octree, proved to invert it, or the cell \
                  is undecided. The exit code is 1 when a fold is proved, and 0 when none is, even if cells are \
                  undecided."
)]
pub struct CertifyArgs {
    /// Map file
    pub map: PathBuf,
    /// Write all cells with what is proved in them, for ParaView (.vtu, .vtk). Eight siblings with the same verdict are
    /// written as one cell, with the least of their bounds
    #[arg(short, long, value_name = "FILE")]
    pub output: Option<PathBuf>,
    /// Write a picture of a cross-section, coloured by what is proved, and of its worst place enlarged (.png)
    #[arg(long, value_name = "FILE")]
    pub png: Option<PathBuf>,
    /// Write a page to look into the map, as `view` does, with boxes where it is folded or where that is undecided (.html)
    #[arg(long, value_name = "PAGE")]
    pub html: Option<PathBuf>,
    #[command(flatten)]
    pub page: PageArgs,
    /// Size of the smallest cells: how many along the longest side of the domain, rounded up to a power of two
    #[arg(long, default_value_t = 4096, value_name = "N")]
    pub finest: usize,
    /// Largest number of cells, which take 2 KB each while they are being divided
    #[arg(long, default_value_t = 1_000_000, value_name = "N")]
    pub max_cells: usize,
    /// Stop when at most this fraction of the volume is undecided
    #[arg(long, default_value_t = 0.0, value_name = "FRACTION")]
    pub undecided: f64,
    #[command(flatten)]
    pub choice: MapChoice,
    #[command(flatten)]
    pub section: SectionArgs,
    #[command(flatten)]
    pub places: PlacesArgs,
}

//! Arguments of `compare`.

use std::path::PathBuf;

use clap::{ArgGroup, Args, ValueEnum};
use solidmap::fit::FitOptions;

use super::boundary::BoundaryMapFiles;
use super::cgal_tetgen::Mesher;
use super::section::SectionArgs;
use super::values::{bytes, seconds};

#[derive(Debug, Args)]
#[command(
    allow_negative_numbers = true,
    group(ArgGroup::new("boundary_map").required(true).args(["image", "boundary"]))
)]
pub struct CompareArgs {
    #[command(flatten)]
    pub files: BoundaryMapFiles,
    /// Methods to compare, separated by commas
    #[arg(
        long,
        value_enum,
        value_delimiter = ',',
        default_value = "mfs,fem,variational,mean_value"
    )]
    pub methods: Vec<MapMethod>,
    /// Folder for tables, a picture, a page of both, and the maps at points and on a tet mesh
    #[arg(short, long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Make no maps, but measure one: that from the tetrahedra of DOMAIN to those of IMAGE, both meshes of the same
    /// tetrahedra. Writes the metrics of VOLMAP's program (.csv); the exit code is 1 if a tetrahedron is inverted
    #[arg(long, value_name = "FILE", conflicts_with_all = ["out", "equal_accuracy", "mesh_study", "frames", "boundary"])]
    pub metrics: Option<PathBuf>,
    /// Refine the finite elements until their difference to the reference inside is no larger than that of mfs
    #[arg(long)]
    pub equal_accuracy: bool,
    /// Also map with four tet meshes (three qualities of TetGen, and Mesh_3), and by mfs with four source distances, to
    /// see how much maps depend on these choices
    #[arg(long)]
    pub mesh_study: bool,
    /// Images of DOMAIN, as the frames of a sequence: also measure the time that each frame takes
    #[arg(long, value_name = "FRAME", num_args = 1..)]
    pub frames: Vec<PathBuf>,
    #[command(flatten)]
    pub tets: CompareTets,
    #[command(flatten)]
    pub measure: CompareMeasure,
    #[command(flatten)]
    pub budget: CompareBudget,
}

/// Tetrahedra of the methods that need them.
#[derive(Debug, Args)]
#[command(next_help_heading = "Tetrahedra")]
pub struct CompareTets {
    /// Edge length inside, as a fraction of the domain's diagonal [default: twice the mean edge of the surface]
    #[arg(long, value_name = "FRACTION")]
    pub mesh_size: Option<f64>,
    /// TetGen: largest ratio of circumradius to shortest edge
    #[arg(long, default_value_t = 1.414, value_name = "RATIO")]
    pub quality: f64,
    /// Program that makes the tetrahedra
    #[arg(long, value_enum, default_value_t = Mesher::Tetgen)]
    pub mesher: Mesher,
    /// Tet mesh of the domain to use instead of making one; the finite elements are linear in tetrahedra, so that
    /// hexahedra cannot be used
    #[arg(long, value_name = "TETS", conflicts_with_all = ["mesh_size", "equal_accuracy", "mesh_study"])]
    pub mesh: Option<PathBuf>,
}

/// How maps are made and measured.
#[derive(Debug, Args)]
#[command(next_help_heading = "Measuring")]
pub struct CompareMeasure {
    /// Boundary error that mfs aims at over 99 % of the area, as a fraction of the target's diagonal
    #[arg(long, value_name = "FRACTION", default_value_t = FitOptions::adaptive().tolerance)]
    pub tolerance: f64,
    /// Cells of the integration grid along the longest side of the domain; they are divided where energies are not
    /// accurate to 1 %
    #[arg(long, default_value_t = 40, value_name = "N")]
    pub resolution: usize,
    /// Points inside at which maps are compared with the reference
    #[arg(long, default_value_t = 5000, value_name = "N")]
    pub interior: usize,
    /// The variational method stops when a step lowers the energy by less than this fraction of it
    #[arg(long, default_value_t = 1e-6, value_name = "FRACTION")]
    pub threshold: f64,
    /// Leave out the reference, and the differences to it
    #[arg(long, conflicts_with = "equal_accuracy")]
    pub no_reference: bool,
    /// Seed of all random choices
    #[arg(long, default_value_t = FitOptions::adaptive().seed)]
    pub seed: u64,
    #[command(flatten)]
    pub section: SectionArgs,
}

/// Limits for each map.
#[derive(Debug, Args)]
#[command(next_help_heading = "Budget of each map")]
pub struct CompareBudget {
    /// Seconds, measuring included
    #[arg(long, default_value_t = 600.0, value_name = "SECONDS", value_parser = seconds)]
    pub time_limit: f64,
    /// Tetrahedra, estimated before they are made
    #[arg(long, default_value_t = 5_000_000, value_name = "N")]
    pub max_tets: usize,
    /// Memory of mfs, such as 500MB, 4GiB or a number of bytes [default: 9/10 of the available memory]
    #[arg(long, value_name = "SIZE", value_parser = bytes)]
    pub memory: Option<u64>,
}

#[derive(Debug, Args)]
pub struct CompareWorkerArgs {
    pub job: PathBuf,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum MapMethod {
    /// Method of fundamental solutions
    Mfs,
    /// Linear finite elements on tetrahedra
    Fem,
    /// Steepest descent of the same energy, as in Wang et al. 2004
    Variational,
    /// Mean value coordinates, which give no harmonic map
    #[value(name = "mean_value", alias = "mean-value")]
    MeanValue,
    /// The map by mfs, made one to one over tetrahedra (as `solidmap bijective` does)
    Bijective,
}

impl From<MapMethod> for solidmap::compare::ComparedMethod {
    fn from(method: MapMethod) -> Self {
        match method {
            MapMethod::Mfs => Self::Mfs,
            MapMethod::Fem => Self::Fem,
            MapMethod::Variational => Self::Variational,
            MapMethod::MeanValue => Self::MeanValue,
            MapMethod::Bijective => Self::Bijective,
        }
    }
}

//! Arguments of `study`.

use std::path::PathBuf;

use clap::{ArgGroup, Args, Subcommand, ValueEnum};
use solidmap::fit::FitOptions;
use solidmap::solver::DenseOptions;

use super::boundary::BoundaryMapFiles;
use super::fit::{MethodArgs, PlacementArgs, PlacementKind};
use super::map::{AccuracyArgs, LameArgs};
use super::section::SectionArgs;
use super::values::bytes;
use crate::shared::input::BoundarySource;

#[derive(Debug, Subcommand)]
pub enum StudyCommand {
    /// Errors, energies and conditioning over the place of the sources: on spheres, on offset surfaces, near the surface
    /// (figure 5 a to c)
    Placement(StudyPlacementArgs),
    /// The same over the numbers of sources and of collocation points (figure 5 d)
    Ratios(StudyRatiosArgs),
    /// Energies of the maps that continue several boundary maps of one domain, and where they are (figure 3)
    Boundary(StudyBoundaryArgs),
}

#[derive(Debug, Args)]
#[command(
    allow_negative_numbers = true,
    group(ArgGroup::new("boundary_map").required(true).args(["image", "second", "boundary"])),
    override_usage = "solidmap study placement [OPTIONS] DOMAIN IMAGE\n       \
                      solidmap study placement [OPTIONS] [DOMAIN] --boundary FILE",
    after_help = STUDY_HELP
)]
pub struct StudyPlacementArgs {
    #[command(flatten)]
    pub source: StudySource,
    /// Placements to study, separated by commas
    #[arg(long, value_enum, value_delimiter = ',', default_value = ALL_PLACEMENTS)]
    pub placements: Vec<PlacementKind>,
    /// Radii of the spheres, over the domain's diagonal: the paper's R-Ratio, more than 0.5
    #[arg(
        long,
        value_name = "LIST",
        value_delimiter = ',',
        default_value = "0.55,0.7,1,1.5,2,3"
    )]
    pub radius: Vec<f64>,
    /// Distances of the offset surfaces, over the domain's diagonal: the paper's O-Distance. One of
    /// 0.01 takes a minute to make
    #[arg(
        long,
        value_name = "LIST",
        value_delimiter = ',',
        default_value = "0.02,0.03,0.05,0.1,0.2,0.4"
    )]
    pub offset: Vec<f64>,
    /// Distances of the sources from the surface in the adaptive placement, over their local spacing: at most 5
    #[arg(long, value_name = "LIST", value_delimiter = ',', default_value = "0.5,1,1.5,2,3")]
    pub alpha: Vec<f64>,
    /// Sources per boundary point: the paper's sRatio, one curve for each
    #[arg(long, value_name = "LIST", value_delimiter = ',', default_value = "0.6")]
    pub s_ratio: Vec<f64>,
    /// Collocation points per boundary point: the paper's cRatio
    #[arg(long, value_name = "RATIO", default_value_t = FitOptions::paper().collocation_ratio)]
    pub c_ratio: f64,
    #[command(flatten)]
    pub system: StudySystemArgs,
    #[command(flatten)]
    pub outputs: StudyOutputs,
}

#[derive(Debug, Args)]
#[command(
    allow_negative_numbers = true,
    group(ArgGroup::new("boundary_map").required(true).args(["image", "second", "boundary"])),
    override_usage = "solidmap study ratios [OPTIONS] DOMAIN IMAGE\n       \
                      solidmap study ratios [OPTIONS] [DOMAIN] --boundary FILE",
    after_help = STUDY_HELP
)]
pub struct StudyRatiosArgs {
    #[command(flatten)]
    pub source: StudySource,
    /// Sources per boundary point: the paper's sRatio
    #[arg(long, value_name = "LIST", value_delimiter = ',', default_value = "0.2,0.4,0.6,0.8")]
    pub s_ratio: Vec<f64>,
    /// Collocation points per boundary point: the paper's cRatio, one curve for each. There must be more of them than
    /// sources
    #[arg(long, value_name = "LIST", value_delimiter = ',', default_value = "1,1.5,2,3")]
    pub c_ratio: Vec<f64>,
    /// Where the sources are placed [default: offset, or what --radius or --alpha imply]
    #[arg(long, value_enum)]
    pub placement: Option<PlacementKind>,
    #[command(flatten)]
    pub place: PlacementArgs,
    #[command(flatten)]
    pub system: StudySystemArgs,
    #[command(flatten)]
    pub outputs: StudyOutputs,
}

/// Offset surfaces need CGAL.
const ALL_PLACEMENTS: &str = if cfg!(feature = "native") {
    "sphere,offset,adaptive"
} else {
    "sphere,adaptive"
};

const STUDY_HELP: &str = "\
Every setting is a row of the table; one that cannot be computed has its reason, and makes the exit code 1. The table is
written after every row, and rows that are in it with the same files and settings are not computed again.";

/// The boundary map that is studied.
#[derive(Debug, Args)]
pub struct StudySource {
    #[command(flatten)]
    files: BoundaryMapFiles,
    /// The same as --image IMAGE
    #[arg(value_name = "IMAGE")]
    second: Option<PathBuf>,
}

impl StudySource {
    /// Where the boundary map comes from, if it is named.
    pub fn source(&self) -> Option<BoundarySource> {
        match (&self.files.domain, &self.second) {
            (Some(domain), Some(image)) => Some(BoundarySource::Image {
                domain: domain.clone(),
                image: image.clone(),
            }),
            _ => self.files.source(),
        }
    }
}

/// What is the same in all rows of a study of placements or ratios.
#[derive(Debug, Args)]
#[command(next_help_heading = "Systems, the same in all rows")]
pub struct StudySystemArgs {
    /// Boundary points that the ratios are of: so many vertices, evenly chosen, or all where there are fewer. Time grows with
    /// the cube of it
    #[arg(long, value_name = "N", default_value_t = 1000)]
    pub points: usize,
    /// Decomposition of the dense systems: `svd`, as in Li et al. 2007, gives their exact condition numbers and ranks;
    /// `dense` (QR) estimates them, in a tenth of the time
    #[arg(long, value_enum, default_value_t = DecompositionKind::Svd)]
    pub method: DecompositionKind,
    #[arg(
        long,
        help = format!(
            "Singular values or pivots below this fraction of the largest count as zero [default: {:e}]",
            DenseOptions::default().truncation
        ),
        value_name = "FRACTION",
        default_value_t = DenseOptions::default().truncation,
        hide_default_value = true,
    )]
    pub truncation: f64,
    /// Leave the affine functions out of the basis, as in Li et al. 2007
    #[arg(long)]
    pub no_affine: bool,
    /// Largest number of sources: a row that asks for more is not computed, and says so
    #[arg(long, value_name = "N", default_value_t = 3000)]
    pub max_sources: usize,
    /// Limit on the memory, such as 500MB, 4GiB or a number of bytes: a row that needs more is not computed [default: 9/10
    /// of the available memory]
    #[arg(long, value_name = "SIZE", value_parser = bytes)]
    pub memory: Option<u64>,
    /// Number of held-out boundary points at which the boundary error is measured
    #[arg(long, default_value_t = FitOptions::paper().held_out, value_name = "N")]
    pub held_out: usize,
    /// Seed of all random choices
    #[arg(long, default_value_t = FitOptions::paper().seed)]
    pub seed: u64,
    /// Cells of the integration grid along the longest side of the domain; they are divided where energies are not accurate
    /// to 1 %, as far as 100 000 points allow
    #[arg(long, default_value_t = 24, value_name = "N")]
    pub resolution: usize,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum DecompositionKind {
    /// QR decomposition
    #[value(alias = "qr")]
    Dense,
    /// Truncated singular value decomposition
    Svd,
}

/// Files that a study writes.
#[derive(Debug, Args)]
#[command(next_help_heading = "Results")]
pub struct StudyOutputs {
    /// Table to write and to go on with (.csv): rows of other files or settings that are in it stay
    #[arg(short, long, value_name = "TABLE", alias = "csv")]
    pub output: Option<PathBuf>,
    /// Write a picture of what was found (.png)
    #[arg(long, value_name = "FILE")]
    pub png: Option<PathBuf>,
    /// Write a page with the picture, and a table with units and explanations (.html)
    #[arg(long, value_name = "PAGE")]
    pub html: Option<PathBuf>,
}

#[derive(Debug, Args)]
#[command(
    allow_negative_numbers = true,
    after_help = "Every map is a row of the table; one that cannot be fitted has its reason. That, and a map that misses the \
                  tolerance, makes the exit code 1. The table is written after every row, and rows that are in it with the \
                  same files and settings are not computed again, unless a picture or a page is asked for, which shows the \
                  maps themselves."
)]
pub struct StudyBoundaryArgs {
    /// Boundary maps: boundary files, or images, which are meshes of DOMAIN with every vertex at its image
    #[arg(required = true, num_args = 1.., value_name = "MAP")]
    pub maps: Vec<PathBuf>,
    /// The domain of all of them; boundary files have it in them
    #[arg(long, value_name = "DOMAIN")]
    pub domain: Option<PathBuf>,
    /// Boundary error to reach over 99 % of the area, as a fraction of each target's diagonal
    #[arg(long, value_name = "FRACTION", default_value_t = FitOptions::adaptive().tolerance)]
    pub tolerance: f64,
    #[command(flatten)]
    pub accuracy: AccuracyArgs,
    #[command(flatten)]
    pub lame: LameArgs,
    #[command(flatten)]
    pub section: SectionArgs,
    #[command(flatten)]
    pub outputs: StudyOutputs,
    #[command(flatten)]
    pub method: MethodArgs,
}

//! Arguments of `fit`, and of every command that fits.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use solidmap::fit::{FitOptions, Placement};
use solidmap::solver::DenseOptions;

use super::boundary::PairArgs;
use super::values::bytes;

#[derive(Debug, Args)]
#[command(allow_negative_numbers = true)]
pub struct FitArgs {
    /// Boundary of the solid to map, or a tet mesh of it; with --boundary it may be left out
    #[arg(required_unless_present = "boundary")]
    pub domain: Option<PathBuf>,
    /// DOMAIN's mesh with every vertex at its image
    #[arg(
        long,
        value_name = "IMAGE",
        requires = "domain",
        required_unless_present_any = ["boundary", "target"]
    )]
    pub image: Option<PathBuf>,
    /// Boundary map that says where every point goes, not vertices alone
    #[arg(long, value_name = "FILE", conflicts_with = "image")]
    pub boundary: Option<PathBuf>,
    /// `sphere`, or the boundary of a solid: the boundary map is made as `boundary sphere` and `boundary pair` make it
    #[arg(long, value_name = "MODEL", requires = "domain", conflicts_with_all = ["image", "boundary"])]
    pub target: Option<PathBuf>,
    #[command(flatten, next_help_heading = "Boundary map, with --target MODEL")]
    pub pair: PairArgs,
    /// Map file to write (safetensors)
    #[arg(short, long, value_name = "MAP")]
    pub output: PathBuf,
    /// Boundary error to reach over 99 % of the area, as a fraction of the target's diagonal. Sources are added where it
    /// is larger; if it cannot be reached, the best map is written and the exit code is 1
    #[arg(long, value_name = "FRACTION", default_value_t = FitOptions::adaptive().tolerance)]
    pub tolerance: f64,
    /// Also write the boundary with its images and errors, for ParaView (.vtu)
    #[arg(long, value_name = "FILE")]
    pub vtu: Option<PathBuf>,
    #[command(flatten)]
    pub method: MethodArgs,
}

/// Settings of the method of fundamental solutions.
#[derive(Debug, Args)]
#[command(next_help_heading = "Method")]
pub struct MethodArgs {
    /// Start from the paper's settings: offset surface at 0.1, s-ratio 0.6, c-ratio 1, svd (but see --no-affine)
    #[arg(long)]
    pub paper: bool,
    /// Where the sources stand [default: adaptive]
    #[arg(long, value_enum)]
    pub placement: Option<PlacementKind>,
    #[arg(
        long,
        help = format!(
            "Adaptive placement: source distance over local spacing [default: {}]",
            Placement::DEFAULT_ALPHA
        ),
        conflicts_with_all = ["offset", "radius", "paper"],
    )]
    pub alpha: Option<f64>,
    #[arg(
        long,
        help = format!("Offset placement: distance over the domain's diagonal [default: {}]", Placement::DEFAULT_DISTANCE),
        value_name = "FRACTION",
        conflicts_with = "radius",
    )]
    pub offset: Option<f64>,
    #[arg(
        long,
        help = format!("Sphere placement: radius over the domain's diagonal [default: {}]", Placement::DEFAULT_RADIUS),
        value_name = "FRACTION",
    )]
    pub radius: Option<f64>,
    #[arg(
        long,
        help = format!(
            "Sources per boundary vertex [default: {}; offset and sphere: {}]",
            FitOptions::adaptive().source_ratio,
            FitOptions::paper().source_ratio
        ),
        value_name = "RATIO",
    )]
    pub s_ratio: Option<f64>,
    #[arg(
        long,
        help = format!(
            "Collocation points per boundary vertex: up to 1, vertices; 3, vertices and centroids; else spread around the \
             sources [default: {}; offset and sphere: {}]",
            FitOptions::adaptive().collocation_ratio,
            FitOptions::paper().collocation_ratio
        ),
        value_name = "RATIO",
    )]
    pub c_ratio: Option<f64>,
    #[arg(
        long,
        help = format!(
            "Limit on the sources, also of refinement; larger models get fewer than asked for [default: {}; dense: {}; \
             svd: {}]",
            FitOptions::adaptive().max_sources,
            FitOptions::dense().max_sources,
            FitOptions::paper().max_sources
        ),
        value_name = "N",
    )]
    pub max_sources: Option<usize>,
    /// Limit on the memory, such as 500MB, 4GiB or a number of bytes: a fit that needs more is refused before it starts,
    /// and refinement ends there [default: 9/10 of what is available now]
    #[arg(long, value_name = "SIZE", value_parser = bytes)]
    pub memory: Option<u64>,
    /// How the coefficients are solved for [default: schwarz with the adaptive placement, else svd]
    #[arg(long, value_enum)]
    pub method: Option<MethodKind>,
    #[arg(
        long,
        help = format!(
            "Dense methods: singular values or pivots below this fraction of the largest are cut off [default: {:e}]",
            DenseOptions::default().truncation
        ),
    )]
    pub truncation: Option<f64>,
    /// Leave the affine functions out of the basis, as the paper does
    #[arg(long)]
    pub no_affine: bool,
    /// Add no sources where the tolerance is missed
    #[arg(long)]
    pub no_refine: bool,
    /// Held-out boundary points that the error is averaged over
    #[arg(long, default_value_t = FitOptions::adaptive().held_out, value_name = "N")]
    pub held_out: usize,
    /// Seed of all random choices
    #[arg(long, default_value_t = FitOptions::adaptive().seed)]
    pub seed: u64,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum PlacementKind {
    /// Near the surface, by local spacing
    Adaptive,
    /// On an offset surface, as in the paper
    Offset,
    /// On a sphere around the domain
    Sphere,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum MethodKind {
    /// Iterations with local solves: any number of sources, near the surface
    Schwarz,
    /// Dense QR: for a few thousand sources
    #[value(alias = "qr")]
    Dense,
    /// Dense truncated singular value decomposition, as in the paper: slower than QR
    Svd,
}

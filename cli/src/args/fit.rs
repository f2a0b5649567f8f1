//! Arguments of `fit`, and of every command that fits.

use std::path::PathBuf;

use clap::{ArgGroup, Args, ValueEnum};
use solidmap::fit::{COLLOCATION_PER_FREE_SOURCE, FitOptions, MOST_FREE_SOURCES, Placement};
use solidmap::solver::DenseOptions;

use super::boundary::{BoundaryMapFiles, PairArgs};
use super::places::PlacesArgs;
use super::values::bytes;

#[derive(Debug, Args)]
#[command(
    allow_negative_numbers = true,
    group(ArgGroup::new("boundary_map").required(true).args(["image", "boundary", "target"]))
)]
pub struct FitArgs {
    #[command(flatten)]
    pub files: BoundaryMapFiles,
    /// Solid to map onto, or `sphere` or `torus`: the boundary map is made first, as by `boundary pair`, `boundary sphere`
    /// or `boundary torus`
    #[arg(long, value_name = "MODEL", requires = "domain")]
    pub target: Option<PathBuf>,
    /// Map file to write (safetensors)
    #[arg(short, long, value_name = "MAP")]
    pub output: PathBuf,
    /// Boundary error to reach over 99 % of the area, as a fraction of the target's diagonal. Sources are added where
    /// it is larger; if it cannot be reached, the best map is written and the exit code is 1
    #[arg(long, value_name = "FRACTION", default_value_t = FitOptions::adaptive().tolerance)]
    pub tolerance: f64,
    /// Largest boundary error to reach anywhere, as a multiple of --tolerance; inf for no such limit
    #[arg(long, value_name = "RATIO", default_value_t = FitOptions::adaptive().max_error_ratio)]
    pub max_error: f64,
    /// Largest boundary error to reach anywhere, as a multiple of the spacing of the image's vertices around: 1 keeps
    /// squeezed limbs apart
    #[arg(long, value_name = "RATIO", default_value_t = FitOptions::adaptive().max_local_error)]
    pub max_local_error: f64,
    /// Also make the one-to-one map that is linear over tetrahedra (those of DOMAIN, if it is a tet mesh), and store it
    /// beside the harmonic one; other commands then use it. If there is none, the harmonic map is written all the same,
    /// and the exit code is 1. `solidmap bijective` has the options
    #[arg(long)]
    pub bijective: bool,
    /// Also write the boundary with its images and errors, for ParaView (.vtu, .vtk)
    #[arg(long, value_name = "FILE")]
    pub vtu: Option<PathBuf>,
    #[command(flatten)]
    pub places: PlacesArgs,
    // A help heading applies to all following arguments that have none of their own.
    #[command(flatten, next_help_heading = "Boundary map, with --target MODEL")]
    pub pair: PairArgs,
    #[command(flatten)]
    pub method: MethodArgs,
}

/// Settings of the method of fundamental solutions.
#[derive(Debug, Args)]
#[command(next_help_heading = "Method")]
pub struct MethodArgs {
    /// Start from the settings of Li et al. 2007: offset surface at 0.1, s-ratio 0.6, c-ratio 1, svd (see also
    /// --no-affine)
    #[arg(long, conflicts_with = "alpha")]
    pub paper: bool,
    /// Where the sources are placed [default: adaptive, or what --offset, --radius or --paper imply]
    #[arg(long, value_enum)]
    pub placement: Option<PlacementKind>,
    #[command(flatten)]
    pub place: PlacementArgs,
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
            "Collocation points per boundary vertex: up to 1, vertices; 3, vertices and centroids; else spread around \
             the sources [default: {}; offset and sphere: {}; free sources: {COLLOCATION_PER_FREE_SOURCE} times --s-ratio]",
            FitOptions::adaptive().collocation_ratio,
            FitOptions::paper().collocation_ratio
        ),
        value_name = "RATIO",
    )]
    pub c_ratio: Option<f64>,
    #[arg(
        long,
        help = format!(
            "Largest number of sources, refinement included [default: {}; dense: {}; svd: {}]",
            FitOptions::adaptive().max_sources,
            FitOptions::dense().max_sources,
            FitOptions::paper().max_sources
        ),
        value_name = "N",
    )]
    pub max_sources: Option<usize>,
    #[arg(
        long,
        help = format!(
            "Largest number of sources after refinement, per boundary vertex; 50 000 are allowed in any case, and inf is no \
             limit [default: {}]",
            FitOptions::adaptive().max_source_ratio
        ),
        value_name = "RATIO",
    )]
    pub max_s_ratio: Option<f64>,
    /// Limit on the memory, such as 500MB, 4GiB or a number of bytes: a fit that needs more is refused before it
    /// starts, and refinement ends there [default: 9/10 of the available memory]
    #[arg(long, value_name = "SIZE", value_parser = bytes)]
    pub memory: Option<u64>,
    /// Solver of the least-squares system [default: schwarz with the adaptive placement, dense with --free-sources, else
    /// svd]
    #[arg(long, value_enum)]
    pub method: Option<MethodKind>,
    #[arg(
        long,
        help = format!(
            "Dense methods: singular values or pivots below this fraction of the largest count as zero [default: {:e}]",
            DenseOptions::default().truncation
        ),
    )]
    pub truncation: Option<f64>,
    /// Leave the affine functions out of the basis, as in Li et al. 2007
    #[arg(long)]
    pub no_affine: bool,
    /// Do not add sources where the tolerance is missed
    #[arg(long)]
    pub no_refine: bool,
    #[arg(
        long,
        help = format!(
            "Move the sources, from where they are placed to where the residual is least, for maps of few sources: at most \
             {MOST_FREE_SOURCES} (--max-sources). Takes some hundred times as long as with fixed ones, and needs a dense method"
        ),
    )]
    pub free_sources: bool,
    /// Number of held-out boundary points at which the boundary error is measured
    #[arg(long, default_value_t = FitOptions::adaptive().held_out, value_name = "N")]
    pub held_out: usize,
    /// Seed of all random choices
    #[arg(long, default_value_t = FitOptions::adaptive().seed)]
    pub seed: u64,
}

/// How far away the sources are, of which one placement has one.
#[derive(Debug, Args)]
pub struct PlacementArgs {
    #[arg(
        long,
        help = format!(
            "Adaptive placement: distance of the sources from the surface, over their local spacing [default: {}]",
            Placement::DEFAULT_ALPHA
        ),
        conflicts_with_all = ["offset", "radius"],
    )]
    alpha: Option<f64>,
    #[arg(
        long,
        help = format!(
            "Offset placement: distance of the sources, as a fraction of the domain's diagonal [default: {}]",
            Placement::DEFAULT_DISTANCE
        ),
        value_name = "FRACTION",
        conflicts_with = "radius",
    )]
    offset: Option<f64>,
    #[arg(
        long,
        help = format!(
            "Sphere placement: radius, as a fraction of the domain's diagonal [default: {}]",
            Placement::DEFAULT_RADIUS
        ),
        value_name = "FRACTION",
    )]
    radius: Option<f64>,
}

impl PlacementArgs {
    /// The placement asked for, or the one that what is given belongs to, or else the default; and its distance or radius.
    pub fn chosen(&self, asked: Option<PlacementKind>, default: PlacementKind) -> anyhow::Result<(PlacementKind, f64)> {
        let places = [
            ("--alpha", PlacementKind::Adaptive, self.alpha, Placement::DEFAULT_ALPHA),
            (
                "--offset",
                PlacementKind::Offset,
                self.offset,
                Placement::DEFAULT_DISTANCE,
            ),
            (
                "--radius",
                PlacementKind::Sphere,
                self.radius,
                Placement::DEFAULT_RADIUS,
            ),
        ];
        let given = places.iter().find(|(_, _, value, _)| value.is_some());
        let chosen = asked.or(given.map(|place| place.1)).unwrap_or(default);
        if let Some((flag, kind, ..)) = given {
            anyhow::ensure!(
                *kind == chosen,
                "{flag} has no meaning with --placement {}",
                format!("{chosen:?}").to_lowercase()
            );
        }
        let value = given.and_then(|place| place.2);
        let usual = places.iter().find(|place| place.1 == chosen).map(|place| place.3);
        Ok((chosen, value.or(usual).expect("every kind is in the list")))
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum PlacementKind {
    /// Near the surface, as far away as they are apart
    Adaptive,
    /// On an offset surface, as in Li et al. 2007
    Offset,
    /// On a sphere around the domain
    Sphere,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum MethodKind {
    /// Iterations with a Schwarz preconditioner: any number of sources, adaptive placement only
    Schwarz,
    /// QR decomposition of a dense matrix: a few thousand sources
    #[value(alias = "qr")]
    Dense,
    /// Truncated singular value decomposition of a dense matrix, as in Li et al. 2007: slower than QR
    Svd,
}

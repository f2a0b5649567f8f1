//! Arguments of the commands for boundary maps.

use std::path::PathBuf;

use clap::{Args, Subcommand, ValueEnum};

use super::section::UpKind;

#[derive(Debug, Subcommand)]
pub enum BoundaryCommand {
    /// Map the boundary of a solid one to one to that of another
    Pair(BoundaryPairArgs),
    /// Say whether a boundary map is one to one, how well it covers its target, and how far it distorts
    Check(BoundaryCheckArgs),
    /// Map a closed surface of genus 0 to the unit sphere, one to one
    Sphere(BoundarySphereArgs),
}

#[derive(Debug, Args)]
pub struct BoundarySphereArgs {
    /// Boundary of the solid to map, or a tet mesh of it
    pub model: PathBuf,
    /// What is kept
    #[arg(long, value_enum, default_value_t = SphereEnergyKind::Balanced)]
    pub energy: SphereEnergyKind,
    /// Where the optimisation starts
    #[arg(long, value_enum, default_value_t = SphereStartKind::Progressive)]
    pub start: SphereStartKind,
    #[command(flatten)]
    pub outputs: BoundaryOutputs,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum SphereEnergyKind {
    /// Angles, with areas in bounds
    Balanced,
    /// Angles alone: limbs shrink to specks
    Conformal,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum SphereStartKind {
    /// An embedding that grows vertex by vertex and never folds
    Progressive,
    /// The conformalised mean curvature flow, where it neither folds nor shrinks limbs to specks
    Flow,
}

#[derive(Debug, Args)]
pub struct BoundaryPairArgs {
    /// Boundary of the solid to map, or a tet mesh of it; of genus 0
    pub domain: PathBuf,
    /// Boundary of the solid to map to, or a tet mesh of it; of genus 0
    pub target: PathBuf,
    #[command(flatten)]
    pub pair: PairArgs,
    #[command(flatten)]
    pub outputs: BoundaryOutputs,
}

/// How a pair is mapped.
#[derive(Debug, Args)]
pub struct PairArgs {
    /// Vertices of DOMAIN that go to vertices of the target, counted from 0: a file of two columns. Given twice: a file
    /// of one column for DOMAIN, and one for the target
    #[arg(long, value_name = "FILE")]
    pub landmarks: Vec<PathBuf>,
    /// `targets` lays the solids over each other; `conformal` maps both to the sphere and turns one
    #[arg(long, value_enum, default_value_t = ViaKind::Targets)]
    pub via: ViaKind,
    /// Leave the map as it is first found: faster, as a rule with more distortion
    #[arg(long)]
    pub no_improve: bool,
}

impl PairArgs {
    /// Nothing was asked for.
    pub fn is_default(&self) -> bool {
        self.landmarks.is_empty() && self.via == ViaKind::Targets && !self.no_improve
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum ViaKind {
    Targets,
    Conformal,
}

/// What the commands that make boundary maps write.
#[derive(Debug, Args)]
pub struct BoundaryOutputs {
    /// Mesh to write: the boundary that is mapped, with every vertex at its image (.obj, .ply, .off)
    #[arg(short, long, value_name = "IMAGE")]
    pub output: PathBuf,
    /// Also write the map itself, which says where every point goes, for `fit --boundary` (.safetensors)
    #[arg(long, value_name = "FILE")]
    pub boundary: Option<PathBuf>,
    /// Write a picture: both surfaces painted with one pattern, and coloured by distortion
    #[arg(long, value_name = "FILE")]
    pub png: Option<PathBuf>,
    /// Write the surface with images and distortions, for ParaView (.vtu)
    #[arg(long, value_name = "FILE")]
    pub vtu: Option<PathBuf>,
    /// Axis that points up in the picture
    #[arg(long, value_enum, allow_hyphen_values = true, default_value_t = UpKind::Z)]
    pub up: UpKind,
}

#[derive(Debug, Args)]
pub struct BoundaryCheckArgs {
    /// Boundary of the solid being mapped, or a tet mesh of it; a boundary file needs none
    #[arg(value_name = "DOMAIN")]
    pub domain: PathBuf,
    /// DOMAIN's mesh with every vertex at its image, or a boundary file
    #[arg(value_name = "IMAGE|FILE")]
    pub image: Option<PathBuf>,
    /// Surface that the image is to cover [default: that of the boundary file, or the sphere that the image lies on]
    #[arg(long, value_name = "MODEL")]
    pub target: Option<PathBuf>,
    /// Distance that image and target may be apart, as a fraction of the target's diagonal
    #[arg(long, value_name = "FRACTION", default_value_t = 0.01)]
    pub tolerance: f64,
    /// Write a picture: domain and image painted with one pattern, and coloured by distortion
    #[arg(long, value_name = "FILE")]
    pub png: Option<PathBuf>,
    /// Axis that points up in the picture
    #[arg(long, value_enum, allow_hyphen_values = true, default_value_t = UpKind::Z)]
    pub up: UpKind,
    /// Seed of the sample points
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
}

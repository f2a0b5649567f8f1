//! Arguments of the commands for boundary maps.

use std::path::{Path, PathBuf};

use clap::{Args, Subcommand, ValueEnum};
use solidmap::boundary_map::pair::PairOptions;
use solidmap::improve::ImproveOptions;

use super::places::PlacesArgs;
use super::section::{TargetUpArgs, UpKind};
use super::values::{at_least_one, positive, share};
use super::view::PageSizeArgs;

#[derive(Debug, Subcommand)]
pub enum BoundaryCommand {
    /// Map the boundary of a solid one to one to that of another
    Pair(BoundaryPairArgs),
    /// Say whether a boundary map is one to one, how well it covers its target, and how far it distorts
    Check(BoundaryCheckArgs),
    /// Map a closed surface of genus 0 to the unit sphere, one to one
    Sphere(BoundarySphereArgs),
    /// Map a closed surface of genus 1 to a mesh of the torus of revolution that fits it best, one to one
    Torus(BoundaryTorusArgs),
    /// Lay a closed surface with handles out in the plane: in a parallelogram, or a polygon of the hyperbolic disk, whose sides
    /// are glued
    Unfold(BoundaryUnfoldArgs),
    /// Move the images on the target so that the harmonic energy of the inside falls, one to one all the way
    Improve(BoundaryImproveArgs),
}

/// Files that a boundary map is read from. Each command puts --image, --boundary and its alternatives into one group.
#[derive(Debug, Args)]
pub struct BoundaryMapFiles {
    /// Boundary of the solid to map, or a mesh of it by tetrahedra or hexahedra; with --boundary it may be left out
    #[arg(required_unless_present = "boundary")]
    pub domain: Option<PathBuf>,
    /// DOMAIN's mesh with every vertex at its image; or a text (.txt) with a line `node x y z` for every vertex of the
    /// boundary, counted from 0
    #[arg(long, value_name = "IMAGE", requires = "domain")]
    pub image: Option<PathBuf>,
    /// Boundary file, as `boundary pair --boundary` writes it: it says where every point goes, not only the vertices
    #[arg(long, value_name = "FILE")]
    pub boundary: Option<PathBuf>,
}

#[derive(Debug, Args)]
pub struct BoundarySphereArgs {
    /// Boundary of the solid to map, or a mesh of it by tetrahedra or hexahedra
    pub model: PathBuf,
    /// What the map preserves
    #[arg(long, value_enum, default_value_t = SphereEnergyKind::Balanced)]
    pub energy: SphereEnergyKind,
    /// Where the optimisation starts
    #[arg(long, value_enum, default_value_t = SphereStartKind::Progressive)]
    pub start: SphereStartKind,
    #[command(flatten)]
    pub outputs: BoundaryOutputs,
}

#[derive(Debug, Args)]
#[command(
    after_help = "The torus has as many vertices as MODEL, within 1000 and 20 000, and the ratio of its radii is 1.05 at least. It lies \
                  about the z axis, has its centre at the origin, and MODEL's volume."
)]
pub struct BoundaryTorusArgs {
    /// Boundary of the solid to map, or a mesh of it by tetrahedra or hexahedra: with one handle, whose hole is not knotted
    pub model: PathBuf,
    #[command(flatten)]
    pub outputs: BoundaryOutputs,
}

#[derive(Debug, Args)]
#[command(
    after_help = "A surface with one handle is laid out in a parallelogram of area 1, whose first side is a loop that bounds in the \
                  solid; one of g handles in a polygon of 4g sides in Poincaré's disk. Angles are distorted little, as the report says, \
                  and not kept exactly. Triangles across a side are drawn once: they stick out, and may come loose."
)]
pub struct BoundaryUnfoldArgs {
    /// Boundary of a solid with handles, or a mesh of it by tetrahedra or hexahedra
    pub model: PathBuf,
    /// The layout to write (.obj, .ply, .off): the model's triangles in the plane z = 0, cut open where the sides are glued
    #[arg(short, long, value_name = "LAYOUT", required_unless_present_any = ["png", "html"])]
    pub output: Option<PathBuf>,
    /// Write a picture: the model and its layout, painted with one pattern
    #[arg(long, value_name = "FILE")]
    pub png: Option<PathBuf>,
    /// Write a page to look into the layout beside the model (.html)
    #[arg(long, value_name = "PAGE")]
    pub html: Option<PathBuf>,
    #[command(flatten)]
    pub page: PageSizeArgs,
    /// Axis of the model that points up in the picture and the page
    #[arg(long, value_enum, allow_hyphen_values = true, default_value_t = UpKind::Z)]
    pub up: UpKind,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum SphereEnergyKind {
    /// Angles, with the distortion of areas bounded
    Balanced,
    /// Angles alone: limbs shrink to specks
    Conformal,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum SphereStartKind {
    /// A spherical embedding made from coarse to fine, without folds
    Progressive,
    /// The conformalised mean curvature flow; where it folds or shrinks limbs to specks, `progressive`
    Flow,
}

#[derive(Debug, Args)]
pub struct BoundaryPairArgs {
    /// Boundary of the solid to map, or a mesh of it by tetrahedra or hexahedra; of any genus, with any
    /// components and cavities
    pub domain: PathBuf,
    /// Boundary of the solid to map to, or a mesh of it by tetrahedra or hexahedra; of the same genus,
    /// with as many components and cavities
    pub target: PathBuf,
    #[command(flatten)]
    pub pair: PairArgs,
    /// Also write up to this many other maps, where the search found any: IMAGE and --boundary with `.2`, `.3` and so on
    /// before the extension
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub alternatives: usize,
    #[command(flatten)]
    pub outputs: BoundaryOutputs,
}

/// How the boundary map of a pair is made.
#[derive(Debug, Args)]
pub struct PairArgs {
    /// Vertices of DOMAIN that go to vertices of the target, counted from 0: a file of two columns. Given twice: a file
    /// of one column for DOMAIN, and one for the target
    #[arg(long, value_name = "FILE")]
    pub landmarks: Vec<PathBuf>,
    /// Landmarks need not be met exactly: one that is off by a tenth of the root of the target's area costs as much as a mean
    /// distortion that is higher by WEIGHT percent
    #[arg(long, value_name = "WEIGHT", requires = "landmarks", value_parser = positive)]
    pub landmarks_weight: Option<f64>,
    /// Paths along edges that are to go to paths on the target, one in each line: vertices of DOMAIN, `>`, vertices of the
    /// target, counted from 0. Their ends may be landmarks, too
    #[arg(long, value_name = "FILE")]
    pub landmark_curves: Option<PathBuf>,
    /// For solids with handles: loops that are to go to loops on the target, up to a deformation along the surface, one in each line:
    /// vertices of DOMAIN, `>`, vertices of the target, counted from 0; the last one is joined to the first. They decide which
    /// handle goes to which, in which direction, and how often it is twisted. With several handles, give one around
    /// the hole of each, none of which meets itself or another
    #[arg(long, value_name = "FILE")]
    pub loops: Option<PathBuf>,
    /// Which component or cavity of DOMAIN goes to which of the target: in each line two numbers, as `solidmap check` lists them.
    /// Those that are not named find their partners by what they lie in, their handles, place and size
    #[arg(long, value_name = "FILE")]
    pub components: Option<PathBuf>,
    /// Boundary file of the same DOMAIN to start from: it is improved, and nothing else is sought. Components and cavities go
    /// where it takes them
    #[arg(long, value_name = "FILE", conflicts_with = "aligned")]
    pub start: Option<PathBuf>,
    /// Axis of DOMAIN that goes roughly (within 60°) where --target-up says
    #[arg(
        long,
        value_enum,
        allow_hyphen_values = true,
        value_name = "UP",
        requires = "target_up"
    )]
    pub domain_up: Option<UpKind>,
    /// Axis of the target that --domain-up corresponds to; it also points up in pictures of the target [default: that of --up]
    #[arg(long, value_enum, allow_hyphen_values = true, value_name = "UP")]
    pub target_up: Option<UpKind>,
    /// Share of the area of DOMAIN that may be stretched or compressed over 10 times, and of the target four times as much;
    /// above it, the map is written with exit code 1, since a limb is probably in the wrong place
    #[arg(long, value_name = "SHARE", value_parser = share, default_value_t = PairOptions::default().most_stretched)]
    pub max_stretched: f64,
    /// How the surfaces are matched
    #[arg(long, value_enum, default_value_t = ViaKind::Targets)]
    pub via: ViaKind,
    /// The solids lie in the same place, with the same size and pose: do not seek how one is to be turned, moved and scaled.
    /// Faster, and right where they are alike from several sides
    #[arg(long)]
    pub aligned: bool,
    /// Do not lower the distortion of the first map that is found: faster, usually with more distortion
    #[arg(long)]
    pub no_improve: bool,
}

impl PairArgs {
    /// Whether no option was given.
    pub fn is_default(&self) -> bool {
        let Self {
            landmarks,
            landmarks_weight,
            landmark_curves,
            loops,
            components,
            start,
            domain_up,
            target_up,
            max_stretched,
            via,
            aligned,
            no_improve,
        } = self;
        landmarks.is_empty()
            && landmarks_weight.is_none()
            && landmark_curves.is_none()
            && loops.is_none()
            && components.is_none()
            && start.is_none()
            && domain_up.is_none()
            && target_up.is_none()
            && *max_stretched == PairOptions::default().most_stretched
            && *via == ViaKind::Targets
            && !aligned
            && !no_improve
    }

    /// The files it names, by their roles.
    pub fn files_by_role(&self) -> Vec<(&'static str, &Path)> {
        let landmarks = self.landmarks.iter().map(|file| ("landmarks", file.as_path()));
        let curves = self
            .landmark_curves
            .iter()
            .map(|file| ("landmark_curves", file.as_path()));
        let loops = self.loops.iter().map(|file| ("loops", file.as_path()));
        let components = self.components.iter().map(|file| ("components", file.as_path()));
        let start = self.start.iter().map(|file| ("start", file.as_path()));
        let decided = loops.chain(components).chain(start);
        landmarks.chain(curves).chain(decided).collect()
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum ViaKind {
    /// Align the solids, and match their limbs by intrinsic shape; each vertex is pulled towards the point of the target that
    /// corresponds to it
    Targets,
    /// Map both surfaces conformally to the sphere, and rotate one onto the other
    Conformal,
}

/// Outputs of the commands that make boundary maps.
#[derive(Debug, Args)]
pub struct BoundaryOutputs {
    /// Mesh to write: the boundary that is mapped, with every vertex at its image (.obj, .ply, .off)
    #[arg(short, long, value_name = "IMAGE")]
    pub output: PathBuf,
    /// Also write the boundary map itself, which says where every point goes, for `fit --boundary` (.safetensors)
    #[arg(long, value_name = "FILE")]
    pub boundary: Option<PathBuf>,
    /// Write a picture: both surfaces painted with one pattern, and coloured by distortion
    #[arg(long, value_name = "FILE")]
    pub png: Option<PathBuf>,
    /// Write the surface with images and distortion, for ParaView (.vtu)
    #[arg(long, value_name = "FILE")]
    pub vtu: Option<PathBuf>,
    /// Write a page to look into the boundary map, as `view` does (.html)
    #[arg(long, value_name = "PAGE")]
    pub html: Option<PathBuf>,
    #[command(flatten)]
    pub page: PageSizeArgs,
    /// Axis that points up in the picture and the page
    #[arg(long, value_enum, allow_hyphen_values = true, default_value_t = UpKind::Z)]
    pub up: UpKind,
}

#[derive(Debug, Args)]
pub struct BoundaryImproveArgs {
    /// Boundary file, as `boundary pair --boundary` or `boundary sphere --boundary` writes it
    #[arg(value_name = "FILE")]
    pub file: PathBuf,
    /// How much the distortion of the surface, and of each component and cavity, may grow: its symmetric Dirichlet energy, in the
    /// mean and at 99.9 % of the area, over those of FILE
    #[arg(long, value_name = "RATIO", value_parser = at_least_one, default_value_t = ImproveOptions::default().most_distortion)]
    pub max_distortion: f64,
    /// Rounds at most; each fits a harmonic map
    #[arg(long, value_name = "N", default_value_t = ImproveOptions::default().most_rounds)]
    pub rounds: usize,
    /// Boundary error that the fits are to reach (99 % of the area, as a fraction of the target's diagonal)
    #[arg(long, value_name = "FRACTION", value_parser = positive, default_value_t = ImproveOptions::default().fit.tolerance)]
    pub tolerance: f64,
    #[command(flatten)]
    pub outputs: BoundaryOutputs,
}

#[derive(Debug, Args)]
pub struct BoundaryCheckArgs {
    /// Boundary of the solid that is mapped, or a mesh of it by tetrahedra or hexahedra; or a boundary file alone
    #[arg(value_name = "DOMAIN")]
    pub domain: PathBuf,
    /// DOMAIN's mesh with every vertex at its image, or a boundary file
    #[arg(value_name = "IMAGE|FILE")]
    pub image: Option<PathBuf>,
    /// Surface that the image is to cover [default: that of the boundary file, or the sphere that the image lies on]
    #[arg(long, value_name = "MODEL")]
    pub target: Option<PathBuf>,
    /// Largest distance allowed between image and target, as a fraction of the target's diagonal
    #[arg(long, value_name = "FRACTION", default_value_t = 0.01)]
    pub tolerance: f64,
    /// Write a picture: domain and image painted with one pattern, and coloured by distortion
    #[arg(long, value_name = "FILE")]
    pub png: Option<PathBuf>,
    /// Write a page to look into the boundary map, as `view` does (.html)
    #[arg(long, value_name = "PAGE")]
    pub html: Option<PathBuf>,
    #[command(flatten)]
    pub page: PageSizeArgs,
    /// Axis that points up in the picture and the page
    #[arg(long, value_enum, allow_hyphen_values = true, default_value_t = UpKind::Z)]
    pub up: UpKind,
    #[command(flatten)]
    pub target_up: TargetUpArgs,
    /// Seed of the sample points
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    #[command(flatten)]
    pub places: PlacesArgs,
}

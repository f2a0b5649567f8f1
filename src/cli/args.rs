//! What can be typed. Each option's help is its documentation; names are a contract.

use std::path::PathBuf;

use clap::{Args, Parser, Subcommand, ValueEnum};
use solidmap::report::Axis;

fn version() -> &'static str {
    static VERSION: std::sync::OnceLock<String> = std::sync::OnceLock::new();
    VERSION.get_or_init(|| format!("{}\n{}", env!("CARGO_PKG_VERSION"), solidmap::LICENCE))
}

/// Harmonic volumetric maps between solids, by the method of fundamental solutions.
#[derive(Debug, Parser)]
#[command(name = "solidmap", version = version(), after_help = EXIT_CODES)]
pub struct Cli {
    #[command(subcommand)]
    pub command: Command,
    /// Print one machine-readable report on stdout
    #[arg(long, global = true)]
    pub json: bool,
    /// Number of threads [default: all cores]
    #[arg(long, global = true, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub threads: Option<u16>,
    /// End with exit code 2 when it takes longer; nothing is left half-written
    #[arg(long, global = true, value_name = "SECONDS", value_parser = seconds)]
    pub time_limit: Option<f64>,
}

const EXIT_CODES: &str = "\
Exit codes: 0 done; 1 ran, but a check failed (tolerance missed, defects found); 2 could not run;
130 interrupted.

Surfaces are read from .obj .ply .off .stl, and from the boundary of tet meshes .mesh .vtk .vtu.";

#[derive(Debug, Subcommand)]
pub enum Command {
    /// Show the main job on built-in models: maps, energies, carried meshes, pictures
    Demo(DemoArgs),
    /// Say what is wrong with a model, where, and how to mend it
    Check(CheckArgs),
    /// Fill a closed surface with tetrahedra
    Tet(TetArgs),
    /// Make the surface at a distance outside of a model
    Offset(OffsetArgs),
    /// Make maps of boundary surfaces, and look into them
    #[command(subcommand)]
    Boundary(BoundaryCommand),
    /// Fit the harmonic map of a solid to a map of its boundary
    Fit(FitArgs),
    /// Map points, or a mesh's vertices
    Eval(EvalArgs),
    /// Measure a map's harmonic and deformation energy and picture their distribution
    Energy(EnergyArgs),
    /// Prove where a map is locally one to one, and where it folds
    Certify(CertifyArgs),
    /// Carry fields from a map's domain to its target: scalars, vectors, labels, the distance field
    Transfer(TransferArgs),
    /// Carry a regular mesh of a polycube, or a given mesh, into the target, with no cell inverted
    Remesh(RemeshArgs),
    /// Measure how far each frame of a sequence is deformed, where, and in how many cycles
    Sequence(SequenceArgs),
    /// Carry the picture on a surface into the solid: a volume, sections, colours of points
    Texture(TextureArgs),
    /// Send one boundary map through every method and measure all alike
    Compare(CompareArgs),
    #[command(hide = true)]
    CompareWorker(CompareWorkerArgs),
    #[command(hide = true)]
    NativeWorker,
}

#[derive(Debug, Args)]
pub struct DemoArgs {
    /// Folder for the results
    #[arg(long, default_value = "solidmap-demo", value_name = "DIR")]
    pub out: PathBuf,
}

#[derive(Debug, Args)]
pub struct CheckArgs {
    /// Surfaces or tet meshes to look at
    #[arg(required = true)]
    pub models: Vec<PathBuf>,
}

#[derive(Debug, Args)]
#[command(allow_negative_numbers = true)]
pub struct TetArgs {
    /// Closed surface
    pub model: PathBuf,
    /// Tet mesh to write: .mesh, .vtk or .vtu
    #[arg(short, long)]
    pub output: PathBuf,
    /// `tetgen` keeps the boundary triangles; `cgal` (Mesh_3) makes its own
    #[arg(long, value_enum, default_value_t = Mesher::Tetgen)]
    pub mesher: Mesher,
    /// Largest ratio of circumradius to shortest edge; 0 for no refinement inside
    #[arg(long, default_value_t = 1.414, value_name = "RATIO")]
    pub quality: f64,
    /// Largest volume of a tetrahedron, in model units cubed
    #[arg(long, value_name = "VOLUME")]
    pub max_volume: Option<f64>,
    /// Limit on the memory, such as 500MB, 4GiB or a number of bytes: a mesh that needs more by an estimate is refused
    /// before it is made [default: 9/10 of the available memory]
    #[arg(long, value_name = "SIZE", value_parser = bytes)]
    pub memory: Option<u64>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Mesher {
    Tetgen,
    Cgal,
}

#[derive(Debug, Args)]
#[command(allow_negative_numbers = true)]
pub struct OffsetArgs {
    /// Surface to wrap
    pub model: PathBuf,
    /// Distance from the model, in model units
    #[arg(long, value_name = "D")]
    pub distance: f64,
    /// Surface to write
    #[arg(short, long)]
    pub output: PathBuf,
    /// The distance is a fraction of the model's bounding-box diagonal
    #[arg(long)]
    pub relative: bool,
}

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
    /// A drawing that grows vertex by vertex and never folds
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
    #[arg(long, value_name = "FRACTION", default_value_t = 0.001)]
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
    /// Adaptive placement: source distance over local spacing [default: 1]
    #[arg(long, conflicts_with_all = ["offset", "radius", "paper"])]
    pub alpha: Option<f64>,
    /// Offset placement: distance over the domain's diagonal [default: 0.1]
    #[arg(long, value_name = "FRACTION", conflicts_with = "radius")]
    pub offset: Option<f64>,
    /// Sphere placement: radius over the domain's diagonal [default: 1]
    #[arg(long, value_name = "FRACTION")]
    pub radius: Option<f64>,
    /// Sources per boundary vertex [default: 1; offset and sphere: 0.6]
    #[arg(long, value_name = "RATIO")]
    pub s_ratio: Option<f64>,
    /// Collocation points per boundary vertex: up to 1, vertices; 3, vertices and centroids; else spread around the
    /// sources [default: 3; offset and sphere: 1]
    #[arg(long, value_name = "RATIO")]
    pub c_ratio: Option<f64>,
    /// Limit on the sources, also of refinement; larger models get fewer than asked for [default: 2000000; dense: 5000;
    /// svd: 3000]
    #[arg(long, value_name = "N")]
    pub max_sources: Option<usize>,
    /// Limit on the memory, such as 500MB, 4GiB or a number of bytes: a fit that needs more is refused before it starts,
    /// and refinement ends there [default: 9/10 of what is available now]
    #[arg(long, value_name = "SIZE", value_parser = bytes)]
    pub memory: Option<u64>,
    /// How the coefficients are solved for [default: schwarz with the adaptive placement, else svd]
    #[arg(long, value_enum)]
    pub method: Option<MethodKind>,
    /// Dense methods: singular values or pivots below this fraction of the largest are cut off [default: 1e-10]
    #[arg(long)]
    pub truncation: Option<f64>,
    /// Leave the affine functions out of the basis, as the paper does
    #[arg(long)]
    pub no_affine: bool,
    /// Add no sources where the tolerance is missed
    #[arg(long)]
    pub no_refine: bool,
    /// Held-out boundary points that the error is averaged over
    #[arg(long, default_value_t = 20_000, value_name = "N")]
    pub held_out: usize,
    /// Seed of all random choices
    #[arg(long, default_value_t = 1)]
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

/// A number of bytes with an optional unit: KB, MB, GB, TB are powers of 1000; K, KiB and so on of 1024.
fn seconds(text: &str) -> Result<f64, String> {
    let seconds = text.parse().ok().filter(|seconds: &f64| (1e-3..=1e9).contains(seconds));
    seconds.ok_or_else(|| format!("`{text}` is no positive number of seconds"))
}

fn bytes(text: &str) -> Result<u64, String> {
    let wanted = || format!("`{text}` is no size; write it as 4GiB, 500MB or a number of bytes");
    let end = text.trim().find(|c: char| c.is_ascii_alphabetic() || c == ' ');
    let (number, unit) = text.trim().split_at(end.unwrap_or(text.trim().len()));
    let unit = unit.trim().to_lowercase();
    let (prefix, base) = match unit.strip_suffix("ib").or(unit.strip_suffix('b')) {
        _ if unit == "b" => ("", 1),
        Some(prefix) if unit.ends_with("ib") => (prefix, 1024u64),
        Some(prefix) => (prefix, 1000),
        None => (unit.as_str(), 1024),
    };
    let power = ["", "k", "m", "g", "t"].iter().position(|p| *p == prefix);
    let factor = base.pow(power.ok_or_else(wanted)? as u32) as f64;
    let number: f64 = number.parse().map_err(|_| wanted())?;
    if number.is_finite() && number > 0.0 {
        Ok((number * factor) as u64)
    } else {
        Err(wanted())
    }
}

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
#[command(allow_negative_numbers = true)]
pub struct RemeshArgs {
    /// Map file; its domain has to be a polycube, a solid whose faces are all across an axis, unless --mesh is given
    pub map: PathBuf,
    /// Carry this mesh of the domain (tetrahedra or hexahedra; .mesh, .vtk, .vtu) instead of a regular one; tetrahedra with
    /// all corners on the boundary are split
    #[arg(long, value_name = "MESH", conflicts_with_all = ["kind", "cells", "cell_size", "max_cells"])]
    pub mesh: Option<PathBuf>,
    /// Mesh of the target to write (.vtu, .vtk, .mesh, .msh); all have regions and tags of cells that stay inverted, .mesh
    /// and .msh also the boundary in parts, .vtu and .vtk qualities and the nodes' places in the domain
    #[arg(short, long, value_name = "MESH")]
    pub output: PathBuf,
    /// Shape of the cells
    #[arg(long, value_enum, default_value_t = CellShape::Tet)]
    pub kind: CellShape,
    /// Cells along the longest side of the domain; between neighbouring planes an even number of that size
    #[arg(long, default_value_t = 32, value_name = "N", conflicts_with = "cell_size")]
    pub cells: usize,
    /// Size of the cells, in the units of the domain
    #[arg(long, value_name = "LENGTH")]
    pub cell_size: Option<f64>,
    /// Leave the nodes where the map puts them, and cells inverted
    #[arg(long)]
    pub no_repair: bool,
    /// Keep boundary nodes where the boundary map puts them, also where cells stay inverted for that
    #[arg(long)]
    pub fix_boundary: bool,
    /// Iterations to better the shapes when no cell is inverted
    #[arg(long, default_value_t = 200, value_name = "N")]
    pub polish: usize,
    /// Limit on the number of cells
    #[arg(long, default_value_t = 20_000_000, value_name = "N")]
    pub max_cells: usize,
    /// Limit on the memory, such as 500MB, 4GiB or a number of bytes: a mesh that needs more by an estimate is refused
    /// before it is made [default: 9/10 of the available memory]
    #[arg(long, value_name = "SIZE", value_parser = bytes)]
    pub memory: Option<u64>,
    /// Also write the mesh in the domain, cell by cell and node by node the same
    #[arg(long, value_name = "MESH")]
    pub domain_mesh: Option<PathBuf>,
    /// Write a picture: the mesh cut open, as mapped and repaired, and the distribution of det J
    #[arg(long, value_name = "FILE")]
    pub png: Option<PathBuf>,
    /// Axis that points up in the picture
    #[arg(long, value_enum, allow_hyphen_values = true, default_value_t = UpKind::Z)]
    pub up: UpKind,
}

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

#[derive(Debug, Clone, Copy, ValueEnum)]
pub enum CellShape {
    /// Tetrahedra, none of which has all its corners on the boundary
    Tet,
    /// Hexahedra, with a layer of them under the boundary
    Hex,
}

#[derive(Debug, Args)]
#[command(allow_negative_numbers = true, after_help = TEXTURE_HELP)]
pub struct TextureArgs {
    /// Closed surface (.obj with texture coordinates or vertex colours), or a texture file from --map
    pub model: PathBuf,
    /// Picture on the surface (.png, .jpg). Without one, the colours of the model's vertices
    #[arg(long, value_name = "PICTURE")]
    pub image: Option<PathBuf>,
    /// Instead of a picture, a checker of N squares along each side of it (16 where N is left out)
    #[arg(long, value_name = "N", num_args = 0..=1, default_missing_value = "16", conflicts_with = "image")]
    pub checker: Option<usize>,
    /// What is beyond the edges of the picture or the checker [default: repeat]
    #[arg(long, value_enum)]
    pub wrap: Option<WrapKind>,
    #[command(flatten)]
    pub extension: TextureExtensionArgs,
    #[command(flatten)]
    pub written: TextureOutputArgs,
}

/// How colours are extended.
#[derive(Debug, Args)]
#[command(next_help_heading = "Extension")]
pub struct TextureExtensionArgs {
    /// Extend the texture coordinates and look the picture up inside, instead of extending colours: for coordinates that
    /// do not jump anywhere
    #[arg(long)]
    pub uv: bool,
    /// With --uv, extend coordinates that jump at seams all the same
    #[arg(long, requires = "uv")]
    pub across_seams: bool,
    /// Sources at least, no more than --max-sources; triangles are cut into four until there are as many vertices [default:
    /// 2000, or --max-sources where that is less]
    #[arg(long, value_name = "N")]
    pub sources: Option<usize>,
    /// Add sources until the harmonic part alone meets 99 % of the surface to this, a fraction of the diagonal of the colour
    /// cube, or with --uv of the box of the texture coordinates
    #[arg(long, value_name = "FRACTION")]
    pub tolerance: Option<f64>,
    /// Sources at most [default: 100000]
    #[arg(long, value_name = "N")]
    pub max_sources: Option<usize>,
}

/// What a texture is written to.
#[derive(Debug, Args)]
#[command(next_help_heading = "Output (at least one)")]
pub struct TextureOutputArgs {
    /// Volume of colours, for ParaView (.vti)
    #[arg(short, long, value_name = "VOLUME")]
    pub output: Option<PathBuf>,
    /// Voxels along the longest side of the model
    #[arg(long, default_value_t = 128, value_name = "N")]
    pub resolution: usize,
    /// Picture of the model cut open, and of sections across x, y and z (.png)
    #[arg(long, value_name = "PNG")]
    pub png: Option<PathBuf>,
    /// Place of the sections, from 0 to 1 along each axis through the model's box
    #[arg(long, default_value_t = 0.5, value_name = "FRACTION")]
    pub position: f64,
    /// Axis that points up in the picture
    #[arg(long, value_enum, default_value_t = AxisKind::Z)]
    pub up: AxisKind,
    /// Texture file (safetensors), to be sampled again
    #[arg(long, value_name = "FILE")]
    pub map: Option<PathBuf>,
    /// Points to colour: .csv with columns x, y, z; .npy (n × 3); or a mesh, which stands for its vertices
    #[arg(long, value_name = "POINTS", requires = "colours")]
    pub at: Option<PathBuf>,
    /// Their colours: .csv, .npy, .ply or .vtu
    #[arg(long, value_name = "FILE", requires = "at")]
    pub colours: Option<PathBuf>,
}

const TRANSFER_HELP: &str = "\
Points of FIELD outside the domain are carried, counted and warned of: the map means nothing there. References of .mesh \
files are not carried. Fields of one name are refused.

Exit code 1 when --at asks for points of the target that have no preimage, or where the map folds; 2 when nothing could be \
done, and then nothing is written.";

const TEXTURE_HELP: &str = "\
Colours are extended as amounts of light: inside they are the averages that light of them would have. On the surface the \
texture is the picture, exactly; a layer as thick as the sources are apart carries what is too fine for them.

Exit code 1 when --tolerance is missed, or when the texture misses the picture on the surface.";

/// What is beyond the edges of a picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum WrapKind {
    /// The same picture again
    Repeat,
    /// The colour of the nearest edge
    Clamp,
}

#[derive(Debug, Args)]
#[command(allow_negative_numbers = true)]
pub struct SequenceArgs {
    /// Boundary of the solid that the frames are held against, or a tet mesh of it
    #[arg(value_name = "REF")]
    pub reference: PathBuf,
    /// REF's mesh with its vertices where they are in each frame, in the order of time
    #[arg(required = true, value_name = "FRAME")]
    pub frames: Vec<PathBuf>,
    /// Folder for the chart, the table, pictures, and series for ParaView. Those of an earlier run are replaced when all new
    /// ones are complete; files in `cells`, `surface` and `material` that it has not made are never touched
    #[arg(short, long, value_name = "DIR")]
    pub output: PathBuf,
    /// Boundary error to reach over 99 % of the area, as a fraction of each frame's diagonal. Sources are added where it is
    /// larger; frames where it cannot be reached are measured all the same, and the exit code is 1
    #[arg(long, value_name = "FRACTION", default_value_t = 0.001)]
    pub tolerance: f64,
    /// Cells of the integration grid along the longest side of REF, the same for all frames
    #[arg(long, default_value_t = 48, value_name = "N")]
    pub resolution: usize,
    /// Lamé constants of the deformation energy
    #[arg(long, num_args = 2, value_names = ["LAMBDA", "MU"], default_values_t = [0.0335, 0.0224])]
    pub lame: Vec<f64>,
    /// Scale each frame to REF's volume first, as the paper does: change of size has no energy then
    #[arg(long)]
    pub own_volume: bool,
    /// Close holes and slits of REF of up to so many edges (1000 at most), by triangles over their rims, in all frames alike
    #[arg(long, value_name = "EDGES", num_args = 0..=1, default_missing_value = "64", require_equals = true)]
    pub mend: Option<usize>,
    /// Mesh with fields in REF (`.vtu`, `.vtk`), carried by the map of every frame to `material.pvd`: vectors turn and stretch
    /// with the solid, everything else keeps its values. See `solidmap transfer`
    #[arg(long, value_name = "FIELD")]
    pub material: Option<PathBuf>,
    /// Frames in a second, for the times in the chart, the table and ParaView [default: times count frames]
    #[arg(long, default_value_t = 1.0, hide_default_value = true, value_name = "N")]
    pub fps: f64,
    /// Frames that are solved for at once [default: 32, fewer where memory is short]
    #[arg(long, value_name = "N")]
    pub frames_per_block: Option<usize>,
    /// Frames to picture on the cross-section, counted from 0, beside the mean and the one of most energy
    #[arg(long, value_name = "FRAME", value_delimiter = ',')]
    pub show: Vec<usize>,
    /// Leave out the series of energies for ParaView
    #[arg(long)]
    pub no_vtu: bool,
    #[command(flatten)]
    pub section: SectionArgs,
    #[command(flatten)]
    pub method: MethodArgs,
}

#[derive(Debug, Args)]
#[command(allow_negative_numbers = true)]
pub struct CompareArgs {
    /// Boundary of the solid to map, or a tet mesh of it; with --boundary it may be left out
    #[arg(required_unless_present = "boundary")]
    pub domain: Option<PathBuf>,
    /// DOMAIN's mesh with every vertex at its image
    #[arg(
        long,
        value_name = "IMAGE",
        requires = "domain",
        required_unless_present = "boundary"
    )]
    pub image: Option<PathBuf>,
    /// Boundary map that says where every point goes, not vertices alone
    #[arg(long, value_name = "FILE", conflicts_with = "image")]
    pub boundary: Option<PathBuf>,
    /// Methods to compare
    #[arg(long, value_enum, value_delimiter = ',', default_values_t = [MapMethod::Mfs, MapMethod::Fem, MapMethod::Variational, MapMethod::MeanValue])]
    pub methods: Vec<MapMethod>,
    /// Folder for tables, pictures and the maps themselves
    #[arg(short, long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Refine the finite elements until they are as near to the reference inside as mfs is
    #[arg(long)]
    pub equal_accuracy: bool,
    /// Also solve on four tet meshes (three qualities of TetGen, and Mesh_3), and with four source distances of mfs:
    /// how much does each method's result depend on what it should not depend on?
    #[arg(long)]
    pub mesh_study: bool,
    /// Images of DOMAIN as the frames of a sequence: what does each frame cost?
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
    /// Edge length inside, over the domain's diagonal [default: twice the mean edge of the surface]
    #[arg(long, value_name = "FRACTION")]
    pub mesh_size: Option<f64>,
    /// Largest ratio of circumradius to shortest edge
    #[arg(long, default_value_t = 1.414, value_name = "RATIO")]
    pub quality: f64,
    /// `tetgen` keeps the boundary triangles; `cgal` (Mesh_3) makes its own
    #[arg(long, value_enum, default_value_t = Mesher::Tetgen)]
    pub mesher: Mesher,
    /// A tet mesh of the domain to take instead
    #[arg(long, value_name = "TETS", conflicts_with_all = ["mesh_size", "equal_accuracy", "mesh_study"])]
    pub mesh: Option<PathBuf>,
}

/// How maps are made and measured.
#[derive(Debug, Args)]
#[command(next_help_heading = "Measuring")]
pub struct CompareMeasure {
    /// Boundary error that mfs aims at over 99 % of the area, as a fraction of the target's diagonal
    #[arg(long, value_name = "FRACTION", default_value_t = 0.001)]
    pub tolerance: f64,
    /// Cells of the integration grid along the longest side of the domain
    #[arg(long, default_value_t = 40, value_name = "N")]
    pub resolution: usize,
    /// Points inside at which maps are held against the reference
    #[arg(long, default_value_t = 5000, value_name = "N")]
    pub interior: usize,
    /// The variational method ends with the step that lowers the energy by less than this part of it
    #[arg(long, default_value_t = 1e-6, value_name = "FRACTION")]
    pub threshold: f64,
    /// Leave the reference out, and the differences to it
    #[arg(long, conflicts_with = "equal_accuracy")]
    pub no_reference: bool,
    /// Seed of all random choices
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    #[command(flatten)]
    pub section: SectionArgs,
}

/// What each map may cost.
#[derive(Debug, Args)]
#[command(next_help_heading = "Budget of each map")]
pub struct CompareBudget {
    /// Seconds, with measuring
    #[arg(long, default_value_t = 600.0, value_name = "SECONDS", value_parser = seconds)]
    pub time_limit: f64,
    /// Tetrahedra, by an estimate
    #[arg(long, default_value_t = 5_000_000, value_name = "N")]
    pub max_tets: usize,
    /// Memory of mfs, such as 500MB or 4GiB [default: 9/10 of what is available now]
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
    /// Linear finite elements on tets, factored
    Fem,
    /// The same energy by steepest descent, as Wang et al. 2004
    Variational,
    /// Mean value coordinates, which are not harmonic
    #[value(name = "mean_value", alias = "mean-value")]
    MeanValue,
}

impl From<MapMethod> for solidmap::compare::Method {
    fn from(method: MapMethod) -> Self {
        match method {
            MapMethod::Mfs => Self::Mfs,
            MapMethod::Fem => Self::Fem,
            MapMethod::Variational => Self::Variational,
            MapMethod::MeanValue => Self::MeanValue,
        }
    }
}

/// Where pictures cut the domain.
#[derive(Debug, Args)]
pub struct SectionArgs {
    /// Axis that the cross-section is perpendicular to [default: z; for `sequence` that of the largest cross-section]
    #[arg(long, value_enum)]
    pub axis: Option<AxisKind>,
    /// Axis that points up in pictures
    #[arg(long, value_enum, default_value_t = AxisKind::Z)]
    pub up: AxisKind,
    /// Place of the cross-section, from 0 to 1 along the axis through the domain's box
    #[arg(long, default_value_t = 0.5, value_name = "FRACTION")]
    pub position: f64,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum AxisKind {
    X,
    Y,
    Z,
}

/// The direction that points up in a picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum UpKind {
    X,
    Y,
    Z,
    #[value(name = "-x")]
    MinusX,
    #[value(name = "-y")]
    MinusY,
    #[value(name = "-z")]
    MinusZ,
}

impl UpKind {
    /// The axis, and whether it points down.
    pub fn axis(self) -> (Axis, bool) {
        match self {
            Self::X => (Axis::X, false),
            Self::Y => (Axis::Y, false),
            Self::Z => (Axis::Z, false),
            Self::MinusX => (Axis::X, true),
            Self::MinusY => (Axis::Y, true),
            Self::MinusZ => (Axis::Z, true),
        }
    }
}

impl From<AxisKind> for Axis {
    fn from(kind: AxisKind) -> Self {
        match kind {
            AxisKind::X => Self::X,
            AxisKind::Y => Self::Y,
            AxisKind::Z => Self::Z,
        }
    }
}

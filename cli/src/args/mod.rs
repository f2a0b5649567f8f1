//! The arguments of the program. Their help texts are their documentation; their names must not change.

mod bijective;
mod boundary;
mod cgal_tetgen;
mod compare;
mod fit;
mod hexmesh;
mod map;
mod places;
mod polycube;
mod remesh;
mod section;
mod sequence;
mod study;
mod texture;
mod transfer;
mod values;
mod view;

use std::path::PathBuf;

use clap::{Args, Parser, Subcommand};

pub use bijective::{BijectiveArgs, MapChoice, MapKind};
pub use boundary::{
    BoundaryCheckArgs, BoundaryCommand, BoundaryImproveArgs, BoundaryMapFiles, BoundaryOutputs, BoundaryPairArgs,
    BoundarySphereArgs, BoundaryTorusArgs, BoundaryUnfoldArgs, PairArgs, SphereEnergyKind, SphereStartKind, ViaKind,
};
pub use cgal_tetgen::{Mesher, OffsetArgs, TetArgs};
pub use compare::{CompareArgs, CompareWorkerArgs, MapMethod};
pub use fit::{FitArgs, MethodArgs, MethodKind, PlacementKind};
pub use hexmesh::HexmeshArgs;
pub use map::{CertifyArgs, EnergyArgs, EvalArgs};
pub use polycube::PolycubeArgs;
pub use remesh::{RemeshArgs, RepairArgs};
pub use section::{ColoursKind, SectionArgs, UpKind};
pub use sequence::SequenceArgs;
pub use study::{
    DecompositionKind, StudyBoundaryArgs, StudyCommand, StudyOutputs, StudyPlacementArgs, StudyRatiosArgs, StudySource,
    StudySystemArgs,
};
pub use texture::{TextureArgs, TextureOutputArgs, WrapKind};
pub use transfer::TransferArgs;
pub use view::{PageArgs, PageSizeArgs, ViewArgs};

use values::seconds;

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
    /// Print the report as JSON on stdout
    #[arg(long, global = true)]
    pub json: bool,
    /// Number of threads; more than eight per core are not used [default: one per core]
    #[arg(long, global = true, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub threads: Option<u16>,
    /// Stop with exit code 2 when the command takes longer than this; no file is left half-written. `fit`, `boundary pair`,
    /// `boundary sphere`, `boundary torus` and `boundary improve` write the best result so far instead, with exit code 1, if there is one
    /// [default: none]
    #[arg(long, global = true, value_name = "SECONDS", value_parser = seconds)]
    pub time_limit: Option<f64>,
}

const EXIT_CODES: &str = "\
Exit codes: 0 done; 1 ran, but a check failed (tolerance missed, defects found); 2 could not run;
130 interrupted.

Surfaces are read from .obj .ply .off .stl, and from the boundary of tet and hex meshes .mesh .msh .vtk .vtu.";

#[derive(Debug, Subcommand)]
pub enum Command {
    /// Map built-in models, and write maps, energies, carried meshes and pictures
    Demo(DemoArgs),
    /// Say what is wrong with a model, where, and how to repair it
    Check(CheckArgs),
    /// Fill a closed surface with tetrahedra
    Tet(TetArgs),
    /// Make a closed surface around a model, at a given distance
    Offset(OffsetArgs),
    /// Make boundary maps, and check them
    #[command(subcommand)]
    Boundary(BoundaryCommand),
    /// Fit the harmonic map of a solid to a map of its boundary
    Fit(FitArgs),
    /// Map points or the vertices of a mesh, or find their preimages
    Eval(EvalArgs),
    /// Measure the harmonic and deformation energy of a map, and picture their densities
    Energy(EnergyArgs),
    /// Prove where a map is locally one to one, and where it folds
    Certify(CertifyArgs),
    /// Write a page to look into a map, a mesh or a boundary map: turn it, cut it, colour it
    View(ViewArgs),
    /// Add to a map file the one-to-one map that is linear over tetrahedra
    Bijective(BijectiveArgs),
    /// Carry fields from a map's domain to its target: scalars, vectors, labels, the distance field
    Transfer(TransferArgs),
    /// Make a polycube of a model, with the map from its boundary to the model's, for `fit` and `remesh`
    Polycube(PolycubeArgs),
    /// Mesh a model with hexahedra: its polycube, the map from it, and the polycube's cells in the model
    Hexmesh(HexmeshArgs),
    /// Carry a regular mesh of a polycube, or a given mesh, into the target, and repair inverted cells
    Remesh(RemeshArgs),
    /// Measure how far each frame of an animation is deformed, and where, and count the cycles
    Sequence(SequenceArgs),
    /// Extend the colours of a surface into the solid: a volume, sections, colours of points
    Texture(TextureArgs),
    /// Extend one boundary map by several methods, and measure all maps alike
    Compare(CompareArgs),
    /// The experiments of Li et al. 2007 on a pair of your own: how errors, energies and conditioning depend on sources,
    /// collocation points and the boundary map
    #[command(subcommand)]
    Study(StudyCommand),
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
    /// Axis that points up in pictures
    #[arg(long, value_enum, allow_hyphen_values = true, default_value_t = UpKind::Z)]
    pub up: UpKind,
}

#[derive(Debug, Args)]
pub struct CheckArgs {
    /// Surfaces, or meshes of tetrahedra or hexahedra, whose cells are examined too. The exit code is 1 if anything is
    /// wrong with a surface, or if cells are inverted, flat, or do not fit together
    #[arg(required = true)]
    pub models: Vec<PathBuf>,
}

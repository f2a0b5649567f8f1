//! Arguments of the commands that make meshes and surfaces by CGAL and TetGen.

use std::path::PathBuf;

use clap::{Args, ValueEnum};

use super::values::bytes;

#[derive(Debug, Args)]
#[command(allow_negative_numbers = true)]
pub struct TetArgs {
    /// Closed surface to fill
    pub model: PathBuf,
    /// Tet mesh to write: .mesh, .vtk or .vtu
    #[arg(short, long)]
    pub output: PathBuf,
    /// Program that makes the tetrahedra
    #[arg(long, value_enum, default_value_t = Mesher::Tetgen)]
    pub mesher: Mesher,
    /// TetGen: largest ratio of circumradius to shortest edge; 0 for no refinement inside
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
    /// TetGen, which keeps the boundary triangles
    Tetgen,
    /// CGAL's Mesh_3, which makes boundary triangles of its own
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
    /// Surface to write: .obj, .ply, .off, .stl, .mesh, .msh, .vtk or .vtu
    #[arg(short, long)]
    pub output: PathBuf,
    /// Take --distance as a fraction of the diagonal of the model's bounding box
    #[arg(long)]
    pub relative: bool,
}

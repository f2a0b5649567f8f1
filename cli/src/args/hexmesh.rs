//! Arguments of `hexmesh`.

use std::path::PathBuf;

use clap::Args;
use solidmap::hexmesh::{MAX_DISTANCE, TOLERANCE};
use solidmap::model_polycube::MOST_VERTICES;
use solidmap::remesh::RemeshOptions;

use super::places::PlacesArgs;
use super::polycube::{OrientArgs, PolycubeChoice, SmoothnessArgs};
use super::remesh::{CellShape, RepairArgs};
use super::section::UpKind;
use super::view::PageSizeArgs;

#[derive(Debug, Args)]
#[command(
    allow_negative_numbers = true,
    after_help = "In one go what `polycube`, `fit` and `remesh` do: a polycube of the model with its faces on a lattice, the harmonic map\n\
                  from it to the model, and the cells of the lattice carried by the map and repaired.\n\
                  The exit code is 1 if no polycube was found, which leaves no file, or if cells stay inverted, the boundary of the\n\
                  mesh passes through itself, or it misses a part of the model; the mesh is written then, with what is wrong marked."
)]
pub struct HexmeshArgs {
    /// Closed surface, or a mesh of tetrahedra (.mesh, .msh, .vtk, .vtu), which is used as it is. Any genus
    pub model: PathBuf,
    /// Mesh to write (.msh, .mesh, .vtu, .vtk); see `remesh`
    #[arg(short, long, value_name = "MESH")]
    pub output: PathBuf,
    /// Shape of the cells
    #[arg(long, value_enum, default_value_t = CellShape::Hex)]
    pub kind: CellShape,
    /// Cells along the longest side of the polycube
    #[arg(long, default_value_t = 32, value_name = "N", conflicts_with = "cell_size")]
    pub cells: usize,
    /// Size of the cells in the polycube, which is about as large as the model
    #[arg(long, value_name = "LENGTH")]
    pub cell_size: Option<f64>,
    /// Folder for what leads to the mesh: polycube.obj and model.obj, as `fit` takes them, their tetrahedra
    /// polycube_tets.vtu and model_tets.vtu (not of voxels), the map map.safetensors, and the cells in the polycube, domain.vtu
    #[arg(long, value_name = "DIR")]
    pub keep: Option<PathBuf>,
    /// Where the polycube comes from
    #[arg(long, value_enum, default_value_t = PolycubeChoice::Auto)]
    pub polycube: PolycubeChoice,
    #[command(flatten)]
    pub smoothness: SmoothnessArgs,
    #[command(flatten)]
    pub orient: OrientArgs,
    /// Boundary error of the map over 99 % of the area, as a fraction of the model's diagonal
    #[arg(long, value_name = "FRACTION", default_value_t = TOLERANCE)]
    pub tolerance: f64,
    /// Iterations at most of each descent that improves the shapes of cells. They never lower the least scaled Jacobian, nor
    /// its 1 % quantile
    #[arg(long, value_name = "N", default_value_t = RemeshOptions::default().polish)]
    pub polish: usize,
    /// Farthest that the model may be from the mesh, or the mesh's boundary from the model, as a fraction of the model's diagonal;
    /// beyond it the exit code is 1
    #[arg(long, value_name = "FRACTION", default_value_t = MAX_DISTANCE)]
    pub max_distance: f64,
    /// Largest surface that is deformed as it is; one with handles or long sharp edges may have 2.5 times as many vertices. Larger ones
    /// are simplified, and their polycube's boundary is mapped to the model's own
    #[arg(long, value_name = "VERTICES", default_value_t = MOST_VERTICES)]
    pub max_vertices: usize,
    #[command(flatten)]
    pub repair: RepairArgs,
    /// Write a picture: the mesh cut open, in the polycube, as mapped and repaired, and the distribution of det J
    #[arg(long, value_name = "FILE")]
    pub png: Option<PathBuf>,
    /// Write a page to look into the mesh, as `view` does (.html)
    #[arg(long, value_name = "PAGE")]
    pub html: Option<PathBuf>,
    #[command(flatten)]
    pub page: PageSizeArgs,
    /// Axis that points up in the picture and the page
    #[arg(long, value_enum, allow_hyphen_values = true, default_value_t = UpKind::Z)]
    pub up: UpKind,
    #[command(flatten)]
    pub places: PlacesArgs,
}

//! Arguments of `remesh`.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use solidmap::remesh::{CellKind, DEFAULT_EFFORT};

use super::places::PlacesArgs;
use super::section::{TargetUpArgs, UpKind};
use super::values::{bytes, effort, off_or_count};
use super::view::PageSizeArgs;

#[derive(Debug, Args)]
#[command(allow_negative_numbers = true)]
pub struct RemeshArgs {
    /// Map file. Without --mesh its domain has to be a polycube: a solid whose faces are perpendicular to the axes
    pub map: PathBuf,
    /// Mesh of the domain to carry instead of a regular one: tetrahedra or hexahedra (.mesh, .msh, .vtk, .vtu)
    #[arg(long, value_name = "MESH", conflicts_with_all = ["kind", "cells", "cell_size", "max_cells"])]
    pub mesh: Option<PathBuf>,
    /// Mesh of the target to write (.vtu, .vtk, .mesh, .msh). All formats have regions, and mark cells that stay
    /// inverted; .mesh and .msh also have the boundary in parts, .vtu and .vtk the quality of cells and the nodes in
    /// the domain
    #[arg(short, long, value_name = "MESH")]
    pub output: PathBuf,
    /// Shape of the cells
    #[arg(long, value_enum, default_value_t = CellShape::Tet)]
    pub kind: CellShape,
    /// Cells along the longest side of the domain; between neighbouring planes of faces, their number is rounded up,
    /// for tetrahedra to an even one
    #[arg(long, default_value_t = 32, value_name = "N", conflicts_with = "cell_size")]
    pub cells: usize,
    /// Size of the cells, in the units of the domain
    #[arg(long, value_name = "LENGTH")]
    pub cell_size: Option<f64>,
    /// Stay on the map's boundary map. Otherwise, where a regular mesh cannot be repaired under it, one of less distortion is
    /// sought, as by `boundary pair`, and taken with a warning if the mesh is better under it
    #[arg(long, conflicts_with = "mesh")]
    pub keep_boundary_map: bool,
    /// Leave all nodes where the map puts them, and cells inverted
    #[arg(long)]
    pub no_repair: bool,
    /// Iterations at most of each descent that improves the shapes of cells once none is inverted. They never lower the
    /// least scaled Jacobian, nor its 1 % quantile. Given here, a mesh is polished too that needs no repair [default: 200
    /// after a repair]
    #[arg(long, value_name = "N")]
    pub polish: Option<usize>,
    #[command(flatten)]
    pub repair: RepairArgs,
    /// Also write the mesh of the domain, with the same cells and nodes in the same order
    #[arg(long, value_name = "MESH")]
    pub domain_mesh: Option<PathBuf>,
    /// Write a picture: the mesh cut open, as mapped and repaired, and the distribution of det J
    #[arg(long, value_name = "FILE")]
    pub png: Option<PathBuf>,
    /// Write a page to look into the mesh that is written, as `view` does (.html)
    #[arg(long, value_name = "PAGE")]
    pub html: Option<PathBuf>,
    #[command(flatten)]
    pub page: PageSizeArgs,
    /// Axis that points up in the picture and the page
    #[arg(long, value_enum, allow_hyphen_values = true, default_value_t = UpKind::Z)]
    pub up: UpKind,
    #[command(flatten)]
    pub target_up: TargetUpArgs,
    #[command(flatten)]
    pub places: PlacesArgs,
}

/// How cells are repaired, and what that may cost.
#[derive(Debug, Args)]
pub struct RepairArgs {
    /// Leave boundary nodes where the boundary map puts them, and the boundary unsplit, even if cells stay inverted
    #[arg(long)]
    pub fix_boundary: bool,
    /// Cells at most that are added where nodes are stuck, or where the boundary of a regular mesh passes through itself:
    /// there edges are split, in domain and target alike. For tetrahedra only; `off` never splits [default: a third of the
    /// mesh's cells, and 5000]
    #[arg(long, value_name = "off|N", value_parser = off_or_count)]
    pub split_stuck: Option<usize>,
    /// Work after which the repair ends although cells stay inverted: iterations for each cell in the mean
    #[arg(long, value_name = "N", default_value_t = DEFAULT_EFFORT, value_parser = effort)]
    pub effort: f64,
    /// Largest number of cells
    #[arg(long, default_value_t = 20_000_000, value_name = "N")]
    pub max_cells: usize,
    /// Limit on the memory, such as 500MB, 4GiB or a number of bytes: a mesh that needs more by an estimate is refused
    /// before it is made [default: 9/10 of the available memory]
    #[arg(long, value_name = "SIZE", value_parser = bytes)]
    pub memory: Option<u64>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum CellShape {
    /// Tetrahedra, none of which has all its corners on the boundary
    Tet,
    /// Hexahedra, with a layer of them under the faces of the polycube where that makes angles better
    Hex,
}

impl From<CellShape> for CellKind {
    fn from(shape: CellShape) -> Self {
        match shape {
            CellShape::Tet => Self::Tets,
            CellShape::Hex => Self::Hexes,
        }
    }
}

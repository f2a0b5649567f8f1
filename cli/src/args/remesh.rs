//! Arguments of `remesh`.

use std::path::PathBuf;

use clap::{Args, ValueEnum};

use super::section::UpKind;
use super::values::bytes;

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

#[derive(Debug, Clone, Copy, ValueEnum)]
pub enum CellShape {
    /// Tetrahedra, none of which has all its corners on the boundary
    Tet,
    /// Hexahedra, with a layer of them under the boundary
    Hex,
}

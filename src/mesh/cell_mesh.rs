use super::surface_mesh::{MeshError, check_counts};
use crate::Point;

/// Cells of one kind.
#[derive(Debug, Clone, PartialEq)]
pub enum CellList {
    /// Tetrahedra; right-handed ones `[a, b, c, d]` have `det(b-a, c-a, d-a) > 0`.
    Tets(Vec<[u32; 4]>),
    /// Hexahedra: four corners around the bottom, counter-clockwise seen from above, then the four over them.
    Hexes(Vec<[u32; 8]>),
}

/// Steps along x, y and z from the first corner of an upright hexahedron to each, in the order of [`CellList::Hexes`].
pub const HEXAHEDRON: [[u8; 3]; 8] = [
    [0, 0, 0],
    [1, 0, 0],
    [1, 1, 0],
    [0, 1, 0],
    [0, 0, 1],
    [1, 0, 1],
    [1, 1, 1],
    [0, 1, 1],
];

/// Faces of a right-handed tetrahedron, counter-clockwise seen from outside.
pub(crate) const TET_FACES: [[usize; 3]; 4] = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]];

impl CellList {
    /// Number of cells.
    pub fn len(&self) -> usize {
        match self {
            Self::Tets(cells) => cells.len(),
            Self::Hexes(cells) => cells.len(),
        }
    }

    /// The corners of each cell.
    pub fn iter(&self) -> impl Iterator<Item = &[u32]> {
        let (flat, corners) = match self {
            Self::Tets(cells) => (cells.as_flattened(), 4),
            Self::Hexes(cells) => (cells.as_flattened(), 8),
        };
        flat.chunks_exact(corners)
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// A mesh of a solid by cells, each in a region.
#[derive(Debug, Clone, PartialEq)]
pub struct CellMesh {
    nodes: Vec<Point>,
    cells: CellList,
    regions: Vec<i32>,
}

impl CellMesh {
    /// A mesh of these nodes and cells (0-based), with the region that every cell belongs to.
    ///
    /// # Errors
    ///
    /// As [`super::SurfaceMesh::new`]; [`MeshError::RegionCount`] unless there is one region per cell.
    pub fn new(nodes: Vec<Point>, cells: CellList, regions: Vec<i32>) -> Result<Self, MeshError> {
        match &cells {
            CellList::Tets(tets) => check_counts(nodes.len(), "tetrahedron", tets)?,
            CellList::Hexes(hexes) => check_counts(nodes.len(), "hexahedron", hexes)?,
        }
        if regions.len() != cells.len() {
            return Err(MeshError::RegionCount {
                cells: cells.len(),
                regions: regions.len(),
            });
        }
        Ok(Self { nodes, cells, regions })
    }

    /// Positions of the nodes.
    pub fn nodes(&self) -> &[Point] {
        &self.nodes
    }

    /// The cells.
    pub fn cells(&self) -> &CellList {
        &self.cells
    }

    /// The region of every cell.
    pub fn regions(&self) -> &[i32] {
        &self.regions
    }

    /// Nodes, cells and regions.
    pub fn into_parts(self) -> (Vec<Point>, CellList, Vec<i32>) {
        (self.nodes, self.cells, self.regions)
    }
}

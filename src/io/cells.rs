//! Cells of one kind, for writing.

use crate::mesh::CellList;

/// Cells of one kind, by their 0-based corners.
#[derive(Debug, Clone, Copy)]
pub enum Cells<'a> {
    /// Triangles, counter-clockwise seen from outside.
    Triangles(&'a [[u32; 3]]),
    /// Quadrilaterals, counter-clockwise seen from outside.
    Quads(&'a [[u32; 4]]),
    /// Tetrahedra, of either orientation.
    Tets(&'a [[u32; 4]]),
    /// Hexahedra: four corners around the bottom, counter-clockwise seen from above, then the four over them.
    Hexes(&'a [[u32; 8]]),
}

impl<'a> From<&'a CellList> for Cells<'a> {
    fn from(cells: &'a CellList) -> Self {
        match cells {
            CellList::Tets(cells) => Self::Tets(cells),
            CellList::Hexes(cells) => Self::Hexes(cells),
        }
    }
}

/// Cells of one kind, with labels.
#[derive(Debug, Clone, Copy)]
pub struct CellGroup<'a> {
    /// The cells.
    pub cells: Cells<'a>,
    /// A label for each cell.
    pub labels: &'a [i32],
    /// Names of labels, for formats that have them.
    pub names: &'a [(i32, String)],
}

impl<'a> Cells<'a> {
    /// Number of cells.
    pub fn count(self) -> usize {
        self.flat().len() / self.corners()
    }

    /// The corners of each cell.
    pub fn iter(self) -> impl Iterator<Item = &'a [u32]> {
        self.flat().chunks_exact(self.corners())
    }

    /// Number of corners of a cell.
    pub(super) fn corners(self) -> usize {
        match self {
            Self::Triangles(_) => 3,
            Self::Quads(_) | Self::Tets(_) => 4,
            Self::Hexes(_) => 8,
        }
    }

    /// The corners of all cells, concatenated.
    pub(super) fn flat(self) -> &'a [u32] {
        match self {
            Self::Triangles(cells) => cells.as_flattened(),
            Self::Quads(cells) | Self::Tets(cells) => cells.as_flattened(),
            Self::Hexes(cells) => cells.as_flattened(),
        }
    }

    /// The cell's name, in the singular.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Triangles(_) => "triangle",
            Self::Quads(_) => "quadrilateral",
            Self::Tets(_) => "tetrahedron",
            Self::Hexes(_) => "hexahedron",
        }
    }
}

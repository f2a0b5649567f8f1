//! The faces of cells, and which of them two cells share.

use rayon::prelude::*;

use super::cell_mesh::{CellList, HEX_FACES, TET_FACES};

/// A face of a cell, which its neighbour has with the opposite orientation.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct CellFace {
    /// Its nodes, ascending; the last is `u32::MAX` for a triangle.
    pub nodes: [u32; 4],
    pub cell: u32,
    /// Which face of the cell.
    pub side: u8,
    /// Its orientation as seen from outside the cell; consistently oriented neighbours have opposite values at their
    /// common face.
    pub reversed: bool,
    /// The node of a quad opposite to the lowest one: four nodes can form three quads. 0 for a triangle.
    pub opposite: u32,
}

/// Borrowed cells of one kind.
#[derive(Debug, Clone, Copy)]
pub(crate) enum CellSlice<'a> {
    Tets(&'a [[u32; 4]]),
    Hexes(&'a [[u32; 8]]),
}

impl<'a> From<&'a CellList> for CellSlice<'a> {
    fn from(cells: &'a CellList) -> Self {
        match cells {
            CellList::Tets(tets) => Self::Tets(tets),
            CellList::Hexes(hexes) => Self::Hexes(hexes),
        }
    }
}

impl CellSlice<'_> {
    pub fn len(self) -> usize {
        match self {
            Self::Tets(cells) => cells.len(),
            Self::Hexes(cells) => cells.len(),
        }
    }
}

/// The faces of all cells, sorted so that the two copies of a shared face are adjacent.
pub(crate) fn faces<'a>(cells: impl Into<CellSlice<'a>>) -> Vec<CellFace> {
    let of_tet = |(cell, tet): (usize, &[u32; 4])| {
        let corners = TET_FACES.map(|face| face.map(|k| tet[k]));
        (0u8..).zip(corners).map(move |(side, [a, b, c])| {
            let nodes = sorted([a, b, c, u32::MAX]);
            CellFace {
                nodes,
                cell: cell as u32,
                side,
                reversed: [[a, b], [b, c], [c, a]].contains(&[nodes[0], nodes[1]]),
                opposite: 0,
            }
        })
    };
    let of_hex = |(cell, hex): (usize, &[u32; 8])| {
        let corners = HEX_FACES.map(|face| face.map(|k| hex[k]));
        (0u8..).zip(corners).map(move |(side, around)| {
            let nodes = sorted(around);
            let first = around.iter().position(|v| *v == nodes[0]).unwrap_or(0);
            CellFace {
                nodes,
                cell: cell as u32,
                side,
                reversed: around[(first + 1) % 4] < around[(first + 3) % 4],
                opposite: around[(first + 2) % 4],
            }
        })
    };
    let mut faces: Vec<CellFace> = match cells.into() {
        CellSlice::Tets(tets) => tets.par_iter().enumerate().flat_map_iter(of_tet).collect(),
        CellSlice::Hexes(hexes) => hexes.par_iter().enumerate().flat_map_iter(of_hex).collect(),
    };
    faces.par_sort_unstable();
    faces
}

/// The corners in ascending order.
pub(crate) fn sorted<const N: usize>(mut corners: [u32; N]) -> [u32; N] {
    corners.sort_unstable();
    corners
}

/// The sorted faces that belong to one cell only.
pub(crate) fn outer(faces: &[CellFace]) -> impl Iterator<Item = &CellFace> {
    let groups = faces.chunk_by(|a, b| a.nodes == b.nodes);
    groups.filter(|group| group.len() == 1).map(|group| &group[0])
}

impl CellFace {
    /// Its corners in their order around it, counter-clockwise seen from outside a right-handed cell; the last is
    /// `None` for a triangle.
    pub fn corners<'a>(&self, cells: impl Into<CellSlice<'a>>) -> ([u32; 3], Option<u32>) {
        match cells.into() {
            CellSlice::Tets(tets) => {
                let tet = tets[self.cell as usize];
                (TET_FACES[self.side as usize].map(|k| tet[k]), None)
            }
            CellSlice::Hexes(hexes) => {
                let hex = hexes[self.cell as usize];
                let [a, b, c, d] = HEX_FACES[self.side as usize].map(|k| hex[k]);
                ([a, b, c], Some(d))
            }
        }
    }

    /// Its triangles, facing out of the cell: a quad is split by the diagonal from its first corner.
    pub fn triangles<'a>(&self, cells: impl Into<CellSlice<'a>>) -> impl Iterator<Item = [u32; 3]> {
        let ([a, b, c], fourth) = self.corners(cells);
        std::iter::once([a, b, c]).chain(fourth.map(|d| [a, c, d]))
    }
}

//! VTK's numbers for kinds of cells, and cells as lists of corners.

use crate::io::{Cells, IoError, Place, contents::Contents, source::Source};

/// Cells as the lists of their corners.
pub(super) struct CellLists {
    pub corners: Vec<i64>,
    /// Where the corners of each cell end.
    pub ends: Vec<usize>,
}

impl CellLists {
    pub fn iter(&self) -> impl Iterator<Item = &[i64]> {
        let starts = std::iter::once(0).chain(self.ends.iter().copied());
        starts.zip(&self.ends).map(|(start, &end)| &self.corners[start..end])
    }
}

const TRIANGLE: u8 = 5;
const QUADRILATERAL: u8 = 9;
const TETRAHEDRON: u8 = 10;
const HEXAHEDRON: u8 = 12;

/// The number that VTK gives this kind of cell.
pub(super) fn vtk_type(cells: Cells) -> u8 {
    match cells {
        Cells::Triangles(_) => TRIANGLE,
        Cells::Quads(_) => QUADRILATERAL,
        Cells::Tets(_) => TETRAHEDRON,
        Cells::Hexes(_) => HEXAHEDRON,
    }
}

/// Adds cells, each with its VTK type, to the polygons and tetrahedra. Points and lines are passed over; `place` is
/// where the types stand.
pub(super) fn sort_cells<'c>(
    source: &Source,
    place: Place,
    contents: &mut Contents,
    cells: impl Iterator<Item = (i64, &'c [i64])>,
) -> Result<(), IoError> {
    for (index, (kind, corners)) in cells.enumerate() {
        contents.cells += 1;
        match (kind, corners) {
            (1..=4 | 21, _) => {}
            (5, &[a, b, c]) => contents.polygons.push([a, b, c]),
            (6, strip) => contents.polygons.push_strip(strip),
            (7, polygon) => contents.polygons.push(polygon.iter().copied()),
            // A pixel goes row by row, not around.
            (8, &[a, b, c, d]) => contents.polygons.push([a, b, d, c]),
            (9, &[a, b, c, d]) => contents.polygons.push([a, b, c, d]),
            (10, &[a, b, c, d]) => {
                contents.tets.push([a, b, c, d]);
                contents.cell_of_tet.push(contents.cells - 1);
            }
            (12, &[a, b, c, d, e, f, g, h]) => contents.hexes.push([a, b, c, d, e, f, g, h]),
            (5 | 8..=10 | 12, _) => {
                let found = format!("cell {index} has VTK type {kind} but {} corners", corners.len());
                return Err(source.malformed_at(place, found));
            }
            (11, _) => contents.add_other_cells("voxels", 1),
            (13, _) => contents.add_other_cells("wedges", 1),
            (14, _) => contents.add_other_cells("pyramids", 1),
            (24, _) => contents.add_other_cells("quadratic tetrahedra", 1),
            (42, _) => contents.add_other_cells("polyhedra", 1),
            _ => contents.add_other_cells(&format!("cells of VTK type {kind}"), 1),
        }
    }
    Ok(())
}

/// Turns offsets as VTK stores them into the ends of lists over `corners` entries; `None` when they are none.
pub(super) fn list_ends(offsets: impl IntoIterator<Item = i64>, corners: usize) -> Option<Vec<usize>> {
    let mut last = 0;
    offsets
        .into_iter()
        .map(|offset| {
            let end = usize::try_from(offset).ok()?;
            let valid = last <= end && end <= corners;
            last = end;
            valid.then_some(end)
        })
        .collect()
}

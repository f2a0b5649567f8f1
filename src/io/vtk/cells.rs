//! VTK's cell types.

use crate::io::{Cells, IoError, Place, input::InputFile, raw_mesh::RawMesh};

/// VTK's cell type.
pub(super) fn vtk_type(cells: Cells) -> u8 {
    match cells {
        Cells::Triangles(_) => 5,
        Cells::Quads(_) => 9,
        Cells::Tets(_) => 10,
        Cells::Hexes(_) => 12,
    }
}

/// Adds cells, each with its VTK type, to the mesh. Points and lines are skipped; `place` is that of the types in the
/// file.
pub(super) fn add_cells<'c>(
    file: &InputFile,
    place: Place,
    raw: &mut RawMesh,
    cells: impl Iterator<Item = (i64, &'c [i64])>,
) -> Result<(), IoError> {
    for (index, (kind, corners)) in cells.enumerate() {
        raw.cells += 1;
        match (kind, corners) {
            (1..=4 | 21, _) => {}
            (5, &[a, b, c]) => raw.polygons.push([a, b, c]),
            (6, strip) => {
                raw.polygons.push_strip(strip);
                raw.has_strips = true;
            }
            (7, polygon) => raw.polygons.push(polygon.iter().copied()),
            // The corners of a pixel are in rows, not around it.
            (8, &[a, b, c, d]) => raw.polygons.push([a, b, d, c]),
            (9, &[a, b, c, d]) => raw.polygons.push([a, b, c, d]),
            (10, &[a, b, c, d]) => {
                raw.tets.push([a, b, c, d]);
                raw.cell_of_volume.push(raw.cells - 1);
            }
            (12, &[a, b, c, d, e, f, g, h]) => {
                raw.hexes.push([a, b, c, d, e, f, g, h]);
                raw.cell_of_volume.push(raw.cells - 1);
            }
            // The corners of a voxel are in rows, not around its faces.
            (11, &[a, b, c, d, e, f, g, h]) => {
                raw.hexes.push([a, b, d, c, e, f, h, g]);
                raw.cell_of_volume.push(raw.cells - 1);
            }
            (5 | 8..=12, _) => {
                let found = format!("cell {index} has VTK type {kind} but {} corners", corners.len());
                return Err(file.malformed_at(place, found));
            }
            (13, _) => raw.add_other_cells("wedges", 1),
            (14, _) => raw.add_other_cells("pyramids", 1),
            (24, _) => raw.add_other_cells("quadratic tetrahedra", 1),
            (42, _) => raw.add_other_cells("polyhedra", 1),
            _ => raw.add_other_cells(&format!("cells of VTK type {kind}"), 1),
        }
    }
    Ok(())
}

/// VTK's offsets as the ends of lists over `corners` entries; `None` unless they ascend within that range.
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

//! Which cells share a face.

use std::collections::HashMap;
use std::collections::hash_map::Entry;

use solidmap::mesh::CellList;

/// No cell.
pub const NONE: u32 = u32::MAX;

/// Faces of a tetrahedron and of a hexahedron, counter-clockwise seen from outside of a right-handed one. The page's script
/// has the same tables.
const TET_FACES: [&[usize]; 4] = [&[0, 2, 1], &[0, 1, 3], &[1, 2, 3], &[0, 3, 2]];
const HEX_FACES: [&[usize]; 6] = [
    &[0, 3, 2, 1],
    &[4, 5, 6, 7],
    &[0, 1, 5, 4],
    &[1, 2, 6, 5],
    &[2, 3, 7, 6],
    &[3, 0, 4, 7],
];

/// The cell across each face of each cell, [`NONE`] at the boundary. Of a face of more than two cells, which no valid mesh has,
/// the first two are neighbours.
pub fn neighbours(cells: &CellList) -> Vec<u32> {
    let faces: &[&[usize]] = match cells {
        CellList::Tets(_) => &TET_FACES,
        CellList::Hexes(_) => &HEX_FACES,
    };
    let mut across = vec![NONE; cells.len() * faces.len()];
    let mut open: HashMap<[u32; 4], u32> = HashMap::with_capacity(across.len() / 2);
    for (cell, corners) in cells.iter().enumerate() {
        for (side, face) in faces.iter().enumerate() {
            let mut nodes = [NONE; 4];
            for (node, &corner) in nodes.iter_mut().zip(*face) {
                *node = corners[corner];
            }
            nodes.sort_unstable();
            let here = cell * faces.len() + side;
            match open.entry(nodes) {
                Entry::Vacant(entry) => {
                    entry.insert(here as u32);
                }
                Entry::Occupied(entry) => {
                    let there = *entry.get() as usize;
                    if across[there] == NONE {
                        across[there] = cell as u32;
                        across[here] = (there / faces.len()) as u32;
                    }
                }
            }
        }
    }
    across
}

/// The corners of the faces at the boundary, as triangles.
pub fn boundary_triangles(cells: &CellList, across: &[u32]) -> Vec<[u32; 3]> {
    let faces: &[&[usize]] = match cells {
        CellList::Tets(_) => &TET_FACES,
        CellList::Hexes(_) => &HEX_FACES,
    };
    let mut triangles = Vec::new();
    for (cell, corners) in cells.iter().enumerate() {
        for (side, face) in faces.iter().enumerate() {
            if across[cell * faces.len() + side] == NONE {
                let at = |k: usize| corners[face[k]];
                triangles.extend((2..face.len()).map(|k| [at(0), at(k - 1), at(k)]));
            }
        }
    }
    triangles
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_that_share_a_face_are_neighbours_and_the_others_make_the_boundary() {
        let hexes = CellList::Hexes(vec![[0, 1, 2, 3, 4, 5, 6, 7], [4, 5, 6, 7, 8, 9, 10, 11]]);
        let across = neighbours(&hexes);
        assert_eq!(across[..6], [NONE, 1, NONE, NONE, NONE, NONE]);
        assert_eq!(across[6..], [0, NONE, NONE, NONE, NONE, NONE]);
        assert_eq!(boundary_triangles(&hexes, &across).len(), 20);
        let tets = CellList::Tets(vec![[0, 1, 2, 3], [0, 2, 1, 4], [0, 2, 1, 5]]);
        let across = neighbours(&tets);
        // A third tetrahedron at the face has no neighbour there.
        assert_eq!([across[0], across[4], across[8]], [1, 0, NONE]);
    }
}

//! Hexahedra cut into tetrahedra that fit together.

use super::cell_mesh::HEX_FACES;

/// Six tetrahedra that fill a hexahedron, right-handed when it is. No vertex is added.
///
/// Every face is cut by the diagonal from its vertex of lowest index, so that two hexahedra cut their common face in the
/// same way, in whatever order they list it (Dompierre, Labbé, Vallet & Camarero, *How to subdivide pyramids, prisms and
/// hexahedra into tetrahedra*, 8th International Meshing Roundtable, 1999). The tetrahedra join the lowest vertex of the
/// hexahedron to the six triangles of the three faces without it: those at the lowest vertex are thereby cut by the
/// diagonals from it. Where faces are not planar, the tetrahedra fill the solid within the cut faces, and some may be
/// inverted although the hexahedron is not.
pub fn tets_of_hex(hex: &[u32; 8]) -> [[u32; 4]; 6] {
    let lowest = (0..8).min_by_key(|&k| hex[k]).unwrap_or(0);
    let mut tets = [[hex[lowest]; 4]; 6];
    let far = HEX_FACES.into_iter().filter(|face| !face.contains(&lowest));
    for (pair, face) in tets.chunks_exact_mut(2).zip(far) {
        let mut around = face.map(|k| hex[k]);
        let first = (0..4).min_by_key(|&k| around[k]).unwrap_or(0);
        around.rotate_left(first);
        let [a, b, c, d] = around;
        // Faces are counter-clockwise from outside, so that the apex inside sees them clockwise.
        pair[0] = [hex[lowest], a, b, c];
        pair[1] = [hex[lowest], a, c, d];
    }
    tets
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Point;
    use crate::mesh::{HEXAHEDRON, TetMesh};

    /// Two cubes with a common face, under every rotation of the numbers of their twelve vertices and with the second
    /// listed from each of its corners around the axis.
    #[test]
    fn neighbours_are_cut_alike_and_all_tetrahedra_are_right_handed() {
        for shift in 0..12 {
            for turn in 0..4 {
                let place = |k: usize| Point::new((k % 3) as f64, (k / 3 % 2) as f64, (k / 6) as f64);
                let number = |k: usize| ((5 * k + shift) % 12) as u32;
                let mut vertices = vec![Point::origin(); 12];
                (0..12).for_each(|k| vertices[number(k) as usize] = place(k));
                let cube = |x: usize| {
                    HEXAHEDRON.map(|[i, j, k]| number(x + usize::from(i) + 3 * usize::from(j) + 6 * usize::from(k)))
                };
                let (left, mut right) = (cube(0), cube(1));
                right[..4].rotate_left(turn);
                right[4..].rotate_left(turn);
                let tets = [tets_of_hex(&left), tets_of_hex(&right)].concat();
                let mesh = TetMesh::new(vertices, tets).unwrap();
                assert!((0..12).all(|t| mesh.signed_volume(t) > 0.1), "{shift} {turn}");
                assert!((mesh.volume() - 2.0).abs() < 1e-14);
                // Unless the common face is cut alike, its four triangles are on the boundary too.
                assert_eq!(mesh.boundary().surface.triangles().len(), 20, "{shift} {turn}");
            }
        }
    }
}

//! Where cells of a carried mesh stay inverted.

use super::Remeshed;
use super::bounded_mesh::faces;
use super::quality::{at, scaled_jacobians};
use crate::Point;
use crate::worst_places::{BadPart, PlaceKind, WorstPlace, listed, places, sharing};

impl Remeshed {
    /// The connected groups of inverted cells of the result, in the target, the largest first; at most `most`. The volume
    /// of a cell is that of the tetrahedra that it consists of, without their signs.
    pub fn worst_places(&self, most: usize) -> Vec<WorstPlace> {
        let bad = &self.report.after.cells;
        let cells = self.mesh.cells.select(bad);
        let values = scaled_jacobians(&cells, &self.images);
        let parts = cells.iter().zip(values).map(|(nodes, value)| {
            let corners: Vec<Point> = nodes.iter().map(|&v| at(&self.images, v)).collect();
            BadPart::of_corners(&corners, volume(&corners), value)
        });
        let parts: Vec<BadPart> = parts.collect();
        let shared = sharing(faces(&cells).into_iter().map(|face| (face.nodes, face.cell)));
        let found = places(PlaceKind::Inverted, &parts, shared, self.report.volume);
        listed([found], most)
    }
}

/// The tetrahedra of a hexahedron around the diagonal from its first corner.
const TETS_OF_HEX: [[usize; 4]; 6] = [
    [0, 1, 2, 6],
    [0, 2, 3, 6],
    [0, 3, 7, 6],
    [0, 7, 4, 6],
    [0, 4, 5, 6],
    [0, 5, 1, 6],
];

fn volume(corners: &[Point]) -> f64 {
    let tet = |t: &[usize; 4]| {
        let [a, b, c, d] = t.map(|k| corners[k]);
        (b - a).dot(&(c - a).cross(&(d - a))).abs() / 6.0
    };
    if corners.len() == 4 {
        tet(&[0, 1, 2, 3])
    } else {
        TETS_OF_HEX.iter().map(tet).sum()
    }
}

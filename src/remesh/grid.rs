//! Regular meshes of polycubes: tetrahedra without boundary tetrahedra, hexahedra with a padding layer.

use std::collections::HashMap;

use super::RemeshError;
use super::bounded_mesh::BoundedMesh;
use super::planes::{Polycube, boxes};
use crate::mesh::{CellList, KUHN};
use crate::{Point, Vector};

/// How large the boxes of the grid are.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum CellSize {
    /// So many along the longest side of the domain.
    Along(usize),
    /// This length, in the units of the domain.
    Length(f64),
}

impl CellSize {
    /// The length, in the units of the polycube.
    pub fn of(self, polycube: &Polycube) -> f64 {
        let spans = polycube.planes().iter().filter_map(|p| Some(p.last()? - p.first()?));
        match self {
            Self::Along(count) => spans.fold(0.0, f64::max) / count as f64,
            Self::Length(length) => length,
        }
    }
}

/// What cells a mesh has.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum CellKind {
    /// Six tetrahedra per box of the grid.
    Tets,
    /// One hexahedron per box, and one under each boundary quad.
    Hexes,
}

/// How far boundary nodes go inward for the padding, in cells. With a half, cells at edges that point inward would be flat.
const DEPTH: f64 = 1.0 / 3.0;

/// A grid through all planes of a polycube, with an even number of boxes between neighbouring planes.
struct PolycubeGrid {
    coordinates: [Vec<f64>; 3],
    /// Which boxes are inside.
    inside: Vec<bool>,
}

/// Places of a grid at most, inside and outside of the solid.
const MOST_PLACES: f64 = 1e9;
/// Cells at most, whatever the limit asked for: corners of cells are counted by 32 bits.
pub(super) const MOST_CELLS: f64 = (1u32 << 28) as f64;

/// The cells that a mesh of this size would have, and the places of its grid, before any is made.
fn counts(polycube: &Polycube, size: f64, kind: CellKind) -> [f64; 2] {
    let along = polycube
        .planes()
        .each_ref()
        .map(|planes| -> Vec<f64> { planes.windows(2).map(|w| divisions(w[1] - w[0], size)).collect() });
    let cubes: f64 = polycube
        .filled()
        .map(|[i, j, k]| along[0][i] * along[1][j] * along[2][k])
        .sum();
    let quads = || {
        polycube.outer_faces(|at, k| {
            let [b, c] = [(k + 1) % 3, (k + 2) % 3];
            along[b][at[b]] * along[c][at[c]]
        })
    };
    let places = along.iter().map(|counts| counts.iter().sum::<f64>() + 1.0).product();
    match kind {
        CellKind::Tets => [6.0 * cubes, places],
        CellKind::Hexes => [cubes + quads(), places],
    }
}

/// The cells that [`regular_mesh`] makes, before any is made.
///
/// # Errors
///
/// Those of [`regular_mesh`].
pub fn cell_count(polycube: &Polycube, size: f64, kind: CellKind, most_cells: usize) -> Result<usize, RemeshError> {
    if !size.is_finite() || size <= 0.0 {
        return Err(RemeshError::Size(size));
    }
    let [cells, places] = counts(polycube, size, kind);
    for (what, count, limit) in [
        ("cells", cells, MOST_CELLS.min(most_cells as f64)),
        ("places in the grid", places, MOST_PLACES),
    ] {
        if count > limit {
            return Err(RemeshError::TooMany { what, count, limit });
        }
    }
    Ok(cells as usize)
}

/// A regular mesh with boxes of about `size`.
///
/// Tetrahedra come from Kuhn's split, mirrored with the parity of the box: every tetrahedron has a node whose three
/// indices are odd. Planes of the polycube have even ones, so that this node is inside, and no tetrahedron has all its
/// nodes on the boundary.
///
/// # Errors
///
/// [`RemeshError::Size`] unless `size` is positive and finite, [`RemeshError::TooMany`] when there would be more cells than
/// `most_cells` (2²⁸ in any case), or more than 10⁹ places in the grid over the polycube's box.
pub fn regular_mesh(
    polycube: &Polycube,
    size: f64,
    kind: CellKind,
    most_cells: usize,
) -> Result<BoundedMesh, RemeshError> {
    cell_count(polycube, size, kind, most_cells)?;
    let grid = PolycubeGrid::new(polycube, size);
    Ok(match kind {
        CellKind::Tets => grid.tets(),
        CellKind::Hexes => grid.hexes(),
    })
}

/// An even number of boxes of about `size` along a length.
fn divisions(length: f64, size: f64) -> f64 {
    // A little less, so that a size that divides the length does.
    2.0 * (length / (2.0 * size) - 1e-9).ceil().max(1.0)
}

impl PolycubeGrid {
    fn new(polycube: &Polycube, size: f64) -> Self {
        let mut coordinates: [Vec<f64>; 3] = Default::default();
        // The box between planes that each box of the grid lies in.
        let mut parents: [Vec<usize>; 3] = Default::default();
        for k in 0..3 {
            let planes = &polycube.planes()[k];
            coordinates[k].push(planes[0]);
            for (parent, w) in planes.windows(2).enumerate() {
                let count = divisions(w[1] - w[0], size) as usize;
                for i in 1..=count {
                    let t = i as f64 / count as f64;
                    coordinates[k].push(if i == count { w[1] } else { w[0] * (1.0 - t) + w[1] * t });
                    parents[k].push(parent);
                }
            }
        }
        let counts = parents.each_ref().map(Vec::len);
        let inside = boxes(counts)
            .map(|at| polycube.contains(std::array::from_fn(|k| parents[k][at[k]] as isize)))
            .collect();
        Self { coordinates, inside }
    }

    fn counts(&self) -> [usize; 3] {
        self.coordinates.each_ref().map(|c| c.len() - 1)
    }

    fn is_inside(&self, at: [isize; 3]) -> bool {
        let counts = self.counts();
        if (0..3).any(|k| at[k] < 0 || at[k] as usize >= counts[k]) {
            return false;
        }
        let [i, j, k] = at.map(|i| i as usize);
        self.inside[i + counts[0] * (j + counts[1] * k)]
    }

    fn filled(&self) -> impl Iterator<Item = [usize; 3]> {
        boxes(self.counts()).filter(|at| self.is_inside(at.map(|i| i as isize)))
    }

    /// Numbers of the nodes that boxes inside have, by their place in the grid; the nodes; which are on the boundary.
    fn nodes(&self) -> (Vec<u32>, Vec<[usize; 3]>, Vec<bool>) {
        let counts = self.counts();
        let size = counts.map(|n| n + 1);
        let mut number = vec![u32::MAX; size.iter().product()];
        let (mut places, mut on_boundary) = (vec![], vec![]);
        for at in boxes(size) {
            let inside = (0..8)
                .filter(|m| self.is_inside(std::array::from_fn(|k| at[k] as isize - (m >> k & 1) as isize)))
                .count();
            if inside > 0 {
                number[at[0] + size[0] * (at[1] + size[1] * at[2])] = places.len() as u32;
                places.push(at);
                on_boundary.push(inside < 8);
            }
        }
        (number, places, on_boundary)
    }

    fn corner(&self, number: &[u32], at: [usize; 3], m: usize) -> u32 {
        let size = self.counts().map(|n| n + 1);
        let [i, j, k]: [usize; 3] = std::array::from_fn(|k| at[k] + (m >> k & 1));
        number[i + size[0] * (j + size[1] * k)]
    }

    fn position(&self, at: [usize; 3]) -> Point {
        Point::from(Vector::from_fn(|k, _| self.coordinates[k][at[k]]))
    }

    fn tets(&self) -> BoundedMesh {
        let (number, places, on_boundary) = self.nodes();
        let mut tets = Vec::new();
        let mut boundary = Vec::new();
        for at in self.filled() {
            // Paths from the corner whose indices are even to the one where they are odd.
            let even = (0..3).fold(0, |m, k| m | (at[k] & 1) << k);
            let corner = |m: usize| self.corner(&number, at, m ^ even);
            let is_mirrored = even.count_ones() % 2 == 1;
            for path in KUHN.map(|path| path.map(corner)) {
                tets.push(match is_mirrored {
                    true => [path[0], path[2], path[1], path[3]],
                    false => path,
                });
            }
            for [axis, side] in faces_of_box() {
                let mut beyond = at.map(|i| i as isize);
                beyond[axis] += 2 * side as isize - 1;
                if self.is_inside(beyond) {
                    continue;
                }
                // The diagonal of the split goes from the corner with even indices to the one with odd ones.
                let (b, c) = ((axis + 1) % 3, (axis + 2) % 3);
                let quad = |i: usize, j: usize| {
                    let m = side << axis | i << b | j << c;
                    self.corner(&number, at, m)
                };
                let [eb, ec] = [even >> b & 1, even >> c & 1];
                let (e, o) = (quad(eb, ec), quad(1 - eb, 1 - ec));
                let (p, q) = (quad(1 - eb, ec), quad(eb, 1 - ec));
                // (b, c) is counter-clockwise seen from the positive side, as long as neither or both are mirrored.
                let outward = (side == 1) == (eb == ec);
                if outward {
                    boundary.extend([[e, p, o], [e, o, q]]);
                } else {
                    boundary.extend([[e, o, p], [e, q, o]]);
                }
            }
        }
        let nodes = places.iter().map(|&at| self.position(at)).collect();
        let regions = vec![1; tets.len()];
        BoundedMesh::new(nodes, CellList::Tets(tets), regions, on_boundary, boundary)
    }

    fn hexes(&self) -> BoundedMesh {
        let (number, places, on_grid_boundary) = self.nodes();
        let mut nodes: Vec<Point> = places.iter().map(|&at| self.position(at)).collect();
        // How far boundary nodes go inward from faces that look down and up each axis. Where both do no place is right for
        // all faces, and cells there are inverted in the domain itself; a map that flattens the corner mends them.
        let mut depths = vec![[[0.0; 2]; 3]; nodes.len()];
        let mut hexes = Vec::new();
        let mut quads = Vec::new();
        for at in self.filled() {
            // Around the bottom, then the top.
            let corners = [0, 1, 3, 2, 4, 5, 7, 6].map(|m| self.corner(&number, at, m));
            hexes.push(corners);
            for [axis, side] in faces_of_box() {
                let mut beyond = at.map(|i| i as isize);
                beyond[axis] += 2 * side as isize - 1;
                if self.is_inside(beyond) {
                    continue;
                }
                let (b, c) = ((axis + 1) % 3, (axis + 2) % 3);
                let quad = |i: usize, j: usize| self.corner(&number, at, side << axis | i << b | j << c);
                let around = [quad(0, 0), quad(1, 0), quad(1, 1), quad(0, 1)];
                // Counter-clockwise from outside.
                let around = if side == 1 {
                    around
                } else {
                    [around[0], around[3], around[2], around[1]]
                };
                let depth = DEPTH * (self.coordinates[axis][at[axis] + 1] - self.coordinates[axis][at[axis]]);
                // Of several boxes with faces across this axis, the thinnest decides how far.
                for v in around {
                    let towards = &mut depths[v as usize][axis][side];
                    *towards = if *towards == 0.0 { depth } else { depth.min(*towards) };
                }
                quads.push(around);
            }
        }
        // Boundary nodes of the grid move inward; new ones take their places.
        let mut surface = HashMap::new();
        let mut on_boundary = vec![false; nodes.len()];
        for v in 0..places.len() {
            if on_grid_boundary[v] {
                surface.insert(v as u32, nodes.len() as u32);
                let at = nodes[v];
                nodes.push(at);
                nodes[v] += Vector::from_fn(|k, _| match depths[v][k] {
                    [down, 0.0] => down,
                    [0.0, up] => -up,
                    _ => 0.0,
                });
                on_boundary.push(true);
            }
        }
        let mut boundary = Vec::new();
        for below in quads {
            let above = below.map(|v| surface[&v]);
            hexes.push([
                below[0], below[1], below[2], below[3], above[0], above[1], above[2], above[3],
            ]);
            boundary.extend([[above[0], above[1], above[2]], [above[0], above[2], above[3]]]);
        }
        let regions = vec![1; hexes.len()];
        BoundedMesh::new(nodes, CellList::Hexes(hexes), regions, on_boundary, boundary)
    }
}

/// Axis, and 0 for its lower side or 1 for the upper.
fn faces_of_box() -> impl Iterator<Item = [usize; 2]> {
    (0..3).flat_map(|axis| [[axis, 0], [axis, 1]])
}

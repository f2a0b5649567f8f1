//! Regular meshes of polycubes: tetrahedra, none with all its nodes on the boundary, or hexahedra with a padding layer.

use super::RemeshError;
use super::bounded_mesh::BoundedMesh;
use super::planes::{Polycube, boxes};
use super::sheets::padded_everywhere;
use crate::mesh::{CellList, KUHN};
use crate::{Point, Vector};

/// The size of the grid's boxes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum CellSize {
    /// This many along the longest side of the domain.
    Along(usize),
    /// Boxes of this edge length, in the units of the domain.
    Length(f64),
}

impl CellSize {
    /// The edge length, in the units of the polycube.
    pub fn of(self, polycube: &Polycube) -> f64 {
        let spans = polycube.planes().iter().filter_map(|p| Some(p.last()? - p.first()?));
        match self {
            Self::Along(count) => spans.fold(0.0, f64::max) / count as f64,
            Self::Length(length) => length,
        }
    }
}

/// The kind of a mesh's cells.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum CellKind {
    /// Six tetrahedra per box of the grid.
    Tets,
    /// One hexahedron per box, and one in the padding layer at boundary quads: at each of them in [`regular_mesh`], at those where it
    /// makes angles better in [`remesh`](super::remesh).
    Hexes,
}

/// Thickness of the padding layer, in cells. With a half, cells at reentrant edges would be flat.
const PADDING: f64 = 1.0 / 3.0;

/// Largest number of grid points, inside and outside of the solid.
const MAX_GRID_POINTS: f64 = 1e9;
/// Largest number of cells, whatever limit is asked for: corners of cells have 32-bit indices.
pub(super) const MAX_CELLS: f64 = (1u32 << 28) as f64;

fn boxes_between_planes(polycube: &Polycube, size: f64, kind: CellKind) -> [Vec<f64>; 3] {
    let between = |planes: &Vec<f64>| planes.windows(2).map(|w| divisions(w[1] - w[0], size, kind)).collect();
    polycube.planes().each_ref().map(between)
}

/// The number of boxes of this size in the polycube.
pub(super) fn box_count(polycube: &Polycube, size: f64, kind: CellKind) -> f64 {
    let along = boxes_between_planes(polycube, size, kind);
    let of_box = |[i, j, k]: [usize; 3]| along[0][i] * along[1][j] * along[2][k];
    polycube.filled().map(of_box).sum()
}

/// The number of cells that a mesh with boxes of this size would have, and the number of its grid points, before any is
/// made.
fn counts(polycube: &Polycube, size: f64, kind: CellKind) -> [f64; 2] {
    let along = boxes_between_planes(polycube, size, kind);
    let box_count = box_count(polycube, size, kind);
    let quads = || {
        polycube.sum_over_outer_faces(|at, k| {
            let [b, c] = [(k + 1) % 3, (k + 2) % 3];
            along[b][at[b]] * along[c][at[c]]
        })
    };
    let points = along.iter().map(|counts| counts.iter().sum::<f64>() + 1.0).product();
    match kind {
        CellKind::Tets => [6.0 * box_count, points],
        CellKind::Hexes => [box_count + quads(), points],
    }
}

/// The number of cells that [`regular_mesh`] makes, before any is made.
///
/// # Errors
///
/// Those of [`regular_mesh`].
pub fn cell_count(polycube: &Polycube, size: f64, kind: CellKind, most_cells: usize) -> Result<usize, RemeshError> {
    if !size.is_finite() || size <= 0.0 {
        return Err(RemeshError::Size(size));
    }
    let [cells, points] = counts(polycube, size, kind);
    for (what, count, limit) in [
        ("cells", cells, MAX_CELLS.min(most_cells as f64)),
        ("points in the grid", points, MAX_GRID_POINTS),
    ] {
        if count > limit {
            return Err(RemeshError::TooMany { what, count, limit });
        }
    }
    Ok(cells as usize)
}

/// The number of points of the grid that [`regular_mesh`] makes over the bounding box of the domain, whatever part of it
/// the domain fills.
pub fn grid_points(polycube: &Polycube, size: f64) -> usize {
    let [_, points] = counts(polycube, size, CellKind::Tets);
    points as usize
}

/// A regular mesh with boxes of about `size`.
///
/// Tetrahedra come from Kuhn's subdivision, mirrored with the parity of the box: every tetrahedron has a node whose
/// three indices are odd. Planes of the polycube have even indices, so that this node is inside, and no tetrahedron has
/// all its nodes on the boundary.
///
/// # Errors
///
/// [`RemeshError::Size`] unless `size` is positive and finite, [`RemeshError::TooMany`] when there would be more cells
/// than `most_cells` (2²⁸ in any case), or more than 10⁹ grid points over the polycube's box.
pub fn regular_mesh(
    polycube: &Polycube,
    size: f64,
    kind: CellKind,
    most_cells: usize,
) -> Result<BoundedMesh, RemeshError> {
    cell_count(polycube, size, kind, most_cells)?;
    let grid = polycube.refined(size, kind);
    Ok(match kind {
        CellKind::Tets => grid.tets(),
        CellKind::Hexes => {
            let grid = grid.hex_grid();
            padded_everywhere(grid)
        }
    })
}

/// A number of boxes of about `size` along a length; an even one for tetrahedra.
fn divisions(length: f64, size: f64, kind: CellKind) -> f64 {
    let step = match kind {
        CellKind::Tets => 2.0,
        CellKind::Hexes => 1.0,
    };
    // Slightly less, so that rounding adds no boxes where the size divides the length.
    step * (length / (step * size) - 1e-9).ceil().max(1.0)
}

impl Polycube {
    /// The same solid with more planes: the grid.
    fn refined(&self, size: f64, kind: CellKind) -> Self {
        let mut planes: [Vec<f64>; 3] = Default::default();
        // The box of the polycube that each box of the grid lies in, along each axis.
        let mut parents: [Vec<usize>; 3] = Default::default();
        for k in 0..3 {
            planes[k].push(self.planes[k][0]);
            for (parent, w) in self.planes[k].windows(2).enumerate() {
                let count = divisions(w[1] - w[0], size, kind) as usize;
                for i in 1..=count {
                    let t = i as f64 / count as f64;
                    planes[k].push(if i == count { w[1] } else { w[0] * (1.0 - t) + w[1] * t });
                    parents[k].push(parent);
                }
            }
        }
        let counts = parents.each_ref().map(Vec::len);
        let inside = boxes(counts)
            .map(|at| self.contains(std::array::from_fn(|k| parents[k][at[k]] as isize)))
            .collect();
        Self { planes, inside }
    }

    /// Node of each grid point, `u32::MAX` where there is none; grid indices of the nodes; which nodes are on the
    /// boundary.
    fn nodes(&self) -> (Vec<u32>, Vec<[usize; 3]>, Vec<bool>) {
        let counts = self.counts();
        let size = counts.map(|n| n + 1);
        let mut node_ids = vec![u32::MAX; size.iter().product()];
        let (mut points, mut on_boundary) = (vec![], vec![]);
        for at in boxes(size) {
            let inside = (0..8)
                .filter(|m| self.contains(std::array::from_fn(|k| at[k] as isize - (m >> k & 1) as isize)))
                .count();
            if inside > 0 {
                node_ids[at[0] + size[0] * (at[1] + size[1] * at[2])] = points.len() as u32;
                points.push(at);
                on_boundary.push(inside < 8);
            }
        }
        (node_ids, points, on_boundary)
    }

    /// The node at a corner of a box; bit `k` of `m` selects the side along axis `k`.
    fn corner(&self, node_ids: &[u32], at: [usize; 3], m: usize) -> u32 {
        let size = self.counts().map(|n| n + 1);
        let [i, j, k]: [usize; 3] = std::array::from_fn(|k| at[k] + (m >> k & 1));
        node_ids[i + size[0] * (j + size[1] * k)]
    }

    fn position(&self, at: [usize; 3]) -> Point {
        Point::from(Vector::from_fn(|k, _| self.planes[k][at[k]]))
    }

    fn tets(&self) -> BoundedMesh {
        let (node_ids, points, on_boundary) = self.nodes();
        let mut tets = Vec::new();
        let mut boundary = Vec::new();
        for at in self.filled() {
            // Paths from the corner with even indices to the one with odd ones.
            let even = (0..3).fold(0, |m, k| m | (at[k] & 1) << k);
            let corner = |m: usize| self.corner(&node_ids, at, m ^ even);
            let is_mirrored = even.count_ones() % 2 == 1;
            for path in KUHN.map(|path| path.map(corner)) {
                let [a, b, c, d] = path;
                tets.push(if is_mirrored { [a, c, b, d] } else { path });
            }
            for [axis, side] in self.outer_faces_of(at) {
                // The diagonal of the face goes from the corner with even indices to the one with odd ones.
                let (b, c) = ((axis + 1) % 3, (axis + 2) % 3);
                let quad = |i: usize, j: usize| self.corner(&node_ids, at, side << axis | i << b | j << c);
                let [eb, ec] = [even >> b & 1, even >> c & 1];
                let (e, o) = (quad(eb, ec), quad(1 - eb, 1 - ec));
                let (p, q) = (quad(1 - eb, ec), quad(eb, 1 - ec));
                // (b, c) is counter-clockwise seen from the positive side, as long as neither or both are mirrored.
                let outward = (side == 1) == (eb == ec);
                boundary.extend(match outward {
                    true => [[e, p, o], [e, o, q]],
                    false => [[e, o, p], [e, q, o]],
                });
            }
        }
        let nodes = points.iter().map(|&at| self.position(at)).collect();
        let regions = vec![1; tets.len()];
        BoundedMesh::new(nodes, CellList::Tets(tets), regions, on_boundary, boundary)
    }

    /// The boxes as hexahedra, and the quads on the boundary.
    fn hex_grid(&self) -> HexGrid {
        let (node_ids, points, _) = self.nodes();
        let (mut hexes, mut quads) = (Vec::new(), Vec::new());
        for at in self.filled() {
            // Around the bottom, then the top.
            let hex = hexes.len() as u32;
            hexes.push([0, 1, 3, 2, 4, 5, 7, 6].map(|m| self.corner(&node_ids, at, m)));
            for [axis, side] in self.outer_faces_of(at) {
                let (b, c) = ((axis + 1) % 3, (axis + 2) % 3);
                let quad = |i: usize, j: usize| self.corner(&node_ids, at, side << axis | i << b | j << c);
                let [p, q, r, s] = [quad(0, 0), quad(1, 0), quad(1, 1), quad(0, 1)];
                quads.push(GridQuad {
                    nodes: if side == 1 { [p, q, r, s] } else { [p, s, r, q] },
                    axis,
                    side,
                    depth: PADDING * self.sides(at)[axis],
                    hex,
                });
            }
        }
        HexGrid {
            nodes: points.iter().map(|&at| self.position(at)).collect(),
            hexes,
            quads,
        }
    }
}

/// The boxes of a polycube as hexahedra, without padding.
#[derive(Debug, Clone)]
pub(super) struct HexGrid {
    pub nodes: Vec<Point>,
    pub hexes: Vec<[u32; 8]>,
    /// The boundary.
    pub quads: Vec<GridQuad>,
}

/// A quad of the boundary of a [`HexGrid`].
#[derive(Debug, Clone, Copy)]
pub(super) struct GridQuad {
    /// Counter-clockwise from outside.
    pub nodes: [u32; 4],
    /// The axis that it lies across, and 0 if it faces down along it, 1 if up.
    pub axis: usize,
    pub side: usize,
    /// Thickness of a padding layer below it.
    pub depth: f64,
    /// The hexahedron that it bounds.
    pub hex: u32,
}

impl HexGrid {
    pub fn of(polycube: &Polycube, size: f64) -> Self {
        polycube.refined(size, CellKind::Hexes).hex_grid()
    }
}

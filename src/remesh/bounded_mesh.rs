//! A mesh with its boundary: the nodes on it, its triangles, and the parts that they form.

use std::collections::HashMap;

use rayon::prelude::*;

pub(crate) use crate::mesh::{CellFace, faces, sorted};
use crate::mesh::{CellList, CellMesh, outer};
use crate::{Point, Vector};

/// A mesh of a solid with its boundary.
#[derive(Debug, Clone, PartialEq)]
pub struct BoundedMesh {
    pub(crate) nodes: Vec<Point>,
    pub(crate) cells: CellList,
    pub(crate) regions: Vec<i32>,
    pub(crate) on_boundary: Vec<bool>,
    pub(crate) boundary: Vec<[u32; 3]>,
    pub(crate) parts: Vec<i32>,
    pub(super) part_names: Vec<String>,
}

/// The boundary of a set of cells of a mesh.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct CellSetBoundary {
    /// Triangles, facing out of the cells.
    pub triangles: Vec<[u32; 3]>,
    /// The cell of each triangle.
    pub cells: Vec<u32>,
    /// For each triangle `[a, b, c]` whether `ab`, `bc` and `ca` are edges of cells, not diagonals of quads.
    pub edges: Vec<[bool; 3]>,
}

impl BoundedMesh {
    /// A mesh with its outer faces as its boundary.
    pub(crate) fn of(mesh: CellMesh, faces: &[CellFace]) -> Self {
        let (nodes, cells, regions) = mesh.into_parts();
        let boundary: Vec<[u32; 3]> = outer(faces).flat_map(|face| face.triangles(&cells)).collect();
        let mut on_boundary = vec![false; nodes.len()];
        boundary.iter().flatten().for_each(|&v| on_boundary[v as usize] = true);
        Self::new(nodes, cells, regions, on_boundary, boundary)
    }

    pub(super) fn new(
        nodes: Vec<Point>,
        cells: CellList,
        regions: Vec<i32>,
        on_boundary: Vec<bool>,
        boundary: Vec<[u32; 3]>,
    ) -> Self {
        let (parts, part_names) = parts(&nodes, &boundary);
        Self {
            nodes,
            cells,
            regions,
            on_boundary,
            boundary,
            parts,
            part_names,
        }
    }

    /// Nodes in the domain.
    pub fn nodes(&self) -> &[Point] {
        &self.nodes
    }

    /// The cells, right-handed where the mesh has no inverted ones.
    pub fn cells(&self) -> &CellList {
        &self.cells
    }

    /// The region of every cell.
    pub fn regions(&self) -> &[i32] {
        &self.regions
    }

    /// Which nodes lie on the boundary.
    pub fn on_boundary(&self) -> &[bool] {
        &self.on_boundary
    }

    /// Boundary triangles, facing outward. Quads of hexahedra are split into two consecutive triangles.
    pub fn boundary(&self) -> &[[u32; 3]] {
        &self.boundary
    }

    /// The part of the boundary that each triangle belongs to, from 1. A part is connected across edges; its triangles
    /// all face the same way along an axis, or none faces along an axis.
    pub fn parts(&self) -> &[i32] {
        &self.parts
    }

    /// Names of the parts, in order.
    pub fn part_names(&self) -> &[String] {
        &self.part_names
    }

    /// The boundary of the cells that are `kept`. Sorts the faces of all cells.
    pub fn boundary_of(&self, kept: impl Fn(u32) -> bool) -> CellSetBoundary {
        let mut faces = faces(&self.cells);
        faces.retain(|face| kept(face.cell));
        let mut boundary = CellSetBoundary::default();
        for face in outer(&faces) {
            let edges: &[[bool; 3]] = match self.cells {
                CellList::Tets(_) => &[[true; 3]],
                CellList::Hexes(_) => &[[true, true, false], [false, true, true]],
            };
            boundary.triangles.extend(face.triangles(&self.cells));
            boundary.cells.extend(edges.iter().map(|_| face.cell));
            boundary.edges.extend(edges);
        }
        boundary
    }

    /// The quads of the boundary; `None` unless the cells are hexahedra.
    pub fn quads(&self) -> Option<Vec<[u32; 4]>> {
        matches!(self.cells, CellList::Hexes(_)).then(|| {
            let pairs = self.boundary.as_chunks::<2>().0;
            pairs.iter().map(|[[a, b, c], [_, _, d]]| [*a, *b, *c, *d]).collect()
        })
    }
}

/// Directions along the axes, as in the names of parts.
const SIDES: [&str; 6] = ["-x", "+x", "-y", "+y", "-z", "+z"];

/// Each boundary triangle's part, and the names of the parts.
fn parts(nodes: &[Point], boundary: &[[u32; 3]]) -> (Vec<i32>, Vec<String>) {
    // Angle to an axis below which a normal counts as along it.
    const ALIGNED: f64 = 1e-6;
    let facing = |t: &[u32; 3]| -> Option<usize> {
        let [a, b, c] = t.map(|v| nodes[v as usize]);
        let normal: Vector = (b - a).cross(&(c - a)).normalize();
        (0..6).find(|side| {
            let along = normal[side / 2] * if side % 2 == 1 { 1.0 } else { -1.0 };
            1.0 - along < 0.5 * ALIGNED * ALIGNED
        })
    };
    let facing: Vec<Option<usize>> = boundary.par_iter().map(facing).collect();
    let mut neighbours: HashMap<[u32; 2], Vec<u32>> = HashMap::new();
    let edges = |t: &[u32; 3]| [[t[0], t[1]], [t[1], t[2]], [t[2], t[0]]].map(|[a, b]| [a.min(b), a.max(b)]);
    for (index, t) in boundary.iter().enumerate() {
        for edge in edges(t) {
            neighbours.entry(edge).or_default().push(index as u32);
        }
    }
    let (mut parts, mut names) = (vec![0; boundary.len()], vec![]);
    for first in 0..boundary.len() {
        if parts[first] != 0 {
            continue;
        }
        let part = names.len() as i32 + 1;
        names.push(match facing[first] {
            Some(side) => format!("face {part} ({})", SIDES[side]),
            None => format!("face {part}"),
        });
        parts[first] = part;
        let mut pending = vec![first];
        while let Some(at) = pending.pop() {
            for edge in edges(&boundary[at]) {
                for &next in &neighbours[&edge] {
                    let next = next as usize;
                    if parts[next] == 0 && facing[next] == facing[first] {
                        parts[next] = part;
                        pending.push(next);
                    }
                }
            }
        }
    }
    (parts, names)
}

//! Sheets of hexahedra: layers below faces of a grid's boundary, by pillowing (Mitchell, Tautges, *Pillowing Doublets*, 1995).
//!
//! A sheet is laid below quads that are connected. Where these border on a face without a layer, it ends on that face, as a row of quads;
//! at a reentrant edge it goes on straight into the solid, until it ends on the face on the other side. The hexahedra on
//! its inner side get nodes of their own, which move inward, and a hexahedron fills the gap below each quad.

use std::collections::{BTreeMap, HashMap};

use super::bounded_mesh::BoundedMesh;
use super::grid::{GridQuad, HexGrid};
use crate::Vector;
use crate::mesh::topology::DisjointSets;
use crate::mesh::{CellList, HEX_FACES, sorted};

/// The grid with one more hexahedron below each of its boundary quads.
pub(super) fn padded_everywhere(grid: HexGrid) -> BoundedMesh {
    let quads = (0..grid.quads.len())
        .map(|quad| SheetQuad::on_boundary(&grid.quads, quad))
        .collect();
    let mut mesh = SheetedMesh::of(grid);
    // It ends nowhere, and so cannot fail.
    let _ = mesh.insert(&Sheet { quads, core: None });
    mesh.bounded()
}

/// The grid with one more hexahedron below each boundary quad that is `padded`, and in the sheets that go on from them. Whole faces have to be
/// padded or not. `None` where a sheet would cross itself, or end inside the solid.
pub(super) fn padded(grid: HexGrid, padded: &[bool]) -> Option<BoundedMesh> {
    let face_of = faces_of(&grid.quads);
    let left_of = left_of(&grid.quads);
    // Faces that are padded and have an edge in common.
    let mut connected = DisjointSets::new(grid.quads.len());
    for (index, &face) in (0..).zip(&face_of) {
        connected.unite(index, face);
    }
    for (&[a, b], &one) in &left_of {
        let other = left_of.get(&[b, a]).copied().unwrap_or(one);
        if padded[one as usize] && padded[other as usize] {
            connected.unite(one, other);
        }
    }
    let mut sheets: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
    for (index, (&face, padded)) in (0..).zip(face_of.iter().zip(padded)) {
        if *padded && face == index {
            sheets.entry(connected.find(index)).or_default().push(face);
        }
    }
    let mut mesh = SheetedMesh::of(grid);
    mesh.face_of = face_of;
    for faces in sheets.values() {
        let sheet = mesh.sheet_below(faces)?;
        mesh.insert(&sheet)?;
    }
    Some(mesh.bounded())
}

pub(super) fn edges([a, b, c, d]: [u32; 4]) -> [[u32; 2]; 4] {
    [[a, b], [b, c], [c, d], [d, a]]
}

/// The quad on the left of each edge of a boundary, from its first end to its second.
pub(super) fn left_of(quads: &[GridQuad]) -> BTreeMap<[u32; 2], u32> {
    let sides = quads.iter().zip(0..);
    sides
        .flat_map(|(quad, index)| edges(quad.nodes).map(|edge| (edge, index)))
        .collect()
}

/// The face of each quad: quads in one plane that are connected, known by the first of them.
pub(super) fn faces_of(quads: &[GridQuad]) -> Vec<u32> {
    let left_of = left_of(quads);
    let mut faces = DisjointSets::new(quads.len());
    for (&[a, b], &one) in &left_of {
        if let Some(&other) = left_of.get(&[b, a])
            && quads[one as usize].axis == quads[other as usize].axis
        {
            faces.unite(one, other);
        }
    }
    let mut first = HashMap::new();
    (0..quads.len() as u32)
        .map(|quad| *first.entry(faces.find(quad)).or_insert(quad))
        .collect()
}

/// A quad that a hexahedron of a sheet is laid below: on its side away from the normal.
#[derive(Debug, Clone, Copy)]
struct SheetQuad {
    quad: GridQuad,
    /// Its index among the quads of the boundary; `None` inside the solid.
    index: Option<usize>,
}

impl SheetQuad {
    fn on_boundary(quads: &[GridQuad], index: usize) -> Self {
        Self {
            quad: quads[index],
            index: Some(index),
        }
    }
}

/// A sheet, and which hexahedra are on its inner side: all of them where it is below boundary quads alone.
struct Sheet {
    quads: Vec<SheetQuad>,
    core: Option<Vec<bool>>,
}

/// A mesh of hexahedra in which sheets are laid.
struct SheetedMesh {
    grid: HexGrid,
    /// The face of the polycube that each boundary quad lies in.
    face_of: Vec<u32>,
}

/// The hexahedra on both sides of each face, by its sorted corners.
type HexesAtFaces = HashMap<[u32; 4], [Option<u32>; 2]>;

impl SheetedMesh {
    fn of(grid: HexGrid) -> Self {
        let face_of = vec![0; grid.quads.len()];
        Self { grid, face_of }
    }

    /// The sheet below these faces, with what it goes on to inside; `None` where it would cross itself or end inside.
    fn sheet_below(&self, faces: &[u32]) -> Option<Sheet> {
        let HexGrid { hexes, quads, .. } = &self.grid;
        let is_padded = |quad: u32| faces.contains(&self.face_of[quad as usize]);
        let below = (0..quads.len()).filter(|&quad| is_padded(quad as u32));
        let mut sheet: Vec<SheetQuad> = below.map(|quad| SheetQuad::on_boundary(quads, quad)).collect();
        let left_of = left_of(quads);
        let continues_inside = |one: u32, other: u32| !is_padded(other) && is_reentrant(&self.grid, one, other);
        let starts: Vec<(u32, [u32; 2])> = sheet
            .iter()
            .filter_map(|of_sheet| of_sheet.index)
            .flat_map(|quad| edges(quads[quad].nodes).map(|edge| (quad as u32, edge)))
            .filter(|(quad, [a, b])| {
                left_of
                    .get(&[*b, *a])
                    .is_some_and(|other| continues_inside(*quad, *other))
            })
            .collect();
        if starts.is_empty() {
            return Some(Sheet {
                quads: sheet,
                core: None,
            });
        }
        let at_faces = hexes_at_faces(hexes);
        let of_face: HashMap<[u32; 4], u32> = quads
            .iter()
            .zip(0..)
            .map(|(quad, index)| (sorted(quad.nodes), index))
            .collect();
        let mut inside: BTreeMap<[u32; 4], SheetQuad> = BTreeMap::new();
        for (start, edge) in starts {
            let from = quads[start as usize];
            let mut edge = edge;
            let mut hex = from.hex;
            let mut above = sorted(from.nodes);
            loop {
                // The face of the hexahedron at the edge across the sheet, and the hexahedron beyond it.
                let across = face_at(hexes[hex as usize], edge, above)?;
                let Some(next) = beyond(&at_faces, across, hex) else {
                    // Here the sheet ends on the boundary.
                    break;
                };
                let quad = face_at(hexes[next as usize], edge, sorted(across))?;
                if let Some(&found) = of_face.get(&sorted(quad)) {
                    // It goes on below another face, if that has a layer.
                    if is_padded(found) { break } else { return None }
                }
                let nodes = facing(quad, edge)?;
                let found = inside.insert(
                    sorted(quad),
                    SheetQuad {
                        quad: GridQuad {
                            nodes,
                            hex: next,
                            ..from
                        },
                        index: None,
                    },
                );
                if let Some(found) = found {
                    // Met before, from the other end.
                    if (found.quad.axis, found.quad.side) != (from.axis, from.side) {
                        return None;
                    }
                    break;
                }
                edge = [nodes[2], nodes[3]];
                (hex, above) = (next, sorted(quad));
            }
        }
        sheet.extend(inside.values());
        let core = core(hexes.len(), &sheet, &at_faces, &inside)?;
        Some(Sheet {
            quads: sheet,
            core: Some(core),
        })
    }

    /// Lays a sheet; `None`, and the mesh is of no use any more, where it ends inside the solid or has three quads at an edge.
    fn insert(&mut self, sheet: &Sheet) -> Option<()> {
        let is_core = |hex: u32| sheet.core.as_ref().is_none_or(|core| core[hex as usize]);
        let left_of_boundary = left_of(&self.grid.quads);
        let mut left_of_sheet = HashMap::new();
        for (of_sheet, index) in sheet.quads.iter().zip(0..) {
            for edge in edges(of_sheet.quad.nodes) {
                if left_of_sheet.insert(edge, index).is_some() {
                    return None;
                }
            }
        }
        // How far nodes move inward from quads that face down and up each axis. Where there are quads of both kinds no position suits
        // all of them, and cells there are flat or inverted in the domain itself (`RemeshReport::invalid_in_domain`); a map that
        // flattens the corner makes them positive.
        let mut depths: BTreeMap<u32, [[f64; 2]; 3]> = BTreeMap::new();
        for SheetQuad { quad, .. } in &sheet.quads {
            for v in quad.nodes {
                // The thinnest of several hexahedra below quads across this axis decides.
                let inset = &mut depths.entry(v).or_default()[quad.axis][quad.side];
                *inset = if *inset == 0.0 {
                    quad.depth
                } else {
                    quad.depth.min(*inset)
                };
            }
        }
        // New nodes take the positions of those on the sheet, which move inward.
        let nodes = &mut self.grid.nodes;
        let mut outer = HashMap::new();
        for (&v, depths) in &depths {
            outer.insert(v, nodes.len() as u32);
            let at = nodes[v as usize];
            nodes.push(at);
            nodes[v as usize] += Vector::from_fn(|k, _| match depths[k] {
                [down, 0.0] => down,
                [0.0, up] => -up,
                _ => 0.0,
            });
        }
        let outside = |v: u32| outer.get(&v).copied().unwrap_or(v);
        if sheet.core.is_some() {
            for (hex, index) in self.grid.hexes.iter_mut().zip(0..) {
                if !is_core(index) {
                    *hex = hex.map(outside);
                }
            }
        }
        let (mut quads, mut face_of) = (Vec::new(), Vec::new());
        let mut hex_below: Vec<u32> = Vec::new();
        for SheetQuad { quad, .. } in &sheet.quads {
            let ([a, b, c, d], [e, f, g, h]) = (quad.nodes, quad.nodes.map(outside));
            hex_below.push(self.grid.hexes.len() as u32);
            self.grid.hexes.push([a, b, c, d, e, f, g, h]);
        }
        // The boundary, quad by quad, and beside those of the sheet the rows where it ends.
        let of_boundary: HashMap<usize, usize> = sheet
            .quads
            .iter()
            .enumerate()
            .filter_map(|(of_sheet, quad)| Some((quad.index?, of_sheet)))
            .collect();
        let ends = |of_sheet: usize, quads: &mut Vec<GridQuad>, faces: &mut Vec<u32>| -> Option<()> {
            for [a, b] in edges(sheet.quads[of_sheet].quad.nodes) {
                if left_of_sheet.contains_key(&[b, a]) {
                    continue;
                }
                // The quad of the face that it ends on, on the sheet's inner side.
                let beside = [[b, a], [a, b]]
                    .into_iter()
                    .filter_map(|edge| left_of_boundary.get(&edge));
                let mut beside = beside.map(|&quad| quad as usize);
                let beside =
                    beside.find(|&quad| !of_boundary.contains_key(&quad) && is_core(self.grid.quads[quad].hex))?;
                quads.push(GridQuad {
                    nodes: [a, b, outside(b), outside(a)],
                    hex: hex_below[of_sheet],
                    ..self.grid.quads[beside]
                });
                faces.push(self.face_of[beside]);
            }
            Some(())
        };
        for (index, quad) in self.grid.quads.iter().enumerate() {
            let (nodes, hex) = match of_boundary.get(&index) {
                Some(&of_sheet) => (quad.nodes.map(outside), hex_below[of_sheet]),
                None if is_core(quad.hex) => (quad.nodes, quad.hex),
                None => (quad.nodes.map(outside), quad.hex),
            };
            quads.push(GridQuad { nodes, hex, ..*quad });
            face_of.push(self.face_of[index]);
            if let Some(&of_sheet) = of_boundary.get(&index) {
                ends(of_sheet, &mut quads, &mut face_of)?;
            }
        }
        for of_sheet in (0..sheet.quads.len()).filter(|&of_sheet| sheet.quads[of_sheet].index.is_none()) {
            ends(of_sheet, &mut quads, &mut face_of)?;
        }
        (self.grid.quads, self.face_of) = (quads, face_of);
        Some(())
    }

    fn bounded(self) -> BoundedMesh {
        let HexGrid { nodes, hexes, quads } = self.grid;
        let mut on_boundary = vec![false; nodes.len()];
        let mut boundary = Vec::with_capacity(2 * quads.len());
        for GridQuad {
            nodes: [a, b, c, d], ..
        } in quads
        {
            [a, b, c, d].iter().for_each(|&v| on_boundary[v as usize] = true);
            boundary.extend([[a, b, c], [a, c, d]]);
        }
        let regions = vec![1; hexes.len()];
        BoundedMesh::new(nodes, CellList::Hexes(hexes), regions, on_boundary, boundary)
    }
}

/// Whether the edge between two quads of the grid's boundary is reentrant: whether the second rises from the first.
pub(super) fn is_reentrant(grid: &HexGrid, one: u32, other: u32) -> bool {
    let [one, other] = [one, other].map(|quad| &grid.quads[quad as usize]);
    if one.axis == other.axis {
        return false;
    }
    let height = |nodes: [u32; 4]| nodes.iter().map(|&v| grid.nodes[v as usize][one.axis]).sum::<f64>();
    let rises = height(other.nodes) - height(one.nodes);
    (rises > 0.0) == (one.side == 1)
}

fn hexes_at_faces(hexes: &[[u32; 8]]) -> HexesAtFaces {
    let mut at_faces = HexesAtFaces::new();
    for (hex, index) in hexes.iter().zip(0..) {
        for face in HEX_FACES.map(|face| sorted(face.map(|k| hex[k]))) {
            let both = at_faces.entry(face).or_insert([None; 2]);
            *both = [Some(index), both[0]];
        }
    }
    at_faces
}

/// The hexahedron on the other side of a face.
fn beyond(at_faces: &HexesAtFaces, face: [u32; 4], hex: u32) -> Option<u32> {
    let both = at_faces.get(&sorted(face))?;
    both.iter().flatten().copied().find(|&other| other != hex)
}

/// The face of a hexahedron that has this edge, other than the given one (by its sorted corners).
fn face_at(hex: [u32; 8], edge: [u32; 2], given: [u32; 4]) -> Option<[u32; 4]> {
    let faces = HEX_FACES.map(|face| face.map(|k| hex[k]));
    let mut found = faces
        .into_iter()
        .filter(|face| edge.iter().all(|v| face.contains(v)) && sorted(*face) != given);
    found.next()
}

/// The corners of a quad in the order in which it has the edge the other way round: first its second end, then its first.
fn facing(quad: [u32; 4], [a, b]: [u32; 2]) -> Option<[u32; 4]> {
    let k = (0..4).find(|&k| quad[k] == b)?;
    let around: [u32; 4] = std::array::from_fn(|i| quad[(k + i) % 4]);
    match around[1] == a {
        true => Some(around),
        false => {
            let [p, q, r, s] = around;
            (s == a).then_some([p, s, r, q])
        }
    }
}

/// The hexahedra on the inner side of a sheet, those that are reached from below it; `None` if that reaches its outer side.
fn core(
    count: usize,
    sheet: &[SheetQuad],
    at_faces: &HexesAtFaces,
    inside: &BTreeMap<[u32; 4], SheetQuad>,
) -> Option<Vec<bool>> {
    let mut neighbours = vec![vec![]; count];
    for (face, both) in at_faces {
        if let [Some(one), Some(other)] = both
            && !inside.contains_key(face)
        {
            neighbours[*one as usize].push(*other);
            neighbours[*other as usize].push(*one);
        }
    }
    let mut is_core = vec![false; count];
    let mut pending: Vec<u32> = sheet.iter().map(|of_sheet| of_sheet.quad.hex).collect();
    while let Some(hex) = pending.pop() {
        if !std::mem::replace(&mut is_core[hex as usize], true) {
            pending.extend(&neighbours[hex as usize]);
        }
    }
    let outer = inside
        .iter()
        .map(|(face, of_sheet)| beyond(at_faces, *face, of_sheet.quad.hex));
    for hex in outer {
        if is_core[hex? as usize] {
            return None;
        }
    }
    Some(is_core)
}

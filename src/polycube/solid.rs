//! A solid on its way to a polycube: tetrahedra with labelled boundary triangles, the model's nodes and their positions in
//! the polycube.

use std::cmp::Ordering;

use nalgebra::Rotation3;
use robust::{Coord, orient2d};

use super::MakePolycubeError;
use super::energy::plane_axes;
use super::face_graph::{Charts, FaceGraph};
use crate::geometry::orientation;
use crate::mesh::topology::DisjointSets;
use crate::mesh::{CellList, CellMesh, TetMesh};
use crate::remesh::{
    BoundedMesh, SharedCoordinates, faces, halve_boundary_edges, halve_edges, is_right_handed,
    split_between_boundary_nodes,
};
use crate::{Point, Vector};

/// A solid and its image. The mesh's nodes are those of the model; labels stand in its `parts`.
#[derive(Debug, Clone)]
pub(super) struct Solid {
    pub mesh: BoundedMesh,
    /// Positions in the polycube.
    pub x: Vec<Point>,
    /// How these are turned against the model where a deformation starts.
    pub turn: Rotation3<f64>,
}

/// Inverted tetrahedra, and boundary triangles that face against their label.
#[derive(Debug, Clone, Default)]
pub(super) struct Inverted {
    pub tets: Vec<u32>,
    pub faces: Vec<u32>,
}

impl Inverted {
    pub fn count(&self) -> usize {
        self.tets.len() + self.faces.len()
    }

    /// Corners of these cells, ascending.
    pub fn nodes(&self, solid: &Solid) -> Vec<u32> {
        let of_tets = self.tets.iter().flat_map(|&t| solid.tets()[t as usize]);
        let of_faces = self.faces.iter().flat_map(|&f| solid.mesh.boundary[f as usize]);
        let mut nodes: Vec<u32> = of_tets.chain(of_faces).collect();
        nodes.sort_unstable();
        nodes.dedup();
        nodes
    }
}

impl Solid {
    /// A mesh with its boundary triangles, without labels. All tetrahedra are made right-handed.
    pub fn new(mesh: TetMesh) -> Result<Self, MakePolycubeError> {
        let (nodes, mut tets) = mesh.into_parts();
        if tets.is_empty() {
            return Err(MakePolycubeError::Empty);
        }
        if let Some(node) = nodes.iter().position(|p| !p.iter().all(|x| x.is_finite())) {
            return Err(MakePolycubeError::NotFinite(node));
        }
        for (index, t) in (0..).zip(&mut tets) {
            if !is_right_handed(&nodes, *t) {
                t.swap(2, 3);
            }
            if !is_right_handed(&nodes, *t) {
                return Err(MakePolycubeError::Flat(index));
            }
        }
        let regions = vec![0; tets.len()];
        let cells = CellMesh::new(nodes.clone(), CellList::Tets(tets), regions)?;
        let found = faces(cells.cells());
        let mut mesh = BoundedMesh::of(cells, &found);
        mesh.parts = vec![0; mesh.boundary.len()];
        Ok(Self {
            mesh,
            x: nodes,
            turn: Rotation3::identity(),
        })
    }

    /// The solid where a deformation starts, turned. The model's own nodes stay as they are.
    pub fn turned(&self, turn: Rotation3<f64>) -> Self {
        let mut turned = self.clone();
        if turn != Rotation3::identity() {
            turned.x = self.mesh.nodes.iter().map(|p| turn * p).collect();
            turned.turn = turn;
        }
        turned
    }

    pub fn tets(&self) -> &[[u32; 4]] {
        match &self.mesh.cells {
            CellList::Tets(tets) => tets,
            CellList::Hexes(_) => &[],
        }
    }

    pub fn labels(&self) -> Vec<u8> {
        (0..self.mesh.boundary.len()).map(|f| self.label(f)).collect()
    }

    pub fn label(&self, face: usize) -> u8 {
        (self.mesh.parts[face] % 6) as u8
    }

    pub fn set_labels(&mut self, labels: &[u8]) {
        self.mesh.parts = labels.iter().map(|&label| i32::from(label)).collect();
    }

    /// Splits what lies between boundary nodes. Returns how many tetrahedra that added.
    pub fn split_between_boundary_nodes(&mut self, most: usize) -> usize {
        split_between_boundary_nodes(&mut self.mesh, &mut self.x, most)
    }

    /// Splits edges of the boundary and inner edges at their midpoints. Returns how many tetrahedra that added.
    pub fn split_edges(&mut self, boundary: &[[u32; 2]], inner: &[[u32; 2]], most: usize) -> usize {
        let before = self.tets().len();
        halve_boundary_edges(&mut self.mesh, &mut self.x, boundary, most);
        let room = most.saturating_sub(self.tets().len() - before);
        halve_edges(&mut self.mesh, &mut self.x, inner, room);
        self.tets().len() - before
    }

    /// The edges of the boundary within a chart whose two ends are on borders, which the polycube would flatten; and the
    /// edge across from a corner at which a chart has a single triangle.
    pub fn surface_edges_to_split(&self, graph: &FaceGraph, charts: &Charts) -> Vec<[u32; 2]> {
        let labels = self.labels();
        let mut on_border = vec![false; self.x.len()];
        for (face, corners) in graph.triangles.iter().enumerate() {
            for k in 0..3 {
                let other = graph.neighbours[face][k] as usize;
                if charts.of_face[other] != charts.of_face[face] {
                    on_border[corners[k] as usize] = true;
                    on_border[corners[(k + 1) % 3] as usize] = true;
                }
            }
        }
        let mut edges = vec![];
        for (face, corners) in graph.triangles.iter().enumerate() {
            for k in 0..3 {
                let [a, b] = [corners[k], corners[(k + 1) % 3]];
                let other = graph.neighbours[face][k] as usize;
                let same = labels[other] == labels[face];
                if same && on_border[a as usize] && on_border[b as usize] {
                    edges.push([a.min(b), a.max(b)]);
                }
                // Both edges at corner `a` are borders: the edge across is split, so that the corner can be a right angle
                // between two triangles.
                let before = graph.neighbours[face][(k + 2) % 3] as usize;
                let across = graph.neighbours[face][(k + 1) % 3] as usize;
                if !same && labels[before] != labels[face] && labels[across] == labels[face] {
                    let [b, c] = [corners[(k + 1) % 3], corners[(k + 2) % 3]];
                    edges.push([b.min(c), b.max(c)]);
                }
            }
        }
        edges.sort_unstable();
        edges.dedup();
        edges
    }

    /// The edges at and around the nodes of inverted cells: of the boundary, and inner ones.
    pub fn edges_around(&self, inverted: &Inverted) -> (Vec<[u32; 2]>, Vec<[u32; 2]>) {
        let nodes = inverted.nodes(self);
        let has = |v: &u32| nodes.binary_search(v).is_ok();
        let pairs = |corners: &[u32]| -> Vec<[u32; 2]> {
            let mut pairs = vec![];
            for (i, &a) in corners.iter().enumerate() {
                pairs.extend(corners[..i].iter().map(|&b| [a.min(b), a.max(b)]));
            }
            pairs
        };
        let outer = self.mesh.boundary.iter().flat_map(|f| pairs(f));
        let outer = outer.filter(|[a, b]| has(a) && has(b));
        let inner = self
            .tets()
            .iter()
            .flat_map(|t| pairs(t))
            .filter(|[a, b]| has(a) || has(b));
        let unique = |mut edges: Vec<[u32; 2]>| {
            edges.sort_unstable();
            edges.dedup();
            edges
        };
        (unique(outer.collect()), unique(inner.collect()))
    }

    /// What is inverted, exactly.
    pub fn inverted(&self) -> Inverted {
        let tets = (0..).zip(self.tets()).filter(|(_, t)| !is_right_handed(&self.x, **t));
        let faces = (0..).zip(&self.mesh.boundary);
        let faces = faces.filter(|(f, corners)| !self.faces_along(**corners, self.label(*f as usize)));
        Inverted {
            tets: tets.map(|(t, _)| t).collect(),
            faces: faces.map(|(f, _)| f).collect(),
        }
    }

    /// Whether a triangle faces along its label, exactly.
    fn faces_along(&self, corners: [u32; 3], label: u8) -> bool {
        let [u, v] = plane_axes(label);
        let [a, b, c] = corners.map(|node| {
            let p = &self.x[node as usize];
            Coord { x: p[u], y: p[v] }
        });
        orient2d(a, b, c).partial_cmp(&0.0) == Some(Ordering::Greater)
    }

    /// Connected parts of the solid that lie within another in the polycube, where no boundaries cross and nothing is
    /// inverted: each then has a tetrahedron whose centre is in more than one. Linear in the tetrahedra for every part.
    pub fn nested_parts(&self) -> usize {
        let mut sets = DisjointSets::new(self.x.len());
        for [a, b, c, d] in self.tets() {
            [b, c, d].into_iter().for_each(|&other| sets.unite(*a, other));
        }
        let mut seen = vec![false; self.x.len()];
        let mut is_first = |t: &&[u32; 4]| !std::mem::replace(&mut seen[sets.find(t[0]) as usize], true);
        let firsts: Vec<[u32; 4]> = self.tets().iter().filter(|t| is_first(t)).copied().collect();
        if firsts.len() < 2 {
            return 0;
        }
        let corners = |t: &[u32; 4]| t.map(|v| self.x[v as usize]);
        let has = |t: &[u32; 4], p: Point| {
            (0..4).all(|k| {
                let mut face = corners(t);
                face[k] = p;
                orientation(&face[0], &face[1], &face[2], &face[3]) != Some(Ordering::Less)
            })
        };
        let is_nested = |first: &&[u32; 4]| {
            let centre = Point::from(corners(first).iter().map(|p| p.coords).sum::<Vector>() / 4.0);
            self.tets().iter().filter(|t| has(t, centre)).count() > 1
        };
        firsts.iter().filter(is_nested).count()
    }

    /// Whether all nodes of every plane have the same coordinate, bit for bit.
    pub fn is_flat(&self, planes: &SharedCoordinates) -> bool {
        planes.equal.iter().all(|(axis, nodes)| {
            let first = nodes.first().map(|&v| self.x[v as usize][*axis].to_bits());
            nodes
                .iter()
                .all(|&v| Some(self.x[v as usize][*axis].to_bits()) == first)
        })
    }
}

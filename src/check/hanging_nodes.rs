//! Where cells do not fit together: vertices inside a face or an edge of a cell that does not name them, where cells of
//! different size meet; faces that lie on one another with other corners.

use rayon::prelude::*;

use super::anatomy::is_finite;
use crate::geometry::{Aabb, Bvh, closest_point_on_triangle};
use crate::mesh::{CellFace, CellMesh, outer, sorted};
use crate::{Point, Vector};

/// A vertex this close to a face, as a fraction of the face's longest edge, lies on it.
const ON_FACE: f64 = 1e-6;
/// Rounding of coordinates that were once in single precision, as a fraction of them; it counts up to [`MOST_ROUNDING`].
const SINGLE_PRECISION: f64 = 1.2e-7;
/// Most that rounding adds, as a fraction of the face's longest edge.
const MOST_ROUNDING: f64 = 1e-3;

/// A face that belongs to one cell only.
struct OuterFace {
    cell: u32,
    /// Its vertices, the fourth only of a quad.
    vertices: [u32; 3],
    fourth: Option<u32>,
    corners: Vec<Point>,
    tolerance: f64,
}

/// Vertices of the boundary that lie inside another boundary face, or inside one of its edges, each with the cell of the
/// first such face; ascending. Faces that two cells share cannot have such vertices unless cells overlap. `faces` are
/// those of all cells, sorted.
pub(super) fn hanging_nodes(mesh: &CellMesh, faces: &[CellFace]) -> Vec<[u32; 2]> {
    let outer: Vec<OuterFace> = outer(faces).filter_map(|face| OuterFace::of(mesh, face)).collect();
    let mut vertices: Vec<u32> = outer.iter().flat_map(OuterFace::vertices).collect();
    vertices.par_sort_unstable();
    vertices.dedup();
    let boxes: Vec<Aabb> = outer.iter().map(OuterFace::bounds).collect();
    let tree = Bvh::new(&boxes);
    let is_face = |nodes: [u32; 3]| {
        let [a, b, c] = nodes;
        let key = sorted([a, b, c, u32::MAX]);
        faces.binary_search_by_key(&key, |face| face.nodes).is_ok()
    };
    let first = |&v: &u32| {
        let p = &mesh.nodes()[v as usize];
        let mut found: Option<u32> = None;
        visit_boxes_with(&tree, p, |item| {
            let face = &outer[item as usize];
            if found.is_none_or(|cell| face.cell < cell)
                && !mesh.cells().corners(face.cell as usize).contains(&v)
                && face.has_inside(p, |a, b| is_face([a, b, v]))
            {
                found = Some(face.cell);
            }
        });
        found.map(|cell| [v, cell])
    };
    vertices.par_iter().filter_map(first).collect()
}

/// Pairs of boundary faces that overlap though they are not the same: a square that one pair of tetrahedra cuts along the
/// other diagonal than the pair behind it, and faces of hexahedra of which one has its corners in a wrong order. Either
/// share two vertices or more and lie on one another; or they are quads that share three. `faces` are those of all cells,
/// sorted; each face is in the first of its pairs only.
pub(super) fn mismatched_faces(mesh: &CellMesh, faces: &[CellFace]) -> Vec<[u32; 2]> {
    let outer: Vec<OuterFace> = outer(faces).filter_map(|face| OuterFace::of(mesh, face)).collect();
    let boxes: Vec<Aabb> = outer.iter().map(OuterFace::bounds).collect();
    let tree = Bvh::new(&boxes);
    let on_another = |face: &OuterFace| {
        let centre = face.centre();
        let mut found: Option<u32> = None;
        visit_boxes_with(&tree, &centre, |item| {
            let other = &outer[item as usize];
            if other.cell != face.cell
                && found.is_none_or(|cell| other.cell < cell)
                && face.shared_with(other) >= 2
                && other.is_on(&centre)
            {
                found = Some(other.cell);
            }
        });
        found.map(|cell| [face.cell, cell])
    };
    let mut pairs: Vec<[u32; 2]> = outer.par_iter().filter_map(on_another).collect();

    let threes = |face: &OuterFace| {
        let v: Vec<u32> = face.vertices().collect();
        let of_quad = (v.len() == 4).then(|| [[0, 1, 2], [0, 1, 3], [0, 2, 3], [1, 2, 3]].map(|k| k.map(|k| v[k])));
        let cell = face.cell;
        of_quad.into_iter().flatten().map(move |mut three| {
            three.sort_unstable();
            (three, cell)
        })
    };
    let mut shared: Vec<([u32; 3], u32)> = outer.iter().flat_map(threes).collect();
    shared.par_sort_unstable();
    let groups = shared.chunk_by(|a, b| a.0 == b.0);
    pairs.extend(groups.flat_map(|group| group.windows(2).map(|two| [two[0].1, two[1].1])));
    pairs.retain(|[a, b]| a != b);
    pairs.iter_mut().for_each(|pair| pair.sort_unstable());
    pairs.sort_unstable();
    pairs.dedup();
    pairs
}

/// Calls `visit` with every item of the tree in a leaf whose box contains the point.
fn visit_boxes_with(tree: &Bvh, p: &Point, mut visit: impl FnMut(u32)) {
    let (nodes, mut at) = (tree.nodes(), 0);
    while let Some(node) = nodes.get(at) {
        if !node.bounds.contains(p) {
            at += node.size();
            continue;
        }
        at += 1;
        if node.is_leaf() {
            tree.order()[node.items()].iter().for_each(|&item| visit(item));
        }
    }
}

impl OuterFace {
    /// `None` unless all corners are finite, and so near each other that distances are.
    fn of(mesh: &CellMesh, face: &CellFace) -> Option<Self> {
        let (vertices, fourth) = face.corners(mesh.cells());
        let corners: Vec<Point> = vertices
            .into_iter()
            .chain(fourth)
            .map(|v| mesh.nodes()[v as usize])
            .collect();
        let count = corners.len();
        let longest = (0..count)
            .map(|k| (corners[k] - corners[(k + 1) % count]).norm())
            .fold(0.0, f64::max);
        let magnitude = corners.iter().map(|p| p.coords.amax()).fold(0.0, f64::max);
        let rounding = (SINGLE_PRECISION * magnitude).min(MOST_ROUNDING * longest);
        let tolerance = rounding.max(ON_FACE * longest);
        (corners.iter().all(is_finite) && tolerance.is_finite()).then_some(Self {
            cell: face.cell,
            vertices,
            fourth,
            corners,
            tolerance,
        })
    }

    fn vertices(&self) -> impl Iterator<Item = u32> + use<> {
        self.vertices.into_iter().chain(self.fourth)
    }

    fn centre(&self) -> Point {
        Point::from(self.corners.iter().map(|p| p.coords).sum::<Vector>() / self.corners.len() as f64)
    }

    /// How many vertices both faces have.
    fn shared_with(&self, other: &Self) -> usize {
        self.vertices().filter(|&v| other.vertices().any(|w| v == w)).count()
    }

    fn bounds(&self) -> Aabb {
        let around = Aabb::around(&self.corners);
        Aabb {
            low: around.low - Vector::repeat(self.tolerance),
            high: around.high + Vector::repeat(self.tolerance),
        }
    }

    /// Whether a point lies on the face, away from its corners. Where it lies on an edge, `is_triangle` says whether the
    /// ends of the edge and the point are a face: then that is a needle, and the cells fit together.
    fn has_inside(&self, p: &Point, is_triangle: impl Fn(u32, u32) -> bool) -> bool {
        let near = |q: &Point| (q - p).norm() <= self.tolerance;
        if self.corners.iter().any(near) {
            return false;
        }
        let vertices: Vec<u32> = self.vertices().collect();
        let count = vertices.len();
        for k in 0..count {
            let next = (k + 1) % count;
            if self.is_on_triangle(p, [self.corners[k], self.corners[next], self.corners[k]]) {
                return !is_triangle(vertices[k], vertices[next]);
            }
        }
        self.is_on(p)
    }

    /// Whether a point lies on the face.
    fn is_on(&self, p: &Point) -> bool {
        match self.corners[..] {
            [a, b, c] => self.is_on_triangle(p, [a, b, c]),
            [a, b, c, d] => {
                self.is_on_triangle(p, [a, b, c]) || self.is_on_triangle(p, [a, c, d]) || self.is_on_bilinear(p)
            }
            _ => false,
        }
    }

    fn is_on_triangle(&self, p: &Point, corners: [Point; 3]) -> bool {
        closest_point_on_triangle(p, &corners).offset.norm() <= self.tolerance
    }

    /// Whether a point lies on the bilinear face of a hexahedron, which two triangles meet only at its edges unless it is
    /// planar. By Gauss-Newton steps from the middle: faces that are so warped that these fail are not examined.
    fn is_on_bilinear(&self, p: &Point) -> bool {
        let [a, b, c, d] = [0, 1, 2, 3].map(|k| self.corners[k].coords);
        let (along_u, along_v, twist) = (b - a, d - a, a - b + c - d);
        if twist.norm() <= self.tolerance {
            return false;
        }
        let (mut u, mut v) = (0.5, 0.5);
        for _ in 0..20 {
            let offset = a + along_u * u + along_v * v + twist * (u * v) - p.coords;
            if offset.norm() <= self.tolerance {
                return true;
            }
            let (du, dv) = (along_u + twist * v, along_v + twist * u);
            let (uu, uv, vv) = (du.norm_squared(), du.dot(&dv), dv.norm_squared());
            let (ru, rv) = (du.dot(&offset), dv.dot(&offset));
            let det = uu * vv - uv * uv;
            u = (u - (vv * ru - uv * rv) / det).clamp(0.0, 1.0);
            v = (v - (uu * rv - uv * ru) / det).clamp(0.0, 1.0);
            if !(u.is_finite() && v.is_finite()) {
                return false;
            }
        }
        false
    }
}

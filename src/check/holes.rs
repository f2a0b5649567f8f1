//! Small holes closed with triangles over the vertices of their rims.
//!
//! Among all triangulations of a rim the one of least area, and where areas agree of shortest sides, by dynamic
//! programming: Barequet & Sharir, *Filling gaps in the boundary of a polyhedron*, Computer Aided Geometric Design 12
//! (1995). No vertex is added, so that meshes over the same vertices take the same triangles.

use std::collections::{HashMap, HashSet};

use serde::Serialize;

use crate::mesh::topology::Topology;
use crate::mesh::{SurfaceMesh, triangle_area};

/// Fraction of the surface's area that the triangles over all holes may have: larger holes are missing parts of the
/// model.
const MAX_AREA: f64 = 0.01;
/// Weight of the square of a triangle's longest side against its area: enough to choose well-shaped triangles in a
/// plane.
const LONG: f64 = 0.01;

/// The most edges that a rim may have: with `n` edges its triangulation takes `16 n²` bytes and time of order `n³`.
pub const MOST_RIM_EDGES: usize = 1000;

/// A hole that has been closed.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ClosedHole {
    /// The vertices around it, in order.
    pub rim: Vec<u32>,
    /// Length of the rim.
    pub length: f64,
    /// Area of the triangles that close it.
    pub area: f64,
}

/// Why holes were left open.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum HoleError {
    /// More edges are allowed than can be triangulated.
    #[error("cannot close holes of up to {asked} edges; allow at most {MOST_RIM_EDGES}")]
    LimitTooHigh {
        /// Edges that are allowed.
        asked: usize,
    },
    /// A rim of too many edges.
    #[error(
        "a hole of {edges} edges begins at vertex {vertex}, and holes of up to {most} edges are closed; repair it in a \
         mesh editor"
    )]
    TooManyEdges {
        /// Edges of its rim.
        edges: usize,
        /// Edges that are allowed.
        most: usize,
        /// A vertex of the rim.
        vertex: u32,
    },
    /// The closing triangles would be too large a part of the surface.
    #[error(
        "closing the holes would add {:.1} % to the surface's area, and at most 1 % is added; repair the surface in a \
         mesh editor",
        100.0 * .share
    )]
    TooLarge {
        /// Their part of the area.
        share: f64,
    },
    /// A rim that is not a loop, or cannot be triangulated without using an edge of other triangles again.
    #[error(
        "the open edges at vertex {vertex} do not go around a hole that triangles could close; repair it in a mesh \
         editor"
    )]
    NoHole {
        /// A vertex of the open edges.
        vertex: u32,
    },
}

/// The surface with all its holes closed by triangles over the vertices of their rims, appended and oriented like the
/// triangles around them; and the holes, if there were any.
///
/// Closes holes of up to `most_edges` edges each ([`MOST_RIM_EDGES`] at most), with together up to a hundredth of the
/// surface's area; the cost grows with the cube of the edges. Vertices stay as they are, also those that are not
/// finite.
///
/// # Errors
///
/// [`HoleError`] for the first hole that stays open; nothing is closed then.
pub fn close_holes(mesh: &SurfaceMesh, most_edges: usize) -> Result<(SurfaceMesh, Vec<ClosedHole>), HoleError> {
    if most_edges > MOST_RIM_EDGES {
        return Err(HoleError::LimitTooHigh { asked: most_edges });
    }
    let topology = Topology::new(mesh);
    let open: HashSet<[u32; 2]> = topology.open_edges().into_iter().collect();
    let mut triangles = mesh.triangles().to_vec();
    let mut holes = Vec::new();
    let mut taken: HashSet<[u32; 2]> = topology.edges().iter().copied().collect();
    for rim in topology.boundary_loops().into_iter().flat_map(simple) {
        let vertex = rim.first().copied().unwrap_or_default();
        if rim.len() > most_edges {
            let (edges, most) = (rim.len(), most_edges);
            return Err(HoleError::TooManyEdges { edges, most, vertex });
        }
        let sides = || (0..rim.len()).map(|k| [rim[k], rim[(k + 1) % rim.len()]]);
        if rim.len() < 3 || sides().any(|[a, b]| !open.contains(&[a.min(b), a.max(b)])) {
            return Err(HoleError::NoHole { vertex });
        }
        let patch = cheapest(mesh, &rim, &taken).ok_or(HoleError::NoHole { vertex })?;
        for &[a, b, c] in &patch {
            taken.extend([[a, b], [b, c], [c, a]].map(|[p, q]| [p.min(q), p.max(q)]));
        }
        let position = |v: u32| mesh.vertices()[v as usize];
        holes.push(ClosedHole {
            length: sides().map(|[a, b]| (position(a) - position(b)).norm()).sum(),
            area: patch.iter().map(|t| triangle_area(&t.map(position))).sum(),
            rim,
        });
        triangles.extend(patch);
    }
    let share = holes.iter().map(|hole| hole.area).sum::<f64>() / mesh.area();
    if share > MAX_AREA {
        return Err(HoleError::TooLarge { share });
    }
    let closed = SurfaceMesh::new(mesh.vertices().to_vec(), triangles).expect("the rims are of the mesh's vertices");
    Ok((closed, holes))
}

/// Splits a rim into loops that visit no vertex twice: holes that touch in a vertex have one boundary loop.
fn simple(rim: Vec<u32>) -> Vec<Vec<u32>> {
    let mut loops = Vec::new();
    let mut walked: Vec<u32> = Vec::new();
    let mut place = HashMap::new();
    for vertex in rim {
        if let Some(&before) = place.get(&vertex) {
            let around = walked.split_off(before);
            for v in &around {
                place.remove(v);
            }
            loops.push(around);
        }
        place.insert(vertex, walked.len());
        walked.push(vertex);
    }
    loops.push(walked);
    loops
}

/// The triangles of least cost over a rim, none of whose inner edges is taken; `None` where there are none.
fn cheapest(mesh: &SurfaceMesh, rim: &[u32], taken: &HashSet<[u32; 2]>) -> Option<Vec<[u32; 3]>> {
    let n = rim.len();
    let is_free = |i: usize, j: usize| {
        let (a, b) = (rim[i].min(rim[j]), rim[i].max(rim[j]));
        j == i + 1 || (i == 0 && j == n - 1) || (a != b && !taken.contains(&[a, b]))
    };
    let cost = |triangle: [u32; 3]| {
        let corners = triangle.map(|v| mesh.vertices()[v as usize]);
        let [a, b, c] = &corners;
        let sides = [a - b, b - c, c - a].map(|side| side.norm_squared());
        triangle_area(&corners) + LONG * sides.into_iter().fold(0.0, f64::max)
    };
    // Least cost of the part of the rim from `i` to `j`, and the vertex that it is split at.
    let mut least = vec![(0.0, 0); n * n];
    for gap in 2..n {
        for i in 0..n - gap {
            let j = i + gap;
            let split = |k: usize| least[i * n + k].0 + least[k * n + j].0 + cost([rim[i], rim[k], rim[j]]);
            let best = (i + 1..j).map(|k| (split(k), k)).min_by(|a, b| a.0.total_cmp(&b.0));
            least[i * n + j] = best.filter(|_| is_free(i, j)).unwrap_or((f64::INFINITY, 0));
        }
    }
    if !least[n - 1].0.is_finite() {
        return None;
    }
    let mut triangles = Vec::with_capacity(n - 2);
    let mut parts = vec![(0, n - 1)];
    while let Some((i, j)) = parts.pop() {
        if j > i + 1 {
            let k = least[i * n + j].1;
            triangles.push([rim[i], rim[k], rim[j]]);
            parts.extend([(i, k), (k, j)]);
        }
    }
    Some(triangles)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::check::check;
    use crate::mesh::shapes;

    /// The mesh without these triangles.
    fn without(mesh: &SurfaceMesh, gone: &[usize]) -> SurfaceMesh {
        let kept = mesh.triangles().iter().enumerate().filter(|(t, _)| !gone.contains(t));
        SurfaceMesh::new(mesh.vertices().to_vec(), kept.map(|(_, &t)| t).collect()).unwrap()
    }

    #[test]
    fn a_missing_triangle_comes_back() {
        let sphere = shapes::sphere(1.0, 3);
        let (closed, holes) = close_holes(&without(&sphere, &[7, 500]), 16).unwrap();
        assert_eq!(holes.len(), 2);
        assert!(check(&closed, None).is_solvable());
        assert!((closed.volume() - sphere.volume()).abs() < 1e-14);
        assert_eq!(closed.vertices(), sphere.vertices());
        // The first two triangles touch in a vertex.
        let (closed, holes) = close_holes(&without(&sphere, &[0, 1]), 16).unwrap();
        assert_eq!(holes.len(), 2);
        assert!(check(&closed, None).is_solvable());
    }

    #[test]
    fn a_slit_is_closed_without_touching_the_edges_that_are_there() {
        let cube = shapes::cube(1.0, 12);
        // A row of squares in a face: its rim has vertices that the mesh joins by edges of other triangles.
        let normal = |t: usize| cube.area_vector(t).normalize();
        let middle = |t: usize| cube.corners(t).iter().map(|p| p.coords).sum::<crate::Vector>() / 3.0;
        let (low, _) = cube.bounding_box().unwrap();
        let cell = 1.0 / 12.0;
        let gone: Vec<usize> = (0..cube.triangles().len())
            .filter(|&t| {
                let p = middle(t) - low.coords;
                normal(t).z > 0.9 && (5.0..6.0).contains(&(p.y / cell)) && (2.0..6.0).contains(&(p.x / cell))
            })
            .collect();
        assert_eq!(gone.len(), 8);
        let (closed, holes) = close_holes(&without(&cube, &gone), 16).unwrap();
        assert_eq!((holes.len(), holes[0].rim.len()), (1, 10));
        let report = check(&closed, None);
        assert!(report.is_solvable() && report.findings.is_empty(), "{report}");
        assert!((closed.volume() - 1.0).abs() < 1e-13);
        assert!((holes[0].area - 4.0 * cell * cell).abs() < 1e-13);
    }

    #[test]
    fn holes_that_are_not_small_are_refused() {
        let sphere = shapes::sphere(1.0, 3);
        let cap: Vec<usize> = (0..sphere.triangles().len())
            .filter(|&t| sphere.corners(t)[0].z > 0.5)
            .collect();
        let bowl = without(&sphere, &cap);
        let HoleError::TooManyEdges { edges, .. } = close_holes(&bowl, 8).unwrap_err() else {
            panic!("the rim of a bowl is long")
        };
        assert!(matches!(close_holes(&bowl, edges), Err(HoleError::TooLarge { .. })));
        let (same, holes) = close_holes(&sphere, 8).unwrap();
        assert!(holes.is_empty() && same == sphere);
        let empty = SurfaceMesh::default();
        assert!(close_holes(&empty, 8).unwrap().1.is_empty());
        let lone = SurfaceMesh::new(vec![crate::Point::new(f64::NAN, 0.0, 0.0); 3], vec![[0, 1, 2]]).unwrap();
        let _ = close_holes(&lone, 8);
        let asked = MOST_RIM_EDGES + 1;
        assert_eq!(close_holes(&sphere, asked), Err(HoleError::LimitTooHigh { asked }));
        assert!(close_holes(&sphere, MOST_RIM_EDGES).is_ok());
    }

    #[test]
    fn rims_that_touch_in_a_vertex_are_two_holes() {
        // Two regular tetrahedra with a common tip, each without a face there: two faces are missing, six are left.
        let p = crate::Point::new;
        let tip = p(0.0, 0.0, 0.0);
        let [a, b, c] = [p(1.0, 1.0, 0.0), p(1.0, 0.0, 1.0), p(0.0, 1.0, 1.0)];
        let [d, e, f] = [a, b, c].map(|corner| p(-corner.x, -corner.y, -corner.z));
        let faces = vec![[0, 3, 2], [0, 1, 3], [1, 2, 3], [0, 5, 6], [0, 6, 4], [4, 6, 5]];
        let mesh = SurfaceMesh::new(vec![tip, a, b, c, d, e, f], faces).unwrap();
        let Err(HoleError::TooLarge { share }) = close_holes(&mesh, 8) else {
            panic!("both holes could be closed, but are no small ones")
        };
        assert!((share - 2.0 / 6.0).abs() < 1e-12, "{share}");
    }
}

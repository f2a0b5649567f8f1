//! Rings of boundary nodes that do not wind once about the inner edge that they surround.
//!
//! Where all cells around an edge are right-handed, the nodes of its ring are passed in turn by a half-plane that turns
//! about it. If the boundary map has the ring wind twice, or not at all, an end of the edge would have to pass through the
//! ring: each of its nodes alone may have room, but they cannot get there.

use std::f64::consts::TAU;

use super::bounded_mesh::BoundedMesh;
use super::cells_at_nodes::CellsAtNodes;
use super::quality::at;
use crate::Point;
use crate::mesh::CellList;

/// The corners of a right-handed tetrahedron with each edge first: right-handed, too.
const EDGES_FIRST: [[usize; 4]; 6] = [
    [0, 1, 2, 3],
    [0, 2, 3, 1],
    [0, 3, 1, 2],
    [1, 2, 0, 3],
    [1, 3, 2, 0],
    [2, 3, 0, 1],
];

/// The cells around an inner edge, whose other nodes are all on the boundary and wind about it by other than once.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct WindingRing {
    /// How often, in the sense in which the cells go around; 1 where they fit.
    pub winding: i64,
    pub cells: Vec<u32>,
}

/// The rings at edges of the given tetrahedra, with the nodes at `x`; none for hexahedra.
pub(super) fn winding_rings(mesh: &BoundedMesh, x: &[Point], cells: &[u32]) -> Vec<WindingRing> {
    let CellList::Tets(tets) = &mesh.cells else {
        return vec![];
    };
    let mut edges: Vec<[u32; 2]> = cells
        .iter()
        .flat_map(|&cell| EDGES_FIRST.map(|[a, b, ..]| [a, b].map(|k| tets[cell as usize][k])))
        .map(|[a, b]| [a.min(b), a.max(b)])
        .collect();
    edges.sort_unstable();
    edges.dedup();
    if edges.is_empty() {
        return vec![];
    }
    let cells_at = CellsAtNodes::new(&mesh.cells, mesh.nodes.len());
    let ring = |[a, b]: [u32; 2]| -> Option<WindingRing> {
        let around = cells_at.of(a).iter().filter(|&&cell| tets[cell as usize].contains(&b));
        let cells: Vec<u32> = around.copied().collect();
        let mut sides: Vec<[u32; 2]> = Vec::with_capacity(cells.len());
        for &cell in &cells {
            let t = tets[cell as usize];
            let [i, _, c, d] = EDGES_FIRST
                .into_iter()
                .map(|order| order.map(|k| t[k]))
                .find(|[i, j, ..]| [*i, *j] == [a, b] || [*j, *i] == [a, b])?;
            sides.push(if i == a { [c, d] } else { [d, c] });
        }
        // Around an inner edge every node ends one side and begins the next.
        let [mut begins, mut ends] = [0, 1].map(|k| sides.iter().map(|side| side[k]).collect::<Vec<u32>>());
        begins.sort_unstable();
        ends.sort_unstable();
        if begins != ends || !begins.iter().all(|&v| mesh.on_boundary[v as usize]) {
            return None;
        }
        let winding = turns(
            at(x, a),
            at(x, b),
            &sides.iter().map(|side| side.map(|v| at(x, v))).collect::<Vec<_>>(),
        )?;
        (winding != 1).then_some(WindingRing { winding, cells })
    };
    edges.into_iter().filter_map(ring).collect()
}

/// How often sides go around the line from `a` to `b`; `None` where they do not close, or nodes are missing.
fn turns(a: Point, b: Point, sides: &[[Point; 2]]) -> Option<i64> {
    let axis = (b - a).try_normalize(0.0)?;
    let angle = |[c, d]: &[Point; 2]| {
        let [c, d] = [c, d].map(|p| {
            let from = p - a;
            from - axis * axis.dot(&from)
        });
        axis.dot(&c.cross(&d)).atan2(c.dot(&d))
    };
    let turns = sides.iter().map(angle).sum::<f64>() / TAU;
    let whole = turns.round();
    ((turns - whole).abs() < 1e-6).then_some(whole as i64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::CellMesh;
    use crate::remesh::given_mesh;

    /// Seven tetrahedra around an edge.
    fn ring_of_seven() -> BoundedMesh {
        let mut nodes = vec![Point::new(0.0, 0.0, -1.0), Point::new(0.0, 0.0, 1.0)];
        nodes.extend((0..7).map(|k| on_circle(f64::from(k) / 7.0)));
        let tets = (0..7).map(|k| [0, 1, 2 + k, 2 + (k + 1) % 7]).collect();
        let mesh = CellMesh::new(nodes, CellList::Tets(tets), vec![0; 7]).unwrap();
        let surface = mesh.boundary().surface;
        given_mesh(mesh, &surface).unwrap().mesh
    }

    fn on_circle(turns: f64) -> Point {
        Point::new((TAU * turns).cos(), (TAU * turns).sin(), 0.0)
    }

    #[test]
    fn rings_that_wind_twice_not_at_all_or_backwards_are_named() {
        let mesh = ring_of_seven();
        let all: Vec<u32> = (0..7).collect();
        let found = |turns: &dyn Fn(f64) -> f64| -> Vec<i64> {
            let mut x = mesh.nodes.clone();
            (0..7).for_each(|k| x[2 + k] = on_circle(turns(k as f64 / 7.0)));
            let rings = winding_rings(&mesh, &x, &all);
            assert!(rings.iter().all(|ring| ring.cells == all));
            rings.iter().map(|ring| ring.winding).collect()
        };
        assert!(found(&|t| t).is_empty());
        // Unevenly, and turned.
        assert!(found(&|t| t * t + 0.2).is_empty());
        assert_eq!(found(&|t| 2.0 * t), [2]);
        assert_eq!(found(&|t| -t), [-1]);
        assert_eq!(found(&|t| 0.3 * (TAU * t).sin()), [0]);
        // Edges of the boundary have no ring, whichever cells are asked for.
        assert_eq!(winding_rings(&mesh, &mesh.nodes, &[3]), []);
        let missing = winding_rings(&mesh, &mesh.nodes[..5], &all);
        assert_eq!(missing, []);
    }
}

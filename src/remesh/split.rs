//! Splitting of edges, faces and tetrahedra at their centroids, in the domain and in the image alike.

use std::collections::{HashMap, HashSet};

use super::bounded_mesh::{BoundedMesh, sorted};
use super::quality::is_right_handed;
use crate::mesh::{CellList, TetMesh};
use crate::{Point, Vector};

/// The edge, face or cell at whose centroid a new node is inserted, with ascending corners.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(super) enum SplitSimplex {
    Edge([u32; 2]),
    Face([u32; 3]),
    Cell([u32; 4]),
}

impl SplitSimplex {
    fn edge(a: u32, b: u32) -> Self {
        Self::Edge([a.min(b), a.max(b)])
    }

    fn corners(&self) -> &[u32] {
        match self {
            Self::Edge(corners) => corners,
            Self::Face(corners) => corners,
            Self::Cell(corners) => corners,
        }
    }

    fn dimension(&self) -> usize {
        self.corners().len()
    }
}

/// The edges, the faces and the cell of a tetrahedron.
fn simplices(tet: [u32; 4]) -> impl Iterator<Item = SplitSimplex> {
    let [a, b, c, d] = sorted(tet);
    let edges = [[a, b], [a, c], [a, d], [b, c], [b, d], [c, d]].map(SplitSimplex::Edge);
    let faces = [[a, b, c], [a, b, d], [a, c, d], [b, c, d]].map(SplitSimplex::Face);
    edges.into_iter().chain(faces).chain([SplitSimplex::Cell([a, b, c, d])])
}

/// The edges and triangles of the boundary, which are never split.
fn outer_simplices(mesh: &BoundedMesh) -> HashSet<SplitSimplex> {
    let of_triangle = |t: &[u32; 3]| {
        let [a, b, c] = sorted(*t);
        let edges = [[a, b], [b, c], [a, c]].map(SplitSimplex::Edge);
        edges.into_iter().chain([SplitSimplex::Face([a, b, c])])
    };
    mesh.boundary.iter().flat_map(of_triangle).collect()
}

/// Which nodes of inverted cells are stuck.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum StuckNodes {
    /// Those of cells with all their nodes on the boundary, also where they are not inverted but flat.
    OnBoundary,
    /// All: each has room, but together they cannot get there. Mostly an inner edge is surrounded by edges of the fixed
    /// boundary, which the image winds about it more or less than once. The midpoint of that edge alone would inherit
    /// them, so that all edges at its nodes are split.
    All,
}

/// What to split at the stuck nodes of these inverted cells: all edges at inner nodes, and of cells with boundary nodes
/// what is between these.
pub(super) fn stuck_simplices(mesh: &BoundedMesh, inverted: &[u32], stuck: StuckNodes) -> HashSet<SplitSimplex> {
    let mut found = HashSet::new();
    let CellList::Tets(tets) = &mesh.cells else {
        return found;
    };
    let is_inner = |v: &u32| !mesh.on_boundary[*v as usize];
    let has_inner = |cell: &u32| tets[*cell as usize].iter().any(is_inner);
    let is_stuck = |cell: &&u32| stuck == StuckNodes::All || !has_inner(cell);
    let inverted: Vec<u32> = inverted.iter().filter(is_stuck).copied().collect();
    if inverted.is_empty() {
        return found;
    }
    let outer = outer_simplices(mesh);
    for &cell in &inverted {
        found.extend(between_boundary_nodes(tets[cell as usize], &mesh.on_boundary, &outer));
    }
    let nodes: HashSet<u32> = inverted
        .iter()
        .flat_map(|&cell| tets[cell as usize])
        .filter(is_inner)
        .collect();
    for t in tets {
        for a in t.iter().filter(|v| nodes.contains(v)) {
            found.extend(t.iter().filter(|b| *b != a).map(|&b| SplitSimplex::edge(*a, b)));
        }
    }
    found
}

/// The inner edges of a tetrahedron between boundary nodes, else such faces, else the cell itself if all its nodes are on
/// the boundary: only of the lowest dimension, since what is inside of others is split with them.
fn between_boundary_nodes(tet: [u32; 4], on_boundary: &[bool], outer: &HashSet<SplitSimplex>) -> Vec<SplitSimplex> {
    let is_outside = |simplex: &SplitSimplex| simplex.corners().iter().all(|&v| on_boundary[v as usize]);
    let mut found: Vec<SplitSimplex> = simplices(tet)
        .filter(|simplex| is_outside(simplex) && !outer.contains(simplex))
        .collect();
    if let Some(lowest) = found.iter().map(SplitSimplex::dimension).min() {
        found.retain(|simplex| simplex.dimension() == lowest);
    }
    found
}

/// Splits simplices one after the other, edges first and long ones before short ones, and adds the images of new nodes
/// to each list in `images`. Simplices that an earlier split has cut are left alone, as are those whose parts would not
/// all be right-handed in the domain. Returns how many cells were added, at most about `most`.
pub(super) fn split(
    mesh: &mut BoundedMesh,
    images: &mut [&mut Vec<Point>],
    simplices: impl IntoIterator<Item = SplitSimplex>,
    most: usize,
) -> usize {
    let CellList::Tets(tets) = &mut mesh.cells else {
        return 0;
    };
    let mut wanted: Vec<SplitSimplex> = simplices.into_iter().collect();
    wanted.sort_unstable();
    wanted.dedup();
    let length = |simplex: &SplitSimplex| match *simplex {
        SplitSimplex::Edge([a, b]) => (mesh.nodes[a as usize] - mesh.nodes[b as usize]).norm(),
        _ => 0.0,
    };
    wanted.sort_by(|a, b| (a.dimension().cmp(&b.dimension())).then(length(b).total_cmp(&length(a))));

    let mut cells_at: HashMap<u32, Vec<u32>> = HashMap::new();
    wanted.iter().flat_map(SplitSimplex::corners).for_each(|&v| {
        cells_at.entry(v).or_default();
    });
    for (cell, t) in (0..).zip(tets.iter()) {
        for v in t {
            if let Some(cells) = cells_at.get_mut(v) {
                cells.push(cell);
            }
        }
    }
    let before = tets.len();
    for simplex in wanted {
        let corners = simplex.corners();
        let has_all = |cell: &u32| corners.iter().all(|v| tets[*cell as usize].contains(v));
        let cells: Vec<u32> = cells_at[&corners[0]].iter().copied().filter(has_all).collect();
        if cells.is_empty() || tets.len() - before + cells.len() * (corners.len() - 1) > most {
            continue;
        }
        let new = mesh.nodes.len() as u32;
        // One tetrahedron for each corner of the simplex, with the new node in its place.
        let part = |cell: u32, gone: u32| tets[cell as usize].map(|v| if v == gone { new } else { v });
        mesh.nodes.push(centroid(&mesh.nodes, corners));
        let parts = || {
            cells
                .iter()
                .flat_map(|&cell| corners.iter().map(move |&gone| (cell, gone)))
        };
        let is_sound = |(cell, gone): (u32, u32)| {
            !is_right_handed(&mesh.nodes, tets[cell as usize]) || is_right_handed(&mesh.nodes, part(cell, gone))
        };
        if !parts().all(is_sound) {
            mesh.nodes.pop();
            continue;
        }
        images.iter_mut().for_each(|images| {
            let image = centroid(images, corners);
            images.push(image);
        });
        mesh.on_boundary.push(false);
        for &cell in &cells {
            let whole = tets[cell as usize];
            for (k, &gone) in corners.iter().enumerate() {
                let part = whole.map(|v| if v == gone { new } else { v });
                if k == 0 {
                    tets[cell as usize] = part;
                    if let Some(cells) = cells_at.get_mut(&gone) {
                        cells.retain(|&other| other != cell);
                    }
                } else {
                    let added = tets.len() as u32;
                    part.iter().for_each(|v| {
                        if let Some(cells) = cells_at.get_mut(v) {
                            cells.push(added);
                        }
                    });
                    tets.push(part);
                    mesh.regions.push(mesh.regions[cell as usize]);
                }
            }
        }
    }
    tets.len() - before
}

/// Splits the inner edges and faces with all their nodes on the boundary, and the tetrahedra: images of a boundary that is
/// flat there would be flat. Returns how many cells were added, at most about `most`.
pub(crate) fn split_between_boundary_nodes(mesh: &mut BoundedMesh, x: &mut Vec<Point>, most: usize) -> usize {
    let mut added = 0;
    loop {
        let CellList::Tets(tets) = &mesh.cells else {
            return added;
        };
        let outer = outer_simplices(mesh);
        let between = |t: &[u32; 4]| between_boundary_nodes(*t, &mesh.on_boundary, &outer);
        let simplices: Vec<SplitSimplex> = tets.iter().flat_map(between).collect();
        let now = split(mesh, &mut [x], simplices, most - added);
        added += now;
        if now == 0 {
            return added;
        }
    }
}

/// Splits inner edges at their midpoints, those of the boundary excepted. Returns how many cells were added, at most about
/// `most`.
pub(crate) fn halve_edges(mesh: &mut BoundedMesh, x: &mut Vec<Point>, edges: &[[u32; 2]], most: usize) -> usize {
    let outer = outer_simplices(mesh);
    let edges = edges.iter().map(|&[a, b]| SplitSimplex::edge(a, b));
    let inner: Vec<SplitSimplex> = edges.filter(|edge| !outer.contains(edge)).collect();
    split(mesh, &mut [x], inner, most)
}

/// A mesh with edges divided at their midpoints, one after the other, and all tetrahedra around them. An edge is left alone
/// whose parts are so short that tetrahedra at it would be flat.
pub(crate) fn split_edges(mesh: TetMesh, edges: &HashSet<[u32; 2]>) -> TetMesh {
    let (nodes, tets) = mesh.into_parts();
    let regions = vec![0; tets.len()];
    let on_boundary = vec![false; nodes.len()];
    let mut mesh = BoundedMesh::new(nodes, CellList::Tets(tets), regions, on_boundary, vec![]);
    let edges = edges.iter().map(|&[a, b]| SplitSimplex::edge(a, b));
    split(&mut mesh, &mut [], edges, usize::MAX);
    match mesh.cells {
        CellList::Tets(tets) => TetMesh::new(mesh.nodes, tets).expect("parts name nodes"),
        CellList::Hexes(_) => TetMesh::default(),
    }
}

fn centroid(points: &[Point], corners: &[u32]) -> Point {
    let sum: Vector = corners.iter().map(|&v| points[v as usize].coords).sum();
    Point::from(sum / corners.len() as f64)
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::super::bounded_mesh::faces;
    use super::super::given::given_mesh;
    use super::super::quality::invalid_cells;
    use super::*;
    use crate::Matrix3;
    use crate::baseline::test_meshes;
    use crate::mesh::CellMesh;

    fn bounded(nodes: Vec<Point>, tets: Vec<[u32; 4]>) -> BoundedMesh {
        let regions = (0..tets.len() as i32).map(|cell| cell % 3).collect();
        let mesh = CellMesh::new(nodes, CellList::Tets(tets), regions).unwrap();
        let surface = mesh.boundary().surface;
        given_mesh(mesh, &surface).unwrap().mesh
    }

    fn tets(mesh: &BoundedMesh) -> &[[u32; 4]] {
        match &mesh.cells {
            CellList::Tets(tets) => tets,
            CellList::Hexes(_) => panic!("tetrahedra"),
        }
    }

    /// Volume of each region.
    fn volumes(mesh: &BoundedMesh) -> BTreeMap<i32, f64> {
        let mut volumes = BTreeMap::new();
        for (t, region) in tets(mesh).iter().zip(&mesh.regions) {
            let [a, b, c, d] = t.map(|v| mesh.nodes[v as usize]);
            *volumes.entry(*region).or_insert(0.0) += (b - a).dot(&(c - a).cross(&(d - a))) / 6.0;
        }
        volumes
    }

    fn assert_split_well(mesh: &BoundedMesh, before: &BoundedMesh, images: &[Point], linear: &Matrix3) {
        assert_eq!(mesh.nodes[..before.nodes.len()], before.nodes);
        assert_eq!(mesh.on_boundary.len(), mesh.nodes.len());
        assert!(mesh.on_boundary[before.nodes.len()..].iter().all(|on| !on));
        assert_eq!(invalid_cells(&mesh.cells, &mesh.nodes).cells, [] as [u32; 0]);
        let outside = faces(&mesh.cells);
        let shared = outside.chunk_by(|a, b| a.nodes == b.nodes).map(<[_]>::len);
        assert!(shared.clone().all(|cells| cells <= 2), "conforming");
        assert_eq!(shared.filter(|cells| *cells == 1).count(), mesh.boundary.len());
        for ((region, volume), (other, after)) in volumes(before).into_iter().zip(volumes(mesh)) {
            assert!(region == other && (volume - after).abs() < 1e-13);
        }
        for (p, image) in mesh.nodes.iter().zip(images) {
            assert!((linear * p - image).norm() < 1e-13);
        }
    }

    fn split_stuck(mesh: &BoundedMesh, inverted: &[u32], stuck: StuckNodes, most: usize) -> (BoundedMesh, usize) {
        let (mut split_mesh, linear) = (mesh.clone(), Matrix3::new(1.0, 0.5, 0.0, 0.0, 2.0, 0.1, -0.3, 0.0, 1.5));
        let mut images: Vec<Point> = mesh.nodes.iter().map(|p| linear * p).collect();
        let simplices = stuck_simplices(mesh, inverted, stuck);
        let added = split(&mut split_mesh, &mut [&mut images], simplices, most);
        assert_eq!(split_mesh.cells.len(), mesh.cells.len() + added);
        assert_split_well(&split_mesh, mesh, &images, &linear);
        (split_mesh, added)
    }

    #[test]
    fn tetrahedra_on_the_boundary_alone_are_split_and_regions_stay() {
        // One tetrahedron has no interior edge or face, two that share a face no interior edge; boxes have interior edges.
        let single = [
            [0.0; 3],
            [1.0, 0.0, 0.0],
            [0.0, 1.0, 0.0],
            [0.0, 0.0, 1.0],
            [0.0, 0.0, -1.0],
        ]
        .map(Point::from);
        let [one, two] = [vec![[0, 1, 2, 3]], vec![[0, 1, 2, 3], [0, 2, 1, 4]]];
        let of_cube = |boxes| test_meshes::cube(boxes).into_parts();
        for (nodes, list) in [
            (single[..4].to_vec(), one),
            (single.to_vec(), two),
            of_cube(1),
            of_cube(2),
            of_cube(4),
        ] {
            let mesh = bounded(nodes, list);
            let all: Vec<u32> = (0..mesh.cells.len() as u32).collect();
            let is_alone = |mesh: &BoundedMesh, t: &[u32; 4]| t.iter().all(|&v| mesh.on_boundary[v as usize]);
            assert!(tets(&mesh).iter().any(|t| is_alone(&mesh, t)));
            let (after, added) = split_stuck(&mesh, &all, StuckNodes::OnBoundary, usize::MAX);
            assert!(added > 0 && !tets(&after).iter().any(|t| is_alone(&after, t)));
            assert_eq!(split_stuck(&mesh, &[], StuckNodes::OnBoundary, usize::MAX).1, 0);
        }
    }

    #[test]
    fn all_edges_at_a_stuck_node_are_split_within_the_limit() {
        let (nodes, list) = test_meshes::cube(4).into_parts();
        let mesh = bounded(nodes, list);
        let at = |v: u32| tets(&mesh).iter().filter(move |t| t.contains(&v));
        let inner = (0..).find(|&v| !mesh.on_boundary[v as usize]).unwrap();
        let cell = tets(&mesh).iter().position(|t| t.contains(&inner)).unwrap() as u32;
        let neighbours: HashSet<u32> = at(inner).flatten().copied().filter(|&v| v != inner).collect();
        let (after, added) = split_stuck(&mesh, &[cell], StuckNodes::All, usize::MAX);
        assert!(added >= neighbours.len());
        let has = |a: u32, b: u32| tets(&after).iter().any(|t| t.contains(&a) && t.contains(&b));
        assert!(neighbours.iter().all(|&b| !has(inner, b)));
        let (_, limited) = split_stuck(&mesh, &[cell], StuckNodes::All, 20);
        assert!((1..=20).contains(&limited), "{limited}");
        assert_eq!(split_stuck(&mesh, &[cell], StuckNodes::All, 0).1, 0);
    }
}

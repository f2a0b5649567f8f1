//! A basis of the loops of a closed surface, and the cochains that count crossings with its dual loops.
//!
//! A spanning tree of the edges and one of the triangles that crosses none of its edges leave two edges per handle
//! (Eppstein, *Dynamic generators of topologically embedded graphs*, 2003). Each of them closes a loop through the first
//! tree, and a dual loop through the second; loop `j` crosses dual loop `j` once and no other.

use std::collections::VecDeque;

use crate::mesh::SurfaceMesh;
use crate::mesh::topology::Topology;

/// A loop of the basis with its dual loop.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct HandleLoop {
    /// Vertices along edges.
    pub loop_vertices: Vec<u32>,
    /// Triangles and, after each, the side of it that the dual loop leaves by.
    pub dual: Vec<(u32, usize)>,
    /// For each triangle the crossings of the dual loop with the sides from corner `k` to the next, positive from the left
    /// of the side to its right: a closed cochain. The loop itself has 1.
    pub cochain: Vec<[i32; 3]>,
}

/// The two loops per handle of a closed, consistently oriented, connected surface.
pub(crate) fn handle_loops(surface: &SurfaceMesh) -> Vec<HandleLoop> {
    let topology = Topology::new(surface);
    let triangles = surface.triangles();
    let edges_of = |t: u32| topology.edges_of_triangle(t as usize).expect("three vertices");
    let (parent, mut is_used) = vertex_tree(surface, &topology);

    // The tree of triangles: the triangle before each, and the side of that one between them.
    let mut before: Vec<Option<(u32, usize)>> = vec![None; triangles.len()];
    let mut is_reached = vec![false; triangles.len()];
    let mut queue = VecDeque::from([0u32]);
    is_reached[0] = true;
    while let Some(t) = queue.pop_front() {
        for (side, edge) in edges_of(t).into_iter().enumerate() {
            let next = across(&topology, edge, t);
            if !is_used[edge as usize] && !is_reached[next as usize] {
                (is_used[edge as usize], is_reached[next as usize]) = (true, true);
                before[next as usize] = Some((t, side));
                queue.push_back(next);
            }
        }
    }
    let left_over = (0..topology.edges().len() as u32).filter(|&e| !is_used[e as usize]);
    let of_edge = |edge: u32| {
        let [a, b] = topology.edges()[edge as usize];
        let loop_vertices = closed_through(a, b, &parent);
        let first = topology.sides(edge as usize)[0].triangle;
        let last = across(&topology, edge, first);
        let side_of = |t: u32, edge: u32| edges_of(t).iter().position(|&e| e == edge).unwrap_or(0);
        // From the first triangle over the edge to the last, and back through the tree.
        let mut dual = vec![(first, side_of(first, edge))];
        let (mut up, mut down) = (to_root(last, &before), to_root(first, &before));
        while up.len() > 1 && down.len() > 1 && up[up.len() - 2] == down[down.len() - 2] {
            up.pop();
            down.pop();
        }
        for pair in up.windows(2) {
            let (tree_parent, side) = before[pair[0] as usize].expect("not the root");
            let edge = edges_of(tree_parent)[side];
            dual.push((pair[0], side_of(pair[0], edge)));
        }
        for pair in down.windows(2).rev() {
            dual.push(before[pair[0] as usize].expect("not the root"));
        }
        oriented(
            surface,
            &topology,
            HandleLoop {
                cochain: cochain_of(&topology, &dual, triangles.len()),
                loop_vertices,
                dual,
            },
        )
    };
    left_over.map(of_edge).collect()
}

/// The triangle on the other side of an edge.
fn across(topology: &Topology, edge: u32, triangle: u32) -> u32 {
    let mut sides = topology.sides(edge as usize).iter();
    sides
        .find(|side| side.triangle != triangle)
        .expect("a closed surface")
        .triangle
}

/// The vertex before each in a breadth-first tree, and which edges the tree has.
fn vertex_tree(surface: &SurfaceMesh, topology: &Topology) -> (Vec<Option<u32>>, Vec<bool>) {
    let count = surface.vertices().len();
    let mut neighbours: Vec<Vec<(u32, u32)>> = vec![Vec::new(); count];
    for (e, &[a, b]) in topology.edges().iter().enumerate() {
        neighbours[a as usize].push((b, e as u32));
        neighbours[b as usize].push((a, e as u32));
    }
    let mut parent = vec![None; count];
    let mut is_used = vec![false; topology.edges().len()];
    let root = surface.triangles()[0][0];
    let mut is_reached = vec![false; count];
    is_reached[root as usize] = true;
    let mut queue = VecDeque::from([root]);
    while let Some(v) = queue.pop_front() {
        for &(w, e) in &neighbours[v as usize] {
            if !is_reached[w as usize] {
                (is_reached[w as usize], is_used[e as usize]) = (true, true);
                parent[w as usize] = Some(v);
                queue.push_back(w);
            }
        }
    }
    (parent, is_used)
}

/// The closed walk `a`, `b`, and from there through the tree back to `a`, without the part that it would go twice.
fn closed_through(a: u32, b: u32, parent: &[Option<u32>]) -> Vec<u32> {
    let to_root = |v: u32| -> Vec<u32> { std::iter::successors(Some(v), |&v| parent[v as usize]).collect() };
    let (mut up, mut down) = (to_root(b), to_root(a));
    while up.len() > 1 && down.len() > 1 && up[up.len() - 2] == down[down.len() - 2] {
        up.pop();
        down.pop();
    }
    // Both end at the same vertex.
    down.pop();
    up.extend(down.into_iter().rev());
    up
}

fn to_root(t: u32, before: &[Option<(u32, usize)>]) -> Vec<u32> {
    std::iter::successors(Some(t), |&t| before[t as usize].map(|(parent, _)| parent)).collect()
}

fn cochain_of(topology: &Topology, dual: &[(u32, usize)], triangles: usize) -> Vec<[i32; 3]> {
    let mut cochain = vec![[0; 3]; triangles];
    for &(t, side) in dual {
        let edge = topology.edges_of_triangle(t as usize).expect("three vertices")[side];
        let next = across(topology, edge, t);
        let edges = topology.edges_of_triangle(next as usize).expect("three vertices");
        let back = edges.iter().position(|&e| e == edge).unwrap_or(0);
        cochain[t as usize][side] += 1;
        cochain[next as usize][back] -= 1;
    }
    cochain
}

/// The loop, turned round if its cochain is −1 on it.
fn oriented(surface: &SurfaceMesh, topology: &Topology, mut found: HandleLoop) -> HandleLoop {
    if value_on(surface, topology, &found.cochain, &found.loop_vertices) < 0 {
        found.loop_vertices.reverse();
    }
    found
}

/// How often a closed walk along edges crosses each dual loop, with signs: its homology, as a combination of the loops.
pub(crate) fn crossings_with_duals(surface: &SurfaceMesh, loops: &[HandleLoop], walk: &[u32]) -> Vec<i32> {
    let topology = Topology::new(surface);
    let crossings = loops.iter().map(|one| value_on(surface, &topology, &one.cochain, walk));
    crossings.collect()
}

/// The sum of a cochain along a closed walk over edges.
pub(super) fn value_on(surface: &SurfaceMesh, topology: &Topology, cochain: &[[i32; 3]], walk: &[u32]) -> i32 {
    let next = walk.iter().cycle().skip(1);
    let step = |(&a, &b): (&u32, &u32)| {
        let edge = topology.edges().binary_search(&[a.min(b), a.max(b)]);
        let side = topology.sides(edge.expect("neighbours"))[0];
        let t = side.triangle as usize;
        let k = (0..3).find(|&k| {
            let (from, to) = (surface.triangles()[t][k], surface.triangles()[t][(k + 1) % 3]);
            [from, to] == [a, b] || [from, to] == [b, a]
        });
        let k = k.expect("a side of the triangle");
        match surface.triangles()[t][k] == a {
            true => cochain[t][k],
            false => -cochain[t][k],
        }
    };
    walk.iter().zip(next).map(step).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::shapes;

    #[test]
    fn loops_cross_their_own_dual_loops_once_and_cochains_are_closed() {
        for (surface, handles) in [(shapes::torus(1.0, 0.4, 17, 9), 1), (shapes::double_torus(3), 2)] {
            let loops = handle_loops(&surface);
            assert_eq!(loops.len(), 2 * handles);
            let topology = Topology::new(&surface);
            for (j, own) in loops.iter().enumerate() {
                assert!(own.cochain.iter().all(|sides| sides.iter().sum::<i32>() == 0));
                for (k, other) in loops.iter().enumerate() {
                    let crossings = value_on(&surface, &topology, &other.cochain, &own.loop_vertices);
                    assert_eq!(crossings, i32::from(j == k));
                }
            }
        }
    }
}

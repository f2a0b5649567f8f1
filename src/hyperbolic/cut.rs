//! A surface cut to a polygon: its surface group, and the deck transformations of its triangles.
//!
//! A spanning tree of the edges and one of the triangles that crosses none of its edges leave `2g` edges, the generators. Cut along
//! these and the first tree the surface is a disk, all of whose triangles lie in one copy of the polygon. What crossing an edge of
//! the first tree means follows from its leaves inward: the crossings around a vertex make the identity. At the root they
//! make the relator.

use std::collections::VecDeque;

use super::polygon::SurfaceGroup;
use super::word::{Letter, Word};
use crate::mesh::SurfaceMesh;
use crate::mesh::topology::Topology;

/// A surface group, and for the corners of each triangle the word that takes the vertex's place to that in the triangle's copy of
/// the polygon.
pub(super) struct CutSurface {
    pub group: SurfaceGroup,
    pub corners: Vec<[Word; 3]>,
}

/// The crossings of the sides of each triangle.
struct Crossings<'a> {
    surface: &'a SurfaceMesh,
    topology: Topology<'a>,
    /// For side `k`, from corner `k` to the next: what takes places in the triangle on the other side to those in this one.
    words: Vec<[Word; 3]>,
}

/// A triangle and one of its corners or sides.
type At = (usize, usize);

impl Crossings<'_> {
    fn edge(&self, (t, side): At) -> usize {
        self.topology.edges_of_triangle(t).expect("three vertices")[side] as usize
    }

    /// The same side of the triangle on the other side.
    fn twin(&self, (t, side): At) -> At {
        let edge = self.edge((t, side));
        let sides = self.topology.sides(edge).iter();
        let other = sides.map(|s| s.triangle as usize).find(|&other| other != t);
        let other = other.expect("a closed surface");
        let place = (0..3).find(|&k| self.edge((other, k)) == edge);
        (other, place.expect("a side of both"))
    }

    fn set(&mut self, side: At, word: Word) {
        let (t, k) = self.twin(side);
        self.words[t][k] = word.inverted();
        self.words[side.0][side.1] = word;
    }

    /// The sides crossed on the way around a vertex, counter-clockwise, from the triangle of one of its corners on.
    fn around(&self, (t, corner): At) -> Vec<At> {
        let mut sides = Vec::new();
        let (mut triangle, mut at) = (t, corner);
        loop {
            let side = (triangle, (at + 2) % 3);
            sides.push(side);
            // The same side begins at the vertex there.
            (triangle, at) = self.twin(side);
            if triangle == t {
                return sides;
            }
        }
    }

    fn product(&self, sides: impl Iterator<Item = At>) -> Word {
        sides.fold(Word::default(), |word, (t, k)| word.times(&self.words[t][k]))
    }
}

/// `None` unless the surface is a closed, connected, oriented manifold of genus 2 or more.
pub(super) fn cut(surface: &SurfaceMesh) -> Option<CutSurface> {
    let count = surface.triangles().len();
    let mut crossings = Crossings {
        topology: Topology::new(surface),
        surface,
        words: vec![<[Word; 3]>::default(); count],
    };
    let mut corner_of = vec![None; surface.vertices().len()];
    for (t, corners) in surface.triangles().iter().enumerate() {
        for (k, &v) in corners.iter().enumerate() {
            corner_of[v as usize].get_or_insert((t, k));
        }
    }
    let (order, to_parent) = vertex_tree(&crossings, &corner_of)?;
    let is_tree: Vec<bool> = {
        let mut is_tree = vec![false; crossings.topology.edges().len()];
        to_parent
            .iter()
            .flatten()
            .for_each(|&side| is_tree[crossings.edge(side)] = true);
        is_tree
    };
    let mut letter: Letter = 0;
    for side in left_over(&crossings, is_tree) {
        letter = letter.checked_add(1)?;
        crossings.set(side, Word::letter(letter));
    }
    // Leaves first.
    for &v in order[1..].iter().rev() {
        let edge = crossings.edge(to_parent[v as usize]?);
        let mut sides = crossings.around(corner_of[v as usize]?);
        let place = sides.iter().position(|&side| crossings.edge(side) == edge)?;
        sides.rotate_left(place);
        let others = crossings.product(sides[1..].iter().copied());
        crossings.set(sides[0], others.inverted());
    }
    let around_root = crossings.around(corner_of[order[0] as usize]?);
    let relator = cyclically_reduced(crossings.product(around_root.into_iter()));
    let group = SurfaceGroup::new(&relator)?;
    let corners = corner_words(&crossings, &group, &corner_of);
    Some(CutSurface { group, corners })
}

/// Vertices in the order of a breadth-first tree, and the side from each to its parent.
fn vertex_tree(crossings: &Crossings, corner_of: &[Option<At>]) -> Option<(Vec<u32>, Vec<Option<At>>)> {
    let triangles = crossings.surface.triangles();
    let root = triangles.first()?[0];
    let mut is_reached = vec![false; corner_of.len()];
    is_reached[root as usize] = true;
    let mut to_parent = vec![None; corner_of.len()];
    let mut order = vec![root];
    let mut next = 0;
    while next < order.len() {
        let v = order[next];
        next += 1;
        for side in crossings.around(corner_of[v as usize]?) {
            // The side from the neighbour to this vertex.
            let w = triangles[side.0][side.1];
            if !is_reached[w as usize] {
                is_reached[w as usize] = true;
                to_parent[w as usize] = Some(side);
                order.push(w);
            }
        }
    }
    let reached = corner_of.iter().flatten().count();
    (order.len() == reached).then_some((order, to_parent))
}

/// A side of each edge that neither tree has.
fn left_over(crossings: &Crossings, mut is_used: Vec<bool>) -> Vec<At> {
    let count = crossings.surface.triangles().len();
    let mut is_reached = vec![false; count];
    is_reached[0] = true;
    let mut queue = VecDeque::from([0]);
    while let Some(t) = queue.pop_front() {
        for side in 0..3 {
            let (edge, (other, _)) = (crossings.edge((t, side)), crossings.twin((t, side)));
            if !is_used[edge] && !is_reached[other] {
                (is_used[edge], is_reached[other]) = (true, true);
                queue.push_back(other);
            }
        }
    }
    let mut found = Vec::new();
    for (t, side) in (0..count).flat_map(|t| [0, 1, 2].map(|side| (t, side))) {
        let edge = crossings.edge((t, side));
        if !is_used[edge] {
            is_used[edge] = true;
            found.push((t, side));
        }
    }
    found
}

fn cyclically_reduced(word: Word) -> Vec<Letter> {
    let mut letters = word.0.to_vec();
    while letters.len() > 1 && letters[0] == -letters[letters.len() - 1] {
        letters.pop();
        letters.remove(0);
    }
    letters
}

fn corner_words(crossings: &Crossings, group: &SurfaceGroup, corner_of: &[Option<At>]) -> Vec<[Word; 3]> {
    let triangles = crossings.surface.triangles();
    let mut corners = vec![<[Word; 3]>::default(); triangles.len()];
    for &at in corner_of.iter().flatten() {
        let v = triangles[at.0][at.1];
        let mut word = Word::default();
        for side in crossings.around(at) {
            let k = triangles[side.0]
                .iter()
                .position(|&w| w == v)
                .expect("its own triangle");
            corners[side.0][k] = word.clone();
            // Crossings of the tree are not shortened yet.
            let crossed = crossings.words[side.0][side.1].inverted();
            word = group.relator.shortened(crossed.times(&word));
        }
    }
    corners
}

#[cfg(test)]
mod tests {
    use super::super::testing::plate_with_holes;
    use super::*;
    use crate::mesh::shapes;
    use crate::toroidal::DeckGroup;

    #[test]
    fn crossings_around_every_vertex_and_triangle_close() {
        for surface in [
            shapes::double_torus(3),
            shapes::double_torus(6),
            plate_with_holes(3, 2),
            plate_with_holes(5, 2),
        ] {
            let cut = cut(&surface).unwrap();
            let genus = 1 - (surface.vertices().len() as i64 - surface.triangles().len() as i64 / 2) / 2;
            assert_eq!(cut.group.genus() as i64, genus);
            let relator = &cut.group.relator;
            // Both triangles at an edge see the same step from one end to the other.
            let mut steps = std::collections::HashMap::new();
            for (t, words) in surface.triangles().iter().zip(&cut.corners) {
                for k in 0..3 {
                    let [a, b] = [k, (k + 1) % 3];
                    let step = relator.product(&words[a].inverted(), &words[b]);
                    steps.insert((t[a], t[b]), step);
                }
            }
            for ((a, b), step) in &steps {
                assert!(relator.product(step, &steps[&(*b, *a)]).is_identity());
            }
        }
    }
}

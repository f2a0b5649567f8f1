//! The rings of a surface on its universal cover: each neighbour with the deck transformation to the copy of it next to the vertex.

use smallvec::SmallVec;

use super::layout::LatticeMap;
use crate::spherical::{Hierarchy, Insertion};

/// A group of deck transformations of a universal cover.
pub(crate) trait DeckGroup: Clone {
    type Element: Clone + Ord;

    fn identity(&self) -> Self::Element;
    /// First `b`, then `a`.
    fn product(&self, a: &Self::Element, b: &Self::Element) -> Self::Element;
    fn inverse(&self, a: &Self::Element) -> Self::Element;
}

/// The deck transformations of the plane over a torus.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Translations;

/// A translation by whole periods.
pub(crate) type Shift = [i32; 2];

impl DeckGroup for Translations {
    type Element = Shift;

    fn identity(&self) -> Shift {
        [0; 2]
    }

    fn product(&self, a: &Shift, b: &Shift) -> Shift {
        plus(*a, *b)
    }

    fn inverse(&self, a: &Shift) -> Shift {
        minus([0; 2], *a)
    }
}

/// The neighbours of a vertex, counter-clockwise, with the transformation of each.
type LiftedRing<T> = SmallVec<[(u32, T); 10]>;

/// At a vertex, a neighbour with its transformation, and the next neighbour.
type Links<T> = SmallVec<[(u32, T, u32); 8]>;

/// The lifted ring of each vertex of a simplified mesh.
#[derive(Debug, Clone)]
pub(crate) struct LiftedRings<G: DeckGroup> {
    /// Empty for vertices that are not inserted.
    rings: Vec<LiftedRing<G::Element>>,
    group: G,
}

pub(crate) fn plus(a: Shift, b: Shift) -> Shift {
    [a[0] + b[0], a[1] + b[1]]
}

pub(crate) fn minus(a: Shift, b: Shift) -> Shift {
    [a[0] - b[0], a[1] - b[1]]
}

impl LiftedRings<Translations> {
    /// Applies a map to all translations.
    pub fn transform(&mut self, map: LatticeMap) {
        for (_, shift) in self.rings.iter_mut().flatten() {
            *shift = map.apply(*shift);
        }
    }
}

impl<G: DeckGroup> LiftedRings<G> {
    /// The rings of a closed oriented surface whose triangles, on the cover, have their corners moved by `corners`.
    pub fn new(group: G, vertices: usize, triangles: &[[u32; 3]], corners: &[[G::Element; 3]]) -> Self {
        // At every vertex, pairs of a neighbour, with its transformation, and the next one counter-clockwise.
        let mut links: Vec<Links<G::Element>> = vec![Links::new(); vertices];
        for (t, corners) in triangles.iter().zip(corners) {
            for k in 0..3 {
                let [own, next, last] = [0, 1, 2].map(|step| (k + step) % 3);
                let to_next = group.product(&group.inverse(&corners[own]), &corners[next]);
                links[t[own] as usize].push((t[next], to_next, t[last]));
            }
        }
        let in_turn = |mut links: Links<G::Element>| {
            links.sort_unstable();
            let mut ring = LiftedRing::with_capacity(links.len());
            let mut place = 0;
            for _ in 0..links.len() {
                let (neighbour, to_it, next) = &links[place];
                ring.push((*neighbour, to_it.clone()));
                place = links.partition_point(|link| link.0 < *next).min(links.len() - 1);
            }
            ring
        };
        Self {
            rings: links.into_iter().map(in_turn).collect(),
            group,
        }
    }

    /// The neighbours of a vertex; none before it is inserted.
    pub fn of(&self, vertex: u32) -> &[(u32, G::Element)] {
        &self.rings[vertex as usize]
    }

    /// The triangles, each once with the transformations of its corners, ordered by their lowest vertex, which comes first
    /// and is not moved.
    pub fn triangles(&self) -> (Vec<[u32; 3]>, Vec<[G::Element; 3]>) {
        let (mut triangles, mut corners) = (Vec::new(), Vec::new());
        for (v, ring) in (0u32..).zip(&self.rings) {
            let pairs = ring.iter().zip(ring.iter().cycle().skip(1));
            for (a, b) in pairs.filter(|(a, b)| v < a.0 && v < b.0) {
                triangles.push([v, a.0, b.0]);
                corners.push([self.group.identity(), a.1.clone(), b.1.clone()]);
            }
        }
        (triangles, corners)
    }

    /// Makes all collapses of a hierarchy. Returns the transformations of the neighbours of each removed vertex, in the order
    /// of the hierarchy's rings.
    pub fn collapse(&mut self, hierarchy: &Hierarchy) -> Vec<G::Element> {
        let mut removed = Vec::new();
        for collapse in hierarchy.collapses() {
            debug_assert_eq!(collapse.first, removed.len());
            removed.extend(self.remove(&collapse));
        }
        removed
    }

    /// Collapses the vertex to the first neighbour of its ring.
    fn remove(&mut self, collapse: &Insertion) -> Vec<G::Element> {
        let (v, ids) = (collapse.vertex, collapse.ring);
        let mut ring = std::mem::take(&mut self.rings[v as usize]);
        let place = place_of(&ring, ids[0]);
        ring.rotate_left(place);
        let k = ring.len();
        debug_assert!(ring.iter().zip(ids).all(|(a, b)| a.0 == *b));
        let group = self.group.clone();
        let (u, to_u) = ring[0].clone();
        let from_u = group.inverse(&to_u);
        let of_u = &mut self.rings[u as usize];
        let place = place_of(of_u, v);
        of_u.remove(place);
        for (i, (r, to_r)) in ring[2..k - 1].iter().enumerate() {
            of_u.insert(place + i, (*r, group.product(&from_u, to_r)));
        }
        for (r, to_r) in &ring[2..k - 1] {
            let place = place_of(&self.rings[*r as usize], v);
            self.rings[*r as usize][place] = (u, group.product(&group.inverse(to_r), &to_u));
        }
        for side in [ring[1].0, ring[k - 1].0] {
            self.rings[side as usize].retain(|r| r.0 != v);
        }
        ring.into_iter().map(|r| r.1).collect()
    }

    /// Undoes a collapse; `to_ring` has the transformations of the neighbours.
    pub fn insert(&mut self, insertion: &Insertion, to_ring: &[G::Element]) {
        let (v, ids) = (insertion.vertex, insertion.ring);
        let ring: LiftedRing<G::Element> = ids.iter().copied().zip(to_ring.iter().cloned()).collect();
        let k = ring.len();
        let group = self.group.clone();
        let u = ring[0].0;
        let back = |r: &(u32, G::Element)| (v, group.inverse(&r.1));
        let of_u = &mut self.rings[u as usize];
        let place = place_of(of_u, ids[1]);
        of_u.rotate_left(place);
        of_u.drain(1..k - 2);
        of_u.insert(1, back(&ring[0]));
        let second = ring[1].0;
        let place = place_of(&self.rings[second as usize], u);
        self.rings[second as usize].insert(place, back(&ring[1]));
        for r in &ring[2..k - 1] {
            let place = place_of(&self.rings[r.0 as usize], u);
            self.rings[r.0 as usize][place] = back(r);
        }
        let last = ring[k - 1].0;
        let place = place_of(&self.rings[last as usize], u);
        self.rings[last as usize].insert(place + 1, back(&ring[k - 1]));
        self.rings[v as usize] = ring;
    }

    /// The transformations of the ring of a vertex that is to be inserted at the same place as its first neighbour.
    pub fn as_of_first(&self, insertion: &Insertion) -> Vec<G::Element> {
        let of_u = self.of(insertion.ring[0]);
        let to = |r: &u32| of_u[place_of(of_u, *r)].1.clone();
        let others = insertion.ring[1..].iter().map(to);
        std::iter::once(self.group.identity()).chain(others).collect()
    }

    /// Moves a vertex to another copy of its place: `by` takes the old copy to the new one.
    pub fn move_vertex(&mut self, vertex: u32, by: &G::Element) {
        let group = self.group.clone();
        let back = group.inverse(by);
        let mut ring = std::mem::take(&mut self.rings[vertex as usize]);
        for (r, to_r) in &mut ring {
            *to_r = group.product(by, to_r);
            let place = place_of(&self.rings[*r as usize], vertex);
            let entry = &mut self.rings[*r as usize][place].1;
            *entry = group.product(entry, &back);
        }
        self.rings[vertex as usize] = ring;
    }
}

fn place_of<T>(ring: &[(u32, T)], vertex: u32) -> usize {
    ring.iter()
        .position(|r| r.0 == vertex)
        .expect("neighbours are in each other's rings")
}

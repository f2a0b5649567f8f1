//! The rings of a surface on its universal cover: each neighbour with the translation to the copy of it next to the vertex.

use smallvec::SmallVec;

use super::layout::LatticeMap;
use crate::spherical::{Hierarchy, Insertion};

/// A deck transformation of the universal cover of a torus: a translation by whole periods.
pub(crate) type Shift = [i32; 2];

/// The neighbours of a vertex, counter-clockwise, with the translation of each.
type LiftedRing = SmallVec<[(u32, Shift); 10]>;

/// The lifted ring of each vertex of a simplified mesh.
#[derive(Debug, Clone)]
pub(crate) struct LiftedRings {
    /// Empty for vertices that are not inserted.
    rings: Vec<LiftedRing>,
}

pub(crate) fn plus(a: Shift, b: Shift) -> Shift {
    [a[0] + b[0], a[1] + b[1]]
}

pub(crate) fn minus(a: Shift, b: Shift) -> Shift {
    [a[0] - b[0], a[1] - b[1]]
}

impl LiftedRings {
    /// The rings of a closed oriented surface whose triangles, on the cover, have their corners translated by `shifts`.
    pub fn new(vertices: usize, triangles: &[[u32; 3]], shifts: &[[Shift; 3]]) -> Self {
        // At every vertex, pairs of a neighbour, with its translation, and the next one counter-clockwise.
        let mut links: Vec<SmallVec<[(u32, Shift, u32); 8]>> = vec![SmallVec::new(); vertices];
        for (t, shifts) in triangles.iter().zip(shifts) {
            for k in 0..3 {
                let [own, next, last] = [0, 1, 2].map(|step| (k + step) % 3);
                links[t[own] as usize].push((t[next], minus(shifts[next], shifts[own]), t[last]));
            }
        }
        let in_turn = |mut links: SmallVec<[(u32, Shift, u32); 8]>| {
            links.sort_unstable();
            let mut ring = LiftedRing::with_capacity(links.len());
            let mut place = 0;
            for _ in 0..links.len() {
                let (neighbour, shift, next) = links[place];
                ring.push((neighbour, shift));
                place = links.partition_point(|link| link.0 < next).min(links.len() - 1);
            }
            ring
        };
        Self {
            rings: links.into_iter().map(in_turn).collect(),
        }
    }

    /// The neighbours of a vertex; none before it is inserted.
    pub fn of(&self, vertex: u32) -> &[(u32, Shift)] {
        &self.rings[vertex as usize]
    }

    /// The triangles, each once with the translations of its corners, ordered by their lowest vertex, which comes first
    /// and is not translated.
    pub fn triangles(&self) -> (Vec<[u32; 3]>, Vec<[Shift; 3]>) {
        let (mut triangles, mut shifts) = (Vec::new(), Vec::new());
        for (v, ring) in (0u32..).zip(&self.rings) {
            let pairs = ring.iter().zip(ring.iter().cycle().skip(1));
            for (a, b) in pairs.filter(|(a, b)| v < a.0 && v < b.0) {
                triangles.push([v, a.0, b.0]);
                shifts.push([[0; 2], a.1, b.1]);
            }
        }
        (triangles, shifts)
    }

    /// Applies a map to all translations.
    pub fn transform(&mut self, map: LatticeMap) {
        for (_, shift) in self.rings.iter_mut().flatten() {
            *shift = map.apply(*shift);
        }
    }

    /// Makes all collapses of a hierarchy. Returns the translations of the neighbours of each removed vertex, in the order
    /// of the hierarchy's rings.
    pub fn collapse(&mut self, hierarchy: &Hierarchy) -> Vec<Shift> {
        let mut removed = Vec::new();
        for collapse in hierarchy.collapses() {
            debug_assert_eq!(collapse.first, removed.len());
            removed.extend(self.remove(&collapse));
        }
        removed
    }

    /// Collapses the vertex to the first neighbour of its ring.
    fn remove(&mut self, collapse: &Insertion) -> Vec<Shift> {
        let (v, ids) = (collapse.vertex, collapse.ring);
        let mut ring = std::mem::take(&mut self.rings[v as usize]);
        let place = place_of(&ring, ids[0]);
        ring.rotate_left(place);
        let k = ring.len();
        debug_assert!(ring.iter().zip(ids).all(|(a, b)| a.0 == *b));
        let (u, to_u) = ring[0];
        let of_u = &mut self.rings[u as usize];
        let place = place_of(of_u, v);
        of_u.remove(place);
        let moved = ring[2..k - 1].iter().map(|&(r, shift)| (r, minus(shift, to_u)));
        of_u.insert_many(place, moved);
        for &(r, shift) in &ring[2..k - 1] {
            let place = place_of(&self.rings[r as usize], v);
            self.rings[r as usize][place] = (u, minus(to_u, shift));
        }
        for side in [ring[1].0, ring[k - 1].0] {
            self.rings[side as usize].retain(|r| r.0 != v);
        }
        ring.iter().map(|r| r.1).collect()
    }

    /// Undoes a collapse; `shifts` has the translations of the neighbours.
    pub fn insert(&mut self, insertion: &Insertion, shifts: &[Shift]) {
        let (v, ids) = (insertion.vertex, insertion.ring);
        let ring: LiftedRing = ids.iter().copied().zip(shifts.iter().copied()).collect();
        let k = ring.len();
        let (u, to_u) = ring[0];
        let back = |shift: Shift| minus([0; 2], shift);
        self.rings[v as usize] = ring.clone();
        let of_u = &mut self.rings[u as usize];
        let place = place_of(of_u, ids[1]);
        of_u.rotate_left(place);
        of_u.drain(1..k - 2);
        of_u.insert(1, (v, back(to_u)));
        let (second, shift) = ring[1];
        let place = place_of(&self.rings[second as usize], u);
        self.rings[second as usize].insert(place, (v, back(shift)));
        for &(r, shift) in &ring[2..k - 1] {
            let place = place_of(&self.rings[r as usize], u);
            self.rings[r as usize][place] = (v, back(shift));
        }
        let (last, shift) = ring[k - 1];
        let place = place_of(&self.rings[last as usize], u);
        self.rings[last as usize].insert(place + 1, (v, back(shift)));
    }
}

fn place_of(ring: &[(u32, Shift)], vertex: u32) -> usize {
    ring.iter()
        .position(|r| r.0 == vertex)
        .expect("neighbours are in each other's rings")
}

//! Progressive simplification of a closed surface, down to a tetrahedron where its genus is 0, and the inverse vertex
//! insertions.
//!
//! Half-edge collapses under the link condition (Dey, Edelsbrunner, Guha, Nekhayev, *Topology preserving edge
//! contraction*, 1999) keep the topology. They are grouped in levels: the vertices that a level removes are an
//! independent set of a fixed share of the rest, so that the number of levels grows with the logarithm of the size.

use rayon::prelude::*;
use smallvec::SmallVec;

use crate::{Point, Vector};

/// The neighbours of a vertex, counter-clockwise seen from outside.
pub(super) type Ring = SmallVec<[u32; 10]>;

/// A level removes at most one in this many vertices.
const SHARE: usize = 4;
/// Vertices of higher valence are removed only when no others are left.
const MAX_VALENCE: usize = 8;
/// Collapses that leave a vertex of higher valence are made only when there is no other.
const MAX_VALENCE_AFTER: usize = 12;

/// The collapses from a surface to a coarse one.
#[derive(Debug, Clone)]
pub(crate) struct Hierarchy {
    /// The triangles of the coarsest surface.
    pub base: Vec<[u32; 3]>,
    /// Number of vertices of the surface.
    pub vertices: usize,
    removed: Vec<u32>,
    /// The ring of `removed[i]` is `rings[first[i]..first[i + 1]]`, starting with the vertex that it was collapsed to.
    rings: Vec<u32>,
    first: Vec<usize>,
    /// Level `l` removed `levels[l]..levels[l + 1]`.
    levels: Vec<usize>,
}

/// A vertex to insert: the inverse of a collapse.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Insertion<'a> {
    pub vertex: u32,
    /// Its neighbours, counter-clockwise; the triangles that it replaces are a fan about the first.
    pub ring: &'a [u32],
    /// Where the ring begins when the rings of all removed vertices are put one after the other, in the order of removal.
    pub first: usize,
}

impl Hierarchy {
    /// Removes vertices until four are left, those of `late` after all others.
    ///
    /// The triangles must be a closed oriented manifold of genus 0 over all of the points. `None` when no
    /// vertex can be removed, which does not happen for such a surface.
    pub fn new(points: &[Point], triangles: &[[u32; 3]], late: &[u32]) -> Option<Self> {
        let mut coarsening = Coarsening::new(points, triangles, late);
        coarsening.run(4)?;
        let v = coarsening.rings.iter().position(|ring| !ring.is_empty())?;
        let (v, ring) = (v as u32, &coarsening.rings[v]);
        let base = vec![
            [v, ring[0], ring[1]],
            [v, ring[1], ring[2]],
            [v, ring[2], ring[0]],
            [ring[0], ring[2], ring[1]],
        ];
        Some(Self {
            base,
            ..coarsening.record
        })
    }

    /// As [`Self::new`], for a surface of any genus: removes vertices until `least` are left, or none can be removed.
    pub fn with_least(points: &[Point], triangles: &[[u32; 3]], least: usize) -> Self {
        let mut coarsening = Coarsening::new(points, triangles, &[]);
        // Ends early where no vertex can be removed.
        let _ = coarsening.run(least.max(4));
        let base = VertexRings {
            rings: coarsening.rings,
        };
        Self {
            base: base.triangles(),
            ..coarsening.record
        }
    }

    /// The vertices that are inserted first, at least so many of them if there are as many.
    pub fn coarsest(&self, count: usize) -> Vec<u32> {
        let mut base: Vec<u32> = self.base.iter().flatten().copied().collect();
        base.sort_unstable();
        base.dedup();
        let others = self.removed.iter().rev().take(count);
        base.into_iter().chain(others.copied()).collect()
    }

    /// The levels, coarsest first, each as its vertices in the order of insertion.
    pub fn refinements(&self) -> impl Iterator<Item = impl Iterator<Item = Insertion<'_>>> {
        let levels = self.levels.windows(2).rev();
        levels.map(|level| (level[0]..level[1]).rev().map(|i| self.insertion(i)))
    }

    /// The insertions that undo the collapses, in the order of the collapses.
    pub fn collapses(&self) -> impl Iterator<Item = Insertion<'_>> {
        (0..self.removed.len()).map(|i| self.insertion(i))
    }

    fn insertion(&self, i: usize) -> Insertion<'_> {
        Insertion {
            vertex: self.removed[i],
            ring: &self.rings[self.first[i]..self.first[i + 1]],
            first: self.first[i],
        }
    }
}

/// The ring of neighbours of each vertex of a simplified mesh.
#[derive(Debug, Clone)]
pub(crate) struct VertexRings {
    /// Empty for vertices that are not inserted.
    rings: Vec<Ring>,
}

impl VertexRings {
    /// The rings of a closed oriented surface, which need not use all of the vertices.
    pub fn new(vertices: usize, triangles: &[[u32; 3]]) -> Self {
        Self {
            rings: rings_of(vertices, triangles),
        }
    }

    /// The neighbours of a vertex, counter-clockwise; none before it is inserted.
    pub fn of(&self, vertex: u32) -> &[u32] {
        &self.rings[vertex as usize]
    }

    /// The triangles, each once, ordered by their lowest vertex, which comes first.
    pub fn triangles(&self) -> Vec<[u32; 3]> {
        let mut triangles = Vec::new();
        for (v, ring) in self.rings.iter().enumerate() {
            let v = v as u32;
            let pairs = ring.iter().zip(ring.iter().cycle().skip(1));
            triangles.extend(pairs.filter(|&(&a, &b)| v < a && v < b).map(|(&a, &b)| [v, a, b]));
        }
        triangles
    }

    /// Inserts a vertex.
    pub fn insert(&mut self, insertion: &Insertion) {
        let (v, ring) = (insertion.vertex, insertion.ring);
        let (u, k) = (ring[0], ring.len());
        self.rings[v as usize] = Ring::from_slice(ring);
        // The ring of u holds the vertices of `ring` in order; v replaces all but the first and the last of them.
        let of_u = &mut self.rings[u as usize];
        let place = place_of(of_u, ring[1]);
        of_u.rotate_left(place);
        of_u.drain(1..k - 2);
        of_u.insert(1, v);
        let second = &mut self.rings[ring[1] as usize];
        let place = place_of(second, u);
        second.insert(place, v);
        for &r in &ring[2..k - 1] {
            let place = place_of(&self.rings[r as usize], u);
            self.rings[r as usize][place] = v;
        }
        let last = &mut self.rings[ring[k - 1] as usize];
        let place = place_of(last, u);
        last.insert(place + 1, v);
    }
}

/// The state of the simplification.
struct Coarsening<'a> {
    points: &'a [Point],
    rings: Vec<Ring>,
    is_late: Vec<bool>,
    /// Twice the area of the surface, the unit of priorities.
    double_area: f64,
    record: Hierarchy,
}

impl<'a> Coarsening<'a> {
    fn new(points: &'a [Point], triangles: &[[u32; 3]], late: &[u32]) -> Self {
        let mut is_late = vec![false; points.len()];
        late.iter().for_each(|&v| is_late[v as usize] = true);
        let double_area = |t: &[u32; 3]| {
            let [a, b, c] = t.map(|v| points[v as usize]);
            (b - a).cross(&(c - a)).norm()
        };
        Self {
            points,
            rings: rings_of(points.len(), triangles),
            is_late,
            double_area: triangles.iter().map(double_area).sum::<f64>().max(f64::MIN_POSITIVE),
            record: Hierarchy {
                base: Vec::new(),
                vertices: points.len(),
                removed: Vec::new(),
                rings: Vec::new(),
                first: vec![0],
                levels: vec![0],
            },
        }
    }

    fn run(&mut self, least: usize) -> Option<()> {
        let mut left: Vec<u32> = (0..self.points.len() as u32).collect();
        let mut locked = vec![false; self.points.len()];
        let mut most_valence = MAX_VALENCE;
        let mut with_late = false;
        while left.len() > least {
            let most = (left.len() / SHARE).max(1).min(left.len() - least);
            let taken = self.take_level(&left, &mut locked, most_valence, with_late, most);
            if taken > 0 {
                self.record.levels.push(self.record.removed.len());
                left.retain(|&v| !self.rings[v as usize].is_empty());
                left.iter().for_each(|&v| locked[v as usize] = false);
                continue;
            }
            // No vertex could be removed: relax the conditions.
            if most_valence < left.len() {
                most_valence = if most_valence < 4 * MAX_VALENCE {
                    most_valence + 2
                } else {
                    left.len()
                };
            } else if !with_late {
                (with_late, most_valence) = (true, MAX_VALENCE);
            } else {
                return None;
            }
        }
        Some(())
    }

    /// Removes an independent set of up to `most` vertices, those of the lowest priority first. Returns their number.
    fn take_level(
        &mut self,
        left: &[u32],
        locked: &mut [bool],
        most_valence: usize,
        with_late: bool,
        most: usize,
    ) -> usize {
        let candidates = left
            .par_iter()
            .filter(|&&v| self.rings[v as usize].len() <= most_valence && (with_late || !self.is_late[v as usize]));
        let mut queue: Vec<(i64, u32)> = candidates.map(|&v| (self.priority(v), v)).collect();
        queue.par_sort_unstable();
        let mut taken = 0;
        for (_, v) in queue {
            if taken == most {
                break;
            }
            if locked[v as usize] {
                continue;
            }
            if let Some(place) = self.best_collapse(v) {
                self.rings[v as usize].iter().for_each(|&r| locked[r as usize] = true);
                self.collapse(v, place);
                taken += 1;
            }
        }
        taken
    }

    /// Logarithm of the shortest edge times the valence, rounded so that ties stay ties when the surface is rotated or
    /// scaled.
    fn priority(&self, v: u32) -> i64 {
        let p = self.points[v as usize];
        let ring = &self.rings[v as usize];
        let squares = ring.iter().map(|&r| (self.points[r as usize] - p).norm_squared());
        let shortest = squares.fold(f64::INFINITY, f64::min);
        let length = (shortest / self.double_area).sqrt().max(1e-30) * ring.len() as f64;
        (length.ln() * 1e6).round() as i64
    }

    /// Position in the ring of `v` of the neighbour that it is best collapsed to.
    fn best_collapse(&self, v: u32) -> Option<usize> {
        let ring = &self.rings[v as usize];
        let normal = self.normal(v);
        let mut best: Option<(i64, u32, usize)> = None;
        for place in 0..ring.len() {
            if !self.may_collapse(ring, place) {
                continue;
            }
            let quality = (self.quality(ring, place, &normal) * 1e6).round() as i64;
            let is_better = best.is_none_or(|(q, u, _)| quality > q || (quality == q && ring[place] < u));
            if is_better {
                best = Some((quality, ring[place], place));
            }
        }
        best.map(|(.., place)| place)
    }

    /// The link condition: the two vertices of the edge have no common neighbours but those of its triangles.
    fn may_collapse(&self, ring: &Ring, place: usize) -> bool {
        let k = ring.len();
        let of_u = &self.rings[ring[place] as usize];
        let is_free = |i: usize| !of_u.contains(&ring[(place + i) % k]);
        let sides = [ring[(place + 1) % k], ring[(place + k - 1) % k]];
        sides.iter().all(|&s| self.rings[s as usize].len() > 3) && (k > 3 || of_u.len() > 3) && (2..k - 1).all(is_free)
    }

    /// Quality of the worst triangle that the collapse makes: 1 for an equilateral one, negative for an inverted one.
    fn quality(&self, ring: &Ring, place: usize, normal: &Vector) -> f64 {
        let k = ring.len();
        let at = |i: usize| self.points[ring[(place + i) % k] as usize];
        let u = at(0);
        let mut worst: f64 = 1.0;
        for i in 1..k - 1 {
            let (a, b) = (at(i) - u, at(i + 1) - u);
            let cross = a.cross(&b);
            let edges = a.norm_squared() + b.norm_squared() + (b - a).norm_squared();
            let shape = if edges > 0.0 {
                12f64.sqrt() * cross.norm() / edges
            } else {
                0.0
            };
            worst = worst.min(if cross.dot(normal) < 0.0 { shape - 1.0 } else { shape });
        }
        let valence = self.rings[ring[place] as usize].len() + k - 4;
        worst - valence.saturating_sub(MAX_VALENCE_AFTER) as f64
    }

    fn normal(&self, v: u32) -> Vector {
        let p = self.points[v as usize];
        let ring = &self.rings[v as usize];
        let offset = |v: &u32| self.points[*v as usize] - p;
        let pairs = ring.iter().zip(ring.iter().cycle().skip(1));
        pairs.map(|(a, b)| offset(a).cross(&offset(b))).sum()
    }

    fn collapse(&mut self, v: u32, place: usize) {
        let mut ring = std::mem::take(&mut self.rings[v as usize]);
        ring.rotate_left(place);
        let (u, k) = (ring[0], ring.len());
        let of_u = &mut self.rings[u as usize];
        let place = place_of(of_u, v);
        of_u.remove(place);
        of_u.insert_from_slice(place, &ring[2..k - 1]);
        for &r in &ring[2..k - 1] {
            let place = place_of(&self.rings[r as usize], v);
            self.rings[r as usize][place] = u;
        }
        for side in [ring[1], ring[k - 1]] {
            self.rings[side as usize].retain(|&mut r| r != v);
        }
        self.record.removed.push(v);
        self.record.rings.extend_from_slice(&ring);
        self.record.first.push(self.record.rings.len());
    }
}

/// The ring of every vertex; each starts with the neighbour of the vertex's first triangle.
fn rings_of(vertices: usize, triangles: &[[u32; 3]]) -> Vec<Ring> {
    // At every vertex, pairs of a neighbour and the next one counter-clockwise.
    let mut links: Vec<SmallVec<[[u32; 2]; 8]>> = vec![SmallVec::new(); vertices];
    for &[a, b, c] in triangles {
        links[a as usize].push([b, c]);
        links[b as usize].push([c, a]);
        links[c as usize].push([a, b]);
    }
    links
        .into_par_iter()
        .map(|mut links| {
            let mut ring = Ring::with_capacity(links.len());
            // Sorted for binary search: a linear search is quadratic in the valence.
            links[..].sort_unstable();
            let Some(&[first, mut next]) = links.first() else {
                return ring;
            };
            ring.push(first);
            while next != first && ring.len() < links.len() {
                ring.push(next);
                let place = links.partition_point(|link| link[0] < next);
                next = links[place.min(links.len() - 1)][1];
            }
            ring
        })
        .collect()
}

fn place_of(ring: &[u32], vertex: u32) -> usize {
    ring.iter()
        .position(|&r| r == vertex)
        .expect("neighbours are in each other's rings")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::topology::Topology;
    use crate::mesh::{SurfaceMesh, shapes};

    fn sorted(triangles: &[[u32; 3]]) -> Vec<[u32; 3]> {
        let mut all: Vec<[u32; 3]> = triangles
            .iter()
            .map(|&[a, b, c]| match a.min(b).min(c) {
                low if low == a => [a, b, c],
                low if low == b => [b, c, a],
                _ => [c, a, b],
            })
            .collect();
        all.sort_unstable();
        all
    }

    #[test]
    fn inserting_all_vertices_gives_the_surface() {
        for mesh in [
            shapes::sphere(1.0, 4),
            shapes::cube(1.0, 9),
            shapes::polycube(&[[0, 0, 0], [1, 0, 0]], 5),
        ] {
            let hierarchy = Hierarchy::new(mesh.vertices(), mesh.triangles(), &[]).unwrap();
            let mut neighbours = VertexRings::new(hierarchy.vertices, &hierarchy.base);
            let mut vertices = 4;
            for level in hierarchy.refinements() {
                for insertion in level {
                    neighbours.insert(&insertion);
                    vertices += 1;
                }
                let coarse = SurfaceMesh::new(mesh.vertices().to_vec(), neighbours.triangles()).unwrap();
                let shape = Topology::new(&coarse).components().shapes;
                assert_eq!(
                    (shape.len(), shape[0].vertices, shape[0].genus()),
                    (1, vertices, Some(0))
                );
            }
            assert_eq!(sorted(&neighbours.triangles()), sorted(mesh.triangles()));
        }
    }

    #[test]
    fn levels_are_few_and_late_vertices_stay_longest() {
        let mesh = shapes::sphere(1.0, 5);
        let late = [7, 99, 1234, 5000, 8000];
        let hierarchy = Hierarchy::new(mesh.vertices(), mesh.triangles(), &late).unwrap();
        assert!(hierarchy.levels.len() < 45, "{} levels", hierarchy.levels.len());
        assert_eq!(hierarchy.removed.len(), mesh.vertices().len() - 4);
        let last = &hierarchy.removed[hierarchy.removed.len() - 20..];
        let is_late_enough = |v: &u32| last.contains(v) || hierarchy.base.iter().flatten().any(|b| b == v);
        assert!(late.iter().all(is_late_enough));
    }

    #[test]
    fn a_vertex_with_two_hundred_neighbours_is_removed() {
        // A double cone over 200 points of a circle.
        let mut vertices = vec![Point::new(0.0, 0.0, 1.0), Point::new(0.0, 0.0, -1.0)];
        let mut triangles = Vec::new();
        for i in 0..200u32 {
            let angle = f64::from(i) * std::f64::consts::TAU / 200.0;
            vertices.push(Point::new(angle.cos(), angle.sin(), 0.0));
            let (a, b) = (2 + i, 2 + (i + 1) % 200);
            triangles.extend([[0, a, b], [1, b, a]]);
        }
        let hierarchy = Hierarchy::new(&vertices, &triangles, &[]).unwrap();
        assert_eq!(hierarchy.removed.len(), 198);
    }
}

//! The class of a map between surfaces of genus 2 or more, from a rough correspondence.
//!
//! Which handle goes to which, and how often it is twisted, is known once every edge of the domain has a path on the target: the crossings of
//! the path with the polygon's sides are the deck transformation along the edge. Correspondences by closest points jump here and there.
//! So edges whose paths are about as long as they are come first, and what two edges of a triangle say about the third is taken
//! before its own path.

use std::cmp::Reverse;
use std::collections::{BinaryHeap, HashMap};
use std::sync::Arc;

use rayon::prelude::*;

use crate::hyperbolic::{HyperbolicEmbedding, Relator, Word};
use crate::mesh::topology::Topology;
use crate::mesh::{SurfaceMesh, SurfacePoint};
use crate::toroidal::{DeckGroup, LiftedRings};
use crate::{Point, Vector};

/// Paths are not sought beyond this many times the length of the edge: what is beyond has jumped.
const MOST_STRETCH: f64 = 12.0;

/// Paths over the triangles of a target.
pub(super) struct TargetPaths<'a> {
    surface: &'a SurfaceMesh,
    relator: &'a Arc<Relator>,
    /// For each side of a triangle the other triangle there, and what takes places in the frame of the one to that of the other.
    crossings: Vec<[(u32, Word); 3]>,
    middles: Vec<Point>,
    /// Mean length of an edge.
    spacing: f64,
}

/// The path along an edge of the domain.
struct EdgePath {
    /// What takes places in the frame of its end to that of its beginning.
    word: Word,
    length: f64,
}

impl<'a> TargetPaths<'a> {
    pub fn new(embedding: &'a HyperbolicEmbedding) -> Self {
        Self::over(embedding.surface(), &embedding.group().relator, embedding.crossings())
    }

    pub fn over(surface: &'a SurfaceMesh, relator: &'a Arc<Relator>, crossings: Vec<[(u32, Word); 3]>) -> Self {
        let count = surface.triangles().len();
        let middle = |t: usize| Point::from(surface.corners(t).iter().map(|p| p.coords).sum::<Vector>() / 3.0);
        Self {
            surface,
            relator,
            crossings,
            middles: (0..count).map(middle).collect(),
            spacing: (surface.area() / count as f64).sqrt() * 1.5,
        }
    }

    /// For each triangle of the domain, which may have borders, what takes places in the frames of its corners to that of the first one,
    /// for points of the target that the vertices go to, about. `None` where the paths contradict each other.
    pub fn corner_words(&self, domain: &SurfaceMesh, targets: &[Option<SurfacePoint>]) -> Option<Vec<[Word; 3]>> {
        let topology = Topology::new(domain);
        let edges = topology.edges();
        // Lengths of the domain as if its area was that of the target.
        let scale = (self.surface.area() / domain.area()).sqrt();
        let length = |[a, b]: [u32; 2]| {
            let [a, b] = [a, b].map(|v| domain.vertices()[v as usize]);
            scale * (b - a).norm() + self.spacing
        };
        let paths = self.paths(domain, edges, targets, &length);
        let mut order: Vec<(f64, u32)> = Vec::new();
        for (e, path) in paths.iter().enumerate() {
            if let Some(path) = path {
                order.push((path.length / length(edges[e]), e as u32));
            }
        }
        order.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let mut known: Vec<Option<Word>> = vec![None; edges.len()];
        let edges_of = |t: u32| topology.edges_of_triangle(t as usize).expect("three vertices");
        // The word along side `k` of a triangle, from corner `k` to the next.
        let along = |t: u32, k: usize, word: &Word| {
            let corners = domain.triangles()[t as usize];
            match corners[k] < corners[(k + 1) % 3] {
                true => word.clone(),
                false => word.inverted(),
            }
        };
        for (_, e) in order {
            if known[e as usize].is_some() {
                continue;
            }
            known[e as usize] = paths[e as usize].as_ref().map(|path| path.word.clone());
            let mut new = vec![e];
            while let Some(e) = new.pop() {
                for side in topology.sides(e as usize) {
                    let t = side.triangle;
                    let of_triangle = edges_of(t);
                    let sides =
                        [0, 1, 2].map(|k| known[of_triangle[k] as usize].as_ref().map(|word| along(t, k, word)));
                    let unknown = (0..3).filter(|&k| sides[k].is_none()).collect::<Vec<_>>();
                    let step = |k: usize| sides[k % 3].clone().unwrap_or_default();
                    match unknown[..] {
                        [] => {
                            let relator = self.relator;
                            let whole = relator.product(&relator.product(&step(0), &step(1)), &step(2));
                            if !whole.is_identity() {
                                return None;
                            }
                        }
                        [k] => {
                            let word = self.relator.product(&step(k + 1), &step(k + 2)).inverted();
                            let other = of_triangle[k];
                            known[other as usize] = Some(along(t, k, &word));
                            new.push(other);
                        }
                        _ => {}
                    }
                }
            }
        }
        let corners = |t: usize| -> Option<[Word; 3]> {
            let [first, _, last] = edges_of(t as u32);
            let to_second = along(t as u32, 0, known[first as usize].as_ref()?);
            let to_third = along(t as u32, 2, known[last as usize].as_ref()?).inverted();
            Some([Word::default(), to_second, to_third])
        };
        (0..domain.triangles().len()).map(corners).collect()
    }

    /// The path along each edge whose ends have targets, from its lower vertex.
    fn paths(
        &self,
        domain: &SurfaceMesh,
        edges: &[[u32; 2]],
        targets: &[Option<SurfacePoint>],
        length: &(impl Fn([u32; 2]) -> f64 + Sync),
    ) -> Vec<Option<EdgePath>> {
        let mut first = vec![0; domain.vertices().len() + 1];
        // Edges are sorted by their lower vertex.
        for &[a, _] in edges {
            first[a as usize + 1] += 1;
        }
        for v in 0..domain.vertices().len() {
            first[v + 1] += first[v];
        }
        let of_vertex = |v: usize| -> Vec<Option<EdgePath>> {
            let own = &edges[first[v]..first[v + 1]];
            let Some(from) = targets[v] else {
                return own.iter().map(|_| None).collect();
            };
            let ends: Vec<Option<SurfacePoint>> = own.iter().map(|&[_, b]| targets[b as usize]).collect();
            let longest = own.iter().map(|&edge| length(edge)).fold(0.0, f64::max);
            self.paths_from(&from, &ends, MOST_STRETCH * longest)
        };
        let all: Vec<Vec<Option<EdgePath>>> = (0..domain.vertices().len()).into_par_iter().map(of_vertex).collect();
        all.into_iter().flatten().collect()
    }

    /// Shortest paths over middles of triangles (Dijkstra), up to a length.
    fn paths_from(&self, from: &SurfacePoint, ends: &[Option<SurfacePoint>], most: f64) -> Vec<Option<EdgePath>> {
        let surface = self.surface;
        let position = |point: &SurfacePoint| point.position(surface, surface.vertices());
        let begin = position(from);
        let mut open: Vec<u32> = ends.iter().flatten().map(|end| end.triangle).collect();
        open.sort_unstable();
        open.dedup();
        // By triangle: the distance, and the triangle and its side before it.
        let mut found: HashMap<u32, (f64, Option<(u32, usize)>)> = HashMap::from([(from.triangle, (0.0, None))]);
        let mut settled: HashMap<u32, ()> = HashMap::new();
        let mut queue = BinaryHeap::from([(Reverse(Ordered(0.0)), from.triangle)]);
        while let Some((Reverse(Ordered(distance)), t)) = queue.pop() {
            if settled.insert(t, ()).is_some() {
                continue;
            }
            open.retain(|&other| other != t);
            if open.is_empty() || distance > most {
                break;
            }
            let here = if t == from.triangle {
                begin
            } else {
                self.middles[t as usize]
            };
            for (side, (other, _)) in self.crossings[t as usize].iter().enumerate() {
                let length = distance + (self.middles[*other as usize] - here).norm();
                let is_shorter = found.get(other).is_none_or(|(known, _)| length < *known);
                if is_shorter && !settled.contains_key(other) {
                    found.insert(*other, (length, Some((t, side))));
                    queue.push((Reverse(Ordered(length)), *other));
                }
            }
        }
        let path = |end: &SurfacePoint| {
            settled.get(&end.triangle)?;
            let mut word = Word::default();
            let mut t = end.triangle;
            while let Some((_, Some((before, side)))) = found.get(&t) {
                // From the frame of the triangle before to that of this one.
                let crossing = &self.crossings[*before as usize][*side].1;
                word = self.relator.product(&word, crossing);
                t = *before;
            }
            let length = match end.triangle == from.triangle {
                true => (position(end) - begin).norm(),
                false => found[&end.triangle].0,
            };
            Some(EdgePath {
                word: word.inverted(),
                length,
            })
        };
        ends.iter().map(|end| end.as_ref().and_then(path)).collect()
    }
}

/// A surface in a class of maps: its rings on the universal cover of the target, and the places of its vertices there.
pub(super) type Lifted = (LiftedRings<Arc<Relator>>, Vec<Vector>);

/// The domain with these words of its triangles' corners, and these points of the target, in whose frames its vertices are.
pub(super) fn lifted(
    domain: &SurfaceMesh,
    target: &HyperbolicEmbedding,
    corners: &[[Word; 3]],
    targets: &[Option<SurfacePoint>],
) -> Lifted {
    let count = domain.vertices().len();
    let rings = LiftedRings::new(target.group().relator.clone(), count, domain.triangles(), corners);
    let place = |point: &Option<SurfacePoint>| point.map_or(Vector::z(), |point| target.place_in_frame(&point));
    (rings, targets.iter().map(place).collect())
}

/// Lengths, which are never NaN here, in order.
#[derive(PartialEq)]
struct Ordered(f64);

impl Eq for Ordered {}

impl PartialOrd for Ordered {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Ordered {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        self.0.total_cmp(&other.0)
    }
}

//! The class of a map from a loop for each handle: both surfaces are cut open along their loops, the borders are closed by caps, and what
//! comes of it, which has no handles any more, is mapped through the sphere, caps to caps. Paths on the target that is cut open tell the
//! class; where they come to a cap, its triangles have the frames of those along the border, so that only on which side of its middle a
//! path goes counts.

use std::collections::HashMap;
use std::sync::Arc;

use super::super::loops::LoopPair;
use super::super::{LandmarkCurve, Landmarks, PairError, PairMapping, PairOptions, map_pair};
use super::lifting::{Lifted, TargetPaths, lifted};
use crate::boundary_map::BoundaryMap;
use crate::hyperbolic::{HyperbolicEmbedding, Relator, Word};
use crate::mesh::{SurfaceMesh, SurfacePoint};
use crate::spherical::{SphericalEmbedding, genus};
use crate::toroidal::DeckGroup;
use crate::{Point, Vector};

/// A side of a triangle: from this corner to the next.
type Side = (u32, usize);

/// A surface that is cut open along disjoint loops.
struct CutOpen<'a> {
    original: &'a SurfaceMesh,
    loops: Vec<&'a [u32]>,
    /// The sides of the original triangles from one vertex to another.
    sides: HashMap<[u32; 2], Side>,
    /// The triangles of the original come first, and those of the caps after them.
    surface: SurfaceMesh,
    /// The borders, on the left and on the right of each loop, along it: those on the left have the loop's own vertices, and those on the
    /// right copies of them.
    borders: Vec<Vec<u32>>,
    /// The middle of the cap of each border, and the first of its triangles, one along each edge of the border.
    caps: Vec<(u32, u32)>,
}

impl<'a> CutOpen<'a> {
    /// `None` where handles remain, or it falls apart.
    fn new(original: &'a SurfaceMesh, loops: Vec<&'a [u32]>) -> Option<Self> {
        let mut vertices = original.vertices().to_vec();
        let mut triangles = original.triangles().to_vec();
        let mut sides = HashMap::new();
        for (t, corners) in (0u32..).zip(original.triangles()) {
            sides.extend((0..3).map(|k| ([corners[k], corners[(k + 1) % 3]], (t, k))));
        }
        let mut borders = Vec::new();
        for walk in &loops {
            let count = walk.len();
            let copies: Vec<u32> = (0..count).map(|k| (vertices.len() + k) as u32).collect();
            for (k, &v) in walk.iter().enumerate() {
                let (next, last) = (walk[(k + 1) % count], walk[(k + count - 1) % count]);
                // On the right, counter-clockwise from the vertex before to the next.
                let mut at = last;
                while at != next {
                    let &(t, corner) = sides.get(&[v, at])?;
                    triangles[t as usize][corner] = copies[k];
                    at = original.triangles()[t as usize][(corner + 2) % 3];
                }
            }
            vertices.extend(walk.iter().map(|&v| original.vertices()[v as usize]));
            borders.extend([walk.to_vec(), copies]);
        }
        let mut caps = Vec::new();
        for (side, border) in borders.iter().enumerate() {
            let middle = border.iter().map(|&v| vertices[v as usize].coords).sum::<Vector>() / border.len() as f64;
            let cap = vertices.len() as u32;
            vertices.push(middle.into());
            caps.push((cap, triangles.len() as u32));
            for (&v, &next) in border.iter().zip(border.iter().cycle().skip(1)) {
                triangles.push(match is_left(side) {
                    true => [next, v, cap],
                    false => [v, next, cap],
                });
            }
        }
        let surface = SurfaceMesh::new(vertices, triangles).ok()?;
        (genus(&surface) == Ok(0)).then_some(Self {
            original,
            loops,
            sides,
            surface,
            borders,
            caps,
        })
    }

    /// Edge `k` of a loop as a side of the triangle beside it.
    fn along(&self, border: usize, k: usize) -> Option<Side> {
        let walk = self.loops[border / 2];
        let [v, next] = [walk[k % walk.len()], walk[(k + 1) % walk.len()]];
        let edge = if is_left(border) { [v, next] } else { [next, v] };
        self.sides.get(&edge).copied()
    }

    /// The cut surface without its caps.
    fn without_caps(&self) -> Option<SurfaceMesh> {
        let vertices = self.surface.vertices().len() - self.caps.len();
        let triangles = self.surface.triangles()[..self.original.triangles().len()].to_vec();
        SurfaceMesh::new(self.surface.vertices()[..vertices].to_vec(), triangles).ok()
    }

    /// What takes places in the frame of a triangle to that of another at the same vertex: the first counter-clockwise that has a side from
    /// there to this one.
    fn around(
        &self,
        crossings: &[[(u32, Word); 3]],
        relator: &Arc<Relator>,
        from: u32,
        vertex: u32,
        to: u32,
    ) -> Option<Word> {
        let (mut t, mut word) = (from, Word::default());
        for _ in 0..self.original.triangles().len() {
            let corners = self.original.triangles()[t as usize];
            let side = corners.iter().position(|v| *v == vertex)?;
            if corners[(side + 1) % 3] == to {
                return Some(word);
            }
            let (next, crossing) = &crossings[t as usize][side];
            (t, word) = (*next, relator.product(crossing, &word));
        }
        None
    }

    /// The crossings of sides of all triangles, from those of the original's.
    fn crossings(&self, of_original: &[[(u32, Word); 3]], relator: &Arc<Relator>) -> Option<Vec<[(u32, Word); 3]>> {
        let mut all = of_original.to_vec();
        for (border, (_, first)) in self.caps.iter().enumerate() {
            let walk = self.loops[border / 2];
            let count = walk.len();
            let fan = |k: usize| first + (k % count) as u32;
            let vertex = |k: usize| walk[k % count];
            // From the triangle of the cap at an edge to the next.
            let to_next = |k: usize| -> Option<Word> {
                let [from, next] = [self.along(border, k)?.0, self.along(border, k + 1)?.0];
                match is_left(border) {
                    true => self.around(of_original, relator, from, vertex(k + 1), vertex(k + 2)),
                    false => {
                        let back = self.around(of_original, relator, next, vertex(k + 1), vertex(k))?;
                        Some(back.inverted())
                    }
                }
            };
            let words = (0..count).map(to_next).collect::<Option<Vec<Word>>>()?;
            for k in 0..count {
                let (t, side) = self.along(border, k)?;
                all[t as usize][side] = (fan(k), Word::default());
                let before = (fan(k + count - 1), words[(k + count - 1) % count].inverted());
                let after = (fan(k + 1), words[k].clone());
                let outside = (t, Word::default());
                all.push(match is_left(border) {
                    true => [outside, before, after],
                    false => [outside, after, before],
                });
            }
        }
        Some(all)
    }

    /// The point of a border at a share of the loop's length, in the triangle beside it.
    fn at_share(&self, border: usize, share: f64) -> Option<SurfacePoint> {
        let walk = self.loops[border / 2];
        let lengths = lengths(walk, self.original);
        let at = share * lengths[walk.len()];
        let k = (lengths.partition_point(|length| *length <= at).max(1) - 1).min(walk.len() - 1);
        let length = (lengths[k + 1] - lengths[k]).max(f64::MIN_POSITIVE);
        let t = ((at - lengths[k]) / length).clamp(0.0, 1.0);
        self.on_border(border, k, t)
    }

    /// The point of a border edge that is this far along it.
    fn on_border(&self, border: usize, k: usize, t: f64) -> Option<SurfacePoint> {
        let (triangle, side) = self.along(border, k)?;
        let mut barycentric = [0.0; 3];
        let ends = if is_left(border) { [1.0 - t, t] } else { [t, 1.0 - t] };
        (barycentric[side], barycentric[(side + 1) % 3]) = (ends[0], ends[1]);
        Some(SurfacePoint { triangle, barycentric })
    }

    /// A point of the surface with its caps, or a point of the border in whose frame it is.
    fn in_original(&self, point: SurfacePoint) -> Option<SurfacePoint> {
        let count = self.original.triangles().len() as u32;
        if point.triangle < count {
            return Some(point);
        }
        let border = self.caps.partition_point(|(_, first)| *first <= point.triangle) - 1;
        self.on_border(border, (point.triangle - self.caps[border].1) as usize, 0.5)
    }
}

/// Borders on the left and on the right take turns.
fn is_left(border: usize) -> bool {
    border.is_multiple_of(2)
}

/// Along a closed walk, the length to each vertex, and of all.
fn lengths(walk: &[u32], surface: &SurfaceMesh) -> Vec<f64> {
    let mut lengths = vec![0.0];
    for (&v, &w) in walk.iter().zip(walk.iter().cycle().skip(1)) {
        let edge = surface.vertices()[w as usize] - surface.vertices()[v as usize];
        lengths.push(lengths[lengths.len() - 1] + edge.norm());
    }
    lengths
}

impl PairMapping<'_> {
    /// The domain in the class of maps that takes these loops to their partners, and what lies between them as a map through the sphere
    /// does. `None` where there is no such map.
    pub(super) fn lifted_by_loops(
        &self,
        loops: &[&LoopPair],
        embedding: &HyperbolicEmbedding,
    ) -> Result<Option<Lifted>, PairError> {
        let of_domain = loops.iter().map(|pair| &pair.domain[..]).collect();
        let of_target = loops.iter().map(|pair| &pair.target[..]).collect();
        let cut = CutOpen::new(self.domain, of_domain).zip(CutOpen::new(embedding.surface(), of_target));
        let Some((domain, target)) = cut else {
            return Ok(None);
        };
        let map = self.mapped_with_caps(&domain, &target)?;
        Ok(map.and_then(|map| class_of(&domain, &target, &map, embedding)))
    }

    /// A map of the domain with its caps to the target with its caps, through the sphere.
    fn mapped_with_caps(&self, domain: &CutOpen, target: &CutOpen) -> Result<Option<BoundaryMap>, PairError> {
        let caps = domain.caps.iter().zip(&target.caps).map(|(from, to)| [from.0, to.0]);
        let counts = [domain, target].map(|side| side.surface.vertices().len());
        let closed = |border: &Vec<u32>| border.iter().chain(border.first()).copied().collect();
        let borders = domain.borders.iter().zip(&target.borders);
        let options = PairOptions {
            landmarks: Landmarks::new(caps.collect(), counts[0], counts[1])?,
            curves: borders
                .map(|(from, to)| LandmarkCurve {
                    domain: closed(from),
                    target: closed(to),
                })
                .collect(),
            improve: false,
            up: self.options.up,
            aligned: self.options.aligned,
            ..PairOptions::default()
        };
        let progress = |phase| {
            let _ = self.reporter.send(phase);
            self.reporter.control()
        };
        match map_pair(&domain.surface, &target.surface, &options, &progress) {
            Ok((map, _)) => Ok(Some(map)),
            Err(PairError::Cancelled) => Err(PairError::Cancelled),
            // The other ways to a class are left.
            Err(_) => Ok(None),
        }
    }
}

/// The domain in the class of maps that is told by a map of both with their caps.
fn class_of(domain: &CutOpen, target: &CutOpen, map: &BoundaryMap, embedding: &HyperbolicEmbedding) -> Option<Lifted> {
    let relator: &Arc<Relator> = &embedding.group().relator;
    let of_original = embedding.crossings();
    // On the sphere, where edges go to great circles, shortest paths are such circles, too.
    let on_sphere = |embedding: Option<&SphericalEmbedding>, of: &SurfaceMesh| {
        let directions = embedding?.directions()[..of.vertices().len()].iter();
        SurfaceMesh::new(directions.map(|x| Point::from(*x)).collect(), of.triangles().to_vec()).ok()
    };
    let cut = on_sphere(map.domain_embedding(), &domain.without_caps()?)?;
    let onto = on_sphere(map.target_embedding(), &target.surface)?;
    let paths = TargetPaths::over(&onto, relator, target.crossings(&of_original, relator)?);
    let mut corners = vec![SurfacePoint::corner(0, 0); cut.vertices().len()];
    for (t, vertices) in (0u32..).zip(cut.triangles()) {
        (0..3).for_each(|k| corners[vertices[k] as usize] = SurfacePoint::corner(t, k));
    }
    let mut places: Vec<Option<SurfacePoint>> = map.evaluate_on_target(&corners)?.into_iter().map(Some).collect();
    // Vertices on the right of a loop are in the frames of other triangles than those on its left.
    let mut to_left = vec![Word::default(); places.len()];
    for (border, vertices) in domain.borders.iter().enumerate() {
        let lengths = lengths(domain.loops[border / 2], domain.original);
        for (k, &v) in vertices.iter().enumerate() {
            let share = lengths[k] / lengths[vertices.len()];
            let place = target.at_share(border, share)?;
            places[v as usize] = Some(place);
            if !is_left(border) {
                let left = target.at_share(border - 1, share)?;
                let sides = &of_original[place.triangle as usize];
                to_left[v as usize] = sides.iter().find(|(other, _)| *other == left.triangle)?.1.clone();
            }
        }
    }
    let mut corners = paths.corner_words(&cut, &places)?;
    for (words, vertices) in corners.iter_mut().zip(cut.triangles()) {
        for (word, v) in words.iter_mut().zip(vertices) {
            *word = relator.product(word, &to_left[*v as usize].inverted());
        }
    }
    let own = &places[..domain.original.vertices().len()];
    let own: Vec<_> = own.iter().map(|place| target.in_original((*place)?)).collect();
    Some(lifted(domain.original, embedding, &corners, &own))
}

//! Correspondences between surfaces of genus 0 that follow limbs into other poses, from intrinsic geometry alone.
//!
//! 1. Each surface gets its eigenfunctions, geodesic distances and extremities: the tips of its limbs
//!    ([`IntrinsicShape`]).
//! 2. Extremities are matched in the few ways that agree best with geodesic distances.
//! 3. Each matching determines a functional map of 20 eigenfunctions. Of those that preserve orientation, the closest to
//!    an isometry are kept: distances do not tell left from right, but the triangles of the map do.
//! 4. ZoomOut refines these to 100 eigenfunctions, in both directions ([`correspondences`]).
//!
//! Distances are in units of the square root of the surface's area. Surfaces of many vertices are simplified first, so that
//! the cost has a bound.

mod descriptors;
mod eigen;
mod extremities;
mod functional_map;
mod heat;
mod isometry;
mod laplacian;
mod matching;
mod simplified;
mod spectral;
mod triangulation;
mod zoomout;

pub use extremities::Extremity;
pub(crate) use isometry::{MappedVertex, isometry_defect};

use nalgebra::DMatrix;
use rayon::prelude::*;

use crate::Vector;
use crate::mesh::{SurfaceMesh, triangle_area};
use crate::spherical::SphericalEmbedding;
use eigen::Eigenpairs;
use extremities::{average_distances, extremities, highest};
use functional_map::{SampledMap, gram_factor, map_of_points};
use heat::HeatMethod;
use laplacian::{Laplacian, Neighbours};
use matching::{TipDistances, assignments};
use simplified::SimplifiedSurface;
use spectral::Rows;
use triangulation::IntrinsicTriangulation;
use zoomout::refined;

/// Surfaces with fewer vertices have no correspondences.
const LEAST_VERTICES: usize = 200;
/// Samples for each eigenfunction, at least.
const SAMPLES_PER_MODE: usize = 4;
/// Assignments of extremities that are compared by functional maps.
const ASSIGNMENTS: usize = 16;
/// Points that determine a map.
const LEAST_POINTS: usize = 3;
/// Maps whose images are on average this close, as a fraction of the target's diagonal, are the same.
const SAME: f64 = 0.05;
/// Maps that cover less of the target reverse the orientation of a part of it.
const LEAST_COVERAGE: f64 = 0.5;
/// An extremity is left out where that lowers the defect to this part of it.
const WORTHWHILE: f64 = 0.9;

/// The intrinsic geometry of a surface: eigenfunctions of its Laplacian, geodesic distances, extremities.
#[derive(Debug)]
pub struct IntrinsicShape {
    simplified: SimplifiedSurface,
    neighbours: Neighbours,
    heat: HeatMethod,
    eigenpairs: Eigenpairs,
    /// Eigenfunctions at the samples, their weights, and the factor of the weighted products.
    sample_rows: Vec<f64>,
    sample_weights: Vec<f64>,
    gram_factor: DMatrix<f64>,
    diagonal: f64,
    average_distances: Vec<f64>,
    /// Vertices of the surface as it was given.
    extremities: Vec<Extremity>,
    /// Distances from each extremity to all vertices of the simplified surface.
    distances: Vec<Vec<f64>>,
}

/// A correspondence between two surfaces.
#[derive(Debug, Clone, PartialEq)]
pub struct Correspondence {
    /// Matched extremities: a vertex of the domain and one of the target each.
    pub extremities: Vec<[u32; 2]>,
    /// For each vertex of the domain, a vertex of the target and a weight in (0, 1], by how well the map back agrees; `None`
    /// where it does not.
    pub targets: Vec<Option<(u32, f64)>>,
    /// How far the functional map `C` is from that of an isometry: `‖CᵀC − I‖² / 20`. Below 0.2 for different poses.
    pub defect: f64,
    /// How much of the target the correspondence covers, less what it covers with its back: about 1, by samples.
    pub coverage: f64,
}

impl IntrinsicShape {
    /// The intrinsic geometry of a closed, outward oriented surface of genus 0, with at most `modes` eigenfunctions (100
    /// do). `None` when it is anything else, has fewer than 200 vertices or no area, when there is not enough memory, or
    /// when `proceed`, which is asked several times in a second, says no.
    ///
    /// Takes about a second for 5000 vertices or more.
    pub fn new(surface: &SurfaceMesh, modes: usize, proceed: &(dyn Fn() -> bool + Sync)) -> Option<Self> {
        let is_finite = surface
            .vertices()
            .iter()
            .all(|p| p.coords.iter().all(|x| x.is_finite()));
        if surface.vertices().len() < LEAST_VERTICES || !is_finite {
            return None;
        }
        let simplified = SimplifiedSurface::new(surface)?;
        let triangulation = IntrinsicTriangulation::delaunay(&simplified.points, &simplified.triangles)?;
        let laplacian = Laplacian::new(&triangulation);
        let neighbours = laplacian.neighbours();
        let heat = HeatMethod::new(&triangulation, &laplacian)?;
        let modes = modes.min(simplified.samples.len() / SAMPLES_PER_MODE);
        let eigenpairs = Eigenpairs::lowest(&laplacian, modes, proceed)?;
        let slowest: Vec<f64> = (0..simplified.points.len() as u32)
            .map(|v| eigenpairs.at(v)[1].abs())
            .collect();
        let average_distances = average_distances(&heat, highest(&slowest), proceed)?;
        let mut extremities = extremities(&average_distances, &neighbours);
        let distances = extremities.iter().map(|tip| heat.distances(tip.vertex)).collect();
        extremities
            .iter_mut()
            .for_each(|tip| tip.vertex = simplified.originals[tip.vertex as usize]);
        let rows = simplified.samples.iter().flat_map(|&v| eigenpairs.at(v));
        let sample_rows: Vec<f64> = rows.copied().collect();
        let sample_weights = sample_weights(&simplified);
        Some(Self {
            gram_factor: gram_factor(&sample_rows, &sample_weights, modes)?,
            simplified,
            neighbours,
            heat,
            eigenpairs,
            sample_rows,
            sample_weights,
            diagonal: surface.diagonal(),
            average_distances,
            extremities,
            distances,
        })
    }

    /// The tips of limbs, the most persistent first; at most twelve.
    pub fn extremities(&self) -> &[Extremity] {
        &self.extremities
    }

    /// Geodesic distances of all vertices from one, in units of the square root of the area.
    pub fn distances_from(&self, vertex: u32) -> Vec<f64> {
        self.simplified
            .interpolated(&self.heat.distances(self.simplified.nearest(vertex)))
    }

    fn modes(&self) -> usize {
        self.eigenpairs.count()
    }

    /// The first eigenfunctions at all vertices of the simplified surface.
    fn all_rows(&self, modes: usize) -> Rows<'_> {
        Rows {
            entries: &self.eigenpairs.functions,
            stride: self.modes(),
            used: modes,
        }
    }

    /// The first eigenfunctions at the samples.
    fn sampled_rows(&self, modes: usize) -> Rows<'_> {
        Rows {
            entries: &self.sample_rows,
            stride: self.modes(),
            used: modes,
        }
    }

    fn tip_distances(&self, to_landmarks: &[Vec<f64>]) -> TipDistances {
        let tips: Vec<u32> = self
            .extremities
            .iter()
            .map(|tip| self.simplified.nearest(tip.vertex))
            .collect();
        let at = |distances: &Vec<f64>, tip: u32| distances[tip as usize];
        let of_tip = |tip: u32, sets: &[Vec<f64>]| sets.iter().map(|distances| at(distances, tip)).collect();
        TipDistances {
            average: tips.iter().map(|&tip| self.average_distances[tip as usize]).collect(),
            between: tips.iter().map(|&tip| of_tip(tip, &self.distances)).collect(),
            to_landmarks: tips.iter().map(|&tip| of_tip(tip, to_landmarks)).collect(),
        }
    }
}

/// Correspondences between two surfaces, the closest to an isometry first: at most `most`, all different, all orientation
/// preserving. Empty when there are not three matched extremities and landmarks together, or when `proceed` says no.
///
/// `target_embedding` is of the target's surface, with the same vertices. Landmarks are pairs of a vertex of the domain and
/// the one of the target that it goes to; extremities are matched consistently with them. Takes about a second.
pub fn correspondences(
    domain: &IntrinsicShape,
    target: &IntrinsicShape,
    target_embedding: &SphericalEmbedding,
    landmarks: &[[u32; 2]],
    most: usize,
    proceed: &(dyn Fn() -> bool + Sync),
) -> Vec<Correspondence> {
    let Some(search) = Search::new(domain, target, target_embedding.directions(), landmarks) else {
        return Vec::new();
    };
    let mut found = search.candidates(proceed);
    found.truncate(most);
    let mut found: Vec<Candidate> = found
        .into_par_iter()
        .map(|candidate| search.without_misfits(candidate))
        .collect();
    sort_distinct(&mut found, target);
    let refine = |candidate: Candidate| {
        let tips = |&[i, j]: &[usize; 2]| [domain.extremities[i].vertex, target.extremities[j].vertex];
        Some(Correspondence {
            targets: refined(domain, target, &candidate.map.images, proceed)?,
            extremities: candidate.pairs.iter().map(tips).collect(),
            defect: candidate.map.defect,
            coverage: candidate.map.coverage,
        })
    };
    let refined: Option<Vec<Correspondence>> = found.into_par_iter().map(refine).collect();
    refined.unwrap_or_default()
}

/// The correspondence that a map between the surfaces becomes when it is refined by eigenfunctions, as [`correspondences`] are: for each
/// vertex of the domain a vertex of the target and a weight. `image` is the vertex of the target that is nearest to the image of a vertex.
/// Places where the map is distorted are smoothed out, and limbs stay where they are. `None` when the map does not determine it, or
/// `proceed` says no.
pub(crate) fn correspondence_of_map(
    domain: &IntrinsicShape,
    target: &IntrinsicShape,
    image: impl Fn(u32) -> u32,
    proceed: &(dyn Fn() -> bool + Sync),
) -> Option<Vec<Option<(u32, f64)>>> {
    let of_sample = |&sample: &u32| {
        let vertex = domain.simplified.originals[sample as usize];
        target.simplified.nearest(image(vertex))
    };
    let images: Vec<u32> = domain.simplified.samples.iter().map(of_sample).collect();
    refined(domain, target, &images, proceed)
}

/// Maps between two shapes by their matched points.
struct Search<'a> {
    domain: &'a IntrinsicShape,
    target: &'a IntrinsicShape,
    directions: &'a [Vector],
    /// Distances from the landmarks on the domain, and on the target.
    to_landmarks: [Vec<Vec<f64>>; 2],
}

/// An assignment of extremities, by their places in the two lists, and its map.
struct Candidate {
    pairs: Vec<[usize; 2]>,
    map: SampledMap,
}

impl<'a> Search<'a> {
    /// `None` when a landmark or direction is missing.
    fn new(
        domain: &'a IntrinsicShape,
        target: &'a IntrinsicShape,
        directions: &'a [Vector],
        landmarks: &[[u32; 2]],
    ) -> Option<Self> {
        let shapes = [domain, target];
        let is_vertex = |side: usize, v: u32| (v as usize) < shapes[side].simplified.places.len();
        let are_vertices = landmarks
            .iter()
            .all(|pair| (0..2).all(|side| is_vertex(side, pair[side])));
        let distances = |side: usize| {
            let shape = shapes[side];
            landmarks
                .iter()
                .map(|pair| shape.heat.distances(shape.simplified.nearest(pair[side])))
                .collect()
        };
        (are_vertices && directions.len() == target.simplified.places.len()).then(|| Self {
            domain,
            target,
            directions,
            to_landmarks: [distances(0), distances(1)],
        })
    }

    /// Different orientation-preserving maps of the best assignments, the closest to an isometry first.
    fn candidates(&self, proceed: &(dyn Fn() -> bool + Sync)) -> Vec<Candidate> {
        let [of_domain, of_target] = &self.to_landmarks;
        let (from, to) = (
            self.domain.tip_distances(of_domain),
            self.target.tip_distances(of_target),
        );
        let assignments = assignments(&from, &to, ASSIGNMENTS).into_par_iter();
        let candidates = assignments.filter_map(|pairs| if proceed() { self.candidate(pairs) } else { None });
        let mut candidates: Vec<Candidate> = candidates.collect();
        sort_distinct(&mut candidates, self.target);
        candidates
    }

    /// The map of an assignment. `None` when too few points are matched or it is not orientation preserving.
    fn candidate(&self, pairs: Vec<[usize; 2]>) -> Option<Candidate> {
        let of_tips = pairs
            .iter()
            .map(|&[i, j]| [&self.domain.distances[i][..], &self.target.distances[j]]);
        let landmarks = self.to_landmarks[0].iter().zip(&self.to_landmarks[1]);
        let points: Vec<_> = of_tips.chain(landmarks.map(|(from, to)| [&from[..], to])).collect();
        if points.len() < LEAST_POINTS {
            return None;
        }
        let map = map_of_points(self.domain, self.target, self.directions, &points)?;
        (map.coverage > LEAST_COVERAGE).then_some(Candidate { pairs, map })
    }

    /// The candidate without extremities that have no true partner: leaving them out lowers the defect.
    fn without_misfits(&self, mut candidate: Candidate) -> Candidate {
        loop {
            let shorter = (0..candidate.pairs.len()).into_par_iter().filter_map(|left_out| {
                let mut pairs = candidate.pairs.clone();
                pairs.remove(left_out);
                self.candidate(pairs)
            });
            let best = shorter
                .collect::<Vec<_>>()
                .into_iter()
                .min_by(|a, b| a.map.defect.total_cmp(&b.map.defect));
            match best {
                Some(best) if best.map.defect < WORTHWHILE * candidate.map.defect => candidate = best,
                _ => return candidate,
            }
        }
    }
}

/// Sorts by the defect and leaves out maps that are as good as the same as one before.
fn sort_distinct(candidates: &mut Vec<Candidate>, target: &IntrinsicShape) {
    candidates.sort_by(|a, b| a.map.defect.total_cmp(&b.map.defect));
    let points = &target.simplified.points;
    let mut kept: Vec<Candidate> = Vec::new();
    for candidate in candidates.drain(..) {
        let is_same = |other: &Candidate| {
            let images = candidate.map.images.iter().zip(&other.map.images);
            let distances = images.map(|(&a, &b)| (points[a as usize] - points[b as usize]).norm());
            distances.sum::<f64>() < SAME * target.diagonal * candidate.map.images.len() as f64
        };
        if !kept.iter().any(is_same) {
            kept.push(candidate);
        }
    }
    *candidates = kept;
}

/// The area around each sample: a third of its triangles.
fn sample_weights(simplified: &SimplifiedSurface) -> Vec<f64> {
    let position = |place: u32| simplified.points[simplified.samples[place as usize] as usize];
    let mut weights = vec![0.0; simplified.samples.len()];
    for corners in &simplified.sample_triangles {
        let area = triangle_area(&corners.map(position));
        corners.iter().for_each(|&place| weights[place as usize] += area / 3.0);
    }
    let total: f64 = weights.iter().sum();
    weights.iter_mut().for_each(|weight| *weight /= total);
    weights
}

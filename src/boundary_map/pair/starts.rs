//! Where the search for an embedding starts from: soft targets by shape in space, by intrinsic shape, or by a map that is
//! given.

use std::borrow::Cow;
use std::sync::Arc;

use super::alignment::{align_by_landmarks, align_upright, is_upright};
use super::embedder::SoftTargets;
use super::inter_surface::InverseEmbedding;
use super::isometry::IntrinsicShapes;
use super::landmark_warp::warped;
use super::report::{PairPhase, PairStartKind};
use super::targets::{VertexTarget, targets_of_vertices, vertex_targets};
use super::{AlignmentSurface, PairError, PairMapping};
use crate::boundary_map::BoundaryMap;
use crate::geometry::{Similarity, SurfaceQuery, similarity};
use crate::intrinsic::{Correspondence, IntrinsicShape, correspondence_of_map, correspondences};
use crate::spherical::SphericalEmbedding;
use crate::{Point, Vector};

/// Eigenfunctions of intrinsic correspondences, and the most correspondences that are tried.
const MODES: usize = 100;
const MOST_CORRESPONDENCES: usize = 3;
/// Weight of the soft target of an extremity, over the largest of others.
const EXTREMITY_WEIGHT: f64 = 30.0;

/// Fewest landmarks by which the domain is deformed: a similarity takes three of them close to their places as it is.
const LEAST_WARPED: usize = 4;

/// Soft targets that the embeddings of the domain start from.
pub(super) struct Start {
    pub kind: PairStartKind,
    /// Those of the vertices that coarse embeddings are pulled by; of the others where nothing has to be computed for them.
    pub soft_targets: SoftTargets,
    /// How those of the others are found.
    closest: Option<ClosestPoints>,
}

/// By which the closest points of the target are found for vertices of the aligned domain.
pub(super) struct ClosestPoints {
    domain: Arc<AlignmentSurface>,
    target: Arc<AlignmentSurface>,
    alignment: Similarity,
}

impl ClosestPoints {
    /// The closest points of the target for all vertices of the domain.
    pub fn of_all(&self) -> Vec<Option<VertexTarget>> {
        vertex_targets(&self.domain, &self.target, &self.alignment)
    }
}

impl Start {
    fn complete(kind: PairStartKind, soft_targets: SoftTargets) -> Self {
        Self {
            kind,
            soft_targets,
            closest: None,
        }
    }

    /// With the soft targets of these vertices.
    fn by_closest_points(
        kind: PairStartKind,
        closest: ClosestPoints,
        target: &SphericalEmbedding,
        vertices: &[u32],
    ) -> Self {
        let ClosestPoints {
            domain,
            target: onto,
            alignment,
        } = &closest;
        let mut soft_targets = vec![None; domain.vertex_count()];
        let found = targets_of_vertices(domain, onto, alignment, vertices);
        for (&v, found) in vertices.iter().zip(found) {
            soft_targets[v as usize] = found.map(|found| soft_target(target, &found));
        }
        Self {
            kind,
            soft_targets,
            closest: Some(closest),
        }
    }

    /// The soft targets of all vertices.
    pub(super) fn all_soft_targets(&self, target: &SphericalEmbedding) -> Cow<'_, SoftTargets> {
        match &self.closest {
            None => Cow::Borrowed(&self.soft_targets),
            Some(closest) => {
                let found = closest.of_all();
                let of_vertex = |found: Option<VertexTarget>| found.map(|found| soft_target(target, &found));
                Cow::Owned(found.into_iter().map(of_vertex).collect())
            }
        }
    }
}

fn soft_target(target: &SphericalEmbedding, found: &VertexTarget) -> (Vector, f64) {
    (target.direction(&found.place), found.weight)
}

/// Alignments and intrinsic shapes, which do not depend on embeddings.
#[derive(Default)]
pub(super) struct ShapeMatches {
    alignments: Vec<(PairStartKind, ClosestPoints)>,
    /// About the pair.
    warnings: Vec<String>,
    /// None where solids lie in the same place, or a surface has none; where a map is given, those that are known.
    shapes: Option<IntrinsicShapes>,
}

/// Alignments of a pair.
pub(super) struct PairAlignments {
    pub all: Vec<(PairStartKind, ClosestPoints)>,
    /// About the pair.
    pub warnings: Vec<String>,
}

/// All starts of a pair, and what was found beside.
pub(super) struct Starts {
    pub all: Vec<Start>,
    /// About the pair.
    pub warnings: Vec<String>,
    /// As in [`ShapeMatches`].
    pub shapes: Option<IntrinsicShapes>,
    /// The correspondence by intrinsic shape that is closest to an isometry.
    pub closest: Option<Correspondence>,
}

impl PairMapping<'_> {
    /// The starts, with the soft targets of these vertices at least.
    pub(super) fn starts(&self, matches: ShapeMatches, inverse: &InverseEmbedding, vertices: &[u32]) -> Starts {
        let target = inverse.target();
        let ShapeMatches {
            alignments,
            warnings,
            shapes,
        } = matches;
        let given = self.soft_targets_of_given(target);
        let given = given.map(|soft_targets| Start::complete(PairStartKind::Given, soft_targets));
        let aligned = alignments
            .into_iter()
            .map(|(kind, closest)| Start::by_closest_points(kind, closest, target, vertices));
        let mut all: Vec<Start> = given.into_iter().chain(aligned).collect();
        let found = match (&shapes, self.refined) {
            (Some(shapes), Some(map)) => {
                all.extend(self.start_of_map(map, shapes, inverse));
                vec![]
            }
            (Some(shapes), None) if self.options.start.is_none() => self.correspondences(shapes, target),
            _ => vec![],
        };
        all.extend(found.iter().flat_map(|found| starts_of_correspondence(found, target)));
        Starts {
            all,
            warnings,
            shapes,
            closest: found.into_iter().next(),
        }
    }

    /// Alignments of the solids and their intrinsic shapes; no alignments where a map is given or refined. Reports nothing: it is made
    /// beside the target's embedding.
    pub(super) fn shape_matches(&self) -> Result<ShapeMatches, PairError> {
        if self.options.start.is_some() || self.refined.is_some() {
            return Ok(ShapeMatches {
                shapes: self.shapes.cloned(),
                ..ShapeMatches::default()
            });
        }
        let PairAlignments { all, warnings } = self.alignments()?;
        Ok(ShapeMatches {
            alignments: all,
            warnings,
            shapes: match self.options.aligned {
                true => None,
                false => self.intrinsic_shapes(),
            },
        })
    }

    /// Alignments by shape, by landmarks, and after a deformation by landmarks; curves and loops count as landmarks.
    pub(super) fn alignments(&self) -> Result<PairAlignments, PairError> {
        let from = Arc::new(AlignmentSurface::new(self.domain, "domain")?);
        let to = Arc::new(AlignmentSurface::new(self.target, "target")?);
        let closest = |domain: &Arc<AlignmentSurface>, alignment: &Similarity| ClosestPoints {
            domain: domain.clone(),
            target: to.clone(),
            alignment: *alignment,
        };
        let mut alignments = Vec::new();
        if self.options.aligned {
            alignments.push((PairStartKind::Aligned, closest(&from, &Similarity::identity())));
            return Ok(PairAlignments {
                all: alignments,
                warnings: vec![],
            });
        }
        let mut pairs = self.landmarks.positions(self.domain.vertices(), self.target.vertices());
        pairs.extend(self.curves.iter().map(|point| {
            let place = point.place.position(self.target, self.target.vertices());
            (self.domain.vertices()[point.vertex as usize], place)
        }));
        // Landmarks on a line, or fewer than three, say nothing about the rotation.
        let by_landmarks = align_by_landmarks(&from, &to, &pairs).ok();
        if let Some(found) = &by_landmarks {
            let similarity = &found.best[0].similarity;
            alignments.push((PairStartKind::Landmarks, closest(&from, similarity)));
            let warped = (pairs.len() >= LEAST_WARPED)
                .then(|| warped(self.domain, similarity, &pairs))
                .flatten();
            // A domain that folds into nothing has no frame.
            if let Some(warped) = warped.and_then(|warped| AlignmentSurface::new(&warped, "domain").ok()) {
                let closest = closest(&Arc::new(warped), &Similarity::identity());
                alignments.push((PairStartKind::LandmarkWarp, closest));
            }
        }
        let by_shape = align_upright(&from, &to, self.options.up.as_ref());
        let mut warnings = Vec::new();
        if by_landmarks.as_ref().unwrap_or(&by_shape).looks_mirrored() {
            warnings.push(
                "the target looks like the mirror image of the domain; mirror one of them if that is not what you want"
                    .into(),
            );
        }
        let of_alignment = |found: &super::Alignment| (PairStartKind::Alignment, closest(&from, &found.similarity));
        alignments.extend(by_shape.best.iter().map(of_alignment));
        Ok(PairAlignments {
            all: alignments,
            warnings,
        })
    }

    /// The intrinsic shapes of both surfaces, if they have any.
    pub(super) fn intrinsic_shapes(&self) -> Option<IntrinsicShapes> {
        if let Some(known) = self.shapes {
            return Some(known.clone());
        }
        let proceed = || self.reporter.should_improve();
        let shape = |surface| IntrinsicShape::new(surface, MODES, &proceed);
        let (domain, target) = rayon::join(|| shape(self.domain), || shape(self.target));
        Some(IntrinsicShapes {
            domain: Arc::new(domain?),
            target: Arc::new(target?),
        })
    }

    /// Correspondences by intrinsic shape, the closest to an isometry first.
    fn correspondences(&self, shapes: &IntrinsicShapes, target: &SphericalEmbedding) -> Vec<Correspondence> {
        let proceed = || self.reporter.should_improve();
        // A cancellation takes effect by `should_improve`.
        let _ = self.reporter.send(PairPhase::Intrinsic { done: 1, of: 2 });
        let (from, to, pairs) = (&shapes.domain, &shapes.target, self.landmarks.pairs());
        let mut found = correspondences(from, to, target, pairs, MOST_CORRESPONDENCES, &proceed);
        if let Some(up) = &self.options.up {
            found.retain(|correspondence| self.is_upright(correspondence, up));
        }
        found
    }

    /// Soft targets by a map through the target's embedding, refined by eigenfunctions.
    fn start_of_map(&self, map: &BoundaryMap, shapes: &IntrinsicShapes, inverse: &InverseEmbedding) -> Option<Start> {
        let of_domain = map.domain_embedding()?.directions();
        let image = |v: u32| {
            let (corners, barycentric) = inverse.corners(&of_domain[v as usize]);
            let nearest = (0..3).max_by(|&i, &j| barycentric[i].total_cmp(&barycentric[j]));
            corners[nearest.unwrap_or(0)]
        };
        let proceed = || self.reporter.should_improve();
        let targets = correspondence_of_map(&shapes.domain, &shapes.target, image, &proceed)?;
        let directions = inverse.target().directions();
        let soft_target = |found: Option<(u32, f64)>| found.map(|(w, weight)| (directions[w as usize], weight));
        let soft_targets = targets.into_iter().map(soft_target).collect();
        Some(Start::complete(PairStartKind::Refined, soft_targets))
    }

    /// Whether the best rotation between corresponding points takes one direction roughly to the other.
    fn is_upright(&self, correspondence: &Correspondence, up: &[Vector; 2]) -> bool {
        let pairs = self.domain.vertices().iter().zip(&correspondence.targets);
        let pairs =
            pairs.filter_map(|(p, found)| found.map(|(w, weight)| (*p, self.target.vertices()[w as usize], weight)));
        let pairs: Vec<(Point, Point, f64)> = pairs.collect();
        similarity(&pairs, 1.0, None).is_none_or(|found| is_upright(&found.rotation, up))
    }

    /// The images of the vertices under the map that is given: bit for bit its directions where the target's embedding is
    /// that of the map.
    fn soft_targets_of_given(&self, target: &SphericalEmbedding) -> Option<SoftTargets> {
        let given = self.options.start.as_ref()?;
        if let (Some(domain), Some(same)) = (given.domain_embedding(), given.target_embedding())
            && same.surface() == target.surface()
            && same.directions() == target.directions()
        {
            return Some(domain.directions().iter().map(|x| Some((*x, 1.0))).collect());
        }
        let query = SurfaceQuery::new(self.target).ok()?;
        let soft_target = |image: &Point| {
            let place = query.closest_point(image).surface_point();
            Some((target.direction(&place), 1.0))
        };
        Some(given.image().iter().map(soft_target).collect())
    }
}

/// Soft targets by a correspondence, and the same with strong pulls at extremities.
fn starts_of_correspondence(correspondence: &Correspondence, target: &SphericalEmbedding) -> [Start; 2] {
    let direction = |w: u32| target.directions()[w as usize];
    let soft_target = |&(w, weight): &(u32, f64)| (direction(w), weight);
    let soft_targets: SoftTargets = correspondence
        .targets
        .iter()
        .map(|found| found.as_ref().map(soft_target))
        .collect();
    let mut with_extremities = soft_targets.clone();
    for &[v, w] in &correspondence.extremities {
        with_extremities[v as usize] = Some((direction(w), EXTREMITY_WEIGHT));
    }
    [
        Start::complete(PairStartKind::Intrinsic, soft_targets),
        Start::complete(PairStartKind::Extremities, with_extremities),
    ]
}

//! Where the search for an embedding starts from: soft targets by shape in space, by intrinsic shape, or by a map that is
//! given.

use std::sync::Arc;

use super::alignment::{align_by_landmarks, align_with_progress, is_upright};
use super::embedder::SoftTargets;
use super::isometry::IntrinsicShapes;
use super::landmark_warp::warped;
use super::report::{PairPhase, PairStartKind};
use super::targets::{VertexTarget, vertex_targets};
use super::{AlignmentSurface, PairError, PairMapping};
use crate::geometry::{Similarity, SurfaceQuery, similarity};
use crate::intrinsic::{Correspondence, IntrinsicShape, correspondences};
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
    pub soft_targets: SoftTargets,
}

/// All starts of a pair, and what was found beside.
pub(super) struct Starts {
    pub all: Vec<Start>,
    /// About the pair.
    pub warnings: Vec<String>,
    /// None where solids lie in the same place or a map is given, or where a surface has none.
    pub shapes: Option<IntrinsicShapes>,
    /// The correspondence by intrinsic shape that is closest to an isometry.
    pub closest: Option<Correspondence>,
}

impl PairMapping<'_> {
    pub(super) fn starts(&self, target: &SphericalEmbedding) -> Result<Starts, PairError> {
        if let Some(soft_targets) = self.soft_targets_of_given(target) {
            let kind = PairStartKind::Given;
            return Ok(Starts {
                all: vec![Start { kind, soft_targets }],
                warnings: vec![],
                shapes: None,
                closest: None,
            });
        }
        let (mut all, warnings) = self.starts_by_alignment(target)?;
        let shapes = match self.options.aligned {
            true => None,
            false => self.intrinsic_shapes(),
        };
        let found = shapes
            .as_ref()
            .map_or(vec![], |shapes| self.correspondences(shapes, target));
        all.extend(found.iter().flat_map(|found| starts_of_correspondence(found, target)));
        Ok(Starts {
            all,
            warnings,
            shapes,
            closest: found.into_iter().next(),
        })
    }

    /// Soft targets by the closest points once the solids are aligned.
    fn starts_by_alignment(&self, target: &SphericalEmbedding) -> Result<(Vec<Start>, Vec<String>), PairError> {
        let from = AlignmentSurface::new(self.domain, "domain")?;
        let to = AlignmentSurface::new(self.target, "target")?;
        let direction = |found: VertexTarget| (target.direction(&found.place), found.weight);
        let start = |similarity: &Similarity, kind| {
            let found = vertex_targets(&from, &to, similarity);
            let soft_targets = found.into_iter().map(|found| found.map(direction)).collect();
            Start { kind, soft_targets }
        };
        if self.options.aligned {
            return Ok((vec![start(&Similarity::identity(), PairStartKind::Aligned)], vec![]));
        }
        let mut starts = Vec::new();
        let mut pairs = self.landmarks.positions(self.domain.vertices(), self.target.vertices());
        pairs.extend(self.curves.iter().map(|point| {
            let place = point.place.position(self.target, self.target.vertices());
            (self.domain.vertices()[point.vertex as usize], place)
        }));
        // Landmarks on a line, or fewer than three, say nothing about the rotation.
        let by_landmarks = align_by_landmarks(&from, &to, &pairs).ok();
        if let Some(found) = &by_landmarks {
            let similarity = &found.best[0].similarity;
            starts.push(start(similarity, PairStartKind::Landmarks));
            let warped = (pairs.len() >= LEAST_WARPED)
                .then(|| warped(self.domain, similarity, &pairs))
                .flatten();
            // A domain that folds into nothing has no frame.
            if let Some(from) = warped.and_then(|warped| AlignmentSurface::new(&warped, "domain").ok()) {
                let found = vertex_targets(&from, &to, &Similarity::identity());
                let kind = PairStartKind::LandmarkWarp;
                let soft_targets = found.into_iter().map(|found| found.map(direction)).collect();
                starts.push(Start { kind, soft_targets });
            }
        }
        let progress = |done, of| {
            // A cancellation takes effect when the alignments are there, in a second or two.
            let _ = self.reporter.send(PairPhase::Aligning { done, of });
        };
        let alignments = align_with_progress(&from, &to, self.options.up.as_ref(), &progress);
        let mut warnings = Vec::new();
        if by_landmarks.as_ref().unwrap_or(&alignments).looks_mirrored() {
            warnings.push(
                "the target looks like the mirror image of the domain; mirror one of them if that is not what you want"
                    .into(),
            );
        }
        let of_alignment = |found: &super::Alignment| start(&found.similarity, PairStartKind::Alignment);
        starts.extend(alignments.best.iter().map(of_alignment));
        Ok((starts, warnings))
    }

    /// The intrinsic shapes of both surfaces, if they have any.
    fn intrinsic_shapes(&self) -> Option<IntrinsicShapes> {
        if let Some(known) = self.shapes {
            return Some(known.clone());
        }
        let proceed = || self.reporter.should_improve();
        self.intrinsic_step(0);
        let shape = |surface| IntrinsicShape::new(surface, MODES, &proceed);
        let (domain, target) = rayon::join(|| shape(self.domain), || shape(self.target));
        Some(IntrinsicShapes {
            domain: Arc::new(domain?),
            target: Arc::new(target?),
        })
    }

    fn intrinsic_step(&self, done: usize) {
        // A cancellation takes effect by `should_improve`.
        let _ = self.reporter.send(PairPhase::Intrinsic { done, of: 2 });
    }

    /// Correspondences by intrinsic shape, the closest to an isometry first.
    fn correspondences(&self, shapes: &IntrinsicShapes, target: &SphericalEmbedding) -> Vec<Correspondence> {
        let proceed = || self.reporter.should_improve();
        self.intrinsic_step(1);
        let (from, to, pairs) = (&shapes.domain, &shapes.target, self.landmarks.pairs());
        let mut found = correspondences(from, to, target, pairs, MOST_CORRESPONDENCES, &proceed);
        if let Some(up) = &self.options.up {
            found.retain(|correspondence| self.is_upright(correspondence, up));
        }
        found
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
    let soft_targets = correspondence
        .targets
        .iter()
        .map(|found| found.as_ref().map(soft_target));
    let intrinsic = Start {
        kind: PairStartKind::Intrinsic,
        soft_targets: soft_targets.collect(),
    };
    let mut soft_targets = intrinsic.soft_targets.clone();
    for &[v, w] in &correspondence.extremities {
        soft_targets[v as usize] = Some((direction(w), EXTREMITY_WEIGHT));
    }
    let kind = PairStartKind::Extremities;
    [intrinsic, Start { kind, soft_targets }]
}

//! Where the search for an embedding starts from: soft targets by shape in space, by intrinsic shape, or by a map that is
//! given.

use super::alignment::{align_by_landmarks, align_with_progress};
use super::embedder::SoftTargets;
use super::report::{PairPhase, PairStartKind};
use super::targets::{VertexTarget, vertex_targets};
use super::{AlignmentSurface, PairError, PairMapping};
use crate::geometry::{Similarity, SurfaceQuery};
use crate::spherical::SphericalEmbedding;

/// Soft targets that the embeddings of the domain start from.
pub(super) struct Start {
    pub kind: PairStartKind,
    pub soft_targets: SoftTargets,
}

impl PairMapping<'_> {
    /// The starts, and warnings about the pair.
    pub(super) fn starts(&self, target: &SphericalEmbedding) -> Result<(Vec<Start>, Vec<String>), PairError> {
        if let Some(soft_targets) = self.soft_targets_of_given(target) {
            let kind = PairStartKind::Given;
            return Ok((vec![Start { kind, soft_targets }], vec![]));
        }
        let (mut starts, warnings) = self.starts_by_alignment(target)?;
        if !self.options.aligned {
            starts.extend(self.intrinsic_starts(target));
        }
        Ok((starts, warnings))
    }

    /// Soft targets by the closest points once the solids are aligned.
    fn starts_by_alignment(&self, target: &SphericalEmbedding) -> Result<(Vec<Start>, Vec<String>), PairError> {
        let from = AlignmentSurface::new(self.domain, "domain")?;
        let to = AlignmentSurface::new(self.target, "target")?;
        let start = |similarity: &Similarity, kind| {
            let found = vertex_targets(&from, &to, similarity);
            let direction = |found: VertexTarget| (target.direction(&found.place), found.weight);
            let soft_targets = found.into_iter().map(|found| found.map(direction)).collect();
            Start { kind, soft_targets }
        };
        if self.options.aligned {
            return Ok((vec![start(&Similarity::identity(), PairStartKind::Aligned)], vec![]));
        }
        let mut starts = Vec::new();
        let pairs = self.landmarks.positions(self.domain.vertices(), self.target.vertices());
        // Landmarks on a line, or fewer than three, say nothing about the rotation.
        let by_landmarks = align_by_landmarks(&from, &to, &pairs).ok();
        if let Some(found) = &by_landmarks {
            starts.push(start(&found.best[0].similarity, PairStartKind::Landmarks));
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

    /// Soft targets by intrinsic correspondences.
    fn intrinsic_starts(&self, _target: &SphericalEmbedding) -> Vec<Start> {
        Vec::new()
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
        let soft_target = |image: &crate::Point| {
            let place = query.closest_point(image).surface_point();
            Some((target.direction(&place), 1.0))
        };
        Some(given.image().iter().map(soft_target).collect())
    }
}

//! The map by soft targets, sought from the target to the domain, too, where the first search ends off an isometry: either search
//! gets stuck at other minima.

use super::isometry::{Quality, SMALL_DEFECT, is_off};
use super::soft_targets::SoftTargetMaps;
use super::{PairError, PairMapping, PairMaps, PairOptions, PairReport};

/// A map that was sought from the target to the domain, turned round.
struct Reversed {
    maps: PairMaps,
    quality: Quality,
}

impl PairMapping<'_> {
    /// As [`Self::by_soft_targets`]; where that ends [off](is_off) an isometry, a map is sought the other way, too, and the better
    /// one is taken.
    pub(super) fn by_soft_targets_both_ways(&self) -> Result<PairMaps, PairError> {
        let first = self.by_soft_targets(None)?.ok_or(PairError::NoEmbedding)?;
        let is_seen_off = first.quality.isometry_defect.is_some_and(is_off);
        if !is_seen_off || !self.is_free_search() || !self.reporter.should_improve() {
            return Ok(first.maps);
        }
        let reversed = self.by_soft_targets_from_target(&first)?;
        let mut made = first.maps;
        if let Some(Reversed { maps, quality }) = reversed
            && quality.rating() < first.quality.rating()
        {
            let found = maps.report;
            made.map = maps.map;
            made.report = PairReport {
                is_reversed: true,
                after: found.after,
                stretch: found.stretch,
                isometry_defect: found.isometry_defect,
                nearer_isometry: found.nearer_isometry,
                warnings: found.warnings,
                ..made.report
            };
        }
        let timings = &mut made.report.timings;
        let total = self.elapsed();
        timings.reversed = total - timings.total;
        timings.total = total;
        made.report.concluded = self.reporter.should_conclude();
        if let Some(defect) = made.report.isometry_defect.filter(|defect| is_off(*defect)) {
            made.report.warnings.push(format!(
                "if the solids are poses of one body, a part of it may be out of its place, such as a head turned round: the map has an \
                 isometry defect of {defect:.3}, and right ones have less than {SMALL_DEFECT}. Look at it, and give landmarks there"
            ));
        }
        Ok(made)
    }

    /// Whether nothing that is given says where the domain goes.
    fn is_free_search(&self) -> bool {
        let options = self.options;
        self.landmarks.pairs().is_empty()
            && self.curves.is_empty()
            && options.start.is_none()
            && !options.aligned
            && options.improve
    }

    /// The inverse of the map that is found from the target to the domain, improved as a map of the domain; `None` where its coarse
    /// embeddings are no better than the first map's, or none is found.
    fn by_soft_targets_from_target(&self, first: &SoftTargetMaps) -> Result<Option<Reversed>, PairError> {
        let shapes = first.shapes.as_ref().map(|shapes| shapes.exchanged());
        let options = PairOptions {
            up: self.options.up.map(|[domain, target]| [target, domain]),
            alternatives: 0,
            ..self.options.clone()
        };
        let back = PairMapping {
            domain: self.target,
            target: self.domain,
            options: &options,
            shapes: shapes.as_ref(),
            ..*self
        };
        let Some(found) = some_or_cancelled(back.by_soft_targets(first.coarse_rating))? else {
            return Ok(None);
        };
        // The target's triangles are not distorted much, but the domain's may be where they bend about limbs.
        let Some(start) = found.maps.map.inverse() else {
            return Ok(None);
        };
        let options = PairOptions {
            start: Some(start),
            alternatives: 0,
            ..self.options.clone()
        };
        let improving = PairMapping {
            options: &options,
            shapes: first.shapes.as_ref(),
            ..*self
        };
        let Some(improved) = some_or_cancelled(improving.by_soft_targets(None))? else {
            return Ok(None);
        };
        let quality = Quality {
            isometry_defect: found.quality.isometry_defect,
            ..improved.quality
        };
        let report = PairReport {
            isometry_defect: found.maps.report.isometry_defect,
            nearer_isometry: found.maps.report.nearer_isometry,
            warnings: found.maps.report.warnings,
            ..improved.maps.report
        };
        let maps = PairMaps {
            report,
            ..improved.maps
        };
        Ok(Some(Reversed { maps, quality }))
    }
}

/// What a search has found; `None` where it failed, since the first map is there. Only a cancellation is passed on.
fn some_or_cancelled(found: Result<Option<SoftTargetMaps>, PairError>) -> Result<Option<SoftTargetMaps>, PairError> {
    match found {
        Err(PairError::Cancelled) => Err(PairError::Cancelled),
        found => Ok(found.ok().flatten()),
    }
}

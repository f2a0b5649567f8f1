//! The map by soft targets, sought from the target to the domain, too, where the first search ends off an isometry: either search
//! gets stuck at other minima.

use super::isometry::{Quality, is_off};
use super::{
    BoundaryMap, PairError, PairMapping, PairMaps, PairOptions, PairReport, Stretch, distortion, product_of_quantiles,
};

impl PairMapping<'_> {
    /// As [`Self::by_soft_targets`]; where that ends [off](is_off) an isometry, a map is sought the other way, too, and the better
    /// one is taken.
    pub(super) fn by_soft_targets_both_ways(&self) -> Result<PairMaps, PairError> {
        let mut made = self.by_soft_targets()?;
        let is_seen_off = made.report.isometry_defect.is_some_and(is_off);
        if !is_seen_off || !self.is_free_search() || !self.reporter.should_improve() {
            return Ok(made);
        }
        if let Some((map, found)) = self.by_soft_targets_from_target()?
            && rating(&found) < rating(&made.report)
        {
            made.map = map;
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

    /// The inverse of the map that is found from the target to the domain, with its own distortion and stretch in the report;
    /// `None` where none is found.
    fn by_soft_targets_from_target(&self) -> Result<Option<(BoundaryMap, PairReport)>, PairError> {
        let options = PairOptions {
            up: self.options.up.map(|[domain, target]| [target, domain]),
            alternatives: 0,
            ..self.options.clone()
        };
        let back = PairMapping {
            domain: self.target,
            target: self.domain,
            options: &options,
            ..*self
        };
        let found = match back.by_soft_targets() {
            Ok(found) => found,
            Err(PairError::Cancelled) => return Err(PairError::Cancelled),
            Err(_) => return Ok(None),
        };
        let Some(map) = found.map.inverse() else {
            return Ok(None);
        };
        let measured = distortion(&map).zip(Stretch::of(&map, self.options.most_stretched));
        Ok(measured.map(|(after, stretch)| {
            let report = PairReport {
                after,
                stretch,
                ..found.report
            };
            (map, report)
        }))
    }
}

/// What the maps are compared by, as [`Quality`] says, but by quantiles of the distortion in place of the mean, which single
/// triangles rule.
fn rating(report: &PairReport) -> f64 {
    let quality = Quality {
        energy: product_of_quantiles(&report.after).cbrt(),
        isometry_defect: report.isometry_defect,
    };
    quality.rating()
}

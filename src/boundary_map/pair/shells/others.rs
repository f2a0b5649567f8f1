//! Other maps of a pair of outermost shells, where the first one takes the shells inside elsewhere, or others are wanted.

use super::super::{
    DISTINCT, PairAlternative, PairError, PairMethod, PairOptions, PairPhase, PairReport, PairStartKind, distortion,
    map_pair_with_alternatives, product_of_quantiles,
};
use super::{ShellMapper, mean_distance, no_area};
use crate::boundary_map::{BoundaryMap, SurfaceDistortion};
use crate::progress::ProgressResponse;

/// Weight of the distance by which shells inside are off, beside the distortion, where maps are compared.
const OFF_WEIGHT: f64 = 20.0;
/// What else is tried: maps of up to this many times the least energy, and alignments of the whole solids.
const MOST_ENERGY: f64 = 2.0;
const MOST_ALTERNATIVES: usize = 4;
const MOST_ALIGNMENTS: usize = 2;

/// A map of a pair of shells that was tried.
pub(super) struct RatedMap {
    /// The less, the better.
    pub rating: f64,
    pub kind: PairStartKind,
    pub map: BoundaryMap,
    pub distortion: SurfaceDistortion,
    /// See [`super::Matching::off_inside`].
    pub off: f64,
}

/// The maps that differ from the one that is taken and from each other, the best first.
pub(super) fn distinct(
    taken: &RatedMap,
    mut rated: Vec<RatedMap>,
    diagonal: f64,
) -> Vec<(BoundaryMap, PairAlternative)> {
    rated.sort_by(|a, b| a.rating.total_cmp(&b.rating));
    let mut found: Vec<(BoundaryMap, PairAlternative)> = Vec::new();
    for other in rated {
        let is_near = |map: &BoundaryMap| mean_distance(&other.map, map) < DISTINCT * diagonal;
        if is_near(&taken.map) || found.iter().any(|(map, _)| is_near(map)) {
            continue;
        }
        let alternative = PairAlternative {
            shell: None,
            kind: other.kind,
            energy_ratio: other.distortion.mean_symmetric_dirichlet / taken.distortion.mean_symmetric_dirichlet,
            isometry_defect: None,
            distance: mean_distance(&other.map, &taken.map) / diagonal,
        };
        found.push((other.map, alternative));
    }
    found
}

impl ShellMapper<'_> {
    /// The map of a pair of outermost shells that was found first, and others from other starts, with what they come from; their times are
    /// added to the report's.
    pub(super) fn tried<A: ProgressResponse>(
        &self,
        pair: [usize; 2],
        map: BoundaryMap,
        report: &mut PairReport,
        progress: &dyn Fn(PairPhase) -> A,
    ) -> Result<Vec<(PairStartKind, BoundaryMap)>, PairError> {
        let [from, to] = self.pair(pair);
        let options = self.options_of([from, to])?;
        let surfaces = [&from.surface, &to.surface];
        let kind = report
            .starts
            .get(report.start)
            .map_or(PairStartKind::Class, |start| start.kind);
        let mut tried = vec![(kind, map)];
        let mut timings = vec![report.timings];
        // What cannot be mapped another way has a map all the same.
        let others =
            |options: &PairOptions| match map_pair_with_alternatives(surfaces[0], surfaces[1], options, progress) {
                Err(PairError::Cancelled) => Err(PairError::Cancelled),
                found => Ok(found.ok()),
            };
        let as_good = |other: &&PairAlternative| other.energy_ratio <= MOST_ENERGY;
        let with_alternatives = PairOptions {
            alternatives: report
                .alternatives
                .iter()
                .filter(as_good)
                .count()
                .min(MOST_ALTERNATIVES),
            ..options.clone()
        };
        if with_alternatives.alternatives > 0
            && let Some(found) = others(&with_alternatives)?
        {
            let kinds = found.report.alternatives.iter().map(|other| other.kind);
            tried.extend(kinds.zip(found.alternatives));
            timings.push(found.report.timings);
        }
        let is_free = !options.aligned && options.landmarks.pairs().is_empty() && options.curves.is_empty();
        if is_free && from.genus == 0 && options.method == PairMethod::SoftTargets {
            for alignment in self.matching.alignments()?.iter().take(MOST_ALIGNMENTS) {
                let moved = surfaces[0].vertices().iter().map(|p| alignment.similarity.apply(p));
                let from_alignment = PairOptions {
                    start: Some(BoundaryMap::new(surfaces[0].clone(), moved.collect())?),
                    alternatives: 0,
                    ..options.clone()
                };
                if let Some(found) = others(&from_alignment)? {
                    tried.push((PairStartKind::Alignment, found.map));
                    timings.push(found.report.timings);
                }
            }
        }
        report.timings = timings.into_iter().sum();
        Ok(tried)
    }

    /// The map of a pair, with how much it distorts, and takes the shells inside elsewhere.
    pub(super) fn rated(&self, pair: [usize; 2], kind: PairStartKind, map: BoundaryMap) -> Result<RatedMap, PairError> {
        let distortion = distortion(&map).ok_or_else(no_area)?;
        let off = self.matching.off_inside(pair, &map)?;
        Ok(RatedMap {
            rating: product_of_quantiles(&distortion).cbrt() * (1.0 + OFF_WEIGHT * off),
            kind,
            map,
            distortion,
            off,
        })
    }
}

//! The map of a pair with two handles or more, made the other way, too, where it looks wrong or none is found: the class of maps is that
//! of the closest points of one solid on the other, and those of the other on the one may lead to another class.

use std::time::Instant;

use super::super::{LandmarkCurve, LoopError, PairError, PairMaps, PairOptions, PairReport, Stretch, distortion};
use crate::boundary_map::BoundaryMap;

/// What `make` makes with these options; or, where that looks wrong or is nothing, the inverse of what it makes with the solids exchanged
/// (the flag), if that is better. Once `should_conclude` says so, nothing more is made.
pub fn by_both_ways(
    options: &PairOptions,
    should_conclude: impl Fn() -> bool,
    make: impl Fn(&PairOptions, bool) -> Result<PairMaps, PairError>,
) -> Result<PairMaps, PairError> {
    let begin = Instant::now();
    let first = make(options, false);
    let is_enough = match &first {
        Ok(PairMaps { report, .. }) => !report.stretch.looks_wrong() || report.concluded || !options.improve,
        Err(error) => !matches!(
            error,
            PairError::NoClass { .. } | PairError::Loops(LoopError::NotFound { .. })
        ),
    };
    if is_enough || should_conclude() {
        return first;
    }
    let back = match make(&exchanged(options), true) {
        Err(PairError::Cancelled) => return Err(PairError::Cancelled),
        back => back.ok().and_then(|back| turned_round(back, options)),
    };
    let better = match (first, back) {
        (Ok(first), Some(back)) if first.report.stretch.worst_share() <= back.report.stretch.worst_share() => Ok(first),
        (_, Some(back)) => Ok(back),
        (first, None) => first,
    };
    better.map(|mut better| {
        let timings = &mut better.report.timings;
        let total = begin.elapsed().as_secs_f64();
        timings.reversed += total - timings.total;
        timings.total = total;
        better.report.concluded |= should_conclude();
        better
    })
}

/// The options with domain and target exchanged.
fn exchanged(options: &PairOptions) -> PairOptions {
    let exchanged = |pair: &LandmarkCurve| LandmarkCurve {
        domain: pair.target.clone(),
        target: pair.domain.clone(),
    };
    PairOptions {
        loops: options.loops.iter().map(exchanged).collect(),
        up: options.up.map(|[domain, target]| [target, domain]),
        ..options.clone()
    }
}

/// The maps the other way round, and the report with what is measured of the map.
fn turned_round(found: PairMaps, options: &PairOptions) -> Option<PairMaps> {
    let map = found.map.inverse()?;
    let report = PairReport {
        is_reversed: true,
        after: distortion(&map)?,
        stretch: Stretch::of(&map, options.most_stretched)?,
        ..found.report
    };
    Some(PairMaps {
        map,
        report,
        alternatives: found.alternatives.iter().filter_map(BoundaryMap::inverse).collect(),
    })
}

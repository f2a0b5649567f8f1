//! The map by soft targets, sought again where the first search ends off an isometry or looks wrong: from the target to the domain, since
//! either search gets stuck at other minima, and from the map itself where a part of it is out of order. With a few landmarks it is
//! sought without them, too, and made to meet them.

use super::isometry::{SMALL_DEFECT, is_off};
use super::soft_targets::SoftTargetMaps;
use super::{
    BoundaryMap, Landmarks, NearerIsometry, PairError, PairMapping, PairMaps, PairOptions, PairPhase, PairReport,
    PairStartKind, PairTimings,
};

/// Most landmarks with which the map is sought without them, too: more say by themselves where the domain goes.
const FEW_LANDMARKS: usize = 20;
/// Landmarks agree with the map that was found without them where meeting them raises its rating by no more than this factor: true
/// landmarks of poses and bends lower it by up to a third, since that map is improved further, or raise it by 1 % at most.
const MOST_COSTS: f64 = 1.05;

/// Ratio of isometry defects above which a map is clearly farther from an isometry than another.
const CLEARLY_FARTHER: f64 = 2.0;

/// A map that was found without landmarks, and then made to meet them.
struct WithoutLandmarks {
    met: SoftTargetMaps,
    /// Its rating over that before.
    costs: f64,
}

impl PairMapping<'_> {
    /// As [`Self::by_soft_targets`], by the best of all searches.
    pub(super) fn by_several_searches(&self) -> Result<PairMaps, PairError> {
        let mut best = self.with_and_without_landmarks()?;
        let PairMaps { map, report, .. } = &mut best.maps;
        report.nearer_isometry = report.isometry_defect.zip(best.closest).and_then(|(defect, closest)| {
            NearerIsometry::than(defect, map.image().iter().copied(), &closest, self.target)
        });
        Ok(best.maps)
    }

    /// The map with landmarks. With a few of them the map without any is made to meet them first. Where it hardly costs it anything, this
    /// is the map: a search that landmarks lead, too, may end elsewhere and worse. Else, or where the first search misses some, both are
    /// made, and the better one is taken.
    fn with_and_without_landmarks(&self) -> Result<SoftTargetMaps, PairError> {
        let landmarks = self.landmarks.pairs().len();
        let may_do_without = landmarks > 0 && self.options.landmarks_weight.is_none() && self.is_search();
        // Other maps that meet landmarks come from a search with them.
        let is_first = may_do_without && landmarks <= FEW_LANDMARKS && self.options.alternatives == 0;
        let mut without = match is_first {
            true => self.by_map_without_landmarks()?,
            false => None,
        };
        if let Some(found) = without.take_if(|found| found.costs <= MOST_COSTS) {
            return Ok(found.met);
        }
        let first = self.by_best_search();
        let are_missed = matches!(first, Err(PairError::LandmarksMissed { .. }));
        if may_do_without && are_missed && !is_first && self.reporter.should_improve() {
            without = self.by_map_without_landmarks()?;
        }
        let Some(without) = without else {
            return first;
        };
        let mut best = match first {
            Ok(first) => first.or_better(Some(without.met)),
            Err(_) => without.met,
        };
        self.count_time(&mut best.maps.report);
        Ok(best)
    }

    /// The map of a search. Where that ends [off](is_off) an isometry, or stretches too much, a map is sought the other way, too; where
    /// a part of the better one is out of order, another from that map. The best is taken.
    fn by_best_search(&self) -> Result<SoftTargetMaps, PairError> {
        let mut best = self.by_soft_targets(None)?.ok_or(PairError::NoEmbedding)?;
        let is_free = self.is_search() && self.landmarks.pairs().is_empty();
        let may_go_on = || is_free && self.reporter.should_improve();
        let is_seen_off = is_free && best.quality.isometry_defect.is_some_and(is_off);
        let is_stretched = is_free && best.maps.report.stretch.looks_wrong();
        if (is_seen_off || is_stretched) && may_go_on() {
            let found = self.by_soft_targets_from_target(&best)?;
            best = best.or_better(found);
            self.count_time(&mut best.maps.report);
        }
        if best.is_out_of_order && may_go_on() {
            let found = self.by_refined_map(&best)?;
            best = best.or_better(found);
            self.count_time(&mut best.maps.report);
        }
        let report = &mut best.maps.report;
        if let Some(defect) = report.isometry_defect.filter(|defect| is_seen_off && is_off(*defect)) {
            report.warnings.push(format!(
                "if the solids are poses of one body, a part of it may be out of its place, such as a head turned round: the map has an \
                 isometry defect of {defect:.3}, and right ones have less than {SMALL_DEFECT}. Look at it, and give landmarks there"
            ));
        }
        Ok(best)
    }

    /// What has passed since the first search was for further ones.
    fn count_time(&self, report: &mut PairReport) {
        let timings = &mut report.timings;
        let total = self.elapsed();
        timings.reversed += total - timings.total;
        timings.total = total;
        report.concluded = self.reporter.should_conclude();
    }

    /// Whether nothing but landmarks says where the domain goes.
    fn is_search(&self) -> bool {
        let options = self.options;
        self.curves.is_empty() && options.start.is_none() && !options.aligned && options.improve
    }

    /// The map that is found without landmarks, made to meet them; `None` where it cannot.
    fn by_map_without_landmarks(&self) -> Result<Option<WithoutLandmarks>, PairError> {
        static NONE: Landmarks = Landmarks::none();
        let free = PairMapping {
            landmarks: &NONE,
            ..*self
        };
        let Some(found) = some_or_cancelled(free.by_best_search().map(Some))? else {
            return Ok(None);
        };
        let free_rating = found.quality.rating();
        let SoftTargetMaps {
            maps,
            shapes,
            closest,
            about_pair,
            ..
        } = found;
        let options = PairOptions {
            start: Some(maps.map),
            ..self.options.clone()
        };
        let meeting = PairMapping {
            options: &options,
            shapes: shapes.as_ref(),
            ..*self
        };
        let Some(mut met) = some_or_cancelled(meeting.by_soft_targets(None))? else {
            return Ok(None);
        };
        let report = &mut met.maps.report;
        report.coarse_embeddings = maps.report.coarse_embeddings;
        for start in &mut report.starts {
            start.kind = PairStartKind::WithoutLandmarks;
        }
        report.warnings = about_pair.clone();
        let (of_free, total) = (maps.report.timings, report.timings.total);
        report.timings = PairTimings {
            improve: of_free.improve + total - of_free.total,
            total,
            ..of_free
        };
        let costs = met.quality.rating() / free_rating;
        let met = SoftTargetMaps {
            closest,
            about_pair,
            ..met
        };
        Ok(Some(WithoutLandmarks { met, costs }))
    }

    /// The inverse of the map that is found from the target to the domain, improved as a map of the domain unless it looks wrong then;
    /// `None` where none is found, or its coarse embeddings are no better than the first map's, which does not look wrong.
    fn by_soft_targets_from_target(&self, first: &SoftTargetMaps) -> Result<Option<SoftTargetMaps>, PairError> {
        let shapes = first.shapes.as_ref().map(|shapes| shapes.exchanged());
        let options = PairOptions {
            up: self.options.up.map(|[domain, target]| [target, domain]),
            alternatives: 0,
            ..self.options.clone()
        };
        self.report(PairPhase::Reversed)?;
        let back = PairMapping {
            domain: self.target,
            target: self.domain,
            is_reversed: true,
            options: &options,
            shapes: shapes.as_ref(),
            ..*self
        };
        let most_rating = first.coarse_rating.filter(|_| !first.maps.report.stretch.looks_wrong());
        let Some(found) = some_or_cancelled(back.by_soft_targets(most_rating))? else {
            return Ok(None);
        };
        let Some(inverse) = found.maps.map.inverse() else {
            return Ok(None);
        };
        // The target's triangles are not distorted much, but the domain's may be where they bend about limbs.
        let improved = self.by_inverse(&inverse, first, true)?;
        // The energy that is lowered is weighted by the domain's area, and that of the search by the target's: small parts of the domain may
        // get to cover much of the target.
        let better = match improved {
            Some(improved) if !improved.maps.report.stretch.looks_wrong() => Some(improved),
            improved => {
                let as_found = self.by_inverse(&inverse, first, false)?;
                match improved {
                    Some(improved) => Some(improved.or_better(as_found)),
                    None => as_found,
                }
            }
        };
        Ok(better.map(|mut better| {
            let report = &mut better.maps.report;
            report.is_reversed = true;
            report.coarse_embeddings = found.maps.report.coarse_embeddings;
            report.warnings = found.maps.report.warnings;
            report.starts = vec![];
            better
        }))
    }

    /// A map from its start, the inverse of one that was found the other way.
    fn by_inverse(
        &self,
        inverse: &BoundaryMap,
        first: &SoftTargetMaps,
        improve: bool,
    ) -> Result<Option<SoftTargetMaps>, PairError> {
        let options = PairOptions {
            start: Some(inverse.clone()),
            alternatives: 0,
            improve,
            ..self.options.clone()
        };
        let from_inverse = PairMapping {
            options: &options,
            shapes: first.shapes.as_ref(),
            ..*self
        };
        some_or_cancelled(from_inverse.by_soft_targets(None))
    }

    /// The map that is found from the start that a map becomes when it is refined by eigenfunctions; `None` where none is found.
    fn by_refined_map(&self, first: &SoftTargetMaps) -> Result<Option<SoftTargetMaps>, PairError> {
        let again = PairMapping {
            refined: Some(&first.maps.map),
            shapes: first.shapes.as_ref(),
            ..*self
        };
        some_or_cancelled(again.by_soft_targets(None))
    }
}

impl SoftTargetMaps {
    /// Whether its isometry defect is clearly larger than another's: limbs that are exchanged may stretch little.
    fn is_farther_from_isometry(&self, other: &Self) -> bool {
        let defects = [self, other].map(|maps| maps.quality.isometry_defect);
        matches!(defects, [Some(own), Some(other)] if own > CLEARLY_FARTHER * other)
    }

    /// This map, or that of a further search if there is one and it is better: by the rating, or where one of them looks wrong, if less is
    /// stretched, unless that one is clearly farther from an isometry. What is said of other maps stays that of the first search.
    fn or_better(mut self, found: Option<Self>) -> Self {
        let Some(found) = found else {
            return self;
        };
        let [own, other] = [&self, &found].map(|search| &search.maps.report.stretch);
        let is_better = match own.looks_wrong() || other.looks_wrong() {
            true => other.worst_share() < own.worst_share() && !found.is_farther_from_isometry(&self),
            false => found.quality.rating() < self.quality.rating(),
        };
        let (own, found_report) = (&mut self.maps.report, found.maps.report);
        own.coarse_embeddings += found_report.coarse_embeddings;
        let start = own.starts.len() + found_report.start;
        let has_starts = !found_report.starts.is_empty();
        // Those about the pair, and other maps of it.
        let keeps_warnings = found_report
            .starts
            .iter()
            .any(|start| start.kind == PairStartKind::WithoutLandmarks);
        own.starts.extend(found_report.starts);
        if !is_better {
            return self;
        }
        let warnings = match keeps_warnings {
            true => std::mem::take(&mut own.warnings),
            false => found_report.warnings,
        };
        if has_starts {
            (own.start, own.schedule) = (start, found_report.schedule);
        }
        let report = PairReport {
            is_reversed: own.is_reversed || found_report.is_reversed,
            after: found_report.after,
            stretch: found_report.stretch,
            isometry_defect: found_report.isometry_defect,
            warnings,
            ..own.clone()
        };
        Self {
            maps: PairMaps {
                map: found.maps.map,
                report,
                alternatives: self.maps.alternatives,
            },
            quality: found.quality,
            is_out_of_order: found.is_out_of_order,
            ..self
        }
    }
}

/// What a search has found; `None` where it failed, since the first map is there. Only a cancellation is passed on.
fn some_or_cancelled(found: Result<Option<SoftTargetMaps>, PairError>) -> Result<Option<SoftTargetMaps>, PairError> {
    match found {
        Err(PairError::Cancelled) => Err(PairError::Cancelled),
        found => Ok(found.ok().flatten()),
    }
}

#[cfg(test)]
mod tests {
    use std::ops::ControlFlow;

    use nalgebra::{Rotation3, Unit};

    use super::super::isometry::IntrinsicShapes;
    use super::super::{Given, Landmarks, PairStartKind};
    use super::*;
    use crate::Vector;
    use crate::boundary_map::BoundaryMap;
    use crate::mesh::{SurfaceMesh, shapes};
    use crate::spherical::SphericalEmbedding;

    const LIMBS: [[f64; 3]; 3] = [[1.0, 0.2, 0.1], [-0.6, 0.9, 0.0], [-0.1, -0.4, 1.0]];

    /// A ball with three limbs, star-shaped.
    fn star() -> SurfaceMesh {
        let radius = |x: &Vector| {
            let limb =
                |(d, length): (&[f64; 3], f64)| length * (-18.0 * (1.0 - x.dot(&Vector::from(*d).normalize()))).exp();
            1.0 + LIMBS.iter().zip([1.0, 0.7, 0.5]).map(limb).sum::<f64>()
        };
        shapes::deformed(&shapes::sphere(1.0, 4), |p| p * radius(&p.coords.normalize()))
    }

    /// A map of the star to itself that squeezes a belt around a limb to a twelfth of its width, and stretches what follows. It is one to
    /// one.
    fn squeezed(star: &SurfaceMesh) -> BoundaryMap {
        let directions: Vec<Vector> = star.vertices().iter().map(|p| p.coords.normalize()).collect();
        let axis = Vector::from(LIMBS[0]).normalize();
        let image = |angle: f64| match angle {
            ..0.5 => angle,
            0.5..0.9 => 0.5 + (angle - 0.5) / 12.0,
            0.9..1.4 => 1.4 - (1.4 - angle) * (1.4 - 0.5 - 0.4 / 12.0) / 0.5,
            _ => angle,
        };
        let moved = directions.iter().map(|x| {
            let angle = x.angle(&axis);
            // From the axis there is no direction to turn to, and nothing to be turned.
            let across = Unit::try_new(axis.cross(x), 1e-9);
            across.map_or(*x, |across| {
                Rotation3::from_axis_angle(&across, image(angle) - angle) * x
            })
        });
        let target = SphericalEmbedding::new(star.clone(), &directions).unwrap();
        let domain = SphericalEmbedding::new(star.clone(), &moved.collect::<Vec<_>>()).unwrap();
        BoundaryMap::through_sphere(domain, target).unwrap()
    }

    /// A map with a part out of order is sought again from its own map, and what is found is better and is taken.
    #[test]
    fn a_part_that_is_out_of_order_is_sought_again_from_its_own_map() {
        let star = star();
        let (none, options) = (Landmarks::none(), PairOptions::default());
        let given = Given {
            surfaces: [&star, &star],
            landmarks: &none,
            loops: &[],
            curves: &[],
            options: &options,
        };
        let made = given.mapped(&|_| ControlFlow::<()>::Continue(()), |pair| {
            let shapes: IntrinsicShapes = pair.intrinsic_shapes().expect("limbs are intrinsic shapes");
            let as_given = PairOptions {
                start: Some(squeezed(&star)),
                improve: false,
                ..options.clone()
            };
            let broken = PairMapping {
                options: &as_given,
                shapes: Some(&shapes),
                ..pair
            };
            let first = broken.by_soft_targets(None)?.expect("a map is given");
            assert!(first.is_out_of_order);
            // At least a tenth of the surface counts with the most that a triangle does.
            assert!(first.quality.energy > 2.0, "{:?}", first.quality);
            let found = pair.by_refined_map(&first)?;
            let best = first.or_better(found);
            // An isometry has 1.
            assert!(
                !best.is_out_of_order && best.quality.energy < 1.01,
                "{:?}",
                best.quality
            );
            Ok(best.maps)
        });
        let PairMaps { map, report, .. } = made.unwrap();
        let kinds: Vec<PairStartKind> = report.starts.iter().map(|start| start.kind).collect();
        assert_eq!(kinds, [PairStartKind::Given, PairStartKind::Refined]);
        assert_eq!(report.start, 1);
        // To itself, so that vertices go to themselves.
        let errors = star.vertices().iter().zip(map.image()).map(|(p, q)| (p - q).norm());
        let mean = errors.sum::<f64>() / star.vertices().len() as f64;
        assert!(mean < 0.01 * star.diagonal(), "{mean}");
    }
}

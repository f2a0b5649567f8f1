//! The map by soft targets: the domain is embedded on the sphere of the target, pulled towards where alignments and
//! correspondences take its vertices; several starts and schedules are compared on coarse embeddings.

use super::embedder::{DomainEmbedder, EmbeddingCandidate, SoftTargets};
use super::inter_surface::InverseEmbedding;
use super::isometry::{IntrinsicShapes, Quality};
use super::search::{self, RankedEmbedding, Schedules, SearchStep, best_of_starts};
use super::starts::{Start, Starts};
use super::{
    DISTINCT, ISOMETRY_ENERGY, PairAlternative, PairError, PairMapping, PairMaps, PairMethod, PairPhase, PairReport,
    PairStart, PairStartKind, PairTimings, SoftTargetSchedule, TOO_FINE,
};
use crate::Vector;
use crate::boundary_map::BoundaryMap;
use crate::intrinsic::Correspondence;
use crate::mesh::SurfaceMesh;
use crate::spherical::{Locator, SphereEnergy, SphericalEmbedding, check_embedding};

/// Schedules to compare: which one ends best differs from pair to pair.
const SCHEDULES: [SoftTargetSchedule; 4] = [
    SoftTargetSchedule::new(1.0, 60),
    SoftTargetSchedule::new(1.0, 200),
    SoftTargetSchedule::new(10.0, 200),
    SoftTargetSchedule::new(100.0, 60),
];
/// More schedules for the starts that led to the best embeddings: which of them leaves no limb turned or bent differs, too.
/// Where most of them turn a head round, a few do not, mostly of those that end early; these are rated best.
const MORE_SCHEDULES: [SoftTargetSchedule; 10] = [
    SoftTargetSchedule::new(3.0, 40),
    SoftTargetSchedule::new(3.0, 60),
    SoftTargetSchedule::new(10.0, 60),
    SoftTargetSchedule::new(1000.0, 60),
    SoftTargetSchedule::new(10.0, 100),
    SoftTargetSchedule::new(100.0, 200),
    SoftTargetSchedule::new(10.0, 400),
    SoftTargetSchedule::new(30.0, 400),
    SoftTargetSchedule::new(100.0, 400),
    SoftTargetSchedule::new(1000.0, 400),
];
/// Schedules with a few landmarks: met from the beginning, with pulls that last, or when the coarse embedding is nearly done.
const SCHEDULES_WITH_LANDMARKS: [SoftTargetSchedule; 5] = [
    SoftTargetSchedule::new(10.0, 400),
    SoftTargetSchedule::new(100.0, 400),
    SoftTargetSchedule::new(1.0, 60).with_landmarks_from(LATE_LANDMARKS),
    SoftTargetSchedule::new(10.0, 60).with_landmarks_from(LATE_LANDMARKS),
    SoftTargetSchedule::new(100.0, 60).with_landmarks_from(LATE_LANDMARKS),
];
/// Number of vertices from which landmarks are met late: those of the first step that counts which of them are missed.
const LATE_LANDMARKS: usize = 1600;
/// Schedules for solids in the same place: those taken for polycubes of voxels, where strong pulls can be trusted.
const SCHEDULES_IN_PLACE: [SoftTargetSchedule; 4] = [
    SoftTargetSchedule::new(1.0, 60),
    SoftTargetSchedule::new(1.0, 800),
    SoftTargetSchedule::new(10.0, 800),
    SoftTargetSchedule::new(100.0, 800),
];
/// Where coarse embeddings are compared: of all starts at first, then of the better ones. With 100 vertices their energies do
/// not tell good ones yet, and of those with nearly the same map several have to continue: otherwise, of five poses of a horse,
/// one ended with wrong limbs and one much more distorted.
const STEPS: [SearchStep; 4] = [
    SearchStep::new(200, 6, 18, 1.5),
    SearchStep::new(400, 3, 5, 1.35),
    SearchStep::new(LATE_LANDMARKS, 2, 2, 1.15),
    SearchStep::new(4000, 2, 2, AS_GOOD_COARSE),
];
/// The same for solids in the same place.
const STEPS_IN_PLACE: [SearchStep; 2] = [SearchStep::new(1600, 2, 2, 1.1), SearchStep::new(4000, 1, 1, 1.0)];
/// Another map is completed, too, when its rating with 4000 vertices is at most this times the least: then the better one is taken.
const AS_GOOD_COARSE: f64 = 1.15;
/// Share of the area that is distorted beyond measure from which on a part of a map is out of order: maps in order have up to
/// 0.3 %, and a strip along a leg that covers most of it makes 1 %.
const MOST_OUT_OF_ORDER: f64 = 0.005;
/// A warning says that an alternative is as good when its rating is at most this times that of the map that was taken.
const AS_GOOD: f64 = 1.03;

/// The maps by soft targets, and what the first is compared by with those of other searches.
pub(super) struct SoftTargetMaps {
    pub maps: PairMaps,
    pub quality: Quality,
    /// The rating of the coarse embedding that was completed; `None` where a map was given.
    pub coarse_rating: Option<f64>,
    /// None where solids lie in the same place or a map is given, or where a surface has none.
    pub shapes: Option<IntrinsicShapes>,
    /// The correspondence by intrinsic shape that is closest to an isometry, where nothing but landmarks says where the domain goes.
    pub closest: Option<Correspondence>,
    /// Warnings about the pair, whatever the map.
    pub about_pair: Vec<String>,
    /// Whether a part of the map is distorted beyond measure, such as a strip along a leg that covers most of the other one, and
    /// neither landmarks nor curves can be why.
    pub is_out_of_order: bool,
}

impl PairMapping<'_> {
    /// `None` where no coarse embedding is rated below `most_rating`, if that is given: then none is completed.
    pub(super) fn by_soft_targets(&self, most_rating: Option<f64>) -> Result<Option<SoftTargetMaps>, PairError> {
        // Each uses one core for much of its time.
        let (target, matches) = rayon::join(|| self.target_embedding(), || self.shape_matches());
        let (target, matches) = (target?, matches?);
        let locator = Locator::new(&target);
        let inverse = InverseEmbedding::new(&target, &locator);
        let sphere = self.elapsed();

        let embedder = self.embedder(&target, &inverse)?;
        let (schedules, steps) = self.schedules(&embedder);
        let pulled = embedder.hierarchy.coarsest(schedules.most_pulled());
        self.report(PairPhase::Aligning { done: 0, of: 0 })?;
        let Starts {
            all: starts,
            mut warnings,
            shapes,
            closest,
        } = self.starts(matches, &inverse, &pulled);
        let about_pair = warnings.clone();
        let align = self.elapsed();

        let embedder = DomainEmbedder {
            shapes: shapes.as_ref(),
            ..embedder
        };
        let soft_targets: Vec<&SoftTargets> = starts.iter().map(|start| &start.soft_targets).collect();
        self.report(PairPhase::CoarseEmbeddings {
            vertices: steps[0].vertices,
            done: 0,
            of: soft_targets.len() * schedules.of_all.len(),
        })?;
        let given = self.given_embedding(&embedder, &starts);
        let is_given = given.is_some();
        let (mut ranked, coarse_embeddings) = match given {
            Some(candidate) => {
                let given = RankedEmbedding {
                    candidate,
                    start: 0,
                    schedule: schedules.of_all[0],
                    qualities: vec![],
                };
                (vec![given], 1)
            }
            None => best_of_starts(&embedder, &soft_targets, &schedules, &steps),
        };
        let compared = self.elapsed();
        let coarse_rating = ranked.first().filter(|_| !is_given).map(RankedEmbedding::rating);
        if let Some((rating, most)) = coarse_rating.zip(most_rating)
            && rating >= most
        {
            return Ok(None);
        }
        let completed = match self.options.improve {
            true => Some(self.completed_best(&embedder, &mut ranked, &starts)?),
            false => None,
        };
        let (best, others) = ranked.split_first().ok_or(PairError::NoEmbedding)?;

        let start = &starts[best.start];
        let before = match is_given {
            true => best.candidate.clone(),
            false => embedder
                .by_soft_targets_alone(&start.all_soft_targets(&target), &best.schedule)
                .ok_or(TOO_FINE)?,
        };
        let after = completed.unwrap_or_else(|| before.clone());
        self.require_landmarks(&after)?;
        let alternatives = self.distinct(&inverse, best, others);
        if let [first, ..] = alternatives[..]
            && let Some(qualities) = first.0.compared(best)
            && qualities[0].rating() <= AS_GOOD * qualities[1].rating()
        {
            warnings.push(format!(
                "another map is nearly as good (its energy was {:.3} times this one's), as of symmetric bodies: look at the \
                 alternatives, or give landmarks if it is not the one that you want",
                energy_ratio(qualities)
            ));
        }
        let mut others = Vec::new();
        for (other, _) in alternatives.iter().take(self.options.alternatives) {
            let completed = self.completed(&embedder, other, &starts[other.start])?;
            if !completed.missed().is_empty() {
                break;
            }
            others.push(self.through(&completed, &target)?);
        }
        let (improved, concluded) = (self.elapsed(), self.reporter.should_conclude());
        let quality = embedder.quality(&after);
        let is_free = embedder.pins.len() == 0 && embedder.springs.is_empty();
        let is_out_of_order = is_free && shapes.is_some() && embedder.share_out_of_order(&after) > MOST_OUT_OF_ORDER;
        // Correspondences know nothing of springs.
        let closest = closest.filter(|_| embedder.springs.is_empty());
        let (map, distortions, stretch) = self.measured(&target, &before, &after)?;
        let report = PairReport {
            landmarks: self.landmarks.pairs().len(),
            landmark_error: self.landmark_error(&map),
            coarse_embeddings,
            starts: summaries(&starts, &ranked),
            start: best.start,
            alternatives: alternatives
                .iter()
                .map(|(other, distance)| PairAlternative {
                    shell: None,
                    kind: starts[other.start].kind,
                    energy_ratio: other.compared(best).map_or(f64::NAN, energy_ratio),
                    isometry_defect: other.qualities.last().and_then(|quality| quality.isometry_defect),
                    distance: *distance,
                })
                .collect(),
            schedule: Some(best.schedule),
            isometry_defect: quality.isometry_defect,
            timings: PairTimings {
                sphere,
                align: align - sphere,
                coarse: compared - align,
                improve: improved - compared,
                reversed: 0.0,
                total: self.elapsed(),
            },
            concluded,
            warnings,
            ..PairReport::of(PairMethod::SoftTargets, distortions, stretch)
        };
        Ok(Some(SoftTargetMaps {
            maps: PairMaps {
                map,
                report,
                alternatives: others,
            },
            quality,
            coarse_rating,
            shapes,
            closest,
            about_pair,
            is_out_of_order,
        }))
    }

    /// The target's spherical embedding: that of the boundary map that is started from, or is refined, if it is one of this target.
    fn target_embedding(&self) -> Result<SphericalEmbedding, PairError> {
        let from = self.options.start.as_ref().or(self.refined);
        let given = from.and_then(BoundaryMap::target_embedding);
        match given.filter(|given| given.surface() == self.target) {
            Some(given) => Ok(given.clone()),
            None => {
                let side = if self.is_reversed { "domain" } else { "target" };
                self.sphere(side, self.target, SphereEnergy::Balanced)
            }
        }
    }

    /// The embedding of the map that is started from, if that was composed with the embedding of the target that is used here.
    fn given_embedding(&self, embedder: &DomainEmbedder, starts: &[Start]) -> Option<EmbeddingCandidate> {
        let [start] = starts else {
            return None;
        };
        if start.kind != PairStartKind::Given {
            return None;
        }
        let directions = bijective_targets(self.domain, &start.soft_targets)?;
        let mut candidate = embedder.candidate_at(&directions);
        candidate.energy = embedder.energy_of(&candidate.embedding);
        Some(candidate)
    }

    /// The schedules to compare, and where they are compared.
    fn schedules(&self, embedder: &DomainEmbedder) -> (Schedules, Vec<SearchStep>) {
        let landmarks = embedder.pins.len();
        if landmarks > 0 {
            // As without landmarks, but that these are met late.
            let of_best = MORE_SCHEDULES.map(|schedule| schedule.with_landmarks_from(LATE_LANDMARKS));
            let for_landmarks = |schedule: SoftTargetSchedule| schedule.for_landmarks(landmarks);
            let schedules = Schedules {
                of_all: SCHEDULES_WITH_LANDMARKS.map(for_landmarks).into(),
                of_best: of_best.map(for_landmarks).into(),
            };
            (schedules, STEPS.map(|step| step.for_landmarks(landmarks)).into())
        } else if self.options.aligned {
            (Schedules::of_all(&SCHEDULES_IN_PLACE), STEPS_IN_PLACE.into())
        } else {
            let schedules = Schedules {
                of_all: SCHEDULES.into(),
                of_best: MORE_SCHEDULES.into(),
            };
            (schedules, STEPS.into())
        }
    }

    /// The best embedding, completed. Where another map is nearly as good, both are completed, and the better one becomes the first;
    /// where it misses landmarks, the first of the others that meets all.
    fn completed_best(
        &self,
        embedder: &DomainEmbedder,
        ranked: &mut [RankedEmbedding],
        starts: &[Start],
    ) -> Result<EmbeddingCandidate, PairError> {
        let completed = |ranked: &RankedEmbedding| self.completed(embedder, ranked, &starts[ranked.start]);
        let best = ranked.first().ok_or(PairError::NoEmbedding)?;
        let rival = rival(ranked);
        let (first, second) = rayon::join(|| completed(best), || rival.map(|k| completed(&ranked[k])));
        let first = first?;
        if !first.missed().is_empty() {
            let others = 1..ranked.len().min(search::MOST_WHERE_MISSED);
            for k in others.filter(|&k| ranked[k].qualities.len() == ranked[0].qualities.len()) {
                let other = completed(&ranked[k])?;
                if other.missed().is_empty() {
                    ranked.swap(0, k);
                    return Ok(other);
                }
            }
            return Ok(first);
        }
        let Some((k, second)) = rival.zip(second) else {
            return Ok(first);
        };
        let second = second?;
        let qualities = [&first, &second].map(|candidate| embedder.quality(candidate));
        ranked[0].qualities.push(qualities[0]);
        ranked[k].qualities.push(qualities[1]);
        let [first_rating, second_rating] = qualities.map(|quality| quality.rating());
        if second.missed().is_empty() && second_rating < first_rating {
            ranked.swap(0, k);
            return Ok(second);
        }
        Ok(first)
    }

    /// A coarse embedding with the rest of the vertices, and its distortion lowered.
    fn completed(
        &self,
        embedder: &DomainEmbedder,
        coarse: &RankedEmbedding,
        start: &Start,
    ) -> Result<EmbeddingCandidate, PairError> {
        let refining = |vertices, energy| {
            let total = self.domain.vertices().len();
            // A cancellation takes effect at the next level.
            let _ = self.report(PairPhase::Refining {
                vertices,
                total,
                energy: ISOMETRY_ENERGY * energy,
            });
        };
        let (candidate, soft_targets) = (coarse.candidate.clone(), &start.soft_targets);
        let refined = embedder.refine(candidate, soft_targets, &coarse.schedule, usize::MAX, &refining);
        let mut completed = refined.ok_or(TOO_FINE)?;
        embedder.finish(&mut completed, &|rounds| self.improving(rounds));
        let all = start.all_soft_targets(embedder.inverse.target());
        self.take_exact_targets(embedder, &all, &mut completed);
        Ok(completed)
    }

    /// The embeddings whose maps are not nearly that of `best`, or of one before them, with the mean distance of their images
    /// of vertices from those of `best`, as a fraction of the target's diagonal.
    fn distinct<'b>(
        &self,
        inverse: &InverseEmbedding,
        best: &'b RankedEmbedding,
        others: &'b [RankedEmbedding],
    ) -> Vec<(&'b RankedEmbedding, f64)> {
        let diagonal = self.target.diagonal();
        let distance = |a: &RankedEmbedding, b: &RankedEmbedding| a.distance(b, inverse) / diagonal;
        let mut kept: Vec<(&RankedEmbedding, f64)> = Vec::new();
        for other in others.iter().filter(|other| other.candidate.energy.is_finite()) {
            let from_best = distance(other, best);
            if from_best > DISTINCT && kept.iter().all(|(kept, _)| distance(other, kept) > DISTINCT) {
                kept.push((other, from_best));
            }
        }
        kept
    }

    /// Replaces the candidate by the soft targets themselves where these are a bijection of lower distortion: for a
    /// solid and its copy this is the exact answer.
    fn take_exact_targets(
        &self,
        embedder: &DomainEmbedder,
        soft_targets: &SoftTargets,
        candidate: &mut EmbeddingCandidate,
    ) {
        let Some(targets) = bijective_targets(self.domain, soft_targets) else {
            return;
        };
        let exact = embedder.candidate_at(&targets);
        let energy = embedder.energy_of(&exact.embedding);
        if exact.missed().is_empty() && energy < candidate.energy {
            *candidate = EmbeddingCandidate { energy, ..exact };
        }
    }
}

/// The soft targets as directions, where every vertex has one and they are an embedding.
fn bijective_targets(domain: &SurfaceMesh, soft_targets: &SoftTargets) -> Option<Vec<Vector>> {
    let targets = soft_targets.iter().map(|target| target.map(|(to, _)| to));
    let targets: Option<Vec<Vector>> = targets.collect();
    targets.filter(|x| check_embedding(domain.triangles(), x).is_bijective())
}

/// A map other than the first one that is nearly as good, and that was refined as far.
fn rival(ranked: &[RankedEmbedding]) -> Option<usize> {
    let (best, others) = ranked.split_first()?;
    let is_rival = |other: &RankedEmbedding| {
        other.qualities.len() == best.qualities.len() && other.rating() <= AS_GOOD_COARSE * best.rating()
    };
    others.iter().position(is_rival).map(|k| k + 1)
}

fn energy_ratio([one, other]: [Quality; 2]) -> f64 {
    one.energy / other.energy
}

/// What became of each start.
fn summaries(starts: &[Start], ranked: &[RankedEmbedding]) -> Vec<PairStart> {
    let summary = |(i, start): (usize, &Start)| {
        let found = ranked.iter().find(|embedding| embedding.start == i);
        PairStart {
            kind: start.kind,
            energy: found.map_or(f64::INFINITY, |found| ISOMETRY_ENERGY * found.candidate.energy),
            vertices: found.map_or(0, |found| found.candidate.embedding.inserted.len()),
        }
    };
    starts.iter().enumerate().map(summary).collect()
}

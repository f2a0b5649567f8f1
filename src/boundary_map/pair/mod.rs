//! A bijective boundary map between two solids without a given correspondence: the composition of two embeddings, spherical
//! ones for solids of genus 0.
//!
//! 1. The target is embedded on the sphere ([`map_to_sphere`]).
//! 2. The domain is aligned with the target by similarities ([`align`]). The closest point of the target gives each
//!    vertex of the domain a soft target on the sphere ([`vertex_targets`]).
//! 3. The domain is embedded on the same sphere, coarse to fine, pulled towards the soft targets; several alignments
//!    and schedules are tried on coarse meshes and the best is refined.
//! 4. The domain's embedding is optimised for low distortion of the map from surface to surface.
//!
//! No step inverts a triangle on the sphere, so the result is a bijection at every point of the surface.
//!
//! Two solids of genus 1 are mapped through a flat torus instead, and two of more handles through a hyperbolic surface.

mod alignment;
mod bent;
mod curves;
mod embedder;
mod hyperbolic;
mod inter_surface;
mod isometry;
mod landmark_warp;
mod landmarks;
mod options;
mod oriented_query;
mod report;
mod rotation;
mod search;
mod star;
mod starts;
mod stretch;
mod targets;
mod torus;

use std::collections::BTreeMap;
use std::ops::ControlFlow;
use std::time::Instant;

pub use alignment::{AlignError, Alignment, AlignmentStart, AlignmentSurface, Alignments, align, align_by_landmarks};
pub use curves::{CurveError, LandmarkCurve};
pub use embedder::SoftTargetSchedule;
pub use landmarks::{LandmarkError, Landmarks};
pub use options::{PairMethod, PairOptions};
pub use oriented_query::{OrientedPoint, OrientedQuery, vertex_normals};
pub use report::{
    HyperbolicReport, NearerIsometry, PairAlternative, PairError, PairPhase, PairReport, PairStart, PairStartKind,
    PairTimings, TorusReport,
};
pub use rotation::{RotationMatch, search_rotations};
pub use stretch::Stretch;
pub use targets::{VertexTarget, vertex_targets};

use super::{BoundaryMap, SurfaceDistortion};
use crate::geometry::sphere_rotation;
use crate::hyperbolic::{HyperbolicError, require_genus_2_or_more};
use crate::mesh::SurfaceMesh;
use crate::progress::{ProgressResponse, ProgressSender, run_cancellable};
use crate::spherical::{
    Hierarchy, Locator, Moebius, SphereEnergy, SphereOptions, SphericalEmbedding, SphericalError, check_embedding,
    genus, map_to_sphere, require_genus, require_genus_0, require_scale,
};
use crate::toroidal::{ToroidalError, require_genus_1};
use crate::{Matrix3, Vector};
use embedder::{DomainEmbedder, EmbeddingCandidate, Pin, Pins, SoftTargets};
use inter_surface::{InverseEmbedding, Spring};
use isometry::Quality;
use search::{RankedEmbedding, Schedules, SearchStep, best_of_starts};
use starts::{Start, Starts};

/// Schedules to compare: which one ends best differs from pair to pair.
const SCHEDULES: [SoftTargetSchedule; 4] = [
    SoftTargetSchedule::new(1.0, 60),
    SoftTargetSchedule::new(1.0, 200),
    SoftTargetSchedule::new(10.0, 200),
    SoftTargetSchedule::new(100.0, 60),
];
/// More schedules for the starts that led to the best embeddings: which of them leaves no limb turned or bent differs, too.
const MORE_SCHEDULES: [SoftTargetSchedule; 6] = [
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
/// Vertices of landmark curves that coarse embeddings have.
const MOST_LATE_OF_CURVES: usize = 40;
/// Maps are alternatives to each other when their images of vertices are this far apart in the mean, as a fraction of the
/// target's diagonal.
const DISTINCT: f64 = 0.05;
/// A warning says that an alternative is as good when its rating is at most this times that of the map that was taken.
const AS_GOOD: f64 = 1.03;
/// Symmetric Dirichlet energy of an isometry.
const ISOMETRY_ENERGY: f64 = 4.0;
/// A warning says that the rotation is ambiguous when the second best score is this close to the best.
const AMBIGUOUS_SCORE: f64 = 0.05;
/// The error when the domain's vertices come too close together on the sphere.
const TOO_FINE: PairError = PairError::Sphere {
    side: "domain",
    error: SphericalError::TooFine,
};

/// A bijection from the boundary of one solid to that of another.
///
/// Takes some 7 s for 8000 vertices with limbs on two cores, less for solids of genus 1. The result is the same for any number
/// of threads.
///
/// # Errors
///
/// When the solids are not of one genus, a hole is knotted, no class of maps between solids of genus 2 or more is found, or landmarks
/// cannot be met;
/// [`PairError::Cancelled`] when `progress` cancels it ([`ProgressResponse`]), which usually takes effect within a fraction of a
/// second.
pub fn map_pair<A: ProgressResponse>(
    domain: &SurfaceMesh,
    target: &SurfaceMesh,
    options: &PairOptions,
    progress: &dyn Fn(PairPhase) -> A,
) -> Result<(BoundaryMap, PairReport), PairError> {
    let one = PairOptions {
        alternatives: 0,
        ..options.clone()
    };
    map_pair_with_alternatives(domain, target, &one, progress).map(|pair| (pair.map, pair.report))
}

/// As [`map_pair`], with up to [`PairOptions::alternatives`] other maps, each of which costs as much as refining one coarse
/// embedding.
///
/// # Errors
///
/// As [`map_pair`].
pub fn map_pair_with_alternatives<A: ProgressResponse>(
    domain: &SurfaceMesh,
    target: &SurfaceMesh,
    options: &PairOptions,
    progress: &dyn Fn(PairPhase) -> A,
) -> Result<PairMaps, PairError> {
    match common_genus([domain, target], options)? {
        0 => {}
        1 => return map_tori(domain, target, options, progress),
        genus => return map_hyperbolic_surfaces(domain, target, genus, options, progress),
    }
    let of_side = |side| move |error| PairError::Sphere { side, error };
    let domain = require_genus_0(domain).map_err(of_side("domain"))?;
    let target = require_genus_0(target).map_err(of_side("target"))?;
    require_scale(&domain).map_err(of_side("domain"))?;
    require_scale(&target).map_err(of_side("target"))?;
    let landmarks = Landmarks::new(
        options.landmarks.pairs().to_vec(),
        domain.vertices().len(),
        target.vertices().len(),
    )?;
    let mut weights = options.landmarks_weight.into_iter().chain([options.curves_weight]);
    if let Some(weight) = weights.find(|weight| !(*weight > 0.0 && weight.is_finite())) {
        return Err(PairError::Weight(weight));
    }
    let is_direction = |up: &Vector| up.norm() > 0.0 && up.norm().is_finite();
    if !options.up.iter().flatten().all(is_direction) {
        return Err(PairError::Up);
    }
    let curves = curves::traced(&options.curves, &landmarks, &domain, &target)?;
    let given = Given {
        surfaces: [&domain, &target],
        landmarks: &landmarks,
        curves: &curves,
        options,
    };
    given.mapped(progress, |pair| match options.method {
        PairMethod::SoftTargets => pair.by_soft_targets_both_ways(),
        PairMethod::Conformal => pair.by_conformal_maps(),
        PairMethod::FlatTori | PairMethod::HyperbolicSurface => Err(of_no_handle("domain")),
    })
}

/// The checked inputs of a pair.
struct Given<'a> {
    /// Domain and target.
    surfaces: [&'a SurfaceMesh; 2],
    landmarks: &'a Landmarks,
    curves: &'a [curves::CurvePoint],
    options: &'a PairOptions,
}

impl<'a> Given<'a> {
    /// For solids with handles, which take no landmarks or landmark curves.
    fn with_handles(surfaces: [&'a SurfaceMesh; 2], options: &'a PairOptions) -> Self {
        static NONE: Landmarks = Landmarks::none();
        Self {
            surfaces,
            landmarks: &NONE,
            curves: &[],
            options,
        }
    }

    /// Does the work on other threads, so that `progress` can cancel it.
    fn mapped<A: ProgressResponse>(
        &self,
        progress: &dyn Fn(PairPhase) -> A,
        work: impl FnOnce(PairMapping) -> Result<PairMaps, PairError> + Send,
    ) -> Result<PairMaps, PairError> {
        let made = run_cancellable(&|phase| progress(phase).control(), |reporter| {
            work(PairMapping {
                domain: self.surfaces[0],
                target: self.surfaces[1],
                landmarks: self.landmarks,
                curves: self.curves,
                options: self.options,
                begin: Instant::now(),
                reporter,
            })
        });
        made.unwrap_or(Err(PairError::Cancelled))
    }
}

fn of_no_handle(side: &'static str) -> PairError {
    let error = ToroidalError::Genus { genus: 0 };
    PairError::Torus { side, error }
}

/// The genus of both solids.
///
/// # Errors
///
/// When a surface is not one closed manifold, or has another number of handles than the other.
fn common_genus([domain, target]: [&SurfaceMesh; 2], options: &PairOptions) -> Result<u64, PairError> {
    let genus = |side, surface| genus(surface).map_err(|error| PairError::Sphere { side, error });
    match [genus("domain", domain)?, genus("target", target)?] {
        [0, 0] => Ok(0),
        [domain, target] if domain != target => Err(PairError::UnequalGenus { domain, target }),
        [genus, _] => torus::require_options(options, genus).map(|()| genus),
    }
}

fn map_tori<A: ProgressResponse>(
    domain: &SurfaceMesh,
    target: &SurfaceMesh,
    options: &PairOptions,
    progress: &dyn Fn(PairPhase) -> A,
) -> Result<PairMaps, PairError> {
    let of_side = |side| move |error| PairError::Torus { side, error };
    let domain = require_genus_1(domain).map_err(of_side("domain"))?;
    let target = require_genus_1(target).map_err(of_side("target"))?;
    let of_scale = |side| {
        move |error| PairError::Torus {
            side,
            error: ToroidalError::Surface(error),
        }
    };
    require_scale(&domain).map_err(of_scale("domain"))?;
    require_scale(&target).map_err(of_scale("target"))?;
    Given::with_handles([&domain, &target], options).mapped(progress, |pair| pair.by_tori())
}

fn map_hyperbolic_surfaces<A: ProgressResponse>(
    domain: &SurfaceMesh,
    target: &SurfaceMesh,
    genus: u64,
    options: &PairOptions,
    progress: &dyn Fn(PairPhase) -> A,
) -> Result<PairMaps, PairError> {
    let oriented = |side, surface| -> Result<(SurfaceMesh, usize), PairError> {
        let of_side = |error| PairError::Hyperbolic { side, error };
        let handles = require_genus_2_or_more(surface).map_err(of_side)?;
        let oriented = require_genus(surface, genus).map_err(|error| of_side(HyperbolicError::Surface(error)))?;
        require_scale(&oriented).map_err(|error| of_side(HyperbolicError::Surface(error)))?;
        Ok((oriented, handles))
    };
    let (domain, genus) = oriented("domain", domain)?;
    let (target, _) = oriented("target", target)?;
    Given::with_handles([&domain, &target], options).mapped(progress, |pair| pair.by_hyperbolic_surface(genus))
}

/// The map of a pair, and others.
#[derive(Debug, Clone)]
pub struct PairMaps {
    /// The map with the least energy.
    pub map: BoundaryMap,
    /// What was done and found.
    pub report: PairReport,
    /// Other maps, in the order of [`PairReport::alternatives`], as many as were asked for; fewer where no more were found, or one
    /// misses a landmark.
    pub alternatives: Vec<BoundaryMap>,
}

struct PairMapping<'a> {
    domain: &'a SurfaceMesh,
    target: &'a SurfaceMesh,
    landmarks: &'a Landmarks,
    /// Vertices along landmark curves, with their places on the target.
    curves: &'a [curves::CurvePoint],
    options: &'a PairOptions,
    begin: Instant,
    reporter: &'a ProgressSender<'a, PairPhase>,
}

impl PairMapping<'_> {
    /// As [`Self::by_soft_targets`]; where that ends [off](isometry::is_off) an isometry, a map is sought the other way, too, and the better
    /// one is taken. Either search gets stuck at other minima.
    fn by_soft_targets_both_ways(&self) -> Result<PairMaps, PairError> {
        let mut made = self.by_soft_targets()?;
        let is_free = self.landmarks.pairs().is_empty()
            && self.curves.is_empty()
            && self.options.start.is_none()
            && !self.options.aligned
            && self.options.improve;
        if !is_free || !self.reporter.should_improve() || !made.report.isometry_defect.is_some_and(isometry::is_off) {
            return Ok(made);
        }
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
            Err(PairError::Cancelled) => return Err(PairError::Cancelled),
            found => found.ok(),
        };
        if let Some((map, report)) = found.and_then(|found| Some((found.map.inverse()?, found.report)))
            && let Some(after) = distortion(&map)
            && let Some(stretch) = Stretch::of(&map, self.options.most_stretched)
            && rating(&after, report.isometry_defect) < rating(&made.report.after, made.report.isometry_defect)
        {
            made.map = map;
            made.report = PairReport {
                is_reversed: true,
                after,
                stretch,
                isometry_defect: report.isometry_defect,
                nearer_isometry: report.nearer_isometry,
                warnings: report.warnings,
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

    fn by_soft_targets(&self) -> Result<PairMaps, PairError> {
        let target = self.target_embedding()?;
        let locator = Locator::new(&target);
        let inverse = InverseEmbedding::new(&target, &locator);
        let sphere = self.elapsed();

        self.report(PairPhase::Aligning { done: 0, of: 0 })?;
        let Starts {
            all: starts,
            mut warnings,
            shapes,
            closest,
        } = self.starts(&target)?;
        let align = self.elapsed();

        let embedder = DomainEmbedder {
            shapes: shapes.as_ref(),
            ..self.embedder(&target, &inverse)?
        };
        let soft_targets: Vec<&SoftTargets> = starts.iter().map(|start| &start.soft_targets).collect();
        let (schedules, steps) = self.schedules(&embedder);
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
        let completed = match self.options.improve {
            true => Some(self.completed_best(&embedder, &mut ranked, &starts)?),
            false => None,
        };
        let (best, others) = ranked.split_first().ok_or(PairError::NoEmbedding)?;

        let start = &starts[best.start];
        let before = match is_given {
            true => best.candidate.clone(),
            false => embedder
                .by_soft_targets_alone(&start.soft_targets, &best.schedule)
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
        let of_map = embedder.isometry_defect(&after.embedding);
        let images = after.embedding.directions.iter().map(|x| inverse.position(x));
        // Correspondences know nothing of springs.
        let closest = closest.filter(|_| embedder.springs.is_empty());
        let nearer = closest.and_then(|closest| NearerIsometry::than(of_map?, images, &closest, self.target));
        let (map, [before, after], stretch) = self.measured(&target, &before, &after)?;
        let report = PairReport {
            method: PairMethod::SoftTargets,
            landmarks: self.landmarks.pairs().len(),
            landmark_error: self.landmark_error(&map),
            coarse_embeddings,
            starts: summaries(&starts, &ranked),
            start: best.start,
            alternatives: alternatives
                .iter()
                .map(|(other, distance)| PairAlternative {
                    kind: starts[other.start].kind,
                    energy_ratio: other.compared(best).map_or(f64::NAN, energy_ratio),
                    isometry_defect: other.qualities.last().and_then(|quality| quality.isometry_defect),
                    distance: *distance,
                })
                .collect(),
            rotations: vec![],
            schedule: Some(best.schedule),
            torus: None,
            hyperbolic: None,
            before,
            after,
            isometry_defect: of_map,
            nearer_isometry: nearer,
            is_reversed: false,
            stretch,
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
        };
        Ok(PairMaps {
            map,
            report,
            alternatives: others,
        })
    }

    /// The target's spherical embedding: that of the boundary map that is started from, if it is one of this target.
    fn target_embedding(&self) -> Result<SphericalEmbedding, PairError> {
        let given = self.options.start.as_ref().and_then(BoundaryMap::target_embedding);
        match given.filter(|given| given.surface() == self.target) {
            Some(given) => Ok(given.clone()),
            None => self.sphere("target", self.target, SphereEnergy::Balanced),
        }
    }

    /// The embedding of the map that is started from, if that was composed with the embedding of the target that is used here.
    fn given_embedding(&self, embedder: &DomainEmbedder, starts: &[Start]) -> Option<EmbeddingCandidate> {
        let [Start { kind, soft_targets }] = starts else {
            return None;
        };
        if *kind != PairStartKind::Given {
            return None;
        }
        let directions = bijective_targets(self.domain, soft_targets)?;
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
        let first = completed(ranked.first().ok_or(PairError::NoEmbedding)?)?;
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
        let Some(k) = rival(ranked) else {
            return Ok(first);
        };
        let second = completed(&ranked[k])?;
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
        self.take_exact_targets(embedder, soft_targets, &mut completed);
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

    fn by_conformal_maps(&self) -> Result<PairMaps, PairError> {
        let domain = self.sphere("domain", self.domain, SphereEnergy::Conformal)?;
        let target = self.sphere("target", self.target, SphereEnergy::Conformal)?;
        let sphere = self.elapsed();

        self.report(PairPhase::Aligning { done: 0, of: 0 })?;
        let mut warnings = Vec::new();
        let matches = search_rotations(&domain, &target, None);
        let rotations: Vec<f64> = matches.iter().map(|found| found.score).collect();
        if let [best, second, ..] = rotations[..]
            && second > best - AMBIGUOUS_SCORE
            && self.landmarks.pairs().len() < 2
        {
            warnings.push(
                "several rotations of the spheres fit nearly as well; give landmarks if the map goes to the wrong place"
                    .into(),
            );
        }
        let turned = self.by_three_landmarks(&domain, &target).unwrap_or_else(|| {
            let by_landmarks = self.rotation_of_landmarks(&domain, &target, &mut warnings);
            let rotation = by_landmarks.or(matches.first().map(|found| found.rotation));
            let rotation = rotation.unwrap_or_else(Matrix3::identity);
            domain.directions().iter().map(|x| (rotation * x).normalize()).collect()
        });
        // Rotating may invert the smallest triangles by rounding. Then the target is rotated instead.
        let (turned, target) = if check_embedding(self.domain.triangles(), &turned).is_bijective() {
            (turned, target)
        } else {
            let back = sphere_rotation(&turned, domain.directions(), &vec![1.0; turned.len()]);
            let back = back.map_or_else(Matrix3::identity, |back| back.rotation);
            let directions: Vec<Vector> = target.directions().iter().map(|x| back * x).collect();
            let turned_target = SphericalEmbedding::new(target.surface().clone(), &directions);
            let error = |error| PairError::Sphere { side: "target", error };
            (domain.directions().to_vec(), turned_target.map_err(error)?)
        };
        let align = self.elapsed();

        self.improving(0);
        let locator = Locator::new(&target);
        let inverse = InverseEmbedding::new(&target, &locator);
        let embedder = self.embedder(&target, &inverse)?;
        let mut after = embedder.candidate_at(&turned);
        let before = after.clone();
        if self.options.improve {
            embedder.finish(&mut after, &|rounds| self.improving(rounds));
        }
        self.require_landmarks(&after)?;
        let (improved, concluded) = (self.elapsed(), self.reporter.should_conclude());
        let (map, [before, after], stretch) = self.measured(&target, &before, &after)?;
        let report = PairReport {
            method: PairMethod::Conformal,
            landmarks: self.landmarks.pairs().len(),
            landmark_error: self.landmark_error(&map),
            coarse_embeddings: 1,
            starts: vec![],
            start: 0,
            alternatives: vec![],
            rotations,
            schedule: None,
            torus: None,
            hyperbolic: None,
            before,
            after,
            isometry_defect: None,
            nearer_isometry: None,
            is_reversed: false,
            stretch,
            timings: PairTimings {
                sphere,
                align: align - sphere,
                coarse: 0.0,
                improve: improved - align,
                reversed: 0.0,
                total: self.elapsed(),
            },
            concluded,
            warnings,
        };
        Ok(PairMaps {
            map,
            report,
            alternatives: vec![],
        })
    }

    /// Reports rounds of lowering the distortion; a cancellation takes effect in them.
    fn improving(&self, rounds: usize) {
        let _ = self.reporter.send(PairPhase::Improving {
            rounds,
            most_rounds: DomainEmbedder::MOST_ROUNDS,
        });
    }

    fn report(&self, phase: PairPhase) -> Result<(), PairError> {
        match self.reporter.send(phase) {
            ControlFlow::Continue(()) => Ok(()),
            ControlFlow::Break(()) => Err(PairError::Cancelled),
        }
    }

    fn elapsed(&self) -> f64 {
        self.begin.elapsed().as_secs_f64()
    }

    fn sphere(
        &self,
        side: &'static str,
        surface: &SurfaceMesh,
        energy: SphereEnergy,
    ) -> Result<SphericalEmbedding, PairError> {
        let options = SphereOptions {
            energy,
            ..SphereOptions::default()
        };
        let forward = |phase| {
            let _ = self.reporter.send(PairPhase::Sphere(side, phase));
            self.reporter.control()
        };
        match map_to_sphere(surface, &options, &forward) {
            Ok((map, _)) => Ok(map),
            Err(SphericalError::Cancelled) => Err(PairError::Cancelled),
            Err(error) => Err(PairError::Sphere { side, error }),
        }
    }

    fn embedder<'a>(
        &'a self,
        target: &SphericalEmbedding,
        inverse: &'a InverseEmbedding<'a>,
    ) -> Result<DomainEmbedder<'a>, PairError> {
        let (vertices, pairs) = (self.domain.vertices(), self.landmarks.pairs());
        let metric = |to: &Vector| inverse.length_ratio(to).powi(2);
        let of_pairs = pairs.iter().map(|&[v, w]| (v, target.directions()[w as usize]));
        let of_curves = self
            .curves
            .iter()
            .map(|point| (point.vertex, target.direction(&point.place)));
        let (mut pins, mut springs) = (Vec::new(), BTreeMap::new());
        for (vertex, to) in of_pairs {
            match self.options.landmarks_weight {
                None => pins.push(Pin {
                    vertex,
                    to,
                    metric: metric(&to),
                }),
                Some(weight) => {
                    let weight = weight * metric(&to);
                    springs.insert(vertex, Spring { to, weight });
                }
            }
        }
        for (vertex, to) in of_curves {
            let weight = self.options.curves_weight / self.curves.len() as f64 * metric(&to);
            springs.entry(vertex).or_insert(Spring { to, weight });
        }
        // A few points of the curves are enough for coarse embeddings.
        let of_curves = self
            .curves
            .iter()
            .step_by(self.curves.len().div_ceil(MOST_LATE_OF_CURVES).max(1));
        let late = pairs
            .iter()
            .map(|pair| pair[0])
            .chain(of_curves.map(|point| point.vertex));
        let late: Vec<u32> = late.collect();
        Ok(DomainEmbedder {
            domain: self.domain,
            hierarchy: Hierarchy::new(vertices, self.domain.triangles(), &late).ok_or(TOO_FINE)?,
            inverse,
            shapes: None,
            pins: Pins::new(pins, vertices.len()),
            springs,
            reporter: self.reporter,
        })
    }

    /// The domain's directions under the Möbius transformation that meets the first three landmarks; `None` if that
    /// inverts a geodesic triangle.
    fn by_three_landmarks(&self, domain: &SphericalEmbedding, target: &SphericalEmbedding) -> Option<Vec<Vector>> {
        let three = self.landmarks.pairs().first_chunk::<3>()?;
        let from = three.map(|[v, _]| domain.directions()[v as usize]);
        let to = three.map(|[_, w]| target.directions()[w as usize]);
        let moebius = Moebius::of_three(&from, &to)?;
        let moved: Vec<Vector> = domain.directions().iter().map(|x| moebius.apply(x)).collect();
        let is_bijective = check_embedding(self.domain.triangles(), &moved).is_bijective();
        is_bijective.then_some(moved)
    }

    fn rotation_of_landmarks(
        &self,
        domain: &SphericalEmbedding,
        target: &SphericalEmbedding,
        warnings: &mut Vec<String>,
    ) -> Option<Matrix3> {
        let pairs = self.landmarks.pairs();
        if pairs.len() < 2 {
            return None;
        }
        let directions = |&[v, w]: &[u32; 2]| (domain.directions()[v as usize], target.directions()[w as usize]);
        let (from, to): (Vec<Vector>, Vec<Vector>) = pairs.iter().map(directions).unzip();
        let turn = sphere_rotation(&from, &to, &vec![1.0; from.len()])?;
        if pairs.len() > 3 && turn.mirrored_residual < 0.5 * turn.residual {
            warnings.push("the landmarks have the opposite cyclic order on the target, as on a mirror image".into());
        }
        Some(turn.rotation)
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

    fn require_landmarks(&self, candidate: &EmbeddingCandidate) -> Result<(), PairError> {
        let missed = candidate.missed();
        match missed.first() {
            None => Ok(()),
            Some(&first) => Err(PairError::LandmarksMissed {
                landmarks: self.landmarks.pairs().len(),
                first: self.landmarks.pairs()[first],
                missed,
            }),
        }
    }

    /// The better one of the maps before and after optimisation, with the distortion before and that of the map itself, and
    /// how far that stretches.
    fn measured(
        &self,
        target: &SphericalEmbedding,
        before: &EmbeddingCandidate,
        after: &EmbeddingCandidate,
    ) -> Result<(BoundaryMap, [SurfaceDistortion; 2], Stretch), PairError> {
        self.report(PairPhase::Measuring { done: 0, of: 2 })?;
        let no_area = || PairError::from(AlignError::NoArea { side: "domain" });
        let (first, last) = (self.through(before, target)?, self.through(after, target)?);
        let of_first = distortion(&first).ok_or_else(no_area)?;
        self.report(PairPhase::Measuring { done: 1, of: 2 })?;
        let of_last = distortion(&last).ok_or_else(no_area)?;
        let (map, distortions) = match before.missed().is_empty() && !is_lower(&of_last, &of_first) {
            true => (first, [of_first; 2]),
            false => (last, [of_first, of_last]),
        };
        let stretch = Stretch::of(&map, self.options.most_stretched).ok_or_else(no_area)?;
        Ok((map, distortions, stretch))
    }

    /// The map of an embedding of all vertices.
    fn through(&self, candidate: &EmbeddingCandidate, target: &SphericalEmbedding) -> Result<BoundaryMap, PairError> {
        let domain = SphericalEmbedding::new(self.domain.clone(), &candidate.embedding.directions)
            .map_err(|error| PairError::Sphere { side: "domain", error })?;
        Ok(BoundaryMap::through_sphere(domain, target.clone())?)
    }

    /// The largest distance of an image of a landmark, or of a vertex of a landmark curve, from where it is to be.
    fn landmark_error(&self, map: &BoundaryMap) -> f64 {
        let pairs = self.landmarks.pairs().iter();
        let of_pairs = pairs.map(|&[v, w]| (map.image()[v as usize] - self.target.vertices()[w as usize]).norm());
        let of_curves = self.curves.iter().map(|point| {
            let place = point.place.position(self.target, self.target.vertices());
            (map.image()[point.vertex as usize] - place).norm()
        });
        of_pairs.chain(of_curves).fold(0.0, f64::max) / self.target.diagonal()
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

/// Whether optimisation was of use: it lowers the distortion of straight triangles, which can raise that of the map itself,
/// and it may trade one part of the surface for another. Compared by the mean, or by the product of three quantiles: a few
/// triangles across narrow limbs may dominate the mean, and one quantile alone does not see what lies above it.
fn is_lower(after: &SurfaceDistortion, before: &SurfaceDistortion) -> bool {
    product_of_quantiles(after) <= product_of_quantiles(before)
        || after.mean_symmetric_dirichlet <= before.mean_symmetric_dirichlet
}

/// What maps of a pair are compared by, as [`Quality`] says: quantiles of the distortion in place of the mean, which single triangles rule.
fn rating(of: &SurfaceDistortion, isometry_defect: Option<f64>) -> f64 {
    let energy = product_of_quantiles(of).cbrt();
    Quality {
        energy,
        isometry_defect,
    }
    .rating()
}

fn product_of_quantiles(of: &SurfaceDistortion) -> f64 {
    let quantiles = of.symmetric_dirichlet;
    quantiles.p50 * quantiles.p90 * quantiles.p99
}

/// Distortion of the map itself rather than of straight triangles: over triangles cut into four, whose new vertices go
/// through the sphere.
fn distortion(map: &BoundaryMap) -> Option<SurfaceDistortion> {
    let fine = map.subdivided();
    SurfaceDistortion::of(fine.domain(), fine.image())
}

//! A bijective boundary map between two solids of genus 0 without a given correspondence: the composition of two
//! spherical embeddings.
//!
//! 1. The target is embedded on the sphere ([`map_to_sphere`]).
//! 2. The domain is aligned with the target by similarities ([`align`]). The closest point of the target gives each
//!    vertex of the domain a soft target on the sphere ([`vertex_targets`]).
//! 3. The domain is embedded on the same sphere, coarse to fine, pulled towards the soft targets; several alignments
//!    and schedules are tried on coarse meshes and the best is refined.
//! 4. The domain's embedding is optimised for low distortion of the map from surface to surface.
//!
//! No step inverts a triangle on the sphere, so the result is a bijection at every point of the surface.

mod alignment;
mod embedder;
mod inter_surface;
mod landmarks;
mod options;
mod oriented_query;
mod report;
mod rotation;
mod targets;

use std::ops::ControlFlow;
use std::time::Instant;

pub use alignment::{AlignError, Alignment, AlignmentStart, AlignmentSurface, Alignments, align, align_by_landmarks};
pub use embedder::SoftTargetSchedule;
pub use landmarks::{LandmarkError, Landmarks};
pub use options::{PairMethod, PairOptions};
pub use oriented_query::{OrientedPoint, OrientedQuery, vertex_normals};
pub use report::{PairError, PairPhase, PairReport, PairTimings};
pub use rotation::{RotationMatch, search_rotations};
pub use targets::{VertexTarget, vertex_targets};

use super::{BoundaryMap, SurfaceDistortion};
use crate::geometry::{Similarity, sphere_rotation};
use crate::mesh::SurfaceMesh;
use crate::progress::{ProgressResponse, ProgressSender, run_cancellable};
use crate::spherical::{
    Hierarchy, Locator, Moebius, SphereEnergy, SphereOptions, SphericalEmbedding, SphericalError, check_embedding,
    map_to_sphere, require_genus_0, require_scale,
};
use crate::{Matrix3, Vector};
use alignment::align_with_progress;
use embedder::{DomainEmbedder, EmbeddingCandidate, Pins, SoftTargets, best_coarse_embedding};
use inter_surface::InverseEmbedding;

/// Schedules to compare: which one ends best differs from pair to pair, and coarse embeddings are cheap.
const SCHEDULES: [SoftTargetSchedule; 8] = [
    SoftTargetSchedule::new(1.0, 60),
    SoftTargetSchedule::new(1.0, 200),
    SoftTargetSchedule::new(1.0, 800),
    SoftTargetSchedule::new(10.0, 60),
    SoftTargetSchedule::new(10.0, 200),
    SoftTargetSchedule::new(10.0, 800),
    SoftTargetSchedule::new(100.0, 60),
    SoftTargetSchedule::new(100.0, 800),
];
/// Schedules for solids in the same place: those taken for polycubes of voxels, where strong pulls can be trusted.
const SCHEDULES_IN_PLACE: [SoftTargetSchedule; 4] = [
    SoftTargetSchedule::new(1.0, 60),
    SoftTargetSchedule::new(1.0, 800),
    SoftTargetSchedule::new(10.0, 800),
    SoftTargetSchedule::new(100.0, 800),
];
/// Vertices of the coarse embeddings: of all at first, then of the better ones.
const COARSE_SIZES: [usize; 2] = [1600, 4000];
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
/// Takes some 10 s for 15 000 vertices on two cores. The result is the same for any number of threads.
///
/// # Errors
///
/// When a solid is not of genus 0, or landmarks cannot be met; [`PairError::Cancelled`] when `progress` cancels it
/// ([`ProgressResponse`]), which usually takes effect within a fraction of a second.
pub fn map_pair<A: ProgressResponse>(
    domain: &SurfaceMesh,
    target: &SurfaceMesh,
    options: &PairOptions,
    progress: &dyn Fn(PairPhase) -> A,
) -> Result<(BoundaryMap, PairReport), PairError> {
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
    let made = run_cancellable(&|phase| progress(phase).control(), |reporter| {
        let pair = PairMapping {
            domain: &domain,
            target: &target,
            landmarks: &landmarks,
            aligned: options.aligned,
            improve: options.improve,
            start: Instant::now(),
            reporter,
        };
        match options.method {
            PairMethod::SoftTargets => pair.by_soft_targets(),
            PairMethod::Conformal => pair.by_conformal_maps(),
        }
    });
    made.unwrap_or(Err(PairError::Cancelled))
}

struct PairMapping<'a> {
    domain: &'a SurfaceMesh,
    target: &'a SurfaceMesh,
    landmarks: &'a Landmarks,
    aligned: bool,
    improve: bool,
    start: Instant,
    reporter: &'a ProgressSender<'a, PairPhase>,
}

impl PairMapping<'_> {
    fn by_soft_targets(&self) -> Result<(BoundaryMap, PairReport), PairError> {
        let target = self.sphere("target", self.target, SphereEnergy::Balanced)?;
        let locator = Locator::new(&target);
        let inverse = InverseEmbedding::new(&target, &locator);
        let sphere = self.elapsed();

        self.report(PairPhase::Aligning { done: 0, of: 0 })?;
        let (soft_targets, warnings) = self.soft_targets(&target)?;
        let align = self.elapsed();

        let schedules: &[SoftTargetSchedule] = match self.aligned {
            true => &SCHEDULES_IN_PLACE,
            false => &SCHEDULES,
        };
        let count = soft_targets.len() * schedules.len();
        self.report(PairPhase::CoarseEmbeddings {
            vertices: COARSE_SIZES[0],
            done: 0,
            of: count,
        })?;
        let embedder = self.embedder(&target, &inverse)?;
        let (coarse, [alignment, schedule], alignments) =
            best_coarse_embedding(&embedder, &soft_targets, schedules, &COARSE_SIZES).ok_or(PairError::NoEmbedding)?;
        let compared = self.elapsed();

        let (soft_targets, schedule) = (&soft_targets[alignment], schedules[schedule]);
        let refining = |vertices, energy| {
            let total = self.domain.vertices().len();
            // A cancellation takes effect at the next level.
            let _ = self.report(PairPhase::Refining {
                vertices,
                total,
                energy: ISOMETRY_ENERGY * energy,
            });
        };
        let plain = embedder
            .by_soft_targets_alone(soft_targets, &schedule)
            .ok_or(TOO_FINE)?;
        let mut after = plain.clone();
        if self.improve {
            let refined = embedder.refine(coarse, soft_targets, &schedule, usize::MAX, &refining);
            after = refined.ok_or(TOO_FINE)?;
            embedder.finish(&mut after, &|rounds| self.improving(rounds));
            self.take_exact_targets(&embedder, soft_targets, &mut after);
        }
        self.require_landmarks(&after)?;
        let (improved, concluded) = (self.elapsed(), self.reporter.should_conclude());
        let (map, [before, after]) = self.measured(&target, &plain, &after)?;
        let report = PairReport {
            method: PairMethod::SoftTargets,
            landmarks: self.landmarks.pairs().len(),
            coarse_embeddings: count,
            alignments: alignments.iter().map(|energy| ISOMETRY_ENERGY * energy).collect(),
            alignment,
            rotations: vec![],
            schedule: Some(schedule),
            before,
            after,
            timings: PairTimings {
                sphere,
                align: align - sphere,
                coarse: compared - align,
                improve: improved - compared,
                total: self.elapsed(),
            },
            concluded,
            warnings,
        };
        Ok((map, report))
    }

    fn by_conformal_maps(&self) -> Result<(BoundaryMap, PairReport), PairError> {
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
        if self.improve {
            embedder.finish(&mut after, &|rounds| self.improving(rounds));
        }
        self.require_landmarks(&after)?;
        let (improved, concluded) = (self.elapsed(), self.reporter.should_conclude());
        let (map, [before, after]) = self.measured(&target, &before, &after)?;
        let report = PairReport {
            method: PairMethod::Conformal,
            landmarks: self.landmarks.pairs().len(),
            coarse_embeddings: 1,
            alignments: vec![],
            alignment: 0,
            rotations,
            schedule: None,
            before,
            after,
            timings: PairTimings {
                sphere,
                align: align - sphere,
                coarse: 0.0,
                improve: improved - align,
                total: self.elapsed(),
            },
            concluded,
            warnings,
        };
        Ok((map, report))
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
        self.start.elapsed().as_secs_f64()
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

    /// The soft targets that each alignment gives, and warnings about the alignments.
    fn soft_targets(&self, target: &SphericalEmbedding) -> Result<(Vec<SoftTargets>, Vec<String>), PairError> {
        let from = AlignmentSurface::new(self.domain, "domain")?;
        let to = AlignmentSurface::new(self.target, "target")?;
        let pairs = self.landmarks.positions(self.domain.vertices(), self.target.vertices());
        let of_similarity = |similarity: &Similarity| {
            let found = vertex_targets(&from, &to, similarity);
            let direction = |found: VertexTarget| (target.direction(&found.place), found.weight);
            found.into_iter().map(|found| found.map(direction)).collect()
        };
        let mut warnings = Vec::new();
        let alignments = if pairs.len() >= 3 {
            align_by_landmarks(&from, &to, &pairs)?
        } else if self.aligned {
            return Ok((vec![of_similarity(&Similarity::identity())], warnings));
        } else {
            let progress = |done, of| {
                // A cancellation takes effect when the alignments are there, in a second or two.
                let _ = self.reporter.send(PairPhase::Aligning { done, of });
            };
            align_with_progress(&from, &to, &progress)
        };
        if alignments.looks_mirrored() {
            warnings.push(
                "the target looks like the mirror image of the domain; mirror one of them if that is not what you want"
                    .into(),
            );
        }
        let soft_targets = alignments
            .best
            .iter()
            .map(|alignment| of_similarity(&alignment.similarity));
        Ok((soft_targets.collect(), warnings))
    }

    fn embedder<'a>(
        &'a self,
        target: &SphericalEmbedding,
        inverse: &'a InverseEmbedding<'a>,
    ) -> Result<DomainEmbedder<'a>, PairError> {
        let (vertices, pairs) = (self.domain.vertices(), self.landmarks.pairs());
        let late: Vec<u32> = pairs.iter().map(|pair| pair[0]).collect();
        let pin = |&[v, w]: &[u32; 2]| (v, target.directions()[w as usize]);
        Ok(DomainEmbedder {
            domain: self.domain,
            hierarchy: Hierarchy::new(vertices, self.domain.triangles(), &late).ok_or(TOO_FINE)?,
            inverse,
            pins: Pins::new(pairs.iter().map(pin).collect(), vertices.len()),
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
        let targets = soft_targets.iter().map(|target| target.map(|(to, _)| to));
        let targets: Option<Vec<Vector>> = targets.collect();
        let Some(targets) = targets.filter(|x| check_embedding(self.domain.triangles(), x).is_bijective()) else {
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

    /// The better one of the maps before and after optimisation, with the distortion before and that of the map itself.
    fn measured(
        &self,
        target: &SphericalEmbedding,
        before: &EmbeddingCandidate,
        after: &EmbeddingCandidate,
    ) -> Result<(BoundaryMap, [SurfaceDistortion; 2]), PairError> {
        self.report(PairPhase::Measuring { done: 0, of: 2 })?;
        let through = |candidate: &EmbeddingCandidate| -> Result<BoundaryMap, PairError> {
            let domain = SphericalEmbedding::new(self.domain.clone(), &candidate.embedding.directions)
                .map_err(|error| PairError::Sphere { side: "domain", error })?;
            Ok(BoundaryMap::through_sphere(domain, target.clone())?)
        };
        let (first, last) = (through(before)?, through(after)?);
        let of_first = distortion(&first);
        self.report(PairPhase::Measuring { done: 1, of: 2 })?;
        let (Some(of_first), Some(of_last)) = (of_first, distortion(&last)) else {
            return Err(AlignError::NoArea { side: "domain" }.into());
        };
        if before.missed().is_empty() && !is_lower(&of_last, &of_first) {
            Ok((first, [of_first; 2]))
        } else {
            Ok((last, [of_first, of_last]))
        }
    }
}

/// Whether optimisation was of use: it lowers the distortion of straight triangles, which can raise that of the map itself,
/// and it may trade one part of the surface for another. Compared by the mean, or by the product of three quantiles: a few
/// triangles across narrow limbs may dominate the mean, and one quantile alone does not see what lies above it.
fn is_lower(after: &SurfaceDistortion, before: &SurfaceDistortion) -> bool {
    let product = |of: &SurfaceDistortion| {
        let quantiles = of.symmetric_dirichlet;
        quantiles.p50 * quantiles.p90 * quantiles.p99
    };
    product(after) <= product(before) || after.mean_symmetric_dirichlet <= before.mean_symmetric_dirichlet
}

/// Distortion of the map itself rather than of straight triangles: over triangles cut into four, whose new vertices go
/// through the sphere.
fn distortion(map: &BoundaryMap) -> Option<SurfaceDistortion> {
    let fine = map.subdivided();
    SurfaceDistortion::of(fine.domain(), fine.image())
}

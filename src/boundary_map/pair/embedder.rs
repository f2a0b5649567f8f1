//! Embeds the domain on the target's sphere, pulled towards soft targets, and lowers the distortion of the map between
//! the surfaces.
//!
//! Coarse to fine, as Schmidt, Pieper, Kobbelt, *Surface maps via adaptive triangulations*, 2023: on a coarse level
//! long moves are cheap, and every level starts from the solution of a coarser one.

use std::sync::atomic::{AtomicUsize, Ordering};

use rayon::prelude::*;

use super::PairPhase;
use super::inter_surface::{InterSurfaceEnergy, InterSurfaceMap, InverseEmbedding};
use crate::Vector;
use crate::mesh::SurfaceMesh;
use crate::progress::ProgressSender;
use crate::spherical::{EnergyWeights, Hierarchy, Newton, NewtonOptions, PartialEmbedding, Relaxation, RestShapes};

/// For each vertex of the domain the direction on the target's sphere that it is pulled to, and a weight from 0 to 1.
pub(crate) type SoftTargets = Vec<Option<(Vector, f64)>>;

/// How strongly, and up to which level, an embedding is pulled to its soft targets. On finer levels the distortion
/// alone is minimised.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct SoftTargetSchedule {
    /// Energy of the soft targets if all vertices were at distance 1 from theirs on the unit sphere, over the energy of
    /// undistorted triangles.
    pub strength: f64,
    /// Number of embedded vertices up to which the soft targets pull.
    pub until_vertices: usize,
}

/// When to stop alternating between Newton's method and relaxation.
struct AlternationLimits {
    most_rounds: usize,
    /// Relative decrease of the energy in a round below which it is the last.
    least_decrease: f64,
}

/// Landmarks: vertices that must go to given directions.
pub(crate) struct Pins {
    pairs: Vec<(u32, Vector)>,
    /// Index of each vertex's pin.
    of_vertex: Vec<Option<usize>>,
}

/// An embedding of the domain, perhaps still coarse, with its quality.
#[derive(Clone)]
pub(crate) struct EmbeddingCandidate {
    pub embedding: PartialEmbedding,
    /// Which of the pins are met.
    pub pinned: Vec<bool>,
    /// Mean symmetric Dirichlet energy of the map to the target, 1 for an isometry.
    pub energy: f64,
}

/// Embeds a domain on the sphere of a target.
pub(crate) struct DomainEmbedder<'a> {
    pub domain: &'a SurfaceMesh,
    pub hierarchy: Hierarchy,
    pub inverse: &'a InverseEmbedding<'a>,
    pub pins: Pins,
    /// Polled often. After a cancellation, results are not used.
    pub reporter: &'a ProgressSender<'a, PairPhase>,
}

/// Rounds of relaxation towards the soft targets on each level.
const SOFT_TARGET_SWEEPS: usize = 20;
/// Weights of angles and areas beside the soft targets.
const SOFT_TARGET_WEIGHTS: EnergyWeights = EnergyWeights { angle: 0.1, area: 0.1 };
/// Rounds of relaxation for the vertices that a level has inserted, and for all.
const NEW_SWEEPS: usize = 10;
const SWEEPS: usize = 4;
/// Triangles with more than this times the energy of an isometry are relaxed on their own, this often at most.
const DISTORTED: f64 = 8.0;
const MOST_LOCAL_RELAXATIONS: usize = 10;
/// Newton's method and relaxation alternate: Newton's method moves all vertices together, but only until the first
/// triangle would invert; relaxation moves the vertices of such triangles away.
const NEWTON: NewtonOptions = NewtonOptions {
    most_iterations: 5,
    tolerance: 1e-4,
};
/// Limits while embeddings are compared and refined.
const COARSE: AlternationLimits = AlternationLimits {
    most_rounds: 3,
    least_decrease: 1e-3,
};
/// Limits at the end, tight enough that the result does not depend on the alignment it started from.
const LAST: AlternationLimits = AlternationLimits {
    most_rounds: 30,
    least_decrease: 1e-5,
};
/// Candidates of each alignment that go on to the next size, and the energy over that of the best above which they do
/// not.
const KEPT: usize = 3;
const MOST_ENERGY_RATIO: f64 = 1.4;
/// Rounds of moving pins to their directions in an embedding of all vertices.
const MOST_PIN_ROUNDS: usize = 40;
/// Weight of an unmet pin, over that of a soft target.
const PIN_WEIGHT: f64 = 30.0;

impl SoftTargetSchedule {
    pub(super) const fn new(strength: f64, until_vertices: usize) -> Self {
        Self {
            strength,
            until_vertices,
        }
    }
}

impl Pins {
    /// Pins of distinct vertices below `vertices`.
    pub fn new(pairs: Vec<(u32, Vector)>, vertices: usize) -> Self {
        let mut of_vertex = vec![None; vertices];
        for (i, pair) in pairs.iter().enumerate() {
            of_vertex[pair.0 as usize] = Some(i);
        }
        Self { pairs, of_vertex }
    }

    fn of(&self, vertex: u32) -> Option<usize> {
        self.of_vertex[vertex as usize]
    }
}

impl EmbeddingCandidate {
    /// Indices of the pins that are not met.
    pub fn missed(&self) -> Vec<usize> {
        (0..self.pinned.len()).filter(|&i| !self.pinned[i]).collect()
    }

    /// Number of missed pins, and the energy: the order of candidates, best first.
    fn rating(&self) -> (usize, f64) {
        (self.missed().len(), self.energy)
    }
}

impl DomainEmbedder<'_> {
    /// The most rounds of [`Self::finish`].
    pub const MOST_ROUNDS: usize = LAST.most_rounds;

    /// The tetrahedron at the coarsest level of the hierarchy, rotated towards its soft targets.
    fn tetrahedron(&self, soft_targets: &SoftTargets) -> EmbeddingCandidate {
        let target = |v: u32| match self.pins.of(v) {
            Some(i) => Some(self.pins.pairs[i].1),
            None => soft_targets[v as usize].map(|target| target.0),
        };
        EmbeddingCandidate {
            embedding: PartialEmbedding::of_base(&self.hierarchy, target),
            pinned: vec![false; self.pins.pairs.len()],
            energy: f64::INFINITY,
        }
    }

    /// An embedding of all vertices by the soft targets, without minimising the distortion.
    pub fn by_soft_targets_alone(
        &self,
        soft_targets: &SoftTargets,
        schedule: &SoftTargetSchedule,
    ) -> Option<EmbeddingCandidate> {
        let throughout = SoftTargetSchedule {
            until_vertices: usize::MAX,
            ..*schedule
        };
        let start = self.tetrahedron(soft_targets);
        self.refine(start, soft_targets, &throughout, usize::MAX, &|_, _| ())
    }

    /// Inserts vertices until there are at least `enough`. `progress` gets the number of vertices and the energy of
    /// each level. `None` when rounding leaves no position for a vertex.
    pub fn refine(
        &self,
        mut candidate: EmbeddingCandidate,
        soft_targets: &SoftTargets,
        schedule: &SoftTargetSchedule,
        enough: usize,
        progress: &dyn Fn(usize, f64),
    ) -> Option<EmbeddingCandidate> {
        let EmbeddingCandidate {
            embedding,
            pinned,
            energy,
        } = &mut candidate;
        let mut map = InterSurfaceMap::new(self.inverse, self.domain);
        embedding.refine(&self.hierarchy, enough, |embedding| {
            if !self.reporter.should_continue() {
                return;
            }
            // Landmarks have to be met, in no time or in some.
            if self.reporter.should_conclude() && pinned.iter().all(|&is| is) {
                return;
            }
            let is_pulled = embedding.inserted.len() < schedule.until_vertices;
            if is_pulled || !pinned.iter().all(|&is| is) {
                self.pull(embedding, pinned, soft_targets, schedule.strength);
            }
            if !is_pulled {
                map.locate(embedding);
                *energy = self.improve(embedding, &mut map, pinned, &COARSE, &|_| ());
                progress(embedding.inserted.len(), *energy);
            }
        })?;
        Some(candidate)
    }

    /// A given embedding of all vertices. Pins are moved to their directions as far as no triangle inverts.
    pub fn candidate_at(&self, directions: &[Vector]) -> EmbeddingCandidate {
        let mut candidate = EmbeddingCandidate {
            embedding: PartialEmbedding::complete(self.domain, directions),
            pinned: vec![false; self.pins.pairs.len()],
            energy: f64::INFINITY,
        };
        let no_targets = vec![None; directions.len()];
        self.move_pins(&mut candidate.embedding, &mut candidate.pinned);
        for _ in 0..MOST_PIN_ROUNDS {
            if candidate.pinned.iter().all(|&is| is) || !self.reporter.should_continue() {
                break;
            }
            self.pull(&mut candidate.embedding, &mut candidate.pinned, &no_targets, 1.0);
        }
        candidate
    }

    /// The energy of an embedding of all vertices.
    pub fn energy_of(&self, embedding: &PartialEmbedding) -> f64 {
        let mut map = InterSurfaceMap::new(self.inverse, self.domain);
        map.locate(embedding);
        map.find_protrusions(embedding);
        map.energy(embedding)
    }

    /// Lowers the distortion of the map until it has converged. `progress` gets the number of rounds so far.
    pub fn finish(&self, candidate: &mut EmbeddingCandidate, progress: &dyn Fn(usize)) {
        let mut map = InterSurfaceMap::new(self.inverse, self.domain);
        map.locate(&candidate.embedding);
        candidate.energy = self.improve(&mut candidate.embedding, &mut map, &candidate.pinned, &LAST, progress);
    }

    /// Relaxation towards the soft targets and the unmet pins.
    fn pull(&self, embedding: &mut PartialEmbedding, pinned: &mut [bool], soft_targets: &SoftTargets, strength: f64) {
        let weight = strength * 4.0 * std::f64::consts::PI / embedding.inserted.len() as f64;
        for _ in 0..SOFT_TARGET_SWEEPS / 4 {
            self.move_pins(embedding, pinned);
            let soft_target = |v: u32| match self.pins.of(v) {
                Some(i) => Some((self.pins.pairs[i].1, PIN_WEIGHT * weight.max(0.1))),
                None => soft_targets[v as usize].map(|(to, trust)| (to, trust * weight)),
            };
            let is_fixed = |v: u32| self.pins.of(v).is_some_and(|i| pinned[i]);
            let relaxation = Relaxation {
                points: self.domain.vertices(),
                weights: SOFT_TARGET_WEIGHTS,
                soft_target: &soft_target,
                is_fixed: &is_fixed,
            };
            if self.reporter.should_continue() {
                relaxation.run(embedding, 4);
            }
        }
        self.move_pins(embedding, pinned);
    }

    /// Moves pins to their directions where all their triangles stay positive.
    fn move_pins(&self, embedding: &mut PartialEmbedding, pinned: &mut [bool]) {
        for (i, &(v, to)) in self.pins.pairs.iter().enumerate() {
            let is_inserted = !embedding.rings.of(v).is_empty();
            if is_inserted && !pinned[i] && embedding.stays_positive(v, &to) {
                embedding.directions[v as usize] = to;
                pinned[i] = true;
            }
        }
    }

    /// Lowers the distortion of the map to the target; returns its energy.
    fn improve(
        &self,
        embedding: &mut PartialEmbedding,
        map: &mut InterSurfaceMap,
        pinned: &[bool],
        limits: &AlternationLimits,
        progress: &dyn Fn(usize),
    ) -> f64 {
        let is_fixed = |v: u32| self.pins.of(v).is_some_and(|i| pinned[i]);
        let vertices = embedding.inserted.clone();
        let new_vertices = &vertices[embedding.level_start..];
        map.find_protrusions(embedding);
        for _ in 0..NEW_SWEEPS {
            map.sweep(embedding, new_vertices, &is_fixed);
        }
        for _ in 0..SWEEPS {
            map.sweep(embedding, &vertices, &is_fixed);
        }
        let fixed: Vec<u32> = vertices.iter().copied().filter(|&v| is_fixed(v)).collect();
        let triangles = embedding.rings.triangles();
        let shapes = RestShapes::new(&triangles, self.domain.vertices());
        let mut newton = Newton::new(&triangles, &fixed).ok();
        for round in 0..limits.most_rounds {
            progress(round);
            if !self.reporter.should_improve() {
                break;
            }
            // Updated only where there were protrusions before: finding them costs as much as a step.
            if round > 0 && map.has_protrusions() {
                map.find_protrusions(embedding);
            }
            let before = map.energy(embedding);
            self.relax_distorted(embedding, map, &is_fixed);
            if let Some(solver) = &mut newton {
                let energy = InterSurfaceEnergy::new(map, &shapes);
                let should_continue = || self.reporter.should_improve();
                match solver.minimise(&energy, &mut embedding.directions, &NEWTON, &should_continue) {
                    Ok(_) => map.locate(embedding),
                    Err(_) => newton = None,
                }
            }
            map.sweep(embedding, &vertices, &is_fixed);
            if map.energy(embedding) > (1.0 - limits.least_decrease) * before {
                break;
            }
        }
        if map.has_protrusions() {
            map.find_protrusions(embedding);
        }
        map.energy(embedding)
    }

    fn relax_distorted(
        &self,
        embedding: &mut PartialEmbedding,
        map: &mut InterSurfaceMap,
        is_fixed: &dyn Fn(u32) -> bool,
    ) {
        for _ in 0..MOST_LOCAL_RELAXATIONS {
            let distorted = map.distorted(embedding, DISTORTED);
            if distorted.is_empty() {
                break;
            }
            for _ in 0..3 {
                map.sweep(embedding, &distorted, is_fixed);
            }
        }
    }
}

/// The best coarse embedding over all combinations of soft targets and schedules: all are computed with `sizes[0]`
/// vertices, and the better ones of each alignment refined to the next size.
///
/// Returns it, the indices of its soft targets and its schedule, and the last energy of the best one of each alignment.
pub(crate) fn best_coarse_embedding(
    embedder: &DomainEmbedder,
    soft_targets: &[SoftTargets],
    schedules: &[SoftTargetSchedule],
    sizes: &[usize],
) -> Option<(EmbeddingCandidate, [usize; 2], Vec<f64>)> {
    let all = (0..soft_targets.len()).flat_map(|a| (0..schedules.len()).map(move |s| [a, s]));
    let start = |choice: [usize; 2]| (embedder.tetrahedron(&soft_targets[choice[0]]), choice);
    let mut choices: Vec<(EmbeddingCandidate, [usize; 2])> = all.map(start).collect();
    let mut energies = vec![f64::INFINITY; soft_targets.len()];
    for &size in sizes {
        let (done, of) = (AtomicUsize::new(0), choices.len());
        let refined = |(candidate, [a, s]): (EmbeddingCandidate, [usize; 2])| {
            let mut refined = embedder.refine(candidate, &soft_targets[a], &schedules[s], size, &|_, _| ())?;
            // A small surface has all its vertices before its schedule starts to minimise the distortion.
            if !refined.energy.is_finite() {
                embedder.finish(&mut refined, &|_| ());
            }
            let done = done.fetch_add(1, Ordering::Relaxed) + 1;
            // A cancellation takes effect in the refinements.
            let _ = embedder.reporter.send(PairPhase::CoarseEmbeddings {
                vertices: size,
                done,
                of,
            });
            Some((refined, [a, s]))
        };
        choices = choices.into_par_iter().filter_map(refined).collect();
        choices.sort_by(|a, b| {
            let (a, b) = (a.0.rating(), b.0.rating());
            a.0.cmp(&b.0).then(a.1.total_cmp(&b.1))
        });
        let best = choices.first()?.0.rating();
        for (candidate, [a, _]) in choices.iter().rev() {
            energies[*a] = candidate.energy;
        }
        let mut kept = vec![0; soft_targets.len()];
        choices.retain(|(candidate, [a, _])| {
            let (missed, energy) = candidate.rating();
            kept[*a] += 1;
            kept[*a] <= KEPT && missed == best.0 && energy <= MOST_ENERGY_RATIO * best.1
        });
        if embedder.reporter.should_conclude() {
            break;
        }
    }
    let (candidate, choice) = choices.into_iter().next()?;
    Some((candidate, choice, energies))
}

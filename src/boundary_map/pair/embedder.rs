//! Embeds the domain on the target's sphere, pulled towards soft targets, and lowers the distortion of the map between
//! the surfaces.
//!
//! Coarse to fine, as Schmidt, Pieper, Kobbelt, *Surface maps via adaptive triangulations*, 2023: on a coarse level long
//! moves are cheap, and every level starts from the solution of a coarser one.

use rayon::prelude::*;

use super::inter_surface::{InterSurfaceEnergy, InterSurfaceMap, InverseEmbedding};
use crate::Vector;
use crate::mesh::SurfaceMesh;
use crate::spherical::{
    EnergyWeights, Hierarchy, Newton, NewtonError, NewtonOptions, PartialEmbedding, Relaxation, RestShapes,
};

/// Directions on the target's sphere that vertices of the domain are pulled to.
pub(crate) struct SoftTargets {
    /// For each vertex a direction and its weight, from 0 to 1.
    pub of_vertex: Vec<Option<(Vector, f64)>>,
}

/// How strongly, and up to which level, an embedding is pulled to its soft targets. On finer levels the distortion alone
/// is minimised.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct SoftTargetSchedule {
    /// Energy of the soft targets if all were 1 away, over the energy of undistorted triangles.
    #[serde(rename = "pull")]
    pub strength: f64,
    /// Number of vertices up to which the soft targets count.
    #[serde(rename = "until")]
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
    /// Index of each vertex's pin, or [`NO_PIN`].
    of_vertex: Vec<u32>,
}

const NO_PIN: u32 = u32::MAX;

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
    domain: &'a SurfaceMesh,
    hierarchy: &'a Hierarchy,
    inverse: &'a InverseEmbedding<'a>,
    pins: Pins,
    /// Polled often. Once it is false, the work is cancelled and results are not used.
    goes_on: &'a (dyn Fn() -> bool + Sync),
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
const NEWTON_STEPS: usize = 5;
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
/// Candidates of each alignment that go on to the next size, and the energy over that of the best above which they do not.
const KEPT: usize = 3;
const MOST_ENERGY_RATIO: f64 = 1.4;
/// Rounds of moving pins to their directions in an embedding of all vertices.
const MOST_PIN_ROUNDS: usize = 40;
/// Weight of an unmet pin, over that of a soft target.
const PIN_WEIGHT: f64 = 30.0;

impl Pins {
    /// Pins of distinct vertices below `vertices`.
    pub fn new(pairs: Vec<(u32, Vector)>, vertices: usize) -> Self {
        let mut of_vertex = vec![NO_PIN; vertices];
        for (i, pair) in pairs.iter().enumerate() {
            of_vertex[pair.0 as usize] = i as u32;
        }
        Self { pairs, of_vertex }
    }

    fn of(&self, vertex: u32) -> Option<usize> {
        let pin = self.of_vertex[vertex as usize];
        (pin != NO_PIN).then_some(pin as usize)
    }
}

impl<'a> DomainEmbedder<'a> {
    pub fn new(
        domain: &'a SurfaceMesh,
        hierarchy: &'a Hierarchy,
        inverse: &'a InverseEmbedding<'a>,
        pins: Pins,
        goes_on: &'a (dyn Fn() -> bool + Sync),
    ) -> Self {
        Self {
            domain,
            hierarchy,
            inverse,
            pins,
            goes_on,
        }
    }

    /// An embedding with at least `enough` vertices. `None` when rounding leaves no position for one.
    pub fn coarse(
        &self,
        soft_targets: &SoftTargets,
        schedule: &SoftTargetSchedule,
        enough: usize,
    ) -> Option<EmbeddingCandidate> {
        let target = |v: u32| match self.pins.of(v) {
            Some(i) => Some(self.pins.pairs[i].1),
            None => soft_targets.of_vertex[v as usize].map(|target| target.0),
        };
        let candidate = EmbeddingCandidate {
            embedding: PartialEmbedding::of_base(self.hierarchy, target),
            pinned: vec![false; self.pins.pairs.len()],
            energy: f64::INFINITY,
        };
        self.refine(candidate, soft_targets, schedule, enough, &|_, _| ())
    }

    /// An embedding of all vertices by the soft targets, without minimising the distortion.
    pub fn by_soft_targets_alone(
        &self,
        soft_targets: &SoftTargets,
        schedule: &SoftTargetSchedule,
    ) -> Option<EmbeddingCandidate> {
        let to_the_end = SoftTargetSchedule {
            until_vertices: usize::MAX,
            ..*schedule
        };
        self.coarse(soft_targets, &to_the_end, usize::MAX)
    }

    /// Inserts vertices until there are at least `enough`. `progress` gets the number of vertices and the energy of each
    /// level.
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
        embedding.refine(self.hierarchy, enough, |embedding| {
            if !(self.goes_on)() {
                return;
            }
            let is_pulled = embedding.inserted.len() < schedule.until_vertices;
            if is_pulled || !pinned.iter().all(|&is| is) {
                self.pull(embedding, pinned, soft_targets, schedule);
            }
            if !is_pulled {
                map.locate(embedding);
                *energy = self.improve(embedding, &mut map, pinned, &COARSE);
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
        let no_targets = SoftTargets {
            of_vertex: vec![None; directions.len()],
        };
        let schedule = SoftTargetSchedule {
            strength: 1.0,
            until_vertices: 0,
        };
        self.move_pins(&mut candidate.embedding, &mut candidate.pinned);
        for _ in 0..MOST_PIN_ROUNDS {
            if candidate.pinned.iter().all(|&is| is) || !(self.goes_on)() {
                break;
            }
            self.pull(&mut candidate.embedding, &mut candidate.pinned, &no_targets, &schedule);
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

    /// Lowers the distortion of the map until it has converged.
    pub fn finish(&self, candidate: &mut EmbeddingCandidate) {
        let mut map = InterSurfaceMap::new(self.inverse, self.domain);
        map.locate(&candidate.embedding);
        candidate.energy = self.improve(&mut candidate.embedding, &mut map, &candidate.pinned, &LAST);
    }

    /// Indices of the pins that are not met.
    pub fn missed(&self, candidate: &EmbeddingCandidate) -> Vec<usize> {
        (0..candidate.pinned.len()).filter(|&i| !candidate.pinned[i]).collect()
    }

    /// Relaxation towards the soft targets and the unmet pins.
    fn pull(
        &self,
        embedding: &mut PartialEmbedding,
        pinned: &mut [bool],
        soft_targets: &SoftTargets,
        schedule: &SoftTargetSchedule,
    ) {
        let weight = schedule.strength * 4.0 * std::f64::consts::PI / embedding.inserted.len() as f64;
        for _ in 0..SOFT_TARGET_SWEEPS / 4 {
            self.move_pins(embedding, pinned);
            let soft_target = |v: u32| match self.pins.of(v) {
                Some(i) => Some((self.pins.pairs[i].1, PIN_WEIGHT * weight.max(0.1))),
                None => soft_targets.of_vertex[v as usize].map(|(to, trust)| (to, trust * weight)),
            };
            let is_fixed = |v: u32| self.pins.of(v).is_some_and(|i| pinned[i]);
            let relaxation = Relaxation {
                points: self.domain.vertices(),
                weights: SOFT_TARGET_WEIGHTS,
                soft_target: &soft_target,
                is_fixed: &is_fixed,
            };
            if (self.goes_on)() {
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
            if !(self.goes_on)() {
                break;
            }
            // Updated only where there were protrusions before: finding them costs as much as a step.
            if round > 0 && map.has_protrusions() {
                map.find_protrusions(embedding);
            }
            let before = map.energy(embedding);
            self.relax_distorted(embedding, map, &is_fixed);
            let stepped = newton
                .as_mut()
                .map(|newton| self.newton_steps(newton, embedding, map, &shapes));
            if stepped.is_some_and(|result| result.is_err()) {
                newton = None;
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

    fn newton_steps(
        &self,
        newton: &mut Newton,
        embedding: &mut PartialEmbedding,
        map: &mut InterSurfaceMap,
        shapes: &RestShapes,
    ) -> Result<(), NewtonError> {
        let energy = InterSurfaceEnergy::new(map, shapes);
        let options = NewtonOptions {
            most_iterations: NEWTON_STEPS,
            tolerance: 1e-4,
        };
        newton.minimise(&energy, &mut embedding.directions, &options, self.goes_on)?;
        map.locate(embedding);
        Ok(())
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
    let mut choices: Vec<(Option<EmbeddingCandidate>, [usize; 2])> = all.map(|choice| (None, choice)).collect();
    let mut energies = vec![f64::INFINITY; soft_targets.len()];
    for &size in sizes {
        let embed = |(candidate, [a, s]): (Option<EmbeddingCandidate>, [usize; 2])| {
            let (soft_targets, schedule) = (&soft_targets[a], &schedules[s]);
            let refined = match candidate {
                Some(candidate) => embedder.refine(candidate, soft_targets, schedule, size, &|_, _| ()),
                None => embedder.coarse(soft_targets, schedule, size),
            };
            let mut refined = refined?;
            // A small surface has all its vertices before the schedule comes to minimising the distortion.
            if !refined.energy.is_finite() {
                embedder.finish(&mut refined);
            }
            Some((Some(refined), [a, s]))
        };
        choices = choices.into_par_iter().filter_map(embed).collect();
        choices.sort_by(|a, b| {
            let (a, b) = (rating(&a.0), rating(&b.0));
            a.0.cmp(&b.0).then(a.1.total_cmp(&b.1))
        });
        let best = rating(&choices.first()?.0);
        for (candidate, [a, _]) in choices.iter().rev() {
            energies[*a] = rating(candidate).1;
        }
        let mut kept = vec![0; soft_targets.len()];
        choices.retain(|(candidate, [a, _])| {
            let (missed, energy) = rating(candidate);
            kept[*a] += 1;
            kept[*a] <= KEPT && missed == best.0 && energy <= MOST_ENERGY_RATIO * best.1
        });
    }
    let (candidate, choice) = choices.into_iter().next()?;
    Some((candidate?, choice, energies))
}

/// Number of missed pins, and the energy: the order of candidates, best first.
fn rating(candidate: &Option<EmbeddingCandidate>) -> (usize, f64) {
    candidate.as_ref().map_or((usize::MAX, f64::INFINITY), |candidate| {
        (candidate.pinned.iter().filter(|&&is| !is).count(), candidate.energy)
    })
}

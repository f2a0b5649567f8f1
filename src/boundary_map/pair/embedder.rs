//! Embeds the domain on the target's sphere, pulled towards soft targets, and lowers the distortion of the map between
//! the surfaces.
//!
//! Coarse to fine, as Schmidt, Pieper, Kobbelt, *Surface maps via adaptive triangulations*, 2023: on a coarse level
//! long moves are cheap, and every level starts from the solution of a coarser one.

use std::collections::BTreeMap;

use super::PairPhase;
use super::drag::drag;
use super::inter_surface::{InterSurfaceEnergy, InterSurfaceMap, InverseEmbedding, Spring};
use super::isometry::{IntrinsicShapes, Quality};
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
    /// Number of embedded vertices from which landmarks are met. Before, springs pull them, which can give way: a coarse
    /// embedding that meets them may turn about a limb between two of them, and would keep that turn.
    pub landmarks_from: usize,
}

/// When to stop alternating between Newton's method and relaxation.
struct AlternationLimits {
    most_rounds: usize,
    /// Relative decrease of the energy in a round below which it is the last.
    least_decrease: f64,
}

/// A vertex that must go to a direction.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Pin {
    pub vertex: u32,
    pub to: Vector,
    /// Square of the target's [length ratio](InverseEmbedding::length_ratio) at `to`: the weight of a spring whose energy is
    /// the squared distance on the target.
    pub metric: f64,
}

/// Landmarks: vertices that must go to given directions.
pub(crate) struct Pins {
    pins: Vec<Pin>,
    /// Index of each vertex's pin.
    of_vertex: Vec<Option<usize>>,
}

/// An embedding of the domain, perhaps still coarse, with its quality.
#[derive(Clone)]
pub(crate) struct EmbeddingCandidate {
    pub embedding: PartialEmbedding,
    /// Which of the pins are met.
    pub pinned: Vec<bool>,
    /// Mean symmetric Dirichlet energy of the map to the target, 1 for an isometry and [`MOST_COMPARED`] at most in any
    /// triangle, with that of springs of pins that are not met. Infinite while it has only been pulled to soft targets.
    pub energy: f64,
}

/// Embeds a domain on the sphere of a target.
pub(crate) struct DomainEmbedder<'a> {
    pub domain: &'a SurfaceMesh,
    pub hierarchy: Hierarchy,
    pub inverse: &'a InverseEmbedding<'a>,
    /// By which maps are compared, beside their energy.
    pub shapes: Option<&'a IntrinsicShapes>,
    pub pins: Pins,
    /// Springs of vertices that are never released: soft landmarks.
    pub springs: BTreeMap<u32, Spring>,
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
/// The same at the end, where rounds are many and a bent triangle costs as much as ten others.
const LAST_LOCAL_RELAXATIONS: usize = 3;
/// Newton's method and relaxation alternate: Newton's method moves all vertices together, but only until the first
/// triangle would invert; relaxation moves the vertices of such triangles away.
const NEWTON: NewtonOptions = NewtonOptions {
    most_iterations: 5,
    tolerance: 1e-4,
};
/// Limits while dozens of embeddings are compared.
const CROWDED: AlternationLimits = AlternationLimits {
    most_rounds: 3,
    least_decrease: 1e-3,
};
const CROWDED_VERTICES: usize = 450;
/// Limits on the levels after that. What is not brought in order here stays: of a cat's map to a horse, with 3 rounds on each of
/// these levels and 2 on the fine ones, a strip of the tail covered most of the other one, and 10 rounds at the end did not change it.
const COARSE: AlternationLimits = AlternationLimits {
    most_rounds: 20,
    least_decrease: 3e-3,
};
/// The same on fine levels, where the last rounds follow soon.
const FINE: AlternationLimits = AlternationLimits {
    most_rounds: 20,
    least_decrease: 1e-2,
};
const FINE_VERTICES: usize = 3000;
/// Limits for embeddings that have only been pulled to soft targets. Those that go on meet more landmarks later for it.
const SETTLING: AlternationLimits = AlternationLimits {
    most_rounds: 15,
    least_decrease: 1e-4,
};
/// Limits at the end.
const LAST: AlternationLimits = AlternationLimits {
    most_rounds: 40,
    least_decrease: 5e-3,
};
/// The most energy of a triangle, over that of an isometry, when embeddings are compared: a few triangles that are nearly
/// degenerate, here and there, would decide otherwise.
const MOST_COMPARED: f64 = 25.0;
/// Vertices for each landmark that coarse embeddings have more, while soft targets pull, and when landmarks are met late.
const PULLED_PER_LANDMARK: usize = 3;
pub(super) const LATE_PER_LANDMARK: usize = 4;
/// Weight of an unmet pin, over that of a soft target.
const PIN_WEIGHT: f64 = 30.0;
/// Energy of the spring of a pin at unit distance on the target, whose area is 4π: first, and from round to round while
/// pins are being met.
const PIN_STIFFNESS: f64 = 10.0;
const STIFFENING: f64 = 4.0;
/// Rounds of meeting pins on a level.
const MOST_PIN_ROUNDS: usize = 8;
/// Steps in which a pin is dragged, the radius within which vertices go with it at most, and rounds of relaxation of these after
/// each step.
const MOST_DRAGS: usize = 40;
const MOST_DRAGGED: f64 = 0.5;
const DRAG_SWEEPS: usize = 3;
/// Limits while pins are being met.
const MEETING: AlternationLimits = AlternationLimits {
    most_rounds: 1,
    least_decrease: 1e-3,
};

impl SoftTargetSchedule {
    /// The schedule for this many landmarks. They are inserted first: coarse embeddings of little else hardly depend on where
    /// they start from, and leave no room to meet landmarks.
    pub(super) fn for_landmarks(self, landmarks: usize) -> Self {
        let until_vertices = self.until_vertices + PULLED_PER_LANDMARK * landmarks;
        let landmarks_from = match self.landmarks_from {
            0 => PULLED_PER_LANDMARK * landmarks,
            late => late + LATE_PER_LANDMARK * landmarks,
        };
        Self {
            until_vertices,
            landmarks_from,
            ..self
        }
    }

    pub(super) const fn new(strength: f64, until_vertices: usize) -> Self {
        Self {
            strength,
            until_vertices,
            landmarks_from: 0,
        }
    }

    /// With landmarks met from this number of vertices on.
    pub(super) const fn with_landmarks_from(self, landmarks_from: usize) -> Self {
        Self { landmarks_from, ..self }
    }
}

impl Pin {
    fn spring(&self, stiffness: f64) -> Spring {
        Spring {
            to: self.to,
            weight: stiffness * self.metric,
        }
    }
}

impl Pins {
    /// Pins of distinct vertices below `vertices`.
    pub fn new(pins: Vec<Pin>, vertices: usize) -> Self {
        let mut of_vertex = vec![None; vertices];
        for (i, pin) in pins.iter().enumerate() {
            of_vertex[pin.vertex as usize] = Some(i);
        }
        Self { pins, of_vertex }
    }

    /// How many there are.
    pub fn len(&self) -> usize {
        self.pins.len()
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
}

impl DomainEmbedder<'_> {
    /// The most rounds of [`Self::finish`].
    pub const MOST_ROUNDS: usize = LAST.most_rounds;

    /// The tetrahedron at the coarsest level of the hierarchy, rotated towards its soft targets.
    pub fn tetrahedron(&self, soft_targets: &SoftTargets) -> EmbeddingCandidate {
        let target = |v: u32| match self.pins.of(v) {
            Some(i) => Some(self.pins.pins[i].to),
            None => soft_targets[v as usize].map(|target| target.0),
        };
        EmbeddingCandidate {
            embedding: PartialEmbedding::of_base(&self.hierarchy, target),
            pinned: vec![false; self.pins.pins.len()],
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
            landmarks_from: 0,
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
            let vertices = embedding.inserted.len();
            let meets = vertices >= schedule.landmarks_from || vertices == self.domain.vertices().len();
            if vertices < schedule.until_vertices {
                self.pull(embedding, pinned, soft_targets, schedule.strength, meets);
                return;
            }
            map.locate(embedding);
            map.springs = self.springs_of_unmet(pinned, PIN_STIFFNESS);
            let limits = match vertices {
                ..CROWDED_VERTICES => &CROWDED,
                CROWDED_VERTICES..FINE_VERTICES => &COARSE,
                _ => &FINE,
            };
            *energy = self.improve(embedding, &mut map, pinned, limits, &|_| ());
            if meets {
                *energy = self.meet_pins(embedding, &mut map, pinned, *energy, false);
            }
            *energy = map.mean_energy(embedding, MOST_COMPARED);
            progress(vertices, *energy);
        })?;
        Some(candidate)
    }

    /// A given embedding of all vertices. Pins are moved to their directions as far as no triangle inverts.
    pub fn candidate_at(&self, directions: &[Vector]) -> EmbeddingCandidate {
        let mut candidate = EmbeddingCandidate {
            embedding: PartialEmbedding::complete(self.domain, directions),
            pinned: vec![false; self.pins.pins.len()],
            energy: f64::INFINITY,
        };
        let mut map = InterSurfaceMap::new(self.inverse, self.domain);
        map.locate(&candidate.embedding);
        candidate.energy = self.meet_pins(
            &mut candidate.embedding,
            &mut map,
            &mut candidate.pinned,
            f64::INFINITY,
            true,
        );
        candidate
    }

    /// How far the map of an embedding is from an isometry; `None` where the surfaces have no intrinsic shapes.
    pub fn isometry_defect(&self, embedding: &PartialEmbedding) -> Option<f64> {
        self.shapes?.defect(embedding, self.domain, self.inverse)
    }

    /// What an embedding is compared by. Where springs pull, by their energy and that of the map alone: what was asked for may be
    /// far from an isometry, and of symmetric bodies eigenfunctions do not tell isometries from other maps.
    pub fn quality(&self, candidate: &EmbeddingCandidate) -> Quality {
        Quality {
            energy: candidate.energy,
            isometry_defect: match self.springs.is_empty() {
                true => self.isometry_defect(&candidate.embedding),
                false => None,
            },
        }
    }

    /// The share of the domain's area where triangles have more energy than counts when embeddings are compared.
    pub fn share_out_of_order(&self, candidate: &EmbeddingCandidate) -> f64 {
        self.measuring(&candidate.embedding)
            .share_above(&candidate.embedding, MOST_COMPARED)
    }

    /// The energy of an embedding of all vertices.
    pub fn energy_of(&self, embedding: &PartialEmbedding) -> f64 {
        self.measuring(embedding).mean_energy(embedding, MOST_COMPARED)
    }

    /// The map of an embedding of all vertices, as it is measured.
    fn measuring(&self, embedding: &PartialEmbedding) -> InterSurfaceMap<'_> {
        let mut map = InterSurfaceMap::new(self.inverse, self.domain);
        map.locate(embedding);
        map.finds_bent = true;
        map.find_protrusions(embedding);
        map
    }

    /// Lowers the distortion of the map of an embedding that has only been pulled to soft targets, so that it can be compared.
    pub fn settle(&self, candidate: &mut EmbeddingCandidate) {
        let EmbeddingCandidate {
            embedding,
            pinned,
            energy,
        } = candidate;
        let mut map = InterSurfaceMap::new(self.inverse, self.domain);
        map.locate(embedding);
        map.springs = self.springs_of_unmet(pinned, PIN_STIFFNESS);
        self.meet_pins(embedding, &mut map, pinned, f64::INFINITY, true);
        self.improve(embedding, &mut map, pinned, &SETTLING, &|_| ());
        *energy = map.mean_energy(embedding, MOST_COMPARED);
    }

    /// Lowers the distortion of the map until it has converged. `progress` gets the number of rounds so far.
    pub fn finish(&self, candidate: &mut EmbeddingCandidate, progress: &dyn Fn(usize)) {
        let EmbeddingCandidate {
            embedding,
            pinned,
            energy,
        } = candidate;
        let mut map = InterSurfaceMap::new(self.inverse, self.domain);
        map.locate(embedding);
        map.springs = self.springs_of_unmet(pinned, PIN_STIFFNESS);
        *energy = self.meet_pins(embedding, &mut map, pinned, *energy, true);
        // On coarse levels nearly all triangles bend, and limbs do not find their places.
        map.finds_bent = true;
        self.improve(embedding, &mut map, pinned, &LAST, progress);
        *energy = map.mean_energy(embedding, MOST_COMPARED);
    }

    /// The springs that are never released, and one of this stiffness for each pin that is not met.
    fn springs_of_unmet(&self, pinned: &[bool], stiffness: f64) -> BTreeMap<u32, Spring> {
        let mut springs = self.springs.clone();
        let unmet = self.pins.pins.iter().zip(pinned).filter(|(_, is_met)| !**is_met);
        springs.extend(unmet.map(|(pin, _)| (pin.vertex, pin.spring(stiffness))));
        springs
    }

    /// Meets the pins, with springs that become stiffer until no triangle is in the way: a penalty method. Returns the
    /// energy, which is `energy` when all were met before. The springs that are left are those never released.
    ///
    /// With `releases`, pins that were met give way again if some cannot be met between them, and those that are missed even then are
    /// [dragged](drag) to their places.
    fn meet_pins(
        &self,
        embedding: &mut PartialEmbedding,
        map: &mut InterSurfaceMap,
        pinned: &mut [bool],
        mut energy: f64,
        releases: bool,
    ) -> f64 {
        let rounds = if releases { 2 * MOST_PIN_ROUNDS } else { MOST_PIN_ROUNDS };
        let mut stiffness = PIN_STIFFNESS;
        let mut before_release = None;
        for round in 0..rounds {
            self.move_pins(embedding, pinned);
            map.locate(embedding);
            if pinned.iter().all(|&is| is) || !self.reporter.should_continue() {
                break;
            }
            stiffness *= STIFFENING;
            if round == MOST_PIN_ROUNDS {
                before_release = Some((embedding.clone(), pinned.to_vec(), energy));
                pinned.fill(false);
                stiffness = PIN_STIFFNESS;
            }
            map.springs = self.springs_of_unmet(pinned, stiffness);
            energy = self.improve(embedding, map, pinned, &MEETING, &|_| ());
        }
        self.move_pins(embedding, pinned);
        if releases {
            self.drag_pins(embedding, map, pinned);
        }
        let missed = |pinned: &[bool]| pinned.iter().filter(|is| !**is).count();
        if let Some((before, were_pinned, energy_before)) = before_release
            && missed(&were_pinned) <= missed(pinned)
        {
            (*embedding, energy) = (before, energy_before);
            pinned.copy_from_slice(&were_pinned);
        }
        map.locate(embedding);
        map.springs = self.springs.clone();
        energy
    }

    /// Relaxation towards the soft targets and the unmet pins; `meets` them where no triangle is in the way.
    fn pull(
        &self,
        embedding: &mut PartialEmbedding,
        pinned: &mut [bool],
        soft_targets: &SoftTargets,
        strength: f64,
        meets: bool,
    ) {
        let weight = strength * 4.0 * std::f64::consts::PI / embedding.inserted.len() as f64;
        let of_landmark = PIN_WEIGHT * weight.max(0.1);
        for _ in 0..SOFT_TARGET_SWEEPS / 4 {
            if meets {
                self.move_pins(embedding, pinned);
            }
            let soft_target = |v: u32| match (self.pins.of(v), self.springs.get(&v)) {
                (Some(i), _) => Some((self.pins.pins[i].to, of_landmark)),
                (_, Some(spring)) => Some((spring.to, of_landmark)),
                _ => soft_targets[v as usize].map(|(to, trust)| (to, trust * weight)),
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
        if meets {
            self.move_pins(embedding, pinned);
        }
    }

    /// Drags pins that are missed to their directions, with what lies around them as far as the nearest pin that is met.
    fn drag_pins(&self, embedding: &mut PartialEmbedding, map: &mut InterSurfaceMap, pinned: &mut [bool]) {
        for i in 0..pinned.len() {
            let Pin { vertex, to, .. } = self.pins.pins[i];
            let is_inserted = !embedding.rings.of(vertex).is_empty();
            for _ in 0..MOST_DRAGS {
                if pinned[i] || !is_inserted || !self.reporter.should_continue() {
                    break;
                }
                let x = embedding.directions[vertex as usize];
                let met = self.pins.pins.iter().zip(&*pinned).filter(|(_, is_met)| **is_met);
                let radius = met.map(|(pin, _)| (pin.to - x).norm()).fold(MOST_DRAGGED, f64::min);
                let Some(dragged) = drag(embedding, vertex, &to, radius) else {
                    break;
                };
                pinned[i] = dragged.arrived;
                map.locate(embedding);
                let is_fixed = |v: u32| v == vertex || self.pins.of(v).is_some_and(|i| pinned[i]);
                for _ in 0..DRAG_SWEEPS {
                    map.sweep(embedding, &dragged.moved, &is_fixed);
                }
            }
        }
    }

    /// Moves pins to their directions where all their triangles stay positive.
    fn move_pins(&self, embedding: &mut PartialEmbedding, pinned: &mut [bool]) {
        for (i, &Pin { vertex, to, .. }) in self.pins.pins.iter().enumerate() {
            let is_inserted = !embedding.rings.of(vertex).is_empty();
            if is_inserted && !pinned[i] && embedding.stays_positive(vertex, &to) {
                embedding.directions[vertex as usize] = to;
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
        let mesh = embedding.inserted_mesh();
        let shapes = RestShapes::new(&mesh.triangles, &mesh.of(self.domain.vertices()));
        let fixed: Vec<u32> = (0..mesh.vertices.len() as u32)
            .filter(|&i| is_fixed(mesh.vertices[i as usize]))
            .collect();
        let mut newton = Newton::new(&mesh.triangles, &fixed).ok();
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
                let energy = InterSurfaceEnergy::new(map, &mesh, &shapes);
                let should_continue = || self.reporter.should_improve();
                let mut directions = mesh.of(&embedding.directions);
                match solver.minimise(&energy, &mut directions, &NEWTON, &should_continue) {
                    Ok(_) => {
                        for (&v, x) in mesh.vertices.iter().zip(directions) {
                            embedding.directions[v as usize] = x;
                        }
                        map.locate(embedding);
                    }
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
        let most = match map.finds_bent {
            true => LAST_LOCAL_RELAXATIONS,
            false => MOST_LOCAL_RELAXATIONS,
        };
        for _ in 0..most {
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

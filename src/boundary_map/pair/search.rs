//! The search for the best coarse embedding: from every start with every schedule, by successive halving.
//!
//! Energies of embeddings with a few hundred vertices tell the starts apart already (of 64 embeddings of two pairs, the
//! order of the starts with 400 vertices was that with 4000), at a tenth of the cost. So all are compared there, and only
//! the best of them get more vertices.

use std::sync::atomic::{AtomicUsize, Ordering};

use rayon::prelude::*;

use super::embedder::{DomainEmbedder, EmbeddingCandidate, LATE_PER_LANDMARK, SoftTargetSchedule, SoftTargets};
use super::inter_surface::InverseEmbedding;
use super::isometry::Quality;
use super::report::PairPhase;

/// A number of vertices at which embeddings are compared, and which of them get more.
pub(crate) struct SearchStep {
    pub vertices: usize,
    /// Most embeddings that continue, of those with nearly the same map, and of all.
    pub most_alike: usize,
    pub most: usize,
    /// Those continue whose rating is at most this times the least.
    pub most_ratio: f64,
}

impl SearchStep {
    pub const fn new(vertices: usize, most_alike: usize, most: usize, most_ratio: f64) -> Self {
        Self {
            vertices,
            most_alike,
            most,
            most_ratio,
        }
    }

    /// The step with more vertices for each of so many landmarks.
    pub fn for_landmarks(self, landmarks: usize) -> Self {
        let more = match self.vertices {
            ..400 => 1,
            400..1600 => 2,
            _ => LATE_PER_LANDMARK,
        };
        Self {
            vertices: self.vertices + more * landmarks,
            ..self
        }
    }
}

/// Schedules to compare: which one ends best differs from pair to pair.
pub(crate) struct Schedules {
    /// For every start.
    pub of_all: Vec<SoftTargetSchedule>,
    /// More for the starts that led to the best embeddings.
    pub of_best: Vec<SoftTargetSchedule>,
}

impl Schedules {
    /// The same for every start, and no more.
    pub fn of_all(schedules: &[SoftTargetSchedule]) -> Self {
        Self {
            of_all: schedules.to_vec(),
            of_best: vec![],
        }
    }

    /// The most vertices that an embedding has while soft targets pull.
    pub fn most_pulled(&self) -> usize {
        let all = self.of_all.iter().chain(&self.of_best);
        all.map(|schedule| schedule.until_vertices).max().unwrap_or(0)
    }
}

/// Starts that more schedules are tried with.
const BEST_STARTS: usize = 3;

/// An embedding with what it came from.
#[derive(Clone)]
pub(crate) struct RankedEmbedding {
    pub candidate: EmbeddingCandidate,
    /// Index of its start.
    pub start: usize,
    pub schedule: SoftTargetSchedule,
    /// How good it was at each of the steps that it took part in.
    pub qualities: Vec<Quality>,
}

/// Maps are alike when their images of vertices are this close in the mean, as a fraction of the target's diagonal.
pub(super) const ALIKE: f64 = 0.03;
/// Embeddings that continue where all miss landmarks.
pub(super) const MOST_WHERE_MISSED: usize = 4;
/// Embeddings are the same when their energies and images differ by no more than this fraction.
const ROUNDING: f64 = 1e-9;

impl RankedEmbedding {
    /// The mean distance of the images of the vertices that both have.
    pub fn distance(&self, other: &Self, inverse: &InverseEmbedding) -> f64 {
        let embeddings = [self, other].map(|ranked| &ranked.candidate.embedding);
        let common = embeddings
            .map(|embedding| embedding.inserted.len())
            .into_iter()
            .min()
            .unwrap_or(0);
        let apart = |&v: &u32| {
            let [a, b] = embeddings.map(|embedding| inverse.position(&embedding.directions[v as usize]));
            (a - b).norm()
        };
        let inserted = &self.candidate.embedding.inserted[..common];
        inserted.iter().map(apart).sum::<f64>() / common as f64
    }

    /// What it was compared by last.
    pub fn rating(&self) -> f64 {
        self.qualities.last().map_or(f64::INFINITY, Quality::rating)
    }

    /// The last qualities of this one and of another when both had as many vertices.
    pub fn compared(&self, other: &Self) -> Option<[Quality; 2]> {
        let mut common = self.qualities.iter().zip(&other.qualities);
        common.next_back().map(|(own, other)| [*own, *other])
    }
}

/// The best embedding that each start led to, the best first: that has at least as many vertices as the last step, the others
/// as many as it took to see that they are worse, or the same map. With the number of embeddings that were compared.
pub(crate) fn best_of_starts(
    embedder: &DomainEmbedder,
    starts: &[&SoftTargets],
    schedules: &Schedules,
    steps: &[SearchStep],
) -> (Vec<RankedEmbedding>, usize) {
    let begun = |start: usize, schedules: &[SoftTargetSchedule]| -> Vec<RankedEmbedding> {
        let of_schedule = |&schedule: &SoftTargetSchedule| RankedEmbedding {
            candidate: embedder.tetrahedron(starts[start]),
            start,
            schedule,
            qualities: vec![],
        };
        schedules.iter().map(of_schedule).collect()
    };
    let mut ranked: Vec<RankedEmbedding> = (0..starts.len())
        .flat_map(|start| begun(start, &schedules.of_all))
        .collect();
    let mut compared = ranked.len();
    let diagonal = embedder.inverse.diagonal();
    let mut given_up: Vec<RankedEmbedding> = Vec::new();
    for (number, step) in steps.iter().enumerate() {
        ranked = refined(embedder, starts, ranked, step.vertices);
        // Before landmarks are met, their springs are part of the energy.
        let counts_missed = ranked.iter().all(|r| step.vertices >= r.schedule.landmarks_from);
        let rating = |r: &RankedEmbedding| (r.candidate.missed().len() * usize::from(counts_missed), r.rating());
        let sort = |ranked: &mut Vec<RankedEmbedding>| {
            ranked.sort_by(|a, b| {
                let (a, b) = (rating(a), rating(b));
                a.0.cmp(&b.0).then(a.1.total_cmp(&b.1))
            });
        };
        sort(&mut ranked);
        given_up.extend(take_copies(&mut ranked, embedder.inverse));
        if number == 0 && !schedules.of_best.is_empty() && !embedder.reporter.should_conclude() {
            let of_best: Vec<RankedEmbedding> = best_starts(&ranked)
                .flat_map(|start| begun(start, &schedules.of_best))
                .collect();
            compared += of_best.len();
            ranked.extend(refined(embedder, starts, of_best, step.vertices));
            sort(&mut ranked);
            given_up.extend(take_copies(&mut ranked, embedder.inverse));
        }
        let Some(best) = ranked.first().map(rating) else { break };
        let mut kept: Vec<RankedEmbedding> = Vec::new();
        // Meeting landmarks early costs energy, but late they may be out of reach, and those that are met stay met.
        let safest = match counts_missed {
            true => None,
            false => safest(&ranked, step.vertices).map(|i| ranked.remove(i)),
        };
        for embedding in std::mem::take(&mut ranked) {
            let alike = kept
                .iter()
                .filter(|other| embedding.distance(other, embedder.inverse) < ALIKE * diagonal);
            let (missed, rated) = rating(&embedding);
            let is_good = missed == best.0 && rated <= step.most_ratio * best.1;
            // Which one will meet the landmarks that are missed is not known yet.
            let (is_good, most, most_alike) = match best.0 {
                0 => (is_good, step.most, step.most_alike),
                _ => (true, step.most.max(MOST_WHERE_MISSED), MOST_WHERE_MISSED),
            };
            if kept.len() < most && is_good && alike.count() < most_alike {
                kept.push(embedding);
            } else {
                given_up.push(embedding);
            }
        }
        kept.extend(safest);
        ranked = kept;
        if embedder.reporter.should_conclude() {
            break;
        }
    }
    // Those that were given up last came farthest.
    ranked.extend(given_up.into_iter().rev());
    let mut is_first = vec![true; starts.len()];
    ranked.retain(|embedding| std::mem::replace(&mut is_first[embedding.start], false));
    (ranked, compared)
}

/// The starts of the best embeddings, in their order.
fn best_starts(ranked: &[RankedEmbedding]) -> impl Iterator<Item = usize> {
    let mut starts: Vec<usize> = Vec::new();
    for embedding in ranked {
        if starts.len() < BEST_STARTS && !starts.contains(&embedding.start) {
            starts.push(embedding.start);
        }
    }
    starts.into_iter()
}

/// Takes out embeddings that another start or schedule led to already: they would take the place of others.
fn take_copies(ranked: &mut Vec<RankedEmbedding>, inverse: &InverseEmbedding) -> Vec<RankedEmbedding> {
    let (mut own, mut copies): (Vec<RankedEmbedding>, Vec<RankedEmbedding>) = (Vec::new(), Vec::new());
    for embedding in std::mem::take(ranked) {
        let energy = embedding.candidate.energy;
        let equals = |other: &RankedEmbedding| {
            (other.candidate.energy - energy).abs() <= ROUNDING * energy
                && embedding.distance(other, inverse) <= ROUNDING * inverse.diagonal()
        };
        match own.iter().any(equals) {
            true => copies.push(embedding),
            false => own.push(embedding),
        }
    }
    *ranked = own;
    copies
}

/// The embedding that misses the fewest landmarks of those whose schedules meet them with so many vertices; the best of them.
/// Their order is by energy.
fn safest(ranked: &[RankedEmbedding], vertices: usize) -> Option<usize> {
    let meets = |i: &usize| ranked[*i].schedule.landmarks_from <= vertices;
    (0..ranked.len())
        .filter(meets)
        .min_by_key(|&i| ranked[i].candidate.missed().len())
}

/// All embeddings with at least so many vertices, but those for which rounding leaves no place.
fn refined(
    embedder: &DomainEmbedder,
    starts: &[&SoftTargets],
    ranked: Vec<RankedEmbedding>,
    vertices: usize,
) -> Vec<RankedEmbedding> {
    let (done, of) = (AtomicUsize::new(0), ranked.len());
    let refine = |mut ranked: RankedEmbedding| {
        let RankedEmbedding { start, schedule, .. } = ranked;
        let mut candidate = embedder.refine(ranked.candidate, starts[start], &schedule, vertices, &|_, _| ())?;
        // Soft targets still pull, or a small surface has all its vertices before its schedule starts to minimise the distortion.
        if !candidate.energy.is_finite() {
            embedder.settle(&mut candidate);
        }
        ranked.qualities.push(embedder.quality(&candidate));
        let done = done.fetch_add(1, Ordering::Relaxed) + 1;
        // A cancellation takes effect in the refinements.
        let _ = embedder
            .reporter
            .send(PairPhase::CoarseEmbeddings { vertices, done, of });
        Some(RankedEmbedding { candidate, ..ranked })
    };
    ranked.into_par_iter().filter_map(refine).collect()
}

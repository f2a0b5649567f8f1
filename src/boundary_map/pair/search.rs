//! The search for the best coarse embedding: from every start with every schedule, by successive halving.
//!
//! Energies of embeddings with a few hundred vertices tell the starts apart already (of 64 embeddings of two pairs, the
//! order of the starts with 400 vertices was that with 4000), at a tenth of the cost. So all are compared there, and only
//! the best of them get more vertices.

use std::sync::atomic::{AtomicUsize, Ordering};

use rayon::prelude::*;

use super::embedder::{DomainEmbedder, EmbeddingCandidate, SoftTargetSchedule, SoftTargets};
use super::report::PairPhase;

/// A number of vertices at which embeddings are compared, and which of them get more.
pub(crate) struct SearchStep {
    pub vertices: usize,
    /// Most embeddings that continue, of each start and of all.
    pub most_of_start: usize,
    pub most: usize,
    /// Those continue whose energy is at most this times the least.
    pub most_energy_ratio: f64,
}

/// An embedding with what it came from.
#[derive(Clone)]
pub(crate) struct RankedEmbedding {
    pub candidate: EmbeddingCandidate,
    /// Index of its start.
    pub start: usize,
    pub schedule: SoftTargetSchedule,
}

/// The best embedding that each start led to, the best first: that has at least as many vertices as the last step, the others
/// as many as it took to see that they are worse.
pub(crate) fn best_of_starts(
    embedder: &DomainEmbedder,
    starts: &[&SoftTargets],
    schedules: &[SoftTargetSchedule],
    steps: &[SearchStep],
) -> Vec<RankedEmbedding> {
    let all = (0..starts.len()).flat_map(|start| schedules.iter().map(move |schedule| (start, *schedule)));
    let mut ranked: Vec<RankedEmbedding> = all
        .map(|(start, schedule)| RankedEmbedding {
            candidate: embedder.tetrahedron(starts[start]),
            start,
            schedule,
        })
        .collect();
    let mut given_up: Vec<RankedEmbedding> = Vec::new();
    for step in steps {
        ranked = refined(embedder, starts, ranked, step.vertices);
        // Before landmarks are met, their springs are part of the energy.
        let counts_missed = ranked.iter().all(|r| step.vertices >= r.schedule.landmarks_from);
        let rating = |r: &RankedEmbedding| {
            (
                r.candidate.missed().len() * usize::from(counts_missed),
                r.candidate.energy,
            )
        };
        ranked.sort_by(|a, b| {
            let (a, b) = (rating(a), rating(b));
            a.0.cmp(&b.0).then(a.1.total_cmp(&b.1))
        });
        let Some(best) = ranked.first().map(rating) else { break };
        let mut kept: Vec<RankedEmbedding> = Vec::new();
        for embedding in std::mem::take(&mut ranked) {
            let of_start = kept.iter().filter(|other| other.start == embedding.start).count();
            let (missed, energy) = rating(&embedding);
            let is_good = missed == best.0 && energy <= step.most_energy_ratio * best.1;
            if kept.len() < step.most && of_start < step.most_of_start && is_good {
                kept.push(embedding);
            } else if of_start == 0 && given_up.iter().all(|other| other.start != embedding.start) {
                given_up.push(embedding);
            }
        }
        // A start that continues is not given up.
        given_up.retain(|other| kept.iter().all(|embedding| embedding.start != other.start));
        ranked = kept;
        if embedder.reporter.should_conclude() {
            break;
        }
    }
    given_up.sort_by(|a, b| a.candidate.energy.total_cmp(&b.candidate.energy));
    let mut best: Vec<RankedEmbedding> = Vec::new();
    for embedding in ranked.into_iter().chain(given_up) {
        if best.iter().all(|other| other.start != embedding.start) {
            best.push(embedding);
        }
    }
    best
}

/// All embeddings with at least so many vertices, but those for which rounding leaves no place.
fn refined(
    embedder: &DomainEmbedder,
    starts: &[&SoftTargets],
    ranked: Vec<RankedEmbedding>,
    vertices: usize,
) -> Vec<RankedEmbedding> {
    let (done, of) = (AtomicUsize::new(0), ranked.len());
    let refine = |RankedEmbedding {
                      candidate,
                      start,
                      schedule,
                  }: RankedEmbedding| {
        let mut candidate = embedder.refine(candidate, starts[start], &schedule, vertices, &|_, _| ())?;
        // A small surface has all its vertices before its schedule starts to minimise the distortion.
        if !candidate.energy.is_finite() {
            embedder.finish(&mut candidate, &|_| ());
        }
        let done = done.fetch_add(1, Ordering::Relaxed) + 1;
        // A cancellation takes effect in the refinements.
        let _ = embedder
            .reporter
            .send(PairPhase::CoarseEmbeddings { vertices, done, of });
        Some(RankedEmbedding {
            candidate,
            start,
            schedule,
        })
    };
    ranked.into_par_iter().filter_map(refine).collect()
}

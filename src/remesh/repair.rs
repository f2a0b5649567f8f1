//! Turns inverted cells back by moving inner nodes, the boundary fixed, and then polishes their shapes.

use super::descent::{Descent, Limits};
use super::foldover::Samples;
use super::quality::{is_positive, lesser};
use crate::Point;

/// Least ε², and share of the least determinant that ε takes.
const FLOOR: f64 = 1e-6;
const SHARE: f64 = 0.2;
/// Fall of ε from one round to the next, at least.
const FALL: f64 = 0.7;
const ROUND: Limits = Limits {
    iterations: 300,
    gain: 3e-5,
    until_positive: true,
};
/// Rounds without fewer inverted samples after which it is given up.
const STALLED: usize = 10;
const MOST_ROUNDS: usize = 100;
/// ε of the polish: a step that inverts a sample costs more than any gain.
const POLISH_EPSILON: f64 = 1e-9;

/// Fall of the energy over some iterations, as a fraction, below which shapes are as good as they get.
const POLISH_GAIN: f64 = 1e-6;

/// What a repair did.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize)]
pub struct RepairReport {
    /// Rounds of falling ε.
    pub rounds: usize,
    /// Iterations of descent in all rounds.
    pub iterations: usize,
    /// Iterations of the polish.
    pub polish_iterations: usize,
}

/// Moves the nodes `free` until all samples have positive determinants, or as few are inverted as can be reached, and
/// polishes them if there are none.
pub(super) fn repair(
    samples: &Samples,
    x: &mut Vec<Point>,
    free: &[u32],
    step: f64,
    polish: usize,
    progress: &dyn Fn(usize, usize),
) -> RepairReport {
    let mut report = RepairReport::default();
    if free.is_empty() {
        return report;
    }
    let mut descent = Descent::new(samples, free, step);
    let start = samples.determinants(x);
    let mut least = start.iter().copied().fold(f64::INFINITY, lesser);
    let mut inverted = start.iter().filter(|d| !is_positive(**d)).count();
    let mut best = (inverted, x.clone());
    let mut epsilon = 1.0;
    let mut stalled = 0;
    while inverted > 0 && stalled < STALLED && report.rounds < MOST_ROUNDS {
        if report.rounds > 0 {
            epsilon = (FALL * epsilon).min((FLOOR + (SHARE * least).powi(2)).sqrt());
        }
        let (value, iterations) = descent.run(x, epsilon, &ROUND);
        report.rounds += 1;
        report.iterations += iterations;
        (least, inverted) = (value.least, value.inverted);
        stalled += 1;
        if inverted < best.0 {
            best = (inverted, x.clone());
            stalled = 0;
        }
        progress(report.rounds, inverted);
        if !value.energy.is_finite() {
            break;
        }
    }
    if best.0 < inverted || !x.iter().flat_map(|p| p.iter()).all(|c| c.is_finite()) {
        *x = best.1;
    }
    if best.0 == 0 {
        let limits = Limits {
            iterations: polish,
            gain: POLISH_GAIN,
            until_positive: false,
        };
        report.polish_iterations = descent.run(x, POLISH_EPSILON, &limits).1;
    }
    report
}

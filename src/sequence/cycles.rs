//! Cycles of a curve of equally spaced values, by autocorrelation.
//!
//! A parabola is subtracted from the curve, so that a slow drift is not taken for a cycle. The rest, `x`, is compared
//! with itself `lag` frames later: `r(lag) = Σ xᵢ xᵢ₊ₗ / √(Σ xᵢ² Σ xᵢ₊ₗ²)` over the frames that have both, 1 where a
//! curve repeats and about `±1/√m` over `m` pairs of frames of noise. The period is the first lag at which `r` has a
//! peak about as high as any.

use nalgebra::{Matrix3, Vector3};

/// Fewest frames that can show a cycle.
const LEAST_FRAMES: usize = 10;
/// Correlation that a period needs: in general, and with fewer than three cycles, where a random walk easily looks
/// periodic.
const LEAST_CORRELATION: f64 = 0.6;
const LEAST_CORRELATION_OF_FEW: f64 = 0.8;
/// Standard deviations of the correlation of noise that a period must exceed. With the number of lags that are tried,
/// noise passes once in some two hundred curves.
const DEVIATIONS: f64 = 3.0;
/// Upper bound on the correlation that is needed, also of short curves: a perfect repetition has 1.
const MOST_NEEDED: f64 = 0.95;
/// The period is the first peak of at least this fraction of the highest: multiples of a period correlate as well as
/// the period.
const AS_HIGH: f64 = 0.85;
/// At multiples of the period, the mean correlation must be at least this fraction of what the period needs.
const LASTING: f64 = 0.8;

/// A period that a curve was found to have.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Cycles {
    /// Frames from one cycle to the next; in general not whole.
    pub period: f64,
    /// Cycles in the curve: its frames over the period.
    pub count: f64,
    /// Correlation of the curve without its drift with itself a period later; 1 when it repeats exactly.
    pub strength: f64,
    /// The first frame, within the first period, at which the curve is lowest on average over the cycles.
    pub first: f64,
}

impl Cycles {
    /// First frames of each whole cycle and of the one after it, for a curve of this many frames. Incomplete cycles at
    /// the ends are left out, to within half a frame; the last frame lasts until the next would begin.
    pub fn spans(&self, frames: usize) -> Vec<[f64; 2]> {
        let last = frames as f64 - 1.0;
        let begins = |k: i32| self.first + f64::from(k) * self.period;
        (-1..)
            .map(|k| [begins(k), begins(k + 1)])
            .take_while(|span| span[0] < last)
            .filter(|span| span[0] >= -0.5 && span[1] <= last + 1.5)
            .collect()
    }

    /// The count rounded to a whole number.
    pub fn whole(&self) -> usize {
        self.count.round() as usize
    }
}

/// Why no cycles were found in a curve.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, thiserror::Error)]
#[serde(rename_all = "snake_case", tag = "reason")]
#[non_exhaustive]
pub enum CycleError {
    /// Too few values.
    #[error("{found} frames are too few to find cycles; at least {needed} are needed")]
    TooFew {
        /// Number of values.
        found: usize,
        /// Values needed.
        needed: usize,
    },
    /// The values are equal but for rounding.
    #[error("all frames have the same energy")]
    Constant,
    /// The curve does not correlate with itself at any lag up to half of its length.
    #[error("the curve does not repeat{}", strongest.map_or(String::new(), |r| format!(" (correlation {r:.2} at best)")))]
    NoRepetition {
        /// The largest correlation at a peak, if there is a peak.
        strongest: Option<f64>,
    },
}

/// The cycles of a curve of one value for each frame, NaN where there is none. At least two cycles are needed, of at
/// least three frames each. Differences up to `resolution` count as rounding.
///
/// A drift is not taken for a cycle, and noise in less than a hundredth of all cases. A random walk may be more often:
/// look at the strength. Costs the square of the number of frames.
///
/// # Errors
///
/// [`CycleError`] when there are none.
pub fn cycles(values: &[f64], resolution: f64) -> Result<Cycles, CycleError> {
    let found = values.iter().filter(|v| v.is_finite()).count();
    if found < LEAST_FRAMES {
        let needed = LEAST_FRAMES;
        return Err(CycleError::TooFew { found, needed });
    }
    let rest = without_drift(values);
    if largest_magnitude(&rest) <= resolution.max(1e-9 * largest_magnitude(values)) {
        return Err(CycleError::Constant);
    }
    // A twentieth more than half, so that the peak of two cycles has a far side.
    let longest = values.len() / 2 + values.len() / 20;
    let correlations: Vec<Correlation> = (0..=longest + 1).map(|lag| Correlation::of(&rest, lag)).collect();
    let peaks = peaks(&correlations, longest);
    let heights = peaks.iter().map(|&lag| correlations[lag].r);
    let highest = heights.fold(f64::NEG_INFINITY, f64::max);
    let strongest = (!peaks.is_empty()).then_some(highest);
    let first_peak = peaks.into_iter().find(|&lag| correlations[lag].r >= AS_HIGH * highest);
    let Some(lag) = first_peak.filter(|_| highest > 0.0) else {
        return Err(CycleError::NoRepetition { strongest });
    };
    let (period, lasting) = refined(&correlations, lag, longest);
    let needed = needed_correlation(values.len() as f64 / period, correlations[lag].pairs);
    if correlations[lag].r < needed || lasting < LASTING * needed {
        return Err(CycleError::NoRepetition { strongest });
    }
    Ok(Cycles {
        period,
        count: values.len() as f64 / period,
        strength: correlations[lag].r,
        first: lowest_phase(&rest, period),
    })
}

fn needed_correlation(count: f64, pairs: usize) -> f64 {
    let least = if count < 2.75 {
        LEAST_CORRELATION_OF_FEW
    } else {
        LEAST_CORRELATION
    };
    (DEVIATIONS / (pairs.max(1) as f64).sqrt()).min(MOST_NEEDED).max(least)
}

fn largest_magnitude(values: &[f64]) -> f64 {
    let finite = values.iter().filter(|v| v.is_finite());
    finite.fold(0.0, |largest: f64, v| largest.max(v.abs()))
}

/// The values minus their least-squares parabola; NaN stays.
fn without_drift(values: &[f64]) -> Vec<f64> {
    let middle = (values.len() - 1) as f64 / 2.0;
    let powers = |i: usize| {
        let t = (i as f64 - middle) / middle.max(1.0);
        Vector3::new(1.0, t, t * t)
    };
    let scale = largest_magnitude(values);
    let (mut normal, mut right) = (Matrix3::zeros(), Vector3::zeros());
    for (i, value) in values.iter().enumerate().filter(|(_, v)| v.is_finite()) {
        let p = powers(i);
        normal += p * p.transpose();
        right += p * (value / scale.max(f64::MIN_POSITIVE));
    }
    let drift = normal
        .cholesky()
        .map_or(Vector3::zeros(), |decomposed| decomposed.solve(&right));
    let rest = |(i, value): (usize, &f64)| value - scale * powers(i).dot(&drift);
    values.iter().enumerate().map(rest).collect()
}

/// How well a curve correlates with itself some frames later.
#[derive(Debug, Clone, Copy)]
struct Correlation {
    r: f64,
    /// Pairs of frames that were compared.
    pairs: usize,
}

impl Correlation {
    fn of(rest: &[f64], lag: usize) -> Self {
        let (mut product, mut squares, mut pairs) = (0.0, [0.0; 2], 0);
        for (a, b) in rest.iter().zip(&rest[lag..]) {
            if a.is_finite() && b.is_finite() {
                product += a * b;
                squares[0] += a * a;
                squares[1] += b * b;
                pairs += 1;
            }
        }
        let size = squares[0].sqrt() * squares[1].sqrt();
        let r = if size > 0.0 { product / size } else { 0.0 };
        Self { r, pairs }
    }
}

/// Lags of peaks with a valley of no positive correlation before them, ascending: at smaller lags the correlation is
/// high just because the curve is smooth.
fn peaks(correlations: &[Correlation], longest: usize) -> Vec<usize> {
    let r = |lag: usize| correlations[lag].r;
    let mut lowest = f64::INFINITY;
    let mut peaks = Vec::new();
    for lag in 2..=longest {
        lowest = lowest.min(r(lag - 1));
        // A cycle of two frames cannot be distinguished from jitter.
        if lag >= 3 && r(lag) >= r(lag - 1) && r(lag) > r(lag + 1) && lowest <= 0.0 {
            peaks.push(lag);
        }
    }
    peaks
}

/// The period between frames, from the peaks at its multiples as far as they go, and the mean correlation at them.
fn refined(correlations: &[Correlation], lag: usize, longest: usize) -> (f64, f64) {
    let mut period = vertex(correlations, lag);
    let (mut sum, mut multiples) = (correlations[lag].r, 1);
    let reach = (0.15 * lag as f64).max(1.0) as usize;
    for multiple in 2..=longest / lag {
        let expected = (multiple as f64 * period).round() as usize;
        let near = expected.saturating_sub(reach).max(1)..=(expected + reach).min(longest);
        let Some(best) = near.max_by(|&a, &b| correlations[a].r.total_cmp(&correlations[b].r)) else {
            break;
        };
        sum += correlations[best].r;
        multiples += 1;
        period = vertex(correlations, best) / multiple as f64;
    }
    (period, sum / f64::from(multiples))
}

/// The lag at which the parabola through a peak and its neighbours is highest.
fn vertex(correlations: &[Correlation], lag: usize) -> f64 {
    let [before, at, after] = [lag - 1, lag, lag + 1].map(|lag| correlations[lag].r);
    let bend = before - 2.0 * at + after;
    let shift = if bend < 0.0 { 0.5 * (before - after) / bend } else { 0.0 };
    lag as f64 + shift.clamp(-0.5, 0.5)
}

/// The frame within the period at which the first harmonic of the curve is lowest.
fn lowest_phase(rest: &[f64], period: f64) -> f64 {
    let turn = std::f64::consts::TAU / period;
    let (mut cosine, mut sine) = (0.0, 0.0);
    for (i, value) in rest.iter().enumerate().filter(|(_, v)| v.is_finite()) {
        cosine += value * (turn * i as f64).cos();
        sine += value * (turn * i as f64).sin();
    }
    let highest = sine.atan2(cosine) / turn;
    (highest + period / 2.0).rem_euclid(period)
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use rand::{Rng, SeedableRng, rngs::StdRng};

    use super::*;

    /// A curve of cycles that rise faster than they fall.
    fn gait(frames: usize, cycles: f64) -> Vec<f64> {
        let at = |i: usize| TAU * cycles * i as f64 / frames as f64;
        (0..frames)
            .map(|i| 2.0 - at(i).cos() + 0.4 * (2.0 * at(i)).sin())
            .collect()
    }

    fn noise(frames: usize, size: f64, seed: u64) -> Vec<f64> {
        let mut random = StdRng::seed_from_u64(seed);
        // The sum of twelve uniform numbers is nearly normal with variance 1.
        let mut normal = || (0..12).map(|_| random.random::<f64>()).sum::<f64>() - 6.0;
        (0..frames).map(|_| size * normal()).collect()
    }

    fn sum(a: &[f64], b: &[f64]) -> Vec<f64> {
        a.iter().zip(b).map(|(a, b)| a + b).collect()
    }

    #[test]
    fn whole_cycles_have_spans_and_incomplete_ones_have_none() {
        let cycles = Cycles {
            period: 10.0,
            count: 2.5,
            strength: 1.0,
            first: 3.0,
        };
        assert_eq!(cycles.spans(25), [[3.0, 13.0], [13.0, 23.0]]);
        assert_eq!(
            cycles.spans(33).len(),
            3,
            "the last frame lasts until the next would begin"
        );
        assert!(cycles.spans(0).is_empty());
    }

    #[test]
    fn whole_and_fractional_numbers_of_cycles_are_found() {
        for frames in [24, 48, 61, 200] {
            // Two short cycles cannot be distinguished from noise.
            for count in [2.0, 3.0, 3.4, 4.0, 6.0].into_iter().skip(usize::from(frames < 30)) {
                let found = cycles(&gait(frames, count), 0.0).unwrap();
                // Subtracting the parabola bends the curve: a few percent of the period.
                assert!((found.count / count - 1.0).abs() < 0.06, "{frames} {count}: {found:?}");
                assert!(found.strength > 0.8);
            }
        }
    }

    #[test]
    fn noise_and_drift_do_not_hide_cycles() {
        for seed in 0..40 {
            let drift: Vec<f64> = (0..48)
                .map(|i| 5.0 * (i as f64 / 48.0) - 3.0 * (i as f64 / 48.0).powi(2))
                .collect();
            // The cycles have a variance of 0.6 about their mean, the noise of 0.04.
            let curve = sum(&sum(&gait(48, 4.0), &drift), &noise(48, 0.2, seed));
            let found = cycles(&curve, 0.0).unwrap();
            assert_eq!(found.whole(), 4, "{found:?}");
        }
    }

    #[test]
    fn the_first_cycle_begins_where_the_curve_is_lowest() {
        let shifted: Vec<f64> = (0..60).map(|i| -(TAU * (i as f64 - 4.0) / 15.0).cos()).collect();
        let found = cycles(&shifted, 0.0).unwrap();
        assert!((found.first - 4.0).abs() < 0.5, "{found:?}");
    }

    #[test]
    fn frames_that_are_missing_do_not_shift_the_count() {
        let mut curve = gait(48, 4.0);
        for missing in [3, 17, 18, 40] {
            curve[missing] = f64::NAN;
        }
        assert!((cycles(&curve, 0.0).unwrap().count - 4.0).abs() < 0.2);
    }

    #[test]
    fn a_curve_that_only_rises_has_no_cycles() {
        for frames in [10, 11, 24, 48, 200] {
            let t = |i: usize| i as f64 / frames as f64;
            let curves: [fn(f64) -> f64; 5] = [
                |t| t,
                |t| (3.0 * t).exp(),
                |t| 1.0 - (-9.0 * t).exp(),
                |t| (20.0 * (t - 0.4)).tanh(),
                |t| t.powi(4),
            ];
            for curve in curves {
                let values: Vec<f64> = (0..frames).map(|i| curve(t(i))).collect();
                let noisy = sum(&values, &noise(frames, 1e-3, 5));
                assert!(
                    cycles(&values, 0.0).is_err() && cycles(&noisy, 0.0).is_err(),
                    "{frames}"
                );
            }
        }
    }

    /// The period has to stand out by three standard deviations at one of many lags.
    #[test]
    fn noise_has_no_cycles() {
        for frames in [12, 24, 48, 96] {
            let passing = (0..1000)
                .filter(|&seed| cycles(&noise(frames, 1.0, seed), 0.0).is_ok())
                .count();
            assert!(passing < 5, "{frames}: {passing}");
        }
    }

    #[test]
    fn constant_and_short_curves_have_no_cycles() {
        assert_eq!(cycles(&[0.7; 40], 0.0), Err(CycleError::Constant));
        assert_eq!(cycles(&[0.0; 40], 0.0), Err(CycleError::Constant));
        let rounding: Vec<f64> = gait(40, 4.0).iter().map(|v| 1e-28 * v).collect();
        assert_eq!(cycles(&rounding, 1e-15), Err(CycleError::Constant));
        assert_eq!(
            cycles(&gait(9, 3.0), 0.0),
            Err(CycleError::TooFew { found: 9, needed: 10 })
        );
        assert!(matches!(cycles(&[], 0.0), Err(CycleError::TooFew { .. })));
        let mut few = vec![f64::NAN; 50];
        few[0] = 1.0;
        assert!(matches!(cycles(&few, 0.0), Err(CycleError::TooFew { found: 1, .. })));
        let huge = gait(40, 4.0).iter().map(|v| 1e300 * v).collect::<Vec<_>>();
        let _ = cycles(&huge, 0.0);
    }
}

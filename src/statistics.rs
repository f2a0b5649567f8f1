//! Summary statistics of errors, energies and qualities.

/// Summary of a list of values. Those that are not finite are counted and otherwise ignored.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Summary {
    /// How many finite values there are.
    pub count: usize,
    /// How many values are infinite or not a number.
    pub not_finite: usize,
    /// Smallest value.
    pub min: f64,
    /// Arithmetic mean.
    pub mean: f64,
    /// Root of the mean square.
    pub rms: f64,
    /// 50 % quantile.
    pub median: f64,
    /// 99 % quantile.
    pub p99: f64,
    /// Largest value.
    pub max: f64,
}

impl Summary {
    /// The summary of `values`; `None` when none is finite. Quantiles as [`quantiles`] defines them.
    pub fn of(values: &[f64]) -> Option<Self> {
        let sorted = sorted_finite(values);
        let (&min, &max) = (sorted.first()?, sorted.last()?);
        let count = sorted.len() as f64;
        // Scaled by the largest magnitude: squares of very small or large values leave the range of f64.
        let scale = min.abs().max(max.abs()).max(f64::MIN_POSITIVE);
        let mean_square = sorted.iter().map(|x| (x / scale).powi(2)).sum::<f64>() / count;
        Some(Self {
            count: sorted.len(),
            not_finite: values.len() - sorted.len(),
            min,
            mean: sorted.iter().map(|x| x / count).sum(),
            rms: scale * mean_square.sqrt(),
            median: quantile_of_sorted(&sorted, 0.5),
            p99: quantile_of_sorted(&sorted, 0.99),
            max,
        })
    }
}

/// The quantiles of `values` at `fractions` in `[0, 1]` (clamped to it); `None` when no value is finite.
///
/// With the `n` finite values sorted, the quantile at `p` interpolates linearly at rank `(n − 1) p`, so 0 gives the
/// smallest and 1 the largest: definition 7 of Hyndman & Fan, *Sample quantiles in statistical packages*, The
/// American Statistician 50 (1996), the default of R and NumPy.
pub fn quantiles<const N: usize>(values: &[f64], fractions: [f64; N]) -> Option<[f64; N]> {
    let sorted = sorted_finite(values);
    (!sorted.is_empty()).then(|| fractions.map(|p| quantile_of_sorted(&sorted, p)))
}

/// The weighted quantiles of `values` at `shares` of the total weight in `[0, 1]` (clamped to it): the smallest value
/// such that it and all smaller ones have that share of the weight; 0 gives the smallest and 1 the largest. Infinite
/// values are allowed; values that are NaN, and those whose weight is not positive and finite, are ignored. `None` when
/// nothing is left.
///
/// # Panics
///
/// When the slices differ in length.
pub fn weighted_quantiles<const N: usize>(values: &[f64], weights: &[f64], shares: [f64; N]) -> Option<[f64; N]> {
    assert_eq!(values.len(), weights.len(), "one weight per value");
    let pairs = values.iter().copied().zip(weights.iter().copied());
    let mut ascending: Vec<(f64, f64)> = pairs
        .filter(|(x, w)| !x.is_nan() && *w > 0.0 && w.is_finite())
        .collect();
    ascending.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
    let (largest, _) = *ascending.last()?;
    // Divided by the largest weight: a sum of large ones would leave the range of f64.
    let unit = ascending.iter().map(|(_, weight)| *weight).fold(0.0, f64::max);
    let total: f64 = ascending.iter().map(|(_, weight)| weight / unit).sum();
    let quantile = |share: f64| {
        let mut below = 0.0;
        let reached = ascending.iter().find(|(_, weight)| {
            below += weight / unit;
            below >= share * total
        });
        match reached {
            Some((value, _)) if share < 1.0 => *value,
            _ => largest,
        }
    };
    Some(shares.map(quantile))
}

fn sorted_finite(values: &[f64]) -> Vec<f64> {
    let mut finite: Vec<f64> = values.iter().copied().filter(|x| x.is_finite()).collect();
    finite.sort_unstable_by(f64::total_cmp);
    finite
}

fn quantile_of_sorted(sorted: &[f64], fraction: f64) -> f64 {
    let rank = (sorted.len() - 1) as f64 * fraction.clamp(0.0, 1.0);
    let (below, above) = (sorted[rank.floor() as usize], sorted[rank.ceil() as usize]);
    below * (1.0 - rank.fract()) + above * rank.fract()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_those_of_definition_7() {
        // numpy.quantile([1, 2, 4, 8], [0, 0.25, 0.5, 0.9, 1])
        let found = quantiles(&[8.0, 1.0, 4.0, 2.0], [0.0, 0.25, 0.5, 0.9, 1.0]).unwrap();
        for (x, y) in found.iter().zip([1.0, 1.75, 3.0, 6.8, 8.0]) {
            assert!((x - y).abs() < 1e-14, "{x} {y}");
        }
        assert_eq!(quantiles(&[3.5], [0.3]), Some([3.5]));
        assert_eq!(quantiles(&[f64::NAN], [0.5]), None);
    }

    #[test]
    fn summary_of_known_values() {
        let summary = Summary::of(&[3.0, f64::NAN, -4.0, f64::INFINITY]).unwrap();
        assert_eq!((summary.count, summary.not_finite), (2, 2));
        assert_eq!((summary.min, summary.mean, summary.max), (-4.0, -0.5, 3.0));
        assert!((summary.rms - 12.5f64.sqrt()).abs() < 1e-14);
        assert_eq!(Summary::of(&[]), None);
        assert_eq!(Summary::of(&[0.0, 0.0]).unwrap().rms, 0.0);
    }

    #[test]
    fn rms_of_extreme_values_neither_overflows_nor_vanishes() {
        for size in [1e-200, 1e200] {
            assert!((Summary::of(&[size, size]).unwrap().rms / size - 1.0).abs() < 1e-14);
        }
    }

    #[test]
    fn weighted_quantiles_sum_weights() {
        let values = [5.0, 1.0, f64::INFINITY, 2.0, f64::NAN, 3.0];
        let weights = [1.0, 1.0, 1.0, 6.0, 9.0, 1.0];
        let found = weighted_quantiles(&values, &weights, [0.0, 0.09, 0.11, 0.69, 0.71, 0.89, 0.91, 1.0]);
        let inf = f64::INFINITY;
        assert_eq!(found, Some([1.0, 1.0, 2.0, 2.0, 3.0, 5.0, inf, inf]));
        assert_eq!(weighted_quantiles(&[1.0], &[0.0], [0.5]), None);
        assert_eq!(
            weighted_quantiles(&[1.0, 2.0], &[f64::MAX; 2], [0.5, 0.6]),
            Some([1.0, 2.0])
        );
    }
}

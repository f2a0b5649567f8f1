/// Quantiles of a density over the volume of a solid.
///
/// `median` is the smallest value such that half of the volume has it or less, `p99` that 99 percent have; points of
/// small cells therefore count little.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Distribution {
    /// Smallest value.
    pub min: f64,
    /// Value that half of the volume does not exceed.
    pub median: f64,
    /// Value that 99 percent of the volume do not exceed.
    pub p99: f64,
    /// Largest value.
    pub max: f64,
}

impl Distribution {
    /// Quantiles of parallel values and weights. `None` when there are none. Costs a sort.
    pub fn weighted(values: &[f64], weights: &[f64]) -> Option<Self> {
        let sorted = WeightedValues::new(values.iter().copied().zip(weights.iter().copied()));
        Some(Self {
            min: sorted.quantile(0.0)?,
            median: sorted.quantile(0.5)?,
            p99: sorted.quantile(0.99)?,
            max: sorted.quantile(1.0)?,
        })
    }
}

/// Values in ascending order, each with its weight.
pub(super) struct WeightedValues {
    ascending: Vec<(f64, f64)>,
    total: f64,
}

impl WeightedValues {
    /// Sorts pairs of values and weights.
    pub fn new(pairs: impl Iterator<Item = (f64, f64)>) -> Self {
        let mut ascending: Vec<(f64, f64)> = pairs.collect();
        ascending.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
        let total = ascending.iter().map(|(_, weight)| weight).sum();
        Self { ascending, total }
    }

    /// The smallest value that, with all below it, has this share of the weight: 0 gives the smallest of all, 1 the
    /// largest. `None` when there are no values.
    pub fn quantile(&self, share: f64) -> Option<f64> {
        let (last, _) = self.ascending.last()?;
        if share >= 1.0 {
            return Some(*last);
        }
        let mut below = 0.0;
        let reached = self.ascending.iter().find(|(_, weight)| {
            below += weight;
            below >= share * self.total
        });
        reached.or(self.ascending.last()).map(|(value, _)| *value)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_count_volume_and_not_points() {
        let values = [5.0, 1.0, 4.0, 2.0, 3.0];
        let even = Distribution::weighted(&values, &[1.0; 5]).unwrap();
        assert_eq!((even.min, even.median, even.p99, even.max), (1.0, 3.0, 5.0, 5.0));
        let heavy = Distribution::weighted(&values, &[0.01, 1.0, 0.01, 100.0, 0.01]).unwrap();
        assert_eq!((heavy.median, heavy.p99, heavy.max), (2.0, 2.0, 5.0));
    }

    #[test]
    fn nothing_has_no_quantiles() {
        assert_eq!(Distribution::weighted(&[], &[]), None);
    }
}

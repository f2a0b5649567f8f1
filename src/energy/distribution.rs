use crate::statistics::weighted_quantiles;

/// Quantiles of a density over the volume of a solid.
///
/// `median` is the smallest value that half of the volume does not exceed, `p99` that 99 percent do not exceed; points
/// of small cells count little.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct DensityQuantiles {
    /// Smallest value.
    pub min: f64,
    /// Value that half of the volume does not exceed.
    pub median: f64,
    /// Value that 99 percent of the volume do not exceed.
    pub p99: f64,
    /// Largest value.
    pub max: f64,
}

impl DensityQuantiles {
    /// Quantiles of parallel values and weights, by [`weighted_quantiles`]. `None` if there are none. Takes a sort.
    ///
    /// # Panics
    ///
    /// When the slices differ in length.
    pub fn weighted(values: &[f64], weights: &[f64]) -> Option<Self> {
        let [min, median, p99, max] = weighted_quantiles(values, weights, [0.0, 0.5, 0.99, 1.0])?;
        Some(Self { min, median, p99, max })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_count_volume_and_not_points() {
        let values = [5.0, 1.0, 4.0, 2.0, 3.0];
        let even = DensityQuantiles::weighted(&values, &[1.0; 5]).unwrap();
        assert_eq!((even.min, even.median, even.p99, even.max), (1.0, 3.0, 5.0, 5.0));
        let heavy = DensityQuantiles::weighted(&values, &[0.01, 1.0, 0.01, 100.0, 0.01]).unwrap();
        assert_eq!((heavy.median, heavy.p99, heavy.max), (2.0, 2.0, 5.0));
    }

    #[test]
    fn nothing_has_no_quantiles() {
        assert_eq!(DensityQuantiles::weighted(&[], &[]), None);
    }
}

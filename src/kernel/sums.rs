//! Sums by the cheaper way: term by term, exact to rounding, or by the fast multipole method.

use std::sync::Arc;

use super::fmm::Fmm;
use super::{KernelError, direct};
use crate::Point;

/// Sources and targets, ready for any number of sums over them at a given accuracy.
///
/// Term by term where that costs less, which is for few points, few sources or few targets; otherwise through [`Fmm`].
#[derive(Debug, Clone)]
pub struct Sums {
    sources: Arc<[Point]>,
    targets: Arc<[Point]>,
    accuracy: f64,
    fmm: Option<Fmm>,
}

/// Whether summing term by term costs less.
///
/// A direct sum costs a unit per pair and three columns. The fast sum costs some hundred units per point and an
/// overhead, which grow with the digits asked for. The table has measured numbers of points, with as many targets as
/// sources on a surface and three columns, at which the two take equal time. For many columns both work by matrix
/// products, and gain about as much.
fn is_small(sources: usize, targets: usize, accuracy: f64) -> bool {
    const CROSSOVERS: [(f64, f64); 5] = [(1e-4, 2e3), (1e-6, 5e3), (1e-8, 1.2e4), (1e-9, 2e4), (0.0, 2.5e4)];
    let reached = CROSSOVERS.into_iter().find(|&(least, _)| accuracy >= least);
    let crossover = reached.map_or(f64::INFINITY, |(_, points)| points);
    let (sources, targets) = (sources as f64, targets as f64);
    sources * targets <= 0.5 * crossover * (sources + targets)
}

impl Sums {
    /// Takes the points, and sorts them into a tree if that pays. `accuracy` is as for [`Fmm::new`].
    ///
    /// # Errors
    ///
    /// As [`Fmm::new`].
    pub fn new(sources: &[Point], targets: &[Point], accuracy: f64) -> Result<Self, KernelError> {
        Self::with_range(sources, targets, accuracy, accuracy)
    }

    /// As [`Self::new`], for sums that will also be taken at accuracies as loose as `loosest`, at which a tree pays
    /// sooner.
    ///
    /// # Errors
    ///
    /// As [`Fmm::new`].
    pub fn with_range(sources: &[Point], targets: &[Point], accuracy: f64, loosest: f64) -> Result<Self, KernelError> {
        let fmm = if is_small(sources.len(), targets.len(), loosest) {
            None
        } else {
            Some(Fmm::new(sources, targets, accuracy)?)
        };
        Ok(Self {
            sources: sources.into(),
            targets: targets.into(),
            accuracy,
            fmm,
        })
    }

    /// Number of sources.
    pub fn sources(&self) -> usize {
        self.sources.len()
    }

    /// The same points at another accuracy; the tree is shared.
    pub fn with_accuracy(&self, accuracy: f64) -> Self {
        Self {
            sources: Arc::clone(&self.sources),
            targets: Arc::clone(&self.targets),
            accuracy,
            fmm: self.fmm.as_ref().map(|fmm| fmm.with_accuracy(accuracy)),
        }
    }

    /// `Σ_j w_j / (4π |x − y_j|)`: see [`Fmm::potential`].
    ///
    /// # Errors
    ///
    /// As [`Fmm::potential`].
    pub fn potential(&self, weights: &[f64], columns: usize) -> Result<Vec<f64>, KernelError> {
        match self.fast() {
            Some(fmm) => fmm.potential(weights, columns),
            None => Ok(direct::sum_columns(&self.sources, weights, columns, &self.targets, false)?.0),
        }
    }

    /// Potential and gradient: see [`Fmm::potential_and_gradient`].
    ///
    /// # Errors
    ///
    /// As [`Fmm::potential`].
    pub fn potential_and_gradient(&self, weights: &[f64], columns: usize) -> Result<(Vec<f64>, Vec<f64>), KernelError> {
        match self.fast() {
            Some(fmm) => fmm.potential_and_gradient(weights, columns),
            None => direct::sum_columns(&self.sources, weights, columns, &self.targets, true),
        }
    }

    fn fast(&self) -> Option<&Fmm> {
        let is_small = is_small(self.sources.len(), self.targets.len(), self.accuracy);
        self.fmm.as_ref().filter(|_| !is_small)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn spiral(count: usize, radius: f64) -> Vec<Point> {
        let point = |i: usize| {
            let (z, angle) = (1.0 - (2 * i + 1) as f64 / count as f64, 2.4 * i as f64);
            let r = (1.0 - z * z).sqrt();
            Point::new(r * angle.cos(), r * angle.sin(), z) * radius
        };
        (0..count).map(point).collect()
    }

    #[test]
    fn small_sums_are_exact_and_large_ones_reach_the_accuracy() {
        for (count, is_fast, tolerance) in [(100, false, 1e-13), (12_000, true, 1e-5)] {
            let (sources, targets) = (spiral(count, 1.1), spiral(count, 1.0));
            let weights: Vec<f64> = (0..2 * count).map(|i| ((i * i) as f64).sin()).collect();
            let sums = Sums::new(&sources, &targets, 1e-5).unwrap();
            assert_eq!(sums.fast().is_some(), is_fast);
            let found = sums.potential_and_gradient(&weights, 2).unwrap();
            let expected = direct::sum_columns(&sources, &weights, 2, &targets, true).unwrap();
            let norm = |v: &mut dyn Iterator<Item = f64>| v.map(|x| x * x).sum::<f64>().sqrt();
            let error = norm(&mut found.0.iter().zip(&expected.0).map(|(a, b)| a - b));
            assert!(error <= tolerance * norm(&mut expected.0.iter().copied()));
            let error = norm(&mut found.1.iter().zip(&expected.1).map(|(a, b)| a - b));
            assert!(error <= 10.0 * tolerance * norm(&mut expected.1.iter().copied()));
            assert_eq!(sums.potential(&weights[..count], 1).unwrap().len(), count);
        }
    }

    #[test]
    fn few_targets_are_summed_directly_however_many_the_sources() {
        let sums = Sums::new(&spiral(50_000, 1.1), &spiral(200, 1.0), 1e-4).unwrap();
        assert!(sums.fmm.is_none());
    }

    #[test]
    fn rejects_weights_of_another_number_of_sources() {
        let sums = Sums::new(&spiral(10, 1.1), &spiral(20, 1.0), 1e-4).unwrap();
        assert!(sums.potential(&[1.0; 19], 2).is_err());
    }
}

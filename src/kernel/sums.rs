//! PLACEHOLDER until the fast multipole sums are merged.
#![allow(missing_docs)]
use super::{KernelError, direct};
use crate::Point;
#[derive(Clone)]
pub struct Sums { sources: Vec<Point>, targets: Vec<Point> }
impl Sums {
    pub fn new(sources: &[Point], targets: &[Point], _accuracy: f64) -> Result<Self, KernelError> { Ok(Self { sources: sources.to_vec(), targets: targets.to_vec() }) }
    pub fn with_accuracy(&self, _accuracy: f64) -> Self { self.clone() }
    pub fn potential(&self, weights: &[f64], columns: usize) -> Result<Vec<f64>, KernelError> {
        let mut out = vec![0.0; self.targets.len() * columns];
        let mut first = 0;
        while first < columns {
            let w: Vec<[f64; 3]> = weights.chunks(columns).map(|row| std::array::from_fn(|k| row.get(first + k).copied().unwrap_or(0.0))).collect();
            let s = direct::Sources::new(&self.sources, &w)?;
            for (o, v) in out.chunks_mut(columns).zip(direct::potential(&s, &self.targets)) { for k in 0..3.min(columns - first) { o[first + k] = v[k]; } }
            first += 3;
        }
        Ok(out)
    }
    pub fn potential_and_gradient(&self, weights: &[f64], columns: usize) -> Result<(Vec<f64>, Vec<f64>), KernelError> {
        assert!(columns == 3);
        let w: Vec<[f64; 3]> = weights.chunks(3).map(|r| [r[0], r[1], r[2]]).collect();
        let s = direct::Sources::new(&self.sources, &w)?;
        let (v, j) = direct::potential_and_gradient(&s, &self.targets);
        Ok((v.as_flattened().to_vec(), j.iter().flat_map(|j| (0..3).flat_map(move |i| (0..3).map(move |k| j[(i, k)]))).collect()))
    }
}

//! PLACEHOLDER until the fast multipole sums' own choice is merged.
#![allow(missing_docs)]
use super::{KernelError, direct, fmm::Fmm};
use crate::Point;
#[derive(Clone)]
pub struct Sums {
    sources: Vec<Point>,
    targets: Vec<Point>,
    fmm: Option<std::sync::Arc<Fmm>>,
}
impl Sums {
    pub fn new(sources: &[Point], targets: &[Point], accuracy: f64) -> Result<Self, KernelError> {
        let fmm = if (sources.len() as f64) * (targets.len() as f64) > 3e7 {
            Some(std::sync::Arc::new(Fmm::new(sources, targets, accuracy)?))
        } else {
            None
        };
        Ok(Self {
            sources: sources.to_vec(),
            targets: targets.to_vec(),
            fmm,
        })
    }
    pub fn with_accuracy(&self, accuracy: f64) -> Self {
        let mut s = self.clone();
        s.fmm = self
            .fmm
            .as_ref()
            .map(|f| std::sync::Arc::new(f.with_accuracy(accuracy)));
        s
    }
    pub fn potential(&self, weights: &[f64], columns: usize) -> Result<Vec<f64>, KernelError> {
        if let Some(f) = &self.fmm {
            return f.potential(weights, columns);
        }
        let mut out = vec![0.0; self.targets.len() * columns];
        let mut first = 0;
        while first < columns {
            let w: Vec<[f64; 3]> = weights
                .chunks(columns)
                .map(|row| std::array::from_fn(|k| row.get(first + k).copied().unwrap_or(0.0)))
                .collect();
            let s = direct::Sources::new(&self.sources, &w)?;
            for (o, v) in out.chunks_mut(columns).zip(direct::potential(&s, &self.targets)) {
                for k in 0..3.min(columns - first) {
                    o[first + k] = v[k];
                }
            }
            first += 3;
        }
        Ok(out)
    }
    pub fn potential_and_gradient(&self, weights: &[f64], columns: usize) -> Result<(Vec<f64>, Vec<f64>), KernelError> {
        if let Some(f) = &self.fmm {
            return f.potential_and_gradient(weights, columns);
        }
        assert!(columns == 3);
        let w: Vec<[f64; 3]> = weights.chunks(3).map(|r| [r[0], r[1], r[2]]).collect();
        let s = direct::Sources::new(&self.sources, &w)?;
        let (v, j) = direct::potential_and_gradient(&s, &self.targets);
        Ok((
            v.as_flattened().to_vec(),
            j.iter()
                .flat_map(|j| (0..3).flat_map(move |i| (0..3).map(move |k| j[(i, k)])))
                .collect(),
        ))
    }
}

//! Weights of the sources in the order of a tree, ready for the inner loops.

use std::f64::consts::PI;

use rayon::prelude::*;

use super::tree::Ordered;
use crate::kernel::direct::Source;

/// Right-hand sides of one pass.
#[derive(Debug)]
pub(super) struct Weights {
    pub(super) columns: usize,
    /// Positions and three weights for each source, the last filled up with zeros.
    pub(super) triples: Vec<Vec<Source>>,
    /// Powers of two by which the sums of each column have to be multiplied: single precision has a short range.
    pub(super) scale: Vec<f64>,
    /// Whether all weights are finite.
    pub(super) are_finite: bool,
}

impl Weights {
    /// Columns `first..first + columns` of `weights`, which has `stride` in all.
    pub(super) fn new(sources: &Ordered, weights: &[f64], stride: usize, first: usize, columns: usize) -> Self {
        let mut largest = vec![0.0f64; columns];
        let mut are_finite = true;
        for row in weights.chunks(stride) {
            for (largest, weight) in largest.iter_mut().zip(&row[first..]) {
                *largest = largest.max(weight.abs());
                are_finite &= weight.is_finite();
            }
        }
        let scale: Vec<f64> = largest.into_iter().map(power_of_two_near).collect();
        let factor: Vec<f64> = scale.iter().map(|s| 1.0 / s).collect();
        let triples = (0..columns.div_ceil(3)).map(|triple| {
            let columns = 3 * triple..columns.min(3 * triple + 3);
            let pack = |(&[x, y, z], &number): (&[f64; 3], &u32)| {
                let row = &weights[number as usize * stride + first..];
                let mut packed = [x, y, z, 0.0, 0.0, 0.0];
                for (slot, column) in packed[3..].iter_mut().zip(columns.clone()) {
                    *slot = row[column] * factor[column] / (4.0 * PI);
                }
                packed
            };
            sources
                .positions
                .par_iter()
                .zip(&sources.original)
                .with_min_len(4096)
                .map(pack)
                .collect()
        });
        Self {
            columns,
            triples: triples.collect(),
            scale,
            are_finite,
        }
    }
}

/// A power of two within a factor of two of `value` where its reciprocal is one too; one for zero and what is not finite.
fn power_of_two_near(value: f64) -> f64 {
    if value == 0.0 || !value.is_finite() {
        return 1.0;
    }
    let exponent_bits = (value.to_bits() >> 52).clamp(23, 2023);
    f64::from_bits(exponent_bits << 52)
}

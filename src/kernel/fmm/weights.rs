//! Weights of the sources in the order of a tree, ready for the inner loops.

use std::f64::consts::PI;
use std::ops::Range;

use rayon::prelude::*;

use super::tree::Ordered;
use crate::kernel::direct::{PackedSource, PowerOfTwoScale};

/// Right-hand sides of one pass: in triples of columns, for each of which the kernel is evaluated again, or in rows of
/// all columns, which are multiplied by blocks of the kernel's matrix.
#[derive(Debug)]
pub(super) struct PassWeights {
    pub(super) columns: usize,
    /// For each triple of columns, positions and weights of all sources, padded with zeros; empty with `rows`.
    pub(super) triples: Vec<Vec<PackedSource>>,
    /// Weights, `sources × columns`, row-major; empty with `triples`.
    pub(super) rows: Vec<f64>,
    /// Power of two by which the sums of each column have to be multiplied: weights are scaled to about one, as single
    /// precision has a short range.
    pub(super) scale: Vec<f64>,
    /// Whether all weights are finite.
    pub(super) are_finite: bool,
}

impl PassWeights {
    /// The given columns of `weights`, which has `stride` in all, in rows or in triples.
    pub(super) fn new(
        sources: &Ordered,
        weights: &[f64],
        stride: usize,
        Range { start: first, end }: Range<usize>,
        in_rows: bool,
    ) -> Self {
        let columns = end - first;
        let mut largest = vec![0.0f64; columns];
        let mut are_finite = true;
        for row in weights.chunks(stride) {
            for (largest, weight) in largest.iter_mut().zip(&row[first..]) {
                *largest = largest.max(weight.abs());
                are_finite &= weight.is_finite();
            }
        }
        let scales = largest.into_iter().map(PowerOfTwoScale::of_magnitude);
        let (factor, scale): (Vec<f64>, Vec<f64>) = scales.map(|scale| (scale.up, scale.down)).unzip();
        let triple_count = if in_rows { 0 } else { columns.div_ceil(3) };
        let mut rows = Vec::new();
        if in_rows {
            rows = vec![0.0; sources.original.len() * columns];
            let fill = |(row, &source): (&mut [f64], &u32)| {
                let from = &weights[source as usize * stride + first..];
                for ((to, from), factor) in row.iter_mut().zip(from).zip(&factor) {
                    *to = from * factor / (4.0 * PI);
                }
            };
            rows.par_chunks_mut(columns)
                .zip(&sources.original)
                .with_min_len(1024)
                .for_each(fill);
        }
        let triples = (0..triple_count).map(|triple| {
            let columns = 3 * triple..columns.min(3 * triple + 3);
            let pack = |(&[x, y, z], &source): (&[f64; 3], &u32)| {
                let row = &weights[source as usize * stride + first..];
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
            rows,
            scale,
            are_finite,
        }
    }
}

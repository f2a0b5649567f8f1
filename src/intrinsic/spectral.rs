//! Nearest vertices in the space of eigenfunctions, or of any other functions of the vertices.

use faer::linalg::matmul::matmul;
use faer::{Accum, MatMut, MatRef, Par};
use rayon::prelude::*;

use super::laplacian::Neighbours;

/// Rows that one matrix product takes.
const ROWS: usize = 64;

/// Rows of numbers, of which the first `used` count.
#[derive(Debug, Clone, Copy)]
pub(super) struct Rows<'a> {
    pub entries: &'a [f64],
    /// Entries from one row to the next.
    pub stride: usize,
    pub used: usize,
}

impl<'a> Rows<'a> {
    pub fn of(&self, row: usize) -> &'a [f64] {
        &self.entries[row * self.stride..][..self.used]
    }

    pub fn count(&self) -> usize {
        self.entries.len() / self.stride
    }

    pub fn matrix(&self, first: usize, count: usize) -> MatRef<'a, f64> {
        let entries = &self.entries[first * self.stride..];
        MatRef::from_row_major_slice_with_stride(entries, count, self.used, self.stride)
    }
}

/// For each row of `queries`, the nearest of `rows`; of equals, the first.
pub(super) fn nearest_rows(queries: Rows, rows: Rows) -> Vec<u32> {
    let half_squares: Vec<f64> = (0..rows.count())
        .map(|r| rows.of(r).iter().map(|x| x * x).sum::<f64>() / 2.0)
        .collect();
    let mut nearest = vec![0; queries.count()];
    nearest.par_chunks_mut(ROWS).enumerate().for_each(|(chunk, nearest)| {
        let mut products = vec![0.0; nearest.len() * rows.count()];
        // Column by column, each for one query.
        matmul(
            MatMut::from_column_major_slice_mut(&mut products, rows.count(), nearest.len()),
            Accum::Replace,
            rows.matrix(0, rows.count()),
            queries.matrix(chunk * ROWS, nearest.len()).transpose(),
            1.0,
            Par::Seq,
        );
        for (nearest, products) in nearest.iter_mut().zip(products.chunks(rows.count())) {
            *nearest = lowest(products, &half_squares);
        }
    });
    nearest
}

/// Where the half square minus the product, half the squared distance up to a constant, is least.
fn lowest(products: &[f64], half_squares: &[f64]) -> u32 {
    const LANES: usize = 8;
    let mut least = [f64::INFINITY; LANES];
    let mut place = [0u32; LANES];
    let whole = products.len() / LANES * LANES;
    for first in (0..whole).step_by(LANES) {
        let (products, half_squares) = (&products[first..first + LANES], &half_squares[first..first + LANES]);
        for lane in 0..LANES {
            let value = half_squares[lane] - products[lane];
            let is_less = value < least[lane];
            least[lane] = if is_less { value } else { least[lane] };
            place[lane] = if is_less { first as u32 } else { place[lane] };
        }
    }
    let of_lanes = (0..LANES).map(|lane| (least[lane], place[lane] + lane as u32));
    let rest = (whole..products.len()).map(|at| (half_squares[at] - products[at], at as u32));
    let better = |a: (f64, u32), b: (f64, u32)| if b.0 < a.0 || (b.0 == a.0 && b.1 < a.1) { b } else { a };
    of_lanes.chain(rest).fold((f64::INFINITY, u32::MAX), better).1
}

/// The vertex that is reached from `start` by going to the neighbour nearest to the query for as long as that is nearer.
pub(super) fn descend(query: &[f64], rows: Rows, neighbours: &Neighbours, start: u32) -> u32 {
    let distance = |v: u32| {
        query
            .iter()
            .zip(rows.of(v as usize))
            .map(|(a, b)| (a - b) * (a - b))
            .sum::<f64>()
    };
    let mut best = (distance(start), start);
    loop {
        let around = neighbours.of(best.1).iter().map(|&v| (distance(v), v));
        let next = around.fold(best, |a, b| if b.0 < a.0 { b } else { a });
        if next.1 == best.1 {
            return best.1;
        }
        best = next;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rows(count: usize, stride: usize, seed: f64) -> Vec<f64> {
        (0..count * stride).map(|i| (seed * (i * i) as f64).sin()).collect()
    }

    #[test]
    fn nearest_rows_are_those_of_a_plain_search() {
        let (queries, all) = (rows(150, 7, 0.37), rows(213, 9, 0.73));
        let queries = Rows {
            entries: &queries,
            stride: 7,
            used: 5,
        };
        let all = Rows {
            entries: &all,
            stride: 9,
            used: 5,
        };
        let found = nearest_rows(queries, all);
        for (q, &found) in found.iter().enumerate() {
            let distance = |r: usize| {
                queries
                    .of(q)
                    .iter()
                    .zip(all.of(r))
                    .map(|(a, b)| (a - b) * (a - b))
                    .sum::<f64>()
            };
            let expected = (0..213).min_by(|&a, &b| distance(a).total_cmp(&distance(b))).unwrap();
            assert_eq!(found as usize, expected);
        }
    }

    #[test]
    fn of_equal_rows_the_first_is_taken() {
        let same = vec![1.0; 30];
        let rows = Rows {
            entries: &same,
            stride: 1,
            used: 1,
        };
        assert!(nearest_rows(rows, rows).iter().all(|&r| r == 0));
    }
}

//! Plain sums of the Laplace kernel over all sources: no approximation, cost `sources × targets`.
//!
//! Three right-hand sides share each kernel evaluation, because a map has three coordinates. The inner loops (`loops`)
//! run in AVX-512, AVX2 or portable Rust, as [`Instructions`] says.
//!
//! Every target's sum is formed in the same order whatever the number of threads, in tiles of sources, so results are
//! reproducible to the last bit for one choice of [`Instructions`] on one make of processor. Between two choices they
//! differ by rounding, and so do makes whose reciprocal square root estimates differ.
//!
//! # Range
//!
//! The vector loops take `1/r` from an estimate polished by one step of Householder's method, and that estimate has a
//! limited range of `r²` (that of `f32` under AVX2). Coordinates are therefore scaled by a power of two to about one,
//! which is exact. What still leaves the range is recognised by a sum that is not finite, or beforehand by the target's
//! coordinates; those targets alone are summed again by the formula of [`laplace_potential`], which has no such limits.
//!
//! # References
//!
//! Householder, *The Numerical Treatment of a Single Nonlinear Equation* (1970), for iterations of arbitrary order.

use std::f64::consts::PI;

use faer::linalg::matmul::matmul;
use faer::{Accum, MatMut, MatRef, Par};
use rayon::prelude::*;
use smallvec::SmallVec;

use super::{KernelError, laplace_potential, require_length};
pub use crate::simd::Instructions;
use crate::{Matrix3, Point};

mod loops;
mod range;
mod single;

pub(super) use loops::{
    BlockValues, LANES, PackedSource, SingleSource, TargetBlock, add_gradient, add_potential, add_potential_in_single,
    write_column,
};
pub(super) use range::{PowerOfTwoScale, is_minute};
use range::{in_range, unlimited_jacobian, unlimited_potential};
pub(super) use single::add_near_potential_in_single;
pub(crate) use single::potential_in_single;

/// Points with three weights each, packed for the sums.
#[derive(Debug, Clone)]
pub struct Sources {
    packed: Vec<PackedSource>,
    scale: PowerOfTwoScale,
    /// Whether the squared distance between a source and a target may underflow.
    has_minute: bool,
}

impl Sources {
    /// Sources at `points` (`n`) with `weights` (`n × 3`).
    ///
    /// # Errors
    ///
    /// [`KernelError::LengthMismatch`] when there are not as many weights as points.
    pub fn new(points: &[Point], weights: &[[f64; 3]]) -> Result<Self, KernelError> {
        require_length("weights of sources", weights.len(), points.len())?;
        let scale = PowerOfTwoScale::of(points);
        let pack = |(p, w): (&Point, &[f64; 3])| {
            let p = *p * scale.up;
            let [w0, w1, w2] = w.map(|w| w / (4.0 * PI));
            [p.x, p.y, p.z, w0, w1, w2]
        };
        Ok(Self {
            packed: points.iter().zip(weights).map(pack).collect(),
            scale,
            has_minute: points.iter().any(|p| is_minute(*p * scale.up)),
        })
    }

    /// Number of sources.
    pub fn len(&self) -> usize {
        self.packed.len()
    }

    /// Whether there are none; their potential is zero.
    pub fn is_empty(&self) -> bool {
        self.packed.is_empty()
    }

    fn blocks(&self, targets: &[Point]) -> SmallVec<[TargetBlock; BLOCKS]> {
        targets.chunks(LANES).map(|t| scaled_block(t, self.scale)).collect()
    }
}

/// Potential at each target, `Σ_j w_j G(x, y_j)` with [`laplace_potential`] as `G`: one triple per target, one
/// component per weight.
///
/// Within `1e-13 Σ_j |w_j| G(x, y_j)` of the exact sum for up to 10⁵ sources, at any scale of coordinates. Infinite or
/// NaN where a target is not finite itself or coincides with a source, even one of weight zero.
///
/// Parallel over targets. Pass many at a time: one target alone costs as much as a vector of them, up to eight.
pub fn potential(sources: &Sources, targets: &[Point]) -> Vec<[f64; 3]> {
    potential_with(Instructions::detect(), sources, targets)
}

/// [`potential`] by the given instructions.
pub fn potential_with(instructions: Instructions, sources: &Sources, targets: &[Point]) -> Vec<[f64; 3]> {
    let mut values = vec![[0.0; 3]; targets.len()];
    let chunk = LANES * BLOCKS;
    (values.par_chunks_mut(chunk), targets.par_chunks(chunk))
        .into_par_iter()
        .with_min_len(chunks_per_task(sources))
        .for_each(|(values, targets)| {
            let blocks = sources.blocks(targets);
            let mut sums = [[[0.0; LANES]; 3]; BLOCKS];
            add_potential(instructions, &sources.packed, &blocks, &mut sums);
            for (i, (value, target)) in values.iter_mut().zip(targets).enumerate() {
                let sum = sums[i / LANES].map(|lane| lane[i % LANES]);
                *value = if in_range(sources, *target, &sum) {
                    sum.map(|v| v * sources.scale.up)
                } else {
                    unlimited_potential(sources, *target)
                };
            }
        });
    values
}

/// The potential as [`potential`] gives it, and its Jacobian at each target: entry `(i, k)` is `∂/∂x_k` of component
/// `i`.
///
/// Costs twice to two and a half times the potential alone. The Jacobian is accurate relative to `Σ_j |w_j| |∇G(x,
/// y_j)|` in the same sense, and not finite where the potential is not.
pub fn potential_and_gradient(sources: &Sources, targets: &[Point]) -> (Vec<[f64; 3]>, Vec<Matrix3>) {
    potential_and_gradient_with(Instructions::detect(), sources, targets)
}

/// [`potential_and_gradient`] by the given instructions.
pub fn potential_and_gradient_with(
    instructions: Instructions,
    sources: &Sources,
    targets: &[Point],
) -> (Vec<[f64; 3]>, Vec<Matrix3>) {
    let mut values = vec![[0.0; 3]; targets.len()];
    let mut jacobians = vec![Matrix3::zeros(); targets.len()];
    let chunk = LANES * BLOCKS;
    (
        values.par_chunks_mut(chunk),
        jacobians.par_chunks_mut(chunk),
        targets.par_chunks(chunk),
    )
        .into_par_iter()
        .with_min_len(chunks_per_task(sources))
        .for_each(|(values, jacobians, targets)| {
            let blocks = sources.blocks(targets);
            let mut sums = [[[0.0; LANES]; 12]; BLOCKS];
            add_gradient(instructions, &sources.packed, &blocks, &mut sums);
            for (i, target) in targets.iter().enumerate() {
                let sum = sums[i / LANES].map(|lane| lane[i % LANES]);
                if in_range(sources, *target, &sum) {
                    let up = sources.scale.up;
                    values[i] = [sum[0] * up, sum[1] * up, sum[2] * up];
                    jacobians[i] = -Matrix3::from_row_slice(&sum[3..]) * up * up;
                } else {
                    values[i] = unlimited_potential(sources, *target);
                    jacobians[i] = unlimited_jacobian(sources, *target);
                }
            }
        });
    (values, jacobians)
}

/// Columns up to which the kernel is evaluated anew for every three of them, rather than once for all.
pub(super) const MOST_TRIPLED: usize = 6;

/// Sums for any number of columns: `weights` is `points × columns`, row-major, and so are the results with
/// `targets × columns` potentials and, when asked for, `targets × columns × 3` entries of gradients.
pub(super) fn sum_columns(
    points: &[Point],
    weights: &[f64],
    columns: usize,
    targets: &[Point],
    with_gradient: bool,
) -> Result<(Vec<f64>, Vec<f64>), KernelError> {
    require_length(
        "weights of sources",
        weights.len(),
        points.len().saturating_mul(columns),
    )?;
    if columns > MOST_TRIPLED && !with_gradient {
        let potentials = products(Instructions::detect(), points, weights, columns, targets);
        return Ok((potentials, Vec::new()));
    }
    let rows = targets.len() * columns;
    let mut potentials = vec![0.0; rows];
    let mut gradients = vec![0.0; if with_gradient { 3 * rows } else { 0 }];
    for first in (0..columns).step_by(3) {
        let part = columns.min(first + 3) - first;
        let triple = |row: &[f64]| std::array::from_fn(|i| if i < part { row[first + i] } else { 0.0 });
        let sources = Sources::new(points, &weights.chunks(columns).map(triple).collect::<Vec<_>>())?;
        let (sums, jacobians) = if with_gradient {
            potential_and_gradient(&sources, targets)
        } else {
            (potential(&sources, targets), Vec::new())
        };
        for (row, sum) in potentials.chunks_mut(columns).zip(&sums) {
            row[first..first + part].copy_from_slice(&sum[..part]);
        }
        for (row, jacobian) in gradients.chunks_mut(3 * columns).zip(&jacobians) {
            for (i, gradient) in row[3 * first..3 * (first + part)].chunks_mut(3).enumerate() {
                gradient.copy_from_slice(&[jacobian[(i, 0)], jacobian[(i, 1)], jacobian[(i, 2)]]);
            }
        }
    }
    Ok((potentials, gradients))
}

/// Writes the matrix `A[r, s] = G(targets[r], sources[s])` to `matrix`, column after column without gaps: the entries
/// of one source are contiguous.
///
/// Relative error of an entry below `1e-15`; not finite where the two points coincide or one is not finite. Parallel
/// over columns.
///
/// # Errors
///
/// [`KernelError::LengthMismatch`] unless `matrix` has `targets × sources` entries.
pub fn fill_matrix(targets: &[Point], sources: &[Point], matrix: &mut [f64]) -> Result<(), KernelError> {
    fill_matrix_with(Instructions::detect(), targets, sources, matrix)
}

/// [`fill_matrix`] by the given instructions.
///
/// # Errors
///
/// As [`fill_matrix`].
pub fn fill_matrix_with(
    instructions: Instructions,
    targets: &[Point],
    sources: &[Point],
    matrix: &mut [f64],
) -> Result<(), KernelError> {
    let entries = targets.len().saturating_mul(sources.len());
    require_length("entries of the matrix", matrix.len(), entries)?;
    if targets.is_empty() {
        return Ok(());
    }
    let scale = PowerOfTwoScale::of(targets.iter().chain(sources));
    let blocks: Vec<TargetBlock> = targets.chunks(LANES).map(|t| scaled_block(t, scale)).collect();
    matrix
        .par_chunks_mut(targets.len())
        .zip(sources)
        .with_min_len(PAIRS_PER_TASK.div_ceil(targets.len()))
        .for_each(|(column, source)| write_entries(instructions, *source, targets, &blocks, scale, column));
    Ok(())
}

/// Blocks of targets that see a tile of sources before the next tile is fetched.
const BLOCKS: usize = 4;
/// Fewest pairs of a parallel task, about a tenth of a millisecond.
const PAIRS_PER_TASK: usize = 1 << 17;
/// Targets and sources whose kernel is evaluated before it is multiplied: as many as a second-level cache holds.
const PRODUCT_ROWS: usize = 256;
const PRODUCT_TILE: usize = 128;

fn scaled_block(targets: &[Point], scale: PowerOfTwoScale) -> TargetBlock {
    TargetBlock::mapped(targets, |target| target.coords.map(|c| c * scale.up).into())
}

fn chunks_per_task(sources: &Sources) -> usize {
    PAIRS_PER_TASK.div_ceil(LANES * BLOCKS * sources.len().max(1))
}

/// The kernel between a source and all targets, which `blocks` hold to scale.
fn write_entries(
    instructions: Instructions,
    source: Point,
    targets: &[Point],
    blocks: &[TargetBlock],
    scale: PowerOfTwoScale,
    column: &mut [f64],
) {
    let scaled = source * scale.up;
    let factor = scale.up / (4.0 * PI);
    let finite = write_column(instructions, scaled.coords.into(), factor, blocks, column);
    let source_is_minute = is_minute(scaled);
    if finite && !source_is_minute {
        return;
    }
    for (entry, target) in column.iter_mut().zip(targets) {
        if !entry.is_finite() || (source_is_minute && is_minute(*target * scale.up)) {
            *entry = laplace_potential(*target, source);
        }
    }
}

/// Potentials of many columns, as products with tiles of the kernel's matrix.
fn products(
    instructions: Instructions,
    points: &[Point],
    weights: &[f64],
    columns: usize,
    targets: &[Point],
) -> Vec<f64> {
    let scale = PowerOfTwoScale::of(targets.iter().chain(points));
    let mut potentials = vec![0.0; targets.len() * columns];
    let rows = PRODUCT_ROWS;
    (potentials.par_chunks_mut(rows * columns), targets.par_chunks(rows))
        .into_par_iter()
        .with_min_len((PAIRS_PER_TASK / columns).div_ceil(rows * points.len().max(1)))
        .for_each(|(potentials, targets)| {
            let blocks: Vec<TargetBlock> = targets.chunks(LANES).map(|t| scaled_block(t, scale)).collect();
            let weights = MatRef::from_row_major_slice(weights, points.len(), columns);
            let out = MatMut::from_row_major_slice_mut(potentials, targets.len(), columns);
            add_products(points, weights, 1.0, out, |source, column| {
                write_entries(instructions, *source, targets, &blocks, scale, column);
            });
        });
    potentials
}

/// Adds to `out` (targets × columns) `factor` times the potential of points with a row of weights each; `write` gives
/// the kernel between a point and all targets.
pub(super) fn add_products<P>(
    points: &[P],
    weights: MatRef<'_, f64>,
    factor: f64,
    mut out: MatMut<'_, f64>,
    write: impl Fn(&P, &mut [f64]),
) {
    let rows = out.nrows();
    let mut kernel = vec![0.0; rows * PRODUCT_TILE.min(points.len())];
    for (tile, points) in points.chunks(PRODUCT_TILE).enumerate() {
        let kernel = &mut kernel[..rows * points.len()];
        for (point, column) in points.iter().zip(kernel.chunks_mut(rows)) {
            write(point, column);
        }
        matmul(
            out.as_mut(),
            Accum::Add,
            MatRef::from_column_major_slice(kernel, rows, points.len()),
            weights.subrows(tile * PRODUCT_TILE, points.len()),
            factor,
            Par::Seq,
        );
    }
}

#[cfg(test)]
mod tests;

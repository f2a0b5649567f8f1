//! Plain sums of the Laplace kernel over all sources: no approximation, cost `sources × targets`.
//!
//! Three right-hand sides share each kernel evaluation, because a map has three coordinates. The inner loops exist for
//! AVX-512, AVX2 and portable Rust behind [`Instructions`]; a lane of a vector is a target and sources are broadcast one
//! after the other, so that no sum crosses lanes and neither array needs padding in memory.
//!
//! Every target's sum is formed in the same order whatever the number of threads, in tiles of sources, so results are
//! reproducible to the last bit for one choice of [`Instructions`] on one make of processor. Between two choices they
//! differ by rounding, and so do makes whose reciprocal square root estimates differ.
//!
//! # Range
//!
//! The vector loops take `1/r` from an estimate polished by one step of Householder's method, and that estimate has a
//! limited range of `r²` (that of `f32` under AVX2). Coordinates are therefore scaled by a power of two to about one,
//! which is exact, and what still leaves the range shows: as a sum that is not finite, or beforehand from the target's
//! coordinates. Those targets alone are summed again by the formula of [`laplace_potential`], which has no such limits.
//!
//! # References
//!
//! Householder, *The Numerical Treatment of a Single Nonlinear Equation* (1970), for iterations of arbitrary order.

use std::f64::consts::PI;

use faer::linalg::matmul::matmul;
use faer::{Accum, MatMut, MatRef, Par};
use rayon::prelude::*;

use super::laplace::norm;
use super::{KernelError, laplace_potential};
use crate::{Matrix3, Point, Vector};

#[cfg(target_arch = "x86_64")]
mod avx2;
#[cfg(target_arch = "x86_64")]
mod avx512;
mod portable;

#[cfg(target_arch = "x86_64")]
use avx2::Avx2;
#[cfg(target_arch = "x86_64")]
use avx512::Avx512;
use portable::Portable;

/// A set of vector instructions that this machine has been found to have.
///
/// The plain functions of this module use the fastest; those that end in `_with` take one, so that each can be tested
/// and measured.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Instructions(Level);

impl Instructions {
    /// The fastest of [`Self::available`].
    pub fn detect() -> Self {
        Self::available().next().unwrap_or(Self(Level::Portable(Portable)))
    }

    /// All that this machine has, fastest first; the last is the portable one, which is always there.
    pub fn available() -> impl Iterator<Item = Self> {
        [
            #[cfg(target_arch = "x86_64")]
            Avx512::detect().map(Level::Avx512),
            #[cfg(target_arch = "x86_64")]
            Avx2::detect().map(Level::Avx2),
            Some(Level::Portable(Portable)),
        ]
        .into_iter()
        .flatten()
        .map(Self)
    }

    /// `"avx512"`, `"avx2"` or `"portable"`.
    pub fn name(self) -> &'static str {
        match self.0 {
            #[cfg(target_arch = "x86_64")]
            Level::Avx512(_) => "avx512",
            #[cfg(target_arch = "x86_64")]
            Level::Avx2(_) => "avx2",
            Level::Portable(_) => "portable",
        }
    }
}

/// Points that carry three weights each, laid out for the sums.
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
        if weights.len() != points.len() {
            return Err(KernelError::LengthMismatch {
                what: "weights of sources",
                expected: points.len(),
                found: weights.len(),
            });
        }
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

    /// How many there are.
    pub fn len(&self) -> usize {
        self.packed.len()
    }

    /// Whether there are none; their potential is zero.
    pub fn is_empty(&self) -> bool {
        self.packed.is_empty()
    }
}

/// Potential at each target, `Σ_j w_j G(x, y_j)` with [`laplace_potential`] as `G`: one triple per target, one
/// component per weight.
///
/// Within `1e-13 Σ_j |w_j| G(x, y_j)` of the exact sum for up to 10⁵ sources, at any scale of coordinates. Not
/// finite (infinite or NaN) where a target coincides with a source, even one of weight zero, and where it is not
/// finite itself.
///
/// Parallel over targets. Give many at a time: one target alone costs as much as a vector of them, up to eight.
pub fn potential(sources: &Sources, targets: &[Point]) -> Vec<[f64; 3]> {
    potential_with(Instructions::detect(), sources, targets)
}

/// [`potential`] by the given instructions.
pub fn potential_with(instructions: Instructions, sources: &Sources, targets: &[Point]) -> Vec<[f64; 3]> {
    match instructions.0 {
        #[cfg(target_arch = "x86_64")]
        Level::Avx512(lanes) => sum_potential(lanes, sources, targets),
        #[cfg(target_arch = "x86_64")]
        Level::Avx2(lanes) => sum_potential(lanes, sources, targets),
        Level::Portable(lanes) => sum_potential(lanes, sources, targets),
    }
}

/// Potential as [`potential`] has it, and its Jacobian at each target: entry `(i, k)` is `∂/∂x_k` of component `i`.
///
/// Costs twice to two and a half times the potential alone. The Jacobian is accurate relative to `Σ_j |w_j| |∇G(x, y_j)|` in the same
/// sense, and not finite where the potential is not.
pub fn potential_and_gradient(sources: &Sources, targets: &[Point]) -> (Vec<[f64; 3]>, Vec<Matrix3>) {
    potential_and_gradient_with(Instructions::detect(), sources, targets)
}

/// [`potential_and_gradient`] by the given instructions.
pub fn potential_and_gradient_with(
    instructions: Instructions,
    sources: &Sources,
    targets: &[Point],
) -> (Vec<[f64; 3]>, Vec<Matrix3>) {
    match instructions.0 {
        #[cfg(target_arch = "x86_64")]
        Level::Avx512(lanes) => sum_gradient(lanes, sources, targets),
        #[cfg(target_arch = "x86_64")]
        Level::Avx2(lanes) => sum_gradient(lanes, sources, targets),
        Level::Portable(lanes) => sum_gradient(lanes, sources, targets),
    }
}

/// Right-hand sides up to which the kernel is evaluated anew for each three of them.
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
    let expected = points.len().saturating_mul(columns);
    if weights.len() != expected {
        return Err(KernelError::LengthMismatch {
            what: "weights of sources",
            expected,
            found: weights.len(),
        });
    }
    if columns > MOST_TRIPLED && !with_gradient {
        return Ok((
            Instructions::detect().sum_products(points, weights, columns, targets),
            Vec::new(),
        ));
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
/// [`KernelError::LengthMismatch`] when `matrix` has not `targets × sources` entries.
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
    let expected = targets.len().saturating_mul(sources.len());
    if matrix.len() != expected {
        return Err(KernelError::LengthMismatch {
            what: "entries of the matrix",
            expected,
            found: matrix.len(),
        });
    }
    match instructions.0 {
        #[cfg(target_arch = "x86_64")]
        Level::Avx512(lanes) => assemble(lanes, targets, sources, matrix),
        #[cfg(target_arch = "x86_64")]
        Level::Avx2(lanes) => assemble(lanes, targets, sources, matrix),
        Level::Portable(lanes) => assemble(lanes, targets, sources, matrix),
    }
    Ok(())
}

/// The inner loops for other algorithms of this module, on coordinates that the caller has scaled: see [`Lanes`].
impl Instructions {
    /// Adds the potential of three weights at each block of targets.
    pub(super) fn add_potential(
        self,
        sources: &[PackedSource],
        targets: &[TargetBlock],
        sums: &mut [[BlockValues; 3]],
    ) {
        match self.0 {
            #[cfg(target_arch = "x86_64")]
            Level::Avx512(lanes) => add_tiles(sources, targets, sums, |s, t, sums| lanes.add_potential(s, t, sums)),
            #[cfg(target_arch = "x86_64")]
            Level::Avx2(lanes) => add_tiles(sources, targets, sums, |s, t, sums| lanes.add_potential(s, t, sums)),
            Level::Portable(lanes) => add_tiles(sources, targets, sums, |s, t, sums| lanes.add_potential(s, t, sums)),
        }
    }

    /// Adds the potential of three weights, then the negative of its gradient, as [`Lanes::add_gradient`] orders them.
    pub(super) fn add_gradient(
        self,
        sources: &[PackedSource],
        targets: &[TargetBlock],
        sums: &mut [[BlockValues; 12]],
    ) {
        match self.0 {
            #[cfg(target_arch = "x86_64")]
            Level::Avx512(lanes) => add_tiles(sources, targets, sums, |s, t, sums| lanes.add_gradient(s, t, sums)),
            #[cfg(target_arch = "x86_64")]
            Level::Avx2(lanes) => add_tiles(sources, targets, sums, |s, t, sums| lanes.add_gradient(s, t, sums)),
            Level::Portable(lanes) => add_tiles(sources, targets, sums, |s, t, sums| lanes.add_gradient(s, t, sums)),
        }
    }

    fn sum_products(self, points: &[Point], weights: &[f64], columns: usize, targets: &[Point]) -> Vec<f64> {
        match self.0 {
            #[cfg(target_arch = "x86_64")]
            Level::Avx512(lanes) => products(lanes, points, weights, columns, targets),
            #[cfg(target_arch = "x86_64")]
            Level::Avx2(lanes) => products(lanes, points, weights, columns, targets),
            Level::Portable(lanes) => products(lanes, points, weights, columns, targets),
        }
    }

    /// Writes `1 / r` for the targets of all blocks, one column of `column.len()` entries.
    pub(super) fn write_column(self, source: [f64; 3], targets: &[TargetBlock], column: &mut [f64]) {
        match self.0 {
            #[cfg(target_arch = "x86_64")]
            Level::Avx512(lanes) => lanes.write_column(source, 1.0, targets, column),
            #[cfg(target_arch = "x86_64")]
            Level::Avx2(lanes) => lanes.write_column(source, 1.0, targets, column),
            Level::Portable(lanes) => lanes.write_column(source, 1.0, targets, column),
        };
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Level {
    #[cfg(target_arch = "x86_64")]
    Avx512(Avx512),
    #[cfg(target_arch = "x86_64")]
    Avx2(Avx2),
    Portable(Portable),
}

/// Targets of one pass of the inner loops: a multiple of every vector width.
pub(super) const LANES: usize = 16;
/// Blocks of targets that see a tile of sources before the next tile is fetched.
const BLOCKS: usize = 4;
/// Sources of a tile: 24 KiB, half of a first-level cache. Also bounds the growth of rounding errors, as each tile is
/// summed on its own.
const TILE: usize = 512;
/// Pairs that make a task worth handing to another thread, a tenth of a millisecond or so.
const PAIRS_PER_TASK: usize = 1 << 17;
/// Targets and sources whose kernel is evaluated before it is multiplied: as many as a second-level cache holds.
const PRODUCT_ROWS: usize = 256;
const PRODUCT_TILE: usize = 128;

/// Scaled position, then the weights over 4π.
pub(super) type PackedSource = [f64; 6];
/// One value for each target of a block.
pub(super) type BlockValues = [f64; LANES];

/// The inner loops in one set of instructions. Sums are in scaled units and add to what is there.
trait Lanes: Copy + Send + Sync {
    /// Adds the potential of three weights.
    fn add_potential(self, sources: &[PackedSource], targets: &TargetBlock, sums: &mut [BlockValues; 3]);

    /// Adds the potential of three weights, then `Σ w d_k / r³` with `d = x − y` for weight after weight: the gradient's
    /// negative.
    fn add_gradient(self, sources: &[PackedSource], targets: &TargetBlock, sums: &mut [BlockValues; 12]);

    /// Writes `factor / r` for the targets of all blocks; returns `true` only when all entries are finite.
    fn write_column(self, source: [f64; 3], factor: f64, targets: &[TargetBlock], column: &mut [f64]) -> bool;
}

/// Scaled coordinates of up to [`LANES`] targets, the last repeated to fill the lanes.
#[derive(Debug, Clone, Copy)]
#[repr(align(64))]
pub(super) struct TargetBlock {
    coordinates: [BlockValues; 3],
    len: usize,
}

impl TargetBlock {
    fn new(targets: &[Point], scale: PowerOfTwoScale) -> Self {
        Self::mapped(targets, |target| target.coords.map(|c| c * scale.up).into())
    }

    /// A block of one to [`LANES`] targets whose scaled coordinates `map` gives.
    pub(super) fn mapped<T>(targets: &[T], map: impl Fn(&T) -> [f64; 3]) -> Self {
        let mut coordinates = [[0.0; LANES]; 3];
        for lane in 0..LANES {
            let target = map(&targets[lane.min(targets.len() - 1)]);
            for axis in 0..3 {
                coordinates[axis][lane] = target[axis];
            }
        }
        Self {
            coordinates,
            len: targets.len(),
        }
    }

    /// Vectors of `width` that hold targets.
    fn vectors(&self, width: usize) -> usize {
        self.len.div_ceil(width)
    }
}

/// A power of two by which lengths are multiplied, and its reciprocal.
#[derive(Debug, Clone, Copy)]
pub(super) struct PowerOfTwoScale {
    pub(super) up: f64,
    down: f64,
}

impl PowerOfTwoScale {
    /// Brings the largest finite coordinate to between one and two, or as near as exact powers of two do.
    pub(super) fn of(points: &[Point]) -> Self {
        let finite = points
            .iter()
            .flat_map(|p| p.iter())
            .map(|c| c.abs())
            .filter(|c| c.is_finite());
        let largest = finite.fold(0.0, f64::max);
        if largest == 0.0 {
            return Self { up: 1.0, down: 1.0 };
        }
        let exponent_bits = (largest.to_bits() >> 52).clamp(23, 2023);
        Self {
            up: f64::from_bits((2046 - exponent_bits) << 52),
            down: f64::from_bits(exponent_bits << 52),
        }
    }
}

fn sum_potential(lanes: impl Lanes, sources: &Sources, targets: &[Point]) -> Vec<[f64; 3]> {
    let mut values = vec![[0.0; 3]; targets.len()];
    (
        values.par_chunks_mut(LANES * BLOCKS),
        targets.par_chunks(LANES * BLOCKS),
    )
        .into_par_iter()
        .with_min_len(chunks_per_task(sources))
        .for_each(|(values, targets)| {
            let sums = sum_tiles(sources, targets, |tile, block, sums| {
                lanes.add_potential(tile, block, sums)
            });
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

fn sum_gradient(lanes: impl Lanes, sources: &Sources, targets: &[Point]) -> (Vec<[f64; 3]>, Vec<Matrix3>) {
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
            let sums = sum_tiles(sources, targets, |tile, block, sums| {
                lanes.add_gradient(tile, block, sums)
            });
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

fn assemble(lanes: impl Lanes, targets: &[Point], sources: &[Point], matrix: &mut [f64]) {
    if targets.is_empty() {
        return;
    }
    let scale = PowerOfTwoScale::of(&[extent(targets), extent(sources)]);
    let blocks: Vec<TargetBlock> = targets.chunks(LANES).map(|t| TargetBlock::new(t, scale)).collect();
    matrix
        .par_chunks_mut(targets.len())
        .zip(sources)
        .with_min_len(PAIRS_PER_TASK.div_ceil(targets.len()))
        .for_each(|(column, source)| write_entries(lanes, *source, targets, &blocks, scale, column));
}

/// The kernel between a source and all targets, which `blocks` hold to scale.
fn write_entries(
    lanes: impl Lanes,
    source: Point,
    targets: &[Point],
    blocks: &[TargetBlock],
    scale: PowerOfTwoScale,
    column: &mut [f64],
) {
    let scaled = source * scale.up;
    let finite = lanes.write_column(scaled.coords.into(), scale.up / (4.0 * PI), blocks, column);
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

/// Potentials of many columns, which share each kernel value: products with tiles of the kernel's matrix.
fn products(lanes: impl Lanes, points: &[Point], weights: &[f64], columns: usize, targets: &[Point]) -> Vec<f64> {
    let scale = PowerOfTwoScale::of(&[extent(targets), extent(points)]);
    let mut potentials = vec![0.0; targets.len() * columns];
    let rows = PRODUCT_ROWS;
    (potentials.par_chunks_mut(rows * columns), targets.par_chunks(rows))
        .into_par_iter()
        .with_min_len((PAIRS_PER_TASK / columns).div_ceil(rows * points.len().max(1)))
        .for_each(|(potentials, targets)| {
            let blocks: Vec<TargetBlock> = targets.chunks(LANES).map(|t| TargetBlock::new(t, scale)).collect();
            let mut kernel = vec![0.0; targets.len() * PRODUCT_TILE.min(points.len())];
            let tiles = points.chunks(PRODUCT_TILE).zip(weights.chunks(PRODUCT_TILE * columns));
            for (points, weights) in tiles {
                let kernel = &mut kernel[..targets.len() * points.len()];
                for (source, column) in points.iter().zip(kernel.chunks_mut(targets.len())) {
                    write_entries(lanes, *source, targets, &blocks, scale, column);
                }
                matmul(
                    MatMut::from_row_major_slice_mut(&mut *potentials, targets.len(), columns),
                    Accum::Add,
                    MatRef::from_column_major_slice(kernel, targets.len(), points.len()),
                    MatRef::from_row_major_slice(weights, points.len(), columns),
                    1.0,
                    Par::Seq,
                );
            }
        });
    potentials
}

/// Adds tile after tile of sources, each to all blocks while it is in the first-level cache.
fn add_tiles<const N: usize>(
    sources: &[PackedSource],
    targets: &[TargetBlock],
    sums: &mut [[BlockValues; N]],
    add: impl Fn(&[PackedSource], &TargetBlock, &mut [BlockValues; N]),
) {
    for tile in sources.chunks(TILE) {
        for (block, sums) in targets.iter().zip(&mut *sums) {
            add(tile, block, sums);
        }
    }
}

fn chunks_per_task(sources: &Sources) -> usize {
    PAIRS_PER_TASK.div_ceil(LANES * BLOCKS * sources.len().max(1))
}

/// Sums over all sources for up to [`BLOCKS`] blocks of targets.
fn sum_tiles<const N: usize>(
    sources: &Sources,
    targets: &[Point],
    add: impl Fn(&[PackedSource], &TargetBlock, &mut [BlockValues; N]),
) -> [[BlockValues; N]; BLOCKS] {
    let mut blocks = [None; BLOCKS];
    for (block, targets) in blocks.iter_mut().zip(targets.chunks(LANES)) {
        *block = Some(TargetBlock::new(targets, sources.scale));
    }
    let mut sums = [[[0.0; LANES]; N]; BLOCKS];
    for tile in sources.packed.chunks(TILE) {
        for (block, sums) in blocks.iter().flatten().zip(&mut sums) {
            add(tile, block, sums);
        }
    }
    sums
}

/// Whether the sums at a target can be trusted.
///
/// Squared distances overflow only when the target is far outside the sources, and lose bits to underflow only when
/// both points are minute. Other limits of the estimate of `1/r` leave an infinity or NaN in the sum.
fn in_range(sources: &Sources, target: Point, sums: &[f64]) -> bool {
    let scaled = target * sources.scale.up;
    let within = scaled.iter().all(|c| c.abs() <= FAR);
    within && !(sources.has_minute && is_minute(scaled)) && sums.iter().all(|v| v.is_finite())
}

/// Largest scaled coordinate of a target for the vector loops, 2⁶⁰: `r²` stays below 2¹²⁴, in the range of `f32`.
const FAR: f64 = (1u64 << 60) as f64;

/// Whether a scaled point is so near the origin (2⁻⁴³⁰) that its squared distance to another such point may underflow.
/// Distances below 2⁻⁴⁸⁵ occur only among such points, since coordinates of `2⁻⁴³⁰` are 2⁻⁴⁸³ apart.
pub(super) fn is_minute(scaled: Point) -> bool {
    const MINUTE: f64 = f64::from_bits((1023 - 430) << 52);
    scaled.coords.amax() < MINUTE
}

/// The point of largest absolute coordinates.
fn extent(points: &[Point]) -> Point {
    let finite = |c: f64| if c.is_finite() { c.abs() } else { 0.0 };
    points
        .iter()
        .fold(Point::origin(), |e, p| e.coords.sup(&p.coords.map(finite)).into())
}

fn unlimited_potential(sources: &Sources, target: Point) -> [f64; 3] {
    let mut sum = [0.0; 3];
    for &[x, y, z, w0, w1, w2] in &sources.packed {
        let r = norm(target - Point::new(x, y, z) * sources.scale.down);
        for (sum, w) in sum.iter_mut().zip([w0, w1, w2]) {
            *sum += w / r;
        }
    }
    sum
}

fn unlimited_jacobian(sources: &Sources, target: Point) -> Matrix3 {
    let mut sum = Matrix3::zeros();
    for &[x, y, z, w0, w1, w2] in &sources.packed {
        let d = target - Point::new(x, y, z) * sources.scale.down;
        let r = norm(d);
        sum -= Vector::new(w0, w1, w2) / r / r * (d / r).transpose();
    }
    sum
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use proptest::test_runner::RngSeed;
    use rand::rngs::StdRng;
    use rand::{Rng, SeedableRng};

    use super::*;
    use crate::kernel::laplace_gradient;

    /// How a random point of a test is placed.
    #[derive(Debug, Clone, Copy)]
    enum Cloud {
        Cube { scale: f64 },
        FarFromOrigin,
        Clustered,
        ManyScales,
    }

    const CLOUDS: [Cloud; 8] = [
        Cloud::Cube { scale: 1.0 },
        Cloud::Cube { scale: 1e-150 },
        Cloud::Cube { scale: 1e-25 },
        Cloud::Cube { scale: 1e25 },
        Cloud::Cube { scale: 1e150 },
        Cloud::FarFromOrigin,
        Cloud::Clustered,
        Cloud::ManyScales,
    ];

    impl Cloud {
        fn points(self, count: usize, rng: &mut StdRng) -> Vec<Point> {
            let mut cube = |half: f64| Vector::from_fn(|_, _| rng.random_range(-half..half));
            (0..count)
                .map(|i| match self {
                    Self::Cube { scale } => cube(1.0) * scale,
                    Self::FarFromOrigin => Vector::new(1e6, -1e6, 3e6) + cube(1.0),
                    // Eight corners with points 1e-9 from each other.
                    Self::Clustered => Vector::from_fn(|axis, _| (i >> axis & 1) as f64) + cube(1e-9),
                    // Distances from 1 to 1e-140: beyond what single precision can square, and within double.
                    Self::ManyScales => cube(1.0) * 10f64.powi(-20 * (i as i32 % 8)),
                })
                .map(Point::from)
                .collect()
        }
    }

    fn weights(count: usize, rng: &mut StdRng) -> Vec<[f64; 3]> {
        (0..count)
            .map(|_| [0; 3].map(|_| rng.random_range(-1.0..1.0)))
            .collect()
    }

    /// The sums and the sums of absolute values of their terms, straight from the definition.
    struct Plain {
        potential: Vector,
        potential_size: Vector,
        jacobian: Matrix3,
        jacobian_size: Vector,
    }

    fn plain(points: &[Point], weights: &[[f64; 3]], target: Point) -> Plain {
        let mut sums = Plain {
            potential: Vector::zeros(),
            potential_size: Vector::zeros(),
            jacobian: Matrix3::zeros(),
            jacobian_size: Vector::zeros(),
        };
        for (point, &w) in points.iter().zip(weights) {
            let (w, g, gradient) = (
                Vector::from(w),
                laplace_potential(target, *point),
                laplace_gradient(target, *point),
            );
            sums.potential += w * g;
            sums.potential_size += w.abs() * g;
            sums.jacobian += w * gradient.transpose();
            // Not `gradient.norm()`, whose squares underflow.
            sums.jacobian_size += w.abs() * norm(gradient);
        }
        sums
    }

    fn assert_agrees_with_plain_sum(points: &[Point], weights: &[[f64; 3]], targets: &[Point]) {
        // Each term is within a few units of 2⁻⁵³ and so is each of the at most 1,200 additions, but those are random.
        const TOLERANCE: f64 = 1e-13;
        let sources = Sources::new(points, weights).unwrap();
        for instructions in Instructions::available() {
            let name = instructions.name();
            let values = potential_with(instructions, &sources, targets);
            let (values_too, jacobians) = potential_and_gradient_with(instructions, &sources, targets);
            assert_eq!(
                (values.len(), values_too.len(), jacobians.len()),
                (targets.len(), targets.len(), targets.len())
            );
            for (t, target) in targets.iter().enumerate() {
                let expected = plain(points, weights, *target);
                for i in 0..3 {
                    for value in [values[t][i], values_too[t][i]] {
                        let error = (value - expected.potential[i]).abs();
                        assert!(
                            error <= TOLERANCE * expected.potential_size[i],
                            "{name} {t} {i}: {value}, off by {error:e}"
                        );
                    }
                    let error = (jacobians[t].row(i) - expected.jacobian.row(i)).amax();
                    assert!(
                        error <= TOLERANCE * expected.jacobian_size[i],
                        "{name} {t} {i}: off by {error:e}"
                    );
                }
            }
        }
    }

    fn assert_bitwise_equal<const N: usize>(left: &[[f64; N]], right: &[[f64; N]]) {
        let bits = |rows: &[[f64; N]]| rows.iter().map(|row| row.map(f64::to_bits)).collect::<Vec<_>>();
        assert_eq!(bits(left), bits(right));
    }

    proptest! {
        #![proptest_config(ProptestConfig { rng_seed: RngSeed::Fixed(1), failure_persistence: None, ..ProptestConfig::default() })]

        #[test]
        fn agrees_with_the_plain_sum(
            cloud in prop::sample::select(CLOUDS.to_vec()),
            source_count in 0usize..80,
            target_count in 0usize..80,
            seed: u64,
        ) {
            let rng = &mut StdRng::seed_from_u64(seed);
            let points = cloud.points(source_count, rng);
            let targets = cloud.points(target_count, rng);
            assert_agrees_with_plain_sum(&points, &weights(source_count, rng), &targets);
        }

        #[test]
        fn matrix_has_the_kernel_of_each_pair(
            cloud in prop::sample::select(CLOUDS.to_vec()),
            rows in 0usize..80,
            columns in 0usize..20,
            seed: u64,
        ) {
            let rng = &mut StdRng::seed_from_u64(seed);
            let (targets, sources) = (cloud.points(rows, rng), cloud.points(columns, rng));
            for instructions in Instructions::available() {
                let mut matrix = vec![f64::NAN; rows * columns];
                fill_matrix_with(instructions, &targets, &sources, &mut matrix).unwrap();
                for (i, entry) in matrix.iter().enumerate() {
                    let expected = laplace_potential(targets[i % rows], sources[i / rows]);
                    prop_assert!((entry / expected - 1.0).abs() < 1e-15, "{}: {entry} for {expected}", instructions.name());
                }
            }
        }
    }

    #[test]
    fn agrees_with_the_plain_sum_over_several_tiles_and_chunks() {
        let rng = &mut StdRng::seed_from_u64(2);
        let cloud = Cloud::Cube { scale: 1.0 };
        let points = cloud.points(2 * TILE + 77, rng);
        let targets = cloud.points(2 * LANES * BLOCKS + 5, rng);
        assert_agrees_with_plain_sum(&points, &weights(points.len(), rng), &targets);
    }

    #[test]
    fn agrees_with_the_plain_sum_where_targets_and_sources_differ_in_scale() {
        let rng = &mut StdRng::seed_from_u64(3);
        for (source_scale, target_scale) in [(1.0, 1e30), (1e30, 1.0), (1e-200, 1.0), (1.0, 1e-200), (1e-300, 1e100)] {
            let points = Cloud::Cube { scale: source_scale }.points(20, rng);
            let targets = Cloud::Cube { scale: target_scale }.points(20, rng);
            assert_agrees_with_plain_sum(&points, &weights(20, rng), &targets);
        }
    }

    #[test]
    fn keeps_its_digits_where_the_squared_distance_underflows() {
        let at = |x: f64, y: f64| Point::new(x, y, 0.0);
        let points = [at(1.0, 0.0), at(1e-158, 2e-158), at(0.0, 0.0)];
        let targets = [at(3e-158, 1e-158), at(0.0, 1e-161)];
        let sources = Sources::new(&points, &[[1.0, 2.0, 3.0]; 3]).unwrap();
        for instructions in Instructions::available() {
            for (value, target) in potential_with(instructions, &sources, &targets).iter().zip(targets) {
                let expected: f64 = points.iter().map(|p| laplace_potential(target, *p)).sum();
                for (value, weight) in value.iter().zip([1.0, 2.0, 3.0]) {
                    assert!((value / (expected * weight) - 1.0).abs() < 1e-15);
                }
            }
            let mut matrix = [0.0; 6];
            fill_matrix_with(instructions, &targets, &points, &mut matrix).unwrap();
            for (i, entry) in matrix.iter().enumerate() {
                assert!((entry / laplace_potential(targets[i % 2], points[i / 2]) - 1.0).abs() < 1e-15);
            }
        }
    }

    #[test]
    fn is_not_finite_where_a_target_is_a_source_and_right_beside_it() {
        let rng = &mut StdRng::seed_from_u64(4);
        let cloud = Cloud::Cube { scale: 1.0 };
        let (points, targets) = (cloud.points(30, rng), cloud.points(30, rng));
        for weight in [[1.0, -2.0, 3.0], [0.0; 3]] {
            let mut weights = weights(30, rng);
            weights[7] = weight;
            let mut with_source = targets.clone();
            with_source[11] = points[7];
            let sources = Sources::new(&points, &weights).unwrap();
            for instructions in Instructions::available() {
                let undisturbed = potential_and_gradient_with(instructions, &sources, &targets);
                let mut values = potential_with(instructions, &sources, &with_source);
                let (mut values_too, mut jacobians) = potential_and_gradient_with(instructions, &sources, &with_source);
                assert!(values[11].iter().chain(&values_too[11]).all(|v| !v.is_finite()));
                assert!(jacobians[11].iter().all(|v| !v.is_finite()));

                values.remove(11);
                values_too.remove(11);
                jacobians.remove(11);
                let (mut expected, mut expected_jacobians) = undisturbed;
                expected.remove(11);
                expected_jacobians.remove(11);
                assert_bitwise_equal(&values_too, &expected);
                assert!(values.iter().flatten().all(|v| v.is_finite()));
                assert_eq!(jacobians, expected_jacobians);
            }
        }
        for instructions in Instructions::available() {
            let mut matrix = [0.0; 2];
            fill_matrix_with(instructions, &[points[0], points[1]], &[points[0]], &mut matrix).unwrap();
            assert_eq!(matrix[0], f64::INFINITY);
            assert!(matrix[1].is_finite());
        }
    }

    #[test]
    fn is_not_finite_where_coordinates_are_not() {
        let points = [Point::new(0.0, 0.5, 1.0), Point::new(-1.0, 0.0, 0.0)];
        let sources = Sources::new(&points, &[[1.0, 2.0, 3.0]; 2]).unwrap();
        for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            let target = Point::new(0.0, bad, 0.0);
            for instructions in Instructions::available() {
                let (values, jacobians) = potential_and_gradient_with(instructions, &sources, &[target]);
                assert!(values[0].iter().all(|v| !v.is_finite()));
                assert!(jacobians[0].iter().all(|v| !v.is_finite()));
                let mut matrix = [0.0; 4];
                fill_matrix_with(instructions, &[target, points[1]], &[points[0], target], &mut matrix).unwrap();
                assert_eq!(matrix.map(f64::is_finite), [false, true, false, false]);
            }
        }
    }

    #[test]
    fn sum_of_no_sources_is_zero_and_no_targets_have_no_values() {
        let none = Sources::new(&[], &[]).unwrap();
        let one = Sources::new(&[Point::origin()], &[[1.0; 3]]).unwrap();
        assert!(none.is_empty() && one.len() == 1);
        assert_eq!(potential(&none, &[Point::origin()]), [[0.0; 3]]);
        assert_eq!(potential_and_gradient(&none, &[Point::origin()]).1, [Matrix3::zeros()]);
        assert!(potential(&one, &[]).is_empty());
        assert!(fill_matrix(&[], &[Point::origin()], &mut []).is_ok());
    }

    #[test]
    fn results_do_not_depend_on_threads_nor_on_the_other_targets() {
        let rng = &mut StdRng::seed_from_u64(5);
        let cloud = Cloud::Cube { scale: 1.0 };
        let (points, targets) = (cloud.points(3000, rng), cloud.points(300, rng));
        let sources = Sources::new(&points, &weights(3000, rng)).unwrap();
        let on_threads = |threads: usize, instructions| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| potential_and_gradient_with(instructions, &sources, &targets))
        };
        for instructions in Instructions::available() {
            let (values, jacobians) = on_threads(1, instructions);
            let (values_4, jacobians_4) = on_threads(4, instructions);
            assert_bitwise_equal(&values, &values_4);
            assert_eq!(jacobians, jacobians_4);
            for t in [0, 7, 100, 299] {
                let alone = potential_with(instructions, &sources, &targets[t..=t]);
                let among = potential_with(instructions, &sources, &targets);
                assert_bitwise_equal(&alone, &among[t..=t]);
            }
        }
    }

    /// Many columns go by products with the kernel's matrix, few by sums: over several tiles of sources and blocks of
    /// targets, with a pair of points at a distance whose square underflows.
    #[test]
    fn sums_of_many_columns_are_those_of_each() {
        let rng = &mut StdRng::seed_from_u64(11);
        let (sources, targets) = (2 * PRODUCT_TILE + 37, PRODUCT_ROWS + 19);
        let mut points = |count: usize| -> Vec<Point> {
            let coordinate = |rng: &mut StdRng| rng.random_range(-1.0..1.0);
            (0..count)
                .map(|_| Point::new(coordinate(rng), coordinate(rng), coordinate(rng)))
                .collect()
        };
        let (mut from, mut to) = (points(sources), points(targets));
        from[5] = Point::origin();
        to[3] = Point::new(1e-170, 0.0, 0.0);
        let columns = MOST_TRIPLED + 2;
        let weight = |i: usize| (i as f64 * 0.37).sin();
        let weights: Vec<f64> = (0..sources * columns).map(weight).collect();
        let (together, _) = sum_columns(&from, &weights, columns, &to, false).unwrap();
        for column in 0..columns {
            let own: Vec<f64> = weights.iter().skip(column).step_by(columns).copied().collect();
            let (alone, _) = sum_columns(&from, &own, 1, &to, false).unwrap();
            let sizes: Vec<f64> = own.iter().map(|w| w.abs()).collect();
            let (bounds, _) = sum_columns(&from, &sizes, 1, &to, false).unwrap();
            for (t, (expected, bound)) in alone.iter().zip(&bounds).enumerate() {
                let found = together[t * columns + column];
                assert!(
                    (found - expected).abs() <= 1e-13 * bound,
                    "{found} and {expected} at {t}"
                );
            }
        }
    }

    #[test]
    fn rejects_arrays_of_different_length() {
        let error = Sources::new(&[Point::origin()], &[]).unwrap_err();
        assert_eq!(error.to_string(), "0 weights of sources were given where 1 are needed");
        let error = fill_matrix(&[Point::origin(); 2], &[Point::origin(); 3], &mut [0.0; 5]).unwrap_err();
        assert_eq!(
            error.to_string(),
            "5 entries of the matrix were given where 6 are needed"
        );
    }
}

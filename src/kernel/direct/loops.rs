//! The inner loops, on scaled coordinates: a lane of a vector is a target, and sources are broadcast one after the
//! other, so that no sum crosses lanes and neither array needs padding in memory.

use crate::simd::{Computation, Instructions, Simd, Vector};

/// Targets of a [`TargetBlock`]: a multiple of every vector width.
pub(in crate::kernel) const LANES: usize = 16;

/// Sources of a tile: 24 KiB, half of a first-level cache. Also bounds the growth of rounding errors, as each tile is
/// summed on its own.
pub(super) const TILE: usize = 512;

/// Scaled position, then the weights over 4π.
pub(in crate::kernel) type PackedSource = [f64; 6];
/// One value for each target of a block.
pub(in crate::kernel) type BlockValues<T = f64> = [T; LANES];

/// A source for sums with values of the kernel in single precision.
#[derive(Debug, Clone, Copy)]
pub(in crate::kernel) struct SingleSource {
    pub(in crate::kernel) position: [f32; 3],
    pub(in crate::kernel) weights: [f64; 3],
}

/// Scaled coordinates of up to [`LANES`] targets, the last repeated to fill the lanes.
#[derive(Debug, Clone, Copy)]
#[repr(align(64))]
pub(in crate::kernel) struct TargetBlock<T = f64> {
    coordinates: [BlockValues<T>; 3],
    len: usize,
}

impl<T: Copy + Default> TargetBlock<T> {
    /// A block of one to [`LANES`] targets whose scaled coordinates `map` gives.
    pub(in crate::kernel) fn mapped<P>(targets: &[P], map: impl Fn(&P) -> [T; 3]) -> Self {
        let mut coordinates = [[T::default(); LANES]; 3];
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

    #[inline(always)]
    fn load<V: Vector<T>>(&self, token: V::Token, vector: usize) -> [V; 3] {
        let [x, y, z] = &self.coordinates;
        let first = vector * V::WIDTH;
        [
            V::load(token, &x[first..]),
            V::load(token, &y[first..]),
            V::load(token, &z[first..]),
        ]
    }
}

/// Adds the potential of three weights at each block of targets.
pub(in crate::kernel) fn add_potential(
    instructions: Instructions,
    sources: &[PackedSource],
    targets: &[TargetBlock],
    sums: &mut [[BlockValues; 3]],
) {
    instructions.run(PotentialLoop(sources, targets, sums));
}

/// Adds the same with values of the kernel in single precision, and returns the largest `1/r`. A sum is not finite where
/// one of these is not.
///
/// Weights and sums are in double precision: rounding to single precision would tell apart weights that differ by
/// rounding, and solvers magnify that.
pub(in crate::kernel) fn add_potential_in_single(
    instructions: Instructions,
    sources: &[SingleSource],
    targets: &[TargetBlock<f32>],
    sums: &mut [[BlockValues; 3]],
) -> f32 {
    instructions.run(SinglePotentialLoop(sources, targets, sums))
}

/// Adds the potential of three weights, then `Σ w d_k / r³` with `d = x − y` for weight after weight: the gradient's
/// negative.
pub(in crate::kernel) fn add_gradient(
    instructions: Instructions,
    sources: &[PackedSource],
    targets: &[TargetBlock],
    sums: &mut [[BlockValues; 12]],
) {
    instructions.run(GradientLoop(sources, targets, sums));
}

/// Writes `factor / r` for the targets of all blocks, `column.len()` in all; returns `true` only when all entries are
/// finite.
pub(in crate::kernel) fn write_column(
    instructions: Instructions,
    source: [f64; 3],
    factor: f64,
    targets: &[TargetBlock],
    column: &mut [f64],
) -> bool {
    instructions.run(ColumnLoop {
        source,
        factor,
        targets,
        column,
    })
}

struct PotentialLoop<'a>(&'a [PackedSource], &'a [TargetBlock], &'a mut [[BlockValues; 3]]);
struct SinglePotentialLoop<'a>(&'a [SingleSource], &'a [TargetBlock<f32>], &'a mut [[BlockValues; 3]]);
struct GradientLoop<'a>(&'a [PackedSource], &'a [TargetBlock], &'a mut [[BlockValues; 12]]);

impl Computation for PotentialLoop<'_> {
    type Output = ();

    #[inline(always)]
    fn run<V: Simd>(self, token: V::Token) {
        let Self(sources, targets, sums) = self;
        for tile in sources.chunks(TILE) {
            for (block, sums) in targets.iter().zip(&mut *sums) {
                // Two vectors share each broadcast of a source where the registers hold both.
                if V::REGISTERS >= 32 && block.len > V::WIDTH {
                    for vector in (0..LANES / V::WIDTH).step_by(2) {
                        add_potential_of::<V, 2>(token, tile, block, vector, sums);
                    }
                } else {
                    for vector in 0..block.len.div_ceil(V::WIDTH) {
                        add_potential_of::<V, 1>(token, tile, block, vector, sums);
                    }
                }
            }
        }
    }
}

impl Computation for SinglePotentialLoop<'_> {
    type Output = f32;

    #[inline(always)]
    fn run<V: Simd>(self, token: V::Token) -> f32 {
        let Self(sources, targets, sums) = self;
        let mut largest = V::Single::splat(token, 0.0);
        for tile in sources.chunks(TILE) {
            for (block, sums) in targets.iter().zip(&mut *sums) {
                for vector in 0..block.len.div_ceil(V::Single::WIDTH) {
                    largest = add_potential_in_single_of::<V>(token, tile, block, vector, sums, largest);
                }
            }
        }
        let mut lanes = [0.0; LANES];
        largest.store(&mut lanes);
        lanes.into_iter().fold(0.0, f32::max)
    }
}

impl Computation for GradientLoop<'_> {
    type Output = ();

    #[inline(always)]
    fn run<V: Simd>(self, token: V::Token) {
        let Self(sources, targets, sums) = self;
        for tile in sources.chunks(TILE) {
            for (block, sums) in targets.iter().zip(&mut *sums) {
                for vector in 0..block.len.div_ceil(V::WIDTH) {
                    add_gradient_of::<V>(token, tile, block, vector, sums);
                }
            }
        }
    }
}

/// For `VECTORS` vectors of the block from the given one on.
#[inline(always)]
fn add_potential_of<V: Simd, const VECTORS: usize>(
    token: V::Token,
    sources: &[PackedSource],
    targets: &TargetBlock,
    vector: usize,
    sums: &mut [BlockValues; 3],
) {
    let zero = V::splat(token, 0.0);
    let mut x = [[zero; 3]; VECTORS];
    for (v, x) in x.iter_mut().enumerate() {
        *x = targets.load(token, vector + v);
    }
    let mut sum = [[zero; 3]; VECTORS];
    for &[sx, sy, sz, w0, w1, w2] in sources {
        let source = [V::splat(token, sx), V::splat(token, sy), V::splat(token, sz)];
        let weights = [V::splat(token, w0), V::splat(token, w1), V::splat(token, w2)];
        for v in 0..VECTORS {
            let g = norm_squared(difference(x[v], source)).reciprocal_sqrt();
            for i in 0..3 {
                sum[v][i] = weights[i].mul_add(g, sum[v][i]);
            }
        }
    }
    for (v, sum) in sum.iter().enumerate() {
        add(token, sum, sums, vector + v);
    }
}

/// Returns `largest`, or `1/r` where that is larger.
#[inline(always)]
fn add_potential_in_single_of<V: Simd>(
    token: V::Token,
    sources: &[SingleSource],
    targets: &TargetBlock<f32>,
    vector: usize,
    sums: &mut [BlockValues; 3],
    mut largest: V::Single,
) -> V::Single {
    let x: [V::Single; 3] = targets.load(token, vector);
    let mut sum = [[V::splat(token, 0.0); 3]; 2];
    for source in sources {
        let [sx, sy, sz] = source.position;
        let position = [
            V::Single::splat(token, sx),
            V::Single::splat(token, sy),
            V::Single::splat(token, sz),
        ];
        let g = norm_squared(difference(x, position)).reciprocal_sqrt();
        largest = g.max(largest);
        let g = V::widened(g);
        let [w0, w1, w2] = source.weights;
        let weights = [V::splat(token, w0), V::splat(token, w1), V::splat(token, w2)];
        for half in 0..2 {
            for i in 0..3 {
                sum[half][i] = weights[i].mul_add(g[half], sum[half][i]);
            }
        }
    }
    for (half, sum) in sum.iter().enumerate() {
        add(token, sum, sums, 2 * vector + half);
    }
    largest
}

#[inline(always)]
fn add_gradient_of<V: Simd>(
    token: V::Token,
    sources: &[PackedSource],
    targets: &TargetBlock,
    vector: usize,
    sums: &mut [BlockValues; 12],
) {
    let x = targets.load(token, vector);
    let mut sum = [V::splat(token, 0.0); 12];
    for &[sx, sy, sz, w0, w1, w2] in sources {
        let source = [V::splat(token, sx), V::splat(token, sy), V::splat(token, sz)];
        let weights = [V::splat(token, w0), V::splat(token, w1), V::splat(token, w2)];
        let d = difference(x, source);
        let g = norm_squared(d).reciprocal_sqrt();
        let g3 = g * g * g;
        for i in 0..3 {
            sum[i] = weights[i].mul_add(g, sum[i]);
            let wg3 = weights[i] * g3;
            for k in 0..3 {
                sum[3 + 3 * i + k] = wg3.mul_add(d[k], sum[3 + 3 * i + k]);
            }
        }
    }
    add(token, &sum, sums, vector);
}

struct ColumnLoop<'a> {
    source: [f64; 3],
    factor: f64,
    targets: &'a [TargetBlock],
    column: &'a mut [f64],
}

impl Computation for ColumnLoop<'_> {
    type Output = bool;

    #[inline(always)]
    fn run<V: Simd>(self, token: V::Token) -> bool {
        let [x, y, z] = self.source;
        let source = [V::splat(token, x), V::splat(token, y), V::splat(token, z)];
        let factor = V::splat(token, self.factor);
        let mut check = V::splat(token, 0.0);
        let (full, rest) = self.column.as_chunks_mut();
        for (block, out) in self.targets.iter().zip(&mut *full) {
            check = write_block(token, source, factor, block, out, check);
        }
        if let Some(block) = self.targets.get(full.len()) {
            let mut out = [0.0; LANES];
            check = write_block(token, source, factor, block, &mut out, check);
            rest.copy_from_slice(&out[..rest.len()]);
        }
        let mut lanes = [0.0; LANES];
        check.store(&mut lanes);
        lanes.iter().sum::<f64>().is_finite()
    }
}

/// Returns `check` plus what is written.
#[inline(always)]
fn write_block<V: Simd>(
    token: V::Token,
    source: [V; 3],
    factor: V,
    block: &TargetBlock,
    out: &mut BlockValues,
    mut check: V,
) -> V {
    for vector in 0..LANES / V::WIDTH {
        let value = factor * norm_squared(difference(block.load(token, vector), source)).reciprocal_sqrt();
        check = check + value;
        value.store(&mut out[vector * V::WIDTH..]);
    }
    check
}

#[inline(always)]
fn difference<T, V: Vector<T>>(x: [V; 3], y: [V; 3]) -> [V; 3] {
    [x[0] - y[0], x[1] - y[1], x[2] - y[2]]
}

#[inline(always)]
fn norm_squared<T, V: Vector<T>>(d: [V; 3]) -> V {
    d[2].mul_add(d[2], d[1].mul_add(d[1], d[0] * d[0]))
}

#[inline(always)]
fn add<V: Simd>(token: V::Token, sum: &[V], sums: &mut [BlockValues], vector: usize) {
    for (&sum, lanes) in sum.iter().zip(sums) {
        let lanes = &mut lanes[vector * V::WIDTH..];
        (V::load(token, lanes) + sum).store(lanes);
    }
}

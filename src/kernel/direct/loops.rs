//! The inner loops, on scaled coordinates: a lane of a vector is a target, and sources are broadcast one after the
//! other, so that no sum crosses lanes and neither array needs padding in memory.

use crate::simd::{Computation, Instructions, Scalar, Simd};

/// Targets of a [`TargetBlock`]: a multiple of every vector width.
pub(in crate::kernel) const LANES: usize = 16;

/// Sources of a tile: 24 KiB, half of a first-level cache. Also bounds the growth of rounding errors, as each tile is
/// summed on its own.
pub(super) const TILE: usize = 512;

/// Scaled position, then the weights over 4π.
pub(in crate::kernel) type PackedSource<T = f64> = [T; 6];
/// One value for each target of a block.
pub(in crate::kernel) type BlockValues<T = f64> = [T; LANES];

/// Scaled coordinates of up to [`LANES`] targets, the last repeated to fill the lanes.
#[derive(Debug, Clone, Copy)]
#[repr(align(64))]
pub(in crate::kernel) struct TargetBlock<T = f64> {
    coordinates: [BlockValues<T>; 3],
    len: usize,
}

impl<T: Scalar> TargetBlock<T> {
    /// A block of one to [`LANES`] targets whose scaled coordinates `map` gives.
    pub(in crate::kernel) fn mapped<P>(targets: &[P], map: impl Fn(&P) -> [f64; 3]) -> Self {
        let mut coordinates = [[T::default(); LANES]; 3];
        for lane in 0..LANES {
            let target = map(&targets[lane.min(targets.len() - 1)]);
            for axis in 0..3 {
                coordinates[axis][lane] = T::from_f64(target[axis]);
            }
        }
        Self {
            coordinates,
            len: targets.len(),
        }
    }

    #[inline(always)]
    fn load<V: Simd<T>>(&self, token: V::Token, vector: usize) -> [V; 3] {
        let [x, y, z] = &self.coordinates;
        let first = vector * V::WIDTH;
        [
            V::load(token, &x[first..]),
            V::load(token, &y[first..]),
            V::load(token, &z[first..]),
        ]
    }
}

/// Adds the potential of three weights at each block of targets. A fourth value, where there is one, becomes the largest
/// `1/r` if that is larger.
pub(in crate::kernel) fn add_potential<T: Scalar, const N: usize>(
    instructions: Instructions,
    sources: &[PackedSource<T>],
    targets: &[TargetBlock<T>],
    sums: &mut [[BlockValues<T>; N]],
) {
    const { assert!(N == 3 || N == 4) }
    instructions.run(PotentialLoop(sources, targets, sums));
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

/// Writes `factor / r` for the targets of all blocks, `column.len()` in all; returns the largest entry, or `None` unless
/// all are finite.
pub(in crate::kernel) fn write_column<T: Scalar>(
    instructions: Instructions,
    source: [T; 3],
    factor: T,
    targets: &[TargetBlock<T>],
    column: &mut [T],
) -> Option<T> {
    instructions.run(ColumnLoop {
        source,
        factor,
        targets,
        column,
    })
}

struct PotentialLoop<'a, T, const N: usize>(
    &'a [PackedSource<T>],
    &'a [TargetBlock<T>],
    &'a mut [[BlockValues<T>; N]],
);
struct GradientLoop<'a>(&'a [PackedSource], &'a [TargetBlock], &'a mut [[BlockValues; 12]]);

impl<T: Scalar, const N: usize> Computation<T> for PotentialLoop<'_, T, N> {
    type Output = ();

    #[inline(always)]
    fn run<V: Simd<T>>(self, token: V::Token) {
        let Self(sources, targets, sums) = self;
        for tile in sources.chunks(TILE) {
            for (block, sums) in targets.iter().zip(&mut *sums) {
                // Two vectors share each broadcast of a source where the registers hold both.
                if V::REGISTERS >= 32 && block.len > V::WIDTH {
                    for vector in (0..LANES / V::WIDTH).step_by(2) {
                        add_potential_of::<T, V, N, 2>(token, tile, block, vector, sums);
                    }
                } else {
                    for vector in 0..block.len.div_ceil(V::WIDTH) {
                        add_potential_of::<T, V, N, 1>(token, tile, block, vector, sums);
                    }
                }
            }
        }
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
fn add_potential_of<T: Scalar, V: Simd<T>, const N: usize, const VECTORS: usize>(
    token: V::Token,
    sources: &[PackedSource<T>],
    targets: &TargetBlock<T>,
    vector: usize,
    sums: &mut [BlockValues<T>; N],
) {
    let zero = V::splat(token, T::default());
    let mut x = [[zero; 3]; VECTORS];
    let mut largest = [zero; VECTORS];
    for v in 0..VECTORS {
        x[v] = targets.load(token, vector + v);
        if N > 3 {
            largest[v] = V::load(token, &sums[3][(vector + v) * V::WIDTH..]);
        }
    }
    let mut sum = [[zero; 3]; VECTORS];
    for &[sx, sy, sz, w0, w1, w2] in sources {
        let source = [V::splat(token, sx), V::splat(token, sy), V::splat(token, sz)];
        let weights = [V::splat(token, w0), V::splat(token, w1), V::splat(token, w2)];
        for v in 0..VECTORS {
            let g = norm_squared(difference(x[v], source)).reciprocal_sqrt();
            if N > 3 {
                largest[v] = g.max(largest[v]);
            }
            for i in 0..3 {
                sum[v][i] = weights[i].mul_add(g, sum[v][i]);
            }
        }
    }
    for v in 0..VECTORS {
        add(token, &sum[v], sums, vector + v);
        if N > 3 {
            largest[v].store(&mut sums[3][(vector + v) * V::WIDTH..]);
        }
    }
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

struct ColumnLoop<'a, T> {
    source: [T; 3],
    factor: T,
    targets: &'a [TargetBlock<T>],
    column: &'a mut [T],
}

impl<T: Scalar> Computation<T> for ColumnLoop<'_, T> {
    type Output = Option<T>;

    #[inline(always)]
    fn run<V: Simd<T>>(self, token: V::Token) -> Option<T> {
        let [x, y, z] = self.source;
        let source = [V::splat(token, x), V::splat(token, y), V::splat(token, z)];
        let factor = V::splat(token, self.factor);
        let zero = V::splat(token, T::default());
        let mut written = Written {
            sum: zero,
            largest: zero,
        };
        let (full, rest) = self.column.as_chunks_mut();
        for (block, out) in self.targets.iter().zip(&mut *full) {
            written = write_block(token, source, factor, block, out, written);
        }
        if let Some(block) = self.targets.get(full.len()) {
            let mut out = [T::default(); LANES];
            written = write_block(token, source, factor, block, &mut out, written);
            rest.copy_from_slice(&out[..rest.len()]);
        }
        let mut lanes = [T::default(); LANES];
        written.sum.store(&mut lanes);
        let is_finite = lanes.iter().map(|lane| lane.to_f64()).sum::<f64>().is_finite();
        written.largest.store(&mut lanes);
        let largest = lanes.iter().map(|lane| lane.to_f64()).fold(0.0, f64::max);
        is_finite.then(|| T::from_f64(largest))
    }
}

/// What tells of the entries written so far, lane by lane.
#[derive(Clone, Copy)]
struct Written<V> {
    /// Not finite once an entry is not.
    sum: V,
    largest: V,
}

#[inline(always)]
fn write_block<T: Scalar, V: Simd<T>>(
    token: V::Token,
    source: [V; 3],
    factor: V,
    block: &TargetBlock<T>,
    out: &mut BlockValues<T>,
    mut written: Written<V>,
) -> Written<V> {
    for vector in 0..LANES / V::WIDTH {
        let value = factor * norm_squared(difference(block.load(token, vector), source)).reciprocal_sqrt();
        written.sum = written.sum + value;
        written.largest = value.max(written.largest);
        value.store(&mut out[vector * V::WIDTH..]);
    }
    written
}

#[inline(always)]
fn difference<T, V: Simd<T>>(x: [V; 3], y: [V; 3]) -> [V; 3] {
    [x[0] - y[0], x[1] - y[1], x[2] - y[2]]
}

#[inline(always)]
fn norm_squared<T, V: Simd<T>>(d: [V; 3]) -> V {
    d[2].mul_add(d[2], d[1].mul_add(d[1], d[0] * d[0]))
}

#[inline(always)]
fn add<T: Scalar, V: Simd<T>>(token: V::Token, sum: &[V], sums: &mut [BlockValues<T>], vector: usize) {
    for (&sum, lanes) in sum.iter().zip(sums) {
        let lanes = &mut lanes[vector * V::WIDTH..];
        (V::load(token, lanes) + sum).store(lanes);
    }
}

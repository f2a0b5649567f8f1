//! The inner loops in AVX-512F: eight targets to a vector.

use std::arch::x86_64::*;

use super::{BlockValues, LANES, Lanes, PackedSource, TargetBlock};

const WIDTH: usize = 8;

/// Proof that the processor has AVX-512F.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Avx512(());

impl Avx512 {
    pub(super) fn detect() -> Option<Self> {
        is_x86_feature_detected!("avx512f").then_some(Self(()))
    }
}

impl Lanes for Avx512 {
    fn add_potential(self, sources: &[PackedSource], targets: &TargetBlock, sums: &mut [BlockValues; 3]) {
        if targets.len > WIDTH {
            // SAFETY: `self` exists only where `detect` found AVX-512F.
            unsafe { add_potential::<2>(sources, targets, sums) }
        } else {
            // SAFETY: as above.
            unsafe { add_potential::<1>(sources, targets, sums) }
        }
    }

    fn add_gradient(self, sources: &[PackedSource], targets: &TargetBlock, sums: &mut [BlockValues; 12]) {
        // SAFETY: `self` exists only where `detect` found AVX-512F.
        unsafe { add_gradient(sources, targets, sums) }
    }

    fn write_column(self, source: [f64; 3], factor: f64, targets: &[TargetBlock], column: &mut [f64]) -> bool {
        // SAFETY: `self` exists only where `detect` found AVX-512F.
        unsafe { write_column(source, factor, targets, column) }
    }
}

/// For the first `VECTORS` vectors of the block together, so that each broadcast of a source serves both.
#[target_feature(enable = "avx512f")]
fn add_potential<const VECTORS: usize>(sources: &[PackedSource], targets: &TargetBlock, sums: &mut [BlockValues; 3]) {
    let mut x = [[_mm512_setzero_pd(); 3]; VECTORS];
    for (v, x) in x.iter_mut().enumerate() {
        *x = load_point(targets, v);
    }
    let mut sum = [[_mm512_setzero_pd(); 3]; VECTORS];
    for &[sx, sy, sz, w0, w1, w2] in sources {
        let source = [_mm512_set1_pd(sx), _mm512_set1_pd(sy), _mm512_set1_pd(sz)];
        let weights = [_mm512_set1_pd(w0), _mm512_set1_pd(w1), _mm512_set1_pd(w2)];
        for v in 0..VECTORS {
            let g = reciprocal_sqrt(square(difference(x[v], source)));
            for i in 0..3 {
                sum[v][i] = _mm512_fmadd_pd(weights[i], g, sum[v][i]);
            }
        }
    }
    for (v, sum) in sum.iter().enumerate() {
        add(sum, sums, v);
    }
}

#[target_feature(enable = "avx512f")]
fn add_gradient(sources: &[PackedSource], targets: &TargetBlock, sums: &mut [BlockValues; 12]) {
    for v in 0..targets.vectors(WIDTH) {
        let x = load_point(targets, v);
        let mut sum = [_mm512_setzero_pd(); 12];
        for &[sx, sy, sz, w0, w1, w2] in sources {
            let source = [_mm512_set1_pd(sx), _mm512_set1_pd(sy), _mm512_set1_pd(sz)];
            let weights = [_mm512_set1_pd(w0), _mm512_set1_pd(w1), _mm512_set1_pd(w2)];
            let d = difference(x, source);
            let g = reciprocal_sqrt(square(d));
            let g3 = _mm512_mul_pd(_mm512_mul_pd(g, g), g);
            for i in 0..3 {
                sum[i] = _mm512_fmadd_pd(weights[i], g, sum[i]);
                let wg3 = _mm512_mul_pd(weights[i], g3);
                for k in 0..3 {
                    sum[3 + 3 * i + k] = _mm512_fmadd_pd(wg3, d[k], sum[3 + 3 * i + k]);
                }
            }
        }
        add(&sum, sums, v);
    }
}

#[target_feature(enable = "avx512f")]
fn write_column(source: [f64; 3], factor: f64, targets: &[TargetBlock], column: &mut [f64]) -> bool {
    let source = [
        _mm512_set1_pd(source[0]),
        _mm512_set1_pd(source[1]),
        _mm512_set1_pd(source[2]),
    ];
    let factor = _mm512_set1_pd(factor);
    let mut check = _mm512_setzero_pd();
    let mut write = |block: &TargetBlock, out: &mut BlockValues| {
        for (v, out) in out.as_chunks_mut().0.iter_mut().enumerate() {
            let g = reciprocal_sqrt(square(difference(load_point(block, v), source)));
            let value = _mm512_mul_pd(factor, g);
            check = _mm512_add_pd(check, value);
            store(out, value);
        }
    };
    let (full, rest) = column.as_chunks_mut();
    for (block, out) in targets.iter().zip(&mut *full) {
        write(block, out);
    }
    if let Some(block) = targets.get(full.len()) {
        let mut out = [0.0; LANES];
        write(block, &mut out);
        rest.copy_from_slice(&out[..rest.len()]);
    }
    _mm512_reduce_add_pd(check).is_finite()
}

/// `1/√s` to 2⁻⁵³ or so before rounding. From an estimate `y` with `h = 1 − s y²`, `|h| ≤ 2⁻¹³`, the step of fourth
/// order `y (1 + h/2 + 3h²/8 + 5h³/16)` leaves `35 h⁴/128`. NaN for zero and for infinity.
#[inline]
#[target_feature(enable = "avx512f")]
fn reciprocal_sqrt(s: __m512d) -> __m512d {
    let y = _mm512_rsqrt14_pd(s);
    let h = _mm512_fnmadd_pd(_mm512_mul_pd(s, y), y, _mm512_set1_pd(1.0));
    let series = _mm512_fmadd_pd(h, _mm512_set1_pd(5.0 / 16.0), _mm512_set1_pd(3.0 / 8.0));
    let series = _mm512_fmadd_pd(h, series, _mm512_set1_pd(0.5));
    _mm512_fmadd_pd(_mm512_mul_pd(y, h), series, y)
}

#[inline]
#[target_feature(enable = "avx512f")]
fn difference(x: [__m512d; 3], y: [__m512d; 3]) -> [__m512d; 3] {
    [
        _mm512_sub_pd(x[0], y[0]),
        _mm512_sub_pd(x[1], y[1]),
        _mm512_sub_pd(x[2], y[2]),
    ]
}

#[inline]
#[target_feature(enable = "avx512f")]
fn square(d: [__m512d; 3]) -> __m512d {
    _mm512_fmadd_pd(d[2], d[2], _mm512_fmadd_pd(d[1], d[1], _mm512_mul_pd(d[0], d[0])))
}

#[inline]
#[target_feature(enable = "avx512f")]
fn load_point(block: &TargetBlock, vector: usize) -> [__m512d; 3] {
    let [x, y, z] = &block.coordinates;
    [
        load(&x.as_chunks().0[vector]),
        load(&y.as_chunks().0[vector]),
        load(&z.as_chunks().0[vector]),
    ]
}

#[inline]
#[target_feature(enable = "avx512f")]
fn add(sum: &[__m512d], sums: &mut [BlockValues], vector: usize) {
    for (&sum, lane) in sum.iter().zip(sums) {
        let lane = &mut lane.as_chunks_mut().0[vector];
        store(lane, _mm512_add_pd(load(lane), sum));
    }
}

#[inline]
#[target_feature(enable = "avx512f")]
fn load(values: &[f64; WIDTH]) -> __m512d {
    // SAFETY: the reference covers the values read, and the instruction asks for no alignment.
    unsafe { _mm512_loadu_pd(values.as_ptr()) }
}

#[inline]
#[target_feature(enable = "avx512f")]
fn store(values: &mut [f64; WIDTH], vector: __m512d) {
    // SAFETY: the reference covers the values written, and the instruction asks for no alignment.
    unsafe { _mm512_storeu_pd(values.as_mut_ptr(), vector) }
}

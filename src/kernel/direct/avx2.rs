//! The inner loops in AVX2 and FMA: four targets to a vector.
//!
//! One vector at a time: a second would not fit the sixteen registers, and the sources come from the first-level cache.

use std::arch::x86_64::*;

use super::{BlockValues, LANES, Lanes, PackedSource, TargetBlock};

const WIDTH: usize = 4;

/// Proof that the processor has AVX2 and FMA.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Avx2(());

impl Avx2 {
    pub(super) fn detect() -> Option<Self> {
        (is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma")).then_some(Self(()))
    }
}

impl Lanes for Avx2 {
    fn add_potential(self, sources: &[PackedSource], targets: &TargetBlock, sums: &mut [BlockValues; 3]) {
        // SAFETY: `self` exists only where `detect` found AVX2 and FMA.
        unsafe { add_potential(sources, targets, sums) }
    }

    fn add_gradient(self, sources: &[PackedSource], targets: &TargetBlock, sums: &mut [BlockValues; 12]) {
        // SAFETY: `self` exists only where `detect` found AVX2 and FMA.
        unsafe { add_gradient(sources, targets, sums) }
    }

    fn write_column(self, source: [f64; 3], factor: f64, targets: &[TargetBlock], column: &mut [f64]) -> bool {
        // SAFETY: `self` exists only where `detect` found AVX2 and FMA.
        unsafe { write_column(source, factor, targets, column) }
    }
}

#[target_feature(enable = "avx2,fma")]
fn add_potential(sources: &[PackedSource], targets: &TargetBlock, sums: &mut [BlockValues; 3]) {
    for v in 0..targets.vectors(WIDTH) {
        let x = load_point(targets, v);
        let mut sum = [_mm256_setzero_pd(); 3];
        for &[sx, sy, sz, w0, w1, w2] in sources {
            let source = [_mm256_set1_pd(sx), _mm256_set1_pd(sy), _mm256_set1_pd(sz)];
            let g = reciprocal_sqrt(square(difference(x, source)));
            sum[0] = _mm256_fmadd_pd(_mm256_set1_pd(w0), g, sum[0]);
            sum[1] = _mm256_fmadd_pd(_mm256_set1_pd(w1), g, sum[1]);
            sum[2] = _mm256_fmadd_pd(_mm256_set1_pd(w2), g, sum[2]);
        }
        add(&sum, sums, v);
    }
}

#[target_feature(enable = "avx2,fma")]
fn add_gradient(sources: &[PackedSource], targets: &TargetBlock, sums: &mut [BlockValues; 12]) {
    for v in 0..targets.vectors(WIDTH) {
        let x = load_point(targets, v);
        let mut sum = [_mm256_setzero_pd(); 12];
        for &[sx, sy, sz, w0, w1, w2] in sources {
            let source = [_mm256_set1_pd(sx), _mm256_set1_pd(sy), _mm256_set1_pd(sz)];
            let d = difference(x, source);
            let g = reciprocal_sqrt(square(d));
            let g3 = _mm256_mul_pd(_mm256_mul_pd(g, g), g);
            for (i, w) in [w0, w1, w2].into_iter().enumerate() {
                let w = _mm256_set1_pd(w);
                sum[i] = _mm256_fmadd_pd(w, g, sum[i]);
                let wg3 = _mm256_mul_pd(w, g3);
                for k in 0..3 {
                    sum[3 + 3 * i + k] = _mm256_fmadd_pd(wg3, d[k], sum[3 + 3 * i + k]);
                }
            }
        }
        add(&sum, sums, v);
    }
}

#[target_feature(enable = "avx2,fma")]
fn write_column(source: [f64; 3], factor: f64, targets: &[TargetBlock], column: &mut [f64]) -> bool {
    let source = [
        _mm256_set1_pd(source[0]),
        _mm256_set1_pd(source[1]),
        _mm256_set1_pd(source[2]),
    ];
    let factor = _mm256_set1_pd(factor);
    let mut check = _mm256_setzero_pd();
    let mut write = |block: &TargetBlock, out: &mut BlockValues| {
        for (v, out) in out.as_chunks_mut().0.iter_mut().enumerate() {
            let g = reciprocal_sqrt(square(difference(load_point(block, v), source)));
            let value = _mm256_mul_pd(factor, g);
            check = _mm256_add_pd(check, value);
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
    let mut lanes = [0.0; WIDTH];
    store(&mut lanes, check);
    lanes.iter().sum::<f64>().is_finite()
}

/// `1/√s` to 2⁻⁵³ or so before rounding, for `s` in the range of `f32`. From an estimate `y` in single precision with
/// `h = 1 − s y²`, `|h| ≤ 3·2⁻¹²`, the step of fifth order `y (1 + h/2 + 3h²/8 + 5h³/16 + 35h⁴/128)` leaves
/// `63 h⁵/256`. Below that range, NaN or infinite; above it, zero.
#[inline]
#[target_feature(enable = "avx2,fma")]
fn reciprocal_sqrt(s: __m256d) -> __m256d {
    let y = _mm256_cvtps_pd(_mm_rsqrt_ps(_mm256_cvtpd_ps(s)));
    let h = _mm256_fnmadd_pd(_mm256_mul_pd(s, y), y, _mm256_set1_pd(1.0));
    let series = _mm256_fmadd_pd(h, _mm256_set1_pd(35.0 / 128.0), _mm256_set1_pd(5.0 / 16.0));
    let series = _mm256_fmadd_pd(h, series, _mm256_set1_pd(3.0 / 8.0));
    let series = _mm256_fmadd_pd(h, series, _mm256_set1_pd(0.5));
    _mm256_fmadd_pd(_mm256_mul_pd(y, h), series, y)
}

#[inline]
#[target_feature(enable = "avx2,fma")]
fn difference(x: [__m256d; 3], y: [__m256d; 3]) -> [__m256d; 3] {
    [
        _mm256_sub_pd(x[0], y[0]),
        _mm256_sub_pd(x[1], y[1]),
        _mm256_sub_pd(x[2], y[2]),
    ]
}

#[inline]
#[target_feature(enable = "avx2,fma")]
fn square(d: [__m256d; 3]) -> __m256d {
    _mm256_fmadd_pd(d[2], d[2], _mm256_fmadd_pd(d[1], d[1], _mm256_mul_pd(d[0], d[0])))
}

#[inline]
#[target_feature(enable = "avx2,fma")]
fn load_point(block: &TargetBlock, vector: usize) -> [__m256d; 3] {
    let [x, y, z] = &block.coordinates;
    [
        load(&x.as_chunks().0[vector]),
        load(&y.as_chunks().0[vector]),
        load(&z.as_chunks().0[vector]),
    ]
}

#[inline]
#[target_feature(enable = "avx2,fma")]
fn add(sum: &[__m256d], sums: &mut [BlockValues], vector: usize) {
    for (&sum, lane) in sum.iter().zip(sums) {
        let lane = &mut lane.as_chunks_mut().0[vector];
        store(lane, _mm256_add_pd(load(lane), sum));
    }
}

#[inline]
#[target_feature(enable = "avx2,fma")]
fn load(values: &[f64; WIDTH]) -> __m256d {
    // SAFETY: the reference covers the values read, and the instruction asks for no alignment.
    unsafe { _mm256_loadu_pd(values.as_ptr()) }
}

#[inline]
#[target_feature(enable = "avx2,fma")]
fn store(values: &mut [f64; WIDTH], vector: __m256d) {
    // SAFETY: the reference covers the values written, and the instruction asks for no alignment.
    unsafe { _mm256_storeu_pd(values.as_mut_ptr(), vector) }
}

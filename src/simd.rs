//! Vectors of `f64` or `f32` in AVX-512, AVX2 or portable Rust, chosen at run time.
//!
//! An inner loop is written once, as a [`Computation`] generic over [`Simd`], and [`Instructions::run`] compiles it for
//! each set of instructions. Vectors are made through a token that exists only where the processor has the
//! instructions, so that code which holds a vector may calculate with it.
//!
//! pulp, on which faer is built, was tried in place of this. It lacks the instructions that estimate reciprocals and
//! reciprocal square roots, which make the kernel sums twice as fast, and its AVX-512 is a cargo feature that changes
//! the results of faer too.

use std::array::from_fn;
use std::ops::{Add, Div, Mul, Neg, Sub};

/// A set of vector instructions that this machine has been found to have.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Instructions(InstructionSet);

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum InstructionSet {
    #[cfg(target_arch = "x86_64")]
    Avx512(x86::Avx512),
    #[cfg(target_arch = "x86_64")]
    Avx2(x86::Avx2),
    Portable,
}

impl Instructions {
    /// Those of plain Rust, which are always there.
    pub(crate) const PORTABLE: Self = Self(InstructionSet::Portable);

    /// The fastest of [`Self::available`].
    pub fn detect() -> Self {
        Self::available().next().unwrap_or(Self::PORTABLE)
    }

    /// All that this machine has, fastest first; the last is the portable one.
    pub fn available() -> impl Iterator<Item = Self> {
        [
            #[cfg(target_arch = "x86_64")]
            x86::Avx512::detect().map(InstructionSet::Avx512),
            #[cfg(target_arch = "x86_64")]
            x86::Avx2::detect().map(InstructionSet::Avx2),
            Some(InstructionSet::Portable),
        ]
        .into_iter()
        .flatten()
        .map(Self)
    }

    /// `"avx512"`, `"avx2"` or `"portable"`.
    pub fn name(self) -> &'static str {
        match self.0 {
            #[cfg(target_arch = "x86_64")]
            InstructionSet::Avx512(_) => "avx512",
            #[cfg(target_arch = "x86_64")]
            InstructionSet::Avx2(_) => "avx2",
            InstructionSet::Portable => "portable",
        }
    }

    pub(crate) fn run<C: Computation>(self, computation: C) -> C::Output {
        match self.0 {
            #[cfg(target_arch = "x86_64")]
            // SAFETY: the token exists only where AVX-512F was found.
            InstructionSet::Avx512(token) => unsafe { x86::run_avx512(token, computation) },
            #[cfg(target_arch = "x86_64")]
            // SAFETY: the token exists only where AVX2 and FMA were found.
            InstructionSet::Avx2(token) => unsafe { x86::run_avx2(token, computation) },
            InstructionSet::Portable => computation.run::<Portable<4>>(()),
        }
    }
}

/// A loop over vectors of any set of instructions.
///
/// `run` and all that it calls with vectors must be `#[inline(always)]`: only what is inlined into
/// [`Instructions::run`] is compiled for the instructions.
pub(crate) trait Computation {
    type Output;

    fn run<V: Simd>(self, token: V::Token) -> Self::Output;
}

/// A vector of `f64`.
pub(crate) trait Simd: Vector<f64> {
    /// A vector of twice as many `f32`.
    type Single: Vector<f32, Token = Self::Token>;

    /// The first half of the values, and the second.
    fn widened(single: Self::Single) -> [Self; 2];
}

/// A vector of [`Self::WIDTH`] values.
pub(crate) trait Vector<T>:
    Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Div<Output = Self> + Neg<Output = Self>
{
    /// Proof that the processor can calculate with these.
    type Token: Copy;
    const WIDTH: usize;
    /// How many vectors the processor can hold in registers.
    const REGISTERS: usize;

    fn splat(token: Self::Token, value: T) -> Self;
    /// The first [`Self::WIDTH`] values.
    fn load(token: Self::Token, values: &[T]) -> Self;
    fn store(self, values: &mut [T]);
    /// `self * factor + summand`, rounded once where the processor can.
    fn mul_add(self, factor: Self, summand: Self) -> Self;
    /// `1 / self` to a unit in the last place, or two of `f32`; infinite or NaN for zero.
    fn reciprocal(self) -> Self;
    /// `1 / √self` to a unit in the last place, or three of `f32`. Not finite for zero, NaN for infinity; AVX2 has the
    /// range of `f32` only.
    fn reciprocal_sqrt(self) -> Self;
    fn sqrt(self) -> Self;
    fn abs(self) -> Self;
    /// The larger of each two; either where one is NaN.
    fn max(self, other: Self) -> Self;
    /// A bit for each value where `self < other`; never for NaN.
    fn less(self, other: Self) -> u32;
    /// `yes` where `self < other`, else `no`.
    fn if_less(self, other: Self, yes: Self, no: Self) -> Self;
}

/// `N` values in plain Rust, which compilers turn into whatever vectors the target has by default.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Portable<const N: usize, T = f64>(pub(crate) [T; N]);

macro_rules! portable_operator {
    ($scalar:ident, $operator:ident, $function:ident) => {
        impl<const N: usize> $operator for Portable<N, $scalar> {
            type Output = Self;

            #[inline(always)]
            fn $function(self, other: Self) -> Self {
                Self(from_fn(|i| self.0[i].$function(other.0[i])))
            }
        }
    };
}

macro_rules! portable {
    ($scalar:ident) => {
        portable_operator!($scalar, Add, add);
        portable_operator!($scalar, Sub, sub);
        portable_operator!($scalar, Mul, mul);
        portable_operator!($scalar, Div, div);

        impl<const N: usize> Neg for Portable<N, $scalar> {
            type Output = Self;

            #[inline(always)]
            fn neg(self) -> Self {
                Self(self.0.map(|a| -a))
            }
        }

        impl<const N: usize> Vector<$scalar> for Portable<N, $scalar> {
            type Token = ();
            const WIDTH: usize = N;
            const REGISTERS: usize = 8;

            #[inline(always)]
            fn splat((): (), value: $scalar) -> Self {
                Self([value; N])
            }

            #[inline(always)]
            fn load((): (), values: &[$scalar]) -> Self {
                let values = &values[..N];
                Self(from_fn(|i| values[i]))
            }

            #[inline(always)]
            fn store(self, values: &mut [$scalar]) {
                values[..N].copy_from_slice(&self.0);
            }

            // Where the instruction is missing, a call to emulate it costs more than the digit is worth.
            #[inline(always)]
            fn mul_add(self, factor: Self, summand: Self) -> Self {
                self * factor + summand
            }

            #[inline(always)]
            fn reciprocal(self) -> Self {
                Self(self.0.map(|a| 1.0 / a))
            }

            #[inline(always)]
            fn reciprocal_sqrt(self) -> Self {
                // The last term makes the result NaN for infinity, as in the other implementations.
                Self(self.0.map(|a| 1.0 / a.sqrt() + 0.0 * a))
            }

            #[inline(always)]
            fn sqrt(self) -> Self {
                Self(self.0.map($scalar::sqrt))
            }

            #[inline(always)]
            fn abs(self) -> Self {
                Self(self.0.map($scalar::abs))
            }

            #[inline(always)]
            fn max(self, other: Self) -> Self {
                other.if_less(self, self, other)
            }

            #[inline(always)]
            fn less(self, other: Self) -> u32 {
                (0..N).fold(0, |bits, i| bits | u32::from(self.0[i] < other.0[i]) << i)
            }

            #[inline(always)]
            fn if_less(self, other: Self, yes: Self, no: Self) -> Self {
                Self(from_fn(
                    |i| if self.0[i] < other.0[i] { yes.0[i] } else { no.0[i] },
                ))
            }
        }
    };
}

portable!(f64);
portable!(f32);

macro_rules! portable_single {
    ($($half:literal, $width:literal;)*) => {
        $(impl Simd for Portable<$half> {
            type Single = Portable<$width, f32>;

            #[inline(always)]
            fn widened(single: Self::Single) -> [Self; 2] {
                [0, $half].map(|first| Self(from_fn(|i| f64::from(single.0[first + i]))))
            }
        })*
    };
}

// One: formulas of vectors for a single value.
portable_single!(1, 2; 4, 8;);

#[cfg(target_arch = "x86_64")]
mod x86 {
    use std::arch::x86_64::*;
    use std::ops::{Add, Div, Mul, Neg, Sub};

    use super::{Computation, Simd, Vector};

    /// Proof that the processor has AVX-512F.
    #[derive(Debug, Clone, Copy, PartialEq, Eq)]
    pub(crate) struct Avx512(());

    impl Avx512 {
        pub(super) fn detect() -> Option<Self> {
            is_x86_feature_detected!("avx512f").then_some(Self(()))
        }
    }

    /// Proof that the processor has AVX2 and FMA.
    #[derive(Debug, Clone, Copy, PartialEq, Eq)]
    pub(crate) struct Avx2(());

    impl Avx2 {
        pub(super) fn detect() -> Option<Self> {
            (is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma")).then_some(Self(()))
        }
    }

    #[target_feature(enable = "avx512f")]
    pub(super) fn run_avx512<C: Computation>(token: Avx512, computation: C) -> C::Output {
        computation.run::<F64x8>(token)
    }

    #[target_feature(enable = "avx2,fma")]
    pub(super) fn run_avx2<C: Computation>(token: Avx2, computation: C) -> C::Output {
        computation.run::<F64x4>(token)
    }

    macro_rules! operator {
        ($name:ident, $operator:ident, $function:ident, $instruction:ident) => {
            impl $operator for $name {
                type Output = Self;

                #[inline(always)]
                fn $function(self, other: Self) -> Self {
                    // SAFETY: the token that made these vectors proves that the processor has the instruction.
                    Self(unsafe { $instruction(self.0, other.0) })
                }
            }
        };
    }

    // What looks like closures below is pasted into the functions: a closure may be compiled apart, without the
    // instructions, and a call of it costs more than what it does.
    macro_rules! simd {
        (
            $name:ident, $scalar:ty, $token:ident, $vector:ty, $width:literal, $registers:literal,
            $set1:ident, $loadu:ident, $storeu:ident, $add:ident, $sub:ident, $mul:ident, $div:ident, $fma:ident,
            $sqrt:ident, $max:ident,
            |$ra:ident| $reciprocal:expr,
            |$rsa:ident| $reciprocal_sqrt:expr,
            |$aa:ident| $abs:expr,
            |$la:ident, $lb:ident| $less:expr,
            |$ia:ident, $ib:ident, $yes:ident, $no:ident| $if_less:expr
        ) => {
            /// Made from a token only, hence only where the instructions are.
            #[derive(Debug, Clone, Copy)]
            pub(crate) struct $name($vector);

            operator!($name, Add, add, $add);
            operator!($name, Sub, sub, $sub);
            operator!($name, Mul, mul, $mul);
            operator!($name, Div, div, $div);

            impl Neg for $name {
                type Output = Self;

                #[inline(always)]
                fn neg(self) -> Self {
                    // SAFETY: the token that made these vectors proves that the processor has the instructions.
                    Self(unsafe { $sub($set1(-0.0), self.0) })
                }
            }

            impl Vector<$scalar> for $name {
                type Token = $token;
                const WIDTH: usize = $width;
                const REGISTERS: usize = $registers;

                #[inline(always)]
                fn splat(_: $token, value: $scalar) -> Self {
                    // SAFETY: the token proves that the processor has the instruction.
                    Self(unsafe { $set1(value) })
                }

                #[inline(always)]
                fn load(_: $token, values: &[$scalar]) -> Self {
                    let values = &values[..$width];
                    // SAFETY: the token proves that the processor has the instruction; the slice covers what it reads.
                    Self(unsafe { $loadu(values.as_ptr()) })
                }

                #[inline(always)]
                fn store(self, values: &mut [$scalar]) {
                    let values = &mut values[..$width];
                    // SAFETY: as for loading; the slice covers what is written.
                    unsafe { $storeu(values.as_mut_ptr(), self.0) }
                }

                #[inline(always)]
                fn mul_add(self, factor: Self, summand: Self) -> Self {
                    // SAFETY: the token that made these vectors proves that the processor has the instruction.
                    Self(unsafe { $fma(self.0, factor.0, summand.0) })
                }

                #[inline(always)]
                fn reciprocal(self) -> Self {
                    let $ra = self.0;
                    // SAFETY: the token that made these vectors proves that the processor has the instructions.
                    Self(unsafe { $reciprocal })
                }

                #[inline(always)]
                fn reciprocal_sqrt(self) -> Self {
                    let $rsa = self.0;
                    // SAFETY: the token that made these vectors proves that the processor has the instructions.
                    Self(unsafe { $reciprocal_sqrt })
                }

                #[inline(always)]
                fn sqrt(self) -> Self {
                    // SAFETY: the token that made these vectors proves that the processor has the instruction.
                    Self(unsafe { $sqrt(self.0) })
                }

                #[inline(always)]
                fn max(self, other: Self) -> Self {
                    // SAFETY: the token that made these vectors proves that the processor has the instruction.
                    Self(unsafe { $max(self.0, other.0) })
                }

                #[inline(always)]
                fn abs(self) -> Self {
                    let $aa = self.0;
                    // SAFETY: the token that made these vectors proves that the processor has the instructions.
                    Self(unsafe { $abs })
                }

                #[inline(always)]
                fn less(self, other: Self) -> u32 {
                    let ($la, $lb) = (self.0, other.0);
                    // SAFETY: the token that made these vectors proves that the processor has the instructions.
                    unsafe { $less }
                }

                #[inline(always)]
                fn if_less(self, other: Self, yes: Self, no: Self) -> Self {
                    let ($ia, $ib, $yes, $no) = (self.0, other.0, yes.0, no.0);
                    // SAFETY: the token that made these vectors proves that the processor has the instructions.
                    Self(unsafe { $if_less })
                }
            }
        };
    }

    simd!(
        F64x8,
        f64,
        Avx512,
        __m512d,
        8,
        32,
        _mm512_set1_pd,
        _mm512_loadu_pd,
        _mm512_storeu_pd,
        _mm512_add_pd,
        _mm512_sub_pd,
        _mm512_mul_pd,
        _mm512_div_pd,
        _mm512_fmadd_pd,
        _mm512_sqrt_pd,
        _mm512_max_pd,
        // Newton's method on an estimate of 14 bits: division takes several times as long.
        |a| {
            let one = _mm512_set1_pd(1.0);
            let estimate = _mm512_rcp14_pd(a);
            let estimate = _mm512_fmadd_pd(estimate, _mm512_fnmadd_pd(a, estimate, one), estimate);
            _mm512_fmadd_pd(estimate, _mm512_fnmadd_pd(a, estimate, one), estimate)
        },
        // From an estimate `y` with `h = 1 − s y²`, `|h| ≤ 2⁻¹³`, Householder's step of fourth order
        // `y (1 + h/2 + 3h²/8 + 5h³/16)` leaves `35 h⁴/128`.
        |s| {
            let y = _mm512_rsqrt14_pd(s);
            let h = _mm512_fnmadd_pd(_mm512_mul_pd(s, y), y, _mm512_set1_pd(1.0));
            let series = _mm512_fmadd_pd(h, _mm512_set1_pd(5.0 / 16.0), _mm512_set1_pd(3.0 / 8.0));
            let series = _mm512_fmadd_pd(h, series, _mm512_set1_pd(0.5));
            _mm512_fmadd_pd(_mm512_mul_pd(y, h), series, y)
        },
        |a| _mm512_abs_pd(a),
        |a, b| u32::from(_mm512_cmp_pd_mask::<_CMP_LT_OQ>(a, b)),
        |a, b, yes, no| _mm512_mask_blend_pd(_mm512_cmp_pd_mask::<_CMP_LT_OQ>(a, b), no, yes)
    );

    simd!(
        F64x4,
        f64,
        Avx2,
        __m256d,
        4,
        16,
        _mm256_set1_pd,
        _mm256_loadu_pd,
        _mm256_storeu_pd,
        _mm256_add_pd,
        _mm256_sub_pd,
        _mm256_mul_pd,
        _mm256_div_pd,
        _mm256_fmadd_pd,
        _mm256_sqrt_pd,
        _mm256_max_pd,
        |a| _mm256_div_pd(_mm256_set1_pd(1.0), a),
        // From an estimate `y` in single precision with `h = 1 − s y²`, `|h| ≤ 3·2⁻¹²`, the step of fifth order
        // `y (1 + h/2 + 3h²/8 + 5h³/16 + 35h⁴/128)` leaves `63 h⁵/256`. Below the range of `f32` the result is NaN or
        // infinite; above it, zero.
        |s| {
            let y = _mm256_cvtps_pd(_mm_rsqrt_ps(_mm256_cvtpd_ps(s)));
            let h = _mm256_fnmadd_pd(_mm256_mul_pd(s, y), y, _mm256_set1_pd(1.0));
            let series = _mm256_fmadd_pd(h, _mm256_set1_pd(35.0 / 128.0), _mm256_set1_pd(5.0 / 16.0));
            let series = _mm256_fmadd_pd(h, series, _mm256_set1_pd(3.0 / 8.0));
            let series = _mm256_fmadd_pd(h, series, _mm256_set1_pd(0.5));
            _mm256_fmadd_pd(_mm256_mul_pd(y, h), series, y)
        },
        |a| _mm256_andnot_pd(_mm256_set1_pd(-0.0), a),
        |a, b| _mm256_movemask_pd(_mm256_cmp_pd::<_CMP_LT_OQ>(a, b)) as u32,
        |a, b, yes, no| _mm256_blendv_pd(no, yes, _mm256_cmp_pd::<_CMP_LT_OQ>(a, b))
    );

    simd!(
        F32x16,
        f32,
        Avx512,
        __m512,
        16,
        32,
        _mm512_set1_ps,
        _mm512_loadu_ps,
        _mm512_storeu_ps,
        _mm512_add_ps,
        _mm512_sub_ps,
        _mm512_mul_ps,
        _mm512_div_ps,
        _mm512_fmadd_ps,
        _mm512_sqrt_ps,
        _mm512_max_ps,
        |a| {
            let estimate = _mm512_rcp14_ps(a);
            _mm512_fmadd_ps(estimate, _mm512_fnmadd_ps(a, estimate, _mm512_set1_ps(1.0)), estimate)
        },
        // Newton's step `y (1 + h/2)` leaves `3 h²/8`.
        |s| {
            let y = _mm512_rsqrt14_ps(s);
            let h = _mm512_fnmadd_ps(_mm512_mul_ps(s, y), y, _mm512_set1_ps(1.0));
            _mm512_fmadd_ps(_mm512_mul_ps(y, h), _mm512_set1_ps(0.5), y)
        },
        |a| _mm512_abs_ps(a),
        |a, b| u32::from(_mm512_cmp_ps_mask::<_CMP_LT_OQ>(a, b)),
        |a, b, yes, no| _mm512_mask_blend_ps(_mm512_cmp_ps_mask::<_CMP_LT_OQ>(a, b), no, yes)
    );

    simd!(
        F32x8,
        f32,
        Avx2,
        __m256,
        8,
        16,
        _mm256_set1_ps,
        _mm256_loadu_ps,
        _mm256_storeu_ps,
        _mm256_add_ps,
        _mm256_sub_ps,
        _mm256_mul_ps,
        _mm256_div_ps,
        _mm256_fmadd_ps,
        _mm256_sqrt_ps,
        _mm256_max_ps,
        |a| _mm256_div_ps(_mm256_set1_ps(1.0), a),
        // Newton's step `y (1 + h/2)` leaves `3 h²/8`, with `|h| ≤ 3·2⁻¹²` three units in the last place.
        |s| {
            let y = _mm256_rsqrt_ps(s);
            let h = _mm256_fnmadd_ps(_mm256_mul_ps(s, y), y, _mm256_set1_ps(1.0));
            _mm256_fmadd_ps(_mm256_mul_ps(y, h), _mm256_set1_ps(0.5), y)
        },
        |a| _mm256_andnot_ps(_mm256_set1_ps(-0.0), a),
        |a, b| _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_LT_OQ>(a, b)) as u32,
        |a, b, yes, no| _mm256_blendv_ps(no, yes, _mm256_cmp_ps::<_CMP_LT_OQ>(a, b))
    );

    impl Simd for F64x8 {
        type Single = F32x16;

        #[inline(always)]
        fn widened(F32x16(single): F32x16) -> [Self; 2] {
            // SAFETY: the token that made this vector proves that the processor has the instructions.
            unsafe {
                let upper = _mm256_castpd_ps(_mm512_extractf64x4_pd::<1>(_mm512_castps_pd(single)));
                let lower = _mm512_castps512_ps256(single);
                [Self(_mm512_cvtps_pd(lower)), Self(_mm512_cvtps_pd(upper))]
            }
        }
    }

    impl Simd for F64x4 {
        type Single = F32x8;

        #[inline(always)]
        fn widened(F32x8(single): F32x8) -> [Self; 2] {
            // SAFETY: the token that made this vector proves that the processor has the instructions.
            unsafe {
                let halves = [_mm256_castps256_ps128(single), _mm256_extractf128_ps::<1>(single)];
                [Self(_mm256_cvtps_pd(halves[0])), Self(_mm256_cvtps_pd(halves[1]))]
            }
        }
    }
}

//! Vectors of points for the inner loops: AVX-512, AVX2 with FMA, or one number at a time.
//!
//! Numbers become lanes only through a token that exists where the processor has the instructions, so that whoever
//! holds a [`Lanes`] may calculate with it.

use std::ops::{Add, Mul, Neg, Sub};

/// One number for each of several points.
pub(super) trait Lanes:
    Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Neg<Output = Self>
{
    /// Proof that the processor can calculate with these.
    type Token: Copy;
    /// How many numbers.
    const WIDTH: usize;

    fn splat(token: Self::Token, value: f64) -> Self;
    /// The first [`Self::WIDTH`] values.
    fn load(token: Self::Token, values: &[f64]) -> Self;
    fn store(self, values: &mut [f64]);
    /// `self * factor + summand`, rounded once where the processor can.
    fn mul_add(self, factor: Self, summand: Self) -> Self;
    fn over(self, divisor: Self) -> Self;
    /// `1 / self` to a unit in the last place; infinite or NaN for zero.
    fn reciprocal(self) -> Self;
    fn sqrt(self) -> Self;
    fn abs(self) -> Self;
    /// A bit for each lane where `self < other`; never for NaN.
    fn less(self, other: Self) -> u32;
    /// `yes` where `self < other`, else `no`.
    fn if_less(self, other: Self, yes: Self, no: Self) -> Self;
}

impl Lanes for f64 {
    type Token = ();
    const WIDTH: usize = 1;

    #[inline(always)]
    fn splat((): (), value: f64) -> Self {
        value
    }

    #[inline(always)]
    fn load((): (), values: &[f64]) -> Self {
        values[0]
    }

    #[inline(always)]
    fn store(self, values: &mut [f64]) {
        values[0] = self;
    }

    // Where the instruction is missing, a call to emulate it costs more than the digit is worth.
    #[inline(always)]
    fn mul_add(self, factor: Self, summand: Self) -> Self {
        self * factor + summand
    }

    #[inline(always)]
    fn over(self, divisor: Self) -> Self {
        self / divisor
    }

    #[inline(always)]
    fn reciprocal(self) -> Self {
        1.0 / self
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        f64::sqrt(self)
    }

    #[inline(always)]
    fn abs(self) -> Self {
        f64::abs(self)
    }

    #[inline(always)]
    fn less(self, other: Self) -> u32 {
        u32::from(self < other)
    }

    #[inline(always)]
    fn if_less(self, other: Self, yes: Self, no: Self) -> Self {
        if self < other { yes } else { no }
    }
}

#[cfg(target_arch = "x86_64")]
pub(super) use x86::{Avx2, Avx512, F64x4, F64x8};

#[cfg(target_arch = "x86_64")]
mod x86 {
    use std::arch::x86_64::*;
    use std::ops::{Add, Mul, Neg, Sub};

    use super::Lanes;

    /// Proof that the processor has AVX-512F.
    #[derive(Debug, Clone, Copy, PartialEq, Eq)]
    pub(in super::super) struct Avx512(());

    impl Avx512 {
        pub(in super::super) fn detect() -> Option<Self> {
            is_x86_feature_detected!("avx512f").then_some(Self(()))
        }
    }

    /// Proof that the processor has AVX2 and FMA.
    #[derive(Debug, Clone, Copy, PartialEq, Eq)]
    pub(in super::super) struct Avx2(());

    impl Avx2 {
        pub(in super::super) fn detect() -> Option<Self> {
            (is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma")).then_some(Self(()))
        }
    }

    macro_rules! lanes {
        (
            $name:ident, $token:ident, $vector:ty, $width:literal,
            $set1:ident, $loadu:ident, $storeu:ident, $add:ident, $sub:ident, $mul:ident, $div:ident, $fma:ident,
            $sqrt:ident, $reciprocal:expr, $abs:expr, $less:expr, $if_less:expr
        ) => {
            /// Made from a token only, hence only where the instructions are.
            #[derive(Debug, Clone, Copy)]
            pub(in super::super) struct $name($vector);

            impl Add for $name {
                type Output = Self;

                #[inline(always)]
                fn add(self, other: Self) -> Self {
                    // SAFETY: the token that made these lanes proves that the processor has the instruction.
                    Self(unsafe { $add(self.0, other.0) })
                }
            }

            impl Sub for $name {
                type Output = Self;

                #[inline(always)]
                fn sub(self, other: Self) -> Self {
                    // SAFETY: the token that made these lanes proves that the processor has the instruction.
                    Self(unsafe { $sub(self.0, other.0) })
                }
            }

            impl Mul for $name {
                type Output = Self;

                #[inline(always)]
                fn mul(self, other: Self) -> Self {
                    // SAFETY: the token that made these lanes proves that the processor has the instruction.
                    Self(unsafe { $mul(self.0, other.0) })
                }
            }

            impl Neg for $name {
                type Output = Self;

                #[inline(always)]
                fn neg(self) -> Self {
                    // SAFETY: the token that made these lanes proves that the processor has the instructions.
                    Self(unsafe { $sub($set1(-0.0), self.0) })
                }
            }

            impl Lanes for $name {
                type Token = $token;
                const WIDTH: usize = $width;

                #[inline(always)]
                fn splat(_: $token, value: f64) -> Self {
                    // SAFETY: the token proves that the processor has the instruction.
                    Self(unsafe { $set1(value) })
                }

                #[inline(always)]
                fn load(_: $token, values: &[f64]) -> Self {
                    let values = &values[..$width];
                    // SAFETY: the token proves that the processor has the instruction; the slice covers what it reads.
                    Self(unsafe { $loadu(values.as_ptr()) })
                }

                #[inline(always)]
                fn store(self, values: &mut [f64]) {
                    let values = &mut values[..$width];
                    // SAFETY: as for loading; the slice covers what is written.
                    unsafe { $storeu(values.as_mut_ptr(), self.0) }
                }

                #[inline(always)]
                fn mul_add(self, factor: Self, summand: Self) -> Self {
                    // SAFETY: the token that made these lanes proves that the processor has the instruction.
                    Self(unsafe { $fma(self.0, factor.0, summand.0) })
                }

                #[inline(always)]
                fn over(self, divisor: Self) -> Self {
                    // SAFETY: the token that made these lanes proves that the processor has the instruction.
                    Self(unsafe { $div(self.0, divisor.0) })
                }

                #[inline(always)]
                fn reciprocal(self) -> Self {
                    // SAFETY: the token that made these lanes proves that the processor has the instructions.
                    Self(unsafe { $reciprocal(self.0) })
                }

                #[inline(always)]
                fn sqrt(self) -> Self {
                    // SAFETY: the token that made these lanes proves that the processor has the instruction.
                    Self(unsafe { $sqrt(self.0) })
                }

                #[inline(always)]
                fn abs(self) -> Self {
                    // SAFETY: the token that made these lanes proves that the processor has the instructions.
                    Self(unsafe { $abs(self.0) })
                }

                #[inline(always)]
                fn less(self, other: Self) -> u32 {
                    // SAFETY: the token that made these lanes proves that the processor has the instructions.
                    unsafe { $less(self.0, other.0) }
                }

                #[inline(always)]
                fn if_less(self, other: Self, yes: Self, no: Self) -> Self {
                    // SAFETY: the token that made these lanes proves that the processor has the instructions.
                    Self(unsafe { $if_less(self.0, other.0, yes.0, no.0) })
                }
            }
        };
    }

    lanes!(
        F64x8,
        Avx512,
        __m512d,
        8,
        _mm512_set1_pd,
        _mm512_loadu_pd,
        _mm512_storeu_pd,
        _mm512_add_pd,
        _mm512_sub_pd,
        _mm512_mul_pd,
        _mm512_div_pd,
        _mm512_fmadd_pd,
        _mm512_sqrt_pd,
        // Newton's method on an estimate of 14 bits: division takes several times as long.
        |a| {
            let one = _mm512_set1_pd(1.0);
            let estimate = _mm512_rcp14_pd(a);
            let estimate = _mm512_fmadd_pd(estimate, _mm512_fnmadd_pd(a, estimate, one), estimate);
            _mm512_fmadd_pd(estimate, _mm512_fnmadd_pd(a, estimate, one), estimate)
        },
        _mm512_abs_pd,
        |a, b| u32::from(_mm512_cmp_pd_mask::<_CMP_LT_OQ>(a, b)),
        |a, b, yes, no| _mm512_mask_blend_pd(_mm512_cmp_pd_mask::<_CMP_LT_OQ>(a, b), no, yes)
    );

    lanes!(
        F64x4,
        Avx2,
        __m256d,
        4,
        _mm256_set1_pd,
        _mm256_loadu_pd,
        _mm256_storeu_pd,
        _mm256_add_pd,
        _mm256_sub_pd,
        _mm256_mul_pd,
        _mm256_div_pd,
        _mm256_fmadd_pd,
        _mm256_sqrt_pd,
        |a| _mm256_div_pd(_mm256_set1_pd(1.0), a),
        |a| _mm256_andnot_pd(_mm256_set1_pd(-0.0), a),
        |a, b| _mm256_movemask_pd(_mm256_cmp_pd::<_CMP_LT_OQ>(a, b)) as u32,
        |a, b, yes, no| _mm256_blendv_pd(no, yes, _mm256_cmp_pd::<_CMP_LT_OQ>(a, b))
    );
}

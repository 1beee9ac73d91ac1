//! SIMD numbers of x86-64, the proofs that the processor has them, and layouts of them.
//!
//! A [`Simd`] value is made by detection only. A rod in SIMD lanes holds one, and runs its passes
//! through [`Simd::vectorize`]: a function compiled for the instructions, into which everything
//! inlines.

use crate::math::instructions::Instructions;
use crate::math::real::{Layout, Never, Real};
use core::arch::x86_64::*;
use std::ops::{Add, AddAssign, Div, Mul, Neg, Sub, SubAssign};

/// Proof that the processor has the instructions of a vector.
pub trait Simd: Copy + Send + Sync + 'static {
    /// Vector of one instruction.
    type Vector: Real;
    /// The proof, where the processor has the instructions.
    fn detect() -> Option<Self>;
    /// Runs `f` compiled for the instructions; see [`Layout::vectorize`].
    fn vectorize<R>(self, f: impl FnOnce() -> R) -> R;
}

/// Proof of AVX2 and FMA, which [`F64x4`] and [`Fused`] need.
#[derive(Clone, Copy, Debug)]
pub struct Avx2(());

impl Simd for Avx2 {
    type Vector = F64x4;
    #[inline]
    fn detect() -> Option<Self> {
        let found = Instructions::Avx2.is_allowed()
            && is_x86_feature_detected!("avx2")
            && is_x86_feature_detected!("fma");
        found.then_some(Avx2(()))
    }
    #[inline(always)]
    fn vectorize<R>(self, f: impl FnOnce() -> R) -> R {
        #[target_feature(enable = "avx2,fma")]
        fn with_features<R>(f: impl FnOnce() -> R) -> R {
            f()
        }
        // SAFETY: only `detect` makes an `Avx2`, after it has found the features
        unsafe { with_features(f) }
    }
}

/// Proof of AVX-512 F, VL and DQ beside AVX2 and FMA, which [`F64x8`] needs.
#[derive(Clone, Copy, Debug)]
pub struct Avx512(());

impl Simd for Avx512 {
    type Vector = F64x8;
    #[inline]
    fn detect() -> Option<Self> {
        let found = Instructions::Avx512.is_allowed()
            && Avx2::detect().is_some()
            && is_x86_feature_detected!("avx512f")
            && is_x86_feature_detected!("avx512vl")
            && is_x86_feature_detected!("avx512dq");
        found.then_some(Avx512(()))
    }
    #[inline(always)]
    fn vectorize<R>(self, f: impl FnOnce() -> R) -> R {
        #[target_feature(enable = "avx512f,avx512vl,avx512dq,avx2,fma")]
        fn with_features<R>(f: impl FnOnce() -> R) -> R {
            f()
        }
        // SAFETY: only `detect` makes an `Avx512`, after it has found the features
        unsafe { with_features(f) }
    }
}

/// A scalar whose `mul_add` is one instruction.
#[derive(Clone, Copy, Debug)]
#[repr(transparent)]
pub struct Fused(f64);

/// Four numbers: AVX2 and FMA.
#[derive(Clone, Copy, Debug)]
#[repr(transparent)]
pub struct F64x4(__m256d);

/// Eight numbers: AVX-512.
#[derive(Clone, Copy, Debug)]
#[repr(transparent)]
pub struct F64x8(__m512d);

macro_rules! operator {
    ($type:ident, $trait:ident, $method:ident, $a:ident, $b:ident => $value:expr) => {
        impl $trait for $type {
            type Output = Self;
            #[inline(always)]
            fn $method(self, o: Self) -> Self {
                let ($a, $b) = (self.0, o.0);
                $type($value)
            }
        }
    };
}
macro_rules! assignments {
    ($type:ident) => {
        impl AddAssign for $type {
            #[inline(always)]
            fn add_assign(&mut self, o: Self) {
                *self = *self + o;
            }
        }
        impl SubAssign for $type {
            #[inline(always)]
            fn sub_assign(&mut self, o: Self) {
                *self = *self - o;
            }
        }
    };
}

operator!(Fused, Add, add, a, b => a + b);
operator!(Fused, Sub, sub, a, b => a - b);
operator!(Fused, Mul, mul, a, b => a * b);
operator!(Fused, Div, div, a, b => a / b);
assignments!(Fused);
impl Neg for Fused {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Fused(-self.0)
    }
}

impl Real for Fused {
    const LANES: usize = 1;
    type Maybe<C: Copy + Send + Sync + 'static> = Never;
    #[inline(always)]
    fn splat(x: f64) -> Self {
        Fused(x)
    }
    #[inline(always)]
    fn from_fn(mut f: impl FnMut(usize) -> f64) -> Self {
        Fused(f(0))
    }
    #[inline(always)]
    fn lane(&self, _: usize) -> f64 {
        self.0
    }
    #[inline(always)]
    fn set_lane(&mut self, _: usize, x: f64) {
        self.0 = x;
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        Fused(self.0.sqrt())
    }
    #[inline(always)]
    fn abs(self) -> Self {
        Fused(self.0.abs())
    }
    #[inline(always)]
    fn max(self, o: Self) -> Self {
        Fused(Real::max(self.0, o.0))
    }
    #[inline(always)]
    fn mul_add(self, a: Self, b: Self) -> Self {
        Fused(self.0.mul_add(a.0, b.0))
    }
}

// Why the intrinsics may be called: these types are used only through `Simd::Vector`, and a rod of
// them is not made without the proof.
macro_rules! vector {
    ($type:ident, $n:literal, $add:ident, $sub:ident, $mul:ident, $div:ident, $fma:ident,
     $set:ident, $load:ident, $sqrt:ident, $a:ident, $b:ident => $max:expr, $abs:expr) => {
        operator!($type, Add, add, a, b => {
            // SAFETY: a number of this type exists only where the processor has the instruction
            unsafe { $add(a, b) }
        });
        operator!($type, Sub, sub, a, b => {
            // SAFETY: a number of this type exists only where the processor has the instruction
            unsafe { $sub(a, b) }
        });
        operator!($type, Mul, mul, a, b => {
            // SAFETY: a number of this type exists only where the processor has the instruction
            unsafe { $mul(a, b) }
        });
        operator!($type, Div, div, a, b => {
            // SAFETY: a number of this type exists only where the processor has the instruction
            unsafe { $div(a, b) }
        });
        assignments!($type);
        impl Neg for $type {
            type Output = Self;
            #[inline(always)]
            fn neg(self) -> Self {
                // SAFETY: a number of this type exists only where the processor has the instruction
                $type(unsafe { $sub($set(-0.0), self.0) })
            }
        }
        impl Real for $type {
            const LANES: usize = $n;
            type Maybe<C: Copy + Send + Sync + 'static> = Never;
            #[inline(always)]
            fn splat(x: f64) -> Self {
                // SAFETY: code that makes numbers of this type runs behind a check of the processor
                $type(unsafe { $set(x) })
            }
            #[inline(always)]
            fn from_fn(mut f: impl FnMut(usize) -> f64) -> Self {
                let mut lanes = [0.0; $n];
                for (i, x) in lanes.iter_mut().enumerate() {
                    *x = f(i);
                }
                // SAFETY: as for `splat`; the unaligned load reads the $n numbers of `lanes`
                $type(unsafe { $load(lanes.as_ptr()) })
            }
            #[inline(always)]
            fn lane(&self, i: usize) -> f64 {
                debug_assert!(i < $n);
                // SAFETY: the vector is $n numbers (`repr(transparent)`), of which `i % $n` is one;
                // the borrow of `self` covers all of them
                unsafe { *(self as *const Self as *const f64).add(i % $n) }
            }
            #[inline(always)]
            fn set_lane(&mut self, i: usize, x: f64) {
                debug_assert!(i < $n);
                // SAFETY: as for `lane`; the borrow is exclusive
                unsafe { *(self as *mut Self as *mut f64).add(i % $n) = x }
            }
            #[inline(always)]
            fn sqrt(self) -> Self {
                // SAFETY: a number of this type exists only where the processor has the instruction
                $type(unsafe { $sqrt(self.0) })
            }
            #[inline(always)]
            fn abs(self) -> Self {
                let $a = self.0;
                // SAFETY: a number of this type exists only where the processor has the instruction
                $type(unsafe { $abs })
            }
            #[inline(always)]
            fn max(self, o: Self) -> Self {
                let ($a, $b) = (self.0, o.0);
                // SAFETY: a number of this type exists only where the processor has the instruction
                $type(unsafe { $max })
            }
            #[inline(always)]
            fn mul_add(self, a: Self, b: Self) -> Self {
                // SAFETY: a number of this type exists only where the processor has the instruction
                $type(unsafe { $fma(self.0, a.0, b.0) })
            }
        }
    };
}

vector!(
    F64x4,
    4,
    _mm256_add_pd,
    _mm256_sub_pd,
    _mm256_mul_pd,
    _mm256_div_pd,
    _mm256_fmadd_pd,
    _mm256_set1_pd,
    _mm256_loadu_pd,
    _mm256_sqrt_pd,
    // the instruction returns its second operand if either is NaN
    a, b => _mm256_blendv_pd(_mm256_max_pd(a, b), a, _mm256_cmp_pd::<_CMP_UNORD_Q>(a, a)),
    _mm256_andnot_pd(_mm256_set1_pd(-0.0), a)
);

vector!(
    F64x8,
    8,
    _mm512_add_pd,
    _mm512_sub_pd,
    _mm512_mul_pd,
    _mm512_div_pd,
    _mm512_fmadd_pd,
    _mm512_set1_pd,
    _mm512_loadu_pd,
    _mm512_sqrt_pd,
    a, b => _mm512_mask_blend_pd(
        _mm512_cmp_pd_mask::<_CMP_UNORD_Q>(a, a),
        _mm512_max_pd(a, b),
        a
    ),
    _mm512_abs_pd(a)
);

/// One robot, its modules side by side.
#[derive(Clone, Copy, Debug)]
pub struct Modules<S>(pub S);

impl<S: Simd> Layout for Modules<S> {
    type Module = S::Vector;
    type Chain = Fused;
    const WIDTH: usize = S::Vector::LANES;
    #[inline(always)]
    fn get(m: &S::Vector, i: usize) -> Fused {
        Fused(m.lane(i))
    }
    #[inline(always)]
    fn put(m: &mut S::Vector, i: usize, c: Fused) {
        m.set_lane(i, c.0);
    }
    #[inline(always)]
    fn vectorize<R>(self, f: impl FnOnce() -> R) -> R {
        self.0.vectorize(f)
    }
}

/// Several robots side by side.
#[derive(Clone, Copy, Debug)]
pub struct Robots<S>(pub S);

impl<S: Simd> Layout for Robots<S> {
    type Module = S::Vector;
    type Chain = S::Vector;
    const WIDTH: usize = 1;
    #[inline(always)]
    fn get(m: &S::Vector, _: usize) -> S::Vector {
        *m
    }
    #[inline(always)]
    fn put(m: &mut S::Vector, _: usize, c: S::Vector) {
        *m = c;
    }
    #[inline(always)]
    fn vectorize<R>(self, f: impl FnOnce() -> R) -> R {
        self.0.vectorize(f)
    }
}

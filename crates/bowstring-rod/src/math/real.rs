//! The scalar of the mechanics: one `f64`, or several numbers side by side in SIMD lanes.
//!
//! A single solve puts modules side by side, a batch puts robots side by side; `Layout` names the
//! number types of both. The mechanics is written once, over [`Real`].
#![warn(missing_docs)]

use std::ops::{Add, AddAssign, Div, Mul, Neg, Sub, SubAssign};

/// Place for a value of type `C` that a struct over a number type [`Real`] may have.
///
/// For `f64` it is an `Option<Box<C>>`. For all other number types, those in lanes, it is [`Never`],
/// without size and value. Robots that have such values are not solved in lanes.
pub trait Maybe<C>: Clone + Send + Sync + 'static {
    /// Stores the value. [`Never`] drops it.
    fn new(value: Option<C>) -> Self;
    /// The value, if there is one.
    fn get(&self) -> Option<&C>;
    /// The value, if there is one, to be changed.
    fn get_mut(&mut self) -> Option<&mut C>;
}

// boxed, so that a struct without the value stays small
impl<C: Copy + Send + Sync + 'static> Maybe<C> for Option<Box<C>> {
    #[inline(always)]
    fn new(value: Option<C>) -> Self {
        value.map(Box::new)
    }
    #[inline(always)]
    fn get(&self) -> Option<&C> {
        self.as_deref()
    }
    #[inline(always)]
    fn get_mut(&mut self) -> Option<&mut C> {
        self.as_deref_mut()
    }
}

/// The [`Maybe`] of numbers in lanes: no value, no size.
#[derive(Clone, Copy, Debug)]
pub struct Never;

impl<C> Maybe<C> for Never {
    #[inline(always)]
    fn new(_: Option<C>) -> Self {
        Never
    }
    #[inline(always)]
    fn get(&self) -> Option<&C> {
        None
    }
    #[inline(always)]
    fn get_mut(&mut self) -> Option<&mut C> {
        None
    }
}

/// Most lanes of a number.
pub const MOST_LANES: usize = 8;

/// Operations of a number in the mechanics.
pub trait Real:
    Copy
    + Send
    + Sync
    + 'static
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
    + AddAssign
    + SubAssign
{
    /// Number of lanes.
    const LANES: usize;
    /// Whether it is `f64`. What is rare (coupled sections, loads between disks) is compiled for plain
    /// numbers only: a branch on this constant keeps it out of all others.
    const PLAIN: bool = false;
    /// Place for an optional value that structs over `f64` can have, and structs over lanes cannot.
    type Maybe<C: Copy + Send + Sync + 'static>: Maybe<C>;
    /// The same number in every lane.
    fn splat(x: f64) -> Self;
    /// Sets lane by lane.
    fn from_fn(f: impl FnMut(usize) -> f64) -> Self;
    /// Value of one lane.
    fn lane(&self, i: usize) -> f64;
    /// Sets one lane.
    fn set_lane(&mut self, i: usize, x: f64);
    /// Square root.
    fn sqrt(self) -> Self;
    /// Absolute value.
    fn abs(self) -> Self;
    /// The larger of two; NaN if either is NaN.
    fn max(self, other: Self) -> Self;
    /// `self * a + b`, fused where the processor can.
    fn mul_add(self, a: Self, b: Self) -> Self;

    /// Zero in every lane.
    #[inline(always)]
    fn zero() -> Self {
        Self::splat(0.0)
    }
    /// Whether every lane is below a bound; a NaN is not.
    #[inline(always)]
    fn all_below(self, bound: f64) -> bool {
        // no early exit: the lanes are compared at once
        let mut all = true;
        for i in 0..Self::LANES {
            all &= self.lane(i) < bound;
        }
        all
    }
    /// Whether any lane is above a bound; a NaN is not.
    #[inline(always)]
    fn any_above(self, bound: f64) -> bool {
        let mut any = false;
        for i in 0..Self::LANES {
            any |= self.lane(i) > bound;
        }
        any
    }
    /// The largest lane; NaN if any lane is NaN.
    #[inline(always)]
    fn largest(self) -> f64 {
        let mut m = self.lane(0);
        for i in 1..Self::LANES {
            m = Real::max(m, self.lane(i));
        }
        m
    }
    /// The largest lane that is a number; negative infinity if none is.
    #[inline(always)]
    fn largest_number(self) -> f64 {
        let mut m = f64::NEG_INFINITY;
        for i in 0..Self::LANES {
            m = f64::max(m, self.lane(i));
        }
        m
    }
}

impl Real for f64 {
    const LANES: usize = 1;
    const PLAIN: bool = true;
    type Maybe<C: Copy + Send + Sync + 'static> = Option<Box<C>>;
    #[inline(always)]
    fn splat(x: f64) -> Self {
        x
    }
    #[inline(always)]
    fn from_fn(mut f: impl FnMut(usize) -> f64) -> Self {
        f(0)
    }
    #[inline(always)]
    fn lane(&self, _: usize) -> f64 {
        *self
    }
    #[inline(always)]
    fn set_lane(&mut self, _: usize, x: f64) {
        *self = x;
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
    fn max(self, other: Self) -> Self {
        // keeps NaN, unlike f64::max
        if self >= other || self.is_nan() {
            self
        } else {
            other
        }
    }
    #[inline(always)]
    fn mul_add(self, a: Self, b: Self) -> Self {
        self * a + b
    }
}

/// Arrangement of numbers in lanes. A value of it proves that the processor has the instructions.
pub trait Layout: Copy + Send + Sync + 'static {
    /// Number type for work inside a module: `WIDTH` modules side by side.
    type Module: Real;
    /// Number type for recursions from module to module.
    type Chain: Real;
    /// Number of modules side by side.
    const WIDTH: usize;
    /// Number of one module.
    fn get(m: &Self::Module, i: usize) -> Self::Chain;
    /// Sets the number of one module.
    fn put(m: &mut Self::Module, i: usize, c: Self::Chain);
    /// Runs `f` compiled for the instructions of these numbers: `f` and every function between it
    /// and the arithmetic must be `#[inline(always)]`.
    fn vectorize<R>(self, f: impl FnOnce() -> R) -> R;
}

/// One robot, one module after the other: any processor.
#[derive(Clone, Copy, Debug)]
pub struct Scalar;

impl Layout for Scalar {
    type Module = f64;
    type Chain = f64;
    const WIDTH: usize = 1;
    #[inline(always)]
    fn get(m: &f64, _: usize) -> f64 {
        *m
    }
    #[inline(always)]
    fn put(m: &mut f64, _: usize, c: f64) {
        *m = c;
    }
    #[inline(always)]
    fn vectorize<R>(self, f: impl FnOnce() -> R) -> R {
        f()
    }
}

//! Vectors and matrices of three, over any [`Real`].
//!
//! Our own, because the same arithmetic runs on one robot and on SIMD lanes of
//! robots, and must inline whole into code compiled for the processor found at run time.

use crate::real::Real;
use std::ops::{Add, AddAssign, Index, IndexMut, Mul, Neg, Sub, SubAssign};

/// A vector of three.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Vec3<T = f64>(pub [T; 3]);

/// A 3x3 matrix, by rows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mat3<T = f64>(pub [[T; 3]; 3]);

impl<T: Real> Vec3<T> {
    #[inline(always)]
    pub fn zero() -> Self {
        Vec3([T::zero(); 3])
    }
    #[inline(always)]
    pub fn splat(v: [f64; 3]) -> Self {
        Vec3([T::splat(v[0]), T::splat(v[1]), T::splat(v[2])])
    }
    /// The unit vector along z, the tangent of a straight backbone.
    #[inline(always)]
    pub fn ez() -> Self {
        Self::splat([0.0, 0.0, 1.0])
    }
    #[inline(always)]
    pub fn dot(self, o: Self) -> T {
        self.0[0] * o.0[0] + self.0[1] * o.0[1] + self.0[2] * o.0[2]
    }
    #[inline(always)]
    pub fn cross(self, o: Self) -> Self {
        let (a, b) = (self.0, o.0);
        Vec3([
            a[1] * b[2] - a[2] * b[1],
            a[2] * b[0] - a[0] * b[2],
            a[0] * b[1] - a[1] * b[0],
        ])
    }
    #[inline(always)]
    pub fn norm2(self) -> T {
        self.dot(self)
    }
    #[inline(always)]
    pub fn norm(self) -> T {
        self.norm2().sqrt()
    }
    /// The largest magnitude of a component.
    #[inline(always)]
    pub fn max_abs(self) -> T {
        self.0[0].abs().max(self.0[1].abs()).max(self.0[2].abs())
    }
    /// `self * o^T`
    #[inline(always)]
    pub fn outer(self, o: Self) -> Mat3<T> {
        Mat3(self.0.map(|a| o.0.map(|b| a * b)))
    }
    /// The cross-product matrix: `skew(a) * b = a x b`.
    #[inline(always)]
    pub fn skew(self) -> Mat3<T> {
        let [x, y, z] = self.0;
        let o = T::zero();
        Mat3([[o, -z, y], [z, o, -x], [-y, x, o]])
    }
}

impl<T: Real> Mat3<T> {
    #[inline(always)]
    pub fn zero() -> Self {
        Mat3([[T::zero(); 3]; 3])
    }
    #[inline(always)]
    pub fn identity() -> Self {
        Self::scalar(T::splat(1.0))
    }
    #[inline(always)]
    pub fn scalar(d: T) -> Self {
        Self::diagonal([d; 3])
    }
    #[inline(always)]
    pub fn diagonal(d: [T; 3]) -> Self {
        let mut m = Self::zero();
        for i in 0..3 {
            m.0[i][i] = d[i];
        }
        m
    }
    #[inline(always)]
    pub fn transpose(self) -> Self {
        let m = self.0;
        Mat3([
            [m[0][0], m[1][0], m[2][0]],
            [m[0][1], m[1][1], m[2][1]],
            [m[0][2], m[1][2], m[2][2]],
        ])
    }
    #[inline(always)]
    pub fn column(self, j: usize) -> Vec3<T> {
        Vec3([self.0[0][j], self.0[1][j], self.0[2][j]])
    }
    /// `self^T * v`
    #[inline(always)]
    pub fn tr_mul(self, v: Vec3<T>) -> Vec3<T> {
        Vec3(self.0[0]) * v.0[0] + Vec3(self.0[1]) * v.0[1] + Vec3(self.0[2]) * v.0[2]
    }
    /// `self^T * o`
    #[inline(always)]
    pub fn tr_mat(self, o: Self) -> Self {
        self.transpose() * o
    }
    /// `(self + self^T) / 2`
    #[inline(always)]
    pub fn symmetric_part(self) -> Self {
        (self + self.transpose()) * T::splat(0.5)
    }
    /// The inverse by cofactors and the leading minors (all positive: positive definite).
    #[inline(always)]
    pub fn inverse_and_minors(self) -> (Self, [T; 3]) {
        let [a, b, c] = self.0.map(Vec3);
        let (bc, ca, ab) = (b.cross(c), c.cross(a), a.cross(b));
        let det = a.dot(bc);
        let r = T::splat(1.0) / det;
        let inverse = Mat3([bc.0, ca.0, ab.0]).transpose() * r;
        (inverse, [self.0[0][0], ab.0[2], det])
    }
    #[inline(always)]
    pub fn inverse(self) -> Self {
        self.inverse_and_minors().0
    }
}

macro_rules! elementwise {
    ($type:ident, $trait:ident, $method:ident, $assign_trait:ident, $assign:ident, $f:expr) => {
        impl<T: Real> $trait for $type<T> {
            type Output = Self;
            #[inline(always)]
            fn $method(mut self, o: Self) -> Self {
                for i in 0..3 {
                    self.0[i] = $f(self.0[i], o.0[i]);
                }
                self
            }
        }
        impl<T: Real> $assign_trait for $type<T> {
            #[inline(always)]
            fn $assign(&mut self, o: Self) {
                *self = $trait::$method(*self, o);
            }
        }
    };
}
elementwise!(Vec3, Add, add, AddAssign, add_assign, |a: T, b: T| a + b);
elementwise!(Vec3, Sub, sub, SubAssign, sub_assign, |a: T, b: T| a - b);
elementwise!(Mat3, Add, add, AddAssign, add_assign, |a: [T; 3], b| (Vec3(
    a
)
    + Vec3(b))
.0);
elementwise!(Mat3, Sub, sub, SubAssign, sub_assign, |a: [T; 3], b| (Vec3(
    a
)
    - Vec3(b))
.0);

impl<T: Real> Neg for Vec3<T> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Vec3(self.0.map(|a| -a))
    }
}
impl<T: Real> Neg for Mat3<T> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Mat3(self.0.map(|r| r.map(|a| -a)))
    }
}
impl<T: Real> Mul<T> for Vec3<T> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, s: T) -> Self {
        Vec3(self.0.map(|a| a * s))
    }
}
impl<T: Real> Mul<T> for Mat3<T> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, s: T) -> Self {
        Mat3(self.0.map(|r| r.map(|a| a * s)))
    }
}
impl<T: Real> Mul<Vec3<T>> for Mat3<T> {
    type Output = Vec3<T>;
    #[inline(always)]
    fn mul(self, v: Vec3<T>) -> Vec3<T> {
        Vec3(self.0.map(|r| Vec3(r).dot(v)))
    }
}
impl<T: Real> Mul for Mat3<T> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, o: Self) -> Self {
        let [x, y, z] = o.0.map(Vec3);
        Mat3(self.0.map(|r| (x * r[0] + y * r[1] + z * r[2]).0))
    }
}
impl<T> Index<usize> for Vec3<T> {
    type Output = T;
    #[inline(always)]
    fn index(&self, i: usize) -> &T {
        &self.0[i]
    }
}
impl<T> IndexMut<usize> for Vec3<T> {
    #[inline(always)]
    fn index_mut(&mut self, i: usize) -> &mut T {
        &mut self.0[i]
    }
}

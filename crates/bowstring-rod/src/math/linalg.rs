//! Vectors of three and 3x3 matrices, over any [`Real`].
//!
//! No closures and no `array::map` here: they would not inline. Own code instead of a library,
//! because the same arithmetic runs on one robot and on SIMD lanes of robots, and must inline into
//! code compiled for the processor found at run time.
#![warn(missing_docs)]

use crate::math::real::Real;
use crate::math::series::small_arc_tangent;
use std::ops::{Add, AddAssign, Index, IndexMut, Mul, Neg, Sub, SubAssign};

/// A vector of three.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Vec3<T = f64>(pub [T; 3]);

/// A 3x3 matrix, by rows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mat3<T = f64>(pub [[T; 3]; 3]);

impl<T: Real> Vec3<T> {
    /// Zero.
    #[inline(always)]
    pub fn zero() -> Self {
        Vec3([T::zero(); 3])
    }
    /// The same vector in every lane.
    #[inline(always)]
    pub fn splat(v: [f64; 3]) -> Self {
        Vec3([T::splat(v[0]), T::splat(v[1]), T::splat(v[2])])
    }
    /// Copies the components of a lane.
    #[inline(always)]
    pub fn take_lane(&mut self, o: &Self, lane: usize) {
        for (own, other) in self.0.iter_mut().zip(&o.0) {
            own.set_lane(lane, other.lane(lane));
        }
    }
    /// Components of one lane.
    #[inline(always)]
    pub fn of_lane(&self, lane: usize) -> Vec3<f64> {
        Vec3([
            self.0[0].lane(lane),
            self.0[1].lane(lane),
            self.0[2].lane(lane),
        ])
    }
    /// Unit vector along z, the tangent of a straight backbone.
    #[inline(always)]
    pub fn ez() -> Self {
        Self::splat([0.0, 0.0, 1.0])
    }
    /// Inner product.
    #[inline(always)]
    pub fn dot(self, o: Self) -> T {
        let (a, b) = (self.0, o.0);
        a[2].mul_add(b[2], a[1].mul_add(b[1], a[0] * b[0]))
    }
    /// Cross product.
    #[inline(always)]
    pub fn cross(self, o: Self) -> Self {
        let (a, b) = (self.0, o.0);
        Vec3([
            a[1].mul_add(b[2], -(a[2] * b[1])),
            a[2].mul_add(b[0], -(a[0] * b[2])),
            a[0].mul_add(b[1], -(a[1] * b[0])),
        ])
    }
    /// `self * s + o`
    #[inline(always)]
    pub fn scaled_add(self, s: T, o: Self) -> Self {
        let (a, b) = (self.0, o.0);
        Vec3([
            a[0].mul_add(s, b[0]),
            a[1].mul_add(s, b[1]),
            a[2].mul_add(s, b[2]),
        ])
    }
    /// Squared length.
    #[inline(always)]
    pub fn norm2(self) -> T {
        self.dot(self)
    }
    /// Length.
    #[inline(always)]
    pub fn norm(self) -> T {
        self.norm2().sqrt()
    }
    /// The largest magnitude of a component.
    #[inline(always)]
    pub fn max_abs(self) -> T {
        self.0[0].abs().max(self.0[1].abs()).max(self.0[2].abs())
    }
    /// Angle to another unit vector (rad).
    #[inline(always)]
    pub fn angle(self, o: Self) -> T {
        let one = T::splat(1.0);
        let along = one + self.dot(o);
        // finite also where they are opposite
        let across = self.cross(o).norm().max(T::splat(1e-100) - along);
        let mut tangent = across / along.max(T::splat(1e-150));
        let mut times = 2.0;
        // half-angle tangents, until the series is short
        while tangent.largest_number() > 0.125 {
            tangent = tangent / (one + tangent.mul_add(tangent, one).sqrt());
            times *= 2.0;
        }
        small_arc_tangent(tangent) * T::splat(times)
    }
    /// `self * o^T`
    #[inline(always)]
    pub fn outer(self, o: Self) -> Mat3<T> {
        let [x, y, z] = self.0;
        Mat3([(o * x).0, (o * y).0, (o * z).0])
    }
    /// `self * o^T + m`
    #[inline(always)]
    pub fn outer_add(self, o: Self, m: Mat3<T>) -> Mat3<T> {
        let ([x, y, z], [a, b, c]) = (self.0, m.rows());
        Mat3([
            o.scaled_add(x, a).0,
            o.scaled_add(y, b).0,
            o.scaled_add(z, c).0,
        ])
    }
    /// `[self] * m`: the cross product with every column.
    #[inline(always)]
    pub fn cross_mat(self, m: Mat3<T>) -> Mat3<T> {
        let [x, y, z] = self.0;
        let [a, b, c] = m.rows();
        Mat3([
            c.scaled_add(y, -(b * z)).0,
            a.scaled_add(z, -(c * x)).0,
            b.scaled_add(x, -(a * y)).0,
        ])
    }
    /// The cross-product matrix: `skew(a) * b = a x b`.
    #[inline(always)]
    pub fn skew(self) -> Mat3<T> {
        self.skew_and_scalar(T::zero())
    }
    /// The cross-product matrix plus `d` times the identity.
    #[inline(always)]
    pub fn skew_and_scalar(self, d: T) -> Mat3<T> {
        let [x, y, z] = self.0;
        Mat3([[d, -z, y], [z, d, -x], [-y, x, d]])
    }
}

impl<T: Real> Mat3<T> {
    /// Zero.
    #[inline(always)]
    pub fn zero() -> Self {
        Mat3([[T::zero(); 3]; 3])
    }
    /// Identity.
    #[inline(always)]
    pub fn identity() -> Self {
        Self::scalar(T::splat(1.0))
    }
    /// Identity times a number.
    #[inline(always)]
    pub fn scalar(d: T) -> Self {
        Self::diagonal([d; 3])
    }
    /// Diagonal matrix.
    #[inline(always)]
    pub fn diagonal(d: [T; 3]) -> Self {
        let mut m = Self::zero();
        for i in 0..3 {
            m.0[i][i] = d[i];
        }
        m
    }
    /// The same matrix in every lane.
    #[inline(always)]
    pub fn splat(m: &Mat3) -> Self {
        let [a, b, c] = m.0;
        Mat3([Vec3::splat(a).0, Vec3::splat(b).0, Vec3::splat(c).0])
    }
    /// Entries of one lane.
    #[inline(always)]
    pub fn of_lane(&self, lane: usize) -> Mat3 {
        let [a, b, c] = self.rows();
        Mat3([a.of_lane(lane).0, b.of_lane(lane).0, c.of_lane(lane).0])
    }
    /// Transpose.
    #[inline(always)]
    pub fn transpose(self) -> Self {
        let m = self.0;
        Mat3([
            [m[0][0], m[1][0], m[2][0]],
            [m[0][1], m[1][1], m[2][1]],
            [m[0][2], m[1][2], m[2][2]],
        ])
    }
    /// Rows.
    #[inline(always)]
    pub fn rows(self) -> [Vec3<T>; 3] {
        let [a, b, c] = self.0;
        [Vec3(a), Vec3(b), Vec3(c)]
    }
    /// Column `j`.
    #[inline(always)]
    pub fn column(self, j: usize) -> Vec3<T> {
        Vec3([self.0[0][j], self.0[1][j], self.0[2][j]])
    }
    /// `self^T * v`
    #[inline(always)]
    pub fn tr_mul(self, v: Vec3<T>) -> Vec3<T> {
        let [x, y, z] = self.rows();
        z.scaled_add(v.0[2], y.scaled_add(v.0[1], x * v.0[0]))
    }
    /// `self * o + m`
    #[inline(always)]
    pub fn mul_add(self, o: Self, m: Self) -> Self {
        let [x, y, z] = o.rows();
        let row = |r: [T; 3], m: [T; 3]| {
            z.scaled_add(r[2], y.scaled_add(r[1], x.scaled_add(r[0], Vec3(m))))
                .0
        };
        Mat3([
            row(self.0[0], m.0[0]),
            row(self.0[1], m.0[1]),
            row(self.0[2], m.0[2]),
        ])
    }
    /// Adds a diagonal.
    #[inline(always)]
    pub fn add_diagonal(mut self, d: [T; 3]) -> Self {
        for i in 0..3 {
            self.0[i][i] += d[i];
        }
        self
    }
    /// `self * [v]`: the product with a cross-product matrix.
    #[inline(always)]
    pub fn mul_skew(self, v: Vec3<T>) -> Self {
        let [a, b, c] = self.rows();
        Mat3([a.cross(v).0, b.cross(v).0, c.cross(v).0])
    }
    /// Multiplies every row by a number.
    #[inline(always)]
    pub fn scale_rows(self, by: [T; 3]) -> Self {
        let [a, b, c] = self.rows();
        Mat3([(a * by[0]).0, (b * by[1]).0, (c * by[2]).0])
    }
    /// Adds the cross-product matrix of a vector.
    #[inline(always)]
    pub fn add_skew(mut self, v: Vec3<T>) -> Self {
        let [x, y, z] = v.0;
        for (row, column, by) in [(2, 1, x), (0, 2, y), (1, 0, z)] {
            self.0[row][column] += by;
            self.0[column][row] -= by;
        }
        self
    }
    /// `self * s + m`
    #[inline(always)]
    pub fn scaled_add(self, s: T, m: Self) -> Self {
        let ([a, b, c], [x, y, z]) = (self.rows(), m.rows());
        Mat3([
            a.scaled_add(s, x).0,
            b.scaled_add(s, y).0,
            c.scaled_add(s, z).0,
        ])
    }
    /// `self^T * o`
    #[inline(always)]
    pub fn tr_mat(self, o: Self) -> Self {
        self.transpose() * o
    }
    /// The lower triangle and its mirror image: a matrix that is symmetric but for rounding, of which
    /// the upper triangle need not be computed.
    #[inline(always)]
    pub fn mirrored(self) -> Self {
        let m = self.0;
        Mat3([
            [m[0][0], m[1][0], m[2][0]],
            [m[1][0], m[1][1], m[2][1]],
            [m[2][0], m[2][1], m[2][2]],
        ])
    }
    /// `(self + self^T) / 2`
    #[inline(always)]
    pub fn symmetric_part(self) -> Self {
        (self + self.transpose()) * T::splat(0.5)
    }
    /// Inverse by cofactors, and the leading minors (all positive: positive definite).
    #[inline(always)]
    pub fn inverse_and_minors(self) -> (Self, [T; 3]) {
        let [a, b, c] = self.rows();
        let (bc, ca, ab) = (b.cross(c), c.cross(a), a.cross(b));
        let det = a.dot(bc);
        let r = T::splat(1.0) / det;
        let inverse = Mat3([bc.0, ca.0, ab.0]).transpose() * r;
        (inverse, [self.0[0][0], ab.0[2], det])
    }
    /// Inverse.
    #[inline(always)]
    pub fn inverse(self) -> Self {
        self.inverse_and_minors().0
    }
}

macro_rules! elementwise {
    ($type:ident, $element:ident, $trait:ident, $method:ident, $assign_trait:ident, $assign:ident, $op:tt) => {
        impl<T: Real> $trait for $type<T> {
            type Output = Self;
            #[inline(always)]
            #[allow(clippy::assign_op_pattern)] // rows have no operators of their own
            fn $method(mut self, o: Self) -> Self {
                for i in 0..3 {
                    self.0[i] = elementwise!(@ $element, self.0[i], o.0[i], $op);
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
    (@ Number, $a:expr, $b:expr, $op:tt) => { $a $op $b };
    (@ Row, $a:expr, $b:expr, $op:tt) => { (Vec3($a) $op Vec3($b)).0 };
}
elementwise!(Vec3, Number, Add, add, AddAssign, add_assign, +);
elementwise!(Vec3, Number, Sub, sub, SubAssign, sub_assign, -);
elementwise!(Mat3, Row, Add, add, AddAssign, add_assign, +);
elementwise!(Mat3, Row, Sub, sub, SubAssign, sub_assign, -);

impl<T: Real> Neg for Vec3<T> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        let [x, y, z] = self.0;
        Vec3([-x, -y, -z])
    }
}
impl<T: Real> Neg for Mat3<T> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        let [a, b, c] = self.rows();
        Mat3([(-a).0, (-b).0, (-c).0])
    }
}
impl<T: Real> Mul<T> for Vec3<T> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, s: T) -> Self {
        let [x, y, z] = self.0;
        Vec3([x * s, y * s, z * s])
    }
}
impl<T: Real> Mul<T> for Mat3<T> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, s: T) -> Self {
        let [a, b, c] = self.rows();
        Mat3([(a * s).0, (b * s).0, (c * s).0])
    }
}
impl<T: Real> Mul<Vec3<T>> for Mat3<T> {
    type Output = Vec3<T>;
    #[inline(always)]
    fn mul(self, v: Vec3<T>) -> Vec3<T> {
        let [a, b, c] = self.rows();
        Vec3([a.dot(v), b.dot(v), c.dot(v)])
    }
}
impl<T: Real> Mul for Mat3<T> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, o: Self) -> Self {
        let [x, y, z] = o.rows();
        let mut out = self;
        for i in 0..3 {
            let r = self.0[i];
            out.0[i] = z.scaled_add(r[2], y.scaled_add(r[1], x * r[0])).0;
        }
        out
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

/// Inner product of vectors of any size.
pub fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Eigenvalues of a symmetric matrix, and eigenvectors as columns of a rotation, by Jacobi rotations.
pub fn principal_axes(mut m: Mat3) -> ([f64; 3], Mat3) {
    let mut axes = Mat3::identity();
    for _ in 0..30 {
        let off = |p: usize, q: usize| m.0[p][q].abs();
        let pairs = [(0, 1), (0, 2), (1, 2)];
        let largest = pairs
            .into_iter()
            .max_by(|a, b| off(a.0, a.1).total_cmp(&off(b.0, b.1)));
        let (p, q) = largest.expect("there are three");
        let size = m.0[p][p].abs() + m.0[q][q].abs();
        if off(p, q) <= f64::EPSILON * size {
            break;
        }
        let angle = 0.5 * (2.0 * m.0[p][q]).atan2(m.0[q][q] - m.0[p][p]);
        let (sin, cos) = angle.sin_cos();
        let mut turn = Mat3::identity();
        (turn.0[p][p], turn.0[q][q]) = (cos, cos);
        (turn.0[p][q], turn.0[q][p]) = (sin, -sin);
        m = turn.transpose() * m * turn;
        axes = axes * turn;
    }
    ([0, 1, 2].map(|q| m.0[q][q]), axes)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Angles of all magnitudes have full relative accuracy.
    #[test]
    fn angles_match_atan2() {
        let axis = Vec3([0.6, -0.48, 0.64]);
        let across = Vec3([0.8, 0.36, -0.48]);
        for angle in [0.0, 1e-12, 1e-8, 1e-3, 0.2, 0.26, 0.9, 1.6, 3.0f64] {
            let turned = axis * angle.cos() + across * angle.sin();
            let found = axis.angle(turned);
            let (sine, cosine) = (axis.cross(turned).norm(), axis.dot(turned));
            // one plus the cosine cancels near opposite vectors
            let off = found - sine.atan2(cosine);
            let most = if angle < 2.0 { 2e-15 } else { 1e-13 };
            assert!(off.abs() <= most * angle, "{angle}: {off:e}");
            assert!(
                (found - angle).abs() < 1e-15 + 1e-12 * angle,
                "{angle}: {found}"
            );
        }
        for back in [axis, axis * (1.0 + f64::EPSILON), across] {
            let found = back.angle(-back);
            assert!((found - std::f64::consts::PI).abs() < 1e-7, "{found}");
        }
    }

    #[test]
    fn principal_axes_restore_the_matrix() {
        for own in [
            [1.0, 2.0, 3.0],
            [1.0, 1.0, 4.0],
            [2.0, 2.0, 2.0],
            [0.0, 0.0, 0.0],
        ] {
            for v in [[0.3, -0.2, 0.9], [0.0, 0.0, 1.0], [0.0; 3]] {
                let v = Vec3(v);
                let m: Mat3 = v.outer(v).add_diagonal(own);
                let (values, axes) = principal_axes(m);
                let back = axes * Mat3::zero().add_diagonal(values) * axes.transpose();
                let unit = axes * axes.transpose();
                for r in 0..3 {
                    for c in 0..3 {
                        assert!((back.0[r][c] - m.0[r][c]).abs() < 1e-14);
                        assert!((unit.0[r][c] - f64::from(u8::from(r == c))).abs() < 1e-14);
                    }
                }
            }
        }
    }
}

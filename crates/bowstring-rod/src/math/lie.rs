//! Rotations and constant-curvature arcs: exponential, left Jacobian, second derivatives.
//!
//! Theory: docs/theory/rod.md (Kinematics).
//!
//! An arc of length `l` has the rotation vector `w`, constant in its own frame. All functions
//! depend on `x = |w|^2` through Stumpff's functions `c_k(x)`, which are smooth at the straight arc
//! `w = 0`.
#![warn(missing_docs)]

use crate::math::linalg::{Mat3, Vec3};
use crate::math::real::Real;
use crate::math::series::stumpff;

/// Position and orientation in the base frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// Rotation from body to base.
    pub rotation: Mat3,
    /// Position (m).
    pub position: Vec3,
}

/// `exp([w])`, the rotation by the rotation vector `w`.
#[inline(always)]
pub fn exp<T: Real>(w: Vec3<T>) -> Mat3<T> {
    let c = stumpff(w.norm2());
    rotation(w, &c)
}

#[inline(always)]
fn rotation<T: Real>(w: Vec3<T>, c: &[T; 8]) -> Mat3<T> {
    // I + c1 [w] + c2 [w]^2, with [w]^2 = w w^T - |w|^2 I and I - c2 |w|^2 = c0
    (w * c[2]).outer_add(w, (w * c[1]).skew_and_scalar(c[0]))
}

/// Rotation vector of a rotation matrix, with a norm in [0, pi].
pub fn log(r: &Mat3<f64>) -> Vec3<f64> {
    let m = &r.0;
    let axial = Vec3([m[2][1] - m[1][2], m[0][2] - m[2][0], m[1][0] - m[0][1]]) * 0.5;
    let (sin, cos) = (axial.norm(), (m[0][0] + m[1][1] + m[2][2] - 1.0) / 2.0);
    let theta = sin.atan2(cos);
    if cos > -0.9 {
        let x = theta * theta;
        return axial * (1.0 / stumpff(x)[1]);
    }
    // near a rotation by pi the axis comes from the symmetric part: w w^T (1 - cos) / theta^2
    let sym = r.symmetric_part() - Mat3::scalar(cos);
    let j = (0..3)
        .max_by(|&a, &b| sym.0[a][a].total_cmp(&sym.0[b][b]))
        .unwrap_or(0);
    let axis = sym.column(j);
    let sign = if axis.dot(axial) < 0.0 { -1.0 } else { 1.0 };
    axis * (sign * theta / axis.norm())
}

/// One arc: its rotation vector, length, and Stumpff's functions.
#[derive(Clone, Copy, Debug)]
pub struct ArcMap<T = f64> {
    w: Vec3<T>,
    length: T,
    c: [T; 8],
}

impl<T: Real> ArcMap<T> {
    /// Arc of a rotation vector (rad) and a length (m).
    #[inline(always)]
    pub fn new(w: Vec3<T>, length: T) -> Self {
        let c = stumpff(w.norm2());
        ArcMap { w, length, c }
    }

    /// Rotation over the arc.
    #[inline(always)]
    pub fn rotation(&self) -> Mat3<T> {
        rotation(self.w, &self.c)
    }

    /// End point in the frame of the start (m).
    #[inline(always)]
    pub fn end(&self) -> Vec3<T> {
        // l T(w) e3 (theory Eq. 2.2) with T = I + c2 [w] + c3 [w]^2
        let (w, c, o) = (self.w, &self.c, T::zero());
        let along = Vec3([o, o, c[1]]) + Vec3([w[1], -w[0], o]) * c[2] + w * (c[3] * w[2]);
        along * self.length
    }

    /// Rotation vector over the arc (rad).
    #[inline(always)]
    pub fn rotation_vector(&self) -> Vec3<T> {
        self.w
    }

    /// Length of the arc (m).
    #[inline(always)]
    pub fn length(&self) -> T {
        self.length
    }

    /// End point in the frame of the start of an arc along which points move by `v`, constant in its
    /// own frame, instead of its length along z: `T(w) v` (m).
    #[inline(always)]
    pub fn end_along(&self, v: Vec3<T>) -> Vec3<T> {
        let (w, c) = (self.w, &self.c);
        v * c[1] + w.cross(v) * c[2] + w * (c[3] * w.dot(v))
    }

    /// Derivative of `T(w) v` with respect to `w`, at constant `v`.
    #[inline(always)]
    pub fn end_along_jacobian(&self, v: Vec3<T>) -> Mat3<T> {
        let (w, c) = (self.w, &self.c);
        let [d1, d2, d3] = self.first_derivatives();
        let wv = w.dot(v);
        let along = v * d1 + w.cross(v) * d2 + w * (d3 * wv);
        let direct = (w * c[3]).outer(v).add_diagonal([c[3] * wv; 3]);
        (along * T::splat(2.0)).outer(w) + direct.add_skew(v * -c[2])
    }

    /// Derivative of `T(w)' n` with respect to `w`, at constant `n`.
    #[inline(always)]
    pub fn transposed_jacobian(&self, n: Vec3<T>) -> Mat3<T> {
        // T(w)' = T(-w)
        let back = ArcMap {
            w: -self.w,
            ..*self
        };
        -back.end_along_jacobian(n)
    }

    /// The same as `hessian` for the end `T(w) v`, at constant `v`.
    #[inline(always)]
    pub fn hessian_along(&self, v: Vec3<T>, n: Vec3<T>, m: Vec3<T>) -> Mat3<T> {
        let (w, c) = (self.w, &self.c);
        let (two, half) = (T::splat(2.0), T::splat(0.5));
        let [d1, d2, d3] = self.first_derivatives();
        let [e1, e2, e3] = self.second_derivatives();
        // n . T v = (n.v) c1 + c2 w.k + c3 (n.w) (v.w) with k = v x n
        let k = v.cross(n);
        let (nv, wk, nw, vw) = (n.dot(v), w.dot(k), n.dot(w), v.dot(w));
        let gradient3 = n * vw + v * nw;
        let alpha = (nv * d1 + wk * d2 + nw * vw * d3) * two + m.dot(w) * c[3];
        let beta = (nv * e1 + wk * e2 + nw * vw * e3) * T::splat(4.0);
        let mw = m.cross(w);
        let y = w * (beta * half) + (k * d2 + gradient3 * d3) * two + mw * d2 + mw.cross(w) * d3
            - m * (c[3] * half);
        let z = n * c[3];
        let of_w = w.outer_add(y, y.outer(w)).add_diagonal([alpha; 3]);
        z.outer_add(v, v.outer_add(z, of_w)).mirrored()
    }

    /// Left Jacobian: `exp(w + dw) = exp(J dw + ...) exp(w)`.
    pub fn left_jacobian(&self) -> Mat3<T> {
        let (w, c) = (self.w, &self.c);
        (w * c[2]).skew() + (w * c[3]).outer(w) + Mat3::scalar(c[1])
    }

    /// Inverse of the left Jacobian; the arc must rotate by less than 2 pi.
    #[inline(always)]
    pub fn left_jacobian_inverse(&self) -> Mat3<T> {
        let (w, c) = (self.w, &self.c);
        let half = T::splat(0.5);
        // I - [w]/2 + e [w]^2, with [w]^2 = w w' - x I
        let e = (c[3] - c[4] - c[4]) * half / c[2];
        let d = T::splat(1.0) - e * w.norm2();
        (w * e).outer_add(w, (w * -half).skew_and_scalar(d))
    }

    /// Derivative of the end point with respect to `w`.
    #[inline(always)]
    pub fn end_jacobian(&self) -> Mat3<T> {
        let (w, c, l) = (self.w, &self.c, self.length);
        let o = T::zero();
        let [d1, d2, d3] = self.first_derivatives();
        let along = Vec3([o, o, d1]) + Vec3([w[1], -w[0], o]) * d2 + w * (d3 * w[2]);
        // derivatives of the same at constant c_k
        let [x, y, z] = (w * c[3]).0;
        let direct = Mat3([[z, c[2], x], [-c[2], z, y], [o, o, z + z]]);
        along.outer_add(w * T::splat(2.0), direct) * l
    }

    /// Hessian in `w` of `n . end(w) + m . eta(w)`, where `exp(w + dw) = exp(eta) exp(w)`.
    #[inline(always)]
    pub fn hessian(&self, n: Vec3<T>, m: Vec3<T>) -> Mat3<T> {
        let (w, c) = (self.w, &self.c);
        let n = n * self.length;
        let two = T::splat(2.0);
        let half = T::splat(0.5);
        let [d1, d2, d3] = self.first_derivatives();
        let [e1, e2, e3] = self.second_derivatives();
        // end/l . n = n_z c1 + c2 w.k + c3 (n.w) w_z with k = e3 x n
        let k = Vec3([-n[1], n[0], T::zero()]);
        let (wk, nw, wz, nz) = (w.dot(k), n.dot(w), w[2], n[2]);
        let nww = nw * wz;
        let gradient3 = n * wz + Vec3([T::zero(), T::zero(), nw]);
        let alpha = (nz * d1 + wk * d2 + nww * d3) * two + m.dot(w) * c[3];
        let beta = (nz * e1 + wk * e2 + nww * e3) * T::splat(4.0);
        // m . eta: c2 and c3 vary along w; the rest is the curvature of the exponential map
        let mw = m.cross(w);
        let y = w * (beta * half) + (k * d2 + gradient3 * d3) * two + mw * d2 + mw.cross(w) * d3
            - m * (c[3] * half);
        let z = n * c[3];
        let mut h = w.outer_add(y, y.outer(w)).add_diagonal([alpha; 3]);
        for i in 0..2 {
            h.0[2][i] += z[i];
        }
        h.0[2][2] += z[2] + z[2];
        h.mirrored()
    }

    /// `d c_k / d x = (k c_{k+2} - c_{k+1}) / 2` for k = 1, 2, 3.
    #[inline(always)]
    fn first_derivatives(&self) -> [T; 3] {
        let c = &self.c;
        let mut d = [T::zero(); 3];
        for k in 1..4 {
            d[k - 1] = (c[k + 2] * T::splat(k as f64) - c[k + 1]) * T::splat(0.5);
        }
        d
    }

    /// `d^2 c_k / d x^2` for k = 1, 2, 3.
    #[inline(always)]
    fn second_derivatives(&self) -> [T; 3] {
        let c = &self.c;
        let mut e = [T::zero(); 3];
        for k in 1..4 {
            // the formula of the first derivatives, differentiated again
            let kf = k as f64;
            e[k - 1] = c[k + 4] * T::splat(0.25 * kf * (kf + 2.0))
                - c[k + 3] * T::splat(0.25 * (2.0 * kf + 1.0))
                + c[k + 2] * T::splat(0.25);
        }
        e
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ARCS: [[f64; 3]; 8] = [
        [0.0, 0.0, 0.0],
        [1e-12, 2e-12, -1e-12],
        [1e-8, -3e-8, 2e-8],
        [0.03, -0.02, 0.01],
        [0.5, 0.6, -0.3],
        [1.5, -1.0, 2.0],
        [-2.0, 2.5, 1.7],
        [4.0, -3.0, 2.0],
    ];

    #[test]
    fn exponential_is_a_rotation_and_log_its_inverse() {
        for w in ARCS {
            let w = Vec3(w);
            let r = exp(w);
            let defect = r * r.transpose() - Mat3::identity();
            assert!(defect.0.iter().flatten().all(|d| d.abs() < 1e-14));
            if w.norm() < 3.1 {
                assert!((log(&r) - w).norm() < 1e-14 + 1e-13 * w.norm());
            }
        }
        let half_turn = Vec3([0.0, 3.13, 0.0]);
        assert!((log(&exp(half_turn)) - half_turn).norm() < 1e-12);
    }

    #[test]
    fn derivatives_match_central_differences() {
        let (n, m, l) = (Vec3([0.7, -1.1, 0.4]), Vec3([-0.3, 0.8, 1.3]), 0.37);
        let step = 1e-4;
        for w0 in ARCS.map(Vec3) {
            let arc = ArcMap::new(w0, l);
            let eta = |d: Vec3| log(&(exp(w0 + d) * arc.rotation().transpose()));
            let value = |d: Vec3| n.dot(ArcMap::new(w0 + d, l).end()) + m.dot(eta(d));
            let e = |i: usize| {
                let mut v = Vec3::zero();
                v[i] = step;
                v
            };
            let (j, q, h) = (arc.left_jacobian(), arc.end_jacobian(), arc.hessian(n, m));
            let unit = j * arc.left_jacobian_inverse() - Mat3::identity();
            assert!(unit.0.iter().flatten().all(|d| d.abs() < 1e-12));
            for i in 0..3 {
                let de = (ArcMap::new(w0 + e(i), l).end() - ArcMap::new(w0 - e(i), l).end())
                    * (0.5 / step);
                let dr = (eta(e(i)) - eta(-e(i))) * (0.5 / step);
                assert!((q.column(i) - de).norm() < 1e-8, "end at {w0:?}");
                assert!((j.column(i) - dr).norm() < 1e-8, "rotation at {w0:?}");
                for k in 0..3 {
                    let d = (value(e(i) + e(k)) - value(e(i) - e(k)) - value(e(k) - e(i))
                        + value(-e(i) - e(k)))
                        / (4.0 * step * step);
                    assert!((h.0[i][k] - d).abs() < 3e-7, "hessian {i}{k} at {w0:?}");
                }
            }
        }
    }
}

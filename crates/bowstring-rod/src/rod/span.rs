//! A tendon between two disks: a straight span.
//!
//! Theory: docs/theory/rod.md (Tendons).

use crate::math::linalg::{Mat3, Vec3};
use crate::math::real::Real;
use crate::rod::constants::Constants;
use crate::rod::routes::Holes;

/// A straight span of tendon between two neighbouring holes (theory Eq. 2.6).
#[derive(Clone)]
pub struct Span<T> {
    /// Vector from the end of the flexible backbone to the end hole (m).
    pub arm: Vec3<T>,
    /// Length (m).
    pub length: T,
    pub per_length: T,
    pub direction: Vec3<T>,
}

impl<T: Real> Span<T> {
    #[inline(always)]
    pub fn new<const A: usize>(
        c: &Constants<T, A>,
        holes: &Holes<T>,
        s: &Mat3<T>,
        rho: Vec3<T>,
    ) -> Self {
        let [x, y] = holes.end;
        let [start, end] = c.reach;
        let arm = s
            .column(2)
            .scaled_add(end, s.column(1).scaled_add(y, s.column(0) * x));
        let v = rho + arm - Vec3([holes.start[0], holes.start[1], -start]);
        let length = v.norm();
        let per_length = T::splat(1.0) / length;
        Span {
            arm,
            length,
            per_length,
            direction: v * per_length,
        }
    }

    /// Adds the geometric stiffness `T / length (I - d d')`, G of theory Eq. 3.3, to that of other
    /// spans.
    #[inline(always)]
    pub fn add_stiffness(&self, tension: T, others: Mat3<T>) -> Mat3<T> {
        let s = tension * self.per_length;
        (self.direction * -s)
            .outer_add(self.direction, others)
            .add_diagonal([s; 3])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::lie::exp;
    use crate::model::load::Model;
    use crate::model::robot::{Robot, Tendon};
    use crate::parts;
    use crate::random::Draw;

    const STEP: f64 = 1e-6;
    const HOLE: [f64; 2] = [0.02, -0.013];

    fn constants<const A: usize>() -> Constants<f64, A> {
        let mut spec = parts::robot(&[parts::section(1.07)], &[1], [0.07, 0.004], 0.0, &[0]);
        spec.tendons = vec![Tendon::parallel(HOLE, 0)];
        let robot = Robot::new(spec);
        Constants::new(&robot.unwrap(), 0, Model::default())
    }

    /// Holes that differ, and the same hole twice.
    fn holes(parallel: bool) -> Holes<f64> {
        Holes {
            start: if parallel { HOLE } else { [0.012, 0.015] },
            end: HOLE,
            curve: None,
        }
    }

    fn vector(draw: &mut Draw, size: f64) -> Vec3 {
        Vec3([0; 3].map(|_| draw.within(-size, size)))
    }

    /// Central differences of `f` along each axis.
    fn differences<const N: usize>(f: impl Fn(Vec3) -> [f64; N]) -> [[f64; 3]; N] {
        let mut out = [[0.0; 3]; N];
        for axis in 0..3 {
            let step =
                |sign: f64| Vec3([0, 1, 2].map(|i| if i == axis { sign * STEP } else { 0.0 }));
            let (up, down) = (f(step(1.0)), f(step(-1.0)));
            for i in 0..N {
                out[i][axis] = (up[i] - down[i]) / (2.0 * STEP);
            }
        }
        out
    }

    fn assert_near(found: [f64; 3], expected: [f64; 3], scale: f64) {
        for (a, b) in found.iter().zip(expected) {
            assert!(
                (a - b).abs() < 1e-7 * scale,
                "{found:?} against {expected:?}"
            );
        }
    }

    /// Derivatives of a straight span's length are those of theory Eq. 2.6 and 3.3.
    #[test]
    fn derivatives_of_a_straight_span() {
        let c = constants::<2>();
        for number in 0..50 {
            let mut draw = Draw::new(31, number);
            let s = exp(vector(&mut draw, 0.8));
            let rho = Vec3([0.0, 0.0, 0.066]) + vector(&mut draw, 0.02);
            let span = Span::new(&c, &holes(number % 2 == 0), &s, rho);
            let moved =
                differences(|u| [Span::new(&c, &holes(number % 2 == 0), &s, rho + u).length]);
            assert_near(moved[0], span.direction.0, 1.0);
            let turned =
                differences(
                    |u| [Span::new(&c, &holes(number % 2 == 0), &(exp(u) * s), rho).length],
                );
            assert_near(turned[0], span.arm.cross(span.direction).0, 1.0);
            let pull = |u| {
                Span::new(&c, &holes(number % 2 == 0), &s, rho + u)
                    .direction
                    .0
                    .map(|d| 3.0 * d)
            };
            let stiffness = span.add_stiffness(3.0, Mat3::zero()).rows();
            for (found, row) in differences(pull).iter().zip(stiffness) {
                assert_near(*found, row.0, 100.0);
            }
        }
    }
}

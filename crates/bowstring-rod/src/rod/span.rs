//! A tendon between two disks: a straight span, or a path parallel to the backbone.
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

/// A tendon along a curve beside one element (theory Eq. 2.7), by two Gauss points: parallel to the
/// backbone, or from hole to hole in a straight line of the cross-section.
pub struct ParallelPath<T> {
    pub length: T,
    /// Hole, unit tangent and speed at each Gauss point.
    points: [(Vec3<T>, Vec3<T>, T); 2],
    /// Weight of a point: length that it represents (m).
    weight: T,
    /// Derivative of a Gauss point's curvature with respect to the nearer and the farther arc.
    near: T,
    far: T,
}

impl<T: Real> ParallelPath<T> {
    /// In an element of a module, whose arcs are `a` and `b`.
    #[inline(always)]
    pub fn new<const A: usize>(
        c: &Constants<T, A>,
        holes: &Holes<T>,
        stretch: T,
        element: usize,
        [a, b]: [Vec3<T>; 2],
    ) -> Self {
        let elements = A as f64 / 2.0;
        let slope = 3f64.sqrt() / 2.0;
        let part = c.part(element);
        let per_length = c.per_flexible * T::splat(elements) / part;
        let near = per_length * T::splat(1.0 + slope);
        let far = per_length * T::splat(1.0 - slope);
        let weight = c.flexible * part * T::splat(0.5 / elements);
        let start = c.fraction(2 * element);
        let mut length = T::zero();
        let gauss = 0.5 / 3f64.sqrt();
        let points = [(a, b, 0.5 - gauss), (b, a, 0.5 + gauss)].map(|(first, other, place)| {
            let share = part.mul_add(T::splat(place / elements), start);
            let (hole, slope) = holes.between(c, share * c.flexible);
            let mut q = slope + (first * near + other * far).cross(hole);
            q.0[2] += stretch;
            let speed = q.norm();
            length += speed * weight;
            (hole, q * (T::splat(1.0) / speed), speed)
        });
        ParallelPath {
            length,
            points,
            weight,
            near,
            far,
        }
    }

    /// Derivatives of the length with respect to the rotation vectors of the two arcs.
    #[inline(always)]
    pub fn gradient(&self) -> [Vec3<T>; 2] {
        let [p, q] = self.points.map(|(hole, d, _)| hole.cross(d));
        let (near, far) = (self.near * self.weight, self.far * self.weight);
        [p * near + q * far, p * far + q * near]
    }

    /// Second derivatives: blocks first-first, second-first, second-second.
    #[inline(always)]
    pub fn hessian(&self) -> [Mat3<T>; 3] {
        let [p, q] = self.points.map(|(b, d, speed)| {
            let across = b.cross(d);
            (Mat3::scalar(b.norm2()) - b.outer(b) - across.outer(across)) * (self.weight / speed)
        });
        let (n, f) = (self.near, self.far);
        [
            p * (n * n) + q * (f * f),
            (p + q) * (n * f),
            p * (f * f) + q * (n * n),
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::lie::exp;
    use crate::model::load::Model;
    use crate::model::robot::{Disk, Robot, RobotSpec, Section, Tendon};
    use crate::random::Draw;

    const STEP: f64 = 1e-6;
    const HOLE: [f64; 2] = [0.02, -0.013];

    fn constants<const A: usize>() -> Constants<f64, A> {
        let robot = Robot::new(RobotSpec {
            payloads: vec![],
            backbone: vec![Section {
                bending: [1.07; 2],
                principal_angle: 0.0,
                torsion: 0.83,
                axial: 6.9e5,
                shear: 2.6e5,
                mass_per_length: 0.035,
                rotary_inertia: 5.5e-8,
                rest_curvature: [0.0; 3],
            }
            .into()],
            disks: vec![Disk {
                hole_length: 0.0,
                station: 0.07,
                clamped_length: 0.004,
                mass: 0.02,
                inertia: [5.1e-6, 1.02e-5],
                segment: 0,
            }],
            tendons: vec![Tendon::parallel(HOLE, 0)],
            gravity: [0.0; 3],
        });
        Constants::new(&robot.unwrap(), 0, Model::default())
    }

    /// Holes that differ, and the same hole twice.
    fn holes(parallel: bool) -> Holes<f64> {
        Holes {
            start: if parallel { HOLE } else { [0.012, 0.015] },
            end: HOLE,
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

    /// Derivatives of a continuous tendon's length with respect to both arcs of an element.
    #[test]
    fn derivatives_of_a_parallel_path() {
        for number in 0..13 {
            derivatives_in_the_last_element::<2>(number);
            derivatives_in_the_last_element::<4>(number);
            derivatives_in_the_last_element::<8>(number);
            derivatives_in_the_last_element::<16>(number);
        }
    }

    fn derivatives_in_the_last_element<const A: usize>(number: usize) {
        let (c, elements) = (constants::<A>(), A / 2);
        let mut draw = Draw::new(32, number);
        let [a, b] = [0; 2].map(|_| vector(&mut draw, 0.3 / elements as f64));
        let holes = holes(number.is_multiple_of(2));
        let path = |a, b| ParallelPath::new(&c, &holes, 1.01, elements - 1, [a, b]);
        let found = path(a, b);
        let [by_a, by_b] = found.gradient();
        assert_near(differences(|u| [path(a + u, b).length])[0], by_a.0, 0.1);
        assert_near(differences(|u| [path(a, b + u).length])[0], by_b.0, 0.1);
        let [aa, ba, bb] = found.hessian();
        let rows = |by: [[f64; 3]; 3], of: Mat3| {
            for (found, row) in by.iter().zip(of.rows()) {
                assert_near(*found, row.0, 0.1);
            }
        };
        rows(differences(|u| path(a + u, b).gradient()[0].0), aa);
        rows(differences(|u| path(a + u, b).gradient()[1].0), ba);
        rows(differences(|u| path(a, b + u).gradient()[1].0), bb);
    }

    /// On an arc of constant curvature a continuous tendon has the length of the parallel arc.
    #[test]
    fn a_parallel_path_of_an_arc_is_the_parallel_arc() {
        let c = constants::<2>();
        for angle in [0.0, 0.1, -0.4, 1.2] {
            let half = Vec3([0.0, 0.5 * angle, 0.0]);
            let path = ParallelPath::new(&c, &holes(true), 1.0, 0, [half, half]);
            // a bend about y shortens a tendon on the side of +x
            let expected = c.flexible - angle * HOLE[0];
            assert!((path.length - expected).abs() < 1e-12, "{angle}");
        }
    }
}

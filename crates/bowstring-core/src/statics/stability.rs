//! Stability of an equilibrium under dead moments and followers, which have no potential.
//!
//! Theory: docs/theory/statics.md (Stability).

use crate::dispatch;
use crate::math::linalg::{Mat3, Vec3};
use crate::model::load::Load;
use crate::statics::newton::{Attempt, LEAST_PIVOT};
use crate::statics::solver::Solver;
use crate::step::oscillation;

/// Negative pivot, over the unit of the shift, that may still belong to a minimum, by rounding.
const LOST_PIVOT: f64 = 1e-8;
/// Damping ratio at which small oscillations under a moment must decay for stability. Without
/// damping, a moment along a round backbone makes them grow however small it is (Nikolai's
/// paradox).
const FLUTTER_DAMPING: f64 = 0.01;
/// Growth above which damping does not stabilise: the motion hardly oscillates.
const STRONG_GROWTH: f64 = 0.5;

/// What is known of the tangent before the frequencies.
enum Tangent {
    /// Its symmetric part is positive definite: divergence is excluded.
    Positive,
    /// Its symmetric part is not.
    Indefinite,
    /// Followers have an unsymmetric part that may be large.
    Unsymmetric,
}

impl Solver {
    /// Determines the stability of an equilibrium under loads without a potential, which Newton's
    /// method does not. An unstable one is accepted where these loads alone `lead` to it from a
    /// stable one.
    pub(super) fn judged(&mut self, attempt: Attempt, load: &Load, lead: bool) -> Attempt {
        let Attempt::Converged {
            stable: None,
            collision,
        } = attempt
        else {
            return attempt;
        };
        match self.stability(load) {
            Some(false) if !lead => Attempt::Saddle,
            stable => Attempt::Converged { stable, collision },
        }
    }

    /// Whether small damped motions under dead moments decay. A moment adds half of itself as a
    /// skew stiffness against its disk's rotation to a symmetric tangent. Where that is positive
    /// definite, divergence is excluded; and with the disk's flexibility `C` in the plane
    /// perpendicular to the moment, squared frequencies lie within an angle of `|moment| sqrt(det
    /// C) / 2` of the real axis, or within the sum of these over the disks. This decides small
    /// moments. Larger ones and followers need the frequencies.
    pub(super) fn stability(&mut self, load: &Load) -> Option<bool> {
        if load.has_follower() {
            return self.stability_of_motion(load, Tangent::Unsymmetric);
        }
        self.engine.linearise();
        let pivot = self.engine.eliminate(true, 0.0);
        let unit = self.settings.shift_unit;
        // a pivot lost in rounding decides nothing; a NaN is no minimum
        let mut stable = match pivot {
            p if p > LEAST_PIVOT * unit => Some(true),
            p if p > -LOST_PIVOT * unit => None,
            _ => Some(false),
        };
        // a NaN is not small
        if stable == Some(true) && !(self.flutter_angle(load) <= 2.0 * FLUTTER_DAMPING) {
            stable = self.stability_of_motion(load, Tangent::Positive);
        }
        if stable == Some(false) {
            stable = self.stability_of_motion(load, Tangent::Indefinite);
        }
        // restore the tangent of Newton's last step for later queries
        self.engine.eliminate(false, 0.0);
        stable
    }

    /// Bound on the angle between squared frequencies under dead moments and the real axis (rad),
    /// from the last elimination.
    ///
    /// A moment `m` on a disk with the flexibility `C` gives `|m| sqrt(det C') / 2`, where `C'` is
    /// `C` in the plane perpendicular to `m`; and `|m|^2 det C' = m . cof(C) m`. One pass gives the
    /// flexibilities of all disks.
    fn flutter_angle(&self, load: &Load) -> f64 {
        let n = self.robot.module_count();
        let rod = &self.engine;
        let mut angle = 0.0;
        rod.flexibilities(&mut |k, flexibility| {
            let moment = Vec3(load.moment_on(k, n));
            if moment.norm2() > 0.0 {
                let own = rod.disk(k).rotation.tr_mul(moment);
                let [a, b, c] = flexibility.rows();
                let cofactors = Mat3([b.cross(c).0, c.cross(a).0, a.cross(b).0]);
                // negative by rounding alone; a NaN stays
                let square = own.dot(cofactors * own);
                angle += 0.5 * if square < 0.0 { 0.0 } else { square.sqrt() };
            }
        });
        angle
    }

    /// Stability from the frequencies, given the symmetric part of the tangent.
    fn stability_of_motion(&self, load: &Load, tangent: Tangent) -> Option<bool> {
        let oscillates = matches!(tangent, Tangent::Positive);
        let growth = dispatch::check_moving(&self.robot, self.elements)
            .ok()
            .and_then(|()| oscillation::growth(&self.at_rest(), load, oscillates));
        match growth {
            Some(growth) if growth <= FLUTTER_DAMPING => Some(true),
            Some(growth) if growth >= STRONG_GROWTH => Some(false),
            None if matches!(tangent, Tangent::Indefinite) => Some(false),
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::load::Model;
    use crate::model::robot::{Robot, Section};
    use crate::parts;
    use crate::random::Draw;
    use crate::statics::solver::Status;

    /// Angle for the moment on one disk, from the energies of three unit moments on it.
    fn angle_by_substitution(solver: &mut Solver, disk: usize, moment: Vec3) -> f64 {
        let per_module = 2 * solver.elements;
        let rod = &mut solver.engine;
        let size = moment.norm();
        let along = moment * (1.0 / size);
        let least = (0..3).min_by(|a, b| along[*a].abs().total_cmp(&along[*b].abs()));
        let mut axis = Vec3::zero();
        axis[least.unwrap()] = 1.0;
        let first = along.cross(axis);
        let first = first * (1.0 / first.norm());
        let second = along.cross(first);
        // twice the energy of a unit moment on the disk
        let mut solution = |unit: Vec3| {
            let local: Vec<_> = (0..rod.module_count())
                .map(|k| match k {
                    _ if k > disk => Vec3::zero(),
                    0 => unit,
                    _ => rod.disk(k - 1).rotation.tr_mul(unit),
                })
                .collect();
            rod.set_gradient(&|i| local[i / per_module]);
            -rod.newton_step(true).slope
        };
        let (a, b, both) = (solution(first), solution(second), solution(first + second));
        let between = 0.5 * (both - a - b);
        0.5 * size * f64::max(a * b - between * between, 0.0).sqrt()
    }

    fn drawn_robot(draw: &mut Draw) -> Robot {
        let n = 1 + draw.within(0.0, 12.0) as usize;
        let section = Section {
            bending: [1.0, draw.within(0.5, 3.0)],
            principal_angle: draw.within(-1.0, 1.0),
            torsion: draw.within(0.3, 2.0),
            rest_curvature: [0.5, -0.3, 0.2].map(|x| x * draw.within(0.0, 1.0)),
            ..parts::section(1.0)
        };
        let spec = parts::robot(&[section], &[n], [0.06, 0.002], 2.0, &[n - 1; 3]);
        Robot::new(spec).unwrap()
    }

    /// The angle of all disks from one pass equals the sum of those by three substitutions for each
    /// disk, on random robots, loads and numbers of elements, and is smaller by rounding alone.
    #[test]
    fn one_pass_gives_the_angle_of_all_disks() {
        let mut solved = 0;
        for seed in 0..300 {
            let draw = &mut Draw::new(40, seed);
            let robot = drawn_robot(draw);
            let n = robot.module_count();
            let elements = [1, 1, 2, 4][draw.within(0.0, 4.0) as usize];
            let mut vector = |size: f64| [0; 3].map(|_| draw.within(-size, size));
            let moments: Vec<_> = (0..n)
                .map(|k| vector(if k % 3 == 1 { 0.0 } else { 0.1 }))
                .collect();
            let (tip_moment, tip_force) = (vector(0.2), vector(0.4));
            let tensions = vector(10.0).map(f64::abs);
            let load = Load {
                tensions: &tensions,
                gravity: [0.0, 3.0, -9.81],
                tip_force,
                tip_moment,
                disk_moments: &moments,
                ..Load::default()
            };
            let mut solver = Solver::new(&robot, Model::default(), elements).unwrap();
            if solver.solve(&load).unwrap().status != Status::Converged {
                continue;
            }
            solver.engine.linearise();
            if !(solver.engine.eliminate(true, 0.0) > 0.0) {
                continue;
            }
            solved += 1;
            let angle = solver.flutter_angle(&load);
            let mut exact = 0.0;
            for k in 0..n {
                let moment = Vec3(load.moment_on(k, n));
                if moment.norm() > 0.0 {
                    exact += angle_by_substitution(&mut solver, k, moment);
                }
            }
            assert!(exact > 0.0);
            let gap = (angle / exact - 1.0).abs();
            assert!(gap < 1e-9, "{seed}: {angle} {exact}");
        }
        assert!(solved > 200, "{solved}");
    }
}

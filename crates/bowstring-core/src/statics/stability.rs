//! Stability of an equilibrium under dead moments and followers, which have no potential.
//!
//! Theory: docs/theory/statics.md (Stability).

use crate::dispatch;
use crate::math::linalg::Vec3;
use crate::model::load::Load;
use crate::motion::oscillation;
use crate::statics::newton::{Attempt, LEAST_PIVOT};
use crate::statics::solver::Solver;

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
        self.engine.gradient();
        self.engine.eliminate(false, 0.0);
        stable
    }

    /// Bound on the angle between squared frequencies under dead moments and the real axis (rad),
    /// from the last elimination.
    fn flutter_angle(&mut self, load: &Load) -> f64 {
        let n = self.robot.module_count();
        let loaded = (0..n).map(|k| (k, Vec3(load.moment_on(k, n))));
        let loaded = loaded.filter(|(_, moment)| moment.norm() > 0.0);
        let angles: Vec<_> = loaded.map(|(k, m)| self.flutter_angle_of(k, m)).collect();
        angles.into_iter().sum()
    }

    /// The same for the moment on one disk.
    fn flutter_angle_of(&mut self, disk: usize, moment: Vec3) -> f64 {
        let per_module = 2 * self.elements;
        let rod = &mut *self.engine;
        let size = moment.norm();
        let along = moment * (1.0 / size);
        let least = (0..3).min_by(|a, b| along[*a].abs().total_cmp(&along[*b].abs()));
        let mut axis = Vec3::zero();
        axis[least.unwrap_or(0)] = 1.0;
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
        let determinant = f64::max(a * b - between * between, 0.0);
        0.5 * size * determinant.sqrt()
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

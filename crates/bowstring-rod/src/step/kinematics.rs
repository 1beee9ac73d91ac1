//! Position, velocity and acceleration of all mass over a step.
//!
//! Theory: docs/theory/dynamics.md (Eq. 5.2).

use super::mass::{LumpedMass, Nodal};
use super::scheme::Scheme;
use crate::math::copies;
use crate::math::linalg::Vec3;
use crate::math::real::{Layout, Real};

/// Motion of all mass at both ends of a step, by modules.
pub(super) struct Kinematics<T, const A: usize> {
    pub position: Vec<Nodal<T, A>>,
    pub velocity: Vec<Nodal<T, A>>,
    /// Time derivatives of position and velocity as memorised by the scheme: dy/dt and dv/dt of
    /// theory Eq. 5.2.
    rate: Vec<Nodal<T, A>>,
    pub acceleration: Vec<Nodal<T, A>>,
    pub next_position: Vec<Nodal<T, A>>,
    pub next_velocity: Vec<Nodal<T, A>>,
    /// Acceleration, damping included, is `factor (next_position - position) + bias`.
    bias: Vec<Nodal<T, A>>,
    /// Mean acceleration of every disk over the step before.
    last_mean: Vec<Vec3<T>>,
}

/// Kinetic energy, loss and work of the mass in a step.
pub(super) struct MassStep {
    /// Kinetic energy at the end of the step (J).
    pub kinetic: f64,
    /// Energy that a mass-proportional damping of 1/s would dissipate (J s).
    pub loss_by_rate: f64,
    /// Work of the forces on the disks (J).
    pub disk_work: f64,
}

/// Largest estimated error of a disk's position in a step, and that of the tip (m).
#[derive(Clone, Copy)]
pub struct StepError {
    pub largest: f64,
    pub tip: f64,
}

impl<T: Real, const A: usize> Kinematics<T, A> {
    pub fn new(modules: usize) -> Self {
        let zero = || copies(Nodal::zero(), modules);
        Kinematics {
            position: zero(),
            velocity: zero(),
            rate: zero(),
            acceleration: zero(),
            next_position: zero(),
            next_velocity: zero(),
            bias: zero(),
            last_mean: copies(Vec3::zero(), modules),
        }
    }

    /// Prepares a search for an equilibrium.
    pub fn begin_at_rest(&mut self) {
        self.bias.fill(Nodal::zero());
    }

    /// Accepts the next position as one at rest.
    pub fn commit_at_rest(&mut self) {
        self.position.copy_from_slice(&self.next_position);
        for nodal in [&mut self.velocity, &mut self.rate, &mut self.acceleration] {
            nodal.fill(Nodal::zero());
        }
    }

    /// Prepares a step.
    #[inline(always)]
    pub fn begin(&mut self, scheme: &Scheme) {
        let by_change = scheme.am * scheme.rate_by_change() / scheme.af;
        let memory = scheme.memory();
        // acceleration + damping * rate
        let on_rate = (by_change + scheme.damping.mass) * memory;
        for k in 0..self.bias.len() {
            let remembered = self.rate[k].combined(on_rate, &self.acceleration[k], memory);
            self.bias[k] = self.velocity[k].combined(-by_change, &remembered, 1.0);
        }
    }

    /// Position and velocity of a module's mass where forces balance.
    #[inline(always)]
    pub fn at_balance(&self, scheme: &Scheme, k: usize) -> (Nodal<T, A>, Nodal<T, A>) {
        let moved = self.moved(k);
        let place = moved.combined(scheme.af, &self.position[k], 1.0);
        let by_change = scheme.am * scheme.rate_by_change();
        (
            place,
            moved.combined(by_change, &self.rate[k], scheme.memory()),
        )
    }

    /// Displacement of a module's mass in this step.
    #[inline(always)]
    pub fn moved(&self, k: usize) -> Nodal<T, A> {
        self.next_position[k].minus(&self.position[k])
    }

    /// Acceleration of a module's mass where forces balance (theory Eq. 5.1), damping included.
    #[inline(always)]
    pub fn balance_acceleration(&self, scheme: &Scheme, k: usize) -> Nodal<T, A> {
        let factor = scheme.acceleration_by_distance();
        self.moved(k).combined(factor, &self.bias[k], 1.0)
    }

    /// Computes the velocities at the end of the step (theory Eq. 5.2), kinetic energy, loss and
    /// work.
    #[inline(always)]
    pub fn finish<L: Layout<Chain = T>>(
        &mut self,
        scheme: &Scheme,
        mass: &LumpedMass<L, A>,
        disk_force: &[Vec3<T>],
    ) -> MassStep {
        let (mut lost, mut twice_kinetic, mut work) = (T::zero(), T::zero(), T::zero());
        for k in 0..disk_force.len() {
            let (moved, rate, velocity) = self.end_velocity(scheme, k);
            lost += mass.product(k, &rate, &moved);
            twice_kinetic += mass.product(k, &velocity, &velocity);
            work += disk_force[k].dot(moved.disk());
            self.next_velocity[k] = velocity;
        }
        MassStep {
            kinetic: 0.5 * twice_kinetic.lane(0),
            loss_by_rate: lost.lane(0),
            disk_work: work.lane(0),
        }
    }

    /// Computes the velocities at the end of the step alone (theory Eq. 5.2).
    #[inline(always)]
    pub fn set_velocities(&mut self, scheme: &Scheme) {
        for k in 0..self.velocity.len() {
            (_, _, self.next_velocity[k]) = self.end_velocity(scheme, k);
        }
    }

    /// Displacement of a module's mass in this step, its rate where forces balance, and its velocity
    /// at the end.
    #[inline(always)]
    fn end_velocity(&self, scheme: &Scheme, k: usize) -> (Nodal<T, A>, Nodal<T, A>, Nodal<T, A>) {
        let by_change = scheme.am * scheme.rate_by_change();
        let (per, keep) = (1.0 / scheme.af, 1.0 - 1.0 / scheme.af);
        let moved = self.moved(k);
        let rate = moved.combined(by_change, &self.rate[k], scheme.memory());
        let velocity = rate.combined(per, &self.velocity[k], keep);
        (moved, rate, velocity)
    }

    /// Copies the state, without allocation, from another of the same size.
    pub fn copy_from(&mut self, o: &Self) {
        self.position.copy_from_slice(&o.position);
        self.velocity.copy_from_slice(&o.velocity);
        self.rate.copy_from_slice(&o.rate);
        self.acceleration.copy_from_slice(&o.acceleration);
    }

    /// Copies the state of a lane.
    pub fn take_lane(&mut self, o: &Self, lane: usize) {
        for (own, other) in [
            (&mut self.position, &o.position),
            (&mut self.velocity, &o.velocity),
            (&mut self.rate, &o.rate),
            (&mut self.acceleration, &o.acceleration),
        ] {
            for (own, other) in own.iter_mut().zip(other) {
                own.take_lane(other, lane);
            }
        }
    }

    /// Accepts the end of the step as the start of the next.
    #[inline(always)]
    pub fn commit(&mut self, scheme: &Scheme) {
        let (per, keep) = if scheme.fresh {
            (1.0 / scheme.duration, 0.0)
        } else {
            (scheme.rate_by_change(), 1.0 - 1.0 / scheme.gamma)
        };
        for k in 0..self.position.len() {
            self.last_mean[k] = self.mean_acceleration(scheme, k);
            let gained = self.next_velocity[k].minus(&self.velocity[k]);
            self.acceleration[k] = gained.combined(per, &self.acceleration[k], keep);
            self.rate[k] = if scheme.fresh {
                self.next_velocity[k]
            } else {
                self.moved(k).combined(per, &self.rate[k], keep)
            };
        }
        std::mem::swap(&mut self.position, &mut self.next_position);
        std::mem::swap(&mut self.velocity, &mut self.next_velocity);
    }

    /// Estimated error of this step, from the change of acceleration since the step before of
    /// length `last_duration`: `h^3 y''' / 12`.
    #[inline(always)]
    pub fn local_error(&self, scheme: &Scheme, last_duration: f64) -> StepError {
        let h = scheme.duration;
        let scale = h * h / 12.0 * (2.0 * h / (h + last_duration));
        let mut error = StepError {
            largest: 0.0,
            tip: 0.0,
        };
        for k in 0..self.last_mean.len() {
            let change = (self.mean_acceleration(scheme, k) - self.last_mean[k]).of_lane(0);
            error.tip = scale * change.norm();
            error.largest = f64::max(error.largest, error.tip);
        }
        error
    }

    /// Mean acceleration of a disk over this step.
    #[inline(always)]
    fn mean_acceleration(&self, scheme: &Scheme, k: usize) -> Vec3<T> {
        let gained = self.next_velocity[k].disk() - self.velocity[k].disk();
        gained * T::splat(1.0 / scheme.duration)
    }
}

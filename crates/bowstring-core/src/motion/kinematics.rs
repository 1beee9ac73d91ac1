//! Position, velocity and acceleration of all mass over a step.

use super::mass::LumpedMass;
use super::scheme::Scheme;
use crate::math::linalg::{Mat3, Vec3};
use crate::math::real::{Layout, Real};

/// A vector at every mass point, from base to tip, the disk last in each module, and a matrix of
/// directors at every disk.
#[derive(Clone)]
pub(super) struct Nodal<T> {
    pub points: Vec<Vec3<T>>,
    pub frames: Vec<Mat3<T>>,
}

impl<T: Real> Nodal<T> {
    fn zero(points: usize, frames: usize) -> Self {
        Nodal {
            points: vec![Vec3::zero(); points],
            frames: vec![Mat3::zero(); frames],
        }
    }

    fn clear(&mut self) {
        self.points.fill(Vec3::zero());
        self.frames.fill(Mat3::zero());
    }
}

/// Motion of all mass at both ends of a step.
pub(super) struct Kinematics<T, const A: usize> {
    pub position: Nodal<T>,
    pub velocity: Nodal<T>,
    /// Rate of the position, and acceleration, as the scheme remembers them.
    rate: Nodal<T>,
    pub acceleration: Nodal<T>,
    pub next_position: Nodal<T>,
    pub next_velocity: Nodal<T>,
    /// Acceleration, damping included, is `factor (next_position - position) + bias`.
    pub bias: Nodal<T>,
    /// Mean acceleration of every disk over the step before.
    last_mean: Vec<Vec3<T>>,
}

/// What a step does to the mass.
pub(super) struct MassStep {
    /// Kinetic energy at its end, J.
    pub kinetic: f64,
    /// Energy that a mass damping of 1/s would take, J s.
    pub loss_by_rate: f64,
    /// Work of the forces on the disks, J.
    pub disk_work: f64,
}

/// Largest estimated error of a disk's position in a step, and that of the tip, m.
#[derive(Clone, Copy)]
pub(crate) struct StepError {
    pub largest: f64,
    pub tip: f64,
}

impl<T: Real, const A: usize> Kinematics<T, A> {
    pub fn new(modules: usize) -> Self {
        let zero = Nodal::zero(modules * A, modules);
        Kinematics {
            position: zero.clone(),
            velocity: zero.clone(),
            rate: zero.clone(),
            acceleration: zero.clone(),
            next_position: zero.clone(),
            next_velocity: zero.clone(),
            bias: zero,
            last_mean: vec![Vec3::zero(); modules],
        }
    }

    /// Prepares a search for an equilibrium.
    pub fn begin_at_rest(&mut self) {
        self.bias.clear();
    }

    /// Takes the next position as one at rest.
    pub fn commit_at_rest(&mut self) {
        self.position = self.next_position.clone();
        for nodal in [&mut self.velocity, &mut self.rate, &mut self.acceleration] {
            nodal.clear();
        }
    }

    /// Prepares a step.
    #[inline(always)]
    pub fn begin(&mut self, scheme: &Scheme) {
        let by_change = scheme.am * scheme.rate_by_change() / scheme.af;
        let memory = scheme.memory();
        // acceleration + damping * rate
        let on_rate = T::splat((by_change + scheme.damping.mass) * memory);
        let on_velocity = T::splat(-by_change);
        let on_acceleration = T::splat(memory);
        for p in 0..self.bias.points.len() {
            self.bias.points[p] = self.rate.points[p].scaled_add(
                on_rate,
                self.velocity.points[p]
                    .scaled_add(on_velocity, self.acceleration.points[p] * on_acceleration),
            );
        }
        for k in 0..self.bias.frames.len() {
            self.bias.frames[k] = self.rate.frames[k] * on_rate
                + self.velocity.frames[k] * on_velocity
                + self.acceleration.frames[k] * on_acceleration;
        }
    }

    /// Velocities at the end of the step, and what it does to the mass.
    #[inline(always)]
    pub fn finish<L: Layout<Chain = T>>(
        &mut self,
        scheme: &Scheme,
        mass: &LumpedMass<L, A>,
        disk_force: &[Vec3<T>],
    ) -> MassStep {
        // rate = am per (next - now) + memory rate_n; velocity = (rate - (1 - af) velocity_n) / af
        let by_change = scheme.am * scheme.rate_by_change();
        let memory = scheme.memory();
        let (a, b, c) = (
            T::splat(by_change / scheme.af),
            T::splat(memory / scheme.af),
            T::splat(1.0 - 1.0 / scheme.af),
        );
        let (mut lost, mut twice_kinetic, mut work) = (T::zero(), T::zero(), T::zero());
        for p in 0..mass.points.len() {
            let moved = self.next_position.points[p] - self.position.points[p];
            let rate =
                moved.scaled_add(T::splat(by_change), self.rate.points[p] * T::splat(memory));
            let m = T::splat(mass.points[p]);
            lost += rate.dot(moved) * m;
            let velocity = moved.scaled_add(
                a,
                self.rate.points[p].scaled_add(b, self.velocity.points[p] * c),
            );
            twice_kinetic += velocity.norm2() * m;
            self.next_velocity.points[p] = velocity;
            if p % A == A - 1 {
                work += disk_force[p / A].dot(moved);
            }
        }
        for k in 0..mass.directors.len() {
            let moved = self.next_position.frames[k] - self.position.frames[k];
            let rate = moved * T::splat(by_change) + self.rate.frames[k] * T::splat(memory);
            let velocity = moved * a + self.rate.frames[k] * b + self.velocity.frames[k] * c;
            let [e1, e3] = mass.directors[k].map(T::splat);
            for q in 0..3 {
                let (r, m, v) = (rate.0[q], moved.0[q], velocity.0[q]);
                lost += (r[0] * m[0] + r[1] * m[1]) * e1 + r[2] * m[2] * e3;
                twice_kinetic += (v[0] * v[0] + v[1] * v[1]) * e1 + v[2] * v[2] * e3;
            }
            self.next_velocity.frames[k] = velocity;
        }
        MassStep {
            kinetic: 0.5 * twice_kinetic.lane(0),
            loss_by_rate: lost.lane(0),
            disk_work: work.lane(0),
        }
    }

    /// Takes the end of the step as the start of the next.
    #[inline(always)]
    pub fn commit(&mut self, scheme: &Scheme) {
        let gamma = scheme.gamma;
        let per = T::splat(scheme.rate_by_change());
        let keep = T::splat(-(1.0 - gamma) / gamma);
        let once = T::splat(1.0 / scheme.duration);
        for k in 0..self.last_mean.len() {
            self.last_mean[k] = self.mean_acceleration(scheme, k);
        }
        for p in 0..self.position.points.len() {
            let moved = self.next_position.points[p] - self.position.points[p];
            let gained = self.next_velocity.points[p] - self.velocity.points[p];
            if scheme.fresh {
                self.rate.points[p] = self.next_velocity.points[p];
                self.acceleration.points[p] = gained * once;
            } else {
                self.rate.points[p] = moved.scaled_add(per, self.rate.points[p] * keep);
                self.acceleration.points[p] =
                    gained.scaled_add(per, self.acceleration.points[p] * keep);
            }
        }
        for k in 0..self.position.frames.len() {
            let moved = self.next_position.frames[k] - self.position.frames[k];
            let gained = self.next_velocity.frames[k] - self.velocity.frames[k];
            if scheme.fresh {
                self.rate.frames[k] = self.next_velocity.frames[k];
                self.acceleration.frames[k] = gained * once;
            } else {
                self.rate.frames[k] = moved * per + self.rate.frames[k] * keep;
                self.acceleration.frames[k] = gained * per + self.acceleration.frames[k] * keep;
            }
        }
        std::mem::swap(&mut self.position, &mut self.next_position);
        std::mem::swap(&mut self.velocity, &mut self.next_velocity);
    }

    /// Estimated error of this step, by the change of acceleration since the step before, which
    /// took `last_duration`: `h^3 y''' / 12`.
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
        let p = k * A + A - 1;
        let gained = self.next_velocity.points[p] - self.velocity.points[p];
        gained * T::splat(1.0 / scheme.duration)
    }
}

/// The first lane of a matrix.
#[inline(always)]
pub(super) fn of_lane<T: Real>(m: &Mat3<T>) -> Mat3 {
    let mut out = Mat3::zero();
    for r in 0..3 {
        for c in 0..3 {
            out.0[r][c] = m.0[r][c].lane(0);
        }
    }
    out
}

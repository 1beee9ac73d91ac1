//! The whole robot as a chain of modules: the passes that every solver is made of.

use crate::linalg::{Mat3, Vec3};
use crate::load::{Load, Model, TendonPath};
use crate::module::{Constants, DeadLoad, Gradient, ParallelPath, Span, State};
use crate::real::Real;
use crate::robot::{Robot, Tendon};
use crate::sweep::{Eliminated, Value};

/// A robot under load, with its scratch memory: no pass allocates.
#[derive(Clone)]
pub(crate) struct Rod<T, const A: usize> {
    pub constants: Vec<Constants>,
    pub states: Vec<State<T, A>>,
    pub gradients: Vec<Gradient<T, A>>,
    pub eliminated: Vec<Eliminated<T, A>>,
    pub tendons: Vec<Tendon>,
    pub tensions: Vec<T>,
    pub continuous: bool,
    dead: Vec<DeadLoad<T>>,
    masses: Vec<f64>,
    tip_moment: Vec3<T>,
    step: Vec<[Vec3<T>; A]>,
    saved: Vec<[Vec3<T>; A]>,
}

/// What the step promises.
pub(crate) struct Step<T> {
    /// Directional derivative of the energy.
    pub slope: T,
    /// Largest change of an arc's rotation vector, rad.
    pub largest: T,
}

impl<T: Real, const A: usize> Rod<T, A> {
    pub fn new(robot: &Robot, model: Model) -> Self {
        let n = robot.module_count();
        let zero = [Vec3::zero(); A];
        let state = State::straight();
        Rod {
            constants: (0..n)
                .map(|k| Constants::new(robot, k, model, A / 2))
                .collect(),
            states: vec![state; n],
            gradients: vec![Gradient::empty(); n],
            eliminated: vec![Eliminated::empty(); n],
            tendons: robot.spec().tendons.clone(),
            tensions: vec![T::zero(); robot.tendon_count()],
            continuous: model.tendon == TendonPath::Continuous,
            dead: vec![
                DeadLoad {
                    f: [Vec3::zero(); 3]
                };
                n
            ],
            masses: robot.spec().disks.iter().map(|d| d.mass).collect(),
            tip_moment: Vec3::zero(),
            step: vec![zero; n],
            saved: vec![zero; n],
        }
    }

    /// Sets dead loads and tensions, read lane by lane.
    #[inline(always)]
    pub fn set_load(
        &mut self,
        tension: impl Fn(usize) -> T,
        gravity: Vec3<T>,
        tip_force: Vec3<T>,
        tip_moment: Vec3<T>,
    ) {
        for (i, t) in self.tensions.iter_mut().enumerate() {
            *t = tension(i);
        }
        self.tip_moment = tip_moment;
        let mut force = tip_force;
        for k in (0..self.dead.len()).rev() {
            let c = &self.constants[k];
            let (h, [start, end]) = (c.flexible, c.clamp);
            let weight = gravity * T::splat(c.mass_per_length);
            force += gravity * T::splat(self.masses[k]);
            // the flexible part's weight by Hermite's rule: half at each end, and a couple
            self.dead[k].f = [
                force + weight * T::splat(h / 2.0 + end),
                force * T::splat(end) + weight * T::splat(end * end / 2.0 - h * h / 12.0),
                force * T::splat(start)
                    + weight * T::splat(start * (start / 2.0 + h + end) + h * h / 12.0),
            ];
            force += weight * T::splat(h + start + end);
        }
    }

    pub fn has_tip_moment(&self) -> bool {
        self.tip_moment.max_abs().largest() != 0.0
    }

    pub fn make_straight(&mut self) {
        for s in &mut self.states {
            s.w = [Vec3::zero(); A];
            s.n = Vec3::zero();
        }
    }

    /// Forward pass: poses and forces; returns the potential energy (tip moment left out).
    #[inline(always)]
    pub fn evaluate(&mut self) -> T {
        let (mut rotation, mut position) = (Mat3::identity(), Vec3::zero());
        let mut energy = T::zero();
        for ((state, c), load) in self.states.iter_mut().zip(&self.constants).zip(&self.dead) {
            (state.rotation, state.position) = (rotation, position);
            state.evaluate(c, load, &self.tendons, &self.tensions);
            (rotation, position) = state.end_pose(c);
            energy += state.energy;
        }
        energy
    }

    /// Backward pass: gradient by the exact costate; returns the largest moment imbalance, N m.
    #[inline(always)]
    pub fn gradient(&mut self) -> T {
        let n = self.states.len();
        let (tip, _) = self.tip();
        let mut lambda = -tip.tr_mul(self.tip_moment);
        let mut residual = T::zero();
        for k in (0..n).rev() {
            let out = &mut self.gradients[k];
            lambda = self.states[k].gradient(
                &self.constants[k],
                &self.tendons,
                &self.tensions,
                lambda,
                out,
            );
            for g in &out.g {
                residual = residual.max(g.max_abs());
            }
        }
        residual
    }

    /// Backward pass: eliminates every strain; returns the least pivot, positive at a minimum.
    #[inline(always)]
    pub fn eliminate<const SYMMETRIC: bool>(&mut self, shift: T) -> T {
        let n = self.states.len();
        // in its log chart a rotation sees a dead moment as a skew stiffness
        let (tip, _) = self.tip();
        let mut value = Value {
            matrix: (tip.tr_mul(self.tip_moment) * T::splat(-0.5)).skew(),
            least_pivot: T::splat(f64::INFINITY),
        };
        for k in (0..n).rev() {
            let (state, gradient) = (&self.states[k], &self.gradients[k]);
            let hessian =
                state.hessian(&self.constants[k], &self.tendons, &self.tensions, gradient);
            self.eliminated[k]
                .eliminate::<SYMMETRIC>(hessian, gradient, &state.s, shift, &mut value);
        }
        value.least_pivot
    }

    /// The Newton step from the present gradient and elimination.
    #[inline(always)]
    pub fn newton_step<const SYMMETRIC: bool>(&mut self) -> Step<T> {
        let n = self.states.len();
        let mut p = Vec3::zero();
        for k in (0..n).rev() {
            let gradient = &self.gradients[k];
            let (answer, start) = self.eliminated[k].backward::<SYMMETRIC>(
                &gradient.h,
                gradient.g,
                self.states[k].s * p,
            );
            self.step[k] = answer;
            p = start;
        }
        let mut x = Vec3::zero();
        let (mut slope, mut largest) = (T::zero(), T::zero());
        for k in 0..n {
            let gradient = &self.gradients[k];
            let (u, end) = self.eliminated[k].forward(&gradient.h, &self.step[k], x);
            self.step[k] = u;
            x = self.states[k].s.tr_mul(end);
            for i in 0..A {
                slope += gradient.g[i].dot(u[i]);
                largest = largest.max(u[i].max_abs());
            }
        }
        Step { slope, largest }
    }

    /// Takes the step as the next right-hand side: inverse iteration.
    pub fn direction_to_gradient(&mut self, scale: T) {
        for (gradient, step) in self.gradients.iter_mut().zip(&self.step) {
            gradient.g = step.map(|v| v * scale);
        }
    }

    pub fn save(&mut self) {
        for (saved, state) in self.saved.iter_mut().zip(&self.states) {
            *saved = state.w;
        }
    }

    /// Moves from the saved strain by a fraction of the step.
    #[inline(always)]
    pub fn advance(&mut self, fraction: T) {
        for ((state, saved), step) in self.states.iter_mut().zip(&self.saved).zip(&self.step) {
            for i in 0..A {
                state.w[i] = saved[i] + step[i] * fraction;
            }
        }
    }

    /// Adds the step to the strain.
    #[inline(always)]
    pub fn advance_fully(&mut self) {
        for (state, step) in self.states.iter_mut().zip(&self.step) {
            for i in 0..A {
                state.w[i] += step[i];
            }
        }
    }

    /// Pose of the tip in the base frame.
    #[inline(always)]
    pub fn tip(&self) -> (Mat3<T>, Vec3<T>) {
        let last = self.states.len() - 1;
        self.states[last].end_pose(&self.constants[last])
    }

    /// Pose of disk `k`.
    pub fn disk(&self, k: usize) -> (Mat3<T>, Vec3<T>) {
        self.states[k].end_pose(&self.constants[k])
    }

    /// Length of a tendon from the base hole to its end disk's hole, m.
    pub fn tendon_length(&self, i: usize) -> T {
        let mut length = T::zero();
        for k in 0..=self.tendons[i].end_disk {
            let (c, state) = (&self.constants[k], &self.states[k]);
            if self.continuous {
                length += state.parallel_length(c, &self.tendons[i], &self.tensions);
            } else {
                length += Span::new(c, &self.tendons[i], &state.s, state.rho).length;
            }
        }
        length
    }
}

impl<T: Real, const A: usize> State<T, A> {
    /// Length of a continuous tendon in this module.
    fn parallel_length(&self, c: &Constants, tendon: &Tendon, tensions: &[T]) -> T {
        let stretch = self.stretch(c, &tensions[c.first_tendon..]);
        let mut length = T::splat(c.clamp[0] + c.clamp[1]);
        for i in (0..A).step_by(2) {
            length += ParallelPath::new(c, A, tendon, stretch, self.w[i], self.w[i + 1]).length;
        }
        // dead loads stretch the backbone, and the tendon with it
        let along = self.rho0 * (T::splat(1.0) / self.rho0.norm());
        length + along.dot(self.rho - self.rho0)
    }
}

impl<const A: usize> Rod<f64, A> {
    /// Sets a load that was checked before.
    pub fn load(&mut self, load: &Load) {
        self.set_load(
            |i| load.tensions[i],
            Vec3(load.gravity),
            Vec3(load.tip_force),
            Vec3(load.tip_moment),
        );
    }

    /// Whether a loaded span points backward: its two disks would have to pass through each other.
    pub fn disks_collide(&self) -> Option<usize> {
        if self.continuous {
            return None;
        }
        (0..self.states.len()).find(|&k| {
            let (c, state) = (&self.constants[k], &self.states[k]);
            (c.first_tendon..self.tendons.len()).any(|i| {
                self.tensions[i] > 0.0 && {
                    let span = Span::new(c, &self.tendons[i], &state.s, state.rho);
                    let mid = state.s.column(2) + Vec3::ez();
                    !(span.direction.dot(mid) > 0.0)
                }
            })
        })
    }
}

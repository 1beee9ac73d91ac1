//! The passes of Newton's method over a time step of the rod, compiled for the instructions of its
//! numbers.
//!
//! Theory: docs/theory/dynamics.md (Time integration).

use super::energy::{Energies, EnergyBalance};
use super::kinematics::StepError;
use super::motion::Motion;
use super::record::Fields;
use super::strain::Strain;
use crate::interrupt;
use crate::math::linalg::Vec3;
use crate::math::real::{Layout, Real};
use crate::model::load::Load;
use crate::rod::groups::put;
use crate::rod::responses::Sources;
use crate::rod::routed::RoutedRod;

/// Rounding error of the forces of a step, over their sum.
const ROUNDING: f64 = 4.0 * f64::EPSILON;

/// A moving rod in any number type: the passes of a step, and the queries between them.
pub trait Moving: RoutedRod + Send + Sync {
    /// Prepares a step: loads are those at [`Moving::balance_time`].
    fn begin(&mut self, duration: f64, rho: f64);
    /// Computes the forces at the present strain; returns the largest moment imbalance (N m).
    fn residual(&mut self) -> f64;
    /// Computes the imbalance under the present tensions and forces on all mass; returns the
    /// largest (N m).
    fn imbalance(&mut self) -> f64;
    /// Prepares the tangent. That of an earlier step is close to the present one, and a new one
    /// costs five times a residual; it is recomputed only if `anew`, or if step or scheme differ.
    /// Returns whether it was.
    fn ready(&mut self, anew: bool) -> bool;
    /// Solves for the present imbalance.
    fn substitute(&mut self);
    /// Moves the end of the step by a linear combination of solutions.
    fn combine(&mut self, coefficients: &[f64]);
    /// Computes velocities, lengths and energies at the end of the step.
    fn finish(&mut self, load: &Load);
    /// Sets the damping that removes this excess of energy when the finished step is solved again;
    /// less than all of it where hardly anything moves. Only without numerical damping. Returns
    /// whether that changes the step.
    fn restore(&mut self, excess: f64) -> bool;
    /// Estimated error of this step; `None` while unknown.
    fn local_error(&self) -> Option<StepError>;
    /// Accepts the end of the step as the start of the next.
    fn commit(&mut self);
    /// Appends all present fields; see [`Motion::record_now`].
    fn record(&self, time: f64, tensions: &[f64], points: usize, out: &mut Fields);

    /// Prepares a search for the equilibrium under the present forces: a step without inertia.
    fn begin_at_rest(&mut self);
    /// Accepts the equilibrium as the state at rest, with the energy of the tendons (J).
    fn commit_at_rest(&mut self, tendons: f64);
    /// Copies the strain of every arc and the contact force of every module from an equilibrium.
    fn take_strain(&mut self, strain: &[Vec3], force: &[Vec3]);
    /// Sets tensions, and forces and moments on tip and disks; gravity is constant.
    fn set_load(&mut self, load: &Load);
    /// Sets the dead force on a disk (N, base frame), in addition to the loads.
    fn set_disk_force(&mut self, disk: usize, force: Vec3);
    /// Sets tensions at once. Disks do not move in a jump, but where tendons run along the backbone
    /// the contact forces jump too. Points inside a module have no degree of freedom of their own
    /// and are moved to their equilibrium under the new tensions.
    fn jump_tensions(&mut self, tensions: &[f64]);
    /// Starts the next step without the scheme's memory, hence without numerical damping.
    fn restart(&mut self);
    /// Starts the next step's predictor from the present strain and its rate alone.
    fn reset_predictor(&mut self);
    /// Omits the forces of the present strain from the next tangent, but keeps tendons and
    /// stiffness. The predictor of a short step may have unrealistic forces that make the tangent
    /// indefinite; inertia then determines the direction of the step.
    fn drop_forces(&mut self);
    /// Whether the scheme has no memory.
    fn is_fresh(&self) -> bool;
    /// Whether no two disks have collided at the end of the finished step.
    fn is_apart(&self) -> bool;
    /// Whether an equilibrium is stable, see [`Tangent::is_stable`].
    fn is_stable(&self, held: usize) -> bool;
    /// Fraction of the step at which forces balance.
    fn balance_time(&self) -> f64;
    /// Moment imbalance due to rounding of the forces of this step (N m).
    fn noise(&self, tensions: &[f64]) -> f64;
    /// Moment that moves all mass by `distance` within this step (N m).
    fn effort(&self, distance: f64) -> f64;
    /// Present position of a disk (m).
    fn disk(&self, k: usize) -> Vec3;
    /// Present linear momentum of all mass (kg m/s).
    fn linear_momentum(&self) -> Vec3;
    /// Energies at both ends of the step.
    fn energies(&self) -> &EnergyBalance;
    fn energies_mut(&mut self) -> &mut EnergyBalance;
    /// Work of an iteration, in units of `interrupt::work`.
    fn work(&self) -> usize;
}

impl<L: Layout, const A: usize> Moving for Motion<L, A> {
    fn begin(&mut self, duration: f64, rho: f64) {
        self.body.rod.layout.vectorize(
            #[inline(always)]
            || {
                self.body.scheme.begin(duration, rho);
                self.kinematics.begin(&self.body.scheme);
                if self.body.scheme.damping.material != 0.0 {
                    self.body.stiffen();
                    self.strain.set_offset(&self.body.scheme);
                }
                self.strain.predict(&self.body.scheme, &mut self.next);
            },
        )
    }

    fn residual(&mut self) -> f64 {
        self.forces().largest()
    }

    fn imbalance(&mut self) -> f64 {
        let imbalance = self.residual.evaluate(&mut self.body, &self.strain);
        imbalance.largest()
    }

    fn ready(&mut self, anew: bool) -> bool {
        let made = anew || !self.tangent.serves(&self.body.scheme);
        if made {
            self.linearise();
        }
        made
    }

    fn substitute(&mut self) {
        let (rod, tangent) = (&self.body.rod, &mut self.tangent);
        self.response.solve_imbalance(rod, tangent, &self.residual);
    }

    fn combine(&mut self, coefficients: &[f64]) {
        let (body, tangent, next) = (&self.body, &self.tangent, &mut self.next);
        body.rod.layout.vectorize(
            #[inline(always)]
            || self.response.combine(body, tangent, coefficients, next),
        )
    }

    fn finish(&mut self, load: &Load) {
        self.body.rod.layout.vectorize(
            #[inline(always)]
            || {
                let (scheme, force) = (&self.body.scheme, &self.residual.disk_force);
                let step = self.kinematics.finish(scheme, &self.body.mass, force);
                let mut dissipated = scheme.damping.mass * step.loss_by_rate;
                if scheme.damping.material != 0.0 {
                    dissipated += scheme.damping.material * self.strain_loss();
                }
                self.measure();
                let tendon_work = self.work_of_tendons();
                // that of forces on disks is in `step`
                let tip_work = Vec3(load.tip_force).dot(self.tip_displacement());
                let work_on_disks =
                    self.work_on_disks() + self.residual.work_of_base(&self.body, &self.kinematics);
                let before = self.energies.now;
                self.energies = EnergyBalance {
                    now: before,
                    next: Energies {
                        kinetic: step.kinetic,
                        work: before.work
                            + (step.disk_work + tendon_work + tip_work + work_on_disks),
                        dissipated: before.dissipated + dissipated,
                        ..self.stored_energies()
                    },
                    tendon_work,
                    loss_by_rate: step.loss_by_rate,
                };
            },
        )
    }

    fn restore(&mut self, excess: f64) -> bool {
        let loss_by_rate = self.energies.loss_by_rate;
        self.body.scheme.restore(excess, loss_by_rate)
    }

    fn local_error(&self) -> Option<StepError> {
        let scheme = &self.body.scheme;
        if scheme.fresh {
            return None;
        }
        let last = self.strain.last_duration()?;
        Some(self.kinematics.local_error(scheme, last))
    }

    fn commit(&mut self) {
        self.body.rod.layout.vectorize(
            #[inline(always)]
            || {
                self.kinematics.commit(&self.body.scheme);
                self.strain.commit(&self.body.scheme, &self.next);
            },
        );
        self.keep_forces();
        self.body.scheme.fresh = false;
        std::mem::swap(&mut self.spans.now, &mut self.spans.next);
        self.energies.now = self.energies.next;
    }

    fn record(&self, time: f64, tensions: &[f64], points: usize, out: &mut Fields) {
        self.body.rod.layout.vectorize(
            #[inline(always)]
            || self.record_now(time, tensions, points, out),
        )
    }

    fn begin_at_rest(&mut self) {
        self.body.scheme.begin_at_rest();
        self.body.stiffen();
        // stability is read from its pivots, so it must belong to these forces
        self.tangent.invalidate();
        self.strain.offset.fill(Strain::zero());
        self.kinematics.begin_at_rest();
    }

    fn commit_at_rest(&mut self, tendons: f64) {
        self.strain.push_at_rest(&self.next);
        self.keep_forces();
        self.body.scheme.fresh = true;
        self.measure();
        self.energies.now = self.stored_energies();
        self.energies.now.elastic += tendons;
        std::mem::swap(&mut self.spans.now, &mut self.spans.next);
        self.kinematics.commit_at_rest();
        self.body.stiffen();
    }

    fn take_strain(&mut self, strain: &[Vec3], force: &[Vec3]) {
        for (k, (strain, force)) in strain.chunks_exact(A).zip(force).enumerate() {
            let (state, i) = (&mut self.next[k / L::WIDTH], k % L::WIDTH);
            for a in 0..A {
                put::<L>(&mut state.w[a], i, Vec3::splat(strain[a].0));
            }
            put::<L>(&mut state.n, i, Vec3::splat(force.0));
        }
        // discards earlier strain
        self.strain.push(&self.next);
        self.keep_forces();
    }

    fn set_load(&mut self, load: &Load) {
        let rod = &mut self.body.rod;
        rod.set_tensions(|i| L::Chain::splat(load.tensions[i]));
        if rod.set_attached(load) {
            self.body.divide();
        }
        let rod = &mut self.body.rod;
        if !rod.attached.has_forces() {
            self.residual.point_force.fill(Vec3::zero());
        }
        self.residual.tip_force = Vec3::splat(load.tip_force);
        self.residual.load_disks(load.disk_forces);
        self.residual.load_lines(load.line_forces, &self.body.rod);
        self.residual.move_base(&load.base);
    }

    fn set_disk_force(&mut self, disk: usize, force: Vec3) {
        self.residual.hold_disk(disk, force.0);
    }

    fn jump_tensions(&mut self, tensions: &[f64]) {
        let (rod, scheme) = (&mut self.body.rod, &self.body.scheme);
        if scheme.rigid || !rod.path.is_continuous() {
            return;
        }
        rod.set_tensions(|i| L::Chain::splat(tensions[i]));
        self.keep_disks();
        self.measure();
        self.spans.now.copy_from_slice(&self.spans.next);
    }

    fn restart(&mut self) {
        self.body.scheme.fresh = true;
    }

    fn reset_predictor(&mut self) {
        self.strain.reset_predictor(&self.body.scheme);
    }

    fn drop_forces(&mut self) {
        let rod = &mut self.body.rod;
        for (state, gradient) in rod.states.iter_mut().zip(&mut rod.gradients) {
            state.f[..2].fill(Vec3::zero());
            state.lambda = Vec3::zero();
            gradient.drop_forces();
        }
    }

    fn is_fresh(&self) -> bool {
        self.body.scheme.fresh
    }

    fn is_apart(&self) -> bool {
        self.spans.forward > 0.0
    }

    fn is_stable(&self, held: usize) -> bool {
        self.tangent.is_stable(held)
    }

    fn balance_time(&self) -> f64 {
        self.body.scheme.af
    }

    fn noise(&self, tensions: &[f64]) -> f64 {
        let tension: f64 = tensions.iter().sum();
        let weight = self.residual.gravity.norm().lane(0) * self.body.mass.total;
        let inertia = self.effort(1.0);
        let (on_disks, own) = (&self.residual.disk_force, &self.residual.point_force);
        let mut dead = 0.0;
        for forces in [on_disks, own, &self.residual.lines] {
            for force in forces {
                dead += force.norm().lane(0);
            }
        }
        dead += self.residual.tip_force.norm().lane(0);
        let force = tension + weight + inertia + dead;
        ROUNDING * force * self.length
    }

    fn effort(&self, distance: f64) -> f64 {
        let acceleration = distance * self.body.scheme.acceleration_by_distance();
        acceleration * self.body.mass.total * self.length
    }

    fn disk(&self, k: usize) -> Vec3 {
        self.kinematics.position[k].disk().of_lane(0)
    }

    fn linear_momentum(&self) -> Vec3 {
        self.body.mass.sum(&self.kinematics.velocity).of_lane(0)
    }

    fn energies(&self) -> &EnergyBalance {
        &self.energies
    }

    fn energies_mut(&mut self) -> &mut EnergyBalance {
        &mut self.energies
    }

    fn work(&self) -> usize {
        A * self.module_count() * (8 + self.body.rod.tendons.len())
    }
}

impl<L: Layout, const A: usize> RoutedRod for Motion<L, A> {
    fn measure_spans(&mut self, angles: bool) {
        self.body.rod.measure_spans(angles);
        self.measure();
    }

    fn span_lengths(&self) -> &[f64] {
        &self.spans.next
    }

    fn angles(&self) -> &[f64] {
        &self.body.rod.spans.angles
    }

    fn beyond(&self, hole: usize, tendon: usize, out: &mut [f64]) {
        let n = self.module_count();
        let stride = self.next.len() * L::WIDTH;
        for (out, column) in out.iter_mut().zip(&self.response.columns) {
            *out = column.rates[tendon * stride..][hole..n].iter().sum();
        }
    }

    fn bend(&self, module: usize) -> f64 {
        self.body.rod.bend(module)
    }

    /// Nothing: no motion takes a clearance in the holes.
    fn add_bending(&self, _: usize, _: f64, _: &mut [f64]) {}

    fn respond(&mut self, sources: Sources) {
        let (body, response, tangent) = (&self.body, &mut self.response, &mut self.tangent);
        let (rod, n) = (&body.rod, body.rod.module_count());
        let own = std::iter::once(None);
        for (column, source) in own.chain(sources.iter(n).map(Some)).enumerate() {
            if interrupt::work(n * (16 + 2 * rod.tendons.len())) {
                return;
            }
            match source {
                None => response.solve_imbalance(rod, tangent, &self.residual),
                Some(source) => response.solve_tension(rod, tangent, column, source),
            }
            response.rate_spans(body, tangent, column);
        }
    }

    fn set_span_tensions(&mut self, tensions: &[f64]) {
        let rod = &mut self.body.rod;
        let count = rod.tendons.len();
        rod.set_span_tensions(|k, i| tensions[k * count + i]);
    }
}

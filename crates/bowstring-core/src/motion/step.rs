//! One implicit time step of the rod: its state, and the passes of Newton's method over it.

use super::energy::{Energies, EnergyBalance};
use super::kinematics::{of_lane, Kinematics, StepError};
use super::mass::LumpedMass;
use super::residual::Residual;
use super::response::Response;
use super::scheme::{Damping, Scheme};
use super::spans::SpanLengths;
use super::strain::{Strain, StrainHistory};
use super::tangent::Tangent;
use crate::math::lie::log;
use crate::math::linalg::{Mat3, Vec3};
use crate::math::real::{Layout, Real};
use crate::model::load::{Load, Model, TendonPath, Theory};
use crate::model::robot::Robot;
use crate::rod::chain::{get, get_mat, in_group, put, Rod, Sources};
use crate::rod::constants::Constants;
use crate::rod::module::State;

/// Compliance of a Kirchhoff rod's module over that of its bending: small enough not to show,
/// large enough to divide by.
const NEARLY_RIGID: f64 = 1e-5;
/// Rounding of the forces of a step, over their sum.
const ROUNDING: f64 = 4.0 * f64::EPSILON;

/// A moving rod.
pub(crate) struct Motion<L: Layout, const A: usize> {
    /// At the strain where forces balance.
    pub(super) rod: Rod<L, A>,
    /// Strain at the end of the step.
    pub(super) next: Vec<State<L::Module, A>>,
    /// Stiffness with the material damping of this step.
    pub(super) constants: Vec<Constants<L::Module>>,
    pub(super) scheme: Scheme,
    pub(super) strain: StrainHistory<L, A>,
    pub(super) mass: LumpedMass<L, A>,
    pub(super) kinematics: Kinematics<L::Chain, A>,
    pub(super) residual: Residual<L, A>,
    pub(super) tangent: Tangent<L, A>,
    pub(super) response: Response<L, A>,
    pub(super) spans: SpanLengths,
    pub(super) balance: EnergyBalance,
    /// Length of the straight robot, m.
    length: f64,
}

impl<L: Layout, const A: usize> Motion<L, A> {
    pub fn new(
        layout: L,
        robot: &Robot,
        model: Model,
        gravity: [f64; 3],
        damping: Damping,
    ) -> Self {
        let mut rod = Rod::new(layout, robot, model);
        let rigid = model.theory == Theory::Kirchhoff;
        if rigid {
            rod.make_yielding(NEARLY_RIGID);
        }
        let n = robot.module_count();
        Motion {
            next: rod.states.clone(),
            constants: rod.constants.clone(),
            scheme: Scheme::new(damping, rigid),
            strain: StrainHistory::new(rod.states.len()),
            mass: LumpedMass::new(robot),
            kinematics: Kinematics::new(n),
            residual: Residual::new(n, gravity),
            tangent: Tangent::new(n),
            response: Response::new(n),
            spans: SpanLengths::new(n * robot.tendon_count()),
            balance: EnergyBalance::default(),
            length: robot.length(),
            rod,
        }
    }

    /// Of an iteration, in units of `interrupt::work`.
    pub fn work(&self) -> usize {
        A * self.module_count() * (8 + self.rod.tendons.len())
    }

    pub fn layout(&self) -> L {
        self.rod.layout
    }

    pub fn module_count(&self) -> usize {
        self.rod.module_count()
    }

    /// Takes strain and contact force from an equilibrium.
    pub fn take_strain(&mut self, strain: impl Fn(usize) -> Vec3, force: impl Fn(usize) -> Vec3) {
        for k in 0..self.module_count() {
            let (g, i) = (k / L::WIDTH, k % L::WIDTH);
            let state = &mut self.next[g];
            for a in 0..A {
                put::<L>(&mut state.w[a], i, Vec3::splat(strain(k * A + a).0));
            }
            put::<L>(&mut state.n, i, Vec3::splat(force(k).0));
        }
        // earlier strain does not count
        self.strain.push(&self.next);
        self.keep_forces();
    }

    /// Sets tensions and tip load; gravity stays.
    pub fn set_load(&mut self, load: &Load) {
        self.rod.set_tensions(|i| L::Chain::splat(load.tensions[i]));
        self.rod.dead.tip_moment = Vec3::splat(load.tip_moment);
        self.residual.tip_force = Vec3::splat(load.tip_force);
    }

    /// Dead forces on the disks beside the loads, N, base frame.
    pub fn set_disk_force(&mut self, disk: usize, force: Vec3) {
        self.residual.disk_force[disk] = Vec3::splat(force.0);
    }

    pub fn set_span_tensions(&mut self, tension: impl Fn(usize, usize) -> f64) {
        self.rod.set_span_tensions(tension);
    }

    /// Lets tensions jump, which moves no disk at once: where tendons run along the backbone the
    /// contact forces jump with them. Points inside a module have none of their own and are put
    /// where the new tensions hold them.
    pub fn jump_tensions(&mut self, tensions: &[f64]) {
        if self.scheme.rigid || self.rod.path != TendonPath::Continuous {
            return;
        }
        self.rod.set_tensions(|i| L::Chain::splat(tensions[i]));
        for g in 0..self.next.len() {
            let t = in_group(&self.rod.tendons, &self.rod.tensions, self.rod.path, g);
            let (c, state) = (&self.rod.constants[g], &mut self.next[g]);
            let end = state.rho;
            state.shape(c, &t);
            state.n = state.compliance(c).inverse() * (end - state.rho0);
            state.rho = end;
            self.strain.set_start_force(g, state.n);
        }
        self.place_mass();
        let now = &mut self.kinematics;
        now.position
            .points
            .copy_from_slice(&now.next_position.points);
        self.measure();
        self.spans.now.copy_from_slice(&self.spans.next);
    }

    /// Puts energy in at once, J.
    pub fn put_in(&mut self, energy: f64) {
        self.balance.now.elastic += energy;
        self.balance.now.work += energy;
    }

    /// Lets the next step go without the scheme's memory and its numerical damping.
    pub fn restart(&mut self) {
        self.scheme.fresh = true;
    }

    /// Starts the next step's search from the present strain and its rate alone.
    pub fn reset_predictor(&mut self) {
        self.strain.reset_predictor(&self.scheme);
    }

    /// Whether the scheme has no memory.
    pub fn is_fresh(&self) -> bool {
        self.scheme.fresh
    }

    /// Whether no two disks have met, as of the step that was finished.
    pub fn is_apart(&self) -> bool {
        self.spans.forward > 0.0
    }

    /// Whether an equilibrium is stable, see [`Tangent::is_stable`].
    pub fn is_stable(&self, held: usize) -> bool {
        self.tangent.is_stable(held)
    }

    /// Position of a disk now.
    pub fn disk(&self, k: usize) -> Vec3 {
        self.kinematics.position.points[k * A + A - 1].of_lane(0)
    }

    /// Of all mass now, kg m/s.
    pub fn linear_momentum(&self) -> Vec3 {
        let mut sum = Vec3::zero();
        let velocities = &self.kinematics.velocity.points;
        for (v, mass) in velocities.iter().zip(&self.mass.points) {
            sum += *v * L::Chain::splat(*mass);
        }
        sum.of_lane(0)
    }

    /// Energies now.
    pub fn energies(&self) -> &Energies {
        &self.balance.now
    }

    /// Energies at the end of the step that was finished.
    pub fn next_energies(&self) -> &Energies {
        &self.balance.next
    }

    /// Work of the tendons on the disks in the step that was finished, J.
    pub fn tendon_work(&self) -> f64 {
        self.balance.tendon_work
    }

    /// Prepares a search for the equilibrium at the present forces: a step without inertia.
    pub fn begin_at_rest(&mut self) {
        self.scheme.begin_at_rest();
        self.stiffen();
        // its pivots tell of stability, so it must be that of these forces
        self.tangent.invalidate();
        self.strain.offset.fill(Strain::zero());
        self.kinematics.begin_at_rest();
    }

    /// Takes the equilibrium that was found as the state at rest, with the energy of the tendons.
    pub fn commit_at_rest(&mut self, tendons: f64) {
        self.strain.push_at_rest(&self.next);
        self.keep_forces();
        self.scheme.fresh = true;
        self.measure();
        self.balance.now = self.stored_energies();
        self.balance.now.elastic += tendons;
        std::mem::swap(&mut self.spans.now, &mut self.spans.next);
        self.kinematics.commit_at_rest();
        self.stiffen();
    }

    /// Prepares a step: loads are those at [`Motion::balance_time`].
    #[inline(always)]
    pub fn begin(&mut self, duration: f64, rho: f64) {
        self.scheme.begin(duration, rho);
        self.kinematics.begin(&self.scheme);
        if self.scheme.damping.material != 0.0 {
            self.stiffen();
            self.strain.set_offset(&self.scheme);
        }
        self.strain.predict(&self.scheme, &mut self.next);
    }

    /// Where in the step forces balance, as a fraction.
    pub fn balance_time(&self) -> f64 {
        self.scheme.af
    }

    /// Scales the stiffness by what material damping adds to it in this step.
    #[inline(always)]
    fn stiffen(&mut self) {
        let factor = L::Module::splat(self.scheme.strain_factor());
        for (c, elastic) in self.constants.iter_mut().zip(&self.rod.constants) {
            c.stiffness = [elastic.stiffness[0] * factor, elastic.stiffness[1] * factor];
        }
    }

    /// Moment that rounding leaves of the forces of this step, N m.
    pub fn noise(&self, tensions: &[f64]) -> f64 {
        let pull: f64 = tensions.iter().sum();
        let weight = self.residual.gravity.norm().lane(0) * self.mass.total;
        let inertia = self.effort(1.0);
        let force = pull + weight + inertia + self.residual.tip_force.norm().lane(0);
        ROUNDING * force * self.length
    }

    /// Moment that moves all mass by so much further within this step, N m.
    pub fn effort(&self, distance: f64) -> f64 {
        distance * self.scheme.acceleration_by_distance() * self.mass.total * self.length
    }

    /// Forces at the present strain; returns the largest moment imbalance, N m.
    #[inline(always)]
    pub fn residual(&mut self) -> f64 {
        self.shape();
        self.place_mass();
        self.residual.set_inertial(
            &self.scheme,
            &self.mass,
            &self.kinematics,
            &self.rod.rotations,
        );
        self.imbalance()
    }

    /// Imbalance under the present tensions and forces on all mass; returns the largest, N m.
    #[inline(always)]
    pub fn imbalance(&mut self) -> f64 {
        self.residual
            .evaluate(&mut self.rod, &self.constants, &self.strain, &self.scheme)
    }

    /// Poses of all modules where forces balance and at the end of the step.
    #[inline(always)]
    fn shape(&mut self) {
        let af = L::Module::splat(self.scheme.af);
        let af_force = L::Module::splat(self.scheme.force_share());
        for g in 0..self.next.len() {
            let t = in_group(&self.rod.tendons, &self.rod.tensions, self.rod.path, g);
            let c = &self.rod.constants[g];
            let (now, next) = (&mut self.rod.states[g], &mut self.next[g]);
            let start = &self.strain.start()[g];
            for a in 0..A {
                now.w[a] = (next.w[a] - start.w[a]).scaled_add(af, start.w[a]);
            }
            now.n = (next.n - start.n).scaled_add(af_force, start.n);
            for state in [now, next] {
                state.shape(c, &t);
                state.rho = state.rho0 + state.compliance(c) * state.n;
            }
        }
    }

    /// Rotations where forces balance, and all mass at the end of the step.
    #[inline(always)]
    fn place_mass(&mut self) {
        let place = &mut self.kinematics.next_position;
        let mut rotation = Mat3::identity();
        let (mut frame, mut position) = (Mat3::identity(), Vec3::zero());
        let mut inside = [Vec3::zero(); A];
        for k in 0..place.frames.len() {
            let (g, i) = (k / L::WIDTH, k % L::WIDTH);
            let (now, next) = (&self.rod.states[g], &self.next[g]);
            if i == 0 {
                for (a, place) in inside[..A - 1].iter_mut().enumerate() {
                    *place = next.inside(a);
                }
            }
            let [start, end] = self.rod.fixed.modules[k].clamp;
            let ahead = frame.column(2) * L::Chain::splat(start);
            let base = position + ahead;
            for a in 0..A - 1 {
                let inside = get::<L>(&inside[a], i);
                place.points[k * A + a] = base + frame * inside;
            }
            position = base + frame * get::<L>(&next.rho, i);
            frame = frame * get_mat::<L>(&next.s, i);
            position += frame.column(2) * L::Chain::splat(end);
            place.points[k * A + A - 1] = position;
            place.frames[k] = frame;
            rotation = rotation * get_mat::<L>(&now.s, i);
            self.rod.rotations[k + 1] = rotation;
        }
    }

    /// Leaves the forces of the present strain out of the next tangent, but not what tendons and
    /// stiffness do: the first guess of a short step may ask for forces that bend the rod over, and
    /// only the mass tells where it really goes.
    pub fn forget_forces(&mut self) {
        for (state, gradient) in self.rod.states.iter_mut().zip(&mut self.rod.gradients) {
            state.f[..2].fill(Vec3::zero());
            state.lambda = Vec3::zero();
            gradient.forget_forces();
        }
    }

    /// Readies the tangent. That of a step before is nearly that of this one, and costs five times
    /// a residual: it is made anew where it is asked for, or where the step or scheme differ.
    /// Returns whether it was.
    #[inline(always)]
    pub fn ready(&mut self, anew: bool) -> bool {
        let made = anew || !self.tangent.serves(&self.scheme);
        if made {
            self.linearise();
        }
        made
    }

    /// Tangent at the present strain, eliminated.
    #[inline(always)]
    pub(super) fn linearise(&mut self) {
        self.tangent.make(
            &mut self.rod,
            &self.constants,
            &self.mass,
            &self.residual,
            &self.scheme,
        );
        self.response.clear_tip_moment();
        if self.scheme.duration.is_infinite() && self.rod.has_tip_moment() {
            self.response
                .prepare_tip_moment(&self.rod, &mut self.tangent);
        }
    }

    /// Solves for the present imbalance.
    #[inline(always)]
    pub fn substitute(&mut self) {
        self.response
            .solve_imbalance(&self.rod, &mut self.tangent, &self.residual);
    }

    /// Moves the end of the step by a sum of solutions.
    #[inline(always)]
    pub fn combine(&mut self, coefficients: &[f64]) {
        self.response.combine(
            &self.rod,
            &self.tangent,
            &self.scheme,
            coefficients,
            &mut self.next,
        );
    }

    /// Measures the spans where forces balance, and their lengths at the end of the step.
    #[inline(always)]
    pub fn measure_spans(&mut self, angles: bool) {
        self.rod.measure_spans(angles);
        self.measure();
    }

    #[inline(always)]
    fn measure(&mut self) {
        self.spans.measure(&self.rod, &self.next);
    }

    /// By modules and tendons, at the end of the step, m.
    pub fn span_lengths(&self) -> &[f64] {
        &self.spans.next
    }

    /// Of the tendons at the holes, where forces balance, rad.
    pub fn angles(&self) -> &[f64] {
        &self.rod.spans.angles
    }

    /// Change of a tendon's length from a hole on, by each of the solutions.
    pub fn beyond(&self, hole: usize, tendon: usize, out: &mut [f64]) {
        let n = self.module_count();
        let stride = self.next.len() * L::WIDTH;
        for (out, column) in out.iter_mut().zip(&self.response.columns) {
            *out = column.rates[tendon * stride..][hole..n].iter().sum();
        }
    }

    /// Solves for the own imbalance in the first column and for more tension in the next, by the
    /// present tangent and measured spans.
    #[inline(always)]
    pub fn respond(&mut self, sources: Sources) {
        let n = self.module_count();
        let own = std::iter::once(None);
        for (column, source) in own.chain(sources.iter(n).map(Some)).enumerate() {
            if crate::interrupt::work(n * (16 + 2 * self.rod.tendons.len())) {
                return;
            }
            match source {
                None => self.substitute(),
                Some(source) => {
                    self.response
                        .solve_tension(&self.rod, &mut self.tangent, column, source)
                }
            }
            self.response
                .rate_spans(&self.rod, &self.tangent, &self.scheme, column);
        }
    }

    /// Velocities, lengths and energies at the end of the step.
    #[inline(always)]
    pub fn finish(&mut self, load: &Load) {
        let step = self
            .kinematics
            .finish(&self.scheme, &self.mass, &self.residual.disk_force);
        self.balance.loss_by_rate = step.loss_by_rate;
        let damping = self.scheme.damping;
        let mut dissipated = damping.mass * step.loss_by_rate;
        if damping.material != 0.0 {
            dissipated += damping.material * self.strain_loss();
        }
        self.measure();
        self.balance.tendon_work = self.work_of_tendons();
        let mut work = step.disk_work + self.balance.tendon_work;
        work += Vec3(load.tip_force).dot(self.tip_displacement());
        if load.tip_moment != [0.0; 3] {
            work += Vec3(load.tip_moment).dot(self.tip_rotation());
        }
        let before = &self.balance.now;
        self.balance.next = Energies {
            kinetic: step.kinetic,
            work: before.work + work,
            dissipated: before.dissipated + dissipated,
            ..self.stored_energies()
        };
    }

    /// Work of the tendons on the disks in this step, J.
    #[inline(always)]
    fn work_of_tendons(&self) -> f64 {
        let tendons = self.rod.tendons.len();
        let mut work = 0.0;
        for (at, (next, now)) in self.spans.next.iter().zip(&self.spans.now).enumerate() {
            work -= self.rod.span_tension(at / tendons, at % tendons) * (next - now);
        }
        work
    }

    /// Displacement of the tip in this step, m.
    #[inline(always)]
    fn tip_displacement(&self) -> Vec3 {
        let (now, next) = (&self.kinematics.position, &self.kinematics.next_position);
        let tip = now.points.len() - 1;
        (next.points[tip] - now.points[tip]).of_lane(0)
    }

    /// Rotation vector of the tip in this step, rad.
    #[inline(always)]
    fn tip_rotation(&self) -> Vec3 {
        let (now, next) = (&self.kinematics.position, &self.kinematics.next_position);
        let tip = now.frames.len() - 1;
        log(&of_lane(&(next.frames[tip] * now.frames[tip].transpose())))
    }

    /// Rate of the strain times its change, by stiffness, J/s.
    #[inline(always)]
    fn strain_loss(&self) -> f64 {
        let scheme = &self.scheme;
        let by_change = L::Module::splat(scheme.am * scheme.rate_by_change());
        let by_rate = L::Module::splat(scheme.memory());
        let mut total = 0.0;
        for g in 0..self.next.len() {
            let (c, next) = (&self.rod.constants[g], &self.next[g]);
            let start = &self.strain.start()[g];
            let change = start.scaled_add(L::Module::splat(-1.0), &Strain::of(next));
            let kept = self.strain.rate[g].scaled_add(by_rate, &Strain::zero());
            let rate = change.scaled_add(by_change, &kept);
            let moments = c.bending_moments(&rate.w);
            let mut lost = L::Module::zero();
            if !scheme.rigid {
                lost = rate.n.dot(next.compliance(c) * change.n);
            }
            for a in 0..A {
                lost += moments[a].dot(change.w[a]);
            }
            total += self.over_modules(g, &lost);
        }
        total
    }

    /// Elastic and gravity energy at the end of the step.
    #[inline(always)]
    fn stored_energies(&self) -> Energies {
        let mut elastic = 0.0;
        for g in 0..self.next.len() {
            let t = in_group(&self.rod.tendons, &self.rod.tensions, self.rod.path, g);
            let c = &self.rod.constants[g];
            let state = &self.next[g];
            let along = state.rho0 * (L::Module::splat(1.0) / state.rho0.norm());
            let longer = along.dot(state.rho - state.rho0);
            let energy = state.elastic_energy(c) + c.stretch_energy(&t, longer);
            elastic += self.over_modules(g, &energy);
        }
        let mut weight = Vec3::zero();
        let points = &self.kinematics.next_position.points;
        for (p, mass) in points.iter().zip(&self.mass.points) {
            weight += *p * L::Chain::splat(*mass);
        }
        Energies {
            elastic,
            gravity: -self.residual.gravity.dot(weight).lane(0),
            ..Energies::default()
        }
    }

    /// Sum over the modules of a group.
    #[inline(always)]
    fn over_modules(&self, g: usize, value: &L::Module) -> f64 {
        let mut sum = 0.0;
        for i in 0..L::WIDTH.min(self.module_count() - g * L::WIDTH) {
            sum += L::get(value, i).lane(0);
        }
        sum
    }

    /// Takes this much energy out of the step that was finished, once it is solved again; not all
    /// of it where hardly anything moves. Without numerical damping only. Returns whether that
    /// changes the step.
    pub fn restore(&mut self, excess: f64) -> bool {
        self.scheme.restore(excess, self.balance.loss_by_rate)
    }

    /// Adds what the tendons did in the step that was finished beside their work on the disks: their
    /// own energy, and work and loss since the start.
    pub fn account(&mut self, tendons: &Energies) {
        let next = &mut self.balance.next;
        next.elastic += tendons.elastic;
        next.work += tendons.work;
        next.dissipated += tendons.dissipated;
    }

    /// Estimated error of this step; none while unknown.
    #[inline(always)]
    pub fn local_error(&self) -> Option<StepError> {
        if self.scheme.fresh {
            return None;
        }
        let last = self.strain.last_duration()?;
        Some(self.kinematics.local_error(&self.scheme, last))
    }

    /// Takes the end of the step as the start of the next.
    #[inline(always)]
    pub fn commit(&mut self) {
        self.kinematics.commit(&self.scheme);
        self.strain.commit(&self.scheme, &self.next);
        self.keep_forces();
        self.scheme.fresh = false;
        std::mem::swap(&mut self.spans.now, &mut self.spans.next);
        self.balance.now = self.balance.next;
    }

    #[inline(always)]
    fn keep_forces(&mut self) {
        let residual = &mut self.residual;
        residual.last_force.copy_from_slice(&residual.force);
    }
}

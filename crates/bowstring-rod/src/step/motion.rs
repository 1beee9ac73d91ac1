//! One implicit time step of the rod: its state and the parts of its passes.
//!
//! Theory: docs/theory/dynamics.md (Time integration).

use super::body::Body;
use super::energy::{Energies, EnergyBalance};
use super::kinematics::Kinematics;
use super::mass::Nodal;
use super::residual::Residual;
use super::response::Response;
use super::scheme::Damping;
use super::spans::SpanLengths;
use super::strain::{Strain, StrainHistory};
use super::tangent::Tangent;
use crate::math::lie::log;
use crate::math::linalg::{Mat3, Vec3};
use crate::math::real::{Layout, Real};
use crate::model::load::Model;
use crate::model::robot::Robot;
use crate::rod::chain::Rod;
use crate::rod::continuous_module::PulledModule;
use crate::rod::groups::{get, get_mat};
use crate::rod::routes::in_group;
use crate::rod::state::State;

/// A moving rod.
pub struct Motion<L: Layout, const A: usize> {
    pub(super) body: Body<L, A>,
    /// Strain at the end of the step.
    pub(super) next: Vec<State<L::Module, A>>,
    pub(super) strain: StrainHistory<L, A>,
    pub(super) kinematics: Kinematics<L::Chain, A>,
    pub(super) residual: Residual<L, A>,
    pub(super) tangent: Tangent<L, A>,
    pub(super) response: Response<L, A>,
    pub(super) spans: SpanLengths,
    pub(super) energies: EnergyBalance,
    /// Length of the straight robot (m).
    pub(super) length: f64,
}

impl<L: Layout, const A: usize> Motion<L, A> {
    pub fn new(
        layout: L,
        robot: &Robot,
        model: Model,
        gravity: [f64; 3],
        damping: Damping,
    ) -> Self {
        let body = Body::new(layout, robot, model, damping);
        let n = robot.module_count();
        Motion {
            next: body.rod.states.clone(),
            strain: StrainHistory::new(body.rod.states.len()),
            kinematics: Kinematics::new(n),
            residual: Residual::new(n, gravity),
            tangent: Tangent::new(n),
            response: Response::new(),
            spans: SpanLengths::new(n * robot.tendon_count()),
            energies: EnergyBalance::default(),
            length: robot.length(),
            body,
        }
    }

    pub(super) fn module_count(&self) -> usize {
        self.body.rod.module_count()
    }

    /// Shape, places of all mass and forces at the present strain; returns the largest imbalance of
    /// each robot (N m).
    #[inline(never)]
    pub(super) fn forces(&mut self) -> L::Chain {
        self.body.rod.layout.vectorize(
            #[inline(always)]
            || self.forces_in_lanes(),
        )
    }

    #[inline(always)]
    fn forces_in_lanes(&mut self) -> L::Chain {
        self.shape();
        self.place_mass();
        self.residual.set_inertial(&self.body, &self.kinematics);
        self.residual.evaluate(&mut self.body, &self.strain)
    }

    /// Poses of all modules where forces balance and at the end of the step.
    #[inline(always)]
    pub(super) fn shape(&mut self) {
        let Body { rod, scheme, .. } = &mut self.body;
        let af = L::Module::splat(scheme.af);
        let af_force = L::Module::splat(scheme.force_share());
        for g in 0..self.next.len() {
            let t = in_group(&rod.tendons, &rod.tensions, rod.path, g);
            let c = &rod.constants[g];
            let (now, next) = (&mut rod.states[g], &mut self.next[g]);
            let start = &self.strain.start()[g];
            for a in 0..A {
                now.w[a] = (next.w[a] - start.w[a]).scaled_add(af, start.w[a]);
            }
            now.n = (next.n - start.n).scaled_add(af_force, start.n);
            for state in [now, next] {
                state.shape(c, &t);
                state.rho = state.rho0 + state.compliance(c, &t) * state.n;
            }
        }
    }

    /// Rotations where forces balance, and positions of all mass at the end of the step.
    #[inline(never)]
    pub(super) fn place_mass(&mut self) {
        self.body.rod.layout.vectorize(
            #[inline(always)]
            || self.place_mass_in_lanes(),
        )
    }

    #[inline(always)]
    fn place_mass_in_lanes(&mut self) {
        let rod = &mut self.body.rod;
        let mut rotation = Mat3::identity();
        let (mut frame, mut position) = (Mat3::identity(), Vec3::zero());
        let mut inside = [Vec3::zero(); A];
        for (k, place) in self.kinematics.next_position.iter_mut().enumerate() {
            let (g, i) = (k / L::WIDTH, k % L::WIDTH);
            let next = &self.next[g];
            if i == 0 {
                for (a, place) in inside[..A - 1].iter_mut().enumerate() {
                    *place = next.inside(&rod.constants[g], a);
                }
            }
            let [start, end] = rod.fixed.modules[k].clamp;
            let base = position + frame.column(2) * start;
            for a in 0..A - 1 {
                place.points[a] = base + frame * get::<L>(&inside[a], i);
            }
            position = base + frame * get::<L>(&next.rho, i);
            frame = frame * get_mat::<L>(&next.s, i);
            position += frame.column(2) * end;
            place.points[A - 1] = position;
            place.frame = frame;
            rotation = rotation * get_mat::<L>(&rod.states[g].s, i);
            rod.rotations[k + 1] = rotation;
        }
    }

    /// Assembles and eliminates the tangent at the present strain.
    #[inline(never)]
    pub(super) fn linearise(&mut self) {
        self.body.rod.layout.vectorize(
            #[inline(always)]
            || self.linearise_in_lanes(),
        )
    }

    #[inline(always)]
    fn linearise_in_lanes(&mut self) {
        self.tangent.make(&mut self.body, &self.residual);
        self.response.turning = None;
        let rod = &self.body.rod;
        if self.body.scheme.duration.is_infinite() && !rod.has_potential() {
            self.response.prepare_turning(rod, &mut self.tangent);
        }
    }

    /// Balances the contact forces under new tensions where no disk moves, and moves the points
    /// inside the modules to their equilibrium.
    #[inline(never)]
    pub(super) fn keep_disks(&mut self) {
        self.body.rod.layout.vectorize(
            #[inline(always)]
            || self.keep_disks_in_lanes(),
        )
    }

    #[inline(always)]
    fn keep_disks_in_lanes(&mut self) {
        let rod = &self.body.rod;
        for (g, state) in self.next.iter_mut().enumerate() {
            let t = in_group(&rod.tendons, &rod.tensions, rod.path, g);
            let (c, end) = (&rod.constants[g], state.rho);
            state.shape(c, &t);
            state.n = state.compliance(c, &t).inverse() * (end - state.rho0);
            state.rho = end;
            self.strain.set_start_force(g, state.n);
        }
        self.place_mass();
        let now = &mut self.kinematics;
        for (now, next) in now.position.iter_mut().zip(&now.next_position) {
            now.points = next.points;
        }
    }

    #[inline(never)]
    pub(super) fn measure(&mut self) {
        self.body.rod.layout.vectorize(
            #[inline(always)]
            || self.measure_in_lanes(),
        )
    }

    #[inline(always)]
    fn measure_in_lanes(&mut self) {
        self.spans.measure(&self.body.rod, &self.next);
    }

    /// Work of the tendons on the disks in this step (J).
    #[inline(always)]
    pub(super) fn work_of_tendons(&self) -> f64 {
        let tendons = self.body.rod.tendons.len();
        let mut work = 0.0;
        for (at, (next, now)) in self.spans.next.iter().zip(&self.spans.now).enumerate() {
            let tension = self.body.rod.span_tension(at / tendons, at % tendons);
            work -= tension * (next - now);
        }
        work
    }

    /// Displacement of the tip in this step (m).
    #[inline(always)]
    pub(super) fn tip_displacement(&self) -> Vec3 {
        let tip = self.module_count() - 1;
        let [now, next] = self.ends(tip);
        (next.disk() - now.disk()).of_lane(0)
    }

    /// Work in this step of moments on the disks, point loads, and forces per length (J).
    #[inline(always)]
    pub(super) fn work_on_disks(&self) -> f64 {
        let rod = &self.body.rod;
        let mut work_of_lines = 0.0;
        for (at, line) in self.residual.lines.iter().enumerate() {
            let [now, next] = self.ends(at / A).map(|place| place.points[at % A]);
            work_of_lines += line.dot(next - now).lane(0);
        }
        if !rod.attached.acts() {
            return work_of_lines;
        }
        let work = |k: usize| {
            let rotation = &rod.rotations[k + 1];
            let moment = *rotation * rod.attached.moment(k, rotation);
            let [now, next] = self.ends(k);
            let turned = (next.frame * now.frame.transpose()).of_lane(0);
            let moved = (next.disk() - now.disk()).of_lane(0);
            moment.of_lane(0).dot(log(&turned)) + self.residual.point_force[k].of_lane(0).dot(moved)
        };
        let mut sum = work_of_lines + (0..self.module_count()).map(work).sum::<f64>();
        if Rod::<L, A>::BETWEEN && rod.attached.has_between() {
            sum += self.work_on_nodes();
        }
        sum
    }

    /// Work in this step of the loads between disks (J).
    #[cold]
    fn work_on_nodes(&self) -> f64 {
        let (rod, mut sum) = (&self.body.rod, 0.0);
        for k in 0..self.module_count() {
            let (g, i) = (k / L::WIDTH, k % L::WIDTH);
            let [now, next] = self.ends(k);
            let before = match k {
                0 => [Mat3::identity(); 2],
                k => self.ends(k - 1).map(|place| place.frame),
            };
            let mut start = State::<L::Module, A>::straight();
            start.w = self.strain.start()[g].w;
            let t = in_group(&rod.tendons, &rod.tensions, rod.path, g);
            start.shape(&rod.constants[g], &t);
            let at = |frame: Mat3<L::Chain>, state: &State<L::Module, A>, arcs: usize| {
                frame * get_mat::<L>(&state.node(arcs / 2), i)
            };
            let balance = |arcs: usize| at(rod.rotations[k], &rod.states[g], arcs);
            rod.each_between(k, balance, |arcs, [force, moment]| {
                let first = at(before[0], &start, arcs);
                let last = at(before[1], &self.next[g], arcs);
                let turned = log(&(last * first.transpose()).of_lane(0));
                let moved = (next.points[arcs - 1] - now.points[arcs - 1]).of_lane(0);
                sum += moment.of_lane(0).dot(turned) + force.of_lane(0).dot(moved);
            });
        }
        sum
    }

    /// Place of a module's mass at both ends of this step.
    #[inline(always)]
    fn ends(&self, k: usize) -> [&Nodal<L::Chain, A>; 2] {
        let motion = &self.kinematics;
        [&motion.position[k], &motion.next_position[k]]
    }

    /// Stiffness-weighted product of the strain rate and its change (J/s).
    #[inline(always)]
    pub(super) fn strain_loss(&self) -> f64 {
        let scheme = &self.body.scheme;
        let (by_change, by_rate) = (scheme.am * scheme.rate_by_change(), scheme.memory());
        let mut total = 0.0;
        for g in 0..self.next.len() {
            let rod = &self.body.rod;
            let t = in_group(&rod.tendons, &rod.tensions, rod.path, g);
            let (c, next) = (&rod.constants[g], &self.next[g]);
            let change = Strain::of(next).combined(1.0, &self.strain.start()[g], -1.0);
            let rate = change.combined(by_change, &self.strain.rate[g], by_rate);
            let moments = c.bending_moments(&rate.w);
            let mut lost = L::Module::zero();
            if !scheme.rigid {
                lost = rate.n.dot(next.compliance(c, &t) * change.n);
            }
            for a in 0..A {
                lost += moments[a].dot(change.w[a]);
            }
            total += self.over_modules(g, &lost);
        }
        total
    }

    /// Elastic and gravitational energy at the end of the step.
    #[inline(never)]
    pub(super) fn stored_energies(&self) -> Energies {
        self.body.rod.layout.vectorize(
            #[inline(always)]
            || self.stored_energies_in_lanes(),
        )
    }

    #[inline(always)]
    fn stored_energies_in_lanes(&self) -> Energies {
        let mut elastic = 0.0;
        for g in 0..self.next.len() {
            elastic += self.over_modules(g, &self.elastic_energy(g));
        }
        let weight = self.body.mass.sum(&self.kinematics.next_position);
        Energies {
            elastic,
            gravity: -self.residual.gravity.dot(weight).lane(0),
            ..Energies::default()
        }
    }

    /// Elastic energy of a group of modules at the end of the step (J).
    #[inline(always)]
    pub(super) fn elastic_energy(&self, g: usize) -> L::Module {
        let (rod, state) = (&self.body.rod, &self.next[g]);
        let t = in_group(&rod.tendons, &rod.tensions, rod.path, g);
        let c = &rod.constants[g];
        let mut energy = state.elastic_energy(c);
        if let Some(pulled) = PulledModule::of(state, c, &t) {
            energy += pulled.strain_energy(c, &t);
        }
        energy
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

    #[inline(always)]
    pub(super) fn keep_forces(&mut self) {
        self.residual.keep_forces();
    }
}

//! Forces on all mass, and the resulting imbalance of arcs and contact forces.
//!
//! Theory: docs/theory/dynamics.md (Eq. 5.1).

use super::body::Body;
use super::kinematics::Kinematics;
use super::mass::{wide, Nodal};
use super::scheme::Scheme;
use super::strain::StrainHistory;
use crate::math::copies;
use crate::math::linalg::{Mat3, Vec3};
use crate::math::real::{Layout, Real};
use crate::model::load::{BaseMotion, TendonPath};
use crate::rod::chain::Rod;
use crate::rod::groups::{get, get_mat, put};
use crate::rod::routes::in_group;

/// Forces on the mass in the base frame, and the resulting forces in the modules.
pub(super) struct Residual<L: Layout, const A: usize> {
    /// Inertial and gravity forces on points (N), and moments on disks (N m).
    pub force: Vec<Vec3<L::Chain>>,
    pub moment: Vec<Vec3<L::Chain>>,
    /// Forces on points at the end of the step before, without forces per length (N).
    pub last_force: Vec<Vec3<L::Chain>>,
    pub gravity: Vec3<L::Chain>,
    /// Motion of the base; `None` where it does not move.
    base: Option<BaseMotion>,
    /// Acceleration of all mass by the motion of the base, where forces balance; empty without it.
    by_base: Vec<Nodal<L::Chain, A>>,
    /// Forces per length on the backbone, lumped into points (N); empty if there are none.
    pub lines: Vec<Vec3<L::Chain>>,
    /// The same before each disk (N/m).
    pub line_forces: Vec<[f64; 3]>,
    /// Dead forces on the disks (N): those of the load and those held.
    pub disk_force: Vec<Vec3<L::Chain>>,
    /// The two parts; that of the load is empty if there is none.
    loaded: Vec<[f64; 3]>,
    held: Vec<[f64; 3]>,
    pub tip_force: Vec3<L::Chain>,
    /// Forces of point loads on the disks where forces balance (N).
    pub point_force: Vec<Vec3<L::Chain>>,
    pub modules: Vec<ModuleForces<L::Module, A>>,
}

/// Forces of a module, in the frame of its start.
#[derive(Clone, Copy)]
pub(super) struct ModuleForces<T, const A: usize> {
    /// Forces on the inner nodes (N).
    pub nodes: [Vec3<T>; A],
    /// Imbalance of the contact force (N).
    pub imbalance: Vec3<T>,
}

impl<L: Layout, const A: usize> Residual<L, A> {
    pub fn new(modules: usize, gravity: [f64; 3]) -> Self {
        let none = ModuleForces {
            nodes: [Vec3::zero(); A],
            imbalance: Vec3::zero(),
        };
        Residual {
            force: copies(Vec3::zero(), modules * A),
            moment: copies(Vec3::zero(), modules),
            last_force: copies(Vec3::zero(), modules * A),
            gravity: Vec3::splat(gravity),
            base: None,
            by_base: vec![],
            lines: vec![],
            line_forces: vec![],
            disk_force: copies(Vec3::zero(), modules),
            loaded: vec![],
            held: vec![[0.0; 3]; modules],
            tip_force: Vec3::zero(),
            point_force: copies(Vec3::zero(), modules),
            modules: copies(none, modules.div_ceil(L::WIDTH)),
        }
    }

    /// Keeps the forces of the finished step.
    pub fn keep_forces(&mut self) {
        self.last_force.copy_from_slice(&self.force);
        for (kept, line) in self.last_force.iter_mut().zip(&self.lines) {
            *kept -= *line;
        }
    }

    /// Sets the forces on the disks that belong to the load.
    pub fn load_disks(&mut self, forces: &[[f64; 3]]) {
        if self.loaded != forces {
            self.loaded.clear();
            self.loaded.extend_from_slice(forces);
            (0..self.held.len()).for_each(|k| self.add_parts(k));
        }
    }

    /// Lumps forces per length on the backbone before each disk by Simpson's rule, as its mass.
    pub fn load_lines(&mut self, lines: &[[f64; 3]], rod: &Rod<L, A>) {
        self.lines.clear();
        self.line_forces.clear();
        if lines.is_empty() {
            return;
        }
        self.line_forces.extend_from_slice(lines);
        self.lines.resize(self.force.len(), Vec3::zero());
        for (k, line) in lines.iter().enumerate() {
            let (c, line) = (&rod.fixed.modules[k], Vec3::splat(*line));
            let [start, end] = c.clamp;
            let sixth = c.flexible * L::Chain::splat(1.0 / (3.0 * A as f64));
            for a in 1..=A {
                self.lines[k * A + a - 1] += line * (sixth * c.simpson(a));
            }
            self.lines[k * A + A - 1] += line * end;
            if k > 0 {
                self.lines[k * A - 1] += line * (sixth * c.simpson(0) + start);
            }
        }
    }

    /// Sets the force on a disk beside those of the load.
    pub fn hold_disk(&mut self, k: usize, force: [f64; 3]) {
        self.held[k] = force;
        self.add_parts(k);
    }

    fn add_parts(&mut self, k: usize) {
        let loaded = self.loaded.get(k).copied().unwrap_or_default();
        self.disk_force[k] = Vec3::splat(loaded) + Vec3::splat(self.held[k]);
    }

    /// Sets the motion of the base.
    pub fn move_base(&mut self, base: &BaseMotion) {
        self.base = (*base != BaseMotion::default()).then_some(*base);
        let count = self.base.map_or(0, |_| self.moment.len());
        self.by_base.resize(count, Nodal::zero());
    }

    /// Work of the inertial forces by the motion of the base in this step (J).
    #[inline(always)]
    pub fn work_of_base(&self, body: &Body<L, A>, motion: &Kinematics<L::Chain, A>) -> f64 {
        let mut work = L::Chain::zero();
        for (k, by_base) in self.by_base.iter().enumerate() {
            work -= body.mass.product(k, by_base, &motion.moved(k));
        }
        work.lane(0)
    }

    /// Acceleration of a module's mass by the motion of the base: by that of its origin `a`, and with
    /// the angular velocity `w` and acceleration of the base `a + w' x y + w x (w x y) + 2 w x y'`;
    /// directors turn about the origin.
    #[cold]
    fn set_acceleration_by_base(
        &mut self,
        scheme: &Scheme,
        motion: &Kinematics<L::Chain, A>,
        k: usize,
    ) {
        let base = self.base.unwrap_or_default();
        let [rate, spin] = [base.angular_velocity, base.angular_acceleration].map(Vec3::splat);
        let (place, velocity) = motion.at_balance(scheme, k);
        let turned = |y: Vec3<L::Chain>, v: Vec3<L::Chain>| {
            spin.cross(y) + rate.cross(rate.cross(y) + v * L::Chain::splat(2.0))
        };
        let out = &mut self.by_base[k];
        for a in 0..A {
            let by_turn = turned(place.points[a], velocity.points[a]);
            out.points[a] = by_turn + Vec3::splat(base.acceleration);
        }
        for q in 0..3 {
            let director = turned(place.frame.column(q), velocity.frame.column(q));
            for r in 0..3 {
                out.frame.0[r][q] = director[r];
            }
        }
    }

    /// Computes gravity and inertial forces of all mass.
    #[inline(always)]
    pub fn set_inertial(&mut self, body: &Body<L, A>, motion: &Kinematics<L::Chain, A>) {
        let splat = L::Chain::splat;
        let (moves, lined) = (self.base.is_some(), !self.lines.is_empty());
        let laden = !body.mass.bodies.is_empty();
        for k in 0..self.moment.len() {
            let mut acceleration = motion.balance_acceleration(&body.scheme, k);
            if moves {
                self.set_acceleration_by_base(&body.scheme, motion, k);
                acceleration = acceleration.combined(1.0, &self.by_base[k], 1.0);
            }
            for a in 0..A {
                let m = splat(body.mass.points[k * A + a]);
                self.force[k * A + a] = (self.gravity - acceleration.points[a]) * m;
                if lined {
                    self.force[k * A + a] += self.lines[k * A + a];
                }
            }
            let [e1, e3] = body.mass.directors[k].map(splat);
            let mut push = acceleration.frame;
            for row in &mut push.0 {
                *row = [row[0] * e1, row[1] * e1, row[2] * e3];
            }
            if let (true, Some(own)) = (laden, body.mass.body(k)) {
                let (first, against) = (wide(own.first), acceleration.disk() - self.gravity);
                self.force[k * A + A - 1] -= against * splat(own.mass) + acceleration.frame * first;
                push += acceleration.frame * Mat3::splat(&own.second) + against.outer(first);
            }
            // sum of director x acceleration
            let q = push * body.rod.rotations[k + 1].transpose();
            self.moment[k] = Vec3([
                q.0[1][2] - q.0[2][1],
                q.0[2][0] - q.0[0][2],
                q.0[0][1] - q.0[1][0],
            ]);
        }
    }

    /// Computes the imbalance of arcs and contact forces (theory Eq. 5.1) under the present
    /// tensions and forces on all mass; returns the largest of each robot (N m).
    #[inline(never)]
    pub fn evaluate(&mut self, body: &mut Body<L, A>, strain: &StrainHistory<L, A>) -> L::Chain {
        body.rod.layout.vectorize(
            #[inline(always)]
            || self.evaluate_in_lanes(body, strain),
        )
    }

    #[inline(always)]
    fn evaluate_in_lanes(
        &mut self,
        body: &mut Body<L, A>,
        strain: &StrainHistory<L, A>,
    ) -> L::Chain {
        self.set_resultants(&mut body.rod);
        self.set_load_moments(body);
        self.set_costate(&mut body.rod);
        self.set_gradients(body, strain)
    }

    /// Resultant of the loads on every module and the distal part, from the tip, in the frame of
    /// its start.
    #[inline(always)]
    fn set_resultants(&mut self, rod: &mut Rod<L, A>) {
        let mut total = self.tip_force;
        for k in (0..self.moment.len()).rev() {
            let (g, i) = (k / L::WIDTH, k % L::WIDTH);
            let [start, end] = rod.fixed.modules[k].clamp;
            let rotation = rod.rotations[k];
            total += self.force[k * A + A - 1] + self.disk_force[k];
            if rod.attached.has_forces() {
                self.point_force[k] = rod.attached.force(k, &rod.rotations[k + 1]);
                total += self.point_force[k];
            }
            let state = &mut rod.states[g];
            let here = rotation.tr_mul(total);
            put::<L>(&mut state.f[0], i, here);
            put::<L>(&mut state.f[1], i, here * end);
            for a in 0..A - 1 {
                let force = self.force[k * A + a];
                total += force;
                put::<L>(&mut self.modules[g].nodes[a], i, rotation.tr_mul(force));
            }
            if Rod::<L, A>::BETWEEN && rod.attached.has_between() {
                let nodes = &mut self.modules[g].nodes;
                rod.each_force_between(k, |arcs, force| {
                    total += force;
                    let sum = get::<L>(&nodes[arcs - 1], i) + rotation.tr_mul(force);
                    put::<L>(&mut nodes[arcs - 1], i, sum);
                });
            }
            let state = &mut rod.states[g];
            put::<L>(&mut state.f[2], i, rotation.tr_mul(total) * start);
        }
    }

    /// Moments of the loads about the start of every module, and forces and moments of its spans.
    #[inline(always)]
    fn set_load_moments(&self, body: &mut Body<L, A>) {
        let (rod, constants) = (&mut body.rod, &body.constants);
        for g in 0..self.modules.len() {
            let t = in_group(&rod.tendons, &rod.tensions, rod.path, g);
            let (c, state) = (&constants[g], &mut rod.states[g]);
            state.end_force = state.f[0];
            state.span_torque = Vec3::zero();
            if t.path == TendonPath::Straight {
                let (_, force, torque, _) = state.spans(c, &t);
                state.end_force -= force;
                state.span_torque = torque;
            }
            let tangent = state.s.column(2);
            state.load_moment = state.rho.cross(state.f[0])
                + tangent.cross(state.f[1])
                + Vec3::ez().cross(state.f[2]);
            for a in 0..A - 1 {
                state.load_moment += state.inside(c, a).cross(self.modules[g].nodes[a]);
            }
        }
    }

    /// Costate of every module (theory Eq. 3.2 with the opposite sign, and inertia), from the tip.
    #[inline(always)]
    fn set_costate(&self, rod: &mut Rod<L, A>) {
        let mut lambda = Vec3::zero();
        for k in (0..self.moment.len()).rev() {
            let (state, i) = (&mut rod.states[k / L::WIDTH], k % L::WIDTH);
            lambda -= rod.rotations[k + 1].tr_mul(self.moment[k]);
            if rod.attached.acts() {
                lambda -= rod.attached.moment(k, &rod.rotations[k + 1]);
            }
            lambda = get_mat::<L>(&state.s, i) * lambda;
            put::<L>(&mut state.lambda, i, lambda);
            lambda -= get::<L>(&state.load_moment, i);
            if Rod::<L, A>::BETWEEN && rod.attached.has_between() {
                let start = &rod.rotations[k];
                let between = &mut rod.attached.between;
                lambda += between.torque_on::<L, A>(k, start, state);
            }
        }
    }

    /// Imbalance of every arc and contact force; returns the largest of each robot (N m).
    #[inline(always)]
    fn set_gradients(&mut self, body: &mut Body<L, A>, strain: &StrainHistory<L, A>) -> L::Chain {
        let (rod, constants) = (&mut body.rod, &body.constants);
        let stiffer = L::Module::splat(body.scheme.force_factor());
        let mut largest = L::Module::zero();
        for g in 0..self.modules.len() {
            let t = in_group(&rod.tendons, &rod.tensions, rod.path, g);
            let (c, offset) = (&constants[g], &strain.offset[g]);
            let (state, out) = (&rod.states[g], &mut rod.gradients[g]);
            state.gradient(c, &t, out);
            if Rod::<L, A>::BETWEEN && rod.attached.has_between() {
                let between = &rod.attached.between;
                between.add_torques::<L, A>(self.moment.len(), g, out);
            }
            let forces = &mut self.modules[g];
            let damped = rod.constants[g].bending_moments(&offset.w);
            for i in 0..A {
                out.g[i] -= out.to_strain[i].tr_mul(damped[i]);
                for a in i..A - 1 {
                    let force = forces.nodes[a];
                    out.g[i] -= out.r[i].tr_mul(force) - state.tail[a].cross(force);
                }
                largest = largest.max(out.g[i].max_abs());
            }
            forces.imbalance = state.n * stiffer - offset.n - state.end_force;
            for a in 0..A - 1 {
                forces.imbalance -= forces.nodes[a] * c.share(a);
            }
            largest = largest.max(forces.imbalance.max_abs() * c.flexible);
        }
        // idle lanes repeat the last module without its loads
        let used = 0..L::WIDTH.min(self.moment.len());
        used.fold(L::Chain::zero(), |worst, i| worst.max(L::get(&largest, i)))
    }
}

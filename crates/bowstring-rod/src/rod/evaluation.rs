//! Shapes, forces and gradient of the whole rod at its present strain.
//!
//! Theory: docs/theory/statics.md.

use crate::math::linalg::{Mat3, Vec3};
use crate::math::real::{Layout, Real};
use crate::rod::between::nodes_of;
use crate::rod::chain::Rod;
use crate::rod::continuous_module::PulledModule;
use crate::rod::groups::{get, get_mat, put};
use crate::rod::routes::in_group;
use crate::rod::span::Span;

impl<L: Layout, const A: usize> Rod<L, A> {
    /// Forward pass: shapes, rotations (theory Eq. 2.3) and forces; returns the potential energy
    /// (theory Eq. 3.1, without loads that have no potential).
    #[inline(always)]
    pub fn evaluate(&mut self) -> L::Chain {
        if self.attached.has_forces() {
            return self.evaluate_attached();
        }
        self.evaluate_module_loads()
    }

    /// `evaluate` with point loads: followers turn with their disks.
    #[cold]
    fn evaluate_attached(&mut self) -> L::Chain {
        self.layout.vectorize(
            #[inline(always)]
            || self.evaluate_with_points(),
        )
    }

    #[inline(always)]
    fn evaluate_with_points(&mut self) -> L::Chain {
        if self.attached.followed > 0 {
            self.turn_disks();
            self.dead.modules.clone_from(&self.attached.constant);
            self.add_resultants(&[], |rod, k| {
                let (rotation, mut on_disk) = (&rod.rotations[k + 1], Vec3::zero());
                for load in rod.attached.on(k) {
                    if load.follower {
                        on_disk += *rotation * Vec3::splat(load.force);
                    }
                }
                let mut between = Vec3::zero();
                if Self::BETWEEN && rod.attached.has_between() {
                    between = rod.force_between(k, true);
                }
                [on_disk, between]
            });
            if Self::BETWEEN && self.attached.has_between() {
                self.set_forces_between(true);
            }
        }
        let mut energy = self.evaluate_module_loads();
        for k in 0..self.module_count() {
            energy += self.attached.potential(k, &self.rotations[k + 1]);
        }
        if Self::BETWEEN && self.attached.has_between() {
            energy += self.potential_between();
        }
        energy
    }

    /// Shapes and rotations of the disks.
    #[inline(never)]
    pub fn turn_disks(&mut self) {
        self.layout.vectorize(
            #[inline(always)]
            || self.turn_disks_in_lanes(),
        )
    }

    #[inline(always)]
    fn turn_disks_in_lanes(&mut self) {
        let (path, n) = (self.path, self.module_count());
        let mut rotation = Mat3::identity();
        for (g, (state, c)) in self.states.iter_mut().zip(&self.constants).enumerate() {
            state.shape(c, &in_group(&self.tendons, &self.tensions, path, g));
            for i in 0..L::WIDTH.min(n - g * L::WIDTH) {
                rotation = rotation * get_mat::<L>(&state.s, i);
                self.rotations[g * L::WIDTH + i + 1] = rotation;
            }
        }
    }

    /// `evaluate` with the loads on modules as they are.
    #[inline(never)]
    pub fn evaluate_module_loads(&mut self) -> L::Chain {
        self.layout.vectorize(
            #[inline(always)]
            || self.evaluate_module_loads_in_lanes(),
        )
    }

    #[inline(always)]
    fn evaluate_module_loads_in_lanes(&mut self) -> L::Chain {
        let path = self.path;
        let n = self.module_count();
        let mut rotation = Mat3::identity();
        let mut energy = L::Chain::zero();
        for (g, (state, c)) in self.states.iter_mut().zip(&self.constants).enumerate() {
            let mut t = in_group(&self.tendons, &self.tensions, path, g);
            state.shape(c, &t);
            let here = L::WIDTH.min(n - g * L::WIDTH);
            for i in 0..here {
                let k = g * L::WIDTH + i;
                // the last is for nodes between elements
                let used = if A > 2 { 4 } else { 3 };
                for (f, dead) in state.f[..used].iter_mut().zip(&self.dead.modules[k]) {
                    put::<L>(f, i, rotation.tr_mul(*dead));
                }
                if Self::BETWEEN && self.attached.has_between() {
                    let forces = &self.attached.between;
                    forces.put_forces::<L, A>(k, &rotation, &mut self.on_nodes[g]);
                }
                rotation = rotation * get_mat::<L>(&state.s, i);
                self.rotations[k + 1] = rotation;
            }
            t.on_nodes = nodes_of(&self.on_nodes, g);
            state.balance(c, &t);
            for i in 0..here {
                energy += L::get(&state.energy, i);
            }
        }
        energy
    }

    /// The second half of `evaluate`: forces, where only tensions of straight spans have changed.
    #[inline(never)]
    pub fn balance(&mut self) -> L::Chain {
        self.layout.vectorize(
            #[inline(always)]
            || self.balance_in_lanes(),
        )
    }

    #[inline(always)]
    fn balance_in_lanes(&mut self) -> L::Chain {
        let (tendons, tensions, path) = (&self.tendons, &self.tensions, self.path);
        let n = self.module_count();
        let mut energy = L::Chain::zero();
        for (g, (state, c)) in self.states.iter_mut().zip(&self.constants).enumerate() {
            let mut t = in_group(tendons, tensions, path, g);
            t.on_nodes = nodes_of(&self.on_nodes, g);
            state.balance(c, &t);
            for i in 0..L::WIDTH.min(n - g * L::WIDTH) {
                energy += L::get(&state.energy, i);
            }
        }
        energy
    }

    /// Backward pass: gradient by the exact costate (theory Eq. 3.2, with the opposite sign);
    /// returns the largest moment imbalance (N m).
    #[inline(never)]
    pub fn gradient(&mut self) -> L::Chain {
        self.layout.vectorize(
            #[inline(always)]
            || self.gradient_in_lanes(),
        )
    }

    #[inline(always)]
    fn gradient_in_lanes(&mut self) -> L::Chain {
        let path = self.path;
        let n = self.module_count();
        let mut lambda = Vec3::zero();
        let mut residual = L::Module::zero();
        for (g, (state, c)) in self
            .states
            .iter_mut()
            .zip(&self.constants)
            .enumerate()
            .rev()
        {
            for i in (0..L::WIDTH.min(n - g * L::WIDTH)).rev() {
                let k = g * L::WIDTH + i;
                if self.attached.acts() {
                    lambda -= self.attached.moment(k, &self.rotations[k + 1]);
                }
                lambda = get_mat::<L>(&state.s, i) * lambda;
                put::<L>(&mut state.lambda, i, lambda);
                lambda -= get::<L>(&state.load_moment, i);
                if Self::BETWEEN && self.attached.has_between() {
                    let start = &self.rotations[k];
                    let between = &mut self.attached.between;
                    lambda += between.torque_on::<L, A>(k, start, state);
                }
            }
            let mut t = in_group(&self.tendons, &self.tensions, path, g);
            t.on_nodes = nodes_of(&self.on_nodes, g);
            let out = &mut self.gradients[g];
            state.gradient(c, &t, out);
            if Self::BETWEEN && self.attached.has_between() {
                self.attached.between.add_torques::<L, A>(n, g, out);
            }
            for v in &out.g {
                residual = residual.max(v.max_abs());
            }
            // the residual of the end's position, times its force, is an imbalance as well
            residual = residual.max(state.miss * state.n.max_abs());
        }
        let mut largest = L::get(&residual, 0);
        for i in 1..L::WIDTH {
            largest = largest.max(L::get(&residual, i));
        }
        largest
    }

    /// Positions of the disks (theory Eq. 2.3), lengths of the tendons, and forward components of
    /// their spans.
    #[inline(never)]
    pub fn finish(&mut self) {
        self.layout.vectorize(
            #[inline(always)]
            || self.finish_in_lanes(),
        )
    }

    #[inline(always)]
    fn finish_in_lanes(&mut self) {
        let n = self.module_count();
        let mut position = Vec3::zero();
        let path = self.path;
        for (j, length) in self.placed.lengths.iter_mut().enumerate() {
            *length = self.tendons.length_in_holes(j, path);
        }
        for (g, (c, state)) in self.constants.iter().zip(&self.states).enumerate() {
            let t = in_group(&self.tendons, &self.tensions, self.path, g);
            let here = L::WIDTH.min(n - g * L::WIDTH);
            let offset = state.offset(c);
            let mean = state.s.column(2) + Vec3::ez();
            let chord = state.rho.dot(mean) * c.per_flexible;
            for i in 0..here {
                let k = g * L::WIDTH + i;
                position += self.rotations[k] * get::<L>(&offset, i);
                self.placed.positions[k] = position;
                self.placed.forward[k] = L::get(&chord, i);
            }
            let pulled = PulledModule::of(state, c, &t);
            for (j, holes) in t.holes.iter().enumerate() {
                let (length, forward) = match &pulled {
                    None => {
                        let span = Span::new(c, holes, &state.s, state.rho);
                        (span.length, span.direction.dot(mean))
                    }
                    Some(pulled) => (pulled.length(c, holes), c.stretch(&t)),
                };
                for i in 0..here {
                    let k = g * L::WIDTH + i;
                    if k > self.tendons.end_disks[j] {
                        break;
                    }
                    self.placed.lengths[j] += L::get(&length, i);
                    let (tension, forward) = (L::get(&t.tensions[j], i), L::get(&forward, i));
                    for robot in 0..L::Chain::LANES {
                        let least = self.placed.forward[k].lane(robot);
                        // a NaN counts as backward
                        if tension.lane(robot) > 0.0 && !(forward.lane(robot) >= least) {
                            self.placed.forward[k].set_lane(robot, forward.lane(robot));
                        }
                    }
                }
            }
        }
    }

    /// Magnitude of the terms that nearly cancel in the energy of one robot (N m).
    #[inline(always)]
    pub fn energy_scale(&self, length: f64, robot: usize) -> f64 {
        // all tendons pass the first module, and all dead loads act on it
        let reach = if self.dead.on_disks {
            self.module_count()
        } else {
            1
        };
        let resultants = self.dead.modules[..reach].iter();
        let mut force = resultants.fold(0.0, |most, module| {
            f64::max(most, module[0].norm().lane(robot))
        });
        force = f64::max(force, self.attached.between.largest_force(robot));
        for t in &self.tensions[..self.tendons.len()] {
            force += L::get(t, 0).lane(robot);
        }
        force * length
    }

    /// The first module of a robot in which a loaded span points backward: its two disks would have
    /// to penetrate each other. From the last `finish`.
    pub fn collision(&self, robot: usize) -> Option<usize> {
        self.placed
            .forward
            .iter()
            .position(|f| !(f.lane(robot) > 0.0))
    }
}

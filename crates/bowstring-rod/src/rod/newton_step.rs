//! A Newton step of the whole rod: second derivatives, elimination from tip to base, substitution.
//!
//! Theory: docs/theory/statics.md (Block-tridiagonal elimination, Eq. 3.4).

use crate::math::linalg::{Mat3, Vec3};
use crate::math::real::{Layout, Real};
use crate::rod::between::nodes_of;
use crate::rod::chain::Rod;
use crate::rod::elimination::Blocks;
use crate::rod::groups::{get, get_mat, put};
use crate::rod::routes::in_group;
use crate::rod::state::Hessian;

/// Predicted effect of the step.
pub struct Step<T> {
    /// Directional derivative of the energy.
    pub slope: T,
    /// Largest rotation added by an arc (rad).
    pub largest: T,
}

/// Second variation of module `i` of a group and of the distal part, whose own is `value` in the
/// frame of the end disk; `s` is the rotation of the end.
#[inline(always)]
pub fn blocks<L: Layout, const A: usize, const SYMMETRIC: bool>(
    of: &Hessian<L::Module, A>,
    i: usize,
    s: &Mat3<L::Chain>,
    value: Mat3<L::Chain>,
    shift: L::Chain,
) -> Blocks<L::Chain, A, 1> {
    // second variation of the disk at the end, in the frame of the start
    let mut p = *s * value * s.transpose();
    if SYMMETRIC {
        p = p.mirrored();
    }
    let mut blocks = Blocks::empty();
    for a in 0..A {
        for b in 0..A {
            if b < a {
                continue;
            }
            blocks.uu[b][a] = get_mat::<L>(&of.uu[b][a], i) + p;
            if !SYMMETRIC && b > a {
                blocks.uu[a][b] = get_mat::<L>(&of.uu[b][a], i).transpose() + p;
            }
        }
        blocks.uu[a][a] = blocks.uu[a][a].add_diagonal([shift; 3]);
        let xu = get_mat::<L>(&of.xu[a], i);
        blocks.xu[a][0] = xu + p;
        blocks.ux[a][0] = xu.transpose() + p;
    }
    blocks.xx[0][0] = get_mat::<L>(&of.xx, i) + p;
    blocks
}

impl<L: Layout, const A: usize> Rod<L, A> {
    /// Second derivatives of all modules, and the responses of their ends.
    #[inline(never)]
    pub fn linearise(&mut self) {
        self.layout.vectorize(
            #[inline(always)]
            || self.linearise_in_lanes(),
        )
    }

    #[inline(always)]
    fn linearise_in_lanes(&mut self) {
        for g in 0..self.states.len() {
            let mut t = in_group(&self.tendons, &self.tensions, self.path, g);
            t.on_nodes = nodes_of(&self.on_nodes, g);
            let (state, gradient) = (&self.states[g], &self.gradients[g]);
            let out = &mut self.newton.hessians[g];
            let response = state.hessian::<true>(&self.constants[g], &t, gradient, out);
            self.newton.responses[g] = response;
            if Self::BETWEEN && self.attached.has_between() {
                self.linearise_torques(g);
            }
        }
    }

    /// Backward pass: eliminates every arc (theory Eq. 3.4); returns the least pivot, positive at a
    /// minimum.
    #[inline(never)]
    pub fn eliminate<const SYMMETRIC: bool>(&mut self, shift: L::Chain) -> L::Chain {
        self.layout.vectorize(
            #[inline(always)]
            || self.eliminate_in_lanes::<SYMMETRIC>(shift),
        )
    }

    #[inline(always)]
    fn eliminate_in_lanes<const SYMMETRIC: bool>(&mut self, shift: L::Chain) -> L::Chain {
        let n = self.module_count();
        self.newton.symmetric = SYMMETRIC;
        let mut value = Mat3::zero();
        let mut least_pivot = L::Chain::splat(f64::INFINITY);
        for k in (0..n).rev() {
            let (g, i) = (k / L::WIDTH, k % L::WIDTH);
            let s = get_mat::<L>(&self.states[g].s, i);
            if self.attached.acts() {
                value += self
                    .attached
                    .stiffness::<SYMMETRIC>(k, &self.rotations[k + 1]);
            }
            let mut blocks =
                blocks::<L, A, SYMMETRIC>(&self.newton.hessians[g], i, &s, value, shift);
            if Self::BETWEEN && self.attached.has_between() {
                self.add_stiffness_between::<SYMMETRIC, 1>(k, &mut blocks);
            }
            if !SYMMETRIC {
                self.couple_followers(k, &mut blocks);
            }
            [[value]] = self.newton.eliminated[k].eliminate::<SYMMETRIC>(blocks, &mut least_pivot);
            if !SYMMETRIC {
                self.eliminate_followers(k);
            }
        }
        least_pivot
    }

    /// `linearise` and `eliminate` in one pass, without shift, for a symmetric tangent: keeps the
    /// eliminated modules only.
    #[inline(never)]
    pub fn linearise_and_eliminate(&mut self) -> L::Chain {
        self.layout.vectorize(
            #[inline(always)]
            || self.linearise_and_eliminate_in_lanes(),
        )
    }

    #[inline(always)]
    fn linearise_and_eliminate_in_lanes(&mut self) -> L::Chain {
        let n = self.module_count();
        self.newton.symmetric = true;
        let mut value = Mat3::zero();
        let mut least_pivot = L::Chain::splat(f64::INFINITY);
        for g in (0..self.states.len()).rev() {
            let t = in_group(&self.tendons, &self.tensions, self.path, g);
            let (state, gradient) = (&self.states[g], &self.gradients[g]);
            let mut hessian = Hessian::empty();
            state.hessian::<true>(&self.constants[g], &t, gradient, &mut hessian);
            for i in (0..L::WIDTH.min(n - g * L::WIDTH)).rev() {
                let s = get_mat::<L>(&state.s, i);
                if self.attached.acts() {
                    let k = g * L::WIDTH + i;
                    value += self.attached.stiffness::<true>(k, &self.rotations[k + 1]);
                }
                let blocks = blocks::<L, A, true>(&hessian, i, &s, value, L::Chain::zero());
                let eliminated = &mut self.newton.eliminated[g * L::WIDTH + i];
                [[value]] = eliminated.eliminate::<true>(blocks, &mut least_pivot);
            }
        }
        least_pivot
    }

    /// Newton step for the present gradient and elimination.
    #[inline(always)]
    pub fn newton_step<const SYMMETRIC: bool>(&mut self) -> Step<L::Chain> {
        let step = self.rotations_of_step::<SYMMETRIC>();
        self.step_to_strain();
        step
    }

    /// Converts the step from rotations added by the arcs to strain.
    #[inline(never)]
    pub fn step_to_strain(&mut self) {
        self.layout.vectorize(
            #[inline(always)]
            || self.step_to_strain_in_lanes(),
        )
    }

    #[inline(always)]
    fn step_to_strain_in_lanes(&mut self) {
        for (step, gradient) in self.newton.step.iter_mut().zip(&self.gradients) {
            for a in 0..A {
                step[a] = gradient.to_strain[a] * step[a];
            }
        }
    }

    /// Newton step as rotations added by the arcs.
    #[inline(never)]
    pub fn rotations_of_step<const SYMMETRIC: bool>(&mut self) -> Step<L::Chain> {
        self.layout.vectorize(
            #[inline(always)]
            || self.rotations_of_step_in_lanes::<SYMMETRIC>(),
        )
    }

    #[inline(always)]
    fn rotations_of_step_in_lanes<const SYMMETRIC: bool>(&mut self) -> Step<L::Chain> {
        self.backward_step::<SYMMETRIC>(
            #[inline(always)]
            |_, _| (),
        );
        self.forward_step()
    }

    /// From tip to base: own solution of the arcs for the present gradient, in `step`. Visits the
    /// right-hand side of each module, the distal part included.
    #[inline(always)]
    pub fn backward_step<const SYMMETRIC: bool>(
        &mut self,
        mut visit: impl FnMut(usize, &[Vec3<L::Chain>; A]),
    ) {
        let (mut p, mut force) = (Vec3::zero(), Vec3::zero());
        for k in (0..self.module_count()).rev() {
            let (g, i) = (k / L::WIDTH, k % L::WIDTH);
            let s = get_mat::<L>(&self.states[g].s, i);
            p = s * p;
            let mut solution = [Vec3::zero(); A];
            for a in 0..A {
                solution[a] = get::<L>(&self.gradients[g].g[a], i) + p;
            }
            let mut start = [p];
            let follower = (!SYMMETRIC).then(|| self.attached.coupling(k)).flatten();
            if let Some(coupling) = follower {
                force = s * force;
                coupling.add_force(force, &mut solution, &mut start[0]);
            }
            visit(k, &solution);
            self.newton.eliminated[k].backward::<SYMMETRIC>(&mut solution, &mut start);
            if let Some(coupling) = follower {
                force = coupling.force_beyond(force, &solution);
                if Self::BETWEEN && self.attached.has_between() {
                    let between = &self.attached.between;
                    force -= between.force_by_arcs(k, |m| *m, &solution);
                }
            }
            for a in 0..A {
                put::<L>(&mut self.newton.step[g][a], i, solution[a]);
            }
            [p] = start;
        }
    }

    /// From base to tip: rotations of the arcs, from their own solutions in `step`.
    #[inline(always)]
    pub fn forward_step(&mut self) -> Step<L::Chain> {
        let mut x = Vec3::zero();
        let (mut slope, mut largest) = (L::Chain::zero(), L::Chain::zero());
        for k in 0..self.module_count() {
            let (g, i) = (k / L::WIDTH, k % L::WIDTH);
            let mut solution = [Vec3::zero(); A];
            for a in 0..A {
                solution[a] = get::<L>(&self.newton.step[g][a], i);
            }
            let u = self.newton.eliminated[k].forward(&solution, &[x]);
            let mut end = x;
            for a in 0..A {
                end += u[a];
            }
            x = get_mat::<L>(&self.states[g].s, i).tr_mul(end);
            for a in 0..A {
                put::<L>(&mut self.newton.step[g][a], i, u[a]);
                slope += get::<L>(&self.gradients[g].g[a], i).dot(u[a]);
                largest = largest.max(u[a].max_abs());
            }
        }
        Step { slope, largest }
    }

    /// The same for the last elimination, symmetric or not.
    #[inline(always)]
    pub fn rotations_of_last_elimination(&mut self) {
        if self.newton.symmetric {
            self.rotations_of_step::<true>();
        } else {
            self.rotations_of_step::<false>();
        }
    }

    pub fn save(&mut self) {
        for (g, state) in self.states.iter().enumerate() {
            self.newton.saved[g] = state.w;
            self.newton.saved_force[g] = state.n;
        }
    }

    /// Moves from the saved strain by a fraction of the step.
    #[inline(always)]
    pub fn advance(&mut self, fraction: L::Module) {
        for (g, state) in self.states.iter_mut().enumerate() {
            for i in 0..A {
                state.w[i] = self.newton.step[g][i].scaled_add(fraction, self.newton.saved[g][i]);
            }
            state.n = self.newton.saved_force[g];
        }
    }
}

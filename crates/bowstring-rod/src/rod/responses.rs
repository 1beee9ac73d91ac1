//! Spans of the tendons, and responses of the rod to changes of their tensions, several side by side
//! in the lanes that hold modules elsewhere.
//!
//! Theory: docs/theory/actuation.md.

use crate::interrupt;
use crate::math::copies;
use crate::math::linalg::{Mat3, Vec3};
use crate::math::real::{Layout, Real};
use crate::rod::between::nodes_of;
use crate::rod::chain::{Rod, SourceResponses};
use crate::rod::groups::{get, get_mat, put};
use crate::rod::span::Span;

/// Right-hand sides: a change of tension in one tendon each.
#[derive(Clone, Copy)]
pub struct Sources<'a> {
    pub tendons: &'a [usize],
    /// Tensions by sources and modules (N).
    pub tensions: &'a [f64],
}

impl<'a> Sources<'a> {
    /// Tendon and tensions of each source, for a robot of `n` modules.
    pub fn iter(self, n: usize) -> impl Iterator<Item = (usize, &'a [f64])> {
        self.tendons
            .iter()
            .copied()
            .zip(self.tensions.chunks_exact(n))
    }
}

/// A vector of module `i` in its group, copied to all lanes.
#[inline(always)]
pub fn same<L: Layout>(v: &Vec3<L::Module>, i: usize) -> Vec3<L::Module> {
    let mut out = Vec3::<L::Module>::zero();
    for (x, y) in out.0.iter_mut().zip(&v.0) {
        *x = L::Module::splat(L::get(y, i).lane(0));
    }
    out
}

#[inline(always)]
pub fn same_mat<L: Layout>(m: &Mat3<L::Module>, i: usize) -> Mat3<L::Module> {
    widen::<L>(&get_mat::<L>(m, i))
}

#[inline(always)]
pub fn widen<L: Layout>(m: &Mat3<L::Chain>) -> Mat3<L::Module> {
    let mut out = Mat3::<L::Module>::zero();
    for (row, from) in out.0.iter_mut().zip(&m.0) {
        for (x, y) in row.iter_mut().zip(from) {
            *x = L::Module::splat(y.lane(0));
        }
    }
    out
}

impl<L: Layout, const A: usize> Rod<L, A> {
    /// Measures the lengths of all spans and, if `angles`, the angles of the tendons at the holes.
    #[inline(never)]
    pub fn measure_spans(&mut self, angles: bool) {
        self.layout.vectorize(
            #[inline(always)]
            || self.measure_spans_in_lanes(angles),
        )
    }

    #[inline(always)]
    fn measure_spans_in_lanes(&mut self, angles: bool) {
        let (n, count) = (self.module_count(), self.tendons.len());
        let zero = Vec3::zero();
        self.spans
            .spans
            .resize_with(self.states.len() * count, || Span {
                arm: zero,
                length: L::Module::zero(),
                per_length: L::Module::zero(),
                direction: zero,
            });
        for (g, (state, c)) in self.states.iter().zip(&self.constants).enumerate() {
            for (j, holes) in self.tendons.in_group(g).iter().enumerate() {
                let span = Span::new(c, holes, &state.s, state.rho);
                for i in 0..L::WIDTH.min(n - g * L::WIDTH) {
                    let k = g * L::WIDTH + i;
                    if k > self.tendons.end_disks[j] {
                        break;
                    }
                    self.spans.lengths[k * count + j] = L::get(&span.length, i).lane(0);
                }
                self.spans.spans[g * count + j] = span;
            }
        }
        if angles {
            self.measure_angles();
        }
    }

    #[inline(always)]
    fn measure_angles(&mut self) {
        let count = self.tendons.len();
        for j in 0..count {
            // before the base hole the tendon is parallel to z
            let mut last = Vec3::<L::Chain>::ez();
            for (g, state) in self.states.iter().enumerate() {
                let after = self.spans.spans[g * count + j].direction;
                let next = state.s.tr_mul(after);
                let mut before = next;
                for i in 0..L::WIDTH {
                    put::<L>(&mut before, i, last);
                    last = get::<L>(&next, i);
                }
                let angle = before.angle(after);
                for i in 0..L::WIDTH {
                    let k = g * L::WIDTH + i;
                    if k > self.tendons.end_disks[j] {
                        break;
                    }
                    self.spans.angles[k * count + j] = L::get(&angle, i).lane(0);
                }
            }
        }
    }

    /// Span of a group and tendon, as measured last.
    pub fn span(&self, g: usize, tendon: usize) -> &Span<L::Module> {
        &self.spans.spans[g * self.tendons.len() + tendon]
    }

    /// Responses of the rod, for the present elimination and measured spans: to its own gradient in
    /// the first column, and to changes of tension in the others. Without sources the present
    /// columns are kept.
    #[inline(always)]
    pub fn respond(&mut self, sources: Sources) {
        let (n, count) = (self.module_count(), self.tendons.len());
        if sources.tendons.is_empty() && !self.spans.responses.is_empty() {
            return self.respond_to_gradient();
        }
        let total = 1 + sources.tendons.len();
        self.reserve_responses(total);
        for part in 0..total.div_ceil(L::WIDTH) {
            let first = part * L::WIDTH;
            if interrupt::work(L::WIDTH * n * (16 + 2 * count)) {
                return;
            }
            self.substitute(part, first..total.min(first + L::WIDTH), &sources);
        }
    }

    /// Makes place for so many responses.
    pub fn reserve_responses(&mut self, total: usize) {
        let (n, count) = (self.module_count(), self.tendons.len());
        while self.spans.responses.len() * L::WIDTH < total {
            self.spans.responses.push(SourceResponses {
                u: copies([Vec3::zero(); A], n),
                force: copies(Vec3::zero(), n),
                beyond: copies(L::Module::zero(), n * count),
            });
        }
    }

    /// The responses in groups of lanes.
    pub fn responses(&self) -> &[SourceResponses<L, A>] {
        &self.spans.responses
    }

    /// Takes a group of responses out of the rod, to be put back.
    #[inline(always)]
    pub fn take_responses(&mut self, part: usize) -> SourceResponses<L, A> {
        let empty = SourceResponses {
            u: vec![],
            force: vec![],
            beyond: vec![],
        };
        std::mem::replace(&mut self.spans.responses[part], empty)
    }

    #[inline(always)]
    pub fn put_responses(&mut self, part: usize, responses: SourceResponses<L, A>) {
        self.spans.responses[part] = responses;
    }

    /// Response to the own gradient only, with modules in the lanes.
    #[inline(never)]
    fn respond_to_gradient(&mut self) {
        self.layout.vectorize(
            #[inline(always)]
            || self.respond_to_gradient_in_lanes(),
        )
    }

    #[inline(always)]
    fn respond_to_gradient_in_lanes(&mut self) {
        self.rotations_of_last_elimination();
        let (n, count) = (self.module_count(), self.tendons.len());
        let out = &mut self.spans.responses[0];
        let mut x = Vec3::<L::Chain>::zero();
        for (g, (state, c)) in self.states.iter().zip(&self.constants).enumerate() {
            let here = L::WIDTH.min(n - g * L::WIDTH);
            let mut start = Vec3::<L::Module>::zero();
            let (response, step) = (&self.newton.responses[g], &self.newton.step[g]);
            let (mut turn, mut moved) = (Vec3::<L::Module>::zero(), Vec3::<L::Module>::zero());
            for a in 0..A {
                turn += step[a];
                moved += response.j[a] * step[a];
            }
            for i in 0..here {
                put::<L>(&mut start, i, x);
                x = get_mat::<L>(&state.s, i).tr_mul(x + get::<L>(&turn, i));
                for a in 0..A {
                    let u = get::<L>(&step[a], i);
                    for q in 0..3 {
                        out.u[g * L::WIDTH + i][a].0[q].set_lane(0, u.0[q].lane(0));
                    }
                }
            }
            let force = state
                .stretching_load(c, nodes_of(&self.on_nodes, g))
                .cross(start)
                - response.k.tr_mul(turn);
            let rho = response.m * moved + response.d_hat * force;
            for j in 0..count {
                let span = &self.spans.spans[g * count + j];
                let longer = span.direction.dot(rho + turn.cross(span.arm));
                let longer = longer * self.fixed.passes[g * count + j];
                for i in 0..here {
                    let place = &mut out.beyond[(g * L::WIDTH + i) * count + j];
                    place.set_lane(0, L::get(&longer, i).lane(0));
                }
            }
        }
        for at in (0..(n - 1) * count).rev() {
            let all = out.beyond[at].lane(0) + out.beyond[at + count].lane(0);
            out.beyond[at].set_lane(0, all);
        }
    }

    /// Substitutes some of the columns along the chain.
    #[inline(never)]
    fn substitute(&mut self, part: usize, columns: std::ops::Range<usize>, sources: &Sources) {
        self.layout.vectorize(
            #[inline(always)]
            || self.substitute_in_lanes(part, columns, sources),
        )
    }

    #[inline(always)]
    fn substitute_in_lanes(
        &mut self,
        part: usize,
        columns: std::ops::Range<usize>,
        sources: &Sources,
    ) {
        self.substitute_backward(part, columns, sources);
        let count = self.tendons.len();
        let mut out = self.take_responses(part);
        self.substitute_forward(
            &mut out,
            #[inline(always)]
            |beyond, k, [_, rho, turn]| {
                let (g, i) = (k / L::WIDTH, k % L::WIDTH);
                for (j, end_disk) in self.tendons.end_disks.iter().enumerate() {
                    beyond[k * count + j] = if k <= *end_disk {
                        let span = &self.spans.spans[g * count + j];
                        let (arm, along) = (same::<L>(&span.arm, i), same::<L>(&span.direction, i));
                        along.dot(rho + turn.cross(arm))
                    } else {
                        L::Module::zero()
                    };
                }
            },
        );
        for at in (0..out.beyond.len() - count).rev() {
            let further = out.beyond[at + count];
            out.beyond[at] += further;
        }
        self.put_responses(part, out);
    }

    /// Force on the end of module `k` due to the sources in some columns, and its arm.
    #[inline(always)]
    fn source_force(
        &self,
        k: usize,
        columns: std::ops::Range<usize>,
        sources: &Sources,
    ) -> [Vec3<L::Module>; 2] {
        let (n, count) = (self.module_count(), self.tendons.len());
        let (g, i) = (k / L::WIDTH, k % L::WIDTH);
        let mut force = Vec3::<L::Module>::zero();
        let mut arm = Vec3::<L::Module>::zero();
        for (lane, column) in columns.enumerate() {
            if column == 0 {
                continue;
            }
            let w = sources.tensions[(column - 1) * n + k];
            if w == 0.0 {
                continue;
            }
            let span = &self.spans.spans[g * count + sources.tendons[column - 1]];
            for q in 0..3 {
                let along = L::get(&span.direction.0[q], i).lane(0);
                force.0[q].set_lane(lane, -along * w);
                arm.0[q].set_lane(lane, L::get(&span.arm.0[q], i).lane(0));
            }
        }
        [force, arm]
    }

    /// From tip to base: eliminates the right-hand sides of the arcs.
    #[inline(never)]
    pub fn substitute_backward(
        &mut self,
        part: usize,
        columns: std::ops::Range<usize>,
        sources: &Sources,
    ) {
        self.layout.vectorize(
            #[inline(always)]
            || self.substitute_backward_in_lanes(part, columns, sources),
        )
    }

    #[inline(always)]
    fn substitute_backward_in_lanes(
        &mut self,
        part: usize,
        columns: std::ops::Range<usize>,
        sources: &Sources,
    ) {
        let mut p = Vec3::<L::Module>::zero();
        let mut following = Vec3::<L::Module>::zero();
        for k in (0..self.module_count()).rev() {
            let (g, i) = (k / L::WIDTH, k % L::WIDTH);
            let [force, arm] = self.source_force(k, columns.clone(), sources);
            let (state, response) = (&self.states[g], &self.newton.responses[g]);
            let moved = same_mat::<L>(&response.d_hat, i) * force;
            let turned = same_mat::<L>(&response.k, i) * moved - arm.cross(force);
            let on_end = same_mat::<L>(&response.m, i).tr_mul(force);
            p = same_mat::<L>(&state.s, i) * p;
            let mut solution = [Vec3::zero(); A];
            for a in 0..A {
                solution[a] = turned - same_mat::<L>(&response.j[a], i).tr_mul(on_end);
                if columns.start == 0 {
                    let own = get::<L>(&self.gradients[g].g[a], i);
                    for q in 0..3 {
                        solution[a].0[q].set_lane(0, own.0[q].lane(0));
                    }
                }
                solution[a] += p;
            }
            let mut start = [p];
            let eliminated = &self.newton.eliminated[k];
            if self.newton.symmetric {
                eliminated.backward_as::<_, true>(widen::<L>, &mut solution, &mut start);
            } else {
                let follower = self.attached.coupling(k).map(|c| c.each(widen::<L>));
                if let Some(coupling) = &follower {
                    following = same_mat::<L>(&state.s, i) * following;
                    coupling.add_force(following, &mut solution, &mut start[0]);
                }
                eliminated.backward_as::<_, false>(widen::<L>, &mut solution, &mut start);
                if let Some(coupling) = &follower {
                    following = coupling.force_beyond(following, &solution);
                    if Self::BETWEEN && self.attached.has_between() {
                        let between = &self.attached.between;
                        following -= between.force_by_arcs(k, widen::<L>, &solution);
                    }
                }
            }
            let stretching = state.stretching_load(&self.constants[g], self.on_nodes(g));
            p = start[0] + same::<L>(&stretching, i).cross(moved);
            let out = &mut self.spans.responses[part];
            out.u[k] = solution;
            out.force[k] = force;
        }
    }

    /// From base to tip: rotations of the arcs, in place of their own solutions. Visits the place
    /// for changes of length and, for each module, the rotation of its start, and the motion and
    /// rotation of its end that its arcs add.
    #[inline(always)]
    pub fn substitute_forward(
        &self,
        out: &mut SourceResponses<L, A>,
        mut visit: impl FnMut(&mut [L::Module], usize, [Vec3<L::Module>; 3]),
    ) {
        let mut x = Vec3::<L::Module>::zero();
        for k in 0..self.dead.modules.len() {
            let (g, i) = (k / L::WIDTH, k % L::WIDTH);
            let (state, response) = (&self.states[g], &self.newton.responses[g]);
            let u = self.newton.eliminated[k].forward_as(widen::<L>, &out.u[k], &[x]);
            let (mut turn, mut moved) = (Vec3::<L::Module>::zero(), Vec3::<L::Module>::zero());
            for a in 0..A {
                turn += u[a];
                moved += same_mat::<L>(&response.j[a], i) * u[a];
            }
            let stretching = state.stretching_load(&self.constants[g], nodes_of(&self.on_nodes, g));
            let load = same::<L>(&stretching, i).cross(x);
            let force = out.force[k] + load - same_mat::<L>(&response.k, i).tr_mul(turn);
            let rho =
                same_mat::<L>(&response.m, i) * moved + same_mat::<L>(&response.d_hat, i) * force;
            visit(&mut out.beyond, k, [x, rho, turn]);
            out.u[k] = u;
            x = same_mat::<L>(&state.s, i).tr_mul(x + turn);
        }
    }

    /// Length change of a tendon from a hole on, for each of the responses.
    pub fn beyond(&self, hole: usize, tendon: usize, out: &mut [f64]) {
        let at = hole * self.tendons.len() + tendon;
        for (part, responses) in out.chunks_mut(L::WIDTH).zip(&self.spans.responses) {
            for (lane, value) in part.iter_mut().enumerate() {
                *value = responses.beyond[at].lane(lane);
            }
        }
    }

    /// Bend of the backbone from the base to the end of a module, the sum of those of the modules
    /// (rad).
    pub fn bend(&self, module: usize) -> f64 {
        (0..=module)
            .map(|k| 2.0 * (0.5 * self.tilt(k).norm()).min(1.0).asin())
            .sum()
    }

    /// Adds a multiple of the change of that bend for each of the responses.
    pub fn add_bending(&self, module: usize, factor: f64, out: &mut [f64]) {
        for k in 0..=module {
            let Some(axis) = self.bend_axis(k) else {
                continue;
            };
            let axis = axis * factor;
            for (part, responses) in out.chunks_mut(L::WIDTH).zip(&self.spans.responses) {
                for (lane, value) in part.iter_mut().enumerate() {
                    for u in &responses.u[k] {
                        *value += axis[0] * u.0[0].lane(lane) + axis[1] * u.0[1].lane(lane);
                    }
                }
            }
        }
    }

    /// Axis about which module `k` is bent; none where it is straight, which any rotation bends.
    pub fn bend_axis(&self, k: usize) -> Option<Vec3> {
        let tilt = self.tilt(k);
        let size = tilt[0].hypot(tilt[1]);
        (size > 0.0).then(|| Vec3([-tilt[1] / size, tilt[0] / size, 0.0]))
    }

    /// Axis of the end of module `k` less that of its start, in the frame of the start.
    fn tilt(&self, k: usize) -> Vec3 {
        let axis = get::<L>(&self.states[k / L::WIDTH].s.column(2), k % L::WIDTH);
        Vec3([0, 1, 2].map(|q| axis.0[q].lane(0))) - Vec3::ez()
    }

    /// Sets the step to a linear combination of responses; returns the largest rotation added by an
    /// arc (rad).
    #[inline(always)]
    pub fn combine(&mut self, coefficients: &[f64]) -> f64 {
        self.combine_rotations(coefficients);
        let mut largest = L::Module::zero();
        for (step, gradient) in self.newton.step.iter_mut().zip(&self.gradients) {
            for a in 0..A {
                largest = largest.max(step[a].max_abs());
                step[a] = gradient.to_strain[a] * step[a];
            }
        }
        largest.largest()
    }

    /// The same as rotations added by the arcs.
    #[inline(always)]
    pub fn combine_rotations(&mut self, coefficients: &[f64]) {
        for k in 0..self.module_count() {
            let (g, i) = (k / L::WIDTH, k % L::WIDTH);
            for a in 0..A {
                let mut sum = [0.0; 3];
                for (part, responses) in coefficients.chunks(L::WIDTH).zip(&self.spans.responses) {
                    let u = &responses.u[k][a];
                    for (lane, factor) in part.iter().enumerate() {
                        for q in 0..3 {
                            sum[q] += factor * u.0[q].lane(lane);
                        }
                    }
                }
                put::<L>(&mut self.newton.step[g][a], i, Vec3::splat(sum));
            }
        }
    }
}

//! Solutions of the eliminated tangent for right-hand sides: the residual, or a change of tension.
//!
//! Theory: docs/theory/dynamics.md and docs/theory/statics.md (Eq. 3.4).

use super::body::Body;
use super::residual::Residual;
use super::tangent::{ContactBlocks, ModulePose, Tangent};
use crate::interrupt;
use crate::math::copies;
use crate::math::linalg::{dot, Mat3, Vec3};
use crate::math::mlcp::eliminate;
use crate::math::real::{Layout, Real};
use crate::rod::between::OnSection;
use crate::rod::chain::Rod;
use crate::rod::groups::{get, get_mat, lanes, put};
use crate::rod::state::State;

/// Solutions for the present tangent.
pub(super) struct Response<L: Layout, const A: usize> {
    pub columns: Vec<Column<L, A>>,
    /// Correction for loads without a potential, for the present tangent at rest.
    pub turning: Option<Box<TurningLoads<L, A>>>,
}

/// One solution: all arcs, contact forces and spans, by groups.
#[derive(Clone)]
pub(super) struct Column<L: Layout, const A: usize> {
    /// Rotation added by every arc (rad).
    pub u: Vec<[Vec3<L::Module>; A]>,
    /// Displacement of the ends due to the contact force (m).
    pub delta: Vec<Vec3<L::Module>>,
    /// Rotation (rad) and translation (m) of every disk, in its own frame.
    pub disks: Vec<[Vec3<L::Chain>; 2]>,
    /// Length change of every span at the end of the step, by tendons and modules; zero where a
    /// tendon does not pass.
    pub rates: Vec<f64>,
}

/// Correction of solutions at rest for loads on disks that have no potential: where a disk turns,
/// they act on it as a further moment and force `W`, in its frame. With `C` the rotations due to
/// these, a solution of the symmetric elimination becomes exact by adding the solution for `W (I -
/// C)^-1` times its rotations.
pub(super) struct TurningLoads<L: Layout, const A: usize> {
    /// Disks with such loads, and the moment and force by rotation of each.
    disks: Vec<(usize, [Mat3<L::Chain>; 2])>,
    /// The same of sections between disks.
    sections: Vec<OnSection<Mat3<L::Chain>>>,
    /// Rotations by those of a solution without the correction, three rows and columns a disk.
    turns: Vec<f64>,
    /// Moments and forces on all disks, in their frames, and on these sections, and the solution for
    /// them.
    on_disks: Vec<[Vec3<L::Chain>; 2]>,
    on_sections: Vec<OnSection<Vec3<L::Chain>>>,
    column: Column<L, A>,
}

impl<L: Layout, const A: usize> Response<L, A> {
    pub fn new() -> Self {
        Response {
            columns: vec![],
            turning: None,
        }
    }

    /// Solves for the present imbalance, in the first column.
    #[inline(never)]
    pub fn solve_imbalance(
        &mut self,
        rod: &Rod<L, A>,
        tangent: &mut Tangent<L, A>,
        own: &Residual<L, A>,
    ) {
        rod.layout.vectorize(
            #[inline(always)]
            || self.solve_imbalance_in_lanes(rod, tangent, own),
        )
    }

    #[inline(always)]
    fn solve_imbalance_in_lanes(
        &mut self,
        rod: &Rod<L, A>,
        tangent: &mut Tangent<L, A>,
        own: &Residual<L, A>,
    ) {
        let out = self.column(rod, 0);
        for g in 0..out.delta.len() {
            let (gradient, contact) = (&rod.gradients[g], &tangent.contact[g]);
            let imbalance = own.modules[g].imbalance;
            // an arc also moves the end through shear and extension
            for a in 0..A {
                let lever = contact.j[a] - gradient.r[a];
                out.u[g][a] = gradient.g[a] + lever.tr_mul(imbalance);
            }
            out.delta[g] = imbalance;
        }
        self.solve(rod, tangent, 0);
    }

    /// Solves for a change of tension in a tendon, by modules.
    #[inline(never)]
    pub fn solve_tension(
        &mut self,
        rod: &Rod<L, A>,
        tangent: &mut Tangent<L, A>,
        column: usize,
        tendon_tension: (usize, &[f64]),
    ) {
        rod.layout.vectorize(
            #[inline(always)]
            || self.solve_tension_in_lanes(rod, tangent, column, tendon_tension),
        )
    }

    #[inline(always)]
    fn solve_tension_in_lanes(
        &mut self,
        rod: &Rod<L, A>,
        tangent: &mut Tangent<L, A>,
        column: usize,
        (tendon, tension): (usize, &[f64]),
    ) {
        let n = rod.module_count();
        let out = self.column(rod, column);
        for g in 0..out.delta.len() {
            let span = rod.span(g, tendon);
            let force = span.direction * lanes::<L>(n, g, |k| tension[k]);
            let torque = span.arm.cross(force);
            for a in 0..A {
                out.u[g][a] = torque + tangent.contact[g].j[a].tr_mul(force);
            }
            out.delta[g] = force;
        }
        self.solve(rod, tangent, column);
    }

    /// Column for a solution.
    #[inline(always)]
    fn column(&mut self, rod: &Rod<L, A>, column: usize) -> &mut Column<L, A> {
        while self.columns.len() <= column {
            self.columns.push(Column::of(rod));
        }
        &mut self.columns[column]
    }

    /// Solves for the right-hand side in a column, in place.
    #[inline(always)]
    fn solve(&mut self, rod: &Rod<L, A>, tangent: &mut Tangent<L, A>, column: usize) {
        let out = &mut self.columns[column];
        out.substitute(rod, tangent, &[], &[]);
        if let Some(correction) = &mut self.turning {
            correction.apply(rod, tangent, out);
        }
    }

    /// Computes the length change of all spans at the end of the step for a solution. Uses the
    /// spans where forces balance, which is accurate enough for Newton's method.
    #[inline(never)]
    pub fn rate_spans(&mut self, body: &Body<L, A>, tangent: &Tangent<L, A>, column: usize) {
        body.rod.layout.vectorize(
            #[inline(always)]
            || self.rate_spans_in_lanes(body, tangent, column),
        )
    }

    #[inline(always)]
    fn rate_spans_in_lanes(&mut self, body: &Body<L, A>, tangent: &Tangent<L, A>, column: usize) {
        let (rod, out) = (&body.rod, &mut self.columns[column]);
        let (groups, count) = (out.delta.len(), rod.tendons.len());
        let ahead = L::Module::splat(1.0 / body.scheme.af);
        for g in 0..groups {
            let (mut turn, mut moved) = (Vec3::zero(), out.delta[g]);
            for a in 0..A {
                turn += out.u[g][a];
                moved += tangent.contact[g].j[a] * out.u[g][a];
            }
            for j in 0..count {
                let span = rod.span(g, j);
                let rate = span.direction.dot(moved + turn.cross(span.arm)) * ahead;
                let rate = rate * rod.fixed.passes[g * count + j];
                let rates = &mut out.rates[(j * groups + g) * L::WIDTH..][..L::WIDTH];
                for (i, out) in rates.iter_mut().enumerate() {
                    *out = L::get(&rate, i).lane(0);
                }
            }
        }
    }

    /// Moves the end of the step by a linear combination of solutions.
    #[inline(always)]
    pub fn combine(
        &self,
        body: &Body<L, A>,
        tangent: &Tangent<L, A>,
        coefficients: &[f64],
        next: &mut [State<L::Module, A>],
    ) {
        for (column, factor) in self.columns.iter().zip(coefficients) {
            column.add(body, tangent, L::Module::splat(*factor), next);
        }
    }

    /// Prepares the correction for this tangent.
    #[inline(never)]
    pub fn prepare_turning(&mut self, rod: &Rod<L, A>, tangent: &mut Tangent<L, A>) {
        rod.layout.vectorize(
            #[inline(always)]
            || self.prepare_turning_in_lanes(rod, tangent),
        )
    }

    #[inline(always)]
    fn prepare_turning_in_lanes(&mut self, rod: &Rod<L, A>, tangent: &mut Tangent<L, A>) {
        let n = rod.module_count();
        let acts = |parts: &[Mat3<L::Chain>; 2]| parts.iter().any(|m| m.of_lane(0) != Mat3::zero());
        let mut disks = vec![];
        for k in 0..n {
            let (attached, rotation) = (&rod.attached, &rod.rotations[k + 1]);
            let whole = attached.stiffness::<false>(k, rotation);
            let skew = whole - attached.stiffness::<true>(k, rotation);
            let parts = [-skew, rod.attached.by_own_turn(k)];
            if acts(&parts) {
                disks.push((k, parts));
            }
        }
        let mut sections = vec![];
        if Rod::<L, A>::BETWEEN && rod.attached.has_between() {
            sections = rod.turning_between();
            sections.retain(|section| acts(&section.parts));
        }
        let size = 3 * (disks.len() + sections.len());
        let mut on_sections = vec![];
        for section in &sections {
            on_sections.push(OnSection {
                module: section.module,
                arcs: section.arcs,
                parts: [Vec3::zero(); 2],
            });
        }
        let mut correction = TurningLoads {
            turns: vec![],
            on_disks: copies([Vec3::zero(); 2], n),
            on_sections,
            column: Column::of(rod),
            disks,
            sections,
        };
        // I - C, and I beside it
        let mut problem = vec![0.0; size * 2 * size];
        for at in 0..size {
            if interrupt::work(n * 16) {
                return;
            }
            let mut turn = Vec3::zero();
            turn[at % 3] = L::Chain::splat(1.0);
            let unit = |i: usize| if i == at / 3 { turn } else { Vec3::zero() };
            correction.solve(rod, tangent, unit);
            for (i, turn) in correction.turns_of(&correction.column).iter().enumerate() {
                problem[i * 2 * size + at] = -turn;
            }
            problem[at * 2 * size + at] += 1.0;
            problem[at * 2 * size + size + at] = 1.0;
        }
        let solved = eliminate(&mut problem, size);
        for row in problem.chunks_exact(2 * size) {
            correction.turns.extend_from_slice(&row[size..]);
        }
        if !solved {
            correction.turns.fill(f64::NAN);
        }
        self.turning = Some(Box::new(correction));
    }
}

impl<L: Layout, const A: usize> Column<L, A> {
    fn of(rod: &Rod<L, A>) -> Self {
        let groups = rod.states.len();
        Column {
            u: copies([Vec3::zero(); A], groups),
            delta: copies(Vec3::zero(), groups),
            disks: copies([Vec3::zero(); 2], rod.module_count()),
            rates: vec![0.0; groups * L::WIDTH * rod.tendons.len()],
        }
    }

    /// Moves the end of the step by this solution times a factor.
    #[inline(never)]
    pub fn add(
        &self,
        body: &Body<L, A>,
        tangent: &Tangent<L, A>,
        factor: L::Module,
        next: &mut [State<L::Module, A>],
    ) {
        body.rod.layout.vectorize(
            #[inline(always)]
            || self.add_in_lanes(body, tangent, factor, next),
        )
    }

    #[inline(always)]
    fn add_in_lanes(
        &self,
        body: &Body<L, A>,
        tangent: &Tangent<L, A>,
        factor: L::Module,
        next: &mut [State<L::Module, A>],
    ) {
        let ahead = factor * L::Module::splat(1.0 / body.scheme.af);
        for (g, next) in next.iter_mut().enumerate() {
            for a in 0..A {
                let step = body.rod.gradients[g].to_strain[a] * self.u[g][a];
                next.w[a] = step.scaled_add(ahead, next.w[a]);
            }
            let step = tangent.contact[g].stiffness * self.delta[g];
            next.n = step.scaled_add(ahead, next.n);
        }
    }

    /// Substitution from tip to base and back; moments and forces `on_disks` act in their frames, and
    /// `on_sections` in those of the starts of their modules, if there are any.
    #[inline(never)]
    fn substitute(
        &mut self,
        rod: &Rod<L, A>,
        tangent: &mut Tangent<L, A>,
        on_disks: &[[Vec3<L::Chain>; 2]],
        on_sections: &[OnSection<Vec3<L::Chain>>],
    ) {
        rod.layout.vectorize(
            #[inline(always)]
            || self.substitute_in_lanes(rod, tangent, on_disks, on_sections),
        )
    }

    #[inline(always)]
    fn substitute_in_lanes(
        &mut self,
        rod: &Rod<L, A>,
        tangent: &mut Tangent<L, A>,
        on_disks: &[[Vec3<L::Chain>; 2]],
        on_sections: &[OnSection<Vec3<L::Chain>>],
    ) {
        self.substitute_to_base(rod, tangent, on_disks, on_sections);
        self.substitute_to_tip(rod, tangent);
    }

    /// Eliminates the right-hand side, module by module from the tip.
    #[inline(always)]
    fn substitute_to_base(
        &mut self,
        rod: &Rod<L, A>,
        tangent: &mut Tangent<L, A>,
        on_disks: &[[Vec3<L::Chain>; 2]],
        on_sections: &[OnSection<Vec3<L::Chain>>],
    ) {
        let mut p = [Vec3::zero(); 2];
        for k in (0..rod.module_count()).rev() {
            let (g, i) = (k / L::WIDTH, k % L::WIDTH);
            let contact = &tangent.contact[g];
            let module = &mut tangent.eliminated[k];
            let ModulePose { s, o, b } = ModulePose::of(rod, k);
            if let Some([moment, force]) = on_disks.get(k) {
                p[0] -= *moment;
                p[1] -= *force;
            }
            let mut start = [Vec3::zero(); 2];
            for load in on_sections.iter().filter(|load| load.module == k) {
                let own = self.load_section(rod, contact, load);
                start = [start[0] + own[0], start[1] + own[1]];
            }
            let push = s * p[1];
            let turn = s * p[0] + b.cross(push);
            let delta = module.inverse * (get::<L>(&self.delta[g], i) + push);
            module.solution = delta;
            let mut u = [Vec3::zero(); A];
            for a in 0..A {
                let on_end = get_mat::<L>(&contact.j[a], i).tr_mul(push);
                u[a] = get::<L>(&self.u[g][a], i) + turn + on_end - module.u[a].tr_mul(delta);
            }
            p = [
                turn + o.cross(push) - module.x.tr_mul(delta) - start[0],
                push - module.t.tr_mul(delta) - start[1],
            ];
            module.arcs.backward::<true>(&mut u, &mut p);
            for a in 0..A {
                put::<L>(&mut self.u[g][a], i, u[a]);
            }
        }
    }

    /// Adds a moment and a force on a section to the right-hand sides of its module; returns those
    /// on the start of the module.
    #[cold]
    fn load_section(
        &mut self,
        rod: &Rod<L, A>,
        contact: &ContactBlocks<L::Module, A>,
        load: &OnSection<Vec3<L::Chain>>,
    ) -> [Vec3<L::Chain>; 2] {
        let (k, [moment, force]) = (load.module, load.parts);
        let (g, i) = (k / L::WIDTH, k % L::WIDTH);
        let (c, state, gradient) = (&rod.constants[g], &rod.states[g], &rod.gradients[g]);
        let at = load.arcs - 1;
        let share = L::get(&c.share(at), i);
        let beyond = get::<L>(&state.tail[at], i).skew();
        for a in 0..A {
            let r = get_mat::<L>(&gradient.r[a], i);
            let mut moved = (get_mat::<L>(&contact.j[a], i) - r) * share;
            let mut sum = get::<L>(&self.u[g][a], i);
            if a <= at {
                moved += r + beyond;
                sum -= moment;
            }
            sum -= moved.tr_mul(force);
            put::<L>(&mut self.u[g][a], i, sum);
        }
        let delta = get::<L>(&self.delta[g], i) - force * share;
        put::<L>(&mut self.delta[g], i, delta);
        let mut place = get::<L>(&state.inside(c, at), i);
        place.0[2] += rod.fixed.modules[k].clamp[0];
        [moment + place.cross(force), force]
    }

    /// Solves module by module from the base.
    #[inline(always)]
    fn substitute_to_tip(&mut self, rod: &Rod<L, A>, tangent: &Tangent<L, A>) {
        let mut x = [Vec3::zero(); 2];
        for k in 0..rod.module_count() {
            let (g, i) = (k / L::WIDTH, k % L::WIDTH);
            let (contact, module) = (&tangent.contact[g], &tangent.eliminated[k]);
            let mut right = [Vec3::zero(); A];
            for a in 0..A {
                right[a] = get::<L>(&self.u[g][a], i);
            }
            let u = module.arcs.forward(&right, &x);
            let mut coupled = module.x * x[0] + module.t * x[1];
            let ModulePose { s, o, b } = ModulePose::of(rod, k);
            let mut turn = x[0];
            let mut moved = x[1] + x[0].cross(o);
            for a in 0..A {
                coupled += module.u[a] * u[a];
                turn += u[a];
                moved += get_mat::<L>(&contact.j[a], i) * u[a];
                put::<L>(&mut self.u[g][a], i, u[a]);
            }
            let delta = -(module.solution + module.inverse * coupled);
            put::<L>(&mut self.delta[g], i, delta);
            moved += delta + turn.cross(b);
            x = [s.tr_mul(turn), s.tr_mul(moved)];
            self.disks[k] = x;
        }
    }
}

/// Product of a matrix, row by row, and a vector.
fn products(rows: &[f64], vector: &[f64]) -> Vec<f64> {
    let rows = rows.chunks_exact(vector.len());
    rows.map(|row| dot(row, vector)).collect()
}

impl<L: Layout, const A: usize> TurningLoads<L, A> {
    /// Solves for the moments and forces by rotations of the loaded disks.
    #[inline(always)]
    fn solve(
        &mut self,
        rod: &Rod<L, A>,
        tangent: &mut Tangent<L, A>,
        turn: impl Fn(usize) -> Vec3<L::Chain>,
    ) {
        for (i, (k, by_turn)) in self.disks.iter().enumerate() {
            let turn = turn(i);
            self.on_disks[*k] = [by_turn[0] * turn, by_turn[1] * turn];
        }
        for (i, section) in self.sections.iter().enumerate() {
            let turn = turn(self.disks.len() + i);
            self.on_sections[i].parts = [section.parts[0] * turn, section.parts[1] * turn];
        }
        self.column.u.fill([Vec3::zero(); A]);
        self.column.delta.fill(Vec3::zero());
        let (on_disks, on_sections) = (&self.on_disks, &self.on_sections);
        self.column.substitute(rod, tangent, on_disks, on_sections);
    }

    /// Rotations of the loaded disks and sections in a solution.
    fn turns_of(&self, of: &Column<L, A>) -> Vec<f64> {
        let mut turns = Vec::with_capacity(self.turns.len());
        for (k, _) in &self.disks {
            turns.extend_from_slice(&of.disks[*k][0].of_lane(0).0);
        }
        for section in &self.sections {
            let k = section.module;
            let mut turn = match k {
                0 => Vec3::zero(),
                k => of.disks[k - 1][0],
            };
            for own in &of.u[k / L::WIDTH][..section.arcs] {
                turn += get::<L>(own, k % L::WIDTH);
            }
            turns.extend_from_slice(&turn.of_lane(0).0);
        }
        turns
    }

    /// Corrects a solution.
    #[inline(always)]
    fn apply(&mut self, rod: &Rod<L, A>, tangent: &mut Tangent<L, A>, out: &mut Column<L, A>) {
        let without = self.turns_of(out);
        if without.is_empty() {
            return;
        }
        let turns = products(&self.turns, &without);
        self.solve(rod, tangent, |i| {
            Vec3::splat([turns[3 * i], turns[3 * i + 1], turns[3 * i + 2]])
        });
        let part = &self.column;
        for g in 0..out.delta.len() {
            for a in 0..A {
                out.u[g][a] += part.u[g][a];
            }
            out.delta[g] += part.delta[g];
        }
        for (disk, part) in out.disks.iter_mut().zip(&part.disks) {
            for q in 0..2 {
                disk[q] += part[q];
            }
        }
    }
}

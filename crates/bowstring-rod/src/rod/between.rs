//! Loads on sections of the backbone between two disks.
//!
//! Theory: docs/theory/rod.md (Loads) and docs/theory/statics.md (Followers).
//!
//! Such a load acts on a node between two elements, whose lengths are chosen for that (see
//! [`Constants::divided`]). Its force is a dead load on the node ([`Tendons::on_nodes`]). Its moment
//! turns the node, hence all arcs before it and the start of the module. As the elements on both
//! sides of the node are not equally long, the couples of the weight by Hermite's rule do not cancel
//! there.

use crate::math::linalg::{Mat3, Vec3};
use crate::math::real::{Layout, Real};
use crate::model::load::PointLoad;
use crate::rod::chain::{Between, LoadedSection, Rod};
use crate::rod::constants::Constants;
use crate::rod::defect::LoadsOnNodes;
use crate::rod::elimination::Blocks;
use crate::rod::groups::{get, get_mat, put};
use crate::rod::point_loads::{
    potential_of, sum_of_forces, sum_of_moments, sum_of_stiffness, turning_of,
};
#[cfg(doc)]
use crate::rod::routes::Tendons;
use crate::rod::state::{Gradient, State};
use std::ops::Range;

impl<C: Real> LoadedSection<C> {
    /// Arcs of its module before it.
    pub fn arcs(&self) -> usize {
        2 * self.element
    }
}

/// Moment and force on a section between two disks, or their change by its rotation, in the frame of
/// the start of its module.
#[derive(Clone, Copy)]
pub struct OnSection<P> {
    pub module: usize,
    /// Arcs of the module before it.
    pub arcs: usize,
    pub parts: [P; 2],
}

/// Fractions of the flexible part at the ends of all arcs of a module that is divided at these
/// sections, in increasing order. The elements are as many times `base`, a power of two, and
/// elements between two sections have the same length.
pub fn ends_of_arcs<const A: usize>(fractions: &[f64], base: usize) -> ([f64; A], Vec<usize>) {
    let bounds: Vec<_> = [0.0]
        .iter()
        .chain(fractions)
        .chain(&[1.0])
        .copied()
        .collect();
    let mut counts = vec![1; bounds.len() - 1];
    for _ in counts.len()..base {
        let length = |i: usize| (bounds[i + 1] - bounds[i]) / counts[i] as f64;
        // the first of the longest
        let longest = (1..counts.len()).fold(0, |best, i| match length(i) > length(best) {
            true => i,
            false => best,
        });
        counts[longest] += 1;
    }
    let (mut ends, mut elements, mut arc) = ([1.0; A], vec![], 0);
    for (i, count) in counts.iter().enumerate() {
        let arcs = count * A / base;
        for a in 1..=arcs {
            if arc < A {
                let share = a as f64 / arcs as f64;
                ends[arc] = bounds[i] + (bounds[i + 1] - bounds[i]) * share;
                arc += 1;
            }
        }
        elements.push(arc / 2);
    }
    ends[A - 1] = 1.0;
    elements.pop();
    (ends, elements)
}

impl<C: Real> Between<C> {
    pub fn clear(&mut self) {
        self.loads.clear();
        self.sections.clear();
    }

    /// Takes over loads with the modules and fractions where they act, from base to tip.
    pub fn set(&mut self, given: Vec<(usize, f64, PointLoad)>, same: impl Fn(f64, f64) -> bool) {
        self.clear();
        for (module, fraction, load) in given {
            let at = self.loads.len();
            self.loads.push(PointLoad {
                disk: module,
                arc_length: None,
                ..load
            });
            match self.sections.last_mut() {
                Some(last) if last.module == module && same(last.fraction, fraction) => {
                    last.loads.end = at + 1;
                }
                _ => self.sections.push(LoadedSection {
                    module,
                    fraction,
                    element: 0,
                    loads: at..at + 1,
                    force: Vec3::zero(),
                    couple: Vec3::zero(),
                    torque: Vec3::zero(),
                    by_turn: Mat3::zero(),
                }),
            }
        }
    }

    /// The sections in a module.
    pub fn in_module(&self, k: usize) -> Range<usize> {
        let first = self.sections.partition_point(|section| section.module < k);
        let after = self.sections.partition_point(|section| section.module <= k);
        first..after
    }

    /// The fewest elements in a module that have nodes at all sections.
    pub fn least_elements(&self) -> usize {
        let counts = self.sections.iter().map(|s| self.in_module(s.module).len());
        (counts.max().unwrap_or(0) + 1).next_power_of_two()
    }

    /// Loads on a section.
    fn on(&self, section: usize) -> &[PointLoad] {
        &self.loads[self.sections[section].loads.clone()]
    }

    /// Change of the force of followers in a module beyond its start by the rotations of its arcs,
    /// where `wide` converts to another number type.
    pub fn force_by_arcs<W: Real, const A: usize>(
        &self,
        k: usize,
        wide: impl Fn(&Mat3<C>) -> Mat3<W>,
        arcs: &[Vec3<W>; A],
    ) -> Vec3<W> {
        let mut sum = Vec3::zero();
        for section in &self.sections[self.in_module(k)] {
            let mut turn = Vec3::zero();
            for own in &arcs[..section.arcs()] {
                turn += *own;
            }
            sum += wide(&section.by_turn) * turn;
        }
        sum
    }

    /// Change of the force that shears and extends a module, by the rotations of its start and its
    /// arcs.
    pub fn stretching_by_turns<const A: usize>(
        &self,
        k: usize,
        c: &Constants<C, A>,
        start: Vec3<C>,
        arcs: &[Vec3<C>; A],
    ) -> Vec3<C> {
        let mut sum = Vec3::zero();
        for section in &self.sections[self.in_module(k)] {
            let mut turn = start;
            for own in &arcs[..section.arcs()] {
                turn += *own;
            }
            sum += section.by_turn * turn * c.fraction(section.arcs());
        }
        sum
    }

    /// Puts the forces on the sections of module `k`, whose start has some rotation, on its nodes.
    #[cold]
    pub fn put_forces<L: Layout<Chain = C>, const A: usize>(
        &self,
        k: usize,
        rotation: &Mat3<C>,
        on_nodes: &mut [Vec3<L::Module>; A],
    ) {
        for section in &self.sections[self.in_module(k)] {
            let force = rotation.tr_mul(section.force);
            put::<L>(&mut on_nodes[section.element], k % L::WIDTH, force);
        }
    }

    /// Moments on the sections of module `k` about its start, whose rotation is given; they are kept
    /// for the gradient of its arcs.
    #[cold]
    pub fn torque_on<L: Layout<Chain = C>, const A: usize>(
        &mut self,
        k: usize,
        start: &Mat3<C>,
        state: &State<L::Module, A>,
    ) -> Vec3<C> {
        let mut sum = Vec3::zero();
        for at in self.in_module(k) {
            let section = &self.sections[at];
            let turned = get_mat::<L>(&state.node(section.element), k % L::WIDTH);
            let rotation = *start * turned;
            let couple = Vec3::ez().cross(rotation.tr_mul(section.couple));
            let moment = sum_of_moments(self.on(at), &rotation) + couple;
            let torque = -(turned * moment);
            self.sections[at].torque = torque;
            sum += torque;
        }
        sum
    }

    /// Adds the moments on the sections of a group of `n` modules to the gradient of its arcs.
    #[cold]
    pub fn add_torques<L: Layout<Chain = C>, const A: usize>(
        &self,
        n: usize,
        g: usize,
        out: &mut Gradient<L::Module, A>,
    ) {
        for i in 0..L::WIDTH.min(n - g * L::WIDTH) {
            for section in &self.sections[self.in_module(g * L::WIDTH + i)] {
                for own in &mut out.g[..section.arcs()] {
                    let sum = get::<L>(own, i) + section.torque;
                    put::<L>(own, i, sum);
                }
            }
        }
    }

    /// Largest force on a section (N), in one lane.
    pub fn largest_force(&self, lane: usize) -> f64 {
        let sizes = self.sections.iter().map(|s| s.force.norm().lane(lane));
        sizes.fold(0.0, f64::max)
    }
}

/// Couple of the weight on the node before an element, over the mean weight of an element (m).
fn couple_by_weight<C: Real, const A: usize>(c: &Constants<C, A>, element: usize) -> C {
    let (before, after) = (c.part(element - 1), c.part(element));
    let unequal = (after * after - before * before) * C::splat(1.0 / 12.0);
    c.flexible * C::splat(2.0 / A as f64) * unequal
}

/// Forces of loads between disks on the nodes of a group; see [`Tendons::on_nodes`].
#[inline(always)]
pub fn nodes_of<T, const A: usize>(on_nodes: &[[Vec3<T>; A]], group: usize) -> &[Vec3<T>] {
    match A {
        2 => &[],
        _ => on_nodes.get(group).map_or(&[], |nodes| nodes),
    }
}

impl<L: Layout, const A: usize> Rod<L, A> {
    fn between(&self) -> &Between<L::Chain> {
        &self.attached.between
    }

    /// Divides modules at the sections on which loads act, after `set_attached`, and equally where
    /// there are none; returns whether any changed.
    #[cold]
    pub fn divide(&mut self) -> bool {
        let Some(source) = &self.fixed.source else {
            return false;
        };
        let base = self.attached.between.least_elements();
        debug_assert!(2 * base <= A, "checked where loads enter");
        let mut changed = false;
        for k in 0..self.dead.modules.len() {
            let range = self.attached.between.in_module(k);
            let sections = &mut self.attached.between.sections[range];
            let fractions: Vec<_> = sections.iter().map(|s| s.fraction).collect();
            let base = if fractions.is_empty() { 1 } else { base };
            let divided = !fractions.is_empty();
            let (ends, elements) = ends_of_arcs::<A>(&fractions, base);
            let ends = divided.then_some(ends);
            for (section, element) in sections.iter_mut().zip(elements) {
                section.element = element;
            }
            if !self.fixed.modules[k].ends_at(ends) {
                let (robot, model) = &**source;
                let c = Constants::divided(robot, k, *model, ends);
                self.fixed.modules[k] = Constants::gather(&[&c]);
                self.constants[k] = Constants::gather(&[&c]);
                changed = true;
            }
        }
        self.on_nodes.clear();
        if Self::BETWEEN && !self.between().loads.is_empty() {
            let none = [Vec3::zero(); A];
            self.on_nodes.resize(self.states.len(), none);
        }
        changed
    }

    /// Forces on the nodes of a group of modules; see [`Tendons::on_nodes`].
    #[inline(always)]
    pub fn on_nodes(&self, g: usize) -> &[Vec3<L::Module>] {
        nodes_of(&self.on_nodes, g)
    }

    /// Rotation of a section relative to the start of its module.
    fn turned(&self, section: &LoadedSection<L::Chain>) -> Mat3<L::Chain> {
        let (g, i) = (section.module / L::WIDTH, section.module % L::WIDTH);
        get_mat::<L>(&self.states[g].node(section.element), i)
    }

    /// Rotation of a section in the base frame.
    fn rotation_of(&self, section: &LoadedSection<L::Chain>) -> Mat3<L::Chain> {
        self.rotations[section.module] * self.turned(section)
    }

    /// Forces on all sections, of the dead loads alone or with followers.
    pub fn set_forces_between(&mut self, followers: bool) {
        for at in 0..self.between().sections.len() {
            let rotation = followers.then(|| self.rotation_of(&self.between().sections[at]));
            let force = sum_of_forces(self.between().on(at), rotation.as_ref());
            self.attached.between.sections[at].force = force;
        }
    }

    /// Forces of the followers on the sections of a module, or of the dead loads there, in the base
    /// frame (N).
    pub fn force_between(&self, k: usize, followers: bool) -> Vec3<L::Chain> {
        let mut sum = Vec3::zero();
        for at in self.between().in_module(k) {
            let section = &self.between().sections[at];
            let loads = self.between().on(at).iter();
            for load in loads.filter(|load| load.follower == followers) {
                let rotation = followers.then(|| self.rotation_of(section));
                sum += sum_of_forces(std::slice::from_ref(load), rotation.as_ref());
            }
        }
        sum
    }

    /// Couples of the weight on the sections, from the mean weight of an element.
    pub fn set_couples(&mut self) {
        for section in &mut self.attached.between.sections {
            let k = section.module;
            let by_weight = couple_by_weight(&self.fixed.modules[k], section.element);
            section.couple = self.dead.modules[k][3] * by_weight;
        }
    }

    /// Imbalance of the moments on the sections of a module by a change of the mean weight of an
    /// element, with the arcs of the module before each section.
    pub fn torques_by_weight(
        &self,
        k: usize,
        weight: Vec3<L::Chain>,
    ) -> impl Iterator<Item = (usize, Vec3<L::Chain>)> + '_ {
        let sections = &self.between().sections[self.between().in_module(k)];
        sections.iter().map(move |section| {
            let couple = weight * couple_by_weight(&self.fixed.modules[k], section.element);
            let couple = Vec3::ez().cross(self.rotation_of(section).tr_mul(couple));
            (section.arcs(), -(self.turned(section) * couple))
        })
    }

    /// Potential of the loads and couples on the sections, without that of the places of the
    /// sections (J).
    pub fn potential_between(&self) -> L::Chain {
        let mut sum = L::Chain::zero();
        for (at, section) in self.between().sections.iter().enumerate() {
            let rotation = self.rotation_of(section);
            sum += potential_of(self.between().on(at), &rotation);
            sum -= rotation.column(2).dot(section.couple);
        }
        sum
    }

    /// Moments on the nodes of a group for the error estimate, in the frames of the starts.
    #[cold]
    pub fn loads_on_nodes(&self, g: usize) -> LoadsOnNodes<L::Module, A> {
        let mut out = LoadsOnNodes {
            moments: [Vec3::zero(); A],
            couples: [Vec3::zero(); A],
        };
        for i in 0..L::WIDTH.min(self.module_count() - g * L::WIDTH) {
            let k = g * L::WIDTH + i;
            for at in self.between().in_module(k) {
                let section = &self.between().sections[at];
                let turned = self.turned(section);
                let rotation = self.rotations[k] * turned;
                let moment = turned * sum_of_moments(self.between().on(at), &rotation);
                let couple = self.rotations[k].tr_mul(section.couple);
                put::<L>(&mut out.moments[section.element], i, moment);
                put::<L>(&mut out.couples[section.element], i, couple);
            }
        }
        out
    }

    /// Adds the second derivatives of constant moments on the sections of a group.
    #[cold]
    pub fn linearise_torques(&mut self, g: usize) {
        for i in 0..L::WIDTH.min(self.module_count() - g * L::WIDTH) {
            let range = self.between().in_module(g * L::WIDTH + i);
            for section in &self.attached.between.sections[range] {
                let mut torque = Vec3::zero();
                put::<L>(&mut torque, i, section.torque);
                let out = &mut self.newton.hessians[g];
                let arcs = section.arcs();
                self.states[g].add_moment_on_node(&self.gradients[g], arcs, torque, out);
            }
        }
    }

    /// Adds the stiffness of the loads on the sections of module `k` to its blocks.
    #[cold]
    pub fn add_stiffness_between<const SYMMETRIC: bool, const S: usize>(
        &self,
        k: usize,
        blocks: &mut Blocks<L::Chain, A, S>,
    ) {
        for at in self.between().in_module(k) {
            let section = &self.between().sections[at];
            let turned = self.turned(section);
            let own = self.stiffness_on::<SYMMETRIC>(at);
            let mut value = turned * own * turned.transpose();
            if SYMMETRIC {
                value = value.mirrored();
            }
            let arcs = section.arcs();
            for a in 0..arcs {
                for b in 0..arcs {
                    if b >= a || !SYMMETRIC {
                        blocks.uu[b][a] += value;
                    }
                }
                blocks.xu[a][0] += value;
                blocks.ux[a][0] += value;
            }
            blocks.xx[0][0] += value;
        }
    }

    /// Stiffness of the loads and the couple on a section against its rotation, in its frame; see
    /// `Attached::stiffness`.
    fn stiffness_on<const SYMMETRIC: bool>(&self, at: usize) -> Mat3<L::Chain> {
        let section = &self.between().sections[at];
        let rotation = self.rotation_of(section);
        let loads = self.between().on(at);
        let sum = sum_of_stiffness::<_, SYMMETRIC>(loads, &rotation, Mat3::zero());
        let couple = rotation.tr_mul(section.couple);
        let of_couple = (-couple.outer(Vec3::ez())).symmetric_part();
        sum + of_couple.add_diagonal([couple[2]; 3])
    }

    /// Adds the changes of the forces of followers on the sections of module `k` by their rotation
    /// to its blocks.
    #[cold]
    pub fn couple_followers_between(&mut self, k: usize, blocks: &mut Blocks<L::Chain, A, 1>) {
        for at in self.between().in_module(k) {
            let section = &self.between().sections[at];
            let turned = self.turned(section);
            let own: Mat3<L::Chain> = turning_of(self.between().on(at));
            let by_turn = turned * own * turned.transpose();
            self.couple_section(section, &by_turn, blocks);
            self.attached.between.sections[at].by_turn = by_turn;
        }
    }

    fn couple_section(
        &self,
        section: &LoadedSection<L::Chain>,
        by_turn: &Mat3<L::Chain>,
        blocks: &mut Blocks<L::Chain, A, 1>,
    ) {
        let k = section.module;
        let (g, i) = (k / L::WIDTH, k % L::WIDTH);
        let (state, response) = (&self.states[g], &self.newton.responses[g]);
        let (c, gradient) = (&self.constants[g], &self.gradients[g]);
        let arcs = section.arcs();
        let share = L::get(&c.fraction(arcs), i);
        let m = get_mat::<L>(&response.m, i).transpose();
        let d_hat = get_mat::<L>(&response.d_hat, i);
        let sideways = get_mat::<L>(&response.k, i) * d_hat;
        let stretching = get::<L>(&state.stretching_load(c, self.on_nodes(g)), i);
        let beyond = get::<L>(&state.tail[arcs - 1], i).skew();
        let mut place = get::<L>(&state.inside(c, arcs - 1), i);
        place.0[2] += self.fixed.modules[k].clamp[0];
        let on_start = (stretching.cross_mat(d_hat) * share - place.skew()) * *by_turn;
        for a in 0..A {
            let j = get_mat::<L>(&response.j[a], i).transpose();
            let r = get_mat::<L>(&gradient.r[a], i).transpose();
            // shear and extension of the end, and the motion of the node by the arcs before it
            let mut arc = (sideways - j * m + r) * share;
            if a < arcs {
                arc += beyond - r;
            }
            let on_arc = arc * *by_turn;
            for b in 0..arcs {
                blocks.uu[a][b] += on_arc;
            }
            blocks.ux[a][0] += on_arc;
            if a < arcs {
                blocks.xu[a][0] += on_start;
            }
        }
        blocks.xx[0][0] += on_start;
    }

    /// Change of the force on the sections of module `k` by the rotation of its start, after its
    /// elimination.
    pub fn force_between_by_start(&self, k: usize) -> Mat3<L::Chain> {
        let mut sum = Mat3::zero();
        for section in &self.between().sections[self.between().in_module(k)] {
            let taken = self.newton.eliminated[k].turn_of_arcs_by_start(section.arcs());
            sum += section.by_turn * (Mat3::identity() - taken);
        }
        sum
    }

    /// Visits the sections of a module: number of arcs before each, and force (N) and moment (N m) of
    /// its loads for some rotation of it, in the base frame.
    pub fn each_between(
        &self,
        k: usize,
        rotation: impl Fn(usize) -> Mat3<L::Chain>,
        mut visit: impl FnMut(usize, [Vec3<L::Chain>; 2]),
    ) {
        for at in self.between().in_module(k) {
            let arcs = self.between().sections[at].arcs();
            let (loads, rotation) = (self.between().on(at), rotation(arcs));
            let moment = rotation * sum_of_moments(loads, &rotation);
            visit(arcs, [sum_of_forces(loads, Some(&rotation)), moment]);
        }
    }

    /// Visits the sections of a module: number of arcs before each, and sum of its forces at the
    /// present rotation in the base frame (N).
    pub fn each_force_between(&self, k: usize, mut visit: impl FnMut(usize, Vec3<L::Chain>)) {
        for at in self.between().in_module(k) {
            let section = &self.between().sections[at];
            let rotation = self.rotation_of(section);
            let force = sum_of_forces(self.between().on(at), Some(&rotation));
            visit(section.arcs(), force);
        }
    }

    /// Moment and force by the rotation of every section that have no potential.
    pub fn turning_between(&self) -> Vec<OnSection<Mat3<L::Chain>>> {
        let of = |(at, section): (usize, &LoadedSection<L::Chain>)| {
            let turned = self.turned(section);
            let skew = self.stiffness_on::<false>(at) - self.stiffness_on::<true>(at);
            let force: Mat3<L::Chain> = turning_of(self.between().on(at));
            let parts = [-skew, force].map(|m| turned * m * turned.transpose());
            OnSection {
                module: section.module,
                arcs: section.arcs(),
                parts,
            }
        };
        self.between().sections.iter().enumerate().map(of).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn elements_end_at_the_sections() {
        let (ends, elements) = ends_of_arcs::<4>(&[0.3], 2);
        for (end, expected) in ends.into_iter().zip([0.15, 0.3, 0.65, 1.0]) {
            assert!((end - expected).abs() < 1e-15);
        }
        assert_eq!(elements, [1]);
        let (ends, elements) = ends_of_arcs::<8>(&[], 1);
        assert_eq!(ends, [0.125, 0.25, 0.375, 0.5, 0.625, 0.75, 0.875, 1.0]);
        assert!(elements.is_empty());
        // the longest part has most elements, and finer ones lie in the coarser
        let (coarse, first) = ends_of_arcs::<8>(&[0.1, 0.8], 4);
        let (fine, second) = ends_of_arcs::<16>(&[0.1, 0.8], 4);
        assert_eq!((first, second), (vec![1, 3], vec![2, 6]));
        for a in 0..8 {
            assert!((coarse[a] - fine[2 * a + 1]).abs() < 1e-15);
        }
    }
}

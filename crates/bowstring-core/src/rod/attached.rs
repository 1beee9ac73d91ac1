//! Loads on disks beside dead forces on their centres: moments, forces off the centre, followers;
//! and the same on a section of the backbone between two disks.
//!
//! Theory: docs/theory/rod.md (Loads) and docs/theory/statics.md (Followers).
//!
//! A dead force at a point of a disk has a potential; it adds a moment and a symmetric stiffness
//! against the disk's rotation. A follower has none. Its force turns with its disk, which changes
//! the resultant of all loads beyond every module before it: the elimination then carries, beside
//! the second variation of the distal part, the change `Q x` of its force by the rotation `x` of
//! the disk.
//!
//! A load between two disks acts on the middle node of its module, whose elements are divided there
//! (see [`Constants::divided`]). Its force is part of the dead loads of the module ([`State::f`]). Its
//! moment turns the node, hence all arcs before it and the start. As the elements on both sides of
//! the node are not equally long, the couples of the weight by Hermite's rule do not cancel there.

use crate::math::linalg::{Mat3, Vec3};
use crate::math::real::{Layout, Real};
use crate::model::load::{Load, PointLoad};
use crate::model::robot::{place, Payload, Place};
use crate::rod::chain::{get, get_mat, lumped, put, Rod};
use crate::rod::constants::Constants;
use crate::rod::defect::LoadOnNode;
use crate::rod::elimination::Blocks;
#[cfg(doc)]
use crate::rod::module::State;

/// Moments and point loads on the disks of a robot.
#[derive(Clone)]
pub(crate) struct Attached<C, const A: usize> {
    /// Dead moments on the disks in the base frame (N m), that on the tip included; empty if there
    /// are none.
    moments: Vec<Vec3<C>>,
    /// By disks from base to tip.
    loads: Vec<PointLoad>,
    /// Loads between two disks; `disk` is the one after them.
    between: Vec<PointLoad>,
    /// Fractions of all modules at which they are divided; empty if there are no such loads.
    fractions: Vec<f64>,
    /// Couples on the tangent of the middle node of each module by Hermite's rule of the weight (N
    /// m), in the base frame; empty if there are no loads between disks.
    couples: Vec<Vec3<C>>,
    /// Imbalance of the moment on the middle node of each module (N m), in the frame of its start,
    /// from the last gradient.
    pub torques: Vec<Vec3<C>>,
    /// Rotations of the middle nodes, from the last evaluation with followers.
    nodes: Vec<Mat3<C>>,
    /// Modules before the last follower force.
    followed: usize,
    /// Loads on the modules without followers; empty if there are none.
    constant: Vec<[Vec3<C>; 5]>,
    /// By modules before the last follower force, from the last elimination.
    couplings: Vec<Coupling<C, A>>,
    /// Change of the force of the part beyond a disk by its rotation (N), during an elimination.
    by_turn: Mat3<C>,
}

/// Effect on a module of a change of the force beyond it, in the frame of its start.
#[derive(Clone, Copy)]
pub(crate) struct Coupling<T, const A: usize> {
    /// Change of the force by the rotation of the module's end (N).
    by_turn: Mat3<T>,
    /// Change of the force on the middle node by its rotation (N).
    by_node: Mat3<T>,
    /// Moment imbalance of each arc and of the start by the force (m).
    arcs: [Mat3<T>; A],
    start: Mat3<T>,
}

impl<T: Real, const A: usize> Coupling<T, A> {
    fn none() -> Self {
        let zero = Mat3::zero();
        Coupling {
            by_turn: zero,
            by_node: zero,
            arcs: [zero; A],
            start: zero,
        }
    }

    /// Adds a force beyond the module to the right-hand sides of its arcs and its start.
    #[inline(always)]
    pub fn add_force(&self, force: Vec3<T>, arcs: &mut [Vec3<T>; A], start: &mut Vec3<T>) {
        for (rhs, by_force) in arcs.iter_mut().zip(&self.arcs) {
            *rhs += *by_force * force;
        }
        *start += self.start * force;
    }

    /// Change of the force that shears and extends the module, by the rotation of its end and of
    /// its middle node.
    #[inline(always)]
    pub fn by_turns(&self, c: &Constants<T, A>, end: Vec3<T>, node: Vec3<T>) -> Vec3<T> {
        self.by_turn * end + self.by_node * node * c.fraction(A / 2)
    }

    /// Force beyond the module's start, where the arcs' own solution is `solution`.
    #[inline(always)]
    pub fn force_beyond(&self, force: Vec3<T>, solution: &[Vec3<T>; A]) -> Vec3<T> {
        let mut turn = Vec3::zero();
        for own in &solution[..A / 2] {
            turn += *own;
        }
        let of_node = self.by_node * turn;
        for own in &solution[A / 2..] {
            turn += *own;
        }
        force - self.by_turn * turn - of_node
    }

    /// The same in another number type.
    #[inline(always)]
    pub fn each<W: Real>(&self, wide: impl Fn(&Mat3<T>) -> Mat3<W>) -> Coupling<W, A> {
        let mut arcs = [Mat3::zero(); A];
        for (to, from) in arcs.iter_mut().zip(&self.arcs) {
            *to = wide(from);
        }
        Coupling {
            by_turn: wide(&self.by_turn),
            by_node: wide(&self.by_node),
            arcs,
            start: wide(&self.start),
        }
    }
}

impl<C: Real, const A: usize> Attached<C, A> {
    pub fn none() -> Self {
        Attached {
            moments: vec![],
            loads: vec![],
            between: vec![],
            fractions: vec![],
            couples: vec![],
            torques: vec![],
            nodes: vec![],
            followed: 0,
            constant: vec![],
            couplings: vec![],
            by_turn: Mat3::zero(),
        }
    }

    /// Whether there are moments or point loads.
    #[inline(always)]
    pub fn acts(&self) -> bool {
        self.has_forces() || !self.moments.is_empty()
    }

    /// Whether there are point loads.
    #[inline(always)]
    pub fn has_forces(&self) -> bool {
        !self.loads.is_empty() || self.has_between()
    }

    /// Whether there are loads between two disks, which need two elements.
    #[inline(always)]
    pub fn has_between(&self) -> bool {
        A > 2 && !self.between.is_empty()
    }

    /// Whether all of them have a potential.
    pub fn has_potential(&self) -> bool {
        let mut loads = self.loads.iter().chain(&self.between);
        self.moments.is_empty() && loads.all(PointLoad::has_potential)
    }

    /// Takes over those of a load on a robot with these modules.
    pub fn set(&mut self, load: &Load, modules: &[Constants<C, A>]) {
        let n = modules.len();
        self.moments.clear();
        let moments = load.disk_moments.iter().chain([&load.tip_moment]);
        if moments.into_iter().any(|moment| *moment != [0.0; 3]) {
            let moments = (0..n).map(|k| Vec3::splat(load.moment_on(k, n)));
            self.moments.extend(moments);
        }
        if load.point_loads.is_empty() && self.loads.is_empty() && !self.has_between() {
            return;
        }
        self.loads.clear();
        if load.has_arc_lengths() || self.has_between() {
            self.set_places(load, modules);
        } else {
            self.loads.extend_from_slice(load.point_loads);
        }
        self.loads.sort_by_key(|load| load.disk);
        let pushes = |load: &&PointLoad| load.follower && load.force != [0.0; 3];
        let followers = self.loads.iter().chain(&self.between).filter(pushes);
        self.followed = followers.map(|load| load.disk + 1).max().unwrap_or(0);
        self.couplings.resize(n, Coupling::none());
        self.constant.clear();
    }

    /// Takes over point loads of which some may act between two disks.
    #[cold]
    fn set_places(&mut self, load: &Load, modules: &[Constants<C, A>]) {
        self.between.clear();
        self.fractions.clear();
        for load in load.point_loads {
            let lengths = modules
                .iter()
                .map(|c| [c.clamp[0], c.flexible, c.clamp[1]].map(|x| x.lane(0)));
            let Some(arc_length) = load.arc_length else {
                self.loads.push(*load);
                continue;
            };
            let mut own = PointLoad {
                arc_length: None,
                ..*load
            };
            match place(lengths, arc_length) {
                Place::Base => continue,
                Place::Disk { disk, beyond } => {
                    own.disk = disk;
                    own.point[2] += beyond;
                    self.loads.push(own);
                }
                Place::Between { module, fraction } => {
                    own.disk = module;
                    self.between.push(own);
                    self.fractions.resize(modules.len(), 0.5);
                    self.fractions[module] = fraction;
                }
            }
        }
        self.between.sort_by_key(|load| load.disk);
        let count = self.fractions.len();
        self.couples.clear();
        self.couples.resize(count, Vec3::zero());
        self.torques.clear();
        self.torques.resize(count, Vec3::zero());
    }

    /// Fraction at which a module is divided.
    pub fn fraction(&self, k: usize) -> f64 {
        self.fractions.get(k).copied().unwrap_or(0.5)
    }

    /// Adds the weights of payloads, after `set`.
    pub fn add_weights(&mut self, payloads: &[Payload], gravity: [f64; 3]) {
        if payloads.is_empty() {
            return;
        }
        self.loads.extend(payloads.iter().map(|payload| PointLoad {
            disk: payload.disk,
            point: payload.centre,
            force: gravity.map(|g| g * payload.mass),
            ..PointLoad::default()
        }));
        self.loads.sort_by_key(|load| load.disk);
    }

    /// The loads on a disk.
    #[inline(always)]
    fn on(&self, k: usize) -> &[PointLoad] {
        of_disk(&self.loads, k)
    }

    /// The loads on the middle node of a module.
    fn on_node(&self, k: usize) -> &[PointLoad] {
        of_disk(&self.between, k)
    }

    /// Sum of the forces on a disk of some rotation, in the base frame (N).
    pub fn force(&self, k: usize, rotation: &Mat3<C>) -> Vec3<C> {
        sum_of_forces(self.on(k), rotation)
    }

    /// Moment of the loads on the middle node of a module about it, in its frame and for its
    /// rotation (N m); without the couple of the weight.
    fn moment_on_node(&self, k: usize, rotation: &Mat3<C>) -> Vec3<C> {
        sum_of_moments(self.on_node(k), rotation)
    }

    /// Stiffness of the loads and couples on the middle node of a module against its rotation; see
    /// `stiffness`.
    fn stiffness_on_node<const SYMMETRIC: bool>(&self, k: usize, rotation: &Mat3<C>) -> Mat3<C> {
        let sum = sum_of_stiffness::<C, SYMMETRIC>(self.on_node(k), rotation, Mat3::zero());
        let couple = rotation.tr_mul(self.couples[k]);
        let along = Vec3::ez();
        sum + (-couple.outer(along).symmetric_part()).add_diagonal([couple[2]; 3])
    }

    /// Sum of the moments on a disk of some rotation about its centre, in its frame (N m).
    #[inline(always)]
    pub fn moment(&self, k: usize, rotation: &Mat3<C>) -> Vec3<C> {
        let dead = self.moments.get(k).map(|moment| rotation.tr_mul(*moment));
        dead.unwrap_or(Vec3::zero()) + sum_of_moments(self.on(k), rotation)
    }

    /// Potential of the dead forces by the rotation of a disk (J).
    fn potential(&self, k: usize, rotation: &Mat3<C>) -> C {
        potential_of(self.on(k), rotation)
    }

    /// Stiffness against the rotation of a disk, in its frame and in rotation-vector coordinates:
    /// that of forces off the centre and, unless `SYMMETRIC`, the skew part of moments, which is
    /// `-[M] / 2` for a dead moment and `[M] / 2` for a follower.
    #[inline(always)]
    pub fn stiffness<const SYMMETRIC: bool>(&self, k: usize, rotation: &Mat3<C>) -> Mat3<C> {
        let half = C::splat(0.5);
        let mut sum = Mat3::zero();
        if let (false, Some(moment)) = (SYMMETRIC, self.moments.get(k)) {
            sum = (rotation.tr_mul(*moment) * -half).skew();
        }
        sum_of_stiffness::<C, SYMMETRIC>(self.on(k), rotation, sum)
    }

    /// Change of the forces of followers on a disk by its rotation, in its frame (N).
    pub fn by_own_turn(&self, k: usize) -> Mat3<C> {
        turning_of(self.on(k))
    }

    /// Coupling of a module with follower forces beyond it, if there are any.
    #[inline(always)]
    pub fn coupling(&self, k: usize) -> Option<&Coupling<C, A>> {
        (k < self.followed).then(|| &self.couplings[k])
    }
}

/// The loads of a sorted list on a disk.
#[inline(always)]
fn of_disk(loads: &[PointLoad], k: usize) -> &[PointLoad] {
    let first = loads.partition_point(|load| load.disk < k);
    let after = loads.partition_point(|load| load.disk <= k);
    &loads[first..after]
}

/// Sum of forces at some rotation, in the base frame (N).
fn sum_of_forces<C: Real>(loads: &[PointLoad], rotation: &Mat3<C>) -> Vec3<C> {
    let mut sum = Vec3::zero();
    for load in loads {
        let force = Vec3::splat(load.force);
        sum += match load.follower {
            true => *rotation * force,
            false => force,
        };
    }
    sum
}

/// Sum of moments at some rotation about the centre, in its frame (N m).
#[inline(always)]
fn sum_of_moments<C: Real>(loads: &[PointLoad], rotation: &Mat3<C>) -> Vec3<C> {
    let mut sum = Vec3::zero();
    for load in loads {
        sum += match load.follower {
            true => Vec3::splat(load.own_moment().0),
            false => {
                let force = rotation.tr_mul(Vec3::splat(load.force));
                let moment = rotation.tr_mul(Vec3::splat(load.moment));
                Vec3::splat(load.point).cross(force) + moment
            }
        };
    }
    sum
}

/// Potential of dead forces by the rotation (J).
fn potential_of<C: Real>(loads: &[PointLoad], rotation: &Mat3<C>) -> C {
    let mut sum = C::zero();
    for load in loads.iter().filter(|load| !load.follower) {
        let point = *rotation * Vec3::splat(load.point);
        sum -= point.dot(Vec3::splat(load.force));
    }
    sum
}

/// Adds the stiffness of loads against the rotation to a sum; see [`Attached::stiffness`].
#[inline(always)]
fn sum_of_stiffness<C: Real, const SYMMETRIC: bool>(
    loads: &[PointLoad],
    rotation: &Mat3<C>,
    mut sum: Mat3<C>,
) -> Mat3<C> {
    let half = C::splat(0.5);
    for load in loads {
        let mut skew = Vec3::splat(load.own_moment().0) * half;
        if !load.follower {
            let force = rotation.tr_mul(Vec3::splat(load.force));
            let point = Vec3::splat(load.point);
            sum += (-force.outer(point).symmetric_part()).add_diagonal([force.dot(point); 3]);
            skew = rotation.tr_mul(Vec3::splat(load.moment)) * -half;
        }
        if !SYMMETRIC {
            sum += skew.skew();
        }
    }
    sum
}

/// Change of the forces of followers by their rotation, in their frame (N).
fn turning_of<C: Real>(loads: &[PointLoad]) -> Mat3<C> {
    let mut sum = Vec3::zero();
    for load in loads.iter().filter(|load| load.follower) {
        sum += Vec3::splat(load.force);
    }
    (-sum).skew()
}

/// Sum of dead forces, or of followers at some rotation, in the base frame (N).
fn sum_of_kind<C: Real>(loads: &[PointLoad], follower: Option<&Mat3<C>>) -> Vec3<C> {
    let mut sum = Vec3::zero();
    for load in loads {
        sum += match (load.follower, follower) {
            (true, Some(rotation)) => *rotation * Vec3::splat(load.force),
            (false, None) => Vec3::splat(load.force),
            _ => continue,
        };
    }
    sum
}

impl<L: Layout, const A: usize> Rod<L, A> {
    /// Divides modules where loads act between their disks, and divides them equally again where
    /// none does any more; returns whether any changed.
    #[cold]
    pub fn divide(&mut self) -> bool {
        let Some(source) = &self.fixed.source else {
            return false;
        };
        let mut changed = false;
        for k in 0..self.dead.modules.len() {
            let parts = self.fixed.modules[k].parts[0].lane(0);
            let fraction = self.attached.fraction(k);
            if parts != 2.0 * fraction {
                let (robot, model) = &**source;
                let c = [Constants::divided(robot, k, *model, fraction)];
                self.fixed.modules[k] = Constants::gather(&c);
                self.constants[k] = Constants::gather(&c);
                changed = true;
            }
        }
        for state in &mut self.states {
            state.f[4] = Vec3::zero();
        }
        changed
    }

    /// Force of the loads on the middle node of a module (N).
    pub fn force_on_node(&self, k: usize) -> Vec3<L::Chain> {
        match self.attached.on_node(k) {
            [] => Vec3::zero(),
            loads => sum_of_forces(loads, &self.node(k)),
        }
    }

    /// Force (N) and moment (N m) of the loads on the middle node of a module, for some rotation of
    /// it, in the base frame.
    pub fn loads_on_node_at(&self, k: usize, node: &Mat3<L::Chain>) -> [Vec3<L::Chain>; 2] {
        let moment = *node * self.attached.moment_on_node(k, node);
        [sum_of_forces(self.attached.on_node(k), node), moment]
    }

    /// Moment and force by the rotation of the middle node of a module that have no potential, in
    /// the frame of its start.
    pub fn turning_on_node(&self, k: usize) -> [Mat3<L::Chain>; 2] {
        let node = self.node(k);
        let whole = self.attached.stiffness_on_node::<false>(k, &node);
        let skew = whole - self.attached.stiffness_on_node::<true>(k, &node);
        let relative = get_mat::<L>(&self.states[k / L::WIDTH].middle(), k % L::WIDTH);
        let force: Mat3<L::Chain> = turning_of(self.attached.on_node(k));
        [-skew, force].map(|m| relative * m * relative.transpose())
    }

    /// Rotation of the middle node of a module, in the base frame.
    pub fn node(&self, k: usize) -> Mat3<L::Chain> {
        self.rotations[k] * get_mat::<L>(&self.states[k / L::WIDTH].middle(), k % L::WIDTH)
    }

    /// Vectors of the middle nodes of a group, by modules.
    fn in_lanes(&self, g: usize, of: impl Fn(usize) -> Vec3<L::Chain>) -> Vec3<L::Module> {
        let mut out = Vec3::zero();
        for i in 0..L::WIDTH.min(self.module_count() - g * L::WIDTH) {
            put::<L>(&mut out, i, of(g * L::WIDTH + i));
        }
        out
    }

    /// Moments on the middle nodes of a group for the error estimate, after the gradient.
    #[cold]
    pub fn loads_on_node(&self, g: usize) -> Option<LoadOnNode<L::Module>> {
        let of_loads = |k: usize| {
            let node = self.node(k);
            self.rotations[k].tr_mul(node * self.attached.moment_on_node(k, &node))
        };
        let of_weight = |k: usize| self.rotations[k].tr_mul(self.attached.couples[k]);
        Some(LoadOnNode {
            moment: self.in_lanes(g, of_loads),
            couple: self.in_lanes(g, of_weight),
        })
    }

    /// Adds the moment on the middle node of module `k` to the gradient of its arcs and to the
    /// costate of its start.
    #[cold]
    pub fn add_moment_on_node(&mut self, k: usize, lambda: &mut Vec3<L::Chain>) {
        let node = self.node(k);
        let relative = get_mat::<L>(&self.states[k / L::WIDTH].middle(), k % L::WIDTH);
        let couple = Vec3::ez().cross(node.tr_mul(self.attached.couples[k]));
        let moment = self.attached.moment_on_node(k, &node) + couple;
        let torque = -(relative * moment);
        self.attached.torques[k] = torque;
        *lambda += torque;
    }

    /// Adds the moments on the middle nodes of a group to the gradient of its arcs.
    #[cold]
    pub fn add_torques(&mut self, g: usize) {
        let torque = self.in_lanes(g, |k| self.attached.torques[k]);
        for own in &mut self.gradients[g].g[..A / 2] {
            *own += torque;
        }
    }

    /// Adds the second derivatives of constant moments on the middle nodes of a group.
    #[cold]
    pub fn linearise_torques(&mut self, g: usize) {
        let torque = self.in_lanes(g, |k| self.attached.torques[k]);
        let out = &mut self.newton.hessians[g];
        self.states[g].add_moment_on_node(&self.gradients[g], torque, out);
    }

    /// Adds the stiffness of the loads on the middle node of module `k` to its blocks.
    #[cold]
    pub fn add_stiffness_on_node<const SYMMETRIC: bool, const S: usize>(
        &self,
        k: usize,
        blocks: &mut Blocks<L::Chain, A, S>,
    ) {
        let own = self
            .attached
            .stiffness_on_node::<SYMMETRIC>(k, &self.node(k));
        let relative = get_mat::<L>(&self.states[k / L::WIDTH].middle(), k % L::WIDTH);
        let mut value = relative * own * relative.transpose();
        if SYMMETRIC {
            value = value.mirrored();
        }
        for a in 0..A / 2 {
            for b in 0..A / 2 {
                if b >= a || !SYMMETRIC {
                    blocks.uu[b][a] += value;
                }
            }
            blocks.xu[a][0] += value;
            blocks.ux[a][0] += value;
        }
        blocks.xx[0][0] += value;
    }

    /// Adds the dead point forces and the forces per length before each disk to the loads on the
    /// modules, after `set_load`.
    pub fn add_forces(&mut self, lines: &[[f64; 3]]) {
        if !self.attached.has_forces() && lines.is_empty() {
            return;
        }
        self.add_resultants(lines, |attached, k| {
            let forces = [attached.on(k), attached.on_node(k)];
            forces.map(|loads| sum_of_kind(loads, None))
        });
        self.has_forces_on_disks();
        if self.attached.has_between() {
            self.set_couples();
        }
        if self.attached.followed > 0 {
            self.attached.constant.clone_from(&self.dead.modules);
        }
    }

    /// Couples of the weight on the middle nodes, from the mean weight of an element.
    fn set_couples(&mut self) {
        for (k, c) in self.fixed.modules.iter().enumerate() {
            let [first, second] = c.parts;
            let unequal = (second * second - first * first) * L::Chain::splat(1.0 / 12.0);
            let element = c.flexible * L::Chain::splat(2.0 / A as f64);
            self.attached.couples[k] = self.dead.modules[k][3] * (element * unequal);
        }
    }

    /// Adds forces on the disks, on the middle nodes before them, and per length before them, in the
    /// base frame, to the loads on the modules.
    fn add_resultants(
        &mut self,
        lines: &[[f64; 3]],
        forces: impl Fn(&Attached<L::Chain, A>, usize) -> [Vec3<L::Chain>; 2],
    ) {
        let mut force = Vec3::zero();
        for k in (0..self.module_count()).rev() {
            let [on_disk, on_node] = forces(&self.attached, k);
            force += on_disk;
            let c = &self.fixed.modules[k];
            let line = lines.get(k).map_or(Vec3::zero(), |line| Vec3::splat(*line));
            let loads = lumped(line, force, c);
            let sums = &mut self.dead.modules[k];
            for (sum, load) in sums.iter_mut().zip(loads) {
                *sum += load;
            }
            sums[2] += on_node * c.clamp[0];
            sums[4] += on_node;
            force += line * (c.flexible + c.clamp[0] + c.clamp[1]) + on_node;
        }
    }

    /// `evaluate` with point loads: followers turn with their disks.
    #[cold]
    pub fn evaluate_attached(&mut self) -> L::Chain {
        if self.attached.followed > 0 {
            self.turn_disks();
            self.dead.modules.clone_from(&self.attached.constant);
            let mut nodes = std::mem::take(&mut self.attached.nodes);
            nodes.clear();
            if self.attached.has_between() {
                nodes.extend((0..self.module_count()).map(|k| self.node(k)));
            }
            let rotations = std::mem::take(&mut self.rotations);
            self.add_resultants(&[], |attached, k| {
                let on_node = nodes
                    .get(k)
                    .map(|node| sum_of_kind(attached.on_node(k), Some(node)));
                [
                    sum_of_kind(attached.on(k), Some(&rotations[k + 1])),
                    on_node.unwrap_or(Vec3::zero()),
                ]
            });
            (self.rotations, self.attached.nodes) = (rotations, nodes);
        }
        let mut energy = self.evaluate_module_loads();
        for k in 0..self.module_count() {
            energy += self.attached.potential(k, &self.rotations[k + 1]);
            if self.attached.has_between() {
                let node = self.node(k);
                energy += potential_of(self.attached.on_node(k), &node);
                energy -= node.column(2).dot(self.attached.couples[k]);
            }
        }
        energy
    }

    /// Adds the couplings by follower forces beyond module `k` to its blocks.
    #[inline(always)]
    pub fn couple_followers(&mut self, k: usize, blocks: &mut Blocks<L::Chain, A, 1>) {
        if k >= self.attached.followed {
            return;
        }
        let (g, i) = (k / L::WIDTH, k % L::WIDTH);
        let (state, response) = (&self.states[g], &self.newton.responses[g]);
        let (c, s) = (&self.constants[g], get_mat::<L>(&state.s, i));
        if k + 1 == self.attached.followed {
            self.attached.by_turn = Mat3::zero();
        }
        let beyond = self.attached.by_turn + self.attached.by_own_turn(k);
        let by_turn = s * beyond * s.transpose();
        let m = get_mat::<L>(&response.m, i).transpose();
        let d_hat = get_mat::<L>(&response.d_hat, i);
        let stretching = get::<L>(&state.stretching_load(c), i);
        let lever = s.column(2) * self.fixed.modules[k].clamp[1];
        let turned = get_mat::<L>(&response.k, i) * d_hat - lever.skew();
        let offset = get::<L>(&state.offset(c), i);
        let start = stretching.cross_mat(d_hat) - offset.skew();
        let mut coupling = Coupling {
            by_turn,
            by_node: Mat3::zero(),
            arcs: [turned; A],
            start,
        };
        let on_start = start * by_turn;
        for a in 0..A {
            let j = get_mat::<L>(&response.j[a], i);
            coupling.arcs[a] = turned - j.transpose() * m;
            let on_arc = coupling.arcs[a] * by_turn;
            for b in 0..A {
                blocks.uu[a][b] += on_arc;
            }
            blocks.ux[a][0] += on_arc;
            blocks.xu[a][0] += on_start;
        }
        blocks.xx[0][0] += on_start;
        if self.attached.has_between() {
            coupling.by_node = self.couple_follower_on_node(k, blocks);
        }
        self.attached.couplings[k] = coupling;
    }

    /// Adds the change of the force of followers on the middle node of module `k` to its blocks;
    /// returns the change by the rotation of the node, in the frame of the start (N).
    fn couple_follower_on_node(
        &self,
        k: usize,
        blocks: &mut Blocks<L::Chain, A, 1>,
    ) -> Mat3<L::Chain> {
        let (g, i) = (k / L::WIDTH, k % L::WIDTH);
        let (state, response) = (&self.states[g], &self.newton.responses[g]);
        let (c, gradient) = (&self.constants[g], &self.gradients[g]);
        let relative = get_mat::<L>(&state.middle(), i);
        let own: Mat3<L::Chain> = turning_of(self.attached.on_node(k));
        let by_turn = relative * own * relative.transpose();
        let share = L::get(&c.fraction(A / 2), i);
        let m = get_mat::<L>(&response.m, i).transpose();
        let d_hat = get_mat::<L>(&response.d_hat, i);
        let turned = get_mat::<L>(&response.k, i) * d_hat;
        let stretching = get::<L>(&state.stretching_load(c), i);
        let beyond = get::<L>(&state.tail[A / 2 - 1], i).skew();
        let mut place = get::<L>(&state.inside(c, A / 2 - 1), i);
        place.0[2] += self.fixed.modules[k].clamp[0];
        let on_start = (stretching.cross_mat(d_hat) * share - place.skew()) * by_turn;
        for a in 0..A {
            let j = get_mat::<L>(&response.j[a], i).transpose();
            let r = get_mat::<L>(&gradient.r[a], i).transpose();
            // shear and extension of the end, and the motion of the node by the arcs before it
            let mut arc = (turned - j * m + r) * share;
            if a < A / 2 {
                arc += beyond - r;
            }
            let on_arc = arc * by_turn;
            for b in 0..A / 2 {
                blocks.uu[a][b] += on_arc;
            }
            blocks.ux[a][0] += on_arc;
            if a < A / 2 {
                blocks.xu[a][0] += on_start;
            }
        }
        blocks.xx[0][0] += on_start;
        by_turn
    }

    /// Eliminates module `k` from the change of the force beyond it.
    #[inline(always)]
    pub fn eliminate_followers(&mut self, k: usize) {
        if k >= self.attached.followed {
            return;
        }
        let Coupling {
            by_turn, by_node, ..
        } = self.attached.couplings[k];
        let eliminated = &self.newton.eliminated[k];
        let turn = Mat3::identity() - eliminated.turn_by_start();
        self.attached.by_turn = by_turn * turn;
        if self.attached.has_between() {
            let of_node = Mat3::identity() - eliminated.turn_of_arcs_by_start(A / 2);
            self.attached.by_turn += by_node * of_node;
        }
    }
}

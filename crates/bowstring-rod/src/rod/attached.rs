//! Loads on disks beside dead forces on their centres: moments, forces off the centre, followers.
//! [`Rod::load`] sets all loads.
//!
//! Theory: docs/theory/rod.md (Loads) and docs/theory/statics.md (Followers).
//!
//! A dead force at a point of a disk has a potential; it adds a moment and a symmetric stiffness
//! against the disk's rotation. A follower has none. Its force turns with its disk, which changes
//! the resultant of all loads beyond every module before it: the elimination then carries, beside
//! the second variation of the distal part, the change `Q x` of its force by the rotation `x` of
//! the disk.
//!
//! Loads between two disks are in [`crate::rod::between`].

use crate::math::copies;
use crate::math::linalg::{Mat3, Vec3};
use crate::math::real::{Layout, Real};
use crate::model::load::{same_section, Load, PointLoad};
use crate::model::robot::{place, Payload, Place};
use crate::rod::chain::{Attached, Coupling, Rod};
use crate::rod::constants::Constants;
use crate::rod::elimination::Blocks;
use crate::rod::groups::{get, get_mat};
use crate::rod::point_loads::{
    potential_of, sum_of_forces, sum_of_moments, sum_of_stiffness, turning_of,
};

impl<T: Real, const A: usize> Coupling<T, A> {
    fn none() -> Self {
        let zero = Mat3::zero();
        Coupling {
            by_turn: zero,
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

    /// Change of the force beyond the module by the rotation of its end.
    #[inline(always)]
    pub fn by_turn(&self, turn: Vec3<T>) -> Vec3<T> {
        self.by_turn * turn
    }

    /// Force beyond the module's end, where the arcs' own solution is `solution`.
    #[inline(always)]
    pub fn force_beyond(&self, force: Vec3<T>, solution: &[Vec3<T>; A]) -> Vec3<T> {
        let mut turn = Vec3::zero();
        for own in solution {
            turn += *own;
        }
        force - self.by_turn * turn
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
            arcs,
            start: wide(&self.start),
        }
    }
}

impl<C: Real, const A: usize> Attached<C, A> {
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

    /// Whether there are loads between two disks; see `Rod::BETWEEN`.
    #[inline(always)]
    pub fn has_between(&self) -> bool {
        A > 2 && C::PLAIN && !self.between.loads.is_empty()
    }

    /// Whether all of them have a potential.
    pub fn has_potential(&self) -> bool {
        let mut loads = self.loads.iter().chain(&self.between.loads);
        self.moments.is_empty() && loads.all(PointLoad::has_potential)
    }

    /// Takes over those of a load on a robot with these modules.
    pub fn set(&mut self, load: &Load, modules: &[Constants<C, A>]) {
        let n = modules.len();
        self.moments.clear();
        if load.has_moments() {
            for k in 0..n {
                self.moments.push(Vec3::splat(load.moment_on(k, n)));
            }
        }
        let between = !self.between.loads.is_empty();
        if load.point_loads.is_empty() && self.loads.is_empty() && !between {
            return;
        }
        self.loads.clear();
        if load.has_arc_lengths() || between {
            self.set_places(load, modules);
        } else {
            self.loads.extend_from_slice(load.point_loads);
        }
        sort_by_disk(&mut self.loads);
        self.followed = followed(&self.loads).max(followed(&self.between.loads));
        if self.followed > 0 && self.couplings.is_empty() {
            self.couplings = copies(Coupling::none(), n);
        }
        self.constant.clear();
    }

    /// Takes over point loads of which some may act between two disks.
    #[cold]
    fn set_places(&mut self, load: &Load, modules: &[Constants<C, A>]) {
        let mut lengths = Vec::with_capacity(modules.len());
        for c in modules {
            lengths.push([c.clamp[0].lane(0), c.flexible.lane(0), c.clamp[1].lane(0)]);
        }
        let between = split(load.point_loads, &lengths, &mut self.loads);
        self.between.set(between, same_section);
    }

    /// Adds the weights of payloads, after `set`.
    pub fn add_weights(&mut self, payloads: &[Payload], gravity: [f64; 3]) {
        if payloads.is_empty() {
            return;
        }
        push_weights(&mut self.loads, payloads, gravity);
    }

    /// The loads on a disk.
    #[inline(always)]
    pub fn on(&self, k: usize) -> &[PointLoad] {
        of_disk(&self.loads, k)
    }

    /// Sum of the forces on a disk of some rotation, in the base frame (N).
    pub fn force(&self, k: usize, rotation: &Mat3<C>) -> Vec3<C> {
        sum_of_forces(self.on(k), Some(rotation))
    }

    /// Sum of the moments on a disk of some rotation about its centre, in its frame (N m).
    #[inline(always)]
    pub fn moment(&self, k: usize, rotation: &Mat3<C>) -> Vec3<C> {
        let dead = self.moments.get(k).map(|moment| rotation.tr_mul(*moment));
        dead.unwrap_or(Vec3::zero()) + sum_of_moments(self.on(k), rotation)
    }

    /// Potential of the dead forces by the rotation of a disk (J).
    #[inline(always)]
    pub fn potential(&self, k: usize, rotation: &Mat3<C>) -> C {
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

/// Adds the weights of payloads to loads sorted by disk.
fn push_weights(loads: &mut Vec<PointLoad>, payloads: &[Payload], gravity: [f64; 3]) {
    loads.extend(payloads.iter().map(|payload| PointLoad {
        disk: payload.disk,
        point: payload.centre,
        force: gravity.map(|g| g * payload.mass),
        ..PointLoad::default()
    }));
    sort_by_disk(loads);
}

/// Modules before the last follower force.
fn followed(loads: &[PointLoad]) -> usize {
    let pushes = |load: &&PointLoad| load.follower && load.force != [0.0; 3];
    let followers = loads.iter().filter(pushes);
    followers.map(|load| load.disk + 1).max().unwrap_or(0)
}

fn sort_by_disk(loads: &mut [PointLoad]) {
    loads.sort_by_key(|load| load.disk);
}

/// Adds the loads on disks to those of `on_disks`; returns the others from base to tip, with their
/// module and the fraction of its flexible part. `lengths` are clamp, flexible part and clamp of
/// every module (m).
fn split(
    given: &[PointLoad],
    lengths: &[[f64; 3]],
    on_disks: &mut Vec<PointLoad>,
) -> Vec<(usize, f64, PointLoad)> {
    let mut between = vec![];
    for load in given {
        let Some(arc_length) = load.arc_length else {
            on_disks.push(*load);
            continue;
        };
        match place(lengths.iter().copied(), arc_length) {
            Place::Base => continue,
            Place::Disk { disk, beyond } => {
                let [x, y, z] = load.point;
                on_disks.push(PointLoad {
                    disk,
                    arc_length: None,
                    point: [x, y, z + beyond],
                    ..*load
                });
            }
            Place::Between { module, fraction } => between.push((module, fraction, *load)),
        }
    }
    between.sort_by(|a, b| {
        (a.0, a.1)
            .partial_cmp(&(b.0, b.1))
            .expect("they are numbers")
    });
    between
}

/// The loads of a sorted list on a disk.
#[inline(always)]
fn of_disk(loads: &[PointLoad], k: usize) -> &[PointLoad] {
    let first = loads.partition_point(|load| load.disk < k);
    let after = loads.partition_point(|load| load.disk <= k);
    &loads[first..after]
}

impl<L: Layout, const A: usize> Rod<L, A> {
    /// Whether all loads have a potential.
    pub fn has_potential(&self) -> bool {
        self.attached.has_potential()
    }

    /// Sets dead moments and point loads; returns whether this divides modules anew.
    pub fn set_attached(&mut self, load: &Load) -> bool {
        let divided = self.attached.has_between();
        self.attached.set(load, &self.fixed.modules);
        if Self::BETWEEN {
            return (divided || self.attached.has_between()) && self.divide();
        }
        false
    }

    /// Sets a load that has been checked.
    pub fn load(&mut self, load: &Load) {
        let on_disks = |k: usize| Vec3::splat(load.disk_forces[k]);
        // divides modules, so before their weight
        self.set_attached(load);
        self.set_load(
            |i| L::Chain::splat(load.tensions[i]),
            Vec3::splat(load.gravity),
            Vec3::splat(load.tip_force),
            (!load.disk_forces.is_empty()).then_some(on_disks),
        );
        self.attached
            .add_weights(&self.fixed.payloads, load.gravity);
        self.add_forces(load.line_forces);
    }

    /// Adds the dead point forces and the forces per length before each disk to the loads on the
    /// modules, after `set_load`.
    pub fn add_forces(&mut self, lines: &[[f64; 3]]) {
        if !self.attached.has_forces() && lines.is_empty() {
            return;
        }
        let forces = |rod: &Self, k: usize| {
            let mut between = Vec3::zero();
            if Self::BETWEEN && rod.attached.has_between() {
                between = rod.force_between(k, false);
            }
            [sum_of_forces(rod.attached.on(k), None), between]
        };
        self.add_resultants(lines, forces);
        self.dead.on_disks = true;
        if Self::BETWEEN && self.attached.has_between() {
            self.set_couples();
            self.set_forces_between(false);
        }
        if self.attached.followed > 0 {
            self.attached.constant.clone_from(&self.dead.modules);
        }
    }

    /// Adds forces on the disks, between them, and per length before them, in the base frame, to the
    /// loads on the modules.
    #[inline(always)]
    pub fn add_resultants(
        &mut self,
        lines: &[[f64; 3]],
        forces: impl Fn(&Self, usize) -> [Vec3<L::Chain>; 2],
    ) {
        let mut force = Vec3::zero();
        for k in (0..self.module_count()).rev() {
            let [on_disk, between] = forces(self, k);
            force += on_disk;
            let c = &self.fixed.modules[k];
            let line = lines.get(k).map_or(Vec3::zero(), |line| Vec3::splat(*line));
            let loads = c.lumped(line, force);
            let sums = &mut self.dead.modules[k];
            for (sum, load) in sums.iter_mut().zip(loads) {
                *sum += load;
            }
            sums[2] += between * c.clamp[0];
            force += line * (c.flexible + c.clamp[0] + c.clamp[1]) + between;
        }
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
        let stretching = get::<L>(&state.stretching_load(c, self.on_nodes(g)), i);
        let lever = s.column(2) * self.fixed.modules[k].clamp[1];
        let turned = get_mat::<L>(&response.k, i) * d_hat - lever.skew();
        let offset = get::<L>(&state.offset(c), i);
        let start = stretching.cross_mat(d_hat) - offset.skew();
        let mut coupling = Coupling {
            by_turn,
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
        if Self::BETWEEN && self.attached.has_between() {
            self.couple_followers_between(k, blocks);
        }
        self.attached.couplings[k] = coupling;
    }

    /// Eliminates module `k` from the change of the force beyond it.
    #[inline(always)]
    pub fn eliminate_followers(&mut self, k: usize) {
        if k >= self.attached.followed {
            return;
        }
        let by_turn = self.attached.couplings[k].by_turn;
        let turn = Mat3::identity() - self.newton.eliminated[k].turn_by_start();
        self.attached.by_turn = by_turn * turn;
        if Self::BETWEEN && self.attached.has_between() {
            let between = self.force_between_by_start(k);
            self.attached.by_turn += between;
        }
    }
}

//! Loads on disks beside dead forces on their centres: moments, forces off the centre, followers.
//!
//! Theory: docs/theory/rod.md (Loads) and docs/theory/statics.md (Followers).
//!
//! A dead force at a point of a disk has a potential; it adds a moment and a symmetric stiffness
//! against the disk's rotation. A follower has none. Its force turns with its disk, which changes
//! the resultant of all loads beyond every module before it: the elimination then carries, beside
//! the second variation of the distal part, the change `Q x` of its force by the rotation `x` of
//! the disk.

use crate::math::linalg::{Mat3, Vec3};
use crate::math::real::{Layout, Real};
use crate::model::load::{Load, PointLoad};
use crate::model::robot::Payload;
use crate::rod::chain::{get, get_mat, lumped, Rod};
use crate::rod::elimination::Blocks;

/// Moments and point loads on the disks of a robot.
#[derive(Clone)]
pub(crate) struct Attached<C, const A: usize> {
    /// Dead moments on the disks in the base frame (N m), that on the tip included; empty if there
    /// are none.
    moments: Vec<Vec3<C>>,
    /// By disks from base to tip.
    loads: Vec<PointLoad>,
    /// Modules before the last follower force.
    followed: usize,
    /// Loads on the modules without followers; empty if there are none.
    constant: Vec<[Vec3<C>; 4]>,
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
    /// Moment imbalance of each arc and of the start by the force (m).
    arcs: [Mat3<T>; A],
    start: Mat3<T>,
}

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

    /// Force beyond the module's start, where the arcs' own solution is `solution`.
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
    pub fn none() -> Self {
        Attached {
            moments: vec![],
            loads: vec![],
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
        !self.loads.is_empty()
    }

    /// Whether all of them have a potential.
    pub fn has_potential(&self) -> bool {
        self.moments.is_empty() && self.loads.iter().all(PointLoad::has_potential)
    }

    /// Takes over those of a load on a robot of `n` disks.
    pub fn set(&mut self, load: &Load, n: usize) {
        self.moments.clear();
        let moments = load.disk_moments.iter().chain([&load.tip_moment]);
        if moments.into_iter().any(|moment| *moment != [0.0; 3]) {
            let moments = (0..n).map(|k| Vec3::splat(load.moment_on(k, n)));
            self.moments.extend(moments);
        }
        if load.point_loads.is_empty() && self.loads.is_empty() {
            return;
        }
        self.loads.clear();
        self.loads.extend_from_slice(load.point_loads);
        self.loads.sort_by_key(|load| load.disk);
        let pushes = |load: &&PointLoad| load.follower && load.force != [0.0; 3];
        let followers = self.loads.iter().filter(pushes);
        self.followed = followers.map(|load| load.disk + 1).max().unwrap_or(0);
        self.couplings.resize(n, Coupling::none());
        self.constant.clear();
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
        let first = self.loads.partition_point(|load| load.disk < k);
        let after = self.loads.partition_point(|load| load.disk <= k);
        &self.loads[first..after]
    }

    /// Sum of the forces on a disk of some rotation, in the base frame (N).
    pub fn force(&self, k: usize, rotation: &Mat3<C>) -> Vec3<C> {
        let mut sum = Vec3::zero();
        for load in self.on(k) {
            let force = Vec3::splat(load.force);
            sum += match load.follower {
                true => *rotation * force,
                false => force,
            };
        }
        sum
    }

    /// Sum of the moments on a disk of some rotation about its centre, in its frame (N m).
    #[inline(always)]
    pub fn moment(&self, k: usize, rotation: &Mat3<C>) -> Vec3<C> {
        let dead = self.moments.get(k).map(|moment| rotation.tr_mul(*moment));
        let mut sum = dead.unwrap_or(Vec3::zero());
        for load in self.on(k) {
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

    /// Potential of the dead forces by the rotation of a disk (J).
    fn potential(&self, k: usize, rotation: &Mat3<C>) -> C {
        let mut sum = C::zero();
        for load in self.on(k).iter().filter(|load| !load.follower) {
            let point = *rotation * Vec3::splat(load.point);
            sum -= point.dot(Vec3::splat(load.force));
        }
        sum
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
        for load in self.on(k) {
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

    /// Change of the forces of followers on a disk by its rotation, in its frame (N).
    pub fn by_own_turn(&self, k: usize) -> Mat3<C> {
        let mut sum = Vec3::zero();
        for load in self.on(k).iter().filter(|load| load.follower) {
            sum += Vec3::splat(load.force);
        }
        (-sum).skew()
    }

    /// Coupling of a module with follower forces beyond it, if there are any.
    #[inline(always)]
    pub fn coupling(&self, k: usize) -> Option<&Coupling<C, A>> {
        (k < self.followed).then(|| &self.couplings[k])
    }
}

impl<L: Layout, const A: usize> Rod<L, A> {
    /// Adds the dead point forces and the forces per length before each disk to the loads on the
    /// modules, after `set_load`.
    pub fn add_forces(&mut self, lines: &[[f64; 3]]) {
        if !self.attached.has_forces() && lines.is_empty() {
            return;
        }
        self.add_resultants(lines, |attached, k| {
            let mut sum = Vec3::zero();
            for load in attached.on(k).iter().filter(|load| !load.follower) {
                sum += Vec3::splat(load.force);
            }
            sum
        });
        self.has_forces_on_disks();
        if self.attached.followed > 0 {
            self.attached.constant.clone_from(&self.dead.modules);
        }
    }

    /// Adds forces on the disks and per length before them, in the base frame, to the loads on the
    /// modules.
    fn add_resultants(
        &mut self,
        lines: &[[f64; 3]],
        on_disk: impl Fn(&Attached<L::Chain, A>, usize) -> Vec3<L::Chain>,
    ) {
        let mut force = Vec3::zero();
        for k in (0..self.module_count()).rev() {
            force += on_disk(&self.attached, k);
            let (h, [start, end]) = (self.fixed.modules[k].flexible, self.fixed.modules[k].clamp);
            let line = lines.get(k).map_or(Vec3::zero(), |line| Vec3::splat(*line));
            let loads = lumped::<_, A>(line, force, h, [start, end]);
            for (sum, load) in self.dead.modules[k].iter_mut().zip(loads) {
                *sum += load;
            }
            force += line * (h + start + end);
        }
    }

    /// `evaluate` with point loads: followers turn with their disks.
    #[cold]
    pub fn evaluate_attached(&mut self) -> L::Chain {
        if self.attached.followed > 0 {
            self.turn_disks();
            self.dead.modules.clone_from(&self.attached.constant);
            let rotations = std::mem::take(&mut self.rotations);
            self.add_resultants(&[], |attached, k| {
                let mut sum = Vec3::zero();
                for load in attached.on(k).iter().filter(|load| load.follower) {
                    sum += rotations[k + 1] * Vec3::splat(load.force);
                }
                sum
            });
            self.rotations = rotations;
        }
        let mut energy = self.evaluate_module_loads();
        for k in 0..self.module_count() {
            energy += self.attached.potential(k, &self.rotations[k + 1]);
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
        let stretching = get::<L>(&state.stretching_load(), i);
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
    }
}

//! Pseudo-arclength continuation of equilibria in a load factor.
//!
//! Theory: docs/theory/statics.md (Continuation).
//!
//! A point is the strain of all arcs and the load factor. Newton's method solves the equations of
//! equilibrium beside that of a plane, by one elimination of the tangent and two right-hand sides.

use crate::criteria::TOLERANCE;
use crate::interrupt;
use crate::math::lie::Pose;
use crate::math::linalg::{Mat3, Vec3};
use crate::model::load::OwnedLoad;
use crate::model::robot::Robot;
use crate::rod::estimate::Verdict;
use crate::statics::solver::Solver;

/// Least length of a step along a branch.
pub(super) const LEAST_STEP: f64 = 1e-6;
/// Least cosine of the angle between tangents at the ends of a step: beyond it, the step may have
/// gone to another branch.
pub(super) const STRAIGHT: f64 = 0.93;
/// Largest distance of the ends of a step over its length.
pub(super) const STRETCH: f64 = 1.1;

/// Most Newton steps of a correction.
const MAX_CORRECTIONS: usize = 10;
/// Largest change of an arc's rotation vector in a step of a correction (rad).
const MAX_CHANGE: f64 = 0.5;
/// Diagonal shift of corrections over the unit of the shift: it keeps them finite where the tangent
/// is singular.
const REGULARISING_SHIFT: f64 = 1e-9;
/// The same on a branch of a family, where the tangent is singular along the whole branch, as for a
/// round rod that buckles in any plane.
const FAMILY_SHIFT: f64 = 1e-6;
/// Residual below which a correction ends at once; a neutral direction needs it to be recognised.
const FINE_RESIDUAL: f64 = 1e-13;
/// Change of rotations and load by a correction (rad, and of the scaled load) below which the
/// derivative by the load is kept.
const SHORT_CORRECTION: f64 = 1e-3;
/// Least distance of the point before over the step for a prediction from it.
const LEAST_MEMORY: f64 = 0.2;
/// Ratio of successive residuals above which rounding prevents a smaller one.
const STAGNATION: f64 = 0.1;
/// Increment of the scaled load for its derivative.
const LOAD_INCREMENT: f64 = 1e-5;
/// Component of the load in a unit tangent below which its sign is noise.
const LEVEL: f64 = 1e-9;

/// Loads whose linear interpolation by the load factor is followed: factor 0 and factor 1.
#[derive(Clone, Debug, PartialEq)]
pub struct LoadPath {
    /// Load at factor 0.
    pub from: OwnedLoad,
    /// Load at factor 1.
    pub to: OwnedLoad,
}

impl LoadPath {
    /// Load at a factor.
    pub fn at(&self, factor: f64, out: &mut OwnedLoad) {
        out.tensions.resize(self.from.tensions.len(), 0.0);
        out.between(&self.from, &self.to, factor);
        out.between_dead(&self.from, &self.to.borrow(), factor);
    }

    /// Load at factor 0, with the point loads that begin there: they divide modules as later on.
    pub(super) fn begin(&self) -> OwnedLoad {
        let mut all = OwnedLoad::default();
        self.at(0.0, &mut all);
        for load in &mut all.point_loads {
            // without a load there is nothing to follow
            load.follower &= load.force != [0.0; 3] || load.moment != [0.0; 3];
        }
        OwnedLoad {
            point_loads: all.point_loads,
            ..self.from.clone()
        }
    }

    /// Load factor that belongs to a moment of (bending stiffness / length) at the base.
    pub(super) fn scale(&self, robot: &Robot) -> f64 {
        let spec = robot.spec();
        let apart = |a: [f64; 3], b: [f64; 3]| (Vec3(b) - Vec3(a)).norm();
        // with the same point loads
        let (mut from, mut to) = (OwnedLoad::default(), OwnedLoad::default());
        self.at(0.0, &mut from);
        self.at(1.0, &mut to);
        let mut moment = apart(from.tip_force, to.tip_force) * robot.length()
            + apart(from.gravity, to.gravity) * robot.mass() * robot.length()
            + apart(from.tip_moment, to.tip_moment);
        for (tendon, (a, b)) in spec
            .tendons
            .iter()
            .zip(from.tensions.iter().zip(&to.tensions))
        {
            let arms = tendon.holes.iter().map(|h| h[0].hypot(h[1]));
            moment += (b - a).abs() * arms.fold(0.0, f64::max);
        }
        let on = |rows: &[[f64; 3]], k: usize| rows.get(k).copied().unwrap_or_default();
        for (k, disk) in spec.disks.iter().enumerate() {
            let force = apart(on(&from.disk_forces, k), on(&to.disk_forces, k));
            moment += force * disk.station;
            moment += apart(on(&from.disk_moments, k), on(&to.disk_moments, k));
            let line = apart(on(&from.line_forces, k), on(&to.line_forces, k));
            let start = if k == 0 {
                0.0
            } else {
                spec.disks[k - 1].station
            };
            moment += line * (disk.station - start) * disk.station;
        }
        for (a, b) in from.point_loads.iter().zip(&to.point_loads) {
            let place = b.arc_length.unwrap_or_else(|| spec.disks[b.disk].station);
            let arm = place + Vec3(b.point).norm();
            moment += apart(a.force, b.force) * arm + apart(a.moment, b.moment);
        }
        robot.moment_scale() / moment
    }
}

/// A point or a direction: strain of all arcs, and load factor over its scale.
#[derive(Clone, Debug)]
pub(super) struct Vector {
    pub strain: Vec<Vec3>,
    pub load: f64,
}

impl Vector {
    pub fn zero(arcs: usize) -> Self {
        Vector {
            strain: vec![Vec3::zero(); arcs],
            load: 0.0,
        }
    }

    /// Inner product: of rotations, the sum over arcs times their number, so that it does not
    /// depend on the number of arcs.
    pub fn dot(&self, o: &Self) -> f64 {
        let strain = self.strain.iter().zip(&o.strain);
        let strain: f64 = strain.map(|(a, b)| a.dot(*b)).sum();
        strain * self.strain.len() as f64 + self.load * o.load
    }

    pub fn norm(&self) -> f64 {
        self.dot(self).sqrt()
    }

    /// `self = a + factor * b`
    pub fn set_sum(&mut self, a: &Self, factor: f64, b: &Self) {
        for (to, (a, b)) in self.strain.iter_mut().zip(a.strain.iter().zip(&b.strain)) {
            *to = b.scaled_add(factor, *a);
        }
        self.load = a.load + factor * b.load;
    }

    /// `self += factor * o`
    pub fn add(&mut self, factor: f64, o: &Self) {
        for (to, from) in self.strain.iter_mut().zip(&o.strain) {
            *to = from.scaled_add(factor, *to);
        }
        self.load += factor * o.load;
    }

    pub fn scale(&mut self, factor: f64) {
        self.strain.iter_mut().for_each(|v| *v = *v * factor);
        self.load *= factor;
    }

    pub fn distance(&self, o: &Self) -> f64 {
        let strain = self.strain.iter().zip(&o.strain);
        let strain: f64 = strain.map(|(a, b)| (*a - *b).norm2()).sum();
        let load = self.load - o.load;
        (strain * self.strain.len() as f64 + load * load).sqrt()
    }
}

/// Plane on which a correction ends (theory Eq. 3.6): `normal . (point - origin) = offset`.
pub(super) struct Plane<'a> {
    pub origin: &'a Vector,
    pub normal: &'a Vector,
    pub offset: f64,
}

/// Where a second point of a branch is, seen along the tangent of the first.
#[derive(Clone, Copy, Debug)]
pub(super) enum Side {
    Behind,
    Ahead,
}

/// What changes at a limit point or a bifurcation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Signature {
    /// Number of negative eigenvalues, as in [`State::unstable`]; zero on a branch of a family.
    pub unstable: usize,
    /// Whether the load rises along the tangent.
    pub rising: bool,
}

/// An equilibrium with all that is known about it.
#[derive(Clone, Debug)]
pub(super) struct State {
    pub at: Vector,
    /// Unit tangent of the branch.
    pub tangent: Vector,
    pub signature: Signature,
    /// Number of negative eigenvalues of the second variation; under a moment only its parity.
    pub unstable: usize,
    /// Number of eigenvalues that are zero within rounding.
    pub neutral: usize,
    pub stable: Option<bool>,
    pub residual: f64,
    /// Elements that the error estimate or the compression of a module asks for.
    pub needed: usize,
    pub collision: Option<usize>,
    /// Poses of all disks from base to tip.
    pub disks: Vec<Pose>,
}

impl State {
    pub fn empty(curve: &Curve) -> Self {
        let arcs = curve.arcs();
        let pose = Pose {
            rotation: Mat3::identity(),
            position: Vec3::zero(),
        };
        State {
            at: Vector::zero(arcs),
            tangent: Vector::zero(arcs),
            signature: Signature {
                unstable: 0,
                rising: true,
            },
            unstable: 0,
            neutral: 0,
            stable: None,
            residual: f64::INFINITY,
            needed: 0,
            collision: None,
            disks: vec![pose; curve.solver.robot.module_count()],
        }
    }
}

/// Equations of the equilibria along a load path, with scratch memory.
pub(super) struct Curve {
    solver: Solver,
    path: LoadPath,
    /// Load at the present factor.
    load: OwnedLoad,
    /// Load factor of a unit of the scaled load.
    pub scale: f64,
    /// Whether the tangent is symmetric: no moments.
    pub symmetric: bool,
    /// Whether the branch is one of a family of equal ones, on which the zero eigenvalue hides those
    /// that change their sign.
    pub family: bool,
    /// Present point.
    pub at: Vector,
    /// Largest moment imbalance of the last `residual`, over (bending stiffness / length).
    imbalance: f64,
    /// Derivative of the imbalance with respect to the scaled load.
    by_load: Vec<Vec3>,
    /// Newton step at constant load, and motion by the scaled load.
    to_root: Vec<Vec3>,
    motion: Vec<Vec3>,
    /// Right-hand side of the discretisation error.
    error: Vec<Vec3>,
}

impl Curve {
    /// Curve through the last equilibrium of the solver, which is that at factor 0.
    pub fn new(solver: Solver, path: &LoadPath, scale: f64) -> Self {
        let mut at = Vector::zero(2 * solver.elements * solver.robot.module_count());
        solver.engine.strains(&mut |i, w| at.strain[i] = w);
        let arcs = at.strain.len();
        Curve {
            solver,
            path: path.clone(),
            load: OwnedLoad::default(),
            scale,
            symmetric: path.from.borrow().has_potential() && path.to.borrow().has_potential(),
            family: false,
            at,
            imbalance: f64::INFINITY,
            by_load: vec![Vec3::zero(); arcs],
            to_root: vec![Vec3::zero(); arcs],
            motion: vec![Vec3::zero(); arcs],
            error: vec![Vec3::zero(); arcs],
        }
    }

    pub fn arcs(&self) -> usize {
        self.at.strain.len()
    }

    /// Load factor of a scaled load.
    pub fn factor(&self, load: f64) -> f64 {
        load * self.scale
    }

    /// Replaces the load path by one from the load at a scaled load of the present one, along a
    /// transverse force at the tip, in units of bending stiffness over length squared.
    pub fn push(&mut self, load: f64, direction: [f64; 3]) -> (LoadPath, f64) {
        let mut from = OwnedLoad::default();
        self.path.at(load * self.scale, &mut from);
        let mut to = from.clone();
        let settings = &self.solver.settings;
        let unit = settings.moment_scale / settings.length;
        for q in 0..3 {
            to.tip_force[q] += unit * direction[q];
        }
        let before = std::mem::replace(&mut self.path, LoadPath { from, to });
        (before, std::mem::replace(&mut self.scale, 1.0))
    }

    /// Takes back the load path that `push` replaced.
    pub fn restore(&mut self, (path, scale): (LoadPath, f64)) {
        (self.path, self.scale) = (path, scale);
    }

    fn evaluate(&mut self, load: f64) -> f64 {
        self.path.at(load * self.scale, &mut self.load);
        self.solver.take_load(&self.load.borrow());
        let engine = &mut self.solver.engine;
        engine.evaluate();
        engine.gradient() / self.solver.settings.moment_scale
    }

    /// Imbalance at the present point.
    pub fn residual_alone(&mut self) -> f64 {
        let at = &self.at;
        self.solver.engine.set_strains(&|i| at.strain[i]);
        self.imbalance = self.evaluate(self.at.load);
        self.imbalance
    }

    /// The same, and its derivative with respect to the load.
    pub fn residual(&mut self) -> f64 {
        let at = &self.at;
        self.solver.engine.set_strains(&|i| at.strain[i]);
        let load = self.at.load;
        self.evaluate(load + LOAD_INCREMENT);
        let by_load = &mut self.by_load;
        self.solver
            .engine
            .gradients(&mut |i, g| by_load[i] = g * (1.0 / LOAD_INCREMENT));
        self.imbalance = self.evaluate(load);
        let by_load = &mut self.by_load;
        self.solver
            .engine
            .gradients(&mut |i, g| by_load[i] -= g * (1.0 / LOAD_INCREMENT));
        self.imbalance
    }

    /// Eliminates the tangent at the present point, after `residual`; the shift is in its unit.
    fn eliminate(&mut self, shift: f64) {
        self.eliminate_shifted(shift * self.solver.settings.shift_unit);
    }

    fn eliminate_shifted(&mut self, shift: f64) {
        self.solver.engine.eliminate(self.symmetric, shift);
    }

    /// Motion by the scaled load, for the last elimination.
    fn solve_for_load(&mut self) {
        let engine = &mut self.solver.engine;
        let (by_load, motion) = (&self.by_load, &mut self.motion);
        engine.set_gradient(&|i| by_load[i]);
        engine.newton_step(self.symmetric);
        engine.steps(&mut |i, s| motion[i] = s);
    }

    /// Sets the present point to the unloaded shape, at a load.
    pub fn make_unloaded(&mut self, load: f64) {
        let (engine, at) = (&mut self.solver.engine, &mut self.at);
        engine.make_unloaded();
        engine.strains(&mut |i, w| at.strain[i] = w);
        at.load = load;
    }

    /// Newton step at constant load and motion by the load (theory Eq. 3.7), after `residual`.
    pub fn solve_both(&mut self) {
        self.solver.engine.linearise();
        self.eliminate(match self.family {
            true => FAMILY_SHIFT,
            false => REGULARISING_SHIFT,
        });
        self.solve_to_root();
        self.solve_for_load();
    }

    /// Newton step at constant load, for the last elimination.
    fn solve_to_root(&mut self) {
        let engine = &mut self.solver.engine;
        engine.newton_step(self.symmetric);
        let to_root = &mut self.to_root;
        engine.steps(&mut |i, s| to_root[i] = s);
    }

    /// Newton step at constant load, after `residual`.
    pub fn newton_step(&mut self, step: &mut Vector) {
        self.solver.engine.linearise();
        self.eliminate(REGULARISING_SHIFT);
        self.solver.engine.newton_step(self.symmetric);
        self.solver.engine.steps(&mut |i, s| step.strain[i] = s);
        step.load = 0.0;
    }

    /// Sets the present point to that predicted on the plane across the tangent of `base`, at a
    /// step from it: on the cubic through another point of the branch, behind `base` or ahead, with
    /// both tangents; without one, on the tangent.
    pub fn predict(&mut self, base: &State, step: f64, other: Option<(&State, Side)>) {
        self.at.set_sum(&base.at, step, &base.tangent);
        let Some((other, side)) = other else { return };
        if self.family {
            // both points are anywhere along the family
            return;
        }
        let bent = base.tangent.distance(&other.tangent);
        // length of the arc over the chord
        let apart = base.at.distance(&other.at) * (1.0 + bent * bent / 24.0);
        if !(apart > LEAST_MEMORY * step) {
            return;
        }
        let behind = match side {
            Side::Behind => apart,
            Side::Ahead => -apart,
        };
        // divided differences: the second one with both arguments here, and the third one
        let ahead = &base.tangent;
        let (mut second, mut third) = (Vector::zero(self.arcs()), Vector::zero(self.arcs()));
        second.set_sum(&other.at, -1.0, &base.at);
        second.scale(1.0 / behind);
        third.set_sum(ahead, 1.0, &other.tangent);
        third.add(2.0, &second);
        third.scale(1.0 / (behind * behind));
        second.add(1.0, ahead);
        second.scale(1.0 / behind);
        // the length whose point is on the plane
        let (a, b) = (second.dot(ahead), third.dot(ahead));
        let mut length = step;
        for _ in 0..2 {
            length = step - length * length * (a + (length + behind) * b);
        }
        if (length - step).abs() > 0.1 * step {
            return;
        }
        self.at.add(length - step, ahead);
        self.at.add(length * length, &second);
        self.at.add(length * length * (length + behind), &third);
    }

    /// Newton's method from the present point to the equilibrium on a plane; returns its steps.
    pub fn correct(&mut self, plane: &Plane) -> Option<usize> {
        self.correct_to(FINE_RESIDUAL, plane)
    }

    /// The same to a residual.
    ///
    /// A step keeps the tangent of the one before where its residual shows that this suffices. The
    /// derivative by the load is kept after a short step, but new at the end: the tangent of the
    /// branch needs it where a mode is soft.
    pub fn correct_to(&mut self, fine: f64, plane: &Plane) -> Option<usize> {
        let (mut before, mut last) = (f64::INFINITY, f64::INFINITY);
        let mut ends = false;
        for step in 0..=MAX_CORRECTIONS {
            if interrupt::work(4 * self.solver.settings.work) {
                return None;
            }
            let short = last < SHORT_CORRECTION;
            let residual = match short && !ends {
                true => self.residual_alone(),
                false => self.residual(),
            };
            let stagnates = residual > STAGNATION * before;
            if residual <= fine || residual <= TOLERANCE && stagnates {
                if short && !ends {
                    self.residual();
                }
                return Some(step);
            }
            if !residual.is_finite() || step == MAX_CORRECTIONS {
                return None;
            }
            // by quadratic convergence, the residual after a step with the same tangent
            let kept = 2.0 * residual * residual / before;
            let keep = short && kept <= 0.1 * fine && !self.family;
            match keep {
                true => self.solve_to_root(),
                false => self.solve_both(),
            }
            ends = keep || residual * residual <= 0.1 * fine;
            before = residual;
            let arcs = self.arcs() as f64;
            let normal = plane.normal;
            let along = |v: &[Vec3]| {
                let pairs = normal.strain.iter().zip(v);
                pairs.map(|(n, v)| n.dot(*v)).sum::<f64>() * arcs
            };
            let place = self.at.dot(normal) - plane.origin.dot(normal);
            let missing = plane.offset - place - along(&self.to_root);
            let load = missing / (along(&self.motion) + normal.load);
            let mut largest = 0.0;
            for (i, w) in self.at.strain.iter_mut().enumerate() {
                let change = self.motion[i].scaled_add(load, self.to_root[i]);
                largest = f64::max(largest, change.max_abs());
                *w += change;
            }
            self.at.load += load;
            last = f64::max(largest, load.abs());
            // a NaN is not small
            if !(largest <= MAX_CHANGE) || !load.is_finite() {
                return None;
            }
        }
        None
    }

    /// Motion by the scaled load along a direction at the present point.
    pub fn motion_along(&mut self, direction: &Vector) -> f64 {
        self.residual();
        self.solver.engine.linearise();
        self.eliminate(REGULARISING_SHIFT);
        self.solve_for_load();
        let pairs = direction.strain.iter().zip(&self.motion);
        pairs.map(|(d, m)| d.dot(*m)).sum::<f64>() * self.arcs() as f64
    }

    /// Unit direction of the branch at a point that is orthogonal to so many null vectors there.
    pub fn motion_across(&mut self, at: &Vector, count: usize) -> Vector {
        let null = self.null_vectors(at, count, &[]);
        // for the elimination and the derivative by the load at that point
        self.solve_for_load();
        let mut out = Vector::zero(self.arcs());
        out.strain.copy_from_slice(&self.motion);
        out.load = 1.0;
        for other in &null {
            let part = out.dot(other);
            out.add(-part, other);
        }
        out.scale(1.0 / out.norm());
        out
    }

    /// Sets the unit tangent at a corrected point, oriented `along` another direction, and returns
    /// the number of negative eigenvalues and that of zero ones.
    fn linearised(&mut self, along: &Vector, tangent: &mut Vector) -> (usize, usize) {
        self.solver.engine.linearise();
        let counts = if self.symmetric {
            let zero = self.solver.settings.zero_eigenvalue;
            self.eliminate_shifted(-zero);
            let not_positive = self.solver.engine.negative_pivots();
            let mut negative = 0;
            if not_positive > 0 {
                self.eliminate_shifted(zero);
                negative = self.solver.engine.negative_pivots();
            }
            (negative, not_positive.saturating_sub(negative))
        } else {
            self.eliminate(0.0);
            (self.solver.engine.negative_pivots() % 2, 0)
        };
        self.solve_for_load();
        self.set_tangent(along, tangent);
        counts
    }

    /// Determines place, tangent and collision at the present point, after `residual` or a
    /// correction; `along` orients its tangent.
    pub fn pass(&mut self, along: &Vector, out: &mut State) {
        self.solver.engine.linearise();
        self.eliminate(REGULARISING_SHIFT);
        self.solve_for_load();
        self.set_tangent(along, &mut out.tangent);
        out.at.clone_from(&self.at);
        self.solver.engine.finish();
        out.collision = self.solver.engine.collision();
    }

    /// Whether disks collide at the present point.
    pub fn collides(&mut self) -> bool {
        self.solver.engine.finish();
        self.solver.engine.collision().is_some()
    }

    /// Unit tangent from the motion by the load.
    fn set_tangent(&self, along: &Vector, tangent: &mut Vector) {
        tangent.strain.copy_from_slice(&self.motion);
        tangent.load = 1.0;
        let norm = tangent.norm();
        let side = if tangent.dot(along) < 0.0 { -1.0 } else { 1.0 };
        tangent.scale(side / norm);
    }

    fn signature(&self, unstable: usize, tangent: &Vector, before: bool) -> Signature {
        Signature {
            unstable: if self.family { 0 } else { unstable },
            rising: if tangent.load.abs() < LEVEL {
                before
            } else {
                tangent.load > 0.0
            },
        }
    }

    /// Signature at the present corrected point, beside `from`; `tangent` is scratch memory.
    pub fn probe(&mut self, from: &State, tangent: &mut Vector) -> Signature {
        let (negative, _) = self.linearised(&from.tangent, tangent);
        self.signature(negative, tangent, from.signature.rising)
    }

    /// Determines all about the present point, after `residual` or `correct`; `along` orients its tangent.
    pub fn settle(&mut self, along: &Vector, rising: bool, out: &mut State) {
        out.residual = self.imbalance;
        let (mut negative, mut neutral) = self.linearised(along, &mut out.tangent);
        if self.family {
            // the eigenvalue of the family has either sign by rounding
            (negative, neutral) = ((negative + neutral).saturating_sub(1), 1);
        }
        out.signature = self.signature(negative, &out.tangent, rising);
        (out.unstable, out.neutral) = (negative, neutral);
        out.at.strain.copy_from_slice(&self.at.strain);
        out.at.load = self.at.load;
        let stable = match (self.symmetric, negative, neutral) {
            (true, 0, 0) => Some(true),
            (true, 0, _) => None,
            (true, _, _) => Some(false),
            (false, _, _) => self.solver.stability(&self.load.borrow()),
        };
        let engine = &mut self.solver.engine;
        // the estimate adds the imbalance, in whose place the derivative by the load is
        engine.gradient();
        let mut found = engine.estimate();
        if self.family {
            // the estimate is lost in motion along the family
            found.motion = 0.0;
        }
        // near a limit point the error at constant load is large, that across the branch is not
        let (rhs, by_load) = (&mut self.error, &self.by_load);
        engine.gradients(&mut |i, g| rhs[i] = g);
        engine.newton_step(self.symmetric);
        let (mut along, arcs) = (0.0, by_load.len() as f64);
        let tangent = &out.tangent;
        engine.steps(&mut |i, s| along += s.dot(tangent.strain[i]) * arcs);
        let by = -along * tangent.load;
        if !self.family {
            engine.set_gradient(&|i| by_load[i].scaled_add(by, rhs[i]));
            found.motion = engine.correct_step();
        }
        let length = self.solver.settings.length;
        let verdict = Verdict::new(&found, [0.0; 2], stable, length, self.solver.elements);
        out.stable = verdict.stable;
        out.needed = verdict.needed;
        engine.finish();
        out.collision = engine.collision();
        for (k, pose) in out.disks.iter_mut().enumerate() {
            *pose = engine.disk(k);
        }
    }

    /// Vectors near the null space of the tangent at a point, orthonormal, and orthogonal to some
    /// others: inverse iteration.
    pub fn null_vectors(&mut self, at: &Vector, count: usize, others: &[&Vector]) -> Vec<Vector> {
        self.at.clone_from(at);
        self.residual();
        self.solver.engine.linearise();
        self.eliminate(1e3 * REGULARISING_SHIFT);
        let mut found: Vec<Vector> = vec![];
        for number in 0..count {
            let mut x = Vector::zero(self.arcs());
            for (i, v) in x.strain.iter_mut().enumerate() {
                let phase = (i * (number + 1)) as f64 + 0.7 * number as f64;
                *v = Vec3([phase.cos(), 0.6 - (0.5 * phase).sin(), 0.1 * phase.sin()]);
            }
            for _ in 0..4 {
                for other in others.iter().copied().chain(&found) {
                    let part = x.dot(other);
                    x.add(-part, other);
                }
                x.load = 0.0;
                x.scale(1.0 / x.norm());
                let engine = &mut self.solver.engine;
                engine.set_gradient(&|i| x.strain[i]);
                engine.newton_step(self.symmetric);
                engine.steps(&mut |i, s| x.strain[i] = s);
            }
            for other in others.iter().copied().chain(&found) {
                let part = x.dot(other);
                x.add(-part, other);
            }
            x.scale(1.0 / x.norm());
            found.push(x);
        }
        found
    }
}

//! Static equilibrium: Newton's method on the strain, globalised, with an honest status.

use crate::dispatch::{self, Passes, Plain};
use crate::interrupt;
pub use crate::math::lie::Pose;
use crate::math::linalg::Vec3;
use crate::model::load::{Load, Model, OwnedLoad};
use crate::model::robot::{InputError, Robot};
use crate::motion::oscillation::{self, Equilibrium};
use crate::rod::chain::Step;
use crate::rod::estimate::{ErrorEstimate, Verdict};
use crate::rod::module::Constants;
use crate::rod::sensitivity::Jacobians;

/// How a solve ended. Only [`Status::Converged`] comes with a pose.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Status {
    /// The residual is below the tolerance, at a minimum of the energy where there is one.
    Converged,
    /// The residual stayed above the tolerance.
    MaxIterations,
    /// An equilibrium was found, but no stable one.
    Unstable,
    /// An equilibrium was found only with two disks passed through each other: the load closes
    /// the gap between them.
    NoEquilibrium,
}

impl Status {
    /// The word that the outputs use.
    pub fn word(self) -> &'static str {
        match self {
            Status::Converged => "converged",
            Status::MaxIterations => "max_iterations",
            Status::Unstable => "unstable",
            Status::NoEquilibrium => "no_equilibrium",
        }
    }
}

// Newton's method.

/// Largest moment imbalance over (bending stiffness / length) that counts as converged.
pub const TOLERANCE: f64 = 1e-10;
/// Newton steps before giving up.
const MAX_ITERATIONS: usize = 200;
/// Newton steps on the residual for one load.
const MAX_RESIDUAL_STEPS: usize = 40;
/// Largest rotation that an arc may add in one step (rad).
pub(crate) const MAX_STEP: f64 = 1.0;
/// Times that a step is halved: what does not help at a millionth is lost in rounding.
const MAX_HALVINGS: usize = 20;
/// Share of the slope's promise that the energy must fall by (Armijo's condition).
pub(crate) const SUFFICIENT_DECREASE: f64 = 1e-4;
/// Rounding of the energy over the terms that it is a small difference of.
pub(crate) const ENERGY_NOISE: f64 = 1e-14;
/// Fall of the residual that a shortened step must bring, over its fraction, and the least
/// fraction.
const RESIDUAL_DECREASE: f64 = 1e-3;
/// Factor by which a full step may let the residual grow.
const RESIDUAL_GROWTH: f64 = 2.0;
/// Times that the shift is quadrupled in search of a minimum.
const MAX_SHIFTS: usize = 40;
/// Attempts at leaving unstable equilibria.
const MAX_ESCAPES: usize = 4;
/// Least pivot of a minimum over the unit of the shift; a smaller one is lost in rounding.
const LEAST_PIVOT: f64 = 1e-12;

// Stability under a tip moment.

/// Negative pivot over the unit of the shift that may still be one of a minimum, by rounding.
const LOST_PIVOT: f64 = 1e-8;
/// Damping ratio that keeps small oscillations under a tip moment from growing where it counts as
/// stable. Without any, a moment along a round backbone lets them grow however small it is
/// (Nikolai's paradox).
pub(crate) const FLUTTER_DAMPING: f64 = 0.01;
/// The same where no damping helps: what grows hardly oscillates.
const HOPELESS: f64 = 0.5;
/// Least moment over (bending stiffness / length) that may lead from a stable equilibrium to one
/// that is not.
const LEADS: f64 = 0.1;

// Load stepping and extrapolation.

/// First increment of all the load, as a share of it.
const FIRST_INCREMENT: f64 = 0.25;
/// Factor of the increment after one that converged.
const LONGER: f64 = 1.5;
/// Factor of the increment after one that did not.
const SHORTER: f64 = 0.3;
/// Increment below which the load is given up.
const LEAST_INCREMENT: f64 = 1e-3;
/// Newton steps in all after which smaller increments are not tried.
const MAX_CONTINUATION: usize = 3 * MAX_ITERATIONS;
/// Largest change of an arc's rotation vector by extrapolation (rad).
const MAX_EXTRAPOLATION: f64 = 0.3;

/// What a solve found, its numbers aside.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Outcome {
    /// How the solve ended.
    pub status: Status,
    /// Whether the equilibrium is a minimum of the energy. Under a tip moment, which has no
    /// potential: whether small motions at a damping ratio of 0.01 die out, false with
    /// [`Status::Converged`] where it is the moment that leads from a stable equilibrium to one where
    /// they do not, as it does beyond half a turn; `None` where that takes more damping, or the
    /// masses of a robot that has none, and where the answer is lost in rounding.
    pub stable: Option<bool>,
    /// Newton steps.
    pub iterations: usize,
    /// Largest moment imbalance over (bending stiffness / length).
    pub residual: f64,
    /// The way from straight led to an unstable equilibrium, which was left for a stable one.
    pub left_unstable: bool,
    /// Largest fraction of the load that did converge.
    pub fraction: f64,
    /// Module in which two disks collide.
    pub collision: Option<usize>,
    /// Of a converged answer, where it was asked for.
    pub error: Option<ErrorEstimate>,
}

impl Outcome {
    /// Of a load that is not solved yet.
    pub(crate) fn pending() -> Self {
        Outcome {
            status: Status::MaxIterations,
            stable: None,
            iterations: 0,
            residual: f64::INFINITY,
            left_unstable: false,
            fraction: 1.0,
            collision: None,
            error: None,
        }
    }
}

/// A robot, its physics, and scratch memory for one solve after another.
///
/// ```
/// use bowstring_core::{model::load::{Load, Model}, model::robot::*, statics::solver::{Solver, Status}};
/// let section = Section { bending: 1.07, torsion: 0.83, axial: 6.9e5, shear: 2.6e5, mass_per_length: 0.035, rotary_inertia: 5.5e-8 };
/// let disks = (1..=9).map(|k| Disk { station: 0.641 * k as f64 / 9.0, clamped_length: 0.0, mass: 0.02, inertia: [5.1e-6, 1.02e-5], segment: 0 });
/// let robot = Robot::new(RobotSpec {
///     sections: vec![section],
///     disks: disks.collect(),
///     tendons: vec![Tendon { hole: [0.029, 0.0], end_disk: 8 }],
///     gravity: [0.0; 3],
/// })?;
/// let mut solver = Solver::new(&robot, Model::default(), 1)?;
/// let load = Load { tensions: &[40.0], gravity: [0.0; 3], tip_force: [0.0; 3], tip_moment: [0.0; 3] };
/// let outcome = solver.solve(&load)?;
/// assert_eq!(outcome.status, Status::Converged);
/// assert!((solver.tip().unwrap().position[0] - 0.2164).abs() < 1e-3);
/// # Ok::<(), InputError>(())
/// ```
#[derive(Clone)]
pub struct Solver {
    robot: Robot,
    model: Model,
    elements: usize,
    pub(crate) engine: Box<dyn Passes>,
    settings: Settings,
    /// The last load, kept for what is asked after the solve.
    load: OwnedLoad,
    /// Strain of the points before, latest first, for extrapolation along a sweep.
    history: [Vec<Vec3>; 3],
    known: usize,
    /// Whether the last solve converged: only then are there numbers to give.
    settled: bool,
}

#[derive(Clone, Copy, Debug)]
pub(crate) struct Settings {
    /// Measure of moments: bending stiffness over length (N m).
    pub moment_scale: f64,
    /// Diagonal shift worth a tenth of an arc's bending stiffness (N m).
    pub shift_unit: f64,
    /// Length of the robot (m).
    pub length: f64,
    /// Work of a Newton iteration, in units of `interrupt::work`.
    pub work: usize,
}

impl Settings {
    pub fn new(robot: &Robot, model: Model, elements: usize) -> Self {
        let stiffness = (0..robot.module_count())
            .map(|k| Constants::new(robot, k, model, elements).stiffness[0])
            .fold(0.0, f64::max);
        Settings {
            moment_scale: robot.moment_scale(),
            shift_unit: 0.1 * stiffness,
            length: robot.length(),
            work: robot.module_count() * elements * (8 + 2 * robot.tendon_count()),
        }
    }

    /// Tip moment that the tolerance of the residual does not tell from none, N m.
    pub fn least_moment(&self) -> f64 {
        TOLERANCE * self.moment_scale
    }
}

/// How one attempt at a load ended.
enum Attempt {
    Converged {
        stable: Option<bool>,
        collision: Option<usize>,
    },
    Saddle,
    Stuck,
}

impl Attempt {
    fn is_sound(&self) -> bool {
        matches!(
            self,
            Attempt::Converged {
                collision: None,
                ..
            }
        )
    }
}

impl Solver {
    /// A solver with 1, 2, 4 or 8 elements of fourth order in a module; 1 is the default of
    /// all outputs.
    pub fn new(robot: &Robot, model: Model, elements: usize) -> Result<Self, InputError> {
        dispatch::check_solvers(robot, elements, 1)?;
        let engine = dispatch::quickest(robot, model, elements)?;
        let straight = vec![Vec3::zero(); 2 * elements * robot.module_count()];
        Ok(Solver {
            engine,
            settings: Settings::new(robot, model, elements),
            robot: robot.clone(),
            model,
            elements,
            load: OwnedLoad::default(),
            history: [straight.clone(), straight.clone(), straight],
            known: 0,
            settled: false,
        })
    }

    /// Strain of every arc and contact force of every module, as they stand.
    pub(crate) fn strain_and_force(&self, strain: &mut [Vec3], force: &mut [Vec3]) {
        self.engine.strains(&mut |i, w| strain[i] = w);
        self.engine.contact_forces(&mut |k, n| force[k] = n);
    }

    pub(crate) fn at_rest(&self) -> Equilibrium<'_> {
        let n = self.robot.module_count();
        let (mut strain, mut force) = (
            vec![Vec3::zero(); 2 * self.elements * n],
            vec![Vec3::zero(); n],
        );
        self.strain_and_force(&mut strain, &mut force);
        Equilibrium {
            robot: &self.robot,
            model: self.model,
            elements: self.elements,
            strain,
            force,
        }
    }

    pub(crate) fn model(&self) -> Model {
        self.model
    }

    /// Elements in every module.
    pub fn elements(&self) -> usize {
        self.elements
    }

    pub(crate) fn settings(&self) -> &Settings {
        &self.settings
    }

    /// Forgets the last answer.
    pub(crate) fn unsettle(&mut self) {
        self.settled = false;
        self.known = 0;
    }

    /// Takes the equilibrium that the engine was brought to as the last solve's; returns the
    /// module in which two disks collide.
    pub(crate) fn settle(&mut self, load: &Load) -> Option<usize> {
        self.engine.finish();
        self.load.set(load);
        self.known = 0;
        let collision = self.engine.collision();
        self.settled = collision.is_none();
        collision
    }

    /// The robot that is solved.
    pub fn robot(&self) -> &Robot {
        &self.robot
    }

    /// Equilibrium from the straight backbone.
    pub fn solve(&mut self, load: &Load) -> Result<Outcome, InputError> {
        load.check(&self.robot)?;
        let load = &load.without_moment_below(self.settings.least_moment());
        let outcome = self.solve_from_straight(load);
        self.known = 0;
        self.remember(&outcome);
        Ok(outcome)
    }

    /// Equilibrium from the ones before: for loads that follow each other closely.
    ///
    /// Extrapolates the strain of up to three points before; falls back to a start from
    /// straight.
    pub fn solve_next(&mut self, load: &Load) -> Result<Outcome, InputError> {
        load.check(&self.robot)?;
        if self.known == 0 {
            return self.solve(load);
        }
        let load = &load.without_moment_below(self.settings.least_moment());
        self.load.set(load);
        let [a, b, c] = &self.history;
        let ahead = |i: usize| match self.known {
            1 => a[i],
            2 => a[i] * 2.0 - b[i],
            _ => (a[i] - b[i]) * 3.0 + c[i],
        };
        // loads that jump are not to be extrapolated
        let close = (0..a.len()).all(|i| (ahead(i) - a[i]).max_abs() < MAX_EXTRAPOLATION);
        self.engine.load(load);
        self.engine
            .set_strains(&|i| if close { ahead(i) } else { a[i] });
        let mut outcome = self.equilibrium(load, false);
        if outcome.status != Status::Converged {
            let tried = outcome.iterations;
            outcome = self.solve_from_straight(load);
            outcome.iterations += tried;
            self.known = 0;
        }
        self.remember(&outcome);
        Ok(outcome)
    }

    /// Equilibrium from a strain, or from the straight backbone, by Newton's method alone: no other
    /// start is tried, and the load is not raised step by step.
    pub(crate) fn solve_from(&mut self, strain: Option<&[Vec3]>, load: &Load) -> Outcome {
        let load = &load.without_moment_below(self.settings.least_moment());
        self.load.set(load);
        self.engine.load(load);
        // forgets the contact forces of other loads as well
        self.engine.make_straight();
        if let Some(strain) = strain {
            self.engine.set_strains(&|i| strain[i]);
        }
        let outcome = self.equilibrium(load, false);
        self.known = 0;
        self.remember(&outcome);
        outcome
    }

    /// Estimates the error of the last answer, which `outcome` is of. Where its elements cannot
    /// tell a stable equilibrium from an unstable one, that it is stable is taken back. Returns
    /// the elements in a module that the tolerances need; `None` without an answer.
    pub fn estimate_error(&mut self, outcome: &mut Outcome) -> Option<usize> {
        let verdict = self.verdict(outcome)?;
        outcome.error = Some(verdict.error);
        outcome.stable = verdict.stable;
        Some(verdict.needed)
    }

    pub(crate) fn verdict(&mut self, outcome: &Outcome) -> Option<Verdict> {
        if !self.settled {
            return None;
        }
        let found = self.engine.estimate();
        let (length, elements) = (self.settings.length, self.elements);
        Some(Verdict::new(
            &found,
            [0.0; 2],
            outcome.stable,
            length,
            elements,
        ))
    }

    /// Strain of the last equilibrium, if the last solve converged.
    pub(crate) fn last_strain(&self) -> Option<Vec<Vec3>> {
        (self.known > 0).then(|| self.history[0].clone())
    }

    fn solve_from_straight(&mut self, load: &Load) -> Outcome {
        self.load.set(load);
        self.engine.load(load);
        self.engine.make_straight();
        self.equilibrium(load, true)
    }

    fn remember(&mut self, outcome: &Outcome) {
        if outcome.status != Status::Converged {
            self.known = 0;
            return;
        }
        self.history.rotate_right(1);
        let latest = &mut self.history[0];
        self.engine.strains(&mut |i, w| latest[i] = w);
        self.known = (self.known + 1).min(3);
    }

    /// From the strain that the engine holds; with `patience` also by continuation.
    fn equilibrium(&mut self, load: &Load, patience: bool) -> Outcome {
        let mut outcome = Outcome::pending();
        let attempt = newton(&mut *self.engine, &self.settings, &mut outcome);
        let mut attempt = self.judged(attempt, load, false);
        if patience && !attempt.is_sound() {
            attempt = self.continued(attempt, load, &mut outcome);
        }
        match attempt {
            Attempt::Converged {
                stable,
                collision: None,
            } => {
                outcome.stable = stable;
                outcome.status = Status::Converged;
            }
            Attempt::Converged { collision, .. } => {
                outcome.collision = collision;
                outcome.status = Status::NoEquilibrium;
            }
            Attempt::Saddle => {
                outcome.stable = Some(false);
                outcome.status = Status::Unstable;
            }
            Attempt::Stuck => outcome.status = Status::MaxIterations,
        }
        self.settled = outcome.status == Status::Converged;
        outcome
    }

    /// What continuation makes of an attempt that is not sound: of the tip moment alone, then of
    /// all the load.
    fn continued(&mut self, attempt: Attempt, load: &Load, outcome: &mut Outcome) -> Attempt {
        // what continuation cannot mend keeps its first verdict
        let first = *outcome;
        let mut continued = Attempt::Stuck;
        if load.tip_moment != [0.0; 3] {
            let rest = Load {
                tip_moment: [0.0; 3],
                ..*load
            };
            let rest = self.equilibrium(&rest, true);
            outcome.iterations += rest.iterations;
            if rest.status == Status::Converged {
                continued = self.continuation(load, false, outcome);
                let unstable = Some(false);
                if !matches!(continued, Attempt::Converged { stable, .. } if stable == unstable) {
                    outcome.left_unstable |= matches!(attempt, Attempt::Saddle);
                    outcome.left_unstable |= rest.left_unstable;
                }
            }
        }
        if !continued.is_sound() {
            outcome.left_unstable = first.left_unstable;
            continued = self.continuation(load, true, outcome);
        }
        if continued.is_sound() {
            return continued;
        }
        if !matches!(attempt, Attempt::Stuck) {
            outcome.residual = first.residual;
        }
        attempt
    }

    /// An equilibrium under a tip moment with its stability, which Newton's method does not tell.
    /// An unstable one counts where the moment alone `leads` there from a stable one.
    fn judged(&mut self, attempt: Attempt, load: &Load, leads: bool) -> Attempt {
        let Attempt::Converged {
            stable: None,
            collision,
        } = attempt
        else {
            return attempt;
        };
        match self.stability(load) {
            Some(false) if !leads => Attempt::Saddle,
            stable => Attempt::Converged { stable, collision },
        }
    }

    /// Whether small damped motions under a tip moment die out. The moment adds half of itself as
    /// a skew stiffness against the tip's rotation to a symmetric tangent. Where that is positive
    /// definite, nothing leaves without an oscillation; and with the tip's flexibility `C` in the
    /// plane across the moment, squared frequencies lie within `|moment| sqrt(det C) / 2` of the
    /// real axis, as an angle. That settles small moments. Larger ones take the frequencies.
    fn stability(&mut self, load: &Load) -> Option<bool> {
        self.engine.linearise();
        let pivot = self.engine.eliminate(true, 0.0);
        let unit = self.settings.shift_unit;
        // a pivot that is lost in rounding tells nothing; a NaN is no minimum
        let mut stable = match pivot {
            p if p > LEAST_PIVOT * unit => Some(true),
            p if p > -LOST_PIVOT * unit => None,
            _ => Some(false),
        };
        // a NaN is not small
        if stable == Some(true) && !(self.flutter_angle(load) <= 2.0 * FLUTTER_DAMPING) {
            stable = self.stability_of_motion(load, true);
        }
        if stable == Some(false) {
            stable = self.stability_of_motion(load, false);
        }
        // whoever asks next finds the tangent of Newton's last step
        self.engine.gradient();
        self.engine.eliminate(false, 0.0);
        stable
    }

    /// Bound of the angle between squared frequencies under a tip moment and the real axis (rad),
    /// by the last elimination.
    fn flutter_angle(&mut self, load: &Load) -> f64 {
        let per_module = 2 * self.elements;
        let rod = &mut *self.engine;
        let moment = Vec3(load.tip_moment);
        let size = moment.norm();
        let along = moment * (1.0 / size);
        let least = (0..3).min_by(|a, b| along[*a].abs().total_cmp(&along[*b].abs()));
        let mut axis = Vec3::zero();
        axis[least.unwrap_or(0)] = 1.0;
        let first = along.cross(axis);
        let first = first * (1.0 / first.norm());
        let second = along.cross(first);
        // twice the energy that a unit moment on the tip puts in
        let mut answer = |unit: Vec3| {
            let local: Vec<_> = (0..rod.module_count())
                .map(|k| match k {
                    0 => unit,
                    _ => rod.disk(k - 1).rotation.tr_mul(unit),
                })
                .collect();
            rod.set_gradient(&|i| local[i / per_module]);
            -rod.newton_step(true).slope
        };
        let (a, b, both) = (answer(first), answer(second), answer(first + second));
        let between = 0.5 * (both - a - b);
        let determinant = f64::max(a * b - between * between, 0.0);
        0.5 * size * determinant.sqrt()
    }

    /// The same by the frequencies; `oscillates` as in [`oscillation::growth`].
    fn stability_of_motion(&self, load: &Load, oscillates: bool) -> Option<bool> {
        let growth = dispatch::check_moving(&self.robot, self.elements)
            .ok()
            .and_then(|()| oscillation::growth(&self.at_rest(), load, oscillates));
        match growth {
            Some(growth) if growth <= FLUTTER_DAMPING => Some(true),
            Some(growth) if growth >= HOPELESS => Some(false),
            None if !oscillates => Some(false),
            _ => None,
        }
    }

    /// Raises the load from zero by steps that adapt, all of it or, from the equilibrium of the
    /// rest that the engine holds, its tip moment alone; tells how far it came.
    fn continuation(&mut self, load: &Load, all: bool, outcome: &mut Outcome) -> Attempt {
        let mut part = OwnedLoad::default();
        let mut start = vec![Vec3::zero(); self.history[0].len()];
        let (mut reached, mut increment) = (0.0, if all { FIRST_INCREMENT } else { 1.0 });
        if !all {
            self.engine.strains(&mut |i, w| start[i] = w);
        }
        loop {
            let fraction = f64::min(reached + increment, 1.0);
            let share = if all { fraction } else { 1.0 };
            part.set(load);
            part.tensions.iter_mut().for_each(|t| *t *= share);
            part.gravity = load.gravity.map(|g| g * share);
            part.tip_force = load.tip_force.map(|f| f * share);
            part.tip_moment = load.tip_moment.map(|m| m * fraction);
            let mut attempt = self.attempt_from(&start, &part.borrow(), outcome);
            if fraction == 1.0 {
                let leads =
                    !all && Vec3(load.tip_moment).norm() > LEADS * self.settings.moment_scale;
                attempt = self.judged(attempt, load, leads);
            }
            let sound = attempt.is_sound();
            if sound && fraction == 1.0 {
                outcome.fraction = 1.0;
                return attempt;
            }
            if sound {
                self.engine.strains(&mut |i, w| start[i] = w);
                reached = fraction;
                increment *= LONGER;
            } else {
                increment *= SHORTER;
            }
            outcome.fraction = reached;
            if fraction == 1.0 && matches!(attempt, Attempt::Saddle) && load.tip_moment != [0.0; 3]
            {
                // found, and told to be unstable: smaller increments come to the same
                return attempt;
            }
            // a load that is past hope must not take long to say so
            if increment < LEAST_INCREMENT
                || outcome.iterations > MAX_CONTINUATION
                || interrupt::interrupted()
            {
                return Attempt::Stuck;
            }
        }
    }

    /// Newton's method from a strain, as a part of the way that `outcome` tells of.
    fn attempt_from(&mut self, start: &[Vec3], load: &Load, outcome: &mut Outcome) -> Attempt {
        self.engine.load(load);
        self.engine.make_straight();
        self.engine.set_strains(&|i| start[i]);
        let mut part = Outcome {
            iterations: 0,
            ..*outcome
        };
        let attempt = newton(&mut *self.engine, &self.settings, &mut part);
        outcome.iterations += part.iterations;
        outcome.residual = part.residual;
        outcome.left_unstable |= part.left_unstable;
        attempt
    }

    /// Pose of the tip, which is the last disk; `None`, as all that follow, unless the last
    /// solve converged.
    pub fn tip(&self) -> Option<Pose> {
        self.disk(self.robot.module_count() - 1)
    }

    /// Pose of a disk, counted from the base.
    pub fn disk(&self, k: usize) -> Option<Pose> {
        self.settled.then(|| self.engine.disk(k))
    }

    /// Length of a tendon from the base hole to the hole of its end disk, m.
    pub fn tendon_length(&self, i: usize) -> Option<f64> {
        self.settled.then(|| self.engine.length(i))
    }

    /// Points of the backbone, `per_module` in each module, base and tip included, m.
    pub fn centerline(&self, per_module: usize) -> Option<Vec<Vec3>> {
        self.settled.then(|| self.plain().centerline(per_module))
    }

    /// Derivatives of the last equilibrium; `None` for continuous tendons, and where the
    /// equilibrium is so near to losing stability that they are not finite.
    pub fn jacobians(&self) -> Option<Jacobians> {
        if !self.settled {
            return None;
        }
        let segments: Vec<_> = self.robot.spec().disks.iter().map(|d| d.segment).collect();
        self.plain().jacobians(&segments)
    }

    /// The present state in plain numbers, evaluated.
    fn plain(&self) -> Box<dyn Plain> {
        let mut plain = dispatch::plain(&self.robot, self.model, self.elements)
            .expect("elements were checked when the solver was made");
        plain.take(&self.load.borrow(), &*self.engine, self.history[0].len());
        plain
    }
}

fn converged(rod: &mut dyn Passes, stable: Option<bool>) -> Attempt {
    rod.finish();
    Attempt::Converged {
        stable,
        collision: rod.collision(),
    }
}

fn newton(rod: &mut dyn Passes, settings: &Settings, outcome: &mut Outcome) -> Attempt {
    if rod.has_tip_moment() {
        newton_on_residual(rod, settings, outcome)
    } else {
        newton_on_energy(rod, settings, outcome)
    }
}

/// Minimises the energy: a diagonal shift until all pivots are positive, and backtracking.
fn newton_on_energy(rod: &mut dyn Passes, settings: &Settings, outcome: &mut Outcome) -> Attempt {
    let unit = settings.shift_unit;
    let mut energy = rod.evaluate();
    if !energy.is_finite() {
        return Attempt::Stuck;
    }
    let mut shift = 0.0;
    let mut escapes = 0;
    // the energy is a small difference of large terms
    let noise = ENERGY_NOISE * (rod.energy_scale(settings.length) + energy.abs());
    let stiffening = rod.energy_scale(settings.length) / rod.module_count() as f64;
    // the last elimination still tells the inertia if the step after it was short
    let mut minimum_nearby = false;
    loop {
        if interrupt::work(settings.work) {
            return Attempt::Stuck;
        }
        outcome.residual = rod.gradient() / settings.moment_scale;
        if outcome.residual <= TOLERANCE {
            if minimum_nearby {
                return converged(rod, Some(true));
            }
            rod.linearise();
            let pivot = rod.eliminate(true, 0.0);
            if pivot.is_nan() {
                return Attempt::Stuck;
            }
            // a pivot that is lost in rounding is no proof of a minimum
            if pivot > LEAST_PIVOT * unit {
                return converged(rod, Some(true));
            }
            if escapes == MAX_ESCAPES {
                return Attempt::Saddle;
            }
            escapes += 1;
            outcome.left_unstable = true;
            energy = leave_saddle(rod, settings, escapes, energy);
            continue;
        }
        if outcome.iterations == MAX_ITERATIONS || !outcome.residual.is_finite() {
            return Attempt::Stuck;
        }
        outcome.iterations += 1;
        rod.linearise();
        let Some(pivot) = eliminate_shifted(rod, settings, &mut shift) else {
            return Attempt::Stuck;
        };
        let step = rod.newton_step(true);
        if !step.largest.is_finite() {
            return Attempt::Stuck;
        }
        minimum_nearby = shift == 0.0 && is_minimum_nearby(step.largest, pivot, unit, stiffening);
        let Some(fraction) = backtrack(rod, settings, &step, noise, &mut energy) else {
            return Attempt::Stuck;
        };
        shift = if fraction == 1.0 && shift <= unit {
            0.0
        } else {
            shift * 0.25
        };
    }
}

/// Eliminates with the shift, raised until all pivots are positive; returns the least.
fn eliminate_shifted(rod: &mut dyn Passes, settings: &Settings, shift: &mut f64) -> Option<f64> {
    let mut pivot = rod.eliminate(true, *shift);
    for _ in 0..MAX_SHIFTS {
        if pivot > 0.0 || interrupt::work(settings.work) {
            break;
        }
        *shift = if *shift == 0.0 {
            settings.shift_unit
        } else {
            *shift * 4.0
        };
        pivot = rod.eliminate(true, *shift);
    }
    (pivot > 0.0).then_some(pivot)
}

/// Takes a fraction of the step that lowers the energy enough, and returns it.
fn backtrack(
    rod: &mut dyn Passes,
    settings: &Settings,
    step: &Step<f64>,
    noise: f64,
    energy: &mut f64,
) -> Option<f64> {
    rod.save();
    let mut fraction = (MAX_STEP / step.largest).min(1.0);
    for halvings in 0.. {
        rod.advance(fraction);
        let trial = rod.evaluate();
        if trial <= *energy + SUFFICIENT_DECREASE * fraction * step.slope + noise {
            *energy = trial;
            return Some(fraction);
        }
        fraction *= 0.5;
        if halvings == MAX_HALVINGS || interrupt::work(settings.work) {
            break;
        }
    }
    None
}

/// Newton's method where there is no energy: a step is accepted if the residual falls.
fn newton_on_residual(rod: &mut dyn Passes, settings: &Settings, outcome: &mut Outcome) -> Attempt {
    rod.evaluate();
    let mut residual = rod.gradient() / settings.moment_scale;
    for step in 0..=MAX_RESIDUAL_STEPS {
        outcome.residual = residual;
        if interrupt::work(settings.work) {
            break;
        }
        if residual <= TOLERANCE {
            return converged(rod, None);
        }
        if !residual.is_finite() || step == MAX_RESIDUAL_STEPS {
            break;
        }
        outcome.iterations += 1;
        rod.linearise();
        rod.eliminate(false, 0.0);
        let largest = rod.newton_step(false).largest;
        if !largest.is_finite() {
            break;
        }
        match shorten(rod, settings, largest, residual) {
            Some(trial) => residual = trial,
            None => break,
        }
    }
    Attempt::Stuck
}

/// Takes a fraction of the step that lowers the residual, and returns what is left of it.
fn shorten(rod: &mut dyn Passes, settings: &Settings, largest: f64, residual: f64) -> Option<f64> {
    rod.save();
    let mut fraction = (MAX_STEP / largest).min(1.0);
    loop {
        rod.advance(fraction);
        rod.evaluate();
        let trial = rod.gradient() / settings.moment_scale;
        // a full step may turn the whole chain: let the residual grow a little
        let most = if fraction == 1.0 {
            RESIDUAL_GROWTH
        } else {
            1.0 - RESIDUAL_DECREASE * fraction
        };
        if trial <= residual * most {
            return Some(trial);
        }
        fraction *= 0.5;
        if !(fraction > RESIDUAL_DECREASE) || interrupt::work(settings.work) {
            return None;
        }
    }
}

/// Whether an elimination before a step still tells that the place after it is a minimum: the
/// step must be short, and what it changes of the second derivatives small beside the pivots.
#[inline(always)]
pub(crate) fn is_minimum_nearby(largest: f64, pivot: f64, unit: f64, stiffening: f64) -> bool {
    largest < 1e-4 && pivot > 0.01 * unit && largest * stiffening < 0.1 * pivot
}

/// Moves off an unstable equilibrium, to the side where the energy is lower; returns it.
///
/// Inverse iteration on the shifted Hessian from a fixed, unsymmetric start looks for the
/// lowest mode, so that the same load always takes the same branch.
#[cold]
fn leave_saddle(rod: &mut dyn Passes, settings: &Settings, attempt: usize, energy: f64) -> f64 {
    let mut shift = 1e-6 * settings.shift_unit;
    for _ in 0..MAX_SHIFTS {
        if rod.eliminate(true, shift) > 0.0 || interrupt::work(settings.work) {
            break;
        }
        shift *= 2.0;
    }
    rod.set_gradient(&|i| {
        let phase = i as f64;
        Vec3([0.3 + 0.01 * phase.cos(), -1.0, 0.02 * phase.sin()])
    });
    let mut largest = 1.0;
    for round in 0..9 {
        if interrupt::work(settings.work) {
            break;
        }
        if round > 0 {
            rod.step_to_gradient(1.0 / largest);
        }
        largest = rod.newton_step(true).largest;
    }
    rod.save();
    let modules = rod.module_count() as f64;
    let mut amount = 0.2 * attempt as f64 / (largest * modules.sqrt());
    let mut least = energy;
    for _ in 0..2 {
        rod.advance(amount);
        least = rod.evaluate();
        if least < energy {
            break;
        }
        amount = -amount;
    }
    least
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::robot::{Disk, RobotSpec, Section, Tendon};

    fn robot() -> Robot {
        let section = |bending: f64| Section {
            bending,
            torsion: 0.8 * bending,
            axial: 7e5,
            shear: 2.6e5,
            mass_per_length: 0.035,
            rotary_inertia: 5.5e-8,
        };
        let disks = (0..11).map(|k| Disk {
            station: 0.06 * (k + 1) as f64,
            clamped_length: 0.002,
            mass: 0.02,
            inertia: [5.1e-6, 1.0e-5],
            segment: usize::from(k > 5),
        });
        let tendons = (0..5).map(|i| Tendon {
            hole: [0.02 * (i as f64).cos(), 0.02 * (i as f64).sin()],
            end_disk: if i < 2 { 5 } else { 10 },
        });
        Robot::new(RobotSpec {
            sections: vec![section(1.1), section(0.7)],
            disks: disks.collect(),
            tendons: tendons.collect(),
            gravity: [0.0, 0.0, -9.81],
        })
        .unwrap()
    }

    /// Every engine that this processor can run gives the same answer.
    #[test]
    fn engines_agree() {
        let robot = robot();
        let model = Model::default();
        let mut engines: Vec<Box<dyn Passes>> = vec![dispatch::plain(&robot, model, 1).unwrap()];
        #[cfg(target_arch = "x86_64")]
        {
            use crate::math::simd::{Avx2, Avx512, Simd};
            engines.extend(Avx2::detect().map(|s| dispatch::side_by_side(s, &robot, model)));
            engines.extend(Avx512::detect().map(|s| dispatch::side_by_side(s, &robot, model)));
        }
        for (tip_force, tip_moment) in [([0.3, -0.2, 0.1], [0.0; 3]), ([0.0; 3], [0.05, 0.1, 0.1])]
        {
            let load = Load {
                tensions: &[5.0, 20.0, 10.0, 0.0, 15.0],
                gravity: [0.0, 0.0, -9.81],
                tip_force,
                tip_moment,
            };
            let mut solver = Solver::new(&robot, model, 1).unwrap();
            let mut first = None;
            for engine in &engines {
                solver.engine = engine.clone();
                let outcome = solver.solve(&load).unwrap();
                assert_eq!(outcome.status, Status::Converged);
                let answer = (
                    solver.tip().unwrap().position,
                    solver.tendon_length(1).unwrap(),
                    outcome.iterations,
                );
                let (tip, length, iterations) = *first.get_or_insert(answer);
                assert!((answer.0 - tip).norm() < 1e-11);
                assert!((answer.1 - length).abs() < 1e-11);
                assert_eq!(answer.2, iterations);
            }
        }
    }

    /// Nothing is given that a solve did not converge to.
    #[test]
    fn no_numbers_without_convergence() {
        let robot = robot();
        let mut solver = Solver::new(&robot, Model::default(), 1).unwrap();
        let nothing = |solver: &Solver| {
            solver.tip().is_none()
                && solver.disk(0).is_none()
                && solver.tendon_length(0).is_none()
                && solver.centerline(4).is_none()
                && solver.jacobians().is_none()
        };
        assert!(nothing(&solver));
        let load = |tensions: &'static [f64; 5]| Load {
            tensions,
            gravity: [0.0; 3],
            tip_force: [0.0; 3],
            tip_moment: [0.0; 3],
        };
        solver.solve(&load(&[1.0, 2.0, 3.0, 0.0, 1.0])).unwrap();
        assert!(solver.tip().is_some() && solver.jacobians().is_some());
        let far = solver.solve(&load(&[0.0, 0.0, 1e5, 0.0, 0.0])).unwrap();
        assert_ne!(far.status, Status::Converged);
        assert!(far.stable != Some(true) && far.fraction < 1.0);
        assert!(nothing(&solver));
        let near = solver
            .solve_next(&load(&[1.0, 2.0, 3.0, 0.0, 1.0]))
            .unwrap();
        assert_eq!(near.status, Status::Converged);
    }
}

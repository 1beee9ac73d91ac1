//! Static equilibrium: Newton's method on the strain, globalised, with an honest status.

use crate::linalg::{Mat3, Vec3};
use crate::load::{Load, Model};
use crate::robot::{InputError, Robot};
use crate::rod::Rod;

/// How a solve ended. Only [`Status::Converged`] comes with a pose.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Status {
    /// The residual is below the tolerance, at a minimum of the energy where there is one.
    Converged,
    /// The residual stayed above the tolerance.
    MaxIterations,
    /// An equilibrium was found, but no stable one.
    Unstable,
    /// The load closes the gap between two disks: the model has no equilibrium there.
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

/// Largest moment imbalance over (bending stiffness / length) that counts as converged.
pub const TOLERANCE: f64 = 1e-10;
/// Newton steps before giving up.
pub const MAX_ITERATIONS: usize = 200;

/// What a solve found, its numbers aside.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Outcome {
    pub status: Status,
    /// Whether the equilibrium is a minimum of the energy; `None` under a tip moment, which
    /// has no potential.
    pub stable: Option<bool>,
    pub iterations: usize,
    /// Largest moment imbalance over (bending stiffness / length).
    pub residual: f64,
    /// The way from straight led to an unstable equilibrium, which was left for a stable one.
    pub left_unstable: bool,
    /// Largest fraction of the load that did converge.
    pub fraction: f64,
    /// Module in which two disks collide.
    pub collision: Option<usize>,
}

/// Position and orientation in the base frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// Maps body to base.
    pub rotation: Mat3,
    /// m
    pub position: Vec3,
}

/// A robot, its physics, and scratch memory for one solve after another.
///
/// `A` is the number of arcs in a module: 2 for one element of fourth order, 4 for two, ...
///
/// ```
/// use bowstring_core::{load::{Load, Model}, robot::*, statics::{Solver, Status}};
/// let section = Section { bending: 1.07, torsion: 0.83, axial: 6.9e5, shear: 2.6e5, mass_per_length: 0.035 };
/// let disks = (1..=9).map(|k| Disk { station: 0.641 * k as f64 / 9.0, clamped_length: 0.0, mass: 0.02, segment: 0 });
/// let robot = Robot::new(RobotSpec {
///     sections: vec![section],
///     disks: disks.collect(),
///     tendons: vec![Tendon { hole: [0.029, 0.0], end_disk: 8 }],
///     gravity: [0.0; 3],
/// })?;
/// let mut solver = Solver::<2>::new(&robot, Model::default());
/// let load = Load { tensions: &[40.0], gravity: [0.0; 3], tip_force: [0.0; 3], tip_moment: [0.0; 3] };
/// let outcome = solver.solve(&load)?;
/// assert_eq!(outcome.status, Status::Converged);
/// assert!((solver.tip().position[0] - 0.2164).abs() < 1e-3);
/// # Ok::<(), InputError>(())
/// ```
#[derive(Clone)]
pub struct Solver<const A: usize> {
    pub(crate) robot: Robot,
    pub(crate) rod: Rod<f64, A>,
    moment_scale: f64,
    /// Diagonal shift worth a tenth of an arc's bending stiffness.
    shift_unit: f64,
    /// Strain of the two points before, for extrapolation along a sweep.
    before: Vec<[Vec3; A]>,
    points_before: usize,
}

/// How one attempt at the full load ended.
enum Attempt {
    Converged { stable: Option<bool> },
    Saddle,
    Stuck,
}

impl<const A: usize> Solver<A> {
    pub fn new(robot: &Robot, model: Model) -> Self {
        let rod = Rod::new(robot, model);
        let stiffest = rod
            .constants
            .iter()
            .map(|c| c.stiffness[0])
            .fold(0.0, f64::max);
        Solver {
            before: vec![[Vec3::zero(); A]; robot.module_count()],
            points_before: 0,
            robot: robot.clone(),
            rod,
            moment_scale: robot.moment_scale(),
            shift_unit: 0.1 * stiffest,
        }
    }

    /// The robot that is solved.
    pub fn robot(&self) -> &Robot {
        &self.robot
    }

    /// Equilibrium from the straight backbone.
    pub fn solve(&mut self, load: &Load) -> Result<Outcome, InputError> {
        load.check(&self.robot)?;
        self.rod.load(load);
        self.rod.make_straight();
        self.points_before = 0;
        Ok(self.equilibrium(load))
    }

    /// Equilibrium from the last one: for loads that follow each other closely.
    ///
    /// Of two points before, the strain is extrapolated. Falls back to a start from straight.
    pub fn solve_next(&mut self, load: &Load) -> Result<Outcome, InputError> {
        load.check(&self.robot)?;
        self.rod.load(load);
        if self.points_before == 0 {
            self.rod.make_straight();
        }
        for (state, before) in self.rod.states.iter_mut().zip(&mut self.before) {
            let present = state.w;
            if self.points_before > 1 {
                for i in 0..A {
                    state.w[i] = present[i] * 2.0 - before[i];
                }
            }
            *before = present;
        }
        let mut outcome = self.equilibrium(load);
        if outcome.status != Status::Converged && self.points_before > 0 {
            self.rod.load(load);
            self.rod.make_straight();
            outcome = self.equilibrium(load);
        }
        self.points_before = if outcome.status == Status::Converged {
            self.points_before + 1
        } else {
            0
        };
        Ok(outcome)
    }

    fn equilibrium(&mut self, load: &Load) -> Outcome {
        let mut outcome = Outcome {
            status: Status::MaxIterations,
            stable: None,
            iterations: 0,
            residual: f64::INFINITY,
            left_unstable: false,
            fraction: 1.0,
            collision: None,
        };
        let mut attempt = self.newton(&mut outcome);
        if matches!(attempt, Attempt::Stuck) {
            attempt = self.continuation(load, &mut outcome);
        }
        match attempt {
            Attempt::Converged { stable } => {
                outcome.stable = stable;
                outcome.collision = self.rod.disks_collide();
                outcome.status = if outcome.collision.is_some() {
                    Status::NoEquilibrium
                } else {
                    Status::Converged
                };
            }
            Attempt::Saddle => {
                outcome.stable = Some(false);
                outcome.status = Status::Unstable;
            }
            Attempt::Stuck => outcome.status = Status::MaxIterations,
        }
        outcome
    }

    fn newton(&mut self, outcome: &mut Outcome) -> Attempt {
        if self.rod.has_tip_moment() {
            self.newton_on_residual(outcome)
        } else {
            self.newton_on_energy(outcome)
        }
    }

    /// Minimises the energy: a diagonal shift until all pivots are positive, and backtracking.
    fn newton_on_energy(&mut self, outcome: &mut Outcome) -> Attempt {
        let rod = &mut self.rod;
        let mut energy = rod.evaluate();
        let mut shift = 0.0;
        let mut escapes = 0;
        // rounding of the energy, which is a small difference of large terms
        let noise = 1e-14 * (rod.tensions.iter().sum::<f64>() * self.robot.length() + energy.abs());
        // the last elimination still tells the inertia if the step after it was short
        let mut minimum_nearby = false;
        if !energy.is_finite() {
            return Attempt::Stuck;
        }
        loop {
            outcome.residual = rod.gradient() / self.moment_scale;
            if outcome.residual <= TOLERANCE {
                if minimum_nearby || rod.eliminate::<true>(0.0) > 0.0 {
                    return Attempt::Converged { stable: Some(true) };
                }
                if escapes == MAX_ESCAPES {
                    return Attempt::Saddle;
                }
                escapes += 1;
                outcome.left_unstable = true;
                energy = leave_saddle(rod, self.shift_unit, escapes);
            }
            if outcome.iterations == MAX_ITERATIONS || !outcome.residual.is_finite() {
                return Attempt::Stuck;
            }
            outcome.iterations += 1;
            if outcome.residual <= TOLERANCE {
                continue; // left a saddle: the gradient is that of the new place
            }
            let mut pivot = rod.eliminate::<true>(shift);
            while !(pivot > 0.0) {
                shift = if shift == 0.0 {
                    self.shift_unit
                } else {
                    shift * 4.0
                };
                if shift > 1e9 * self.shift_unit {
                    return Attempt::Stuck;
                }
                pivot = rod.eliminate::<true>(shift);
            }
            let step = rod.newton_step::<true>();
            minimum_nearby = shift == 0.0 && step.largest < 1e-4 && pivot > 0.01 * self.shift_unit;
            rod.save();
            let mut fraction = (MAX_STEP / step.largest).min(1.0);
            loop {
                rod.advance(fraction);
                let trial = rod.evaluate();
                if trial <= energy + 1e-4 * fraction * step.slope + noise {
                    energy = trial;
                    break;
                }
                fraction *= 0.5;
                if fraction < 1e-12 {
                    return Attempt::Stuck;
                }
            }
            shift = if fraction == 1.0 && shift <= self.shift_unit {
                0.0
            } else {
                shift * 0.25
            };
        }
    }

    /// Newton's method where there is no energy: a step is accepted if the residual falls.
    fn newton_on_residual(&mut self, outcome: &mut Outcome) -> Attempt {
        let rod = &mut self.rod;
        rod.evaluate();
        let mut residual = rod.gradient() / self.moment_scale;
        for _ in 0..MAX_RESIDUAL_STEPS {
            outcome.residual = residual;
            if residual <= TOLERANCE {
                return Attempt::Converged { stable: None };
            }
            if !residual.is_finite() {
                break;
            }
            outcome.iterations += 1;
            rod.eliminate::<false>(0.0);
            let step = rod.newton_step::<false>();
            rod.save();
            let mut fraction = (MAX_STEP / step.largest).min(1.0);
            loop {
                rod.advance(fraction);
                rod.evaluate();
                let trial = rod.gradient() / self.moment_scale;
                // a short first step may turn the whole chain: let it grow a little
                if trial
                    <= residual
                        * if fraction == 1.0 {
                            2.0
                        } else {
                            1.0 - 1e-3 * fraction
                        }
                {
                    residual = trial;
                    break;
                }
                fraction *= 0.5;
                if !(fraction > 1e-3) {
                    return Attempt::Stuck;
                }
            }
        }
        Attempt::Stuck
    }

    /// Raises the load from zero by steps that adapt; tells how far it came.
    fn continuation(&mut self, load: &Load, outcome: &mut Outcome) -> Attempt {
        let mut tensions = load.tensions.to_vec();
        self.rod.make_straight();
        let (mut reached, mut increment) = (0.0, 0.25);
        loop {
            let fraction = f64::min(reached + increment, 1.0);
            for (t, full) in tensions.iter_mut().zip(load.tensions) {
                *t = full * fraction;
            }
            self.rod.load(&Load {
                tensions: &tensions,
                gravity: load.gravity.map(|g| g * fraction),
                tip_force: load.tip_force.map(|f| f * fraction),
                tip_moment: load.tip_moment.map(|m| m * fraction),
            });
            let start: Vec<_> = self.rod.states.iter().map(|s| s.w).collect();
            let mut part = Outcome {
                iterations: 0,
                ..*outcome
            };
            let attempt = self.newton(&mut part);
            outcome.iterations += part.iterations;
            outcome.residual = part.residual;
            outcome.left_unstable |= part.left_unstable;
            match attempt {
                Attempt::Converged { .. } if fraction == 1.0 => {
                    outcome.fraction = 1.0;
                    return attempt;
                }
                Attempt::Converged { .. } if self.rod.disks_collide().is_none() => {
                    reached = fraction;
                    increment *= 1.5;
                }
                _ => {
                    for (state, w) in self.rod.states.iter_mut().zip(&start) {
                        state.w = *w;
                        state.n = Vec3::zero();
                    }
                    increment *= 0.3;
                    if increment < 1e-3 {
                        outcome.fraction = reached;
                        return Attempt::Stuck;
                    }
                }
            }
        }
    }

    /// Pose of the tip, which is the last disk.
    pub fn tip(&self) -> Pose {
        self.disk(self.robot.module_count() - 1)
    }

    /// Pose of a disk.
    pub fn disk(&self, k: usize) -> Pose {
        let (rotation, position) = self.rod.disk(k);
        Pose { rotation, position }
    }

    /// Length of a tendon from the base hole to the hole of its end disk, m.
    pub fn tendon_length(&self, i: usize) -> f64 {
        self.rod.tendon_length(i)
    }

    /// Points of the backbone, `per_module` in each module, base and tip included, m.
    pub fn centerline(&self, per_module: usize) -> Vec<Vec3> {
        let mut points = vec![Vec3::zero()];
        for (state, c) in self.rod.states.iter().zip(&self.rod.constants) {
            for j in 1..per_module {
                let local = state.point(c, j as f64 / per_module as f64);
                points.push(state.position + state.rotation * local);
            }
            points.push(state.end_pose(c).1);
        }
        points
    }
}

/// Largest change of an arc's rotation vector in one step, rad.
const MAX_STEP: f64 = 1.0;
/// Attempts at leaving unstable equilibria.
const MAX_ESCAPES: usize = 4;
/// Newton steps on the residual for one load.
const MAX_RESIDUAL_STEPS: usize = 40;

/// Moves off an unstable equilibrium along a falling direction; returns the energy there.
///
/// Inverse iteration on the shifted Hessian from a fixed, unsymmetric start finds the lowest
/// mode, so that the same load always takes the same branch.
fn leave_saddle<const A: usize>(rod: &mut Rod<f64, A>, shift_unit: f64, attempt: usize) -> f64 {
    let mut shift = shift_unit;
    while !(rod.eliminate::<true>(shift) > 0.0) && shift < 1e9 * shift_unit {
        shift *= 1.5;
    }
    for (k, gradient) in rod.gradients.iter_mut().enumerate() {
        for (i, g) in gradient.g.iter_mut().enumerate() {
            let phase = (k * A + i) as f64;
            *g = Vec3([0.3 + 0.01 * phase.cos(), -1.0, 0.02 * phase.sin()]);
        }
    }
    for _ in 0..8 {
        let step = rod.newton_step::<true>();
        rod.direction_to_gradient(1.0 / step.largest);
    }
    let largest = rod.newton_step::<true>().largest;
    rod.save();
    let modules = rod.states.len() as f64;
    rod.advance(0.2 * attempt as f64 / (largest * modules.sqrt()));
    rod.evaluate()
}

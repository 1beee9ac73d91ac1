//! Nonlinear dynamics: an implicit march in time, with an honest status.

use crate::dispatch::{self, Moving};
use crate::interrupt;
use crate::math::linalg::Vec3;
use crate::model::load::{Load, Model, OwnedLoad};
use crate::model::robot::{InputError, Robot, Short};
pub use crate::motion::{Damping, Energies, Fields};
use crate::statics::path::{Command, Drive, History, Line};
use crate::statics::solver::{self, Outcome, Solver, Status};
use crate::tendon::transmission::Transmission;

/// Largest moment imbalance over (bending stiffness / length) at which a step counts as solved:
/// with numerical damping, and without it, where errors of energy add up.
pub const TOLERANCE: [f64; 2] = [1e-6, 1e-7];
/// Share of a step's estimated error that an imbalance may add to it, and the largest imbalance
/// that may: a step need not be solved better than it follows the motion. Only with numerical
/// damping, and by tension.
const SHARE_OF_ERROR: f64 = 5e-3;
const LOOSEST: f64 = 1e-4;
/// Newton iterations of a step before it is cut, without and with pulls and friction, which are
/// but nearly in Newton's matrix.
const MAX_ITERATIONS: [usize; 2] = [12, 30];
/// The same of a search for an equilibrium, which no cut helps.
const MAX_ITERATIONS_AT_REST: usize = 40;
/// Length, as a share of the robot's, to which pulls are met; and where rounding allows no
/// better. Slip that is none is somewhat more.
const LENGTH: f64 = 1e-13;
const NEAR_LENGTH: f64 = 1e-11;
const REST: f64 = 1e-11;
/// Change of the logarithm of a tension that is none.
const FINE: f64 = 1e-9;
/// Residual over the one before at which Newton's matrix is too old.
const SLOW: f64 = 0.03;
/// Shortest step that a cut may reach, over the step asked for.
const MOST_CUTS: f64 = 1e-6;
/// Rounding of a step's forces, over the bending stiffness / length, that still leaves a motion.
const MOST_NOISE: f64 = 1e-4;
/// Steps, repeated ones too, in one stretch of time: enough for minutes of a stiff robot.
const MOST_STEPS: usize = 2_000_000;
/// Energy that may appear from nowhere before a step is done again without numerical damping,
/// whose scheme conserves it; and before a step is cut. Of the largest energy so far.
const GROWTH: [f64; 2] = [1e-3, 5e-2];
/// Without numerical damping: the share of the largest energy so far to which energy is kept, and
/// how often a step is solved again for it.
const KEPT: f64 = 1e-5;
const MAX_RESTORATIONS: usize = 3;

/// Errors of steps add up to that of a motion, but for what each leaves in the velocity, which
/// shows a quarter of an oscillation later.
const ERROR_MARGIN: f64 = 3.0;

/// How long a step is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Step {
    /// At most this long, s.
    Fixed(f64),
    /// Such that a disk's position errs by about this much in a step, m; a step after a jump of
    /// the load is a twentieth of the longest, for nothing is known of it.
    Adaptive { tolerance: f64, longest: f64 },
}

/// What stays the same over a run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// m/s^2
    pub gravity: [f64; 3],
    pub damping: Damping,
    /// Numerical damping: what a step leaves of the fastest oscillation, 0 to 1 (none).
    pub spectral_radius: f64,
    pub step: Step,
}

/// Why a run stopped before its time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stop {
    /// The shortest step did not converge.
    StepFailed,
    /// Two disks met.
    Collision,
}

/// What a stretch of time took.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Count {
    pub steps: usize,
    pub iterations: usize,
    /// Steps done again: shorter, or without numerical damping.
    pub repeated: usize,
    /// Estimated error of the tip's position that these steps add, m: the sum of their own, with a
    /// margin. Zero after a single step, of which nothing is known.
    pub error: f64,
}

/// A moving robot.
///
/// ```
/// use bowstring_core::{dynamics::integrator::*, model::load::{Load, Model}, model::robot::*};
/// let section = Section { bending: 1.07, torsion: 0.83, axial: 6.9e5, shear: 2.6e5, mass_per_length: 0.035, rotary_inertia: 5.5e-8 };
/// let disks = (1..=9).map(|k| Disk { station: 0.641 * k as f64 / 9.0, clamped_length: 0.0, mass: 0.02, inertia: [5.1e-6, 1.02e-5], segment: 0 });
/// let robot = Robot::new(RobotSpec {
///     sections: vec![section],
///     disks: disks.collect(),
///     tendons: vec![Tendon { hole: [0.029, 0.0], end_disk: 8 }],
///     gravity: [0.0; 3],
/// })?;
/// let mut simulator = Simulator::new(&robot, Model::default(), 1, Settings {
///     gravity: [0.0; 3],
///     damping: Damping { mass: 0.5, material: 0.0 },
///     spectral_radius: 1.0,
///     step: Step::Fixed(2e-3),
/// })?;
/// let pull = |tension: &'static [f64]| Load { tensions: tension, gravity: [0.0; 3], tip_force: [0.0; 3], tip_moment: [0.0; 3] };
/// simulator.rest(&pull(&[0.0]))?;
/// // 0 to 40 N in half a second
/// let (stop, _) = simulator.advance(0.5, &pull(&[40.0]))?;
/// assert_eq!(stop, None);
/// assert!((simulator.tip().0[0] - 0.19836).abs() < 1e-3);
/// # Ok::<(), InputError>(())
/// ```
pub struct Simulator {
    robot: Robot,
    model: Model,
    elements: usize,
    settings: Settings,
    engine: Box<dyn Moving>,
    time: f64,
    /// Whether there is a state to move on from.
    ready: bool,
    march: March,
}

/// The course of one stretch of time.
struct March {
    step: Step,
    spectral_radius: f64,
    tolerance: f64,
    at_rest_tolerance: f64,
    loosest: f64,
    /// Step below which rounding would drown the motion, s.
    shortest: f64,
    /// In the place of a tension, the pull of a tendon that is driven so.
    from: OwnedLoad,
    to: OwnedLoad,
    /// Where forces balance, and at the end of the step.
    between: OwnedLoad,
    end: OwnedLoad,
    driven: Option<Driven>,
    /// Step to try next, s.
    next: f64,
    /// Estimated error of the last step, m; infinite if unknown.
    error: f64,
    /// Energy left at the last jump of the load; the least since, and the largest energy; J.
    start: f64,
    left: f64,
    size: f64,
    count: Count,
    /// Steps just before whose error is not known.
    unknown: usize,
    /// Whether the last equilibrium was a minimum of the energy.
    stable: bool,
    /// How much of the stretch was done, s.
    elapsed: f64,
}

/// What a robot is driven by beside tensions.
struct Driven {
    transmission: Transmission,
    /// At the start of the step.
    old: History,
    /// Length of each tendon that hangs there, m.
    slack: Vec<f64>,
    /// Of the step.
    commands: Vec<Command>,
    /// What each tendon lacks or has too much in the iteration before, m.
    lacked: f64,
    length: f64,
}

impl Driven {
    fn new(drive: &Drive, length: f64) -> Self {
        let mut transmission = drive.transmission().clone();
        transmission.fine = FINE;
        transmission.rest = REST * length;
        Driven {
            slack: transmission.slack.clone(),
            transmission,
            old: drive.history().clone(),
            commands: drive.history().commands.clone(),
            lacked: f64::INFINITY,
            length,
        }
    }

    /// Tension of a tendon now: of its stretch where friction leaves it the same all along, else
    /// that of the last balance of forces, N.
    fn tension(&self, i: usize) -> f64 {
        match self.transmission.tension_of_stretch(i) {
            Some(tension) if !self.transmission.rubs => tension,
            _ => self.old.tensions[i],
        }
    }

    /// Tension of a tendon's spans from base to tip at the last balance of forces, N; what a step
    /// that failed has left in the rod is not looked at.
    fn spans(&self, i: usize) -> impl Iterator<Item = f64> + '_ {
        let (m, rubs) = (self.commands.len(), self.transmission.rubs);
        let mut drop = 0.0;
        (0..).map(move |k| {
            if rubs {
                drop += self.old.drops[k * m + i];
            }
            self.old.tensions[i] * (-drop).exp()
        })
    }

    /// Whether a tendon is pulled by a length and does not stretch.
    fn is_stiff(&self, i: usize) -> bool {
        let pulled = matches!(self.commands[i], Command::Pull(_));
        pulled && self.transmission.tension_of_stretch(i).is_none()
    }

    /// Takes on the commands of a step; pulls are those of its end.
    fn begin(&mut self, motion: &mut dyn Moving, tensions: &[f64], pulls: &[f64], share: f64) {
        for (i, command) in self.commands.iter_mut().enumerate() {
            match command {
                Command::Tension(t) => *t = tensions[i],
                Command::Pull(p) => *p = pulls[i],
            }
        }
        self.transmission.start(&self.old, &self.commands);
        self.transmission.share = share;
        self.transmission.apply(motion);
        self.lacked = f64::INFINITY;
    }

    /// Friction and lengths at the present pose; the moment imbalance is made anew where friction
    /// changed it. Whether all is as it must be, and whether it gets better.
    fn look(&mut self, motion: &mut dyn Moving, residual: &mut f64) -> (bool, bool) {
        let transmission = &mut self.transmission;
        motion.measure_spans(transmission.rubs);
        let mut settled = true;
        if transmission.rubs {
            settled = transmission.slide(motion, &self.old, false);
            transmission.apply(motion);
            *residual = motion.imbalance();
        }
        transmission.measure(motion);
        let lacks = transmission.length_residual() / self.length;
        let better = lacks <= 0.1 * self.lacked;
        let stalls = lacks <= NEAR_LENGTH && !better;
        self.lacked = lacks;
        (settled && (lacks <= LENGTH || stalls), better)
    }

    /// A Newton step on tensions and strain; false where there is none. `made`: Newton's matrix
    /// is new.
    fn improve(&mut self, motion: &mut dyn Moving, made: bool) -> bool {
        let transmission = &mut self.transmission;
        transmission.gather(motion, &self.old, 0.0, !made);
        if !transmission.problem.solve() {
            return false;
        }
        if transmission.is_bare() {
            motion.substitute();
            motion.combine(&[1.0]);
            return true;
        }
        motion.combine(transmission.coefficients());
        transmission.take(motion, 1.0);
        true
    }

    /// Takes the pose that was found as the start of the next step; returns the energy in
    /// tendons that are pulled, J.
    fn arrive(&mut self, motion: &dyn Moving) -> f64 {
        let energy = self.transmission.arrive(motion);
        self.old.copy_from(&self.transmission.now);
        self.slack.clone_from(&self.transmission.slack);
        energy
    }
}

/// What to march through.
#[derive(Clone, Copy)]
enum Task {
    /// To the equilibrium under the tensions at hand.
    Rest,
    /// To the equilibrium under `to`.
    Settle,
    /// This long, s.
    Advance(f64),
}

/// Newton's method on one step. The first tolerance is for a step as it was foreseen: the errors
/// of foresight point the same way from step to step and add up. The second is for one that was
/// corrected.
fn solve(
    motion: &mut dyn Moving,
    mut driven: Option<&mut Driven>,
    count: &mut Count,
    tolerances: [f64; 2],
    least: usize,
    again: bool,
) -> bool {
    let (mut iteration, mut best, mut last) = (0, f64::INFINITY, f64::INFINITY);
    let most = match least {
        0 => MAX_ITERATIONS[usize::from(driven.is_some())],
        _ => MAX_ITERATIONS_AT_REST,
    };
    let work = match &driven {
        None => motion.work(),
        Some(driven) => motion.work() * (2 + driven.transmission.problem.size),
    };
    loop {
        let tolerance = tolerances[usize::from(iteration > 0)];
        if interrupt::work(work) {
            return false;
        }
        let mut residual = motion.residual();
        let (mut settled, mut better) = (true, true);
        if let Some(driven) = &mut driven {
            (settled, better) = driven.look(motion, &mut residual);
        }
        if settled && residual <= tolerance && iteration >= least {
            return true;
        }
        best = f64::min(best, residual);
        // a NaN ends it as well
        let best_of_all = f64::max(best, tolerance);
        if iteration == most || !(residual < 1e6 * best_of_all) {
            return false;
        }
        let slow = residual > tolerance && residual > SLOW * last;
        let blind = again && iteration == 0;
        if blind {
            motion.forget_forces();
        }
        let made = motion.ready(slow || !better || blind || iteration < least);
        match &mut driven {
            None => {
                motion.substitute();
                motion.combine(&[1.0]);
            }
            Some(driven) => {
                if !driven.improve(motion, made) {
                    return false;
                }
            }
        }
        last = residual;
        iteration += 1;
        count.iterations += 1;
    }
}

/// Ends a step that was solved; returns the energy left, and the largest so far.
fn finish(motion: &mut dyn Moving, march: &March) -> (f64, f64) {
    motion.finish(&march.between.borrow());
    if let Some(driven) = &march.driven {
        let energies = driven.transmission.energies(motion, motion.tendon_work());
        motion.account(&energies);
    }
    let energies = motion.next_energies();
    (energies.left(), f64::max(march.size, energies.size()))
}

fn run(motion: &mut dyn Moving, march: &mut March, task: Task) -> Option<Stop> {
    let duration = match task {
        Task::Rest | Task::Settle => f64::INFINITY,
        Task::Advance(duration) => duration,
    };
    let settling = duration.is_infinite();
    let nominal = match march.step {
        Step::Fixed(step) => step,
        Step::Adaptive { longest, .. } => longest,
    };
    march.elapsed = 0.0;
    let mut again = false;
    while march.elapsed < duration * (1.0 - 1e-12) {
        if march.count.steps + march.count.repeated > MOST_STEPS {
            return Some(Stop::StepFailed);
        }
        let remaining = duration - march.elapsed;
        let step = remaining / (remaining / march.next - 1e-4).ceil().max(1.0);
        let mut fraction = 1.0;
        if settling {
            motion.begin_at_rest();
        } else {
            motion.begin(step, march.spectral_radius);
            fraction = (march.elapsed + motion.balance_time() * step) / duration;
        }
        march.between.between(&march.from, &march.to, fraction);
        motion.set_load(&march.between.borrow());
        if let Some(driven) = &mut march.driven {
            let share = if settling { 1.0 } else { motion.balance_time() };
            let end = if settling {
                1.0
            } else {
                (march.elapsed + step) / duration
            };
            march.end.between(&march.from, &march.to, end);
            driven.begin(motion, &march.between.tensions, &march.end.tensions, share);
        }
        let tight = if settling {
            march.at_rest_tolerance
        } else {
            march.tolerance
        };
        let loose = if settling || march.driven.is_some() || march.error.is_infinite() {
            tight
        } else {
            let left = motion.effort(SHARE_OF_ERROR * march.error);
            f64::max(tight, f64::min(left, march.loosest))
        };
        let noise = motion.noise(match &march.driven {
            Some(driven) => &driven.old.tensions,
            None => &march.between.tensions,
        });
        let tolerances = [tight, loose].map(|t| f64::max(t, noise));
        let driven = match task {
            // tensions are those of an equilibrium already
            Task::Rest => None,
            _ => march.driven.as_mut(),
        };
        // at rest Newton's matrix tells whether the equilibrium is stable
        let least = usize::from(settling);
        let mut sound = solve(motion, driven, &mut march.count, tolerances, least, again);
        if interrupt::interrupted() {
            return Some(Stop::StepFailed);
        }
        if settling {
            let (mut tendons, mut held) = (0.0, 0);
            if let Some(driven) = &mut march.driven {
                if let Task::Settle = task {
                    held = driven.transmission.problem.negative_eigenvalues();
                } else {
                    motion.measure_spans(false);
                    driven.transmission.adopt(motion);
                }
                tendons = driven.arrive(motion);
            }
            motion.commit_at_rest(tendons);
            march.stable = motion.is_stable(held);
            return (!sound).then_some(Stop::StepFailed);
        }
        let (mut error, mut tip_error) = (f64::INFINITY, f64::INFINITY);
        march.error = error;
        if sound {
            let (mut left, mut size) = finish(motion, march);
            if march.spectral_radius == 1.0 {
                for _ in 0..MAX_RESTORATIONS {
                    let excess = left - march.start;
                    if excess.abs() <= KEPT * size || !motion.restore(excess) {
                        break;
                    }
                    let driven = march.driven.as_mut();
                    // one iteration at least: the force may be lost in the tolerance
                    let again = [0.0, tolerances[1]];
                    sound = solve(motion, driven, &mut march.count, again, 0, false);
                    if !sound {
                        break;
                    }
                    (left, size) = finish(motion, march);
                }
            }
            if let Some(found) = motion.local_error() {
                (error, tip_error) = (found.largest, found.tip);
            }
            let grown = left - march.left;
            if !motion.is_fresh() && march.spectral_radius < 1.0 && grown > GROWTH[0] * size {
                motion.restart();
                march.count.repeated += 1;
                continue;
            }
            // a NaN is not sound
            sound &= grown <= GROWTH[1] * size;
        }
        if !sound {
            motion.reset_predictor();
            again = true;
            march.next = step / 2.0;
            march.count.repeated += 1;
            if march.next < f64::max(nominal * MOST_CUTS, march.shortest) {
                return Some(Stop::StepFailed);
            }
            continue;
        }
        if let Step::Adaptive { tolerance, .. } = march.step {
            if error.is_finite() && error > 2.0 * tolerance && step > march.shortest {
                let shorter = step * f64::max(0.9 * (tolerance / error).cbrt(), 0.2);
                march.next = f64::max(shorter, march.shortest);
                march.count.repeated += 1;
                continue;
            }
        }
        if !motion.is_apart() {
            return Some(Stop::Collision);
        }
        if let Some(driven) = &mut march.driven {
            driven.arrive(motion);
        }
        motion.commit();
        again = false;
        march.error = error;
        // steps of which nothing is known count as the next
        march.unknown += 1;
        if error.is_finite() {
            march.count.error += ERROR_MARGIN * tip_error * march.unknown as f64;
            march.unknown = 0;
        }
        march.left = f64::min(march.left, motion.energies().left());
        march.size = f64::max(march.size, motion.energies().size());
        march.elapsed += step;
        march.count.steps += 1;
        march.next = match march.step {
            // cut steps grow back
            Step::Fixed(longest) => f64::min(2.0 * march.next, longest),
            Step::Adaptive { tolerance, longest } => {
                let growth = if error.is_finite() {
                    (0.9 * (tolerance / error).cbrt()).clamp(0.5, 2.0)
                } else {
                    1.0
                };
                // steps of one length share Newton's matrix
                let keep = (0.85..1.4).contains(&growth);
                f64::min(if keep { step } else { step * growth }, longest)
            }
        };
    }
    None
}

impl Simulator {
    /// A robot that waits for [`Simulator::rest`]; 1, 2, 4 or 8 elements in a module.
    pub fn new(
        robot: &Robot,
        model: Model,
        elements: usize,
        settings: Settings,
    ) -> Result<Self, InputError> {
        let Settings {
            gravity,
            damping,
            spectral_radius,
            step,
        } = settings;
        for (name, unit, value) in [
            ("mass damping", "1/s", damping.mass),
            ("material damping", "s", damping.material),
        ] {
            if !(value.is_finite() && value >= 0.0) {
                return Err(InputError(format!(
                    "{name} is {} {unit}, it must not be negative",
                    Short(value)
                )));
            }
        }
        if !(0.0..=1.0).contains(&spectral_radius) {
            return Err(InputError(format!(
                "spectral radius is {}, it must lie from 0 (damps fast oscillations at once) to 1 (damps nothing)",
                Short(spectral_radius)
            )));
        }
        let lengths: &[(&str, f64)] = match &step {
            Step::Fixed(step) => &[("time step", *step)],
            Step::Adaptive { tolerance, longest } => {
                &[("tolerance", *tolerance), ("longest time step", *longest)]
            }
        };
        for (name, value) in lengths {
            if !(value.is_normal() && *value > 0.0) {
                return Err(InputError(format!(
                    "{name} is {}, it must be positive",
                    Short(*value)
                )));
            }
        }
        if !gravity.iter().all(|g| g.is_finite()) {
            return Err(InputError(format!(
                "gravity is {gravity:?} m/s^2, it must be three finite numbers"
            )));
        }
        // 2 / h^2 times mass times length is the largest force whose rounding is seen
        let scale = robot.moment_scale();
        let size = 8.0 * f64::EPSILON * robot.mass() * robot.length().powi(2);
        let shortest = (size / (MOST_NOISE * scale)).sqrt();
        if let Step::Fixed(step) = step {
            if step < shortest {
                return Err(InputError(format!(
                    "time step is {} s; below {shortest:.1e} s rounding would drown the motion of this robot",
                    Short(step)
                )));
            }
        }
        let forces = OwnedLoad {
            tensions: vec![0.0; robot.tendon_count()],
            ..OwnedLoad::default()
        };
        Ok(Simulator {
            engine: {
                dispatch::check_moving(robot, elements)?;
                dispatch::moving(robot, model, elements, gravity, damping)?
            },
            robot: robot.clone(),
            model,
            elements,
            settings,
            time: 0.0,
            ready: false,
            march: March {
                step,
                spectral_radius,
                tolerance: TOLERANCE[usize::from(spectral_radius == 1.0)] * scale,
                at_rest_tolerance: solver::TOLERANCE * scale,
                loosest: if spectral_radius == 1.0 {
                    0.0
                } else {
                    LOOSEST * scale
                },
                shortest,
                from: forces.clone(),
                to: forces.clone(),
                between: forces.clone(),
                end: forces,
                driven: None,
                next: 0.0,
                error: f64::INFINITY,
                start: 0.0,
                left: 0.0,
                size: 0.0,
                unknown: 0,
                count: Count::default(),
                stable: false,
                elapsed: 0.0,
            },
        })
    }

    /// The robot that moves.
    pub fn robot(&self) -> &Robot {
        &self.robot
    }

    /// Starts anew, at rest in the equilibrium of a load, at time zero; the load's gravity is
    /// not used. Nothing but a converged outcome can be simulated from, and where motion, whose
    /// mass sits in points, finds no rest near it, not that either: see [`Simulator::is_ready`].
    pub fn rest(&mut self, load: &Load) -> Result<Outcome, InputError> {
        let load = Load {
            gravity: self.settings.gravity,
            ..*load
        };
        let mut solver = Solver::new(&self.robot, self.model, self.elements)?;
        let outcome = solver.solve(&load)?;
        let n = self.robot.module_count();
        let mut strain = vec![Vec3::zero(); 2 * self.elements * n];
        let mut force = vec![Vec3::zero(); n];
        solver.strain_and_force(&mut strain, &mut force);
        self.engine.take_strain(&strain, &force);
        self.march.driven = None;
        self.march.to.set(&load);
        self.clear_disk_forces();
        self.ready = outcome.status == Status::Converged && self.settle(Task::Rest).is_none();
        Ok(outcome)
    }

    /// Whether there is a state to move on from.
    pub fn is_ready(&self) -> bool {
        self.ready
    }

    /// A robot at home for [`Simulator::rest_at`], driven through lines.
    pub fn drive(&self, lines: &[Line]) -> Result<Drive, InputError> {
        Drive::new(&self.robot, self.model, self.elements, lines)
    }

    /// Starts anew, at rest where a path of equilibria has come to, at time zero; from there on
    /// each tendon is driven as in the path's last step, by a tension or by a pull, and friction
    /// goes on from the path. In loads that follow, a tendon that is pulled has its pull in the
    /// place of the tension, m.
    ///
    /// # Errors
    /// If the path is not one of [`Simulator::drive`], has not come to an equilibrium, or was
    /// under another gravity.
    pub fn rest_at(&mut self, drive: &Drive) -> Result<Option<Stop>, InputError> {
        let n = self.robot.module_count();
        let history = drive.history();
        let (mut strain, mut force) = (
            vec![Vec3::zero(); 2 * self.elements * n],
            vec![Vec3::zero(); n],
        );
        if drive.robot().spec() != self.robot.spec()
            || drive.solver().model() != self.model
            || history.strain.len() != strain.len()
        {
            return Err(InputError("the path is one of another robot".into()));
        }
        let [gravity, tip_force, tip_moment] = history.load;
        if gravity != self.settings.gravity {
            return Err(InputError(format!(
                "the path was under gravity {gravity:?} m/s^2, the motion is under {:?}",
                self.settings.gravity
            )));
        }
        if drive.solver().tip().is_none() {
            return Err(InputError(
                "the path has not come to an equilibrium to move from".into(),
            ));
        }
        drive.solver().strain_and_force(&mut strain, &mut force);
        self.engine.take_strain(&strain, &force);
        let values: Vec<_> = history
            .commands
            .iter()
            .map(|command| match *command {
                Command::Tension(t) => t,
                Command::Pull(p) => p,
            })
            .collect();
        self.march.to.set(&Load {
            tensions: &values,
            gravity,
            tip_force,
            tip_moment,
        });
        self.march.driven = Some(Driven::new(drive, self.robot.length()));
        self.clear_disk_forces();
        let stop = self.settle(Task::Rest);
        self.ready = stop.is_none();
        Ok(stop)
    }

    /// Adds dead forces on the disks, N in the base frame, and goes to rest under them by
    /// equal increments; they stay until they are taken off. Stops where there is no stable
    /// equilibrium.
    pub fn rest_with_disk_forces(
        &mut self,
        forces: &[[f64; 3]],
        increments: usize,
    ) -> Result<Option<Stop>, InputError> {
        if forces.len() != self.robot.module_count() {
            return Err(InputError(format!(
                "{} disk forces were given, the robot has {} disks",
                forces.len(),
                self.robot.module_count()
            )));
        }
        self.check_ready()?;
        if !forces.iter().flatten().all(|f| f.is_finite()) {
            return Err(InputError("disk forces must be finite numbers".into()));
        }
        let increments = increments.max(1);
        for i in 1..=increments {
            let share = i as f64 / increments as f64;
            for (k, f) in forces.iter().enumerate() {
                self.engine.set_disk_force(k, Vec3(*f) * share);
            }
            if let Some(stop) = self.settle(Task::Settle) {
                self.ready = false;
                return Ok(Some(stop));
            }
        }
        if !self.march.stable {
            self.ready = false;
            return Ok(Some(Stop::StepFailed));
        }
        Ok(None)
    }

    /// Takes all forces off the disks at once.
    pub fn release_disk_forces(&mut self) {
        self.clear_disk_forces();
        self.engine.restart();
        self.engine.reset_predictor();
        self.forget();
    }

    fn clear_disk_forces(&mut self) {
        for k in 0..self.robot.module_count() {
            self.engine.set_disk_force(k, Vec3::zero());
        }
    }

    fn check_ready(&self) -> Result<(), InputError> {
        if self.ready {
            return Ok(());
        }
        Err(InputError(
            "the robot has no state to move from: bring it to rest first".into(),
        ))
    }

    fn check(&self, load: &Load) -> Result<(), InputError> {
        let Some(driven) = &self.march.driven else {
            return load.check(&self.robot);
        };
        if load.tensions.len() != driven.commands.len() {
            return load.check(&self.robot);
        }
        let commands: Vec<_> = driven
            .commands
            .iter()
            .zip(load.tensions)
            .map(|(command, value)| match command {
                Command::Tension(_) => Command::Tension(*value),
                Command::Pull(_) => Command::Pull(*value),
            })
            .collect();
        driven.transmission.check(&self.robot, &commands, load)
    }

    fn settle(&mut self, task: Task) -> Option<Stop> {
        self.march.from = self.march.to.clone();
        let stop = run(&mut *self.engine, &mut self.march, task);
        self.time = 0.0;
        self.march.count = Count::default();
        self.forget();
        stop
    }

    fn forget(&mut self) {
        let energies = *self.energies();
        self.march.start = energies.left();
        self.march.left = energies.left();
        self.march.size = energies.size();
        self.march.error = f64::INFINITY;
        self.march.next = match self.settings.step {
            Step::Fixed(step) => step,
            Step::Adaptive { longest, .. } => longest / 20.0,
        };
    }

    /// Changes the load at once: a release, or a step of tension.
    ///
    /// # Errors
    /// If a number does not fit the robot, or a pull jumps that nothing gives way to.
    pub fn jump(&mut self, load: &Load) -> Result<(), InputError> {
        self.check_ready()?;
        self.check(load)?;
        if let Some(driven) = &mut self.march.driven {
            let pairs = load.tensions.iter().zip(&self.march.to.tensions);
            for (i, (to, from)) in pairs.enumerate() {
                if (to - from).abs() > REST * driven.length && driven.is_stiff(i) {
                    return Err(InputError(format!(
                        "the pull of tendon {} jumps from {from} m to {to} m, which would take an \
                         infinite force: its line does not stretch; let it take its time",
                        i + 1
                    )));
                }
            }
            let energy = driven.transmission.jump(load.tensions, &mut driven.slack);
            self.engine.put_in(energy);
        } else {
            self.engine.jump_tensions(load.tensions);
        }
        self.march.to.set(load);
        self.engine.restart();
        self.engine.reset_predictor();
        self.forget();
        Ok(())
    }

    /// Moves on by `duration` seconds while the load goes in a straight line to the one given;
    /// tells what stopped it before, and what it took.
    pub fn advance(
        &mut self,
        duration: f64,
        load: &Load,
    ) -> Result<(Option<Stop>, Count), InputError> {
        self.check_ready()?;
        self.check(load)?;
        if !(duration.is_finite() && duration >= 0.0) {
            return Err(InputError(format!(
                "duration is {} s, it must not be negative",
                Short(duration)
            )));
        }
        std::mem::swap(&mut self.march.from, &mut self.march.to);
        self.march.to.set(load);
        self.march.count = Count::default();
        let stop = run(&mut *self.engine, &mut self.march, Task::Advance(duration));
        if stop.is_none() {
            self.time += duration;
        } else {
            let march = &mut self.march;
            let reached = if duration > 0.0 {
                march.elapsed / duration
            } else {
                1.0
            };
            march.between.between(&march.from, &march.to, reached);
            march.to = march.between.clone();
            self.time += march.elapsed;
        }
        Ok((stop, self.march.count))
    }

    /// Time since the start, s.
    pub fn time(&self) -> f64 {
        self.time
    }

    /// Step to come, s.
    pub fn next_step(&self) -> f64 {
        self.march.next
    }

    /// Energies now.
    pub fn energies(&self) -> &Energies {
        self.engine.energies()
    }

    /// Position of the tip, m.
    pub fn tip(&self) -> Vec3 {
        self.engine.disk(self.robot.module_count() - 1)
    }

    /// Linear momentum, kg m/s.
    pub fn linear_momentum(&self) -> Vec3 {
        self.engine.linear_momentum()
    }

    /// Appends all fields of now, `points` to a module.
    pub fn record(&mut self, points: usize, fields: &mut Fields) {
        let time = self.time;
        let now = &self.march.to.tensions;
        match &self.march.driven {
            None => self.engine.record(time, now, points, fields),
            Some(driven) => {
                // as of the last step, but for those that a jump has set
                let tensions: Vec<_> = (0..now.len())
                    .map(|i| match driven.commands[i] {
                        Command::Tension(_) => now[i],
                        Command::Pull(_) => driven.tension(i),
                    })
                    .collect();
                self.engine.record(time, &tensions, points, fields);
                let pull = |i| driven.transmission.pull_now(i, &driven.old);
                fields.pull.extend((0..now.len()).map(pull));
                fields.slack.extend(&driven.slack);
                let (n, m) = (self.robot.module_count(), now.len());
                let first = fields.span_tension.len();
                fields.span_tension.resize(first + n * m, f64::NAN);
                for (i, tendon) in self.robot.spec().tendons.iter().enumerate() {
                    for (k, span) in driven.spans(i).take(tendon.end_disk + 1).enumerate() {
                        fields.span_tension[first + k * m + i] = span;
                    }
                }
            }
        }
    }
}

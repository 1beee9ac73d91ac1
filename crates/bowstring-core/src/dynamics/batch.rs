//! Many motions of one robot, each under its own tensions, advanced period by period on all cores.
//!
//! Theory: docs/theory/dynamics.md (Many motions).

use super::integrator::check;
use super::settings::{Integrator, Step};
use crate::dispatch;
use crate::math::real::MOST_LANES;
use crate::model::error::{Argument, InputError, Rule};
use crate::model::load::{Load, Model, OwnedLoad};
use crate::model::robot::Robot;
use crate::statics::batch::for_each;
use crate::statics::solver::{self, Solver, Status};
use crate::step::{Advanced, Flags, MotionsSideBySide, Period};

/// Largest moment imbalance of a converged step, over (bending stiffness / length): with numerical
/// damping, and without it, where errors of energy accumulate.
const TOLERANCE: f64 = 1e-5;
const UNDAMPED_TOLERANCE: f64 = 1e-7;

/// Most steps in a period.
const MOST_STEPS: f64 = 1e5;

/// State of a motion.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum MotionStatus {
    /// It has no state yet.
    #[default]
    NotStarted,
    /// It moves.
    Moving,
    /// It could not start: there is no equilibrium of its tensions.
    NoEquilibrium,
    /// It stopped: even the shortest step did not converge.
    StepFailed,
    /// It stopped: two disks collided.
    Collision,
}

/// How tensions change in a period.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Between {
    /// They jump at the start of the period and are constant in it.
    Held,
    /// They change linearly from those before.
    Linear,
}

/// Periods in which motions advance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Control {
    /// Length of a period (s).
    pub period: f64,
    /// How tensions change in it.
    pub between: Between,
}

/// What is measured of all motions, one after the other.
#[derive(Clone, Debug, Default)]
pub struct Observations {
    /// Positions of the tips (m).
    pub position: Vec<f64>,
    /// Rotations of the tips (body to base, row by row).
    pub rotation: Vec<f64>,
    /// Velocities of the tips (m/s).
    pub velocity: Vec<f64>,
    /// Angular velocities of the tips (rad/s), in base axes.
    pub angular_velocity: Vec<f64>,
    /// Lengths of the tendons (m).
    pub lengths: Vec<f64>,
    /// Kinetic energy, elastic energy, and that of gravity (J).
    pub energies: Vec<f64>,
}

/// Motions side by side.
struct Group {
    lanes: Box<dyn MotionsSideBySide>,
    status: [MotionStatus; MOST_LANES],
    /// Lanes to reset, and tensions by lanes and tendons (N).
    chosen: Flags,
    tensions: Vec<f64>,
}

/// Many motions of one robot.
///
/// Each advances by equal steps of the scheme of [`super::integrator::Simulator`], and by shorter
/// ones where these fail. It depends on the other motions by rounding errors only.
pub struct Motions {
    robot: Robot,
    model: Model,
    elements: usize,
    load: OwnedLoad,
    period: Period,
    groups: Vec<Group>,
    width: usize,
    count: usize,
    threads: usize,
}

impl Motions {
    /// Motions that still need [`Motions::reset`]; 1, 2, 4 or 8 elements in a module.
    ///
    /// The step of the settings is fixed, and made shorter so that steps fill the period. The load is
    /// gravity and a dead force on the tip. `threads`: 0 for all cores.
    ///
    /// # Errors
    /// If a setting is out of range, or the step adaptive.
    pub fn new(
        robot: &Robot,
        (model, elements): (Model, usize),
        settings: Integrator,
        control: Control,
        tip_force: [f64; 3],
        (count, threads): (usize, usize),
    ) -> Result<Self, InputError> {
        check(robot, &settings)?;
        let Step::Fixed(step) = settings.step else {
            return Err(InputError::other("many motions take fixed time steps"));
        };
        let duration = control.period;
        if !(duration.is_finite() && duration >= step) {
            let rule = Rule::AtLeast(step, "a period has one time step or more");
            return Err(InputError::number(Argument::Duration, None, duration, rule));
        }
        let steps = (duration / step * (1.0 - 1e-9)).ceil();
        if steps > MOST_STEPS {
            let rule = Rule::AtLeast(duration / MOST_STEPS, "a period has at most 100 000 steps");
            return Err(InputError::number(Argument::TimeStep, None, step, rule));
        }
        let load = OwnedLoad {
            tensions: vec![0.0; robot.tendon_count()],
            gravity: settings.gravity,
            tip_force,
            ..OwnedLoad::default()
        };
        load.borrow().check(robot)?;
        dispatch::check_solvers(robot, elements, 8 * count.max(1))?;
        let lanes = || {
            let load = load.borrow();
            dispatch::motions_side_by_side(robot, model, elements, settings.damping, &load)
        };
        let width = lanes()?.width();
        let group = |_| {
            Ok(Group {
                lanes: lanes()?,
                status: [MotionStatus::NotStarted; MOST_LANES],
                chosen: [false; MOST_LANES],
                tensions: vec![0.0; MOST_LANES * robot.tendon_count()],
            })
        };
        let groups = (0..count.div_ceil(width))
            .map(group)
            .collect::<Result<_, _>>()?;
        let scale = robot.moment_scale();
        let tolerance = match settings.spectral_radius {
            1.0 => UNDAMPED_TOLERANCE,
            _ => TOLERANCE,
        };
        Ok(Motions {
            robot: robot.clone(),
            model,
            elements,
            load,
            period: Period {
                duration,
                steps: steps as usize,
                spectral_radius: settings.spectral_radius,
                held: control.between == Between::Held,
                tolerance: tolerance * scale,
                at_rest: solver::TOLERANCE * scale,
            },
            groups,
            width,
            count,
            threads,
        })
    }

    /// The robot in motion.
    pub fn robot(&self) -> &Robot {
        &self.robot
    }

    /// Number of motions.
    pub fn count(&self) -> usize {
        self.count
    }

    /// Steps of a period.
    pub fn steps(&self) -> usize {
        self.period.steps
    }

    /// Number of periods of single motions that were repeated with shorter steps.
    pub fn repeated(&self) -> usize {
        self.groups.iter().map(|group| group.lanes.repeated()).sum()
    }

    /// State of a motion.
    pub fn status(&self, motion: usize) -> MotionStatus {
        self.groups[motion / self.width].status[motion % self.width]
    }

    /// Brings some motions to rest in the equilibria of tensions (N), one row for each of them.
    ///
    /// # Errors
    /// If there is no such motion, or a number does not fit the robot.
    pub fn reset(&mut self, which: &[usize], tensions: &[f64]) -> Result<(), InputError> {
        self.check(which.len(), tensions)?;
        if let Some(motion) = which.iter().find(|motion| **motion >= self.count) {
            return Err(InputError::other(format!(
                "there is no motion {motion}: they are counted from 0 to {}",
                self.count as i64 - 1
            )));
        }
        for group in &mut self.groups {
            group.chosen.fill(false);
        }
        let tendons = self.robot.tendon_count();
        for (row, motion) in which.iter().enumerate() {
            let (group, lane) = (&mut self.groups[motion / self.width], motion % self.width);
            group.chosen[lane] = true;
            group.status[lane] = MotionStatus::NoEquilibrium;
            group.tensions[lane * tendons..(lane + 1) * tendons]
                .copy_from_slice(&tensions[row * tendons..(row + 1) * tendons]);
        }
        let (robot, model, elements) = (&self.robot, self.model, self.elements);
        let (period, width, load) = (self.period, self.width, &self.load);
        Solver::new(robot, model, elements)?;
        let solver = || Solver::new(robot, model, elements).expect("checked above");
        for_each(&mut self.groups, self.threads, solver, |solver, group| {
            for lane in 0..width {
                if group.chosen[lane] {
                    let tensions = &group.tensions[lane * tendons..(lane + 1) * tendons];
                    let load = Load {
                        tensions,
                        ..load.borrow()
                    };
                    let found = solver.solve(&load);
                    if found.is_ok_and(|outcome| outcome.status == Status::Converged) {
                        let found = solver.at_rest();
                        group.lanes.set_strain(lane, &found.strain, &found.force);
                    } else {
                        group.chosen[lane] = false;
                    }
                }
            }
            if !group.chosen.contains(&true) {
                return;
            }
            let found = group.lanes.rest(group.chosen, &group.tensions, &period);
            for lane in 0..width {
                if found[lane] {
                    group.status[lane] = MotionStatus::Moving;
                }
            }
        });
        Ok(())
    }

    /// Advances all motions that have not stopped by a period under tensions (N), one row for each
    /// motion. One that stops keeps the state before.
    ///
    /// # Errors
    /// If a number does not fit the robot, or a motion was not started.
    pub fn step(&mut self, tensions: &[f64]) -> Result<(), InputError> {
        self.check(self.count, tensions)?;
        let not_started = |i: &usize| self.status(*i) == MotionStatus::NotStarted;
        if let Some(motion) = (0..self.count).find(not_started) {
            return Err(InputError::other(format!(
                "motion {motion} has no state to start from: reset it first"
            )));
        }
        let (period, width) = (self.period, self.width);
        let tendons = self.robot.tendon_count();
        for (rows, group) in tensions.chunks(width * tendons).zip(&mut self.groups) {
            group.tensions[..rows.len()].copy_from_slice(rows);
        }
        for_each(
            &mut self.groups,
            self.threads,
            || (),
            |_, group| {
                let moving = group.status.map(|status| status == MotionStatus::Moving);
                let found = group.lanes.advance(moving, &group.tensions, &period);
                for lane in (0..width).filter(|lane| moving[*lane]) {
                    group.status[lane] = match found[lane] {
                        Advanced::Done => MotionStatus::Moving,
                        Advanced::StepFailed => MotionStatus::StepFailed,
                        Advanced::Collision => MotionStatus::Collision,
                    };
                }
            },
        );
        Ok(())
    }

    /// Measures all motions; those without a state are zero.
    pub fn observe(&self, out: &mut Observations) {
        let parts = [
            &mut out.position,
            &mut out.rotation,
            &mut out.velocity,
            &mut out.angular_velocity,
            &mut out.lengths,
            &mut out.energies,
        ];
        for part in parts {
            part.clear();
        }
        for motion in 0..self.count {
            let (lanes, lane) = (&self.groups[motion / self.width].lanes, motion % self.width);
            let tip = lanes.tip(lane);
            out.position.extend(tip.position);
            out.rotation.extend(tip.rotation.as_flattened());
            out.velocity.extend(tip.velocity);
            out.angular_velocity.extend(tip.angular_velocity);
            out.energies.extend(lanes.energies(lane));
            let tendons = 0..self.robot.tendon_count();
            out.lengths.extend(tendons.map(|i| lanes.length(lane, i)));
        }
    }

    fn check(&self, rows: usize, tensions: &[f64]) -> Result<(), InputError> {
        let tendons = self.robot.tendon_count();
        if tensions.len() != rows * tendons {
            return Err(InputError::other(format!(
                "{rows} motions of {tendons} tendons need {} tensions; there are {}",
                rows * tendons,
                tensions.len()
            )));
        }
        self.robot.check_tensions(tensions)
    }
}

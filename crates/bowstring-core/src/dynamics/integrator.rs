//! Nonlinear dynamics by implicit time integration.
//!
//! Theory: docs/theory/dynamics.md.

use super::actuation::{Actuation, NEGLIGIBLE_SLIP};
use super::integration::{shortest_step, Equilibrium, Integration};
pub use super::settings::{Count, Damping, Integrator, Step, Stop};
use crate::dispatch;
use crate::math::linalg::Vec3;
use crate::model::error::{Argument, InputError, Rule};
use crate::model::load::{BaseMotion, Load, Model};
use crate::model::robot::Robot;
use crate::statics::path::{Command, Line, PathSolver};
use crate::statics::solver::{Outcome, Solver, Status};
use crate::step::Moving;
pub use crate::step::{DiskFields, Energies, Fields, SectionFields, TendonFields};

/// Checks the settings of a robot's motion.
pub(super) fn check(robot: &Robot, settings: &Integrator) -> Result<(), InputError> {
    let Integrator {
        gravity,
        damping,
        spectral_radius,
        step,
    } = *settings;
    let refused = |argument, value, rule| Err(InputError::number(argument, None, value, rule));
    for (argument, value) in [
        (Argument::MassDamping, damping.mass),
        (Argument::MaterialDamping, damping.material),
    ] {
        if !(value.is_finite() && value >= 0.0) {
            return refused(argument, value, Rule::NotNegative);
        }
    }
    if !(0.0..=1.0).contains(&spectral_radius) {
        let rule = Rule::Other("be from 0 (strongest numerical damping) to 1 (none)");
        return refused(Argument::SpectralRadius, spectral_radius, rule);
    }
    let lengths = match step {
        Step::Fixed(step) => [(Argument::TimeStep, step); 2],
        Step::Adaptive { tolerance, longest } => [
            (Argument::Tolerance, tolerance),
            (Argument::LongestStep, longest),
        ],
    };
    for (argument, value) in lengths {
        if !(value.is_normal() && value > 0.0) {
            return refused(argument, value, Rule::Positive);
        }
    }
    if !gravity.iter().all(|g| g.is_finite()) {
        return Err(InputError::not_finite(Argument::Gravity, None, &gravity));
    }
    let shortest = shortest_step(robot);
    if matches!(step, Step::Fixed(step) if step < shortest) {
        let why = "shorter steps are below numerical resolution for this robot";
        return refused(
            Argument::TimeStep,
            step.longest(),
            Rule::AtLeast(shortest, why),
        );
    }
    Ok(())
}

/// A moving robot.
///
/// ```
/// use bowstring_core::{dynamics::integrator::*, model::load::{Load, Model}, model::robot::*};
/// let section = Section { bending: [1.07; 2], principal_angle: 0.0, torsion: 0.83, axial: 6.9e5, shear: 2.6e5, mass_per_length: 0.035, rotary_inertia: 5.5e-8, rest_curvature: [0.0; 3] };
/// let disks = (1..=9).map(|k| Disk { hole_length: 0.0, station: 0.641 * k as f64 / 9.0, clamped_length: 0.0, mass: 0.02, inertia: [5.1e-6, 1.02e-5], segment: 0 });
/// let robot = Robot::new(RobotSpec {
///     payloads: vec![],
///     backbone: vec![section.into()],
///     disks: disks.collect(),
///     tendons: vec![Tendon::parallel([0.029, 0.0], 8)],
///     gravity: [0.0; 3],
/// })?;
/// let mut simulator = Simulator::new(&robot, Model::default(), 1, Integrator {
///     gravity: [0.0; 3],
///     damping: Damping { mass: 0.5, material: 0.0 },
///     spectral_radius: 1.0,
///     step: Step::Fixed(2e-3),
/// })?;
/// let load = |tension: &'static [f64]| Load { tensions: tension, ..Load::default() };
/// simulator.rest(&load(&[0.0]))?;
/// // 0 to 40 N in half a second
/// let (stop, _) = simulator.advance(0.5, &load(&[40.0]))?;
/// assert_eq!(stop, None);
/// assert!((simulator.tip().0[0] - 0.19836).abs() < 1e-3);
/// # Ok::<(), bowstring_core::model::error::InputError>(())
/// ```
pub struct Simulator {
    robot: Robot,
    model: Model,
    elements: usize,
    settings: Integrator,
    engine: Box<dyn Moving>,
    time: f64,
    /// Whether there is a state to advance from.
    ready: bool,
    integration: Integration,
}

impl Simulator {
    /// A robot that still needs [`Simulator::rest`]; 1, 2, 4 or 8 elements in a module.
    pub fn new(
        robot: &Robot,
        model: Model,
        elements: usize,
        settings: Integrator,
    ) -> Result<Self, InputError> {
        check(robot, &settings)?;
        dispatch::check_moving(robot, elements)?;
        Ok(Simulator {
            engine: dispatch::moving(robot, model, elements, settings.gravity, settings.damping)?,
            robot: robot.clone(),
            model,
            elements,
            settings,
            time: 0.0,
            ready: false,
            integration: Integration::new(robot, &settings),
        })
    }

    /// The robot in motion.
    pub fn robot(&self) -> &Robot {
        &self.robot
    }

    /// Starts again at time zero, at rest in the equilibrium of a load; the load's gravity and
    /// motion of the base are not used. Only a converged outcome can be simulated from, and only if the robot with lumped mass
    /// has a stable rest near it: see [`Simulator::is_ready`].
    pub fn rest(&mut self, load: &Load) -> Result<Outcome, InputError> {
        let load = Load {
            gravity: self.settings.gravity,
            base: BaseMotion::default(),
            ..*load
        };
        let mut solver = Solver::new(&self.robot, self.model, self.elements)?;
        let outcome = solver.solve(&load)?;
        self.take(&solver, &load, None);
        self.ready =
            outcome.status == Status::Converged && self.settle(Equilibrium::Given).is_some();
        Ok(outcome)
    }

    /// Takes over the static equilibrium under a load.
    fn take(&mut self, solver: &Solver, load: &Load, actuation: Option<Actuation>) {
        let found = solver.at_rest();
        self.engine.take_strain(&found.strain, &found.force);
        self.integration.set_load(load);
        self.integration.actuation = actuation;
        self.clear_disk_forces();
    }

    /// Whether there is a state to advance from.
    pub fn is_ready(&self) -> bool {
        self.ready
    }

    /// A robot in its home pose for [`Simulator::rest_at`], actuated through lines.
    pub fn path_solver(&self, lines: &[Line]) -> Result<PathSolver, InputError> {
        PathSolver::new(&self.robot, self.model, self.elements, lines)
    }

    /// Starts again at time zero, at rest at the present state of a path of equilibria. From there
    /// each tendon is under tension or displacement control as in the path's last step, and
    /// friction continues from the path. In later loads, a displacement-controlled tendon has its
    /// displacement (m) in place of the tension.
    ///
    /// # Errors
    /// If the path is not one of [`Simulator::path_solver`], has not reached an equilibrium, or was
    /// under another gravity.
    pub fn rest_at(&mut self, path: &PathSolver) -> Result<Option<Stop>, InputError> {
        let (solver, history) = (path.solver(), path.history());
        let arcs = 2 * self.elements * self.robot.module_count();
        if path.robot().spec() != self.robot.spec()
            || solver.model() != self.model
            || history.strain.len() != arcs
        {
            return Err(InputError::other("the path is one of another robot"));
        }
        let gravity = history.load.gravity;
        if gravity != self.settings.gravity {
            return Err(InputError::other(format!(
                "the path was under gravity {gravity:?} m/s^2, the motion is under {:?}",
                self.settings.gravity
            )));
        }
        if solver.tip().is_none() {
            return Err(InputError::other(
                "the path has not reached an equilibrium to start from",
            ));
        }
        let values: Vec<_> = history.commands.iter().map(Command::value).collect();
        let load = Load {
            tensions: &values,
            ..history.load.borrow()
        };
        let actuation = Actuation::new(path, self.robot.length());
        self.take(solver, &load, Some(actuation));
        self.ready = self.settle(Equilibrium::Given).is_some();
        Ok((!self.ready).then_some(Stop::StepFailed))
    }

    /// Adds dead forces on the disks (N, base frame) in equal increments and finds the rest under
    /// them; they stay until they are released. Stops where there is no stable equilibrium.
    pub fn rest_with_disk_forces(
        &mut self,
        forces: &[[f64; 3]],
        increments: usize,
    ) -> Result<Option<Stop>, InputError> {
        let (given, disks) = (forces.len(), self.robot.module_count());
        if given != disks {
            let argument = Argument::DiskForces;
            return Err(InputError::count(argument, given, disks, "disk"));
        }
        self.check_ready()?;
        if !forces.iter().flatten().all(|f| f.is_finite()) {
            return Err(InputError::other("disk forces must be finite numbers"));
        }
        let increments = increments.max(1);
        for i in 1..=increments {
            let share = i as f64 / increments as f64;
            for (k, f) in forces.iter().enumerate() {
                self.engine.set_disk_force(k, Vec3(*f) * share);
            }
            let found = self.settle(Equilibrium::Loaded);
            self.ready = found == Some(true) || (found == Some(false) && i < increments);
            if !self.ready {
                return Ok(Some(Stop::StepFailed));
            }
        }
        Ok(None)
    }

    /// Removes all forces on the disks at once.
    pub fn release_disk_forces(&mut self) {
        self.clear_disk_forces();
        self.restart_after_jump();
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
        Err(InputError::other(
            "the robot has no state to start from: bring it to rest first",
        ))
    }

    fn check(&self, load: &Load) -> Result<(), InputError> {
        let last = self.integration.point_loads();
        if !load.divides_as(&self.robot, last) {
            return Err(InputError::other(
                "loads between two disks act on other sections than before, which cannot change in \
                 motion; give one that does not act a force of zero",
            ));
        }
        match &self.integration.actuation {
            Some(actuation) if load.tensions.len() == actuation.commands.len() => {
                let commands = actuation.commands.iter().zip(load.tensions);
                let commands: Vec<_> = commands.map(|(c, value)| c.with(*value)).collect();
                actuation.tendons().check(&self.robot, &commands, load)
            }
            _ => load.check(&self.robot),
        }
    }

    /// Finds an equilibrium (see [`Integration::settle`]) and sets the time to zero.
    fn settle(&mut self, which: Equilibrium) -> Option<bool> {
        let found = self.integration.settle(&mut *self.engine, which);
        self.time = 0.0;
        self.forget();
        found
    }

    /// Restarts the integration after a jump.
    fn restart_after_jump(&mut self) {
        self.engine.restart();
        self.engine.reset_predictor();
        self.forget();
    }

    fn forget(&mut self) {
        self.integration.restart(&self.engine.energies().now);
    }

    /// Changes the load at once: a release, or a step of tension.
    ///
    /// # Errors
    /// If a number does not fit the robot, or the displacement of an inextensible tendon jumps.
    pub fn jump(&mut self, load: &Load) -> Result<(), InputError> {
        self.check_ready()?;
        self.check(load)?;
        if let Some(actuation) = &self.integration.actuation {
            let pairs = load.tensions.iter().zip(self.integration.values());
            for (i, (to, from)) in pairs.enumerate() {
                if (to - from).abs() > NEGLIGIBLE_SLIP * self.robot.length()
                    && actuation.is_stiff(i)
                {
                    return Err(InputError::other(format!(
                        "the displacement of tendon {} jumps from {from} m to {to} m, which would take an \
                         infinite force: the tendon is inextensible; give a rise time, or an elastic tendon",
                        i + 1
                    )));
                }
            }
        }
        match &mut self.integration.actuation {
            Some(actuation) => self
                .engine
                .energies_mut()
                .put_in(actuation.jump(load.tensions)),
            None => self.engine.jump_tensions(load.tensions),
        }
        self.integration.set_load(load);
        self.restart_after_jump();
        Ok(())
    }

    /// Advances by `duration` seconds while the load changes linearly to the given one; returns the
    /// reason for an early stop, and the counts of the interval.
    pub fn advance(
        &mut self,
        duration: f64,
        load: &Load,
    ) -> Result<(Option<Stop>, Count), InputError> {
        self.advance_through(duration, load, None)
    }

    /// The same with a motion of the base that is not linear but the cubic through its values at the
    /// start, at one and two thirds of the interval (`base`) and at the end (that of the load).
    pub fn advance_through(
        &mut self,
        duration: f64,
        load: &Load,
        base: Option<[BaseMotion; 2]>,
    ) -> Result<(Option<Stop>, Count), InputError> {
        self.check_ready()?;
        self.check(load)?;
        for base in base.iter().flatten() {
            self.check(&Load {
                base: *base,
                ..*load
            })?;
        }
        if !(duration.is_finite() && duration >= 0.0) {
            let (argument, rule) = (Argument::Duration, Rule::NotNegative);
            return Err(InputError::number(argument, None, duration, rule));
        }
        let actuation = self.integration.actuation.as_ref();
        if duration > 0.0 && actuation.is_some_and(|a| a.tendons().have_losses()) {
            return Err(InputError::other(
                "no motion takes a clearance in the holes or a compliance of the mount",
            ));
        }
        let engine = &mut *self.engine;
        let (reached, stop) = self.integration.advance(engine, duration, load, base);
        self.time += reached;
        Ok((stop, self.integration.count))
    }

    /// Time since the start (s).
    pub fn time(&self) -> f64 {
        self.time
    }

    /// Next step (s).
    pub fn next_step(&self) -> f64 {
        self.integration.next
    }

    /// Present energies.
    pub fn energies(&self) -> &Energies {
        &self.engine.energies().now
    }

    /// Position of the tip (m).
    pub fn tip(&self) -> Vec3 {
        self.engine.disk(self.robot.module_count() - 1)
    }

    /// Linear momentum (kg m/s).
    pub fn linear_momentum(&self) -> Vec3 {
        self.engine.linear_momentum()
    }

    /// Appends all present fields, with `points` points in a module.
    pub fn record(&mut self, points: usize, fields: &mut Fields) {
        let time = self.time;
        let now = self.integration.values();
        let Some(actuation) = &self.integration.actuation else {
            return self.engine.record(time, now, points, fields);
        };
        // values of the last step, except where a jump has set them
        let commands = actuation.commands.iter().zip(now).enumerate();
        let tensions: Vec<_> = commands
            .map(|(i, (command, now))| match command {
                Command::Tension(_) => *now,
                Command::Displacement(_) => actuation.tension(i),
            })
            .collect();
        self.engine.record(time, &tensions, points, fields);
        let (n, m) = (self.robot.module_count(), now.len());
        fields
            .tendons
            .displacement
            .extend((0..m).map(|i| actuation.displacement(i)));
        fields.tendons.slack.extend(&actuation.slack);
        let span_tensions = &mut fields.tendons.span_tension;
        let first = span_tensions.len();
        span_tensions.resize(first + n * m, f64::NAN);
        for (i, tendon) in self.robot.spec().tendons.iter().enumerate() {
            for (k, span) in actuation.spans(i).take(tendon.end_disk + 1).enumerate() {
                span_tensions[first + k * m + i] = span;
            }
        }
    }
}

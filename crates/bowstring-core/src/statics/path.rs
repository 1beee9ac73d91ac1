//! Paths of equilibria of a robot with tendons under tension and displacement control, with axial
//! compliance, slack and friction. The laws are those of `crate::tendon`.
//!
//! Theory: docs/theory/actuation.md.

use crate::dispatch;
#[cfg(target_arch = "x86_64")]
use crate::lanes::paths::{paths_side_by_side, LanePath, LaneState, PathsSideBySide};
use crate::math::linalg::Vec3;
use crate::model::error::InputError;
use crate::model::load::{Load, Model, LEVELS};
use crate::model::robot::Robot;
pub use crate::outcome::PathOutcome;
use crate::rod::estimate::ErrorEstimate;
use crate::statics::adaptive::with_elements;
use crate::statics::inelastic::{at_points_of, Inelasticity, UnloadedCurvature};
use crate::statics::path_step::PathStep;
use crate::statics::relaxation::CreepingTendons;
use crate::statics::solver::{Solver, Status};
pub use crate::tendon::{Command, History, Line};
use crate::tendon::{Slip, Tendons, Transmission, TERMS};

/// The same path with other elements: see `crate::statics::companion`.
#[derive(Clone)]
pub(super) struct Companion {
    pub path: PathSolver,
    /// Stated error of the state from which it started.
    pub inherited: ErrorEstimate,
}

/// A robot that is actuated through its tendons, along a path of equilibria.
#[derive(Clone)]
pub struct PathSolver {
    pub(super) last: PathStep,
    /// Whether elements are chosen step by step.
    pub(super) automatic: bool,
    /// State in the home pose, before any friction.
    pub(super) home: History,
    pub(super) laws: Inelasticity,
    /// Time from each step to the next, and time that passed in steps without a solution (s).
    pub(super) duration: f64,
    pub(super) waited: f64,
    /// Number of unknowns of a step already checked to fit into memory.
    fitting: usize,
    /// Stated error of the last step.
    pub(super) remembered: ErrorEstimate,
    /// The same path with other elements, where a memory carries errors from step to step; none
    /// before the first step.
    pub(super) companion: Option<Box<Companion>>,
    /// Whether it takes a companion; false for companions.
    pub(super) accompanied: bool,
}

impl PathSolver {
    /// As for [`Solver::new`], with one line for each tendon. Without a number of elements they are
    /// chosen step by step, and never reduced along a path.
    pub fn new(
        robot: &Robot,
        model: Model,
        elements: impl Into<Option<usize>>,
        lines: &[Line],
    ) -> Result<Self, InputError> {
        let given = elements.into();
        let elements = given.unwrap_or(1);
        dispatch::check_path(robot, elements, 0, 1)?;
        let mut transmission = Transmission::new(robot, model, lines)?;
        let mut solver = Solver::new(robot, model, elements)?;
        // home: pretension only, no load
        let tensions: Vec<_> = lines.iter().map(|line| line.pretension).collect();
        let load = Load {
            tensions: &tensions,
            ..Load::default()
        };
        let outcome = solver.solve(&load)?;
        if outcome.status != Status::Converged {
            return Err(InputError::other(format!(
                "there is no home pose: under the pretension alone the robot has no stable \
                 equilibrium ({})",
                outcome.status.word()
            )));
        }
        solver.engine.measure_spans(false);
        let mut strain = vec![Vec3::zero(); 2 * elements * robot.module_count()];
        solver.engine.strains(&mut |i, w| strain[i] = w);
        Ok(PathSolver {
            home: transmission.tendons.set_home(&*solver.engine, strain),
            last: PathStep::new(solver, transmission),
            laws: Inelasticity::default(),
            duration: 0.0,
            waited: 0.0,
            automatic: given.is_none(),
            fitting: 0,
            remembered: ErrorEstimate::default(),
            companion: None,
            accompanied: true,
        })
    }

    /// The same with inelastic backbone and tendons.
    ///
    /// # Errors
    /// If a law is out of range, or a section of an inelastic backbone has coupled strains.
    pub fn with_inelasticity(mut self, laws: &Inelasticity) -> Result<Self, InputError> {
        let unloaded = UnloadedCurvature::new(self.robot(), self.solver().elements(), laws)?;
        if let Some(unloaded) = &unloaded {
            self.home.plays.clone_from(&unloaded.plays);
            self.home.lags.clone_from(&unloaded.lags);
        }
        let creep = CreepingTendons::new(self.tendons(), &laws.creep)?;
        if creep.is_some() {
            self.home.crept = vec![[0.0; TERMS]; self.robot().tendon_count()];
        }
        self.last.unloaded = unloaded;
        self.last.creep = creep;
        self.laws = laws.clone();
        self.reset();
        Ok(self)
    }

    /// The same without a companion, where stated errors are not needed: with a memory a third of
    /// the work.
    pub fn alone(mut self) -> Self {
        self.accompanied = false;
        self
    }

    /// Sets the time from each step to the next (s), for relaxation and creep; zero by default.
    ///
    /// # Errors
    /// If it is negative or not finite.
    pub fn set_duration(&mut self, duration: f64) -> Result<(), InputError> {
        if !(duration >= 0.0 && duration.is_finite()) {
            return Err(InputError::other(format!(
                "the time from row to row is {duration} s; it must be finite and >= 0 s"
            )));
        }
        self.duration = duration;
        Ok(())
    }

    /// The actuated robot.
    pub fn robot(&self) -> &Robot {
        self.last.solver.robot()
    }

    /// The solver, for poses and lengths of the last step.
    pub fn solver(&self) -> &Solver {
        &self.last.solver
    }

    pub(crate) fn transmission(&self) -> &Transmission {
        &self.last.transmission
    }

    pub(super) fn tendons(&mut self) -> &mut Tendons {
        &mut self.last.transmission.tendons
    }

    /// State of the tendons after the last step.
    pub fn history(&self) -> &History {
        &self.last.transmission.tendons.now
    }

    /// Returns to the home pose and discards the path.
    pub fn reset(&mut self) {
        self.last.solver.unsettle();
        let home = self.home.clone();
        self.last.begin(&home, 0.0);
        self.waited = 0.0;
        let tendons = self.tendons();
        tendons.slack.fill(0.0);
        tendons.now = home;
        self.remembered = ErrorEstimate::default();
        if let Some(companion) = &mut self.companion {
            companion.path.reset();
            companion.inherited = ErrorEstimate::default();
        }
    }

    /// Continues another path from its last state; its commands and loads are those from which the
    /// next step starts.
    pub fn resume(
        &mut self,
        tensions: &[f64],
        drops: &[f64],
        spans: &[f64],
        commands: &[Command],
        load: &Load,
    ) -> Result<(), InputError> {
        let tendons = &self.last.transmission.tendons;
        let (n, m) = (self.robot().module_count(), tendons.lines.len());
        let numbers = tensions.iter().chain(drops).chain(spans);
        if tensions.len() != m
            || commands.len() != m
            || drops.len() != n * m
            || spans.len() != n * m
            || !numbers.into_iter().all(|v| v.is_finite())
            || self.robot().check_tensions(tensions).is_err()
        {
            return Err(InputError::other(
                "the history does not belong to this robot",
            ));
        }
        tendons.check(self.robot(), commands, load)?;
        for at in 0..n * m {
            let most = tendons.lines[at % m].friction_bound(at / m, std::f64::consts::PI);
            if drops[at].abs() > 1e-12 + most * (1.0 + 1e-9) {
                return Err(InputError::other(format!(
                    "the history is damaged: the tension of tendon {} drops more at a hole than friction allows",
                    at % m + 1
                )));
            }
        }
        self.companion = None;
        self.reset();
        // the pose is an equilibrium for the history's own tensions: solve for it again
        let now = &mut self.tendons().now;
        now.tensions.copy_from_slice(tensions);
        now.drops.copy_from_slice(drops);
        now.spans.copy_from_slice(spans);
        now.commands.copy_from_slice(commands);
        now.load.set_dead(load);
        self.tendons().note_displacements();
        Ok(())
    }

    /// Whether steps can be taken in lanes: with one element in a module, without a memory, without
    /// tensions that only regularisation determines, without losses of displacement, and without
    /// coupled sections.
    #[cfg(target_arch = "x86_64")]
    pub(crate) fn suits_lanes(&self) -> bool {
        let plain = self.solver().elements() == 1 && !self.robot().is_coupled();
        let tendons = &self.transmission().tendons;
        plain && !self.has_memory() && !tendons.is_rigid() && !tendons.have_losses()
    }

    /// Lanes for paths of robots with the topology of this one, where the processor has them, at its
    /// last state.
    #[cfg(target_arch = "x86_64")]
    pub(crate) fn side_by_side(&self) -> Option<Box<dyn PathsSideBySide>> {
        if self.solver().elements() != 1 {
            return None;
        }
        let mut lanes = paths_side_by_side(self.robot(), self.solver().model())?;
        lanes.set_paths(&[self.in_lane()]);
        Some(lanes)
    }

    /// Its robot and last state, for a lane.
    #[cfg(target_arch = "x86_64")]
    pub(crate) fn in_lane(&self) -> LanePath<'_> {
        let (tendons, last) = (&self.transmission().tendons, self.history());
        LanePath {
            robot: self.robot(),
            automatic: self.is_automatic(),
            home: &tendons.home,
            compliance: (0..tendons.home.len())
                .map(|i| tendons.whole_compliance(i))
                .collect(),
            strain: &last.strain,
            tensions: &last.tensions,
            displacements: &last.displacements,
        }
    }

    /// Continues from a step without friction that was taken elsewhere, by its strain, tensions (N)
    /// and displacements (m).
    #[cfg(target_arch = "x86_64")]
    pub(crate) fn continue_from(&mut self, step: &LaneState, commands: &[Command], load: &Load) {
        let now = &mut self.tendons().now;
        now.strain.copy_from_slice(&step.strain);
        now.tensions.copy_from_slice(&step.tensions);
        now.displacements.copy_from_slice(&step.displacements);
        now.commands.copy_from_slice(commands);
        now.load.set_dead(load);
    }

    /// Whether equilibria depend on the path: with friction, backlash, hysteresis, relaxation or
    /// creep.
    pub fn has_memory(&self) -> bool {
        self.last.has_memory()
    }

    /// Slack length of each tendon (m); zero where it is taut.
    pub fn slack(&self) -> &[f64] {
        &self.last.transmission.tendons.slack
    }

    /// Displacement of a tendon from the home pose (m).
    pub fn displacement(&self, i: usize) -> f64 {
        self.history().displacements[i]
    }

    /// Tension of a span (N).
    pub fn span_tension(&self, k: usize, i: usize) -> f64 {
        self.solver().engine.span_tension(k, i)
    }

    /// Whether elements are chosen step by step.
    pub(crate) fn is_automatic(&self) -> bool {
        self.automatic
    }

    /// Checks that copies for independent steps fit into memory.
    ///
    /// # Errors
    /// If they do not.
    pub fn check_copies(&self, copies: usize) -> Result<(), InputError> {
        let unknowns = self.robot().tendon_count() + self.transmission().most_holes();
        dispatch::check_path(self.robot(), self.solver().elements(), unknowns, copies)
    }

    /// Checks the numbers of a step, and that its unknowns fit into memory.
    ///
    /// # Errors
    /// If a number does not fit the robot, or the unknowns do not fit into memory.
    pub fn check(&mut self, commands: &[Command], load: &Load) -> Result<(), InputError> {
        let transmission = self.transmission();
        transmission.tendons.check(self.robot(), commands, load)?;
        // the load changes from that of the last step
        load.check_sections(self.robot(), &self.history().load.point_loads)?;
        if !self.automatic {
            let (robot, elements) = (self.robot(), self.solver().elements());
            load.check_elements_beside(robot, elements, &self.history().load.point_loads)?;
        }
        let by_displacement = commands.iter().filter(|c| c.is_displacement());
        let unknowns = by_displacement.count() + transmission.most_holes();
        if unknowns > self.fitting {
            dispatch::check_path(self.robot(), self.solver().elements(), unknowns, 1)?;
            self.fitting = unknowns;
        }
        Ok(())
    }

    /// One step from `old`, the present state.
    pub(super) fn solve(
        &mut self,
        old: &History,
        commands: &[Command],
        load: &Load,
    ) -> PathOutcome {
        self.last.begin(old, self.waited + self.duration);
        self.last.solve(old, commands, load)
    }

    /// The same robot at `now` with other elements; `None` where its home pose does not converge.
    pub(super) fn with_elements(&self, elements: usize, now: &History) -> Option<PathSolver> {
        let (solver, lines) = (self.solver(), &self.transmission().tendons.lines);
        let mut other = PathSolver::new(self.robot(), solver.model(), elements, lines)
            .and_then(|other| other.with_inelasticity(&self.laws))
            .ok()?;
        other.automatic = self.automatic;
        other.accompanied = self.accompanied;
        dispatch::check_path(self.robot(), elements, self.fitting, 1).ok()?;
        other.fitting = self.fitting;
        other.remembered = self.remembered;
        (other.duration, other.waited) = (self.duration, self.waited);
        let [from, to] = [solver.elements(), elements];
        let strain = with_elements(now.strain.clone(), from, to);
        let mut lags = vec![[[0.0; 2]; TERMS]; other.history().lags.len()];
        for term in 0..TERMS {
            let own: Vec<_> = now.lags.iter().map(|lag| lag[term]).collect();
            for (lag, value) in lags.iter_mut().zip(at_points_of(&own, from, to)) {
                lag[term] = value;
            }
        }
        other.tendons().now = History {
            strain,
            plays: at_points_of(&now.plays, from, to),
            lags,
            ..now.clone()
        };
        other.last.settle_spans();
        Some(other)
    }
}

/// What inelastic backbone and tendons remember, of a stored history.
#[derive(Clone, Copy, Debug, Default)]
pub struct Memory<'a> {
    /// [`History::plays`].
    pub plays: &'a [[f64; 2]],
    /// [`History::lags`].
    pub lags: &'a [[[f64; 2]; TERMS]],
    /// [`History::crept`].
    pub crept: &'a [[f64; TERMS]],
    /// [`PathSolver::remembered`].
    pub error: ErrorEstimate,
    /// [`PathSolver::waited`].
    pub waited: f64,
}

/// Start of the next step, for a stored history.
impl PathSolver {
    /// Largest estimated error of the steps so far.
    pub fn remembered(&self) -> ErrorEstimate {
        self.remembered
    }

    /// Time that passed in steps without a solution since the last one with (s).
    pub fn waited(&self) -> f64 {
        self.waited
    }

    /// Strain of the backbone.
    pub fn strain(&self) -> Vec<[f64; 3]> {
        self.history().strain.iter().map(|w| w.0).collect()
    }

    /// Slip of each tendon at each hole, by modules and tendons: towards the base (1), away from it
    /// (-1) or sticking (0).
    pub fn slips(&self) -> Vec<i8> {
        self.history().slip.iter().map(|slip| *slip as i8).collect()
    }

    /// Sets the start of the next step from [`PathSolver::strain`], [`PathSolver::slips`], and
    /// [`History::plays`], [`History::lags`] and [`History::crept`], after [`PathSolver::resume`].
    ///
    /// # Errors
    /// If it does not fit the robot and its elements, or is not finite.
    pub fn start_from(
        &mut self,
        strain: &[[f64; 3]],
        slips: &[i8],
        memory: Memory,
    ) -> Result<(), InputError> {
        let Memory {
            plays,
            lags,
            crept,
            error,
            waited,
        } = memory;
        let lagging = lags.as_flattened().as_flattened();
        let curvatures = plays.as_flattened().iter().chain(lagging);
        let numbers = strain.as_flattened().iter().chain(curvatures);
        let mut numbers = numbers.chain(crept.as_flattened());
        let finite = numbers.all(|w| w.is_finite());
        let sizes = [error.tip, error.tension, waited];
        let finite = finite && waited.is_finite() && sizes.iter().all(|x| *x >= 0.0);
        let (n, now) = (self.robot().module_count(), self.history().clone());
        let elements = LEVELS.into_iter().find(|e| 2 * e * n == strain.len());
        if let (true, Some(elements)) = (self.automatic, elements) {
            if elements > self.solver().elements() {
                if let Some(mut finer) = self.with_elements(elements, &now) {
                    // they are those of the stored elements
                    finer.tendons().now.spans.clone_from(&now.spans);
                    *self = finer;
                }
            }
        }
        let now = &mut self.tendons().now;
        let lengths = [
            strain.len(),
            slips.len(),
            plays.len(),
            lags.len(),
            crept.len(),
        ];
        let own = [
            now.strain.len(),
            now.slip.len(),
            now.plays.len(),
            now.lags.len(),
            now.crept.len(),
        ];
        if lengths != own || !finite {
            return Err(InputError::other(
                "the history does not belong to this robot",
            ));
        }
        now.plays.copy_from_slice(plays);
        now.lags.copy_from_slice(lags);
        now.crept.copy_from_slice(crept);
        for (to, from) in now.strain.iter_mut().zip(strain) {
            *to = Vec3(*from);
        }
        for (to, from) in now.slip.iter_mut().zip(slips) {
            *to = match from.signum() {
                1 => Slip::Towards,
                -1 => Slip::Away,
                _ => Slip::Sticks,
            };
        }
        (self.remembered, self.waited) = (error, waited);
        self.companion = None;
        let now = self.history().clone();
        self.last.begin(&now, 0.0);
        self.last.measure_losses(&now);
        self.tendons().note_displacements();
        Ok(())
    }
}

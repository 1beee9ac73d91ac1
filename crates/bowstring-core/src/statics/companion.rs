//! Steps of a path with their stated errors: where it has a memory, from the same path with other
//! elements beside it.
//!
//! What a path with friction, a set or creep remembers has errors too, which enter the next step.
//! No estimate of one step contains them. The companion takes every step from its own state, and
//! the differences of both paths are their errors (Richardson extrapolation).
//!
//! Theory: docs/theory/actuation.md (Stated errors of a path).

use crate::criteria::is_near;
use crate::interrupt;
use crate::model::error::InputError;
use crate::model::load::{Load, LEVELS};
use crate::outcome::PathOutcome;
use crate::rod::estimate::ErrorEstimate;
use crate::statics::path::{Companion, PathSolver};
use crate::statics::solver::Status;
use crate::tendon::{Command, History};

/// Stated error over the difference from a path with twice as many elements, and from one with half
/// as many, over the safety factor of the verdict. Elements are of fourth order, so that these
/// differences are 15/16 and 15 times the error; stick and slip make single steps differ.
const OVER_FINER: f64 = 2.0 / 3.0;
const OVER_COARSER: f64 = 0.25 / 3.0;
/// Factor with hysteresis, whose plays turn at other steps at each Gauss point: the order of its
/// errors is lower. Measured against eight elements.
const WITH_HYSTERESIS: f64 = 2.0;
/// Error of the state of a path with twice as many elements, over the stated error.
const OF_FINER: f64 = 0.125;

impl PathSolver {
    /// Equilibrium under commands and load, one step of the path from the last.
    ///
    /// # Errors
    /// If a number does not fit the robot.
    pub fn step(&mut self, commands: &[Command], load: &Load) -> Result<PathOutcome, InputError> {
        self.check(commands, load)?;
        let given = commands;
        let commands = &self.transmission().tendons.driven(commands);
        let load = &self.solver().settings.without_negligible(load);
        let mut iterations = 0;
        let last = &self.history().load.point_loads;
        let least = load.least_elements_beside(self.robot(), last);
        if self.solver().elements() < least {
            let Some(finer) = self.with_elements(least, self.history()) else {
                return Ok(PathOutcome::pending());
            };
            *self = finer;
        }
        loop {
            let _bounded = interrupt::bounded(self.last.most_work());
            let old = self.history().clone();
            self.accompany(least);
            let mut outcome = self.solve(&old, commands, load);
            iterations += outcome.iterations;
            let mut converged = outcome.status == Status::Converged;
            if converged {
                let (needed, before) = self.state_error(&mut outcome, given, load);
                if let Some(finer) = self.finer(needed, &old, before) {
                    *self = finer;
                    continue;
                }
            }
            outcome.iterations = iterations;
            if outcome.error.is_some_and(|error| !error.is_bound()) {
                (outcome.status, outcome.stable) = (Status::MaxIterations, None);
                outcome.error = None;
                converged = false;
                self.companion = None;
            }
            if let Some(error) = outcome.error {
                self.remembered = error;
            }
            if converged {
                self.waited = 0.0;
            } else {
                self.waited += self.duration;
                self.return_to(old, &mut outcome, commands, load);
            }
            return Ok(outcome);
        }
    }

    /// After a step without a solution: returns to `old`, and finds the nearest feasible
    /// displacements.
    fn return_to(
        &mut self,
        old: History,
        outcome: &mut PathOutcome,
        commands: &[Command],
        load: &Load,
    ) {
        self.tendons().now = old;
        let by_displacement = commands.iter().any(|c| c.is_displacement());
        if by_displacement && outcome.status != Status::NoEquilibrium && !interrupt::interrupted() {
            if let Some(nearest) = self.last.nearest(&self.home, commands, load) {
                outcome.status = Status::NoEquilibrium;
                outcome.opposing = nearest.opposing;
                outcome.nearest = Some(nearest.displacements);
            }
        }
        self.last.solver.unsettle();
        self.tendons().slack.fill(f64::NAN);
    }

    /// The same robot with more elements, where a step from `old` needs them: from the state
    /// `before` of the companion, if that has more elements.
    fn finer(
        &mut self,
        needed: usize,
        old: &History,
        before: Option<History>,
    ) -> Option<PathSolver> {
        let enough = needed == self.solver().elements();
        if enough || !self.automatic || interrupt::interrupted() {
            return None;
        }
        if let Some(finer) = self.promoted(needed, before) {
            return Some(finer);
        }
        let mut finer = self.with_elements(needed, old)?;
        finer.companion = None;
        Some(finer)
    }

    /// Takes a companion from the present state, if the path has a memory; with `least` elements or
    /// more.
    fn accompany(&mut self, least: usize) {
        if !(self.accompanied && self.has_memory()) {
            return;
        }
        let elements = match self.solver().elements() {
            elements if 2 * elements > LEVELS[LEVELS.len() - 1] => elements / 2,
            elements => 2 * elements,
        };
        let elements_of = |companion: &Companion| companion.path.solver().elements();
        if self.companion.as_deref().map(elements_of) == Some(elements) {
            return;
        }
        self.companion = None;
        if elements < least {
            return;
        }
        let now = self.history().clone();
        if let Some(mut path) = self.with_elements(elements, &now) {
            path.automatic = false;
            path.accompanied = false;
            self.companion = Some(Box::new(Companion {
                path,
                inherited: self.remembered,
            }));
        }
    }

    /// States the error of a converged step, and returns the elements that the tolerances need, with
    /// the state of the companion before the step.
    fn state_error(
        &mut self,
        outcome: &mut PathOutcome,
        commands: &[Command],
        load: &Load,
    ) -> (usize, Option<History>) {
        let remembered = self.remembered;
        let Some(mut companion) = self.companion.take() else {
            return (self.last.estimate_error(outcome, None, &remembered), None);
        };
        let before = companion.path.history().clone();
        (companion.path.duration, companion.path.waited) = (self.duration, self.waited);
        let commands = companion.path.tendons().driven(commands);
        let found = companion.path.solve(&before, &commands, load);
        if found.status != Status::Converged {
            // with other elements there is no solution: the next step starts with a new companion
            return (self.last.estimate_error(outcome, None, &remembered), None);
        }
        let mut differences = self.differences(&companion.path);
        let (own, other) = (self.solver().elements(), companion.path.solver().elements());
        let apart = ErrorEstimate {
            tip: differences[0],
            tension: differences[1],
        };
        // paths on two branches say nothing of their order
        let near = is_near(&apart, Some(true), self.robot().length());
        let share = if other < own && near {
            OVER_COARSER
        } else {
            OVER_FINER
        };
        let hysteresis = (self.laws.hysteresis.iter()).any(|law| law.share > 0.0);
        let factor = if hysteresis { WITH_HYSTERESIS } else { 1.0 };
        differences = differences.map(|x| factor * share * x);
        let needed = self
            .last
            .estimate_error(outcome, Some(differences), &companion.inherited);
        self.companion = Some(companion);
        (needed, Some(before))
    }

    /// Largest distance of a disk (m) and of a tension (N) between two paths.
    fn differences(&self, other: &PathSolver) -> [f64; 2] {
        let (own, others) = (&self.solver().engine, &other.solver().engine);
        let apart = |k| (own.disk(k).position - others.disk(k).position).norm();
        let tensions = self.history().tensions.iter();
        let changes = tensions.zip(&other.history().tensions);
        let largest = |a: f64, x: f64| if x > a || x.is_nan() { x } else { a };
        [
            (0..self.robot().module_count())
                .map(apart)
                .fold(0.0, largest),
            changes.map(|(a, b)| (a - b).abs()).fold(0.0, largest),
        ]
    }

    /// The path of the companion with `needed` elements, from its state `before` the step, if it has
    /// more elements than this.
    fn promoted(&mut self, needed: usize, before: Option<History>) -> Option<PathSolver> {
        let (companion, before) = (self.companion.take()?, before?);
        let mut path = companion.path;
        if path.solver().elements() < self.solver().elements() {
            return None;
        }
        if path.solver().elements() < needed {
            path = path.with_elements(needed, &before)?;
        } else {
            path.tendons().now = before;
        }
        path.automatic = self.automatic;
        path.accompanied = self.accompanied;
        path.remembered = companion.inherited.at_least(OF_FINER, &self.remembered);
        (path.duration, path.waited) = (self.duration, self.waited);
        Some(path)
    }
}

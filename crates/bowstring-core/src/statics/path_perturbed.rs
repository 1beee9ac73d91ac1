//! Perturbed paths: the same rows for slightly other numbers of robot, laws or commands, for
//! derivatives by differences.
//!
//! A step is solved with the tangent of the nominal path, and the same holes stick and the same
//! tendons are slack: so differences are smooth, and cost a few evaluations of the rod.
//!
//! Theory: docs/theory/actuation.md (Derivatives along a path).

use super::path_step::PathStep;
use crate::criteria::{LOOSE, MAX_STEP, NEGLIGIBLE, TOLERANCE};
use crate::math::linalg::Vec3;
use crate::model::error::InputError;
use crate::model::load::Load;
use crate::outcome::PathOutcome;
use crate::statics::path::PathSolver;
use crate::statics::solver::Status;
use crate::tendon::{Command, History};
use std::mem::swap;

/// Most iterations with the nominal tangent; with friction they take about six.
const MAX_ITERATIONS: usize = 30;

impl PathSolver {
    /// One step beside the last one of the nominal path, which was linearised; as
    /// [`PathSolver::step`] where the two differ in more than numbers, or where that fails.
    ///
    /// # Errors
    /// As [`PathSolver::step`].
    pub(super) fn step_perturbed(
        &mut self,
        nominal: &mut PathSolver,
        commands: &[Command],
        load: &Load,
    ) -> Result<PathOutcome, InputError> {
        if self.is_alike(nominal) {
            let old = self.history().clone();
            let driven = self.transmission().tendons.driven(commands);
            let load = self.solver().settings.without_negligible(load);
            self.last.begin(&old, self.waited + self.duration);
            let last = &mut nominal.last;
            let found = self.last.solve_perturbed(last, &old, &driven, &load);
            if found.status == Status::Converged {
                self.waited = 0.0;
                return Ok(found);
            }
            self.tendons().now = old;
        }
        self.step(commands, load)
    }

    /// Whether another path has the same unknowns in each step.
    fn is_alike(&self, other: &PathSolver) -> bool {
        let [own, others] = [self, other].map(|path| &path.transmission().tendons.lines);
        let mut lines = own.iter().zip(others);
        self.history().is_alike(other.history())
            && lines.all(|(a, b)| (a.friction > 0.0) == (b.friction > 0.0))
    }

    /// Lets the time of a step without a solution pass (s).
    pub(super) fn wait(&mut self, duration: f64) {
        self.waited += duration;
    }
}

impl PathStep {
    /// Linearises the solution of a step from `old`, for perturbed paths.
    pub fn linearise(&mut self, old: &History) {
        let engine = &mut *self.solver.engine;
        self.imbalance.resize(old.strain.len(), Vec3::zero());
        let imbalance = &mut self.imbalance;
        // the stored gradient may be the right-hand side of a step
        engine.evaluate();
        engine.gradient();
        engine.gradients(&mut |i, g| imbalance[i] = g);
        engine.linearise();
        engine.eliminate(engine.has_potential(), 0.0);
        // holes that slip are no unknowns
        self.transmission.friction.restart();
        self.transmission.gather(engine, old, 0.0, false);
    }

    /// One implicit step from `old` after `begin`: from the solution of the nominal path, with its
    /// tangent.
    fn solve_perturbed(
        &mut self,
        nominal: &mut PathStep,
        old: &History,
        commands: &[Command],
        load: &Load,
    ) -> PathOutcome {
        self.start(old, commands, load);
        self.start_at(&nominal.transmission.tendons.now);
        // unknowns, columns and matrix are the nominal ones
        let own = &mut self.transmission.unknowns;
        swap(own, &mut nominal.transmission.unknowns);
        let outcome = self.iterate(nominal, old);
        let own = &mut self.transmission.unknowns;
        swap(own, &mut nominal.transmission.unknowns);
        match outcome.status {
            Status::Converged => self.finish(outcome, load),
            _ => outcome,
        }
    }

    /// Moves strain, unknowns and slip to those of another state.
    pub(super) fn start_at(&mut self, at: &History) {
        let tendons = &mut self.transmission.tendons;
        for (i, command) in tendons.now.commands.iter().enumerate() {
            if command.is_displacement() {
                tendons.now.tensions[i] = at.tensions[i];
            }
        }
        let count = tendons.lines.len();
        for k in 0..at.drops.len() {
            if tendons.lines[k % count].friction > 0.0 {
                (tendons.now.drops[k], tendons.now.slip[k]) = (at.drops[k], at.slip[k]);
            }
        }
        (0..tendons.lines.len()).for_each(|i| tendons.carry(i));
        let engine = &mut *self.solver.engine;
        engine.set_strains(&|i| at.strain[i]);
        tendons.apply(engine);
        self.clear_acceleration();
    }

    /// Chord iteration with the tangent of the nominal path.
    fn iterate(&mut self, nominal: &mut PathStep, old: &History) -> PathOutcome {
        let mut outcome = PathOutcome::pending();
        let mut gradient = vec![Vec3::zero(); old.strain.len()];
        while outcome.iterations < MAX_ITERATIONS {
            self.follow_strain(old);
            let engine = &mut *self.solver.engine;
            if !engine.evaluate().is_finite() {
                break;
            }
            let friction = self.transmission.friction.enabled;
            engine.measure_spans(friction);
            if friction {
                self.transmission
                    .keep_friction(engine, old, &nominal.transmission);
                engine.balance();
            }
            self.transmission.tendons.measure(engine);
            let engine = &mut *self.solver.engine;
            engine.gradient();
            // what is left of the nominal imbalance cancels in the difference
            engine.gradients(&mut |i, g| gradient[i] = g - nominal.imbalance[i]);
            let largest = gradient.iter().fold(0.0, |m, g| f64::max(m, g.max_abs()));
            let robot = self.solver.robot();
            let (scale, length) = (robot.moment_scale(), robot.length());
            let last = std::mem::replace(&mut outcome.residual, largest / scale);
            // a tendon whose slack is zero may become too short: the derivative is one-sided
            outcome.length_residual = self.transmission.tendons.kept_residual(old);
            let stalls = outcome.residual <= TOLERANCE && outcome.residual > 0.5 * last;
            // the first iteration finds effects below the tolerance
            if (outcome.residual <= NEGLIGIBLE || stalls)
                && outcome.length_residual <= LOOSE * length
                && outcome.iterations > 0
            {
                outcome.status = Status::Converged;
                break;
            }
            let rod = &mut *nominal.solver.engine;
            rod.set_gradient(&|i| gradient[i]);
            let largest = if self.transmission.unknowns.is_empty() {
                rod.newton_step(rod.has_potential()).largest
            } else {
                if !self.transmission.solve_kept(rod, old) {
                    break;
                }
                rod.combine(self.transmission.coefficients())
            };
            if !(largest <= MAX_STEP) {
                break;
            }
            self.advance_by(rod);
            outcome.iterations += 1;
        }
        outcome
    }
}

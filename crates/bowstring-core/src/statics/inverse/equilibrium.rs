//! Equilibria of the iteration: the present point, trials near it, and more elements.

use super::task::{norm, residual, Task};
use super::InverseSolver;
use crate::dispatch::Plain;
use crate::interrupt;
use crate::math::linalg::Vec3;
use crate::model::error::InputError;
use crate::model::load::Load;
use crate::rod::estimate::LEVELS;
use crate::statics::adaptive::refine_to;
use crate::statics::outcome::{Outcome, Status};
use crate::statics::solver::{Solver, MAX_EXTRAPOLATION};

/// A solver with the rod that differentiates its tip.
pub(super) struct Level {
    pub solver: Solver,
    pub plain: Box<dyn Plain>,
}

/// Tensions with their equilibrium. Lengths are over that of the robot, tensions over the unit of
/// tension.
#[derive(Clone)]
pub(super) struct Point {
    pub tensions: Vec<f64>,
    pub strain: Vec<Vec3>,
    pub residual: [f64; 6],
    /// Norm of the residual.
    pub size: f64,
    pub level: usize,
    pub outcome: Outcome,
}

impl InverseSolver {
    pub(super) fn first_level(&self, load: &Load) -> usize {
        let least = match self.model.elements {
            Some(elements) => elements,
            None => load.least_elements(&self.robot),
        };
        LEVELS.iter().position(|e| *e >= least).unwrap_or(3)
    }

    /// # Errors
    /// If the solver does not fit into memory.
    pub(super) fn at(&mut self, elements: usize) -> Result<usize, InputError> {
        let Some(level) = LEVELS.iter().position(|e| *e == elements) else {
            return Err(InputError::elements(elements));
        };
        if self.levels[level].is_none() {
            let solver = Solver::new(&self.robot, self.model.model, elements)?;
            let plain = solver.empty_plain();
            self.levels[level] = Some(Box::new(Level { solver, plain }));
        }
        Ok(level)
    }

    pub(super) fn level(&mut self) -> &mut Level {
        let level = self.levels[self.point.level].as_mut();
        level.expect("the level of a point was made")
    }

    /// Takes the last solution to other loads, limits and another target.
    pub(super) fn resume(&mut self, load: &Load, task: &Task) -> bool {
        let now = self.load.borrow();
        let mut same = Load {
            tensions: now.tensions,
            ..*load
        } == now;
        self.load.set_dead(load);
        let bounds = task.lower.iter().zip(&task.upper);
        for (tension, (lower, upper)) in self.point.tensions.iter_mut().zip(bounds) {
            let within = tension.max(*lower).min(*upper);
            same &= within == *tension;
            *tension = within;
        }
        if !same {
            self.linearised = false;
            if !self.settle(false) {
                return false;
            }
        }
        self.measure(task)
    }

    /// Sets the residual of the point to that of the solver's equilibrium.
    pub(super) fn measure(&mut self, task: &Task) -> bool {
        let Some(tip) = self.level().solver.tip() else {
            return false;
        };
        self.point.residual = residual(&tip, &task.target, self.length);
        self.point.size = norm(&self.point.residual[..task.rows]);
        true
    }

    pub(super) fn keep_strain(&mut self) {
        let Point { strain, level, .. } = &mut self.point;
        let of = self.levels[*level].as_ref().expect("it has solved");
        let arcs = 2 * LEVELS[*level] * self.robot.module_count();
        strain.resize(arcs, Vec3::zero());
        of.solver.engine.strains(&mut |i, w| strain[i] = w);
    }

    /// Equilibrium of the point's tensions from its strain.
    pub(super) fn equilibrium(&mut self) -> Outcome {
        let Self {
            load, point, unit, ..
        } = self;
        load.tensions.clear();
        load.tensions
            .extend(point.tensions.iter().map(|t| t * *unit));
        let level = self.levels[point.level].as_mut();
        let solver = &mut level.expect("the level of a point was made").solver;
        solver.solve_from(Some(&point.strain), &load.borrow())
    }

    /// Equilibrium of the trial's tensions, from the strain of the point and its change to first
    /// order by the step.
    pub(super) fn trial_equilibrium(&mut self) -> Outcome {
        let Self {
            load,
            point,
            unit,
            trial,
            step,
            changes,
            strain,
            ..
        } = self;
        load.tensions.clear();
        load.tensions.extend(trial.iter().map(|t| t * *unit));
        changes.clear();
        changes.extend(step.iter().map(|t| t * *unit));
        let level = self.levels[point.level].as_mut();
        let Level { solver, plain } = &mut **level.expect("the level of a point was made");
        strain.clone_from(&point.strain);
        plain.add_strain_by_tensions(changes, strain);
        let moved = strain.iter().zip(&point.strain);
        let moved = moved.fold(0.0, |most: f64, (to, from)| {
            most.max((*to - *from).max_abs())
        });
        // a NaN is not small
        let start = if moved < MAX_EXTRAPOLATION {
            &*strain
        } else {
            &point.strain
        };
        solver.solve_from(Some(start), &load.borrow())
    }

    /// Makes the solver hold the equilibrium of the point; unless `holds`, it may hold another one of
    /// the same tensions.
    pub(super) fn settle(&mut self, holds: bool) -> bool {
        let unit = self.unit;
        let here = self.load.tensions.iter().zip(&self.point.tensions);
        let same = self.load.tensions.len() == self.point.tensions.len()
            && here.into_iter().all(|(load, t)| *load == t * unit);
        if holds && same && self.level().solver.tip().is_some() {
            return true;
        }
        let outcome = self.equilibrium();
        self.point.outcome = outcome;
        let converged = outcome.status == Status::Converged;
        if converged {
            self.keep_strain();
        }
        converged
    }

    /// Solves the point with more elements if its error needs them; false if it does not.
    pub(super) fn refine(&mut self, task: &Task) -> bool {
        let mut outcome = self.point.outcome;
        let needed = self.level().solver.estimate_error(&mut outcome);
        self.point.outcome = outcome;
        let elements = LEVELS[self.point.level];
        let Some(needed) = needed else { return false };
        if self.model.elements.is_some() || needed <= elements || interrupt::interrupted() {
            return false;
        }
        let Ok(level) = self.at(needed) else {
            // the coarse solution states its error, and is better than none
            return false;
        };
        let coarse = self.point.clone();
        self.point.strain = refine_to(coarse.strain.clone(), needed / elements);
        self.point.level = level;
        self.linearised = false;
        let outcome = self.equilibrium();
        if outcome.status != Status::Converged || !self.measure(task) {
            self.point = coarse;
            self.equilibrium();
            return false;
        }
        self.point.outcome = outcome;
        self.keep_strain();
        true
    }
}

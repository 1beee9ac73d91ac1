//! Equilibria of the iteration: the present point, trials near it, more and fewer elements.

use super::task::{norm, residual, Task};
use super::InverseSolver;
use crate::criteria::MAX_EXTRAPOLATION;
use crate::dispatch::Plain;
use crate::interrupt;
use crate::math::linalg::Vec3;
use crate::model::error::InputError;
use crate::model::load::{Load, Model, LEVELS};
use crate::model::robot::Robot;
use crate::outcome::{Outcome, Status};
use crate::rod::estimate::TIP_TOLERANCE;
use crate::statics::adaptive::refine_to;
use crate::statics::solver::Solver;

/// Share of the tolerance of the tip's error below which a path goes on with half the elements, and
/// range of the number of rows before it does.
const COARSENING: f64 = 0.5;
const LEAST_ROWS: usize = 4;
const MOST_ROWS: usize = 128;

/// A solver, and a rod in plain numbers that differentiates its tip where its own rod does not.
pub(super) struct Level {
    pub solver: Solver,
    plain: Box<dyn Plain>,
    /// Whether the last derivatives are those of the solver's own rod.
    in_lanes: bool,
}

impl Level {
    /// # Errors
    /// If the solver does not fit into memory.
    pub fn new(robot: &Robot, model: Model, elements: usize) -> Result<Self, InputError> {
        let solver = Solver::new(robot, model, elements)?;
        let plain = solver.empty_plain();
        Ok(Level {
            solver,
            plain,
            in_lanes: false,
        })
    }

    /// Derivatives of the tip's position and, if wanted, rotation by each tension at the last
    /// equilibrium; false where there are none.
    pub fn tip_by_tensions(&mut self, rotation: bool, columns: &mut [[Vec3; 2]]) -> bool {
        let Level {
            solver,
            plain,
            in_lanes,
        } = self;
        *in_lanes = solver.tip_by_tensions_in_lanes(columns);
        *in_lanes || solver.tip_by_tensions(&mut **plain, rotation, columns)
    }

    /// Adds the change of every arc's strain by changes of tension (N) to first order, after
    /// `tip_by_tensions`.
    pub fn add_strain_by_tensions(&self, changes: &[f64], strain: &mut [Vec3]) {
        if self.in_lanes {
            let engine = &self.solver.engine;
            engine.add_strain_of_responses(changes, strain);
        } else {
            self.plain.add_strain_by_tensions(changes, strain);
        }
    }
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
            let made = Level::new(&self.robot, self.model.model, elements)?;
            self.levels[level] = Some(Box::new(made));
        }
        Ok(level)
    }

    pub(super) fn level(&mut self) -> &mut Level {
        let level = self.levels[self.point.level].as_mut();
        level.expect("the level of a point was made")
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
    /// order by the step, if the derivatives are those of the point's elements.
    pub(super) fn trial_equilibrium(&mut self) -> Outcome {
        let Self {
            load,
            point,
            unit,
            trial,
            step,
            changes,
            strain,
            plain_level,
            ..
        } = self;
        load.tensions.clear();
        load.tensions.extend(trial.iter().map(|t| t * *unit));
        changes.clear();
        changes.extend(step.iter().map(|t| t * *unit));
        let level = self.levels[point.level].as_mut();
        let level = level.expect("the level of a point was made");
        strain.clone_from(&point.strain);
        if *plain_level == point.level {
            level.add_strain_by_tensions(changes, strain);
        }
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
        level.solver.solve_from(Some(start), &load.borrow())
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

    /// Estimates the discretisation error of the point; returns the elements that it needs.
    pub(super) fn estimate(&mut self) -> Option<usize> {
        let mut outcome = self.point.outcome;
        let needed = self.level().solver.estimate_error(&mut outcome);
        self.point.outcome = outcome;
        needed
    }

    /// Solves the point with more elements if its error needs them; false if it does not. The
    /// derivatives of the coarser elements are kept.
    pub(super) fn refine(&mut self, task: &Task) -> bool {
        let elements = LEVELS[self.point.level];
        let Some(needed) = self.estimate() else {
            return false;
        };
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
        let outcome = self.equilibrium();
        if outcome.status != Status::Converged || !self.measure(task) {
            self.point = coarse;
            self.equilibrium();
            return false;
        }
        self.point.outcome = outcome;
        self.keep_strain();
        // after coarser elements that were not fine enough, the next attempt is later
        self.rows_to_hold = match self.rows_refined {
            usize::MAX => usize::min(2 * self.rows_to_hold, MOST_ROWS),
            _ => LEAST_ROWS,
        };
        self.rows_refined = 0;
        true
    }

    /// Halves the elements of the point if the error would still be far within its tolerance.
    pub(super) fn coarsen(&mut self, least_level: usize) {
        let Some(error) = self.point.outcome.error else {
            return;
        };
        if self.model.elements.is_some() || self.point.level <= least_level {
            return;
        }
        if self.rows_refined < self.rows_to_hold {
            self.rows_refined += 1;
            return;
        }
        // fourth order
        if 16.0 * error.tip > COARSENING * TIP_TOLERANCE * self.length {
            return;
        }
        let elements = LEVELS[self.point.level - 1];
        if let Ok(level) = self.at(elements) {
            self.point.strain = coarsen(&self.point.strain);
            self.point.level = level;
            self.past.clear();
            self.rows_refined = usize::MAX;
        }
    }
}

/// The same strain on half as many elements, without its part that is not linear in each: the
/// inverse of [`refine_to`].
fn coarsen(strain: &[Vec3]) -> Vec<Vec3> {
    let halves = strain.chunks_exact(4).flat_map(|arcs| {
        let [first, second] = [arcs[0] + arcs[1], arcs[2] + arcs[3]];
        let (sum, difference) = (first + second, (second - first) * (1.0 / 0.75));
        [(sum - difference) * 0.5, (sum + difference) * 0.5]
    });
    halves.collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Fewer elements hold a strain that is linear in each of them as more elements do.
    #[test]
    fn coarser_elements_undo_finer_ones() {
        let strain: Vec<_> = (0..12)
            .map(|i| Vec3([0.1 * i as f64, (i as f64).sin(), 0.3]))
            .collect();
        let there = coarsen(&refine_to(strain.clone(), 2));
        assert_eq!(there.len(), strain.len());
        for (a, b) in there.iter().zip(&strain) {
            assert!((*a - *b).max_abs() < 1e-14);
        }
    }
}

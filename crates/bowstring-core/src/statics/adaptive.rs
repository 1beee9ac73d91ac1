//! Statics with as many elements in a module as the solution needs.
//!
//! Theory: docs/theory/statics.md (Discretisation error).
//!
//! One element is fourth order and sufficient for most loads. Its error is estimated after the
//! solve (see [`crate::rod::estimate`]), and a load that needs more is solved again with 2, 4 or 8.

use crate::criteria::is_near;
use crate::interrupt;
use crate::math::linalg::Vec3;
use crate::model::error::InputError;
use crate::model::load::{Load, Model, RodModel, LEVELS};
use crate::model::robot::Robot;
use crate::rod::estimate::ErrorEstimate;
use crate::statics::solver::{Outcome, Solver, Status};

/// The same strain on twice as many elements; it is linear in each.
fn refine(strain: &[Vec3]) -> Vec<Vec3> {
    let halves = strain.chunks_exact(2).flat_map(|arcs| {
        let (sum, difference) = (arcs[0] + arcs[1], arcs[1] - arcs[0]);
        [-0.375, 0.375].map(|side| (sum * 0.5 + difference * side, difference * 0.25))
    });
    halves
        .flat_map(|(sum, difference)| [(sum - difference) * 0.5, (sum + difference) * 0.5])
        .collect()
}

/// The same strain on `factor` times as many elements, a power of two.
pub(crate) fn refine_to(mut strain: Vec<Vec3>, factor: usize) -> Vec<Vec3> {
    for _ in 0..factor.ilog2() {
        strain = refine(&strain);
    }
    strain
}

/// The same strain on half as many elements, as far as it is linear in each.
fn coarsen(strain: &[Vec3]) -> Vec<Vec3> {
    let pairs = strain.chunks_exact(4).flat_map(|arcs| {
        let halves = [arcs[0] + arcs[1], arcs[2] + arcs[3]];
        let (sum, difference) = (
            halves[0] + halves[1],
            (halves[1] - halves[0]) * (1.0 / 0.75),
        );
        [(sum - difference) * 0.5, (sum + difference) * 0.5]
    });
    pairs.collect()
}

/// The strain of a rod with `from` elements in a module on `to` elements, both powers of two.
pub(crate) fn with_elements(mut strain: Vec<Vec3>, from: usize, to: usize) -> Vec<Vec3> {
    if to >= from {
        return refine_to(strain, to / from);
    }
    for _ in 0..(from / to).ilog2() {
        strain = coarsen(&strain);
    }
    strain
}

/// A solver that chooses its number of elements, or keeps a given one.
#[derive(Clone)]
pub struct Adaptive {
    robot: Robot,
    model: Model,
    fixed: bool,
    solvers: [Option<Box<Solver>>; 4],
    /// Level of the last solution.
    level: usize,
}

impl Adaptive {
    /// A solver with `elements` in every module: 1, 2, 4 or 8; `None` chooses them for each load.
    pub fn new(robot: &Robot, model: Model, elements: Option<usize>) -> Result<Self, InputError> {
        let first = Solver::new(robot, model, elements.unwrap_or(1))?;
        let level = LEVELS.iter().position(|e| *e == first.elements());
        let level = level.expect("the solver checks its elements");
        let mut solvers = [const { None }; 4];
        solvers[level] = Some(Box::new(first));
        Ok(Adaptive {
            robot: robot.clone(),
            model,
            fixed: elements.is_some(),
            solvers,
            level,
        })
    }

    /// A solver with the elements of a model.
    ///
    /// # Errors
    /// As [`Adaptive::new`].
    pub fn of(robot: &Robot, model: &RodModel) -> Result<Self, InputError> {
        Adaptive::new(robot, model.model, model.elements)
    }

    /// Elements in every module, if they are given.
    pub(crate) fn given_elements(&self) -> Option<usize> {
        self.fixed.then(|| LEVELS[self.level])
    }

    /// The solver that holds the last solution.
    pub fn solver(&self) -> &Solver {
        self.solvers[self.level].as_ref().expect("it has solved")
    }

    /// Solves `load`, that of the last solution, with `elements` in a module, starting only from
    /// that solution's strain: if it converges, it is on the same branch of solutions.
    ///
    /// # Errors
    /// If there is no solution, the elements are fewer than its own, or the solver does not fit
    /// into memory.
    pub fn refined(&self, load: &Load, elements: usize) -> Result<(Solver, Outcome), InputError> {
        let now = self.solver();
        let mut finer = Solver::new(&self.robot, self.model, elements)?;
        let Some(strain) = now.last_strain() else {
            return Err(InputError::other("there is no solution to refine"));
        };
        if elements < now.elements() {
            let now = now.elements();
            return Err(InputError::other(format!(
                "elements: {elements} are fewer than the {now} of the solution"
            )));
        }
        let strain = refine_to(strain, elements / now.elements());
        let mut outcome = finer.solve_from(Some(&strain), load);
        finer.estimate_error(&mut outcome);
        Ok((finer, outcome))
    }

    /// Discards the solutions of all solvers.
    pub(crate) fn reset(&mut self) {
        if !self.fixed {
            self.level = 0;
        }
        for solver in self.solvers.iter_mut().flatten() {
            solver.unsettle();
        }
    }

    /// Discards all solutions, and takes a strain as the last one, with as many elements as it has.
    pub(crate) fn restart_from(&mut self, strain: Option<Vec<Vec3>>) {
        self.reset();
        let Some(strain) = strain else { return };
        let elements = strain.len() / (2 * self.robot.module_count());
        let level = LEVELS.iter().position(|e| *e == elements);
        let usable = level.filter(|level| !self.fixed || *level == self.level);
        // without memory for them it starts from the straight backbone
        if let Some(Ok(solver)) = usable.map(|level| self.at(level)) {
            solver.take_strain(strain);
        }
    }

    /// # Errors
    /// If the solver does not fit into memory.
    fn at(&mut self, level: usize) -> Result<&mut Solver, InputError> {
        let solver = match self.solvers[level].take() {
            Some(solver) => solver,
            None => Box::new(Solver::new(&self.robot, self.model, LEVELS[level])?),
        };
        self.level = level;
        Ok(self.solvers[level].insert(solver))
    }

    /// Equilibrium from the straight backbone. Where one element is nearly sufficient, finer ones
    /// start from its strain.
    pub fn solve(&mut self, load: &Load) -> Result<Outcome, InputError> {
        if !self.fixed {
            self.level = 0;
        }
        self.search(load, false)
    }

    /// Equilibrium from the previous ones, for loads in a fine sequence. The number of elements
    /// does not decrease.
    pub fn solve_next(&mut self, load: &Load) -> Result<Outcome, InputError> {
        self.search(load, true)
    }

    fn search(&mut self, load: &Load, next: bool) -> Result<Outcome, InputError> {
        let mut iterations = 0;
        let mut failed: Option<(usize, Outcome)> = None;
        // strain of the coarser solution, and whether its path left an unstable equilibrium
        let mut start: Option<(Vec<Vec3>, bool)> = None;
        let least = load.least_elements(&self.robot);
        if !self.fixed && LEVELS[self.level] < least {
            let level = LEVELS.iter().position(|e| *e >= least);
            self.level = level.expect("it is one of them or less");
        }
        loop {
            let elements = LEVELS[self.level];
            let solver = self.at(self.level)?;
            let refined = start.take().and_then(|(strain, left_unstable)| {
                let mut outcome = solver.solve_from(Some(&strain), load);
                outcome.left_unstable |= left_unstable;
                if outcome.status != Status::Converged {
                    iterations += outcome.iterations;
                    return None;
                }
                Some(outcome)
            });
            let mut outcome = match refined {
                Some(outcome) => outcome,
                None if failed.is_some() => solver.solve_from(None, load),
                None if next => solver.solve_next(load)?,
                None => solver.solve(load)?,
            };
            iterations += outcome.iterations;
            let needed = solver.estimate_error(&mut outcome);
            let more = match needed {
                _ if self.fixed || interrupt::interrupted() => elements,
                Some(needed) => needed,
                // a coarse rod may have no solution where a finer one has
                None => elements.max(4),
            };
            if more == elements {
                if let (Some((level, first)), true) = (failed, outcome.error.is_none()) {
                    // the first attempt tried more, and reports better how far the load can go
                    (self.level, outcome) = (level, first);
                }
                outcome.iterations = iterations;
                if outcome.error.is_some_and(|error| !error.is_bound()) {
                    (outcome.status, outcome.stable) = (Status::MaxIterations, None);
                    outcome.error = None;
                    self.at(self.level)?.unsettle();
                }
                return Ok(outcome);
            }
            if outcome.status != Status::Converged {
                failed = failed.or(Some((self.level, outcome)));
            }
            let length = self.robot.length();
            let near = |error: ErrorEstimate| is_near(&error, outcome.stable, length);
            if next || outcome.error.is_some_and(near) {
                let strain = self.solver().last_strain();
                start = strain.map(|w| (refine_to(w, more / elements), outcome.left_unstable));
            }
            let level = LEVELS.iter().position(|e| *e == more).expect("one of them");
            let Ok(finer) = self.at(level) else {
                // the coarse solution states its error, and is better than none
                outcome.iterations = iterations;
                return Ok(outcome);
            };
            finer.unsettle();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn refined_strain_is_the_same_field() {
        // linear over the element: moment of curvature at a fraction
        let at = |arcs: &[Vec3], xi: f64, elements: f64| {
            let e = ((xi * elements) as usize).min(arcs.len() / 2 - 1);
            let local = xi * elements - e as f64;
            let (a, b) = (arcs[2 * e], arcs[2 * e + 1]);
            ((a + b) + (b - a) * (3.0 * (local - 0.5))) * elements
        };
        let coarse = [Vec3([0.1, 0.2, -0.3]), Vec3([0.4, -0.1, 0.2])];
        let fine = refine(&coarse);
        for i in 0..20 {
            let xi = (i as f64 + 0.5) / 20.0;
            let off = at(&coarse, xi, 1.0) - at(&fine, xi, 2.0);
            assert!(off.max_abs() < 1e-15, "{xi}: {off:?}");
        }
        for (back, arc) in with_elements(fine, 2, 1).iter().zip(coarse) {
            assert!((*back - arc).max_abs() < 1e-15);
        }
    }
}

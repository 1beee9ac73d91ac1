//! Statics with as many elements in a module as the answer needs.
//!
//! One element is fourth order and enough for most loads; what it misses is estimated after the
//! solve (see [`crate::estimate`]), and a load that needs more is solved again with 2, 4 or 8.

use crate::estimate::ErrorEstimate;
use crate::interrupt;
use crate::linalg::Vec3;
use crate::load::{Load, Model};
use crate::robot::{InputError, Robot};
use crate::statics::{Outcome, Solver, Status};

/// Estimated error of the tip, over the robot's length, that elements are chosen for.
pub const TIP_TOLERANCE: f64 = 1e-5;
/// The same of tensions, over the largest.
pub const TENSION_TOLERANCE: f64 = 1e-4;
/// The same below which finer elements start from the strain of the coarse ones.
const CLOSE: f64 = 1e-2;
/// Elements to choose from.
pub const LEVELS: [usize; 4] = [1, 2, 4, 8];
/// Compression of a module (force times squared length over bending stiffness; between two disks
/// it buckles at pi^2) above which stability depends on the elements, and the largest compression
/// of an element that finds the critical force to 1e-3.
pub(crate) const NEAR_BUCKLING: f64 = 5.0;
const FINE_COMPRESSION: f64 = 0.65;

/// Whether the elements are fine enough to decide stability, by the largest compression of a
/// module.
pub(crate) fn tells_stability(compression: f64, elements: usize) -> bool {
    let own = compression / (elements * elements) as f64;
    // a NaN tells nothing
    compression <= NEAR_BUCKLING || own <= FINE_COMPRESSION
}

/// Elements that bring an error, `ratio` times what is tolerated, below it; the same number
/// where it is already, or where there are no more.
pub(crate) fn needed(elements: usize, ratio: f64, compression: f64) -> usize {
    let enough = |e: usize| {
        let finer = (e / elements) as f64;
        // a NaN is never enough
        (ratio <= 1.0 || ratio / finer.powi(4) <= 1.0) && tells_stability(compression, e)
    };
    let mut finer = LEVELS.into_iter().filter(|e| *e >= elements);
    finer.find(|e| enough(*e)).unwrap_or(LEVELS[3])
}

/// The same strain on twice as many elements: that of each is linear.
pub(crate) fn refine(strain: &[Vec3]) -> Vec<Vec3> {
    let halves = strain.chunks_exact(2).flat_map(|arcs| {
        let (sum, difference) = (arcs[0] + arcs[1], arcs[1] - arcs[0]);
        [-0.375, 0.375].map(|side| (sum * 0.5 + difference * side, difference * 0.25))
    });
    halves
        .flat_map(|(sum, difference)| [(sum - difference) * 0.5, (sum + difference) * 0.5])
        .collect()
}

/// The same strain on `factor` times as many elements, a power of two.
fn refine_to(mut strain: Vec<Vec3>, factor: usize) -> Vec<Vec3> {
    for _ in 0..factor.ilog2() {
        strain = refine(&strain);
    }
    strain
}

/// A solver that chooses its elements, or keeps those that it was given.
#[derive(Clone)]
pub struct Adaptive {
    robot: Robot,
    model: Model,
    fixed: bool,
    solvers: [Option<Box<Solver>>; 4],
    /// Of the last answer.
    level: usize,
}

impl Adaptive {
    /// `elements`: 1, 2, 4 or 8 in every module; `None` chooses them load by load.
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

    /// The solver that holds the last answer.
    pub fn solver(&self) -> &Solver {
        self.solvers[self.level].as_ref().expect("it has solved")
    }

    /// The last answer, which is of `load`, with so many elements in every module: on from its
    /// own strain, and so on the same branch of solutions.
    ///
    /// # Errors
    /// If there are fewer elements than now, or the solver does not fit into memory.
    pub fn refined(&self, load: &Load, elements: usize) -> Result<(Solver, Outcome), InputError> {
        let now = self.solver();
        let mut finer = Solver::new(&self.robot, self.model, elements)?;
        if elements < now.elements() {
            let now = now.elements();
            return Err(InputError(format!(
                "elements: {elements} are fewer than the {now} of the answer"
            )));
        }
        if let Some(strain) = now.last_strain() {
            finer.start_next_from(&refine_to(strain, elements / now.elements()));
        }
        let mut outcome = finer.solve_next(load)?;
        finer.estimate_error(&mut outcome);
        Ok((finer, outcome))
    }

    /// Forgets the answers of all solvers.
    pub(crate) fn reset(&mut self) {
        if !self.fixed {
            self.level = 0;
        }
        for solver in self.solvers.iter_mut().flatten() {
            solver.unsettle();
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

    /// Equilibrium from the straight backbone.
    pub fn solve(&mut self, load: &Load) -> Result<Outcome, InputError> {
        if !self.fixed {
            self.level = 0;
        }
        self.search(load, false)
    }

    /// Equilibrium from the ones before: for loads that follow each other closely. Elements are
    /// not taken back.
    pub fn solve_next(&mut self, load: &Load) -> Result<Outcome, InputError> {
        self.search(load, true)
    }

    fn search(&mut self, load: &Load, next: bool) -> Result<Outcome, InputError> {
        let mut iterations = 0;
        let mut left_unstable = false;
        let mut failed: Option<(usize, Outcome)> = None;
        let mut near = next;
        loop {
            let solver = self.at(self.level)?;
            let mut outcome = if failed.is_some() {
                solver.attempt(load)
            } else if near {
                solver.solve_next(load)?
            } else {
                solver.solve(load)?
            };
            solver.estimate_error(&mut outcome);
            iterations += outcome.iterations;
            outcome.left_unstable |= left_unstable;
            let elements = LEVELS[self.level];
            let more = match (outcome.status, outcome.error) {
                _ if self.fixed || interrupt::interrupted() => elements,
                (Status::Converged, Some(error)) => {
                    let ratio = error.tip / (TIP_TOLERANCE * self.robot.length());
                    needed(elements, ratio, error.compression)
                }
                // a coarse rod may have no answer where a finer one has
                _ => elements.max(4),
            };
            if more == elements {
                if let (Some((level, first)), true) = (failed, outcome.error.is_none()) {
                    // it tried harder, and tells more of how far the load can go
                    (self.level, outcome) = (level, first);
                }
                outcome.iterations = iterations;
                return Ok(outcome);
            }
            if outcome.status != Status::Converged {
                failed = failed.or(Some((self.level, outcome)));
            }
            // on from the coarse answer, which is on the same branch if it is not too far off
            let close = |error: ErrorEstimate| error.tip <= CLOSE * self.robot.length();
            near = next || outcome.error.is_some_and(close);
            let start = if near {
                left_unstable = outcome.left_unstable;
                self.solver().last_strain()
            } else {
                None
            };
            let level = LEVELS.iter().position(|e| *e == more).expect("one of them");
            let Ok(finer) = self.at(level) else {
                // the coarse answer states its error, and is better than none
                outcome.iterations = iterations;
                return Ok(outcome);
            };
            finer.unsettle();
            if let Some(strain) = start {
                finer.start_next_from(&refine_to(strain, more / elements));
            }
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
    }

    #[test]
    fn needed_elements_follow_error_and_compression() {
        assert_eq!(needed(1, 0.9, 0.5), 1);
        assert_eq!(needed(1, 1.1, 0.5), 2);
        assert_eq!(needed(1, 17.0, 0.5), 4);
        assert_eq!(needed(2, 17.0, 0.5), 8);
        assert_eq!(needed(8, 17.0, 0.5), 8);
        assert_eq!(needed(1, 0.1, 9.0), 4);
        assert_eq!(needed(1, f64::NAN, 0.5), 8);
        assert_eq!(needed(1, 0.1, f64::NAN), 8);
    }
}

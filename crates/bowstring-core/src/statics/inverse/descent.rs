//! Descent to the nearest tip, and to the least tensions of it: Gauss-Newton steps in a trust
//! region.
//!
//! Theory: docs/theory/inverse-kinematics.md (Iteration).

use super::curvature::Weights;
use super::task::{norm, residual, Task};
use super::trust_region::{
    half_square, FIRST_RADIUS, LARGER, LEAST_RADIUS, NEAR, SMALLER, SUFFICIENT_DECREASE,
};
use super::InverseSolver;
use crate::interrupt;
use crate::math::linalg::dot;
use crate::outcome::Status;

/// Distance over the robot's length at which a descent ends.
pub(super) const DISTANCE_TOLERANCE: f64 = 1e-8;
/// Distance over the robot's length at which the first descent of a start ends, before the error of
/// its elements is estimated.
pub(super) const NEAR_TOLERANCE: f64 = 1e-5;
/// Change of tension over the unit of tension below which tensions are not made smaller: of tendons
/// that are at most as many as the equations, and of more.
const LAST_REDUCTIONS: [f64; 2] = [0.2, 1e-3];
/// Change of tension over the unit of tension below which a step is not worth an equilibrium, where
/// the distance is within its tolerance.
const SETTLED: f64 = 1e-3;
/// Change of tension over the unit of tension below which the iteration ends.
const LEAST_STEP: f64 = 1e-6;
/// Sum of changes of tension over the unit of tension up to which derivatives are exact enough for
/// the least tensions, or for a nearest tip; and up to which they are kept as long as the distance
/// contracts by this factor in each step.
const LARGEST_DRIFT: f64 = 2e-3;
const MOST_DRIFT: f64 = 0.1;
const CONTRACTION: f64 = 0.05;
/// Most iterations of a descent, and of the first descent of a start.
const MAX_ITERATIONS: usize = 100;
const PATIENCE: usize = 25;
/// Distance over length at which the augmented Lagrangian weighs the squared distance as much as
/// the multipliers.
const STIFFNESS_DISTANCE: f64 = 1e-3;
/// Distance after a step over that before it from which the curvature takes part.
const LITTLE: f64 = 0.7;
/// Weight of the tensions beside the distance: the first of a cold start, its factor in each
/// iteration, and the last.
pub(super) const FIRST_WEIGHT: f64 = 1e-3;
const WEIGHT_FACTOR: f64 = 0.01;
pub(super) const LEAST_WEIGHT: f64 = 1e-7;
/// Iterations after which tensions are not made smaller.
const MAX_REDUCTIONS: usize = 60;
/// Decrease of the distance, over the length, below which a step cannot show one.
const LEAST_GAIN: f64 = 1e-9;

/// How a descent ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum End {
    /// At the tolerance of the distance, or where no small change of tension decreases it.
    Converged,
    /// At the permitted number of iterations.
    Paused,
    /// At a point without derivatives or without acceptable steps.
    Stuck,
}

/// How far, and how long, a descent goes.
#[derive(Clone, Copy, Debug)]
pub(super) struct Effort {
    /// First weight of the tensions beside the distance.
    weight: f64,
    /// Distance over length at which it ends.
    tolerance: f64,
    /// Whether tensions are made smaller.
    reduces: bool,
    /// Most iterations.
    iterations: usize,
}

impl Effort {
    /// From a start.
    pub const FIRST: Effort = Effort {
        weight: FIRST_WEIGHT,
        tolerance: NEAR_TOLERANCE,
        reduces: true,
        iterations: PATIENCE,
    };
    /// From a point at which `FIRST` paused.
    pub const SECOND: Effort = Effort {
        weight: LEAST_WEIGHT,
        iterations: MAX_ITERATIONS,
        ..Effort::FIRST
    };
    /// From the solution of the previous row of a path, or from an unreached point with other
    /// elements.
    pub const WHOLE: Effort = Effort {
        tolerance: DISTANCE_TOLERANCE,
        ..Effort::SECOND
    };
    /// From a point near the target, whose tensions are the least.
    pub const LAST: Effort = Effort {
        reduces: false,
        ..Effort::WHOLE
    };
}

impl InverseSolver {
    /// Gauss-Newton iteration with a trust region from the point.
    pub(super) fn descend(&mut self, task: &Task, effort: Effort, iterations: &mut usize) -> End {
        self.curvature.interrupt();
        let end = self.iterate(task, effort, iterations);
        // the next derivatives may be those of another point
        self.curvature.interrupt();
        end
    }

    fn iterate(&mut self, task: &Task, effort: Effort, iterations: &mut usize) -> End {
        let Effort {
            mut weight,
            tolerance,
            mut reduces,
            iterations: most,
        } = effort;
        let mut radius = FIRST_RADIUS;
        let redundant = self.point.tensions.len() > task.rows;
        let last_reduction = LAST_REDUCTIONS[usize::from(redundant)];
        // the first step from the previous row of a path is short
        let first_curved = usize::from(weight == LEAST_WEIGHT);
        // whether linear steps bring a tip that is not near hardly nearer
        let mut curved = false;
        let mut rejected = false;
        for round in 0..most {
            if interrupt::interrupted() {
                return End::Stuck;
            }
            if self.point.size <= tolerance && !reduces && weight == LEAST_WEIGHT {
                return End::Converged;
            }
            if redundant && reduces || curved && self.point.size >= NEAR {
                self.linearised &= self.drift <= LARGEST_DRIFT;
            }
            if !self.linearised && !self.linearise(task) {
                return End::Stuck;
            }
            *iterations += 1;
            let before = self.point.size;
            // the curved set of equal tips is of interest near the target only
            let near = before < NEAR;
            self.curvature.is_used = match self.curvature.weights {
                Some(Weights::Multipliers) => near && reduces && round >= first_curved,
                Some(Weights::Residual) => !near && curved,
                None => false,
            };
            self.linear_step(task, weight, radius, reduces);
            let largest = self.set_step();
            let predicted = self.predicted(task, weight);
            if weight == LEAST_WEIGHT && largest < 0.9 * radius {
                let bends = self.curvature.is_used && !near;
                if bends && before - predicted < LEAST_GAIN {
                    return End::Converged;
                }
                if before <= tolerance && largest <= SETTLED {
                    return End::Converged;
                }
                // a short step may still halve a small distance
                if largest <= LEAST_STEP && predicted > 0.5 * before {
                    if self.drift <= LARGEST_DRIFT {
                        return End::Converged;
                    }
                    self.linearised = false;
                    continue;
                }
            }
            let merit = Merit::new(self, task, near && redundant && reduces);
            let gain = merit.gain(self, task, predicted);
            let (from, to) = (half_square(&self.point.tensions), half_square(&self.trial));
            let mut achieved = 0.0;
            let accepted = self.try_step(task, |there, size| {
                achieved = merit.decrease(before, size, there, from - to);
                let nearer = before - size >= SUFFICIENT_DECREASE * (before - predicted);
                let better = gain > 0.0 && achieved >= SUFFICIENT_DECREASE * gain;
                nearer || better && size <= NEAR
            });
            let Some(size) = accepted else {
                curved = true;
                if self.drift > 0.0 {
                    // the derivatives may be at fault
                    self.linearised = false;
                    continue;
                }
                rejected = true;
                radius = SMALLER * largest;
                if radius < LEAST_RADIUS {
                    return if before - predicted < LEAST_GAIN {
                        End::Converged
                    } else {
                        End::Stuck
                    };
                }
                continue;
            };
            curved |= size > LITTLE * before;
            // at once a larger one would be rejected again
            if largest > 0.8 * radius && achieved >= 0.5 * gain && !rejected {
                radius *= LARGER;
            }
            rejected = false;
            let contracts = self.drift <= MOST_DRIFT && size <= CONTRACTION * before;
            self.linearised = contracts || self.drift <= LARGEST_DRIFT;
            let small = size <= NEAR && largest <= last_reduction;
            reduces &= round < MAX_REDUCTIONS && !(small && weight == LEAST_WEIGHT);
            weight = (WEIGHT_FACTOR * weight).max(LEAST_WEIGHT);
        }
        End::Paused
    }

    /// Sets the step from the point to the trial; returns its largest change.
    pub(super) fn set_step(&mut self) -> f64 {
        let changes = self.trial.iter().zip(&self.point.tensions);
        self.step.clear();
        self.step.extend(changes.map(|(to, from)| to - from));
        self.step.iter().fold(0.0, |most, d| most.max(d.abs()))
    }

    /// Takes the step to the trial if its equilibrium exists and its distance is accepted; returns
    /// the distance. The derivatives are corrected by the step.
    pub(super) fn try_step(
        &mut self,
        task: &Task,
        accepts: impl FnOnce(&[f64; 6], f64) -> bool,
    ) -> Option<f64> {
        let found = self.trial_equilibrium();
        if found.status != Status::Converged {
            return None;
        }
        let tip = self.level().solver.tip()?;
        let there = residual(&tip, &task.target, self.length);
        let size = norm(&there[..task.rows]);
        if !accepts(&there, size) {
            return None;
        }
        self.note_step(task);
        self.correct_derivatives(task, &there);
        self.point.tensions.clone_from(&self.trial);
        self.point.residual = there;
        self.point.size = size;
        self.point.outcome = found;
        self.keep_strain();
        Some(size)
    }
}

/// What a step has to decrease: the distance, or near the target the augmented Lagrangian of the
/// least tensions.
struct Merit {
    /// Multipliers, and the factor of half the squared distance.
    multipliers: Option<([f64; 6], f64)>,
    residual: [f64; 6],
}

impl Merit {
    fn new(solver: &InverseSolver, task: &Task, augmented: bool) -> Self {
        let found = augmented.then(|| solver.multipliers(task)).flatten();
        let multipliers = found.map(|found| (found, norm(&found) / STIFFNESS_DISTANCE));
        Merit {
            multipliers,
            residual: solver.point.residual,
        }
    }

    /// Predicted decrease by the step.
    fn gain(&self, solver: &InverseSolver, task: &Task, predicted: f64) -> f64 {
        let before = solver.point.size;
        let Some((multipliers, factor)) = self.multipliers else {
            return before - predicted;
        };
        let step = &solver.step;
        let mut slope = dot(&solver.point.tensions, step);
        for (i, d) in step.iter().enumerate() {
            slope += d * dot(&multipliers, &solver.column(i, &task.target));
        }
        let square = match solver.curvature.is_used {
            true => solver.curvature.square(step),
            false => dot(step, step),
        };
        0.5 * factor * (before * before - predicted * predicted) - slope - 0.5 * square
    }

    /// Decrease by a step to a distance `size` and residual `there`, with this decrease of half the
    /// squared tensions.
    fn decrease(&self, before: f64, size: f64, there: &[f64; 6], tensions: f64) -> f64 {
        let Some((multipliers, factor)) = self.multipliers else {
            return before - size;
        };
        let change = dot(&multipliers, &self.residual) - dot(&multipliers, there);
        0.5 * factor * (before * before - size * size) + tensions + change
    }
}

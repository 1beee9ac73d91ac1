//! Descent to the nearest tip, and to the least tensions of it: Gauss-Newton steps in a trust
//! region.
//!
//! Theory: docs/theory/inverse-kinematics.md (Iteration).

use super::task::{norm, residual, Task};
use super::InverseSolver;
use crate::interrupt;
use crate::statics::outcome::Status;

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
/// First radius of the trust region, over the unit of tension.
pub(super) const FIRST_RADIUS: f64 = 1.5;
/// Radius at which the iteration ends.
pub(super) const LEAST_RADIUS: f64 = 1e-8;
/// Factors of the radius after a good step at its limit and after a rejected one.
pub(super) const LARGER: f64 = 2.5;
pub(super) const SMALLER: f64 = 0.3;
/// Required decrease of the distance, over the predicted one.
pub(super) const SUFFICIENT_DECREASE: f64 = 0.1;
/// First permitted increase of the distance by a step to smaller tensions, over the length; after
/// some iterations it is halved by each use.
const FIRST_SLACK: f64 = 1e-3;
const FULL_SLACK: usize = 25;
/// Weight of the tensions beside the distance: the first of a cold start, its factor in each
/// iteration, and the last.
pub(super) const FIRST_WEIGHT: f64 = 1e-3;
const WEIGHT_FACTOR: f64 = 0.01;
pub(super) const LEAST_WEIGHT: f64 = 1e-7;
/// Distance over length below which steps to smaller tensions may increase it, and their length is
/// chosen.
const NEAR: f64 = 1e-2;
/// Range of that length.
const SHARES: [f64; 2] = [0.1, 4.0];
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
        let Effort {
            mut weight,
            tolerance,
            mut reduces,
            iterations: most,
        } = effort;
        let mut radius = FIRST_RADIUS;
        let mut slack = FIRST_SLACK;
        // share of the way to the least tensions that the last step went
        let mut last_share: Option<f64> = None;
        let redundant = self.point.tensions.len() > task.rows;
        let last_reduction = LAST_REDUCTIONS[usize::from(redundant)];
        for round in 0..most {
            if interrupt::interrupted() {
                return End::Stuck;
            }
            if self.point.size <= tolerance && !reduces && weight == LEAST_WEIGHT {
                return End::Converged;
            }
            if redundant && reduces {
                self.linearised &= self.drift <= LARGEST_DRIFT;
            }
            if !self.linearised && !self.linearise(task) {
                return End::Stuck;
            }
            *iterations += 1;
            let mut share = if reduces { 1.0 } else { 0.0 };
            self.linear_step(task, weight, radius, share);
            if let (Some(of), true) = (last_share, self.point.size < NEAR && share > 0.0) {
                let tensions = &self.point.tensions;
                let chosen = step_share(&self.last_step, of, &self.trial, tensions);
                if let Some(chosen) = chosen {
                    share = chosen;
                    self.linear_step(task, weight, radius, share);
                }
            }
            let largest = self.set_step();
            if weight == LEAST_WEIGHT && largest < 0.9 * radius {
                if self.point.size <= tolerance && largest <= SETTLED {
                    return End::Converged;
                }
                // a short step may still halve a small distance
                let gains = self.predicted(task) <= 0.5 * self.point.size;
                if largest <= LEAST_STEP && !gains {
                    if self.drift <= LARGEST_DRIFT {
                        return End::Converged;
                    }
                    self.linearised = false;
                    continue;
                }
            }
            let before = self.point.size;
            let gain = before - self.predicted(task);
            let required = before - SUFFICIENT_DECREASE * gain;
            // the curved set of equal tips is of interest near the target only
            let near = before < NEAR;
            let permitted = required + if near { slack } else { 0.0 };
            let Some(size) = self.try_step(task, |size| size <= permitted) else {
                if self.drift > 0.0 {
                    // the derivatives may be at fault
                    self.linearised = false;
                    continue;
                }
                radius = SMALLER * largest;
                last_share = None;
                if radius < LEAST_RADIUS {
                    return if gain < LEAST_GAIN {
                        End::Converged
                    } else {
                        End::Stuck
                    };
                }
                continue;
            };
            if near && size > required && round >= FULL_SLACK {
                slack *= 0.5;
            }
            if largest > 0.8 * radius && before - size >= 0.5 * gain {
                radius *= LARGER;
            }
            let contracts = self.drift <= MOST_DRIFT && size <= CONTRACTION * before;
            self.linearised = contracts || self.drift <= LARGEST_DRIFT;
            let small = size <= NEAR && largest <= last_reduction;
            reduces &= round < MAX_REDUCTIONS && !(small && weight == LEAST_WEIGHT);
            weight = (WEIGHT_FACTOR * weight).max(LEAST_WEIGHT);
            last_share = (share > 0.0).then_some(share);
            std::mem::swap(&mut self.step, &mut self.last_step);
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
        accepts: impl FnOnce(f64) -> bool,
    ) -> Option<f64> {
        let found = self.trial_equilibrium();
        if found.status != Status::Converged {
            return None;
        }
        let tip = self.level().solver.tip()?;
        let there = residual(&tip, &task.target, self.length);
        let size = norm(&there[..task.rows]);
        if !accepts(size) {
            return None;
        }
        self.correct_derivatives(task, &there);
        self.point.tensions.clone_from(&self.trial);
        self.point.residual = there;
        self.point.size = size;
        self.point.outcome = found;
        self.keep_strain();
        Some(size)
    }
}

/// Share of the next step to the least tensions, from the change of the projected gradient along
/// the last step (Barzilai and Borwein): the derivatives of the tip by the tensions change along
/// it.
fn step_share(step: &[f64], share: f64, next: &[f64], from: &[f64]) -> Option<f64> {
    let (mut square, mut along) = (0.0, 0.0);
    for ((s, to), from) in step.iter().zip(next).zip(from) {
        square += s * s;
        along += s * (s / share - (to - from));
    }
    (along > 0.0 && square > 0.0).then(|| (square / along).clamp(SHARES[0], SHARES[1]))
}

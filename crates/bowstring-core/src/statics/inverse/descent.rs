//! Descent to the nearest tip, and to the least tensions of it: Gauss-Newton steps in a trust
//! region.
//!
//! Theory: docs/theory/inverse-kinematics.md (Iteration).

use super::task::{norm, residual, Task};
use super::InverseSolver;
use crate::interrupt;
use crate::statics::outcome::Status;

/// Distance at which the iteration ends, over the robot's length.
const DISTANCE_TOLERANCE: f64 = 1e-8;
/// Change of tension over the unit of tension below which tensions are not made smaller: of tendons
/// that are at most as many as the equations, and of more. And that below which the iteration ends.
const LAST_REDUCTIONS: [f64; 2] = [0.2, 1e-3];
/// Sum of changes of tension over the unit of tension up to which derivatives are kept.
const LARGEST_DRIFT: f64 = 1e-4;
const LEAST_STEP: f64 = 1e-6;
/// Most iterations from one start.
const MAX_ITERATIONS: usize = 100;
/// First radius of the trust region, over the unit of tension.
const FIRST_RADIUS: f64 = 1.5;
/// Radius at which the iteration ends.
const LEAST_RADIUS: f64 = 1e-8;
/// Factors of the radius after a good step at its limit and after a rejected one.
const LARGER: f64 = 2.5;
const SMALLER: f64 = 0.3;
/// Required decrease of the distance, over the predicted one.
const SUFFICIENT_DECREASE: f64 = 0.1;
/// First permitted increase of the distance by a step to smaller tensions, over the length; after
/// some iterations it is halved by each use.
const FIRST_SLACK: f64 = 1e-3;
const FULL_SLACK: usize = 25;
/// Weight of the tensions beside the distance: the first of a cold start, its factor in each
/// iteration, and the last.
pub(super) const FIRST_WEIGHT: f64 = 1e-3;
const WEIGHT_FACTOR: f64 = 0.03;
pub(super) const LEAST_WEIGHT: f64 = 1e-7;
/// Distance over length below which steps to smaller tensions may increase it, and their length is
/// chosen.
const NEAR: f64 = 1e-2;
/// Range of that length.
const SHARES: [f64; 2] = [0.1, 4.0];
/// Iterations after which tensions are not made smaller.
const MAX_REDUCTIONS: usize = 60;

/// How the iteration from one start ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum End {
    Converged,
    Stuck,
}

impl InverseSolver {
    /// Gauss-Newton iteration with a trust region from the point, whose equilibrium the solver
    /// holds.
    pub(super) fn descend(
        &mut self,
        task: &Task,
        first_weight: f64,
        iterations: &mut usize,
    ) -> End {
        let mut radius = FIRST_RADIUS;
        let mut slack = FIRST_SLACK;
        let mut weight = first_weight;
        // share of the way to the least tensions that the last step went
        let mut last_share: Option<f64> = None;
        let mut reduces = true;
        let redundant = self.point.tensions.len() > task.rows;
        let last_reduction = LAST_REDUCTIONS[usize::from(redundant)];
        for round in 0..MAX_ITERATIONS {
            if interrupt::interrupted() {
                return End::Stuck;
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
            let tensions = &self.point.tensions;
            let changes = self.trial.iter().zip(tensions).map(|(a, b)| a - b);
            let largest = changes.clone().fold(0.0, |most: f64, d| most.max(d.abs()));
            self.step.clear();
            self.step.extend(changes);
            let gain = self.point.size - self.predicted(task);
            if largest <= LEAST_STEP && largest < 0.9 * radius && weight == LEAST_WEIGHT {
                return End::Converged;
            }
            let found = self.trial_equilibrium();
            let tip = self.level().solver.tip();
            let mut accepted = false;
            if let (Status::Converged, Some(tip)) = (found.status, tip) {
                let there = residual(&tip, &task.target, self.length);
                let size = norm(&there[..task.rows]);
                let most = self.point.size - SUFFICIENT_DECREASE * gain;
                // the curved set of equal tips is of interest near the target only
                let near = self.point.size < NEAR;
                if size <= most + if near { slack } else { 0.0 } {
                    accepted = true;
                    if near && size > most && round >= FULL_SLACK {
                        slack *= 0.5;
                    }
                    let good = self.point.size - size >= 0.5 * gain;
                    if largest > 0.8 * radius && good {
                        radius *= LARGER;
                    }
                    self.point.tensions.clone_from(&self.trial);
                    self.point.residual = there;
                    self.point.size = size;
                    self.point.outcome = found;
                    self.keep_strain();
                    self.drift += largest;
                    self.linearised = self.drift <= LARGEST_DRIFT;
                    let near = size <= NEAR && largest <= last_reduction;
                    reduces &= round < MAX_REDUCTIONS && !(near && weight == LEAST_WEIGHT);
                    if size <= DISTANCE_TOLERANCE && !reduces && weight == LEAST_WEIGHT {
                        return End::Converged;
                    }
                    weight = (WEIGHT_FACTOR * weight).max(LEAST_WEIGHT);
                    last_share = (share > 0.0).then_some(share);
                    std::mem::swap(&mut self.step, &mut self.last_step);
                }
            }
            if !accepted {
                radius = SMALLER * largest;
                last_share = None;
                if radius < LEAST_RADIUS {
                    return if gain < 1e-9 {
                        End::Converged
                    } else {
                        End::Stuck
                    };
                }
            }
        }
        End::Stuck
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

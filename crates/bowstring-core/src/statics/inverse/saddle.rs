//! Second-order condition of the least tensions: a saddle, as between two mirror images, is left.
//!
//! Theory: docs/theory/inverse-kinematics.md (Second-order condition).

use super::descent::Effort;
use super::task::{residual, Task};
use super::trust_region::half_square;
use super::{InverseSolver, REACHED};
use crate::interrupt;
use crate::math::linalg::dot;
use crate::math::symmetric::diagonalise;
use crate::outcome::Status;

/// Change of tension over the unit of tension for differences of the derivatives.
const INCREMENT: f64 = 0.02;
/// Eigenvalue of the Hessian, over that of the squared tensions alone, below which a point is a
/// saddle; differences are accurate to less.
const NEGATIVE: f64 = -0.02;
/// Eigenvalue of the squared derivatives of the tip, over their sum, below which a motion keeps it.
const SINGULAR: f64 = 1e-10;
/// Change of tension over the unit of tension that leaves a saddle.
const AWAY: f64 = 0.3;
/// Most saddles that are left one after another.
const MOST_SADDLES: usize = 3;
/// Relative decrease of the squared tensions that another point needs.
const LEAST_DECREASE: f64 = 1e-6;
/// Change of tension over the unit of tension along a path from which the condition is checked
/// again.
const CHECKED_RANGE: f64 = 0.2;

impl InverseSolver {
    /// Whether the tensions are still near those of the last point that was found to be a minimum.
    pub(super) fn is_checked(&self) -> bool {
        let changes = self.point.tensions.iter().zip(&self.checked);
        !self.checked.is_empty()
            && changes
                .into_iter()
                .all(|(a, b)| (a - b).abs() < CHECKED_RANGE)
    }

    /// Leaves a reached point while it is a saddle of the least tensions; returns whether it was.
    pub(super) fn leave_saddles(&mut self, task: &Task, iterations: &mut usize) -> bool {
        let mut left = false;
        for _ in 0..MOST_SADDLES {
            let Some(direction) = self.falling_direction(task, iterations) else {
                break;
            };
            if interrupt::interrupted() || !self.leave(task, &direction, iterations) {
                break;
            }
            left = true;
        }
        self.checked.clone_from(&self.point.tensions);
        left
    }

    /// Direction that keeps the tip to first order, along which the squared tensions of equal tips
    /// fall; `None` at a minimum.
    fn falling_direction(&mut self, task: &Task, iterations: &mut usize) -> Option<Vec<f64>> {
        let inside = |i: &usize| {
            let t = self.point.tensions[*i];
            task.lower[*i] < t && t < task.upper[*i]
        };
        let free: Vec<usize> = (0..self.point.tensions.len()).filter(inside).collect();
        let n = free.len();
        if n == 0 {
            return None;
        }
        let exact = self.linearised && self.drift == 0.0 && self.plain_level == self.point.level;
        if !exact && !self.linearise(task) {
            return None;
        }
        let column = |solver: &Self, i: usize| solver.column(i, &task.target);
        let columns: Vec<_> = free.iter().map(|i| column(self, *i)).collect();
        let mut square: Vec<f64> = vec![];
        for of in &columns {
            square.extend(columns.iter().map(|by| dot(of, by)));
        }
        let mut vectors = vec![];
        diagonalise(n, &mut square, &mut vectors);
        let trace: f64 = columns.iter().map(|of| dot(of, of)).sum();
        // multipliers by the pseudo-inverse: of a direction, two of three equations are independent
        let mut multipliers = [0.0; 6];
        let mut null: Vec<&[f64]> = vec![];
        for (k, vector) in vectors.chunks_exact(n).enumerate() {
            let value = square[k * n + k];
            if value <= SINGULAR * trace {
                null.push(vector);
                continue;
            }
            let along = free
                .iter()
                .zip(vector)
                .map(|(i, v)| self.point.tensions[*i] * v);
            let along = along.sum::<f64>() / value;
            for (of, v) in columns.iter().zip(vector) {
                for (x, entry) in multipliers.iter_mut().zip(of) {
                    *x -= along * v * entry;
                }
            }
        }
        let count = null.len();
        if count == 0 {
            return None;
        }
        let weighted = |solver: &Self, i: usize| dot(&multipliers, &column(solver, i));
        let here: Vec<f64> = free.iter().map(|i| weighted(self, *i)).collect();
        // the derivatives and the residual are those of the trials, then of the point again
        let (point, derivatives) = (self.point.clone(), self.columns.clone());
        let mut hessian = vec![0.0; count * count];
        let mut is_known = true;
        for (a, along) in null.iter().enumerate() {
            *iterations += 1;
            self.trial.clone_from(&self.point.tensions);
            for (i, z) in free.iter().zip(*along) {
                self.trial[*i] += INCREMENT * z;
            }
            self.set_step();
            is_known = self.trial_equilibrium().status == Status::Converged
                && self.differentiate_trial(task);
            if !is_known {
                break;
            }
            let change = free
                .iter()
                .zip(&here)
                .map(|(i, here)| weighted(self, *i) - here);
            let change: Vec<f64> = change.collect();
            for (b, other) in null.iter().enumerate() {
                let bent = dot(&change, other) / INCREMENT;
                hessian[a * count + b] += 0.5 * bent;
                hessian[b * count + a] += 0.5 * bent;
            }
            hessian[a * count + a] += 1.0;
            self.point.residual = point.residual;
        }
        self.columns = derivatives;
        self.linearised = self.settle(false);
        self.point = point;
        if !is_known {
            return None;
        }
        let mut modes = vec![];
        diagonalise(count, &mut hessian, &mut modes);
        let value = |k: usize| hessian[k * count + k];
        let least = (0..count).min_by(|a, b| value(*a).total_cmp(&value(*b)))?;
        if value(least) > NEGATIVE {
            return None;
        }
        let mut direction = vec![0.0; self.point.tensions.len()];
        for (share, along) in modes[least * count..][..count].iter().zip(&null) {
            for (i, z) in free.iter().zip(*along) {
                direction[*i] += share * z;
            }
        }
        Some(direction)
    }

    /// Takes the derivatives and the residual of the trial's equilibrium, which the solver holds.
    fn differentiate_trial(&mut self, task: &Task) -> bool {
        let level = self.levels[self.point.level].as_mut();
        let level = level.expect("the level of a point was made");
        let Some(tip) = level.solver.tip() else {
            return false;
        };
        self.point.residual = residual(&tip, &task.target, self.length);
        level.tip_by_tensions(self.has_rotations, &mut self.columns)
    }

    /// Goes from a saddle to smaller tensions with the same tip, to either side; without them the
    /// point remains.
    fn leave(&mut self, task: &Task, direction: &[f64], iterations: &mut usize) -> bool {
        let saddle = self.point.clone();
        let most = (1.0 - LEAST_DECREASE) * half_square(&saddle.tensions);
        for side in [AWAY, -AWAY] {
            self.point.clone_from(&saddle);
            for (t, d) in self.point.tensions.iter_mut().zip(direction) {
                *t += side * d;
            }
            task.clamp(&mut self.point.tensions);
            self.linearised = false;
            self.curvature.clear();
            if !self.settle(false) || !self.measure(task) {
                continue;
            }
            let end = self.descend(task, Effort::WHOLE, iterations);
            let polished = self.polish(task, end, iterations).is_some();
            let less = half_square(&self.point.tensions) < most;
            if polished && less && self.point.size <= REACHED {
                return true;
            }
        }
        self.point.clone_from(&saddle);
        self.linearised = false;
        self.settle(false);
        self.point = saddle;
        false
    }
}

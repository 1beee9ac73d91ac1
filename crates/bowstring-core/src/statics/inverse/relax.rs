//! Least tensions whose tip is farther from an unreachable target than the nearest tip by a margin
//! at most.
//!
//! Theory: docs/theory/inverse-kinematics.md (Margin of the distance).

use super::curvature::Weights;
use super::equilibrium::Point;
use super::task::Task;
use super::trust_region::{
    half_square, FIRST_RADIUS, LARGER, LEAST_RADIUS, NEAR, SMALLER, SUFFICIENT_DECREASE,
};
use super::InverseSolver;
use crate::interrupt;

/// Most iterations.
const MAX_ITERATIONS: usize = 60;
/// Share of the margin at which the iteration aims, so that it ends within the margin.
const AIM: f64 = 0.999;
/// Change of tension over the unit of tension at which the iteration ends.
const LEAST_CHANGE: f64 = 1e-4;
/// Range of the weight of the tensions beside the distance.
const WEIGHTS: [f64; 2] = [1e-5, 1e2];
/// Tolerance of the predicted distance, over the margin, and most evaluations until it holds.
const WEIGHT_TOLERANCE: f64 = 1e-4;
const WEIGHT_EVALUATIONS: usize = 40;
/// Penalty of a distance beyond the aim, over the multiplier.
const PENALTY: f64 = 2.0;

impl InverseSolver {
    /// Goes from the point, which has the nearest tip, to the least tensions within the margin,
    /// from the solution of the row before if there is one. Without a solution the point remains.
    pub(super) fn relax(&mut self, task: &Task, former: Option<Point>, iterations: &mut usize) {
        if !(task.margin > 0.0) || interrupt::interrupted() {
            return;
        }
        let nearest = self.point.clone();
        if let Some(mut former) = former.filter(|former| former.level == nearest.level) {
            task.clamp(&mut former.tensions);
            self.point = former;
            self.linearised = false;
            if !self.settle(false) || !self.measure(task) {
                self.point = nearest.clone();
            }
        }
        let mut best = nearest.clone();
        self.curvature.interrupt();
        self.reduce(task, &mut best, iterations);
        self.curvature.interrupt();
        let is_nearest = best.tensions == nearest.tensions;
        self.point = best;
        self.linearised = false;
        if !self.settle(false) {
            self.point = nearest;
            self.settle(false);
            return;
        }
        self.estimate();
        if !is_nearest {
            self.nearest = Some(nearest);
        }
    }

    /// Reduces the tensions by steps in a trust region, and replaces `best`, the nearest point, by
    /// the least within the margin.
    fn reduce(&mut self, task: &Task, best: &mut Point, iterations: &mut usize) {
        let (most, aim) = (best.size + task.margin, best.size + AIM * task.margin);
        let (mut radius, mut penalty) = (FIRST_RADIUS, 0.0_f64);
        for _ in 0..MAX_ITERATIONS {
            self.linearised &= self.drift == 0.0;
            if interrupt::interrupted() || !self.linearised && !self.linearise(task) {
                return;
            }
            *iterations += 1;
            let curved = self.curvature.weights == Some(Weights::Residual);
            self.curvature.is_used = curved && self.point.size >= NEAR;
            let weight = self.reducing_step(task, aim, radius);
            let predicted = self.predicted(task, weight);
            let largest = self.set_step();
            let here = half_square(&self.point.tensions);
            if self.point.size <= most && largest <= LEAST_CHANGE {
                return;
            }
            penalty = penalty.max(PENALTY * predicted / weight.powi(2));
            let merit = |square: f64, size: f64| square + penalty * (size - aim).max(0.0);
            let (before, there) = (merit(here, self.point.size), half_square(&self.trial));
            let gain = before - merit(there, predicted);
            let most_merit = before - SUFFICIENT_DECREASE * gain;
            let accepted = self.try_step(task, |_, size| merit(there, size) <= most_merit);
            let Some(size) = accepted else {
                radius = SMALLER * largest;
                if radius < LEAST_RADIUS {
                    return;
                }
                continue;
            };
            if largest > 0.8 * radius && before - merit(there, size) >= 0.5 * gain {
                radius *= LARGER;
            }
            if size <= most && there < half_square(&best.tensions) {
                best.clone_from(&self.point);
            }
        }
    }

    /// Least tensions in the trust region whose tip is, to first order, at the distance `aim` over
    /// the length, into `trial`; or the nearest, if none is. Returns the weight of the tensions.
    fn reducing_step(&mut self, task: &Task, aim: f64, radius: f64) -> f64 {
        // logarithm of the weight and, there, distance beyond the aim, which grows with it
        let mut beyond = |weight: f64| {
            self.linear_step(task, weight.exp(), radius, true);
            self.predicted(task, weight.exp()) - aim
        };
        let [mut low, mut high] = WEIGHTS.map(f64::ln);
        let mut above = beyond(high);
        if above <= 0.0 {
            return high.exp();
        }
        let mut below = beyond(low);
        if below >= 0.0 {
            return low.exp();
        }
        let mut weight = low;
        let mut last = 0.0;
        // false position, the value at an end that remains halved (Illinois)
        for _ in 0..WEIGHT_EVALUATIONS {
            weight = (low * above - high * below) / (above - below);
            let found = beyond(weight);
            if found.abs() <= WEIGHT_TOLERANCE * task.margin {
                break;
            }
            if found > 0.0 {
                (high, above) = (weight, found);
                if last > 0.0 {
                    below *= 0.5;
                }
            } else {
                (low, below) = (weight, found);
                if last < 0.0 {
                    above *= 0.5;
                }
            }
            last = found;
        }
        weight.exp()
    }
}

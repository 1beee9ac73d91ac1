//! The step: derivatives of the tip, and the linear problem within limits and a trust region.
//!
//! Theory: docs/theory/inverse-kinematics.md (Eq. 10.2 and 10.3).

use super::curvature::Weights;
use super::task::{norm, Task};
use super::{InverseSolver, Target};
use crate::math::bounded::{BoundedLeastSquares, Problem};
use crate::math::linalg::{dot, Vec3};
use crate::outcome::Status;

/// Length of a step over the unit of tension from which it corrects the derivatives.
const LEAST_CORRECTING_STEP: f64 = 1e-5;

/// Weight of the tip's motion in the Hessian whose eigenvalues are made positive: motions that keep
/// the tip are then nearly eigenvectors of their own.
const STIFFNESS: f64 = 1e4;

/// Scratch memory of the linear problem.
#[derive(Default)]
pub(super) struct Linear {
    pub solver: BoundedLeastSquares,
    pub a: Vec<f64>,
    pub b: Vec<f64>,
    pub centre: Vec<f64>,
    pub lower: Vec<f64>,
    pub upper: Vec<f64>,
}

impl InverseSolver {
    /// Derivatives at the point, whose equilibrium the solver holds or is solved again.
    pub(super) fn linearise(&mut self, task: &Task) -> bool {
        let unit = self.unit;
        let here = self.load.tensions.iter().zip(&self.point.tensions);
        let same = here.into_iter().all(|(load, t)| *load == t * unit);
        if !same || self.level().solver.tip().is_none() {
            let outcome = self.equilibrium();
            if outcome.status != Status::Converged {
                return false;
            }
        }
        let level = self.levels[self.point.level].as_mut();
        let level = level.expect("the level of a point was made");
        let rotation = task.target.direction.is_some();
        self.drift = 0.0;
        self.plain_level = self.point.level;
        self.has_rotations = rotation;
        self.linearised = level.tip_by_tensions(rotation, &mut self.columns);
        if self.linearised {
            self.correct_curvature(task);
        }
        self.linearised
    }

    /// Corrects the derivatives of the position by the step and the residual `there` at its end
    /// (Broyden's update), and adds the step to their drift. Where a direction is wanted they are
    /// not corrected.
    pub(super) fn correct_derivatives(&mut self, task: &Task, there: &[f64; 6]) {
        let square: f64 = self.step.iter().map(|d| d * d).sum();
        self.drift += self.step.iter().fold(0.0, |most: f64, d| most.max(d.abs()));
        // a shorter step is lost in the tolerance of the equilibria
        if !self.linearised || task.rows > 3 || square < LEAST_CORRECTING_STEP.powi(2) {
            return;
        }
        let mut missing = Vec3([0, 1, 2].map(|q| there[q] - self.point.residual[q]));
        for (i, d) in self.step.iter().enumerate() {
            let column = self.column(i, &task.target);
            missing -= Vec3([column[0], column[1], column[2]]) * *d;
        }
        let scale = self.length / (self.unit * square);
        for (column, d) in self.columns.iter_mut().zip(&self.step) {
            column[0] += missing * (scale * d);
        }
    }

    /// Column of the residual's derivative by a tension, without unit.
    pub(super) fn column(&self, i: usize, target: &Target) -> [f64; 6] {
        let [position, rotation] = &self.columns[i];
        let p = *position * (self.unit / self.length);
        let mut column = [p[0], p[1], p[2], 0.0, 0.0, 0.0];
        if let Some(direction) = target.direction {
            let r = &self.point.residual;
            let tangent = Vec3([0, 1, 2].map(|q| r[3 + q] + direction[q]));
            let turned = rotation.cross(tangent) * self.unit;
            column[3..].copy_from_slice(&turned.0);
        }
        column
    }

    /// Solves the linear problem within the limits and the trust region, into `trial`: the nearest
    /// tip, and of the tensions that lead to it the least if it `reduces`, otherwise those nearest
    /// to the present ones. Then tensions at a limit are kept if enough others are inside.
    pub(super) fn linear_step(&mut self, task: &Task, weight: f64, radius: f64, reduces: bool) {
        let m = task.rows;
        let mut linear = std::mem::take(&mut self.linear);
        let Linear {
            solver,
            a,
            b,
            centre,
            lower,
            upper,
        } = &mut linear;
        let sharp = 1.0 / weight;
        a.clear();
        b.clear();
        b.extend(self.point.residual[..m].iter().map(|r| -r * sharp));
        for (i, t) in self.point.tensions.iter().enumerate() {
            let column = self.column(i, &task.target);
            for (b, c) in b.iter_mut().zip(&column[..m]) {
                let entry = c * sharp;
                a.push(entry);
                *b += entry * t;
            }
        }
        centre.clear();
        lower.clear();
        upper.clear();
        let tensions = &self.point.tensions;
        let at_limit = |i: usize| tensions[i] == task.lower[i] || tensions[i] == task.upper[i];
        // of the least tensions, those at a limit stay there as long as the others are enough
        let free = (0..tensions.len()).filter(|i| !at_limit(*i)).count();
        let holds = !reduces && free >= m;
        for (i, t) in tensions.iter().enumerate() {
            let radius = if holds && at_limit(i) { 0.0 } else { radius };
            centre.push(if reduces { 0.0 } else { *t });
            lower.push(task.lower[i].max(t - radius));
            upper.push(task.upper[i].min(t + radius));
        }
        let mut curvature = std::mem::take(&mut self.curvature);
        let (mut root, mut centre) = (&[][..], &centre[..]);
        if curvature.is_used {
            let (scale, stiffness) = match curvature.weights {
                Some(Weights::Residual) => (sharp * sharp, 0.0),
                _ => (1.0, STIFFNESS),
            };
            curvature.set_root(tensions, scale, stiffness, |i| self.column(i, &task.target));
            (root, centre) = (&curvature.root, &curvature.centre);
        }
        self.trial.clone_from(tensions);
        let problem = Problem {
            a,
            b,
            root,
            centre,
            lower,
            upper,
        };
        solver.solve(&problem, &mut self.trial);
        self.linear = linear;
        self.curvature = curvature;
    }

    /// Predicted norm of the residual at the trial, by the linear problem with this weight.
    pub(super) fn predicted(&mut self, task: &Task, weight: f64) -> f64 {
        self.set_step();
        let mut r = self.point.residual;
        for (i, d) in self.step.iter().enumerate() {
            let column = self.column(i, &task.target);
            for (r, c) in r.iter_mut().zip(column) {
                *r += c * d;
            }
        }
        let linear = norm(&r[..task.rows]);
        let curvature = &self.curvature;
        if !curvature.is_used || curvature.weights != Some(Weights::Residual) {
            return linear;
        }
        let step = &self.step;
        let curved = (curvature.square(step) - dot(step, step)).max(0.0);
        linear.hypot(weight * curved.sqrt())
    }
}

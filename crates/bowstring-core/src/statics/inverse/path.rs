//! Rows of a path: the start from the rows before, and what they show of the next one.
//!
//! Theory: docs/theory/inverse-kinematics.md (Paths).

use super::task::{norm, residual, Task};
use super::InverseSolver;
use crate::criteria::MAX_EXTRAPOLATION;
use crate::math::linalg::Vec3;
use crate::model::load::Load;
use crate::outcome::Status;

/// Rows from which tensions and strain are extrapolated.
const ROWS: usize = 3;
/// Largest change between two steps of the target, over the step, for an extrapolation.
const STEADY: f64 = 0.5;
/// Largest distance at an extrapolated point over that at the previous solution.
const NEARER: f64 = 0.5;

/// A solution of an earlier row.
pub(super) struct Past {
    tensions: Vec<f64>,
    strain: Vec<Vec3>,
    goal: [f64; 6],
}

impl InverseSolver {
    /// Takes the last solution to other loads, limits and another target; false if it has no
    /// equilibrium there.
    pub(super) fn resume(&mut self, load: &Load, task: &Task) -> bool {
        let now = self.load.borrow();
        let same_load = Load {
            tensions: now.tensions,
            ..*load
        } == now;
        self.load.set_dead(load);
        let least_level = self.first_level(load);
        if self.point.level < least_level {
            return false;
        }
        if !same_load {
            self.searched = None;
        }
        let level = self.point.level;
        self.coarsen(least_level);
        let same = task.clamp(&mut self.point.tensions) && same_load && self.point.level == level;
        self.linearised &= same_load && self.has_rotations == (task.rows > 3);
        if !self.settle(same) || !self.measure(task) {
            return false;
        }
        self.extrapolate(task);
        true
    }

    /// Goes to the extrapolation of the rows before, if it is nearer to the target.
    fn extrapolate(&mut self, task: &Task) {
        let Some(count) = self.steady_rows(task) else {
            return;
        };
        let past = &self.past[self.past.len() - count..];
        if past
            .iter()
            .any(|row| row.strain.len() != self.point.strain.len())
        {
            return;
        }
        self.trial.clear();
        self.strain.clear();
        match past {
            [b, a] => {
                let tensions = a.tensions.iter().zip(&b.tensions);
                self.trial.extend(tensions.map(|(a, b)| a + (a - b)));
                let strains = a.strain.iter().zip(&b.strain);
                self.strain.extend(strains.map(|(a, b)| *a + (*a - *b)));
            }
            [c, b, a] => {
                let tensions = a.tensions.iter().zip(&b.tensions).zip(&c.tensions);
                let ahead = tensions.map(|((a, b), c)| (a - b) * 3.0 + c);
                self.trial.extend(ahead);
                let strains = a.strain.iter().zip(&b.strain).zip(&c.strain);
                self.strain
                    .extend(strains.map(|((a, b), c)| (*a - *b) * 3.0 + *c));
            }
            _ => return,
        }
        task.clamp(&mut self.trial);
        let mut moved = self.strain.iter().zip(&self.point.strain);
        if !moved.all(|(to, from)| (*to - *from).max_abs() < MAX_EXTRAPOLATION) {
            return;
        }
        self.set_step();
        let old = self.point.clone();
        std::mem::swap(&mut self.point.strain, &mut self.strain);
        self.point.tensions.clone_from(&self.trial);
        let found = self.equilibrium();
        let tip = match found.status {
            Status::Converged => self.level().solver.tip(),
            _ => None,
        };
        if let Some(tip) = tip {
            let there = residual(&tip, &task.target, self.length);
            let size = norm(&there[..task.rows]);
            if size <= NEARER * old.size {
                self.correct_derivatives(task, &there);
                self.point.residual = there;
                self.point.size = size;
                self.point.outcome = found;
                self.keep_strain();
                return;
            }
        }
        self.point = old;
        if !self.settle(false) {
            self.linearised = false;
        }
    }

    /// Number of rows before this one that continue steadily to its target.
    fn steady_rows(&self, task: &Task) -> Option<usize> {
        let goals = self.past.iter().rev().map(|row| row.goal);
        let goals: Vec<_> = std::iter::once(task.goal(self.length))
            .chain(goals)
            .collect();
        let between = |a: [f64; 6], b: [f64; 6]| [0, 1, 2, 3, 4, 5].map(|q| a[q] - b[q]);
        let steps: Vec<_> = goals.windows(2).map(|g| between(g[0], g[1])).collect();
        let steady = steps
            .windows(2)
            .take_while(|s| norm(&between(s[0], s[1])) <= STEADY * norm(&s[1]));
        match steady.count() {
            0 => None,
            n => Some((n + 1).min(ROWS)),
        }
    }

    /// Keeps the point for later rows, which continue the path unless it is `new`.
    pub(super) fn remember(&mut self, task: &Task, new: bool) {
        let arcs = self.point.strain.len();
        if new || self.past.iter().any(|row| row.strain.len() != arcs) {
            self.past.clear();
        }
        if self.past.len() == ROWS {
            self.past.rotate_left(1);
            self.past.pop();
        }
        self.past.push(Past {
            tensions: self.point.tensions.clone(),
            strain: self.point.strain.clone(),
            goal: task.goal(self.length),
        });
    }
}

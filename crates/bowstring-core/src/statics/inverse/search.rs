//! Search from several starts, for targets that the last solution does not lead to.
//!
//! Theory: docs/theory/inverse-kinematics.md (Iteration).

use super::descent::{Effort, End, DISTANCE_TOLERANCE, NEAR_TOLERANCE};
use super::equilibrium::Point;
use super::task::Task;
use super::{InverseSolver, REACHED};
use crate::interrupt;

/// Starts that are tried until the tip is reached.
const STARTS: usize = 20;
/// Difference of distances over the length within which two starts lead to the same tip, and number
/// of such starts after the first from which it is the nearest.
const SAME: f64 = 1e-7;
const AGREEMENTS: usize = 3;
/// Most starts that are continued after a pause.
const CONTINUED: usize = 5;

/// The nearest of several points, in comparison.
struct Nearest {
    best: Option<(Point, End)>,
    /// Whether the best is not the one from which the search began.
    is_new: bool,
    /// Starts that led to the same tip as the best.
    agreements: usize,
}

impl Nearest {
    fn is_done(&self) -> bool {
        let size = self.best.as_ref().map_or(f64::INFINITY, |(p, _)| p.size);
        size <= REACHED || self.agreements >= AGREEMENTS || interrupt::interrupted()
    }

    /// Compares a point; returns whether it is the best now.
    fn compare(&mut self, point: &Point, end: End) -> bool {
        let least = self.best.as_ref().map_or(f64::INFINITY, |(p, _)| p.size);
        if point.size < least - SAME || self.best.is_none() {
            self.best = Some((point.clone(), end));
            self.is_new = true;
            self.agreements = 0;
            return true;
        }
        if point.size <= least + SAME && end == End::Converged {
            self.agreements += 1;
        }
        false
    }
}

impl InverseSolver {
    /// Nearest tip from several starts, and the last solution if there is one. Returns how its
    /// descent ended, and whether it is another one than the last solution; `None` without any
    /// equilibrium.
    ///
    /// A start that is slow pauses until the others have been tried.
    pub(super) fn search(
        &mut self,
        task: &Task,
        last: Option<(Point, End)>,
        iterations: &mut usize,
    ) -> Option<(End, bool)> {
        let mut nearest = Nearest {
            best: last,
            is_new: false,
            agreements: 0,
        };
        let mut paused: Vec<Point> = vec![];
        let mut is_best = nearest.best.is_some();
        for number in 0..STARTS {
            if nearest.is_done() {
                break;
            }
            is_best = false;
            if !self.start(task, number) {
                continue;
            }
            let end = self.descend(task, Effort::FIRST, iterations);
            let Some(end) = self.approach(task, end, iterations) else {
                continue;
            };
            if end == End::Paused {
                paused.push(self.point.clone());
            }
            is_best = nearest.compare(&self.point, end);
        }
        paused.sort_by(|a, b| a.size.total_cmp(&b.size));
        for point in paused.into_iter().take(CONTINUED) {
            if nearest.is_done() {
                break;
            }
            is_best = false;
            self.point = point;
            self.linearised = false;
            if !self.settle(false) || !self.measure(task) {
                continue;
            }
            let end = self.descend(task, Effort::SECOND, iterations);
            if let Some(end) = self.approach(task, end, iterations) {
                is_best = nearest.compare(&self.point, end);
            }
        }
        let (point, mut end) = nearest.best?;
        if !is_best {
            self.point = point;
            self.linearised = false;
            if !self.settle(false) {
                return None;
            }
        }
        if self.point.size > NEAR_TOLERANCE || self.point.outcome.error.is_none() {
            end = self.polish(task, end, iterations)?;
        }
        let reached = self.point.size <= REACHED;
        self.searched = (!reached).then(|| (task.clone(), self.point.size));
        Some((end, nearest.is_new))
    }

    /// Polishes a point that is near the target; others are compared before.
    fn approach(&mut self, task: &Task, end: End, iterations: &mut usize) -> Option<End> {
        match self.point.size <= NEAR_TOLERANCE {
            true => self.polish(task, end, iterations),
            false => self.settle(true).then_some(end),
        }
    }

    /// Refines the elements as far as the error of the point needs it, and descends with them to
    /// the tolerance of the distance. `None` if an equilibrium is lost.
    pub(super) fn polish(
        &mut self,
        task: &Task,
        mut end: End,
        iterations: &mut usize,
    ) -> Option<End> {
        loop {
            if !self.settle(true) {
                return None;
            }
            let refined = self.refine(task);
            let size = self.point.size;
            if !refined && (size <= DISTANCE_TOLERANCE || size > NEAR_TOLERANCE) {
                return Some(end);
            }
            let effort = match size <= NEAR_TOLERANCE {
                true => Effort::LAST,
                false => Effort::WHOLE,
            };
            end = self.descend(task, effort, iterations);
            if self.point.size > REACHED && size <= NEAR_TOLERANCE {
                end = self.descend(task, Effort::WHOLE, iterations);
            }
            if !refined {
                if !self.settle(true) {
                    return None;
                }
                self.estimate();
                return Some(end);
            }
        }
    }

    /// Whether the last search shows that no tip is nearer than the point's by more than the
    /// margin: the least distance changes at most as much as the target moves.
    pub(super) fn remains_nearest(&self, task: &Task) -> bool {
        self.searched.as_ref().is_some_and(|(searched, least)| {
            let bound = least - task.shift(searched, self.length);
            task.margin > 0.0 && self.point.size - bound <= task.margin
        })
    }
}

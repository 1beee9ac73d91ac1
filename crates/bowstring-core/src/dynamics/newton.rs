//! Newton's method on one step of time, or on an equilibrium.

use super::actuation::Actuation;
use crate::interrupt;
use crate::motion::Moving;

// Tuned constants of the iteration.

/// Iterations of a step before it is cut, without and with lines, whose friction is not wholly in
/// the tangent; and of a search for an equilibrium, which no cut helps.
const MAX_ITERATIONS: usize = 12;
const MAX_ITERATIONS_WITH_LINES: usize = 30;
const MAX_ITERATIONS_AT_REST: usize = 40;
/// Residual over the one before at which the tangent is too old.
const SLOW: f64 = 0.03;
/// Residual over the best so far at which the iteration diverges.
const DIVERGED: f64 = 1e6;

/// Largest moment imbalances that are accepted, N m. The first is for a step as it was predicted:
/// the errors of prediction point the same way from step to step and add up. The second is for one
/// that was corrected.
#[derive(Clone, Copy)]
pub(super) struct Tolerances {
    pub predicted: f64,
    pub corrected: f64,
}

/// What is solved.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum Problem {
    Step,
    /// A step whose longer form failed: the forces of its prediction are no guide.
    CutStep,
    /// An equilibrium, whose tangent tells whether it is stable.
    Equilibrium,
}

/// Solves for strain and tensions; counts the iterations.
pub(super) fn solve(
    motion: &mut dyn Moving,
    mut actuation: Option<&mut Actuation>,
    tolerances: Tolerances,
    problem: Problem,
    iterations: &mut usize,
) -> bool {
    let at_rest = problem == Problem::Equilibrium;
    let most = match &actuation {
        _ if at_rest => MAX_ITERATIONS_AT_REST,
        None => MAX_ITERATIONS,
        Some(_) => MAX_ITERATIONS_WITH_LINES,
    };
    let work = motion.work() * actuation.as_ref().map_or(1, |a| a.work_factor());
    let (mut best, mut last) = (f64::INFINITY, f64::INFINITY);
    for iteration in 0..=most {
        if interrupt::work(work) {
            return false;
        }
        let mut residual = motion.residual();
        let (mut settled, mut better) = (true, true);
        if let Some(actuation) = &mut actuation {
            let check = actuation.update(motion, &mut residual);
            (settled, better) = (check.settled, check.better);
        }
        let first = iteration == 0;
        let tolerance = if first {
            tolerances.predicted
        } else {
            tolerances.corrected
        };
        let makes_tangent = at_rest && first;
        if settled && residual <= tolerance && !makes_tangent {
            return true;
        }
        best = f64::min(best, residual);
        // a NaN ends it as well
        if iteration == most || !(residual < DIVERGED * f64::max(best, tolerance)) {
            return false;
        }
        let slow = residual > tolerance && residual > SLOW * last;
        let blind = problem == Problem::CutStep && first;
        if blind {
            motion.forget_forces();
        }
        let made = motion.ready(slow || !better || blind || makes_tangent);
        match &mut actuation {
            None => {
                motion.substitute();
                motion.combine(&[1.0]);
            }
            Some(actuation) => {
                if !actuation.newton_step(motion, made) {
                    return false;
                }
            }
        }
        last = residual;
        *iterations += 1;
    }
    false
}

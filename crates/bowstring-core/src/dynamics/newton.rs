//! Newton's method on one time step, or on an equilibrium.
//!
//! Theory: docs/theory/dynamics.md (Time integration).

use super::actuation::Actuation;
use crate::interrupt;
use crate::step::Moving;

// Tuned constants of the iteration.

/// Iterations of a step before it is cut, without and with tendon lines, whose friction is not
/// fully in the tangent; and iterations of a search for an equilibrium, which cannot be cut.
const MAX_ITERATIONS: usize = 12;
const MAX_ITERATIONS_WITH_LINES: usize = 30;
const MAX_ITERATIONS_AT_REST: usize = 40;
/// Ratio of successive residuals above which the tangent is recomputed.
const SLOW: f64 = 0.03;
/// Ratio of the residual to the best so far above which the iteration diverges.
const DIVERGED: f64 = 1e6;

/// Largest accepted moment imbalances (N m). The first is for a predicted step: errors of
/// prediction have the same sign from step to step and accumulate. The second is for a corrected
/// step.
#[derive(Clone, Copy)]
pub(super) struct Tolerances {
    pub predicted: f64,
    pub corrected: f64,
}

/// Problem to solve.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum Problem {
    Step,
    /// A step that was cut: the forces at its predictor are unreliable.
    CutStep,
    /// An equilibrium, whose tangent determines its stability.
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
        // a NaN ends the iteration as well
        if iteration == most || !(residual < DIVERGED * f64::max(best, tolerance)) {
            return false;
        }
        let slow = residual > tolerance && residual > SLOW * last;
        let blind = problem == Problem::CutStep && first;
        if blind {
            motion.drop_forces();
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

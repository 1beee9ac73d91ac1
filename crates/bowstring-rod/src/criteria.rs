//! Criteria of Newton's method that single solves, paths and lanes share.
//!
//! Theory: docs/theory/statics.md (Globalisation) and docs/theory/actuation.md.

use crate::rod::estimate::ErrorEstimate;

/// Largest moment imbalance over (bending stiffness / length) of a converged solution.
pub const TOLERANCE: f64 = 1e-10;
/// Residual that changes no digit of a solution: a hundredth of the tolerance.
pub const NEGLIGIBLE: f64 = 0.01 * TOLERANCE;
/// Largest rotation added by an arc in one step (rad).
pub const MAX_STEP: f64 = 1.0;
/// Largest change of an arc's rotation vector by extrapolation (rad).
pub const MAX_EXTRAPOLATION: f64 = 0.3;
/// Sufficient decrease of the energy, over the slope (Armijo's condition).
pub const SUFFICIENT_DECREASE: f64 = 1e-4;
/// Rounding of the energy, over the terms that nearly cancel in it.
pub const ENERGY_NOISE: f64 = 1e-14;
/// Length error to which displacements are met, over the robot's length: a few units of rounding.
pub const LENGTH_TOLERANCE: f64 = 2e-15;
/// The same where rounding allows no better.
pub const LOOSE: f64 = 1e-12;
/// Estimated error of the tip, over the robot's length, up to which finer elements start from the
/// strain of the coarse ones.
const START_TOLERANCE: f64 = 1e-2;
/// Regularisation, over the largest diagonal, of tensions that the rod does not distinguish.
const REGULARISATION: f64 = 1e-10;

/// Whether an elimination before a step still shows that the point after it is a minimum: the step
/// must be short, and its change of the second derivatives small beside the pivots.
#[inline(always)]
pub fn is_minimum_nearby(largest: f64, pivot: f64, unit: f64, stiffening: f64) -> bool {
    largest < 1e-4 && pivot > 0.01 * unit && largest * stiffening < 0.1 * pivot
}

/// Whether the last tangent is kept, which still shows a minimum: where the step with it ends as well
/// as Newton's own. By quadratic convergence the residual `now` after the residual `last` falls to
/// about `2 now^2 / last`.
#[inline(always)]
pub fn keeps_tangent(minimum_nearby: bool, now: f64, last: f64) -> bool {
    minimum_nearby && 2.0 * now * now <= NEGLIGIBLE * last
}

/// Whether a length error meets its tolerance, or stalls below a `loose` one.
#[inline]
pub fn is_length_settled(now: f64, last: f64, loose: f64) -> bool {
    now <= LENGTH_TOLERANCE || (now <= loose && now > 0.5 * last)
}

/// Whether finer elements can start from the strain of a coarse solution: one with a large error
/// may be on another branch.
pub fn is_near(error: &ErrorEstimate, stable: Option<bool>, length: f64) -> bool {
    error.tip <= START_TOLERANCE * length && stable.is_some()
}

/// Solves a symmetric system by Gauss-Jordan elimination without pivoting.
pub fn solve_regularised(matrix: &mut [f64], mut rhs: Vec<f64>) -> Vec<f64> {
    let n = rhs.len();
    let scale = (0..n).fold(0.0, |a: f64, i| a.max(matrix[i * n + i].abs()));
    for i in 0..n {
        matrix[i * n + i] += REGULARISATION * scale;
    }
    for i in 0..n {
        let per = 1.0 / matrix[i * n + i];
        for r in (0..n).filter(|r| *r != i) {
            let factor = matrix[r * n + i] * per;
            for c in i..n {
                matrix[r * n + c] -= factor * matrix[i * n + c];
            }
            rhs[r] -= factor * rhs[i];
        }
    }
    for i in 0..n {
        rhs[i] /= matrix[i * n + i];
    }
    rhs
}

//! Further equilibria at a load, by deflation of those that are known.
//!
//! Theory: docs/theory/statics.md (Search for all equilibria).
//!
//! Newton's method for the equations of equilibrium times `M = product (1 / |q - q_i|^2 + 1)` over
//! the known equilibria `q_i`: its step is Newton's own times `1 / (1 - grad M . step / M)`.

use crate::interrupt;
use crate::statics::continuation::{Curve, State, Vector};
use crate::statics::outcome::TOLERANCE;

/// Most steps from one start.
const MAX_STEPS: usize = 60;
/// Largest length of a step, as that of a continuation.
const LONGEST: f64 = 0.6;
/// Starts near every known equilibrium: modes, each to both sides, and their amounts.
const MODES: usize = 3;
const AMOUNTS: [f64; 2] = [0.3, 1.5];
/// Distance within which two equilibria are the same.
const SAME: f64 = 1e-4;

/// An equilibrium at a load beside those that are known; `None` if none was found. `tried` is the
/// number of starts used before.
pub(super) fn another(
    curve: &mut Curve,
    known: &[Vector],
    load: f64,
    tried: &mut usize,
) -> Option<State> {
    let starts = MODES * 2 * AMOUNTS.len();
    let mut number = 0;
    for from in known {
        if number + starts <= *tried {
            number += starts;
            continue;
        }
        let mut origin = from.clone();
        origin.load = load;
        let modes = curve.null_vectors(&origin, MODES, &[]);
        for mode in &modes {
            for amount in AMOUNTS.into_iter().flat_map(|a| [a, -a]) {
                number += 1;
                if number <= *tried {
                    continue;
                }
                *tried = number;
                if interrupt::interrupted() {
                    return None;
                }
                curve.at.set_sum(&origin, amount, mode);
                if deflated(curve, known) {
                    let mut along = Vector::zero(curve.arcs());
                    along.load = 1.0;
                    let mut state = State::empty(curve);
                    curve.settle(&along, true, &mut state);
                    if state.collision.is_none() {
                        return Some(state);
                    }
                }
            }
        }
    }
    None
}

/// Newton's method at constant load from the present point, with known equilibria deflated.
fn deflated(curve: &mut Curve, known: &[Vector]) -> bool {
    let mut step = Vector::zero(curve.arcs());
    for _ in 0..MAX_STEPS {
        let residual = curve.residual();
        if residual <= TOLERANCE {
            return !known.iter().any(|k| k.distance(&curve.at) < SAME);
        }
        if !residual.is_finite() {
            return false;
        }
        curve.newton_step(&mut step);
        let mut slope = 0.0;
        for k in known {
            let squared = curve.at.distance(k).powi(2);
            // derivative of log(1 / squared + 1) along the step
            let along = curve.at.dot(&step) - k.dot(&step);
            slope -= 2.0 * along / (squared * (1.0 + squared));
        }
        let length = step.norm();
        let mut factor = 1.0 / (1.0 - slope);
        if !(factor.abs() * length <= LONGEST) {
            factor = LONGEST.copysign(factor) / length;
        }
        if !factor.is_finite() {
            return false;
        }
        curve.at.add(factor, &step);
    }
    false
}

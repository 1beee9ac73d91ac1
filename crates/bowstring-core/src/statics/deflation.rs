//! Further equilibria at a load, by deflation of those that are known and by a force across them.
//!
//! Theory: docs/theory/statics.md (Search for all equilibria).
//!
//! Newton's method for the equations of equilibrium times `M = product (1 / |q - q_i|^2 + 1)` over
//! the known equilibria `q_i`: its step is Newton's own times `1 / (1 - grad M . step / M)`.

use crate::interrupt;
use crate::statics::branches::{LEAST_STEP, STRAIGHT, STRETCH};
use crate::statics::continuation::{Curve, Plane, State, Vector};
use crate::statics::outcome::TOLERANCE;

/// Most steps from one start.
const MAX_STEPS: usize = 60;
/// Largest length of a step, as that of a continuation.
const LONGEST: f64 = 0.6;
/// Starts near every known equilibrium: modes, each to both sides, and their amounts.
const MODES: usize = 3;
const AMOUNTS: [f64; 2] = [0.3, 1.5];
/// Transverse forces along which the known equilibria are pushed, and the largest force in units of
/// bending stiffness over length squared.
const PUSHES: [[f64; 3]; 4] = [
    [1.0, 0.0, 0.0],
    [-1.0, 0.0, 0.0],
    [0.0, 1.0, 0.0],
    [0.0, -1.0, 0.0],
];
const MOST_FORCE: f64 = 12.0;
/// Longest step and most points of a push.
const PUSH_STEP: f64 = 0.2;
const PUSH_POINTS: usize = 400;
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

/// An equilibrium at a load beside those that are known, by continuation in a transverse force from
/// each of them: where the force is zero again, there is an equilibrium. `tried` is as in
/// [`another`].
pub(super) fn pushed(
    curve: &mut Curve,
    known: &[Vector],
    load: f64,
    tried: &mut usize,
) -> Option<State> {
    for number in *tried..known.len() * PUSHES.len() {
        *tried = number + 1;
        if interrupt::interrupted() {
            return None;
        }
        let before = curve.push(load, PUSHES[number % PUSHES.len()]);
        let found = push(curve, known, &known[number / PUSHES.len()]);
        curve.restore(before);
        if !found {
            continue;
        }
        curve.at.load = load;
        let mut along = Vector::zero(curve.arcs());
        along.load = 1.0;
        let mut state = State::empty(curve);
        if curve.residual() <= TOLERANCE {
            curve.settle(&along, true, &mut state);
            if state.collision.is_none() {
                return Some(state);
            }
        }
    }
    None
}

/// Continuation in the force; whether it ends at an equilibrium without force that is not known.
fn push(curve: &mut Curve, known: &[Vector], from: &Vector) -> bool {
    let mut normal = Vector::zero(curve.arcs());
    normal.load = 1.0;
    let (mut base, mut next) = (State::empty(curve), State::empty(curve));
    curve.at.clone_from(from);
    curve.at.load = 0.0;
    if curve.residual() > TOLERANCE {
        let origin = curve.at.clone();
        let plane = Plane {
            origin: &origin,
            normal: &normal,
            offset: 0.0,
        };
        if curve.correct(&plane).is_none() {
            return false;
        }
    }
    curve.settle(&normal, true, &mut base);
    let mut step = PUSH_STEP;
    for point in 0..PUSH_POINTS {
        if step < LEAST_STEP || interrupt::interrupted() {
            return false;
        }
        curve.at.set_sum(&base.at, step, &base.tangent);
        let plane = Plane {
            origin: &base.at,
            normal: &base.tangent,
            offset: step,
        };
        let corrected = curve.correct(&plane).is_some();
        if corrected {
            curve.settle(&base.tangent, base.signature.rising, &mut next);
        }
        let turned = next.tangent.dot(&base.tangent);
        if !corrected || !(turned > STRAIGHT) || next.at.distance(&base.at) > STRETCH * step {
            step *= 0.4;
            continue;
        }
        if next.at.load.abs() > MOST_FORCE || next.collision.is_some() {
            return false;
        }
        if point > 0 && base.at.load * next.at.load < 0.0 {
            let share = base.at.load / (base.at.load - next.at.load);
            curve.at.set_sum(&base.at, share, &next.at);
            curve.at.add(-share, &base.at);
            let plane = Plane {
                origin: &base.at,
                normal: &normal,
                offset: -base.at.load,
            };
            let free = curve.correct(&plane).is_some();
            let place = |k: &Vector| {
                let strain = k.strain.iter().zip(&curve.at.strain);
                strain.map(|(a, b)| (*a - *b).norm2()).sum::<f64>() * k.strain.len() as f64
            };
            if free && !known.iter().any(|k| place(k) < SAME * SAME) {
                return true;
            }
        }
        step = f64::min(1.5 * step, PUSH_STEP);
        std::mem::swap(&mut base, &mut next);
    }
    false
}

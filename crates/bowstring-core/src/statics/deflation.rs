//! Further equilibria at a load, by deflation of those that are known and by a force across them.
//!
//! Theory: docs/theory/statics.md (Search for all equilibria).
//!
//! Newton's method for the equations of equilibrium times `M = product (1 / |q - q_i|^2 + 1)` over
//! the known equilibria `q_i`: its step is Newton's own times `1 / (1 - grad M . step / M)`.

use crate::criteria::TOLERANCE;
use crate::interrupt;
use crate::math::linalg::Vec3;
use crate::statics::continuation::{
    Curve, Plane, Side, State, Vector, LEAST_STEP, STRAIGHT, STRETCH,
};

/// Most steps from one start.
const MAX_STEPS: usize = 20;
/// Largest length of a step, as that of a continuation.
const LONGEST: f64 = 2.5;
/// Starts beside every known equilibrium: softest modes, each to both sides by an amount.
const MODES: usize = 3;
const AMOUNT: f64 = 1.0;
/// Starts at mirror images of every known equilibrium: factors of the components of its strain, for
/// half a turn about the backbone and for reflections at two planes along it.
const MIRRORS: [[f64; 3]; 3] = [[-1.0, -1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0]];
/// Starts near every known equilibrium.
const STARTS: usize = MIRRORS.len() + 2 * MODES;
/// Transverse forces along which the known equilibria are pushed, and the largest force in units of
/// bending stiffness over length squared.
const PUSHES: [[f64; 3]; 4] = [
    [1.0, 0.0, 0.0],
    [-1.0, 0.0, 0.0],
    [0.0, 1.0, 0.0],
    [0.0, -1.0, 0.0],
];
const MOST_FORCE: f64 = 12.0;
/// Longest step of a push near no force.
const PUSH_STEP: f64 = 0.2;
/// The same over the force, where that is large.
const PUSH_STEP_FAR: f64 = 0.25;
/// Most points of a push.
const PUSH_POINTS: usize = 400;
/// Residual of the points of a push.
const ROUGH: f64 = 1e-6;
/// Distance within which two equilibria are the same.
const SAME: f64 = 1e-4;

/// What has been tried at a load.
#[derive(Default)]
pub(super) struct Tried {
    /// Whether a start from the unloaded shape finds nothing more.
    unloaded: bool,
    /// Equilibria, with the number of starts used near each.
    starts: Vec<(Vector, usize)>,
    /// Equilibria, each with one of the forces, along which all is known.
    pushes: Vec<(Vector, usize)>,
}

impl Tried {
    /// Number of starts used near an equilibrium.
    fn starts_near(&mut self, at: &Vector) -> &mut usize {
        let near = |(k, _): &(Vector, usize)| are_same(k, at);
        let place = self.starts.iter().position(near).unwrap_or_else(|| {
            self.starts.push((at.clone(), 0));
            self.starts.len() - 1
        });
        &mut self.starts[place].1
    }

    fn is_pushed(&self, at: &Vector, push: usize) -> bool {
        let mut all = self.pushes.iter();
        all.any(|(k, number)| *number == push && are_same(k, at))
    }
}

/// Whether two equilibria at one load are the same.
fn are_same(a: &Vector, b: &Vector) -> bool {
    let strain = a.strain.iter().zip(&b.strain);
    let squared: f64 = strain.map(|(a, b)| (*a - *b).norm2()).sum();
    squared * (a.strain.len() as f64) < SAME * SAME
}

/// An equilibrium at a load beside those that are known; `None` if none was found.
pub(super) fn another(
    curve: &mut Curve,
    known: &[Vector],
    load: f64,
    tried: &mut Tried,
) -> Option<State> {
    if !tried.unloaded {
        curve.make_unloaded(load);
        let state = deflated(curve, known).then(|| settled(curve)).flatten();
        tried.unloaded = state.is_none();
        if state.is_some() {
            return state;
        }
    }
    for from in known {
        let used = *tried.starts_near(from);
        if used >= STARTS {
            continue;
        }
        let mut origin = from.clone();
        origin.load = load;
        let mut modes = vec![];
        for number in used..STARTS {
            *tried.starts_near(from) += 1;
            if interrupt::interrupted() {
                return None;
            }
            if let Some(mirror) = MIRRORS.get(number) {
                curve.at.clone_from(&origin);
                for w in &mut curve.at.strain {
                    *w = Vec3([0, 1, 2].map(|q| mirror[q] * w[q]));
                }
            } else {
                if modes.is_empty() {
                    modes = curve.null_vectors(&origin, MODES, &[]);
                }
                let start = number - MIRRORS.len();
                let amount = if start.is_multiple_of(2) {
                    AMOUNT
                } else {
                    -AMOUNT
                };
                curve.at.set_sum(&origin, amount, &modes[start / 2]);
            }
            if deflated(curve, known) {
                if let Some(state) = settled(curve) {
                    return Some(state);
                }
            }
        }
    }
    None
}

/// The state of the present point, an equilibrium, if no disks collide.
fn settled(curve: &mut Curve) -> Option<State> {
    let mut along = Vector::zero(curve.arcs());
    along.load = 1.0;
    let mut state = State::empty(curve);
    if curve.residual() > TOLERANCE {
        return None;
    }
    curve.settle(&along, true, &mut state);
    state.collision.is_none().then_some(state)
}

/// Newton's method at constant load from the present point, with known equilibria deflated.
fn deflated(curve: &mut Curve, known: &[Vector]) -> bool {
    let mut step = Vector::zero(curve.arcs());
    for _ in 0..MAX_STEPS {
        let residual = curve.residual_alone();
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
/// each of them: where the force is zero again, there is an equilibrium.
pub(super) fn pushed(
    curve: &mut Curve,
    known: &[Vector],
    load: f64,
    tried: &mut Tried,
) -> Option<State> {
    for from in known {
        for number in 0..PUSHES.len() {
            if tried.is_pushed(from, number) {
                continue;
            }
            if interrupt::interrupted() {
                return None;
            }
            tried.pushes.push((from.clone(), number));
            let before = curve.push(load, PUSHES[number]);
            let found = push(curve, known, (from, number), tried);
            curve.restore(before);
            if found {
                curve.at.load = load;
                if let Some(state) = settled(curve) {
                    return Some(state);
                }
            }
        }
    }
    None
}

/// Continuation in the force; whether it ends at an equilibrium without force that is not known.
///
/// Both directions of a force from an equilibrium are one curve, and so are those from all
/// equilibria that it meets: none of them needs to be followed again.
fn push(
    curve: &mut Curve,
    known: &[Vector],
    (from, number): (&Vector, usize),
    tried: &mut Tried,
) -> bool {
    let mut normal = Vector::zero(curve.arcs());
    normal.load = 1.0;
    let (mut base, mut next) = (State::empty(curve), State::empty(curve));
    let mut before = State::empty(curve);
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
    curve.pass(&normal, &mut base);
    let mut met: Vec<(Vector, usize)> = vec![];
    let mut step = PUSH_STEP;
    let mut taken = 0;
    for _ in 0..PUSH_POINTS {
        if step < LEAST_STEP || interrupt::interrupted() {
            return false;
        }
        let other = (taken > 0).then_some((&before, Side::Behind));
        curve.predict(&base, step, other);
        let plane = Plane {
            origin: &base.at,
            normal: &base.tangent,
            offset: step,
        };
        let corrected = curve.correct_to(ROUGH, &plane).is_some();
        if corrected {
            curve.pass(&base.tangent, &mut next);
        }
        let turned = next.tangent.dot(&base.tangent);
        if !corrected || !(turned > STRAIGHT) || next.at.distance(&base.at) > STRETCH * step {
            step *= 0.4;
            continue;
        }
        if next.collision.is_some() {
            return false;
        }
        if next.at.load.abs() > MOST_FORCE {
            tried.pushes.append(&mut met);
            return false;
        }
        if taken > 0 && base.at.load * next.at.load < 0.0 {
            let share = base.at.load / (base.at.load - next.at.load);
            curve.at.set_sum(&base.at, share, &next.at);
            curve.at.add(-share, &base.at);
            let plane = Plane {
                origin: &base.at,
                normal: &normal,
                offset: -base.at.load,
            };
            if curve.correct(&plane).is_some() {
                // the push whose force rises from here backwards, and onwards
                let (back, on) = match base.at.load > 0.0 {
                    true => (number, number ^ 1),
                    false => (number ^ 1, number),
                };
                let place = curve.at.clone();
                let is_known = known.iter().any(|k| are_same(k, &place));
                if !is_known && curve.collides() {
                    return false;
                }
                tried.pushes.push((place.clone(), back));
                if are_same(from, &place) || !is_known {
                    // a closed curve, or the rest is followed from the new equilibrium
                    tried.pushes.append(&mut met);
                    return !is_known;
                }
                met.push((place, on));
            }
        }
        let far = next.at.load.abs();
        step = f64::min(1.5 * step, f64::max(PUSH_STEP, PUSH_STEP_FAR * far));
        std::mem::swap(&mut before, &mut base);
        std::mem::swap(&mut base, &mut next);
        taken += 1;
    }
    false
}

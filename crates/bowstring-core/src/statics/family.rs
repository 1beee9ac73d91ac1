//! Branches that leave a family of equal equilibria, such as those of a round robot that has buckled
//! in any plane, when a load begins that acts on its members differently.
//!
//! Theory: docs/theory/statics.md (Search for all equilibria).

use crate::interrupt;
use crate::statics::continuation::{Curve, Plane, State, Vector, STRAIGHT};

/// Motion along the direction of the softest mode by the scaled load, from which a point is on a
/// family that the load does not keep: elsewhere it is of the order of one.
const PULLED: f64 = 1e3;
/// Longest and shortest step along a family, and most steps.
const STEP: f64 = 0.3;
const LEAST_STEP: f64 = 1e-3;
const MOST_STEPS: usize = 1000;
/// Bisections of a step in which the pull of the load along the family changes its sign.
const BISECTIONS: usize = 40;
/// Scaled loads at which branches are entered.
const FIRST_LOADS: [f64; 3] = [0.01, 0.003, 0.001];
/// Largest distance of the first point of a branch over its load.
const NEAR: f64 = 30.0;
/// Distance within which two members are the same.
const SAME: f64 = 1e-3;

/// What a load does to the equilibria of a family.
pub(super) enum Fate {
    /// The start is not on a family.
    Alone,
    /// All of them remain equal equilibria.
    Kept,
    /// Some of them are on branches: their points, each with the next one of its branch.
    Parted(Vec<[State; 2]>),
}

/// A point of a family.
struct Member {
    at: Vector,
    /// Unit vector along the family.
    along: Vector,
    /// Motion along it by the scaled load, without the resistance that it does not have.
    pull: f64,
}

/// The present point of the curve on its family.
fn member(curve: &mut Curve, before: Option<&Vector>) -> Member {
    let at = curve.at.clone();
    let null = curve.null_vectors(&at, 1, &[]);
    let mut along = null.into_iter().next().expect("one was asked for");
    if before.is_some_and(|before| before.dot(&along) < 0.0) {
        along.scale(-1.0);
    }
    let pull = curve.motion_along(&along);
    Member { at, along, pull }
}

/// The member of the family at a distance from another, about.
fn beside(curve: &mut Curve, from: &Member, distance: f64) -> Option<Member> {
    curve.at.set_sum(&from.at, distance, &from.along);
    curve.family = true;
    let corrected = hold_load(curve, &from.at, 0.0);
    curve.family = false;
    if !corrected {
        return None;
    }
    curve.at.load = from.at.load;
    Some(member(curve, Some(&from.along)))
}

/// Corrects the present point at a load beyond that of another point.
fn hold_load(curve: &mut Curve, origin: &Vector, offset: f64) -> bool {
    let mut normal = Vector::zero(curve.arcs());
    normal.load = 1.0;
    let plane = Plane {
        origin,
        normal: &normal,
        offset,
    };
    curve.correct(&plane).is_some()
}

/// Where the branches begin that leave the family of an equilibrium, if it is on one.
///
/// Along the family the load does work; it leaves those equilibria where this work is stationary.
pub(super) fn fate(curve: &mut Curve, start: &State) -> Fate {
    curve.at.clone_from(&start.at);
    let first = member(curve, None);
    if start.neutral == 0 && !(first.pull.abs() > PULLED) {
        return Fate::Alone;
    }
    let mut kept = true;
    let mut entered: Vec<[State; 2]> = vec![];
    let (mut step, mut gone) = (0.1 * STEP, 0.0);
    let mut base = Member {
        at: first.at.clone(),
        along: first.along.clone(),
        pull: first.pull,
    };
    for _ in 0..MOST_STEPS {
        kept &= !(base.pull.abs() > PULLED);
        if step < LEAST_STEP || interrupt::interrupted() {
            break;
        }
        let next = beside(curve, &base, step);
        let next = next.filter(|next| {
            let went = next.at.distance(&base.at);
            next.along.dot(&base.along) > STRAIGHT && went < 2.0 * step && went > 0.5 * step
        });
        let Some(next) = next else {
            step *= 0.4;
            continue;
        };
        if base.pull * next.pull < 0.0 && f64::max(base.pull.abs(), next.pull.abs()) > PULLED {
            let found = enter(curve, &base, step);
            let is_new = |[origin, _]: &[State; 2]| {
                let mut before = entered.iter();
                before.all(|[other, _]| other.at.distance(&origin.at) > SAME)
            };
            entered.extend(found.filter(is_new));
        }
        gone += next.at.distance(&base.at);
        let closed = next.at.distance(&first.at) < 0.7 * step && gone > 1.5 * step;
        base = next;
        step = f64::min(1.3 * step, STEP);
        if closed {
            break;
        }
    }
    match kept {
        _ if gone == 0.0 => Fate::Alone,
        true => Fate::Kept,
        false => Fate::Parted(entered),
    }
}

/// The member of a family within a step from another at which the pull of the load changes its sign,
/// and the next point of its branch.
fn enter(curve: &mut Curve, base: &Member, step: f64) -> Option<[State; 2]> {
    let (mut low, mut high) = (0.0, step);
    for _ in 0..BISECTIONS {
        let middle = 0.5 * (low + high);
        let pull = beside(curve, base, middle)?.pull;
        match pull * base.pull > 0.0 {
            true => low = middle,
            false => high = middle,
        }
    }
    let origin = beside(curve, base, 0.5 * (low + high))?.at;
    let mut along = Vector::zero(curve.arcs());
    along.load = 1.0;
    let mut states = [State::empty(curve), State::empty(curve)];
    for load in FIRST_LOADS {
        curve.at.clone_from(&origin);
        curve.at.load += load;
        if !hold_load(curve, &origin, load) || curve.at.distance(&origin) > NEAR * load {
            continue;
        }
        curve.settle(&along, true, &mut states[1]);
        curve.at.clone_from(&origin);
        curve.residual();
        curve.settle(&along, true, &mut states[0]);
        return Some(states);
    }
    None
}

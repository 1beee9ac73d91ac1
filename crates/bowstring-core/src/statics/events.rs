//! Limit points and bifurcations between two points of a branch, and the branches that leave them.
//!
//! Theory: docs/theory/statics.md (Limit points and bifurcations).

use crate::statics::continuation::{Curve, Plane, Side, Signature, State, Vector};

/// Length of the interval that encloses an event.
const LOCATED: f64 = 1e-9;
/// Distance beyond an event within which all that changes belongs to it.
const TOGETHER: f64 = 1e-5;
/// Most events in one step of the continuation.
const MAX_EVENTS: usize = 8;
/// Distances from a bifurcation at which a branch that leaves it is sought.
const DISTANCES: [f64; 3] = [0.03, 0.01, 0.003];
/// Largest distance of the point found over that of its plane.
const NEAR: f64 = 5.0;
/// Cosine of the angle below which two branches leave to different sides.
const SAME_SIDE: f64 = 0.97;
/// Most sides to which isolated branches leave; more of them make a family.
const MAX_SIDES: usize = 12;
/// Directions sought in a plane of null vectors.
const DIRECTIONS: usize = 24;

/// What happens at an event.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EventKind {
    /// The load factor has an extremum along the branch: a robot that is loaded further snaps.
    LimitPoint,
    /// Branches meet.
    Bifurcation,
}

impl EventKind {
    /// The word of the kind in the outputs.
    pub fn word(self) -> &'static str {
        match self {
            EventKind::LimitPoint => "limit_point",
            EventKind::Bifurcation => "bifurcation",
        }
    }
}

/// An event that has been located.
pub(super) struct Located {
    pub kind: EventKind,
    /// Number of eigenvalues that change their sign.
    pub multiplicity: usize,
    /// Whether it is where all branches of a family meet: on another branch, which crosses them.
    pub is_hub: bool,
    pub state: State,
}

/// A step of the continuation from one point to another.
pub(super) struct Step<'a> {
    pub base: &'a State,
    pub next: &'a State,
}

impl Step<'_> {
    /// Length along the tangent at its base.
    fn length(&self) -> f64 {
        let tangent = &self.base.tangent;
        self.next.at.dot(tangent) - self.base.at.dot(tangent)
    }

    /// Moves the curve to the point at a length along the tangent.
    fn go(&self, curve: &mut Curve, s: f64) -> bool {
        curve.predict(self.base, s, Some((self.next, Side::Ahead)));
        let plane = Plane {
            origin: &self.base.at,
            normal: &self.base.tangent,
            offset: s,
        };
        curve.correct(&plane).is_some()
    }

    fn signature(&self, curve: &mut Curve, s: f64, scratch: &mut Vector) -> Option<Signature> {
        self.go(curve, s).then(|| curve.probe(self.base, scratch))
    }

    /// Whether the step ends at load factor 0 on a family of equal equilibria, where one eigenvalue
    /// becomes zero without a change of its sign.
    fn ends_on_family(&self) -> bool {
        let [base, next] = [self.base, self.next];
        let both = |state: &State| state.unstable + state.neutral;
        next.at.load == 0.0
            && next.neutral > base.neutral
            && both(next) == both(base)
            && next.signature.rising == base.signature.rising
    }

    /// Locates the events of the step; `None` where the points between do not converge.
    pub fn events(&self, curve: &mut Curve) -> Option<Vec<Located>> {
        let mut found = vec![];
        let (mut now, last) = (self.base.signature, self.next.signature);
        if now == last || self.ends_on_family() {
            return Some(found);
        }
        let length = self.length();
        let mut scratch = Vector::zero(curve.arcs());
        let mut start = 0.0;
        while now != last {
            let (mut low, mut high) = (start, length);
            while high - low > LOCATED {
                let middle = 0.5 * (low + high);
                if self.signature(curve, middle, &mut scratch)? == now {
                    low = middle;
                } else {
                    high = middle;
                }
            }
            let beyond = f64::min(high + TOGETHER, length);
            let after = self.signature(curve, beyond, &mut scratch)?;
            let multiplicity = after.unstable.abs_diff(now.unstable);
            let turns = after.rising != now.rising;
            // where a family turns as it passes its hub, its halves are equally stable
            let is_hub = curve.family && turns && self.base.unstable == self.next.unstable;
            let kind = match (turns, multiplicity) {
                (true, _) if curve.family && !is_hub => EventKind::LimitPoint,
                (true, 1) => EventKind::LimitPoint,
                (false, 0) => break,
                _ => EventKind::Bifurcation,
            };
            if !self.go(curve, high) {
                return None;
            }
            let mut state = State::empty(curve);
            curve.settle(&self.base.tangent, now.rising, &mut state);
            // at a limit point the tangent is that of constant load
            state.signature = now;
            if is_hub {
                // all branches of the family meet: eigenvalues there are zero within rounding
                (state.unstable, state.neutral) = (self.base.unstable, self.base.neutral);
                state.stable = self.base.stable;
            }
            found.push(Located {
                kind,
                multiplicity: multiplicity.max(1),
                is_hub,
                state,
            });
            if found.len() == MAX_EVENTS || beyond >= length {
                break;
            }
            (now, start) = (after, beyond);
        }
        Some(found)
    }
}

/// First points of the branches that leave a bifurcation, on all sides. Of a family of equal
/// branches, as those of a round rod that buckles in any plane, one is returned.
pub(super) fn leaving(curve: &mut Curve, from: &Located) -> Vec<State> {
    let origin = &from.state;
    curve.family = false;
    if from.is_hub {
        let mut across = curve.motion_across(&origin.at, 2);
        let there = leave(curve, origin, &across);
        across.scale(-1.0);
        let back = leave(curve, origin, &across);
        return there.into_iter().chain(back).collect();
    }
    let null = curve.null_vectors(&origin.at, from.multiplicity, &[&origin.tangent]);
    let mut out: Vec<State> = vec![];
    let mut sides_taken: Vec<Vector> = vec![];
    let mut direction = Vector::zero(curve.arcs());
    for (sides, turn) in planes(&null) {
        for side in 0..sides {
            let angle = std::f64::consts::TAU * side as f64 / sides as f64;
            direction.set_sum(turn.0, angle.cos() - 1.0, turn.0);
            direction.add(angle.sin(), turn.1);
            let Some(state) = leave(curve, origin, &direction) else {
                continue;
            };
            let mut way = state.at.clone();
            way.add(-1.0, &origin.at);
            let along = way.dot(&origin.tangent);
            way.add(-along, &origin.tangent);
            way.scale(1.0 / way.norm());
            if sides_taken.iter().any(|taken| taken.dot(&way) > SAME_SIDE) {
                continue;
            }
            sides_taken.push(way);
            out.push(state);
            if out.len() > MAX_SIDES {
                curve.family = true;
                let first = leave(curve, origin, turn.0);
                return first.into_iter().collect();
            }
        }
    }
    out
}

/// Pairs of null vectors, and the number of directions to seek in the plane of each.
fn planes(null: &[Vector]) -> Vec<(usize, (&Vector, &Vector))> {
    if let [only] = null {
        return vec![(2, (only, only))];
    }
    let first = (0..null.len()).flat_map(|i| (i + 1..null.len()).map(move |j| (i, j)));
    first
        .map(|(i, j)| (DIRECTIONS, (&null[i], &null[j])))
        .collect()
}

/// First point of a branch in a direction.
fn leave(curve: &mut Curve, origin: &State, direction: &Vector) -> Option<State> {
    for distance in DISTANCES {
        curve.at.set_sum(&origin.at, distance, direction);
        let plane = Plane {
            origin: &origin.at,
            normal: direction,
            offset: distance,
        };
        if curve.correct(&plane).is_none() {
            continue;
        }
        if curve.at.distance(&origin.at) > NEAR * distance {
            continue;
        }
        let mut along = curve.at.clone();
        along.add(-1.0, &origin.at);
        let mut state = State::empty(curve);
        curve.settle(&along, along.load >= 0.0, &mut state);
        return Some(state);
    }
    None
}

//! Branch diagrams: all equilibria that continuation from an unloaded robot reaches.
//!
//! Theory: docs/theory/statics.md (Continuation, Search for all equilibria).

use crate::interrupt;
use crate::math::lie::Pose;
use crate::math::linalg::Vec3;
use crate::model::error::InputError;
use crate::model::load::RodModel;
use crate::model::robot::Robot;
use crate::outcome::Outcome;
pub use crate::statics::continuation::LoadPath;
use crate::statics::continuation::{
    Curve, Plane, Side, State, Vector, LEAST_STEP, STRAIGHT, STRETCH,
};
use crate::statics::deflation;
pub use crate::statics::events::EventKind;
use crate::statics::events::{leaving, Located, Step};
use crate::statics::family::{self, Fate};
use crate::statics::solver::{Solver, Status};
use std::collections::VecDeque;

/// First length of a step over the largest one.
const FIRST_STEP: f64 = 0.2;
/// Newton steps of a correction up to which the next step is longer, or from which it is shorter.
const FEW_CORRECTIONS: usize = 3;
const MANY_CORRECTIONS: usize = 5;
/// Factors of the next step, and after one that failed.
const LONGER: f64 = 1.5;
const SHORTER: f64 = 0.6;
const FAILED: f64 = 0.4;
/// Longest step where a branch is straight, over the range of the load.
const LONGEST_STEP: f64 = 0.01;
/// Rotation and turn of the tangent, over the length of a step, below which the branch is straight.
const NEARLY_STRAIGHT: f64 = 0.1;
/// Distance within which two points are the same.
const SAME: f64 = 1e-4;
/// Difference of scaled loads within which they are the same.
const SAME_LOAD: f64 = 1e-9;
/// Distance from a chord of a branch within which a point may be on it, over the chord.
const BESIDE_CHORD: f64 = 0.2;
/// Points of a branch before it can close.
const LEAST_LOOP: usize = 8;

/// How far and how finely branches are followed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Search {
    /// Largest load factor; the least one is 0.
    pub most: f64,
    /// Largest step along a branch: radians of rotation, and the load over the one that bends the
    /// robot by about 1 rad. Where the branch is straight, its load grows in longer steps.
    pub step: f64,
    /// Most points of a branch.
    pub points: usize,
    /// Most branches.
    pub branches: usize,
    /// Whether equilibria beside the branches found are sought by deflation, at load factor 1.
    pub deflation: bool,
    /// Whether the search ends where the first branch is no longer stable.
    pub first_loss: bool,
}

impl Default for Search {
    fn default() -> Self {
        Search {
            most: 1.0,
            step: 0.05,
            points: 2000,
            branches: 40,
            deflation: true,
            first_loss: false,
        }
    }
}

/// Why a branch ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum End {
    /// The load factor reaches 0 or its largest value.
    Range,
    /// It returns to its first point.
    Closed,
    /// It meets another branch at a bifurcation.
    Joined,
    /// Two disks collide.
    Collision,
    /// The first branch is no longer stable, and only this was asked for.
    Unstable,
    /// The most points were reached.
    Points,
    /// Newton's method does not converge in the shortest step.
    Lost,
}

impl End {
    /// The word of the end in the outputs.
    pub fn word(self) -> &'static str {
        match self {
            End::Range => "range",
            End::Closed => "closed",
            End::Joined => "joined",
            End::Collision => "collision",
            End::Unstable => "unstable",
            End::Points => "points",
            End::Lost => "lost",
        }
    }
}

/// An equilibrium on a branch.
#[derive(Clone, Debug)]
pub struct Point {
    /// Load factor.
    pub factor: f64,
    /// Length along the branch from its first point.
    pub arclength: f64,
    /// Whether the equilibrium is stable, as in [`Outcome::stable`]; also `None` where an
    /// eigenvalue of the second variation is zero, as at limit points and bifurcations.
    pub stable: Option<bool>,
    /// Number of negative eigenvalues of the second variation; `None` under a moment.
    pub unstable_modes: Option<usize>,
    /// Number of eigenvalues that are zero within rounding.
    pub neutral_modes: usize,
    /// Largest moment imbalance over (bending stiffness / length).
    pub residual: f64,
    /// Poses of all disks from base to tip.
    pub disks: Vec<Pose>,
    at: Vector,
}

/// A limit point or a bifurcation.
#[derive(Clone, Copy, Debug)]
pub struct Event {
    /// What happens.
    pub kind: EventKind,
    /// Its point on the branch.
    pub point: usize,
    /// Number of eigenvalues that change their sign.
    pub multiplicity: usize,
}

/// A branch of equilibria.
#[derive(Clone, Debug)]
pub struct Branch {
    /// Points in order.
    pub points: Vec<Point>,
    /// Events in order.
    pub events: Vec<Event>,
    /// Branch and event at which it begins; `None` for the first branch, for those that begin at
    /// load factor 0 beside it, and for those that deflation found.
    pub origin: Option<(usize, usize)>,
    /// Why it ends.
    pub end: End,
}

/// Branches of equilibria along a load path.
#[derive(Clone, Debug)]
pub struct Diagram {
    /// How the solve at load factor 0 ended; without a solution there are no branches.
    pub start: Outcome,
    /// Branches; the first one begins at load factor 0.
    pub branches: Vec<Branch>,
    /// Whether every bifurcation was followed: fewer branches were found than allowed, and all
    /// were followed to their ends.
    pub complete: bool,
    /// Whether deflation was used.
    pub deflated: bool,
    /// Elements in every module.
    pub elements: usize,
}

/// Follows the branches of equilibria along a load path.
///
/// # Errors
/// If a load does not fit the robot, both loads are equal, or the robot does not fit into memory.
pub fn diagram(
    robot: &Robot,
    model: &RodModel,
    path: &LoadPath,
    search: &Search,
) -> Result<Diagram, InputError> {
    path.from.borrow().check(robot)?;
    path.to.borrow().check(robot)?;
    let to = path.to.borrow();
    to.check_sections(robot, &path.from.point_loads)?;
    let least = to.least_elements_beside(robot, &path.from.point_loads);
    let scale = path.scale(robot);
    if !scale.is_finite() {
        return Err(InputError::other(
            "the loads at factor 0 and at factor 1 are equal; give two different loads",
        ));
    }
    // a robot that is much stiffer than its load needs no long steps
    let scale = f64::min(scale, search.most);
    let mut elements = model.elements.unwrap_or(least);
    to.check_elements_beside(robot, elements, &path.from.point_loads)?;
    let begin = path.begin();
    loop {
        let mut solver = Solver::new(robot, model.model, elements)?;
        let start = solver.solve(&begin.borrow())?;
        let mut found = Following {
            search: *search,
            curve: Curve::new(solver, path, scale),
            branches: vec![],
            bifurcations: vec![],
            left: VecDeque::new(),
            needed: elements,
            enough: match model.elements {
                Some(_) => usize::MAX,
                None => elements,
            },
            complete: true,
        };
        let mut deflated = false;
        if start.status == Status::Converged {
            found.follow_all();
            if search.deflation && !search.first_loss {
                deflated = found.deflate();
            }
        }
        if !found.is_coarse() || interrupt::interrupted() {
            return Ok(Diagram {
                start,
                branches: found.branches,
                complete: found.complete,
                deflated,
                elements,
            });
        }
        elements = found.needed;
    }
}

/// The search, with what it has found.
struct Following {
    search: Search,
    curve: Curve,
    branches: Vec<Branch>,
    /// Bifurcations found.
    bifurcations: Vec<Vector>,
    /// Bifurcations whose branches are not followed yet, by branch and event.
    left: VecDeque<(usize, usize, Located)>,
    /// Elements that the points ask for.
    needed: usize,
    /// Elements beyond which the search is repeated with more of them.
    enough: usize,
    complete: bool,
}

impl Following {
    /// Whether the search ends, to be repeated with more elements.
    fn is_coarse(&self) -> bool {
        self.needed > self.enough
    }

    /// The first branch, and all that leave it and each other.
    fn follow_all(&mut self) {
        let mut first = State::empty(&self.curve);
        let mut along = Vector::zero(self.curve.arcs());
        along.load = 1.0;
        self.curve.residual();
        self.curve.settle(&along, true, &mut first);
        match family::fate(&mut self.curve, &first) {
            Fate::Alone => {}
            Fate::Kept => self.curve.family = true,
            Fate::Parted(mut entered) => {
                // those that remain stable first
                entered.sort_by_key(|[_, next]| next.unstable);
                for [origin, next] in entered {
                    if self.branches.len() == self.search.branches {
                        self.complete = false;
                        break;
                    }
                    let length = next.at.distance(&origin.at);
                    let begun = vec![self.record(&origin, 0.0), self.record(&next, length)];
                    self.follow(next, begun, None);
                }
            }
        }
        if self.branches.is_empty() {
            self.curve.at.clone_from(&first.at);
            self.curve.residual();
            self.curve.settle(&along, true, &mut first);
            let begun = vec![self.record(&first, 0.0)];
            self.follow(first, begun, None);
        }
        self.follow_left();
    }

    /// All branches that leave the bifurcations found.
    fn follow_left(&mut self) {
        while let Some((branch, event, located)) = self.left.pop_front() {
            if self.is_coarse() {
                return;
            }
            let origin = &located.state;
            let states = leaving(&mut self.curve, &located);
            let family = self.curve.family;
            for state in states {
                self.curve.family = family;
                if self.is_known(&state.at) {
                    continue;
                }
                if self.branches.len() == self.search.branches {
                    self.complete = false;
                    return;
                }
                let at = self.branches[branch].events[event].point;
                let begun = self.branches[branch].points[at].clone();
                let mut begun = vec![Point {
                    arclength: 0.0,
                    ..begun
                }];
                let length = state.at.distance(&origin.at);
                if !self.is_within(&state) {
                    continue;
                }
                begun.push(self.record(&state, length));
                self.follow(state, begun, Some((branch, event)));
            }
        }
    }

    /// Equilibria beside the branches at load factor 1, and their branches; whether they could be
    /// sought.
    fn deflate(&mut self) -> bool {
        let one = 1.0 / self.curve.scale;
        // a family of equal equilibria cannot be excluded by some of them
        if self.search.most < 1.0 || self.has_family_at(one) {
            return false;
        }
        let mut tried = deflation::Tried::default();
        loop {
            if self.is_coarse() {
                return false;
            }
            self.curve.family = false;
            let known = self.at_load(one);
            let state = deflation::another(&mut self.curve, &known, one, &mut tried)
                .or_else(|| deflation::pushed(&mut self.curve, &known, one, &mut tried));
            let Some(state) = state else {
                return true;
            };
            if self.branches.len() == self.search.branches {
                self.complete = false;
                return true;
            }
            let is_one_of_many = state.neutral > 0;
            self.curve.family = is_one_of_many;
            let mut begun = vec![self.record(&state, 0.0)];
            let mut back = state.clone();
            back.tangent.scale(-1.0);
            back.signature.rising = !state.signature.rising;
            let first = self.branches.len();
            self.follow(back, begun.clone(), None);
            let half = self.branches.last_mut().expect("it was just followed");
            if half.end != End::Closed {
                // both halves make one branch
                let half = self.branches.pop().expect("it was just followed");
                let total = half.points.last().map_or(0.0, |p| p.arclength);
                let count = half.points.len();
                begun = half.points;
                begun.reverse();
                for point in &mut begun {
                    point.arclength = total - point.arclength;
                }
                let mut events = half.events;
                events.reverse();
                for event in &mut events {
                    event.point = count - 1 - event.point;
                }
                let before = events.len();
                for (branch, event, _) in &mut self.left {
                    if *branch == first {
                        *event = before - 1 - *event;
                    }
                }
                self.curve.family = is_one_of_many;
                self.follow_on(state, begun, events, None);
            }
            self.follow_left();
            if is_one_of_many {
                return false;
            }
        }
    }

    /// Whether a branch of a family of equal ones reaches a load.
    fn has_family_at(&self, load: f64) -> bool {
        let is_on = |p: &Point| p.neutral_modes > 0;
        self.branches.iter().any(|branch| {
            let mut pairs = branch.points.windows(2);
            pairs.any(|pair| {
                let [a, b] = [0, 1].map(|i| pair[i].at.load - load);
                is_on(&pair[0]) && is_on(&pair[1]) && (a * b <= 0.0 || b.abs() < SAME_LOAD)
            })
        })
    }

    /// Equilibria of all branches at a load.
    fn at_load(&mut self, load: f64) -> Vec<Vector> {
        let mut known: Vec<Vector> = vec![];
        let mut normal = Vector::zero(self.curve.arcs());
        normal.load = 1.0;
        for point in self.branches.iter().flat_map(|b| &b.points) {
            let near = (point.at.load - load).abs() < SAME_LOAD;
            if near && !known.iter().any(|k| k.distance(&point.at) < SAME) {
                known.push(point.at.clone());
            }
        }
        // branches that cross the load between two points
        for branch in &self.branches {
            for pair in branch.points.windows(2) {
                let (a, b) = (&pair[0].at, &pair[1].at);
                if (a.load - load) * (b.load - load) >= 0.0 {
                    continue;
                }
                let mut between = a.clone();
                let share = (load - a.load) / (b.load - a.load);
                between.add(share, b);
                between.add(-share, a);
                self.curve.at.clone_from(&between);
                let plane = Plane {
                    origin: &between,
                    normal: &normal,
                    offset: 0.0,
                };
                // the chord may be farther from the branch than two points that are the same
                let is_corrected = self.curve.correct(&plane).is_some()
                    && self.curve.at.distance(&between) < BESIDE_CHORD * a.distance(b);
                let crossing = match is_corrected {
                    true => &self.curve.at,
                    false => &between,
                };
                if !known.iter().any(|k| k.distance(crossing) < SAME) {
                    known.push(crossing.clone());
                }
            }
        }
        known
    }

    fn is_within(&self, state: &State) -> bool {
        let most = self.search.most / self.curve.scale;
        (0.0..=most).contains(&state.at.load)
    }

    fn record(&self, state: &State, arclength: f64) -> Point {
        let is_last = state.at.load == self.search.most / self.curve.scale;
        Point {
            factor: match is_last {
                true => self.search.most,
                false => self.curve.factor(state.at.load),
            },
            arclength,
            stable: state.stable,
            unstable_modes: self.curve.symmetric.then_some(state.unstable),
            neutral_modes: state.neutral,
            residual: state.residual,
            disks: state.disks.clone(),
            at: state.at.clone(),
        }
    }

    fn follow(&mut self, first: State, begun: Vec<Point>, origin: Option<(usize, usize)>) {
        self.follow_on(first, begun, vec![], origin);
    }

    /// Follows a branch from its last point so far.
    fn follow_on(
        &mut self,
        first: State,
        points: Vec<Point>,
        events: Vec<Event>,
        origin: Option<(usize, usize)>,
    ) {
        let index = self.branches.len();
        let begun = points.len();
        let mut branch = Branch {
            points,
            events,
            origin,
            end: End::Points,
        };
        let mut base = first;
        let (mut last, mut next) = (State::empty(&self.curve), State::empty(&self.curve));
        let mut steps = 0;
        let mut step = FIRST_STEP * self.search.step;
        while branch.points.len() < self.search.points {
            let other = (steps > 0).then_some((&last, Side::Behind));
            let taken = self.step(&base, step, other, &mut next);
            if taken.is_some() && step > self.search.step && self.meets_something(&base, &next) {
                step = f64::max(FAILED * step, self.search.step);
                continue;
            }
            let located = taken.and_then(|corrections| {
                let events = Step {
                    base: &base,
                    next: &next,
                };
                Some((corrections, events.events(&mut self.curve)?))
            });
            let Some((corrections, located)) = located else {
                step *= FAILED;
                if step < LEAST_STEP || interrupt::interrupted() {
                    branch.end = End::Lost;
                    break;
                }
                continue;
            };
            self.needed = self.needed.max(next.needed);
            if self.is_coarse() {
                break;
            }
            let before = branch.points.last().map_or(0.0, |p| p.arclength);
            let mut joined = false;
            for event in located {
                let arclength = before + event.state.at.distance(&base.at);
                branch.events.push(Event {
                    kind: event.kind,
                    point: branch.points.len(),
                    multiplicity: event.multiplicity,
                });
                branch.points.push(self.record(&event.state, arclength));
                if event.kind == EventKind::Bifurcation {
                    let place = &event.state.at;
                    if self.bifurcations.iter().any(|b| b.distance(place) < SAME) {
                        joined = true;
                        break;
                    }
                    self.bifurcations.push(place.clone());
                    joined = event.is_hub;
                    self.left.push_back((index, branch.events.len() - 1, event));
                    if joined {
                        break;
                    }
                }
            }
            if joined {
                branch.end = End::Joined;
                break;
            }
            let length = next.at.distance(&base.at);
            branch.points.push(self.record(&next, before + length));
            let most = self.search.most / self.curve.scale;
            if next.collision.is_some() {
                branch.end = End::Collision;
                break;
            }
            if next.at.load == 0.0 || next.at.load == most {
                branch.end = End::Range;
                break;
            }
            if self.search.first_loss && next.stable == Some(false) {
                branch.end = End::Unstable;
                break;
            }
            let since = branch.points.len() - begun;
            let near = 0.5 * f64::min(step, self.search.step);
            if since > LEAST_LOOP && next.at.distance(&branch.points[begun - 1].at) < near {
                branch.end = End::Closed;
                break;
            }
            step *= match corrections {
                c if c <= FEW_CORRECTIONS => LONGER,
                c if c >= MANY_CORRECTIONS => SHORTER,
                _ => 1.0,
            };
            step = f64::min(step, self.longest_step(&base, &next));
            std::mem::swap(&mut last, &mut base);
            std::mem::swap(&mut base, &mut next);
            steps += 1;
        }
        self.complete &= !matches!(branch.end, End::Points | End::Lost);
        self.branches.push(branch);
    }

    /// Longest step behind one: rotations, and the turn of the tangent, stay within those of the
    /// largest step where the branch is straight, as that of a straight robot that is compressed.
    fn longest_step(&self, base: &State, next: &State) -> f64 {
        let usual = self.search.step;
        let turn = next.tangent.distance(&base.tangent) / next.at.distance(&base.at);
        let rotation = (1.0 - next.tangent.load.powi(2)).max(0.0).sqrt();
        let bent = turn.max(rotation);
        // a NaN is not straight
        if !(bent < NEARLY_STRAIGHT) {
            return usual;
        }
        let range = self.search.most / self.curve.scale;
        (usual / bent).min(LONGEST_STEP * range).max(usual)
    }

    /// Whether there is something between two points that usual steps are to find.
    fn meets_something(&self, base: &State, next: &State) -> bool {
        let one = 1.0 / self.curve.scale;
        base.signature != next.signature
            || base.stable != next.stable
            || next.collision.is_some()
            || (base.at.load - one) * (next.at.load - one) < 0.0
    }

    /// One step of the continuation, at most to the end of the load's range; returns the Newton
    /// steps of its correction.
    fn step(
        &mut self,
        base: &State,
        step: f64,
        last: Option<(&State, Side)>,
        next: &mut State,
    ) -> Option<usize> {
        let curve = &mut self.curve;
        curve.predict(base, step, last);
        let plane = Plane {
            origin: &base.at,
            normal: &base.tangent,
            offset: step,
        };
        let mut corrections = curve.correct(&plane)?;
        let most = self.search.most / curve.scale;
        let end = curve.at.load.clamp(0.0, most);
        if curve.at.load != end {
            let share = (end - base.at.load) / (curve.at.load - base.at.load);
            let beyond = curve.at.clone();
            curve.at.set_sum(&base.at, share, &beyond);
            curve.at.add(-share, &base.at);
            let mut normal = Vector::zero(curve.arcs());
            normal.load = 1.0;
            let plane = Plane {
                origin: &base.at,
                normal: &normal,
                offset: end - base.at.load,
            };
            corrections += curve.correct(&plane)?;
            curve.at.load = end;
            curve.residual();
        }
        curve.settle(&base.tangent, base.signature.rising, next);
        let length = next.at.distance(&base.at);
        let turned = next.tangent.dot(&base.tangent);
        (turned > STRAIGHT && length <= STRETCH * step).then_some(corrections)
    }

    /// Whether a point is on a branch found: an equilibrium is where its plane cuts the branch.
    fn is_known(&mut self, at: &Vector) -> bool {
        let mut normal = Vector::zero(self.curve.arcs());
        for branch in 0..self.branches.len() {
            for i in 1..self.branches[branch].points.len() {
                let points = &self.branches[branch].points;
                let (a, b) = (&points[i - 1].at, &points[i].at);
                normal.set_sum(b, -1.0, a);
                let chord = normal.norm();
                // points of an event may coincide with the next one
                if !(chord > 0.0) {
                    continue;
                }
                normal.scale(1.0 / chord);
                let offset = at.dot(&normal) - a.dot(&normal);
                if offset < -BESIDE_CHORD * chord || offset > (1.0 + BESIDE_CHORD) * chord {
                    continue;
                }
                let mut guess = a.clone();
                guess.add(offset, &normal);
                if guess.distance(at) > BESIDE_CHORD * chord {
                    continue;
                }
                let origin = a.clone();
                self.curve.at = guess;
                let plane = Plane {
                    origin: &origin,
                    normal: &normal,
                    offset,
                };
                if self.curve.correct(&plane).is_some() && self.curve.at.distance(at) < SAME {
                    return true;
                }
            }
        }
        false
    }
}

impl Point {
    /// Strain of every arc from base to tip: its rotation vector (rad).
    pub fn strain(&self) -> &[Vec3] {
        &self.at.strain
    }
}

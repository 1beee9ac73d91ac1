//! Several robots, or several loads of one robot, side by side in SIMD lanes.
//!
//! Theory: docs/theory/statics.md.
//!
//! Takes only plain Newton steps, as a single solve does in the regular case: all pivots positive, no
//! step too long, the energy decreasing. Other loads are left to it.

use super::polynomial::{StartPolynomial, Values};
use super::MOST_LANES;
use crate::criteria::{
    is_minimum_nearby, is_near, keeps_tangent, ENERGY_NOISE, MAX_EXTRAPOLATION, MAX_STEP,
    SUFFICIENT_DECREASE, TOLERANCE,
};
use crate::dispatch::fits_lanes;
use crate::interrupt;
use crate::math::copies;
use crate::math::lie::Pose;
use crate::math::linalg::Vec3;
use crate::math::real::{Layout, Real};
use crate::math::simd::{Avx2, Avx512, Robots, Simd};
use crate::model::load::{Load, Model, RodModel};
use crate::model::robot::Robot;
use crate::outcome::{Outcome, Settings, Status};
use crate::rod::chain::Rod;
use crate::rod::estimate::Verdict;

/// Most Newton steps before a load is left to the globalised solver.
const MAX_PLAIN_STEPS: usize = 10;

/// Result in a lane.
#[derive(Clone, Copy, Debug)]
pub enum LaneOutcome {
    /// It converged.
    Solved(Outcome),
    /// It converged after some Newton steps, but needs this number of elements; they can start from
    /// its strain.
    NeedsElements { elements: usize, iterations: usize },
    /// It is left to the globalised solver.
    Left,
}

/// Result by lanes.
pub type Outcomes = [LaneOutcome; MOST_LANES];

/// Robots in SIMD lanes.
pub trait SideBySide {
    /// Number of loads that fit side by side.
    fn width(&self) -> usize;
    /// Replaces the robots by others of the same topology, one for each lane; the last one also in
    /// the lanes beyond. Discards the last solutions.
    fn set_robots(&mut self, robots: &[Robot]);
    /// Solves up to `width` loads from the straight backbone.
    fn solve(&mut self, loads: &[Load]) -> Outcomes;
    /// Solves up to `width` loads from the strains of a polynomial.
    fn solve_from(&mut self, start: &StartPolynomial, loads: &[Load]) -> Outcomes;
    /// Solves up to `width` loads, each from the previous ones in its lane. A lane that was not
    /// solved is left.
    fn solve_next(&mut self, loads: &[Load]) -> Outcomes;
    /// Leaves all lanes; `start_from` takes them back.
    fn leave_all(&mut self);
    /// Starts the next load of a lane from a strain.
    fn start_from(&mut self, lane: usize, strain: &[Vec3]);
    /// Strain of the last solution in a lane.
    fn last_strain(&self, lane: usize) -> Option<Vec<Vec3>>;
    /// Strain of a lane that needs more elements, after the last call.
    fn strain(&self, lane: usize) -> Vec<Vec3>;
    /// Pose of a disk under one of the loads.
    fn disk(&self, k: usize, lane: usize) -> Pose;
    /// Length of a tendon under one of the loads (m).
    fn tendon_length(&self, i: usize, lane: usize) -> f64;
}

/// Lanes with the fewest elements, and with two in a module for loads that need them.
pub struct Levels {
    pub first: Box<dyn SideBySide>,
    pub finer: Option<Box<dyn SideBySide>>,
}

impl Levels {
    /// Where the processor has SIMD lanes, and the model has not more than two elements.
    pub fn new(robot: &Robot, model: &RodModel) -> Option<Self> {
        let lanes = |elements, automatic| side_by_side(robot, model.model, elements, automatic);
        let automatic = model.elements.is_none();
        Some(Levels {
            first: lanes(model.elements.unwrap_or(1), automatic)?,
            finer: if automatic { lanes(FINER, true) } else { None },
        })
    }
}

/// Elements of the finer lanes.
pub const FINER: usize = 2;

/// A solver for one or two elements in a module, where the processor has SIMD lanes and the robot no
/// coupled sections. If `automatic`, a solution that needs more elements is rejected.
fn side_by_side(
    robot: &Robot,
    model: Model,
    elements: usize,
    automatic: bool,
) -> Option<Box<dyn SideBySide>> {
    if !fits_lanes(robot, model) {
        return None;
    }
    if let Some(simd) = Avx512::detect() {
        return with(simd, robot, model, elements, automatic);
    }
    with(Avx2::detect()?, robot, model, elements, automatic)
}

fn with<S: Simd>(
    simd: S,
    robot: &Robot,
    model: Model,
    elements: usize,
    automatic: bool,
) -> Option<Box<dyn SideBySide>> {
    let layout = Robots(simd);
    Some(match elements {
        1 => Box::new(Lanes::<S, 2>::new(layout, robot, model, automatic)),
        2 => Box::new(Lanes::<S, 4>::new(layout, robot, model, automatic)),
        _ => return None,
    })
}

/// Forces on the disks under the load of every lane; `None` where no load has any.
#[inline(always)]
pub(super) fn disk_forces<'a, 'l: 'a, T: Real>(
    of: impl Fn(usize) -> &'a Load<'l>,
) -> Option<impl Fn(usize) -> Vec3<T>> {
    let loaded = (0..T::LANES).any(|lane| !of(lane).disk_forces.is_empty());
    let on_disk = move |k: usize| {
        let own = |lane: usize| of(lane).disk_forces.get(k).copied().unwrap_or_default();
        Vec3([0, 1, 2].map(|q| T::from_fn(|lane| own(lane)[q])))
    };
    loaded.then_some(on_disk)
}

struct Lanes<S: Simd, const A: usize> {
    rod: Rod<Robots<S>, A>,
    model: Model,
    settings: [Settings; MOST_LANES],
    /// Whether elements are chosen: a solution that needs more than one is rejected.
    automatic: bool,
    /// Strains of the previous solutions, latest first, by modules.
    history: [Vec<[Vec3<S::Vector>; A]>; 3],
    /// Number of previous solutions by lanes.
    known: [usize; MOST_LANES],
    /// Lanes whose latest strain is no solution, but a start.
    starts: [bool; MOST_LANES],
    /// Lanes that have been left to the globalised solver.
    left: [bool; MOST_LANES],
    start_values: Values<S::Vector>,
}

impl<S: Simd, const A: usize> Lanes<S, A> {
    /// Number of elements in a module.
    const ELEMENTS: usize = A / 2;

    fn new(layout: Robots<S>, robot: &Robot, model: Model, automatic: bool) -> Self {
        let straight = copies([Vec3::zero(); A], robot.module_count());
        Lanes {
            rod: Rod::new(layout, robot, model),
            model,
            settings: [Settings::new(robot, Self::ELEMENTS); MOST_LANES],
            automatic,
            history: [straight.clone(), straight.clone(), straight],
            known: [0; MOST_LANES],
            starts: [false; MOST_LANES],
            left: [false; MOST_LANES],
            start_values: Values::empty(),
        }
    }

    /// Sets the strain to that extrapolated from the previous solutions.
    #[inline(always)]
    fn extrapolate(&mut self) {
        let vector = |of: &dyn Fn(usize) -> f64| S::Vector::from_fn(of);
        let [a, b, c] = &self.history;
        let known = |lane: usize| match (self.left[lane], self.starts[lane]) {
            (true, _) => 0,
            (false, true) => 1,
            (false, false) => self.known[lane],
        };
        let factors = [
            vector(&|lane| [0.0, 1.0, 2.0, 3.0][known(lane)]),
            vector(&|lane| [0.0, 0.0, -1.0, -3.0][known(lane)]),
            vector(&|lane| [0.0, 0.0, 0.0, 1.0][known(lane)]),
        ];
        let unloaded = vector(&|lane| if known(lane) == 0 { 1.0 } else { 0.0 });
        let mut change = S::Vector::zero();
        for (k, state) in self.rod.states.iter_mut().enumerate() {
            let rest = &self.rod.constants[k].rest;
            for i in 0..A {
                let past = a[k][i] * factors[0] + b[k][i] * factors[1] + c[k][i] * factors[2];
                state.w[i] = past + rest[i] * unloaded;
                change = change.max((state.w[i] - a[k][i]).max_abs());
            }
        }
        // loads that jump are not extrapolated
        for lane in 0..S::Vector::LANES {
            if known(lane) > 1 && !(change.lane(lane) < MAX_EXTRAPOLATION) {
                for (k, state) in self.rod.states.iter_mut().enumerate() {
                    for (w, last) in state.w.iter_mut().zip(&a[k]) {
                        for q in 0..3 {
                            w.0[q].set_lane(lane, last[q].lane(lane));
                        }
                    }
                }
            }
        }
    }

    /// Keeps the strains of the lanes that converged; the others keep their last ones, and become
    /// straight.
    #[inline(always)]
    fn remember(&mut self, outcomes: &Outcomes) {
        self.history.rotate_right(1);
        let [last, before, _] = &mut self.history;
        let zero = S::Vector::zero();
        for (k, state) in self.rod.states.iter_mut().enumerate() {
            for i in 0..A {
                for q in 0..3 {
                    last[k][i].0[q] = chosen(outcomes, state.w[i][q], before[k][i][q]);
                }
            }
            for q in 0..3 {
                state.n.0[q] = chosen(outcomes, state.n[q], zero);
            }
        }
        for (lane, outcome) in outcomes.iter().enumerate() {
            self.left[lane] |= !matches!(outcome, LaneOutcome::Solved(_));
            if !self.left[lane] {
                let known = if self.starts[lane] {
                    0
                } else {
                    self.known[lane]
                };
                self.known[lane] = (known + 1).min(3);
                self.starts[lane] = false;
            }
        }
    }
}

/// Vectors of one lane.
pub(super) fn of_lane<T: Real>(vectors: &[Vec3<T>], lane: usize) -> Vec<Vec3> {
    vectors.iter().map(|v| v.of_lane(lane)).collect()
}

/// The first number in lanes with an outcome, the second in the others.
#[inline(always)]
fn chosen<T: Real>(outcomes: &Outcomes, with: T, without: T) -> T {
    T::from_fn(
        #[inline(always)]
        |lane| match outcomes[lane] {
            LaneOutcome::Solved(_) => with.lane(lane),
            _ => without.lane(lane),
        },
    )
}

impl<S: Simd, const A: usize> SideBySide for Lanes<S, A> {
    fn width(&self) -> usize {
        S::Vector::LANES
    }

    fn set_robots(&mut self, robots: &[Robot]) {
        self.rod.set_robots(robots, self.model);
        for (lane, settings) in self.settings.iter_mut().enumerate() {
            let robot = &robots[lane.min(robots.len() - 1)];
            *settings = Settings::new(robot, Self::ELEMENTS);
        }
        self.restart();
    }

    fn solve(&mut self, loads: &[Load]) -> Outcomes {
        self.restart();
        self.descend(loads)
    }

    fn solve_from(&mut self, start: &StartPolynomial, loads: &[Load]) -> Outcomes {
        self.restart();
        let (states, values) = (&mut self.rod.states, &mut self.start_values);
        self.rod.layout.vectorize(
            #[inline(always)]
            || {
                start.evaluate(
                    loads,
                    values,
                    #[inline(always)]
                    |at, w| states[at / (3 * A)].w[at / 3 % A].0[at % 3] = w,
                )
            },
        );
        self.descend(loads)
    }

    fn leave_all(&mut self) {
        self.restart();
        self.left = [true; MOST_LANES];
    }

    fn start_from(&mut self, lane: usize, strain: &[Vec3]) {
        let last = self.history[0].iter_mut().flatten();
        for (to, from) in last.zip(strain) {
            for q in 0..3 {
                to.0[q].set_lane(lane, from[q]);
            }
        }
        self.starts[lane] = true;
        self.left[lane] = false;
    }

    fn solve_next(&mut self, loads: &[Load]) -> Outcomes {
        self.rod.layout.vectorize(
            #[inline(always)]
            || self.extrapolate(),
        );
        let mut outcomes = self.descend(loads);
        // the lanes beyond the loads repeat the last of them
        for lane in loads.len()..MOST_LANES {
            outcomes[lane] = outcomes[loads.len() - 1];
        }
        self.rod.layout.vectorize(
            #[inline(always)]
            || self.remember(&outcomes),
        );
        outcomes
    }

    fn last_strain(&self, lane: usize) -> Option<Vec<Vec3>> {
        let solved = self.known[lane] > 0 && !self.starts[lane];
        solved.then(|| of_lane(self.history[0].as_flattened(), lane))
    }

    fn strain(&self, lane: usize) -> Vec<Vec3> {
        let mut strain = Vec::with_capacity(self.rod.states.len() * A);
        for state in &self.rod.states {
            for w in &state.w {
                strain.push(w.of_lane(lane));
            }
        }
        strain
    }

    fn disk(&self, k: usize, lane: usize) -> Pose {
        self.rod.disk(k, lane)
    }

    fn tendon_length(&self, i: usize, lane: usize) -> f64 {
        self.rod.placed.lengths[i].lane(lane)
    }
}

impl<S: Simd, const A: usize> Lanes<S, A> {
    fn restart(&mut self) {
        self.rod.make_unloaded();
        self.known = [0; MOST_LANES];
        self.starts = [false; MOST_LANES];
        self.left = [false; MOST_LANES];
    }

    /// Plain Newton steps from the strain of the rod, in the lanes that have not been left to the
    /// globalised solver.
    fn descend(&mut self, loads: &[Load]) -> Outcomes {
        self.rod.layout.vectorize(
            #[inline(always)]
            || self.descend_in_lanes(loads),
        )
    }

    #[inline(always)]
    fn descend_in_lanes(&mut self, loads: &[Load]) -> Outcomes {
        let (rod, settings) = (&mut self.rod, &self.settings);
        // idle lanes repeat the last load
        let of = |lane: usize| &loads[lane.min(loads.len() - 1)];
        let vector = |pick: fn(&Load) -> [f64; 3]| {
            let mut v = Vec3::zero();
            for (q, x) in v.0.iter_mut().enumerate() {
                *x = S::Vector::from_fn(|lane| pick(of(lane))[q]);
            }
            v
        };
        rod.set_load(
            |i| S::Vector::from_fn(|lane| of(lane).tensions[i]),
            vector(|l| l.gravity),
            vector(|l| l.tip_force),
            disk_forces(|lane| of(lane)),
        );
        let mut energy = rod.evaluate();
        // a moment has no energy to minimise; the weight of a payload is a point load
        let fits = rod.fixed.payloads.is_empty();
        let mut plain = [false; MOST_LANES];
        let mut noise = S::Vector::zero();
        let mut stiffening = [0.0; MOST_LANES];
        for lane in 0..S::Vector::LANES {
            plain[lane] = !self.left[lane] && of(lane).fits_lanes() && fits;
            let scale = rod.energy_scale(settings[lane].length, lane);
            stiffening[lane] = scale / rod.module_count() as f64;
            noise.set_lane(lane, ENERGY_NOISE * (scale + energy.lane(lane).abs()));
        }
        let per_scale = S::Vector::from_fn(|lane| 1.0 / settings[lane].moment_scale);
        // least pivot of the last elimination, and rotation added by an arc since then (rad)
        let (mut pivot, mut moved) = (S::Vector::zero(), S::Vector::zero());
        let mut last_residual = S::Vector::zero();
        let mut minimum_nearby = [false; MOST_LANES];
        let mut iterations = [0; MOST_LANES];
        let mut outcomes = [LaneOutcome::Left; MOST_LANES];
        for round in 0..=MAX_PLAIN_STEPS {
            if interrupt::work(S::Vector::LANES * settings[0].work) {
                break;
            }
            let residual = rod.gradient() * per_scale;
            let ready = |lane: usize| residual.lane(lane) <= TOLERANCE && minimum_nearby[lane];
            if round == MAX_PLAIN_STEPS
                || (0..S::Vector::LANES).all(|lane| ready(lane) || !plain[lane])
            {
                rod.finish();
                let found = rod.estimate();
                for lane in 0..loads.len() {
                    let found = found.of_lane(lane);
                    if !plain[lane] || !ready(lane) || rod.collision(lane).is_some() {
                        continue;
                    }
                    let (length, elements) = (settings[lane].length, Self::ELEMENTS);
                    let verdict = Verdict::new(&found, [0.0; 2], Some(true), length, elements);
                    let iterations = iterations[lane];
                    if !verdict.error.is_bound() {
                        continue;
                    }
                    if !self.automatic || verdict.needed == elements {
                        outcomes[lane] = LaneOutcome::Solved(Outcome {
                            status: Status::Converged,
                            stable: verdict.stable,
                            error: Some(verdict.error),
                            iterations,
                            residual: residual.lane(lane),
                            ..Outcome::pending()
                        });
                    } else if is_near(&verdict.error, verdict.stable, length) {
                        outcomes[lane] = LaneOutcome::NeedsElements {
                            elements: verdict.needed,
                            iterations,
                        };
                    }
                }
                break;
            }
            let keep = |lane: usize| {
                let (now, last) = (residual.lane(lane), last_residual.lane(lane));
                keeps_tangent(minimum_nearby[lane], now, last)
            };
            if !(0..S::Vector::LANES).all(|lane| keep(lane) || !plain[lane]) {
                pivot = rod.linearise_and_eliminate();
                moved = S::Vector::zero();
            }
            let step = rod.newton_step::<true>();
            moved += step.largest;
            rod.save();
            // a lane that is left to the globalised solver does not move
            rod.advance(S::Vector::from_fn(|lane| f64::from(plain[lane])));
            let trial = rod.evaluate();
            let bound = energy + step.slope * S::Vector::splat(SUFFICIENT_DECREASE) + noise;
            for lane in 0..S::Vector::LANES {
                if !(residual.lane(lane) <= TOLERANCE) {
                    iterations[lane] = round + 1;
                }
                plain[lane] &= pivot.lane(lane) > 0.0
                    && step.largest.lane(lane) <= MAX_STEP
                    && trial.lane(lane) <= bound.lane(lane);
                minimum_nearby[lane] = is_minimum_nearby(
                    moved.lane(lane),
                    pivot.lane(lane),
                    settings[lane].shift_unit,
                    stiffening[lane],
                );
            }
            energy = trial;
            last_residual = residual;
        }
        outcomes
    }
}

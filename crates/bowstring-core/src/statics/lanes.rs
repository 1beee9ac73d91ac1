//! Several loads of one robot side by side in SIMD lanes.
//!
//! Theory: docs/theory/statics.md.
//!
//! Takes only plain Newton steps, as `solver` does in the regular case: all pivots positive, no
//! step too long, the energy decreasing. Other loads are left to `solver`.

use crate::interrupt;
use crate::math::linalg::Vec3;
use crate::math::real::{Layout, Real};
use crate::math::simd::{Avx2, Avx512, Robots, Simd};
use crate::model::load::{Load, Model};
use crate::model::robot::Robot;
use crate::rod::chain::Rod;
use crate::rod::estimate::Verdict;
use crate::statics::newton::{is_minimum_nearby, ENERGY_NOISE, MAX_STEP, SUFFICIENT_DECREASE};
use crate::statics::outcome::TOLERANCE;
use crate::statics::solver::{Outcome, Pose, Settings, Status};

/// Most Newton steps before a load is left to the globalised solver.
const MAX_PLAIN_STEPS: usize = 10;

/// Robots in SIMD lanes.
pub(crate) trait SideBySide {
    /// Number of loads that fit side by side.
    fn width(&self) -> usize;
    /// Solves up to `width` loads from the straight backbone; `None` for those left to the
    /// globalised solver.
    fn solve(&mut self, loads: &[Load]) -> [Option<Outcome>; 8];
    /// Pose of a disk under one of the loads.
    fn disk(&self, k: usize, lane: usize) -> Pose;
    /// Length of a tendon under one of the loads (m).
    fn tendon_length(&self, i: usize, lane: usize) -> f64;
}

/// A solver for one element in a module, where the processor has SIMD lanes.
pub(crate) fn side_by_side(
    robot: &Robot,
    model: Model,
    elements: Option<usize>,
) -> Option<Box<dyn SideBySide>> {
    if elements.unwrap_or(1) != 1 {
        return None;
    }
    if let Some(simd) = Avx512::detect() {
        return Some(Box::new(Lanes::new(simd, robot, model, elements)));
    }
    Some(Box::new(Lanes::new(
        Avx2::detect()?,
        robot,
        model,
        elements,
    )))
}

struct Lanes<S: Simd> {
    rod: Rod<Robots<S>, 2>,
    settings: Settings,
    /// Whether elements are chosen: a solution that needs more than one is rejected.
    automatic: bool,
}

impl<S: Simd> Lanes<S> {
    fn new(simd: S, robot: &Robot, model: Model, elements: Option<usize>) -> Self {
        Lanes {
            rod: Rod::new(Robots(simd), robot, model),
            settings: Settings::new(robot, model, 1),
            automatic: elements.is_none(),
        }
    }
}

impl<S: Simd> SideBySide for Lanes<S> {
    fn width(&self) -> usize {
        S::Vector::LANES
    }

    fn solve(&mut self, loads: &[Load]) -> [Option<Outcome>; 8] {
        self.rod.layout.vectorize(
            #[inline(always)]
            || solve(&mut self.rod, &self.settings, self.automatic, loads),
        )
    }

    fn disk(&self, k: usize, lane: usize) -> Pose {
        self.rod.disk(k, lane)
    }

    fn tendon_length(&self, i: usize, lane: usize) -> f64 {
        self.rod.placed.lengths[i].lane(lane)
    }
}

#[inline(always)]
fn solve<S: Simd>(
    rod: &mut Rod<Robots<S>, 2>,
    settings: &Settings,
    automatic: bool,
    loads: &[Load],
) -> [Option<Outcome>; 8] {
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
        Vec3::zero(),
    );
    rod.make_straight();
    let mut energy = rod.evaluate();
    // a tip moment has no energy to minimise
    let mut plain = [false; 8];
    let mut noise = S::Vector::zero();
    let mut stiffening = [0.0; 8];
    for lane in 0..S::Vector::LANES {
        plain[lane] = of(lane).tip_moment == [0.0; 3];
        let scale = rod.energy_scale(settings.length, lane);
        stiffening[lane] = scale / rod.module_count() as f64;
        noise.set_lane(lane, ENERGY_NOISE * (scale + energy.lane(lane).abs()));
    }
    let mut minimum_nearby = [false; 8];
    let mut iterations = [0; 8];
    let mut outcomes = [None; 8];
    for round in 0..=MAX_PLAIN_STEPS {
        if interrupt::work(S::Vector::LANES * settings.work) {
            break;
        }
        let residual = rod.gradient() * S::Vector::splat(1.0 / settings.moment_scale);
        let ready = |lane: usize| residual.lane(lane) <= TOLERANCE && minimum_nearby[lane];
        if round == MAX_PLAIN_STEPS || (0..S::Vector::LANES).all(|lane| ready(lane) || !plain[lane])
        {
            rod.finish();
            let found = rod.estimate();
            for lane in 0..loads.len() {
                let found = found.of_lane(lane);
                let verdict = Verdict::new(&found, [0.0; 2], Some(true), settings.length, 1);
                // finer elements are left to the globalised solver
                let fine = !automatic || verdict.needed == 1;
                if plain[lane] && ready(lane) && fine && rod.collision(lane).is_none() {
                    outcomes[lane] = Some(Outcome {
                        status: Status::Converged,
                        stable: verdict.stable,
                        error: Some(verdict.error),
                        iterations: iterations[lane],
                        residual: residual.lane(lane),
                        ..Outcome::pending()
                    });
                }
            }
            break;
        }
        rod.linearise_only();
        let pivot = rod.eliminate::<true>(S::Vector::zero());
        let step = rod.newton_step::<true>();
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
                step.largest.lane(lane),
                pivot.lane(lane),
                settings.shift_unit,
                stiffening[lane],
            );
        }
        energy = trial;
    }
    outcomes
}

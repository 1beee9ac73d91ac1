//! Steps of several paths, or several steps from one state, side by side in SIMD lanes.
//!
//! Theory: docs/theory/actuation.md (Eq. 4.2 and 4.6).
//!
//! Takes tendons without friction and plain Newton steps only, as the solver of single paths does in
//! the regular case: a positive definite tangent, one element in a module. Other steps are left to it.

use super::loads::{disk_forces, of_lane};
use super::MOST_LANES;
use crate::criteria::{
    is_length_settled, is_minimum_nearby, solve_regularised, LENGTH_TOLERANCE, LOOSE, MAX_STEP,
    NEGLIGIBLE, TOLERANCE,
};
use crate::interrupt;
use crate::math::copies;
use crate::math::lie::Pose;
use crate::math::linalg::Vec3;
use crate::math::mlcp::Complementarity;
use crate::math::real::{Layout, Real};
use crate::math::simd::{Avx2, Avx512, Robots, Simd};
use crate::model::load::{Load, Model};
use crate::model::robot::{Robot, Tendon};
use crate::outcome::{PathOutcome, Settings, Status};
use crate::rod::chain::Rod;
use crate::rod::estimate::Verdict;
use crate::rod::tension_columns::TensionColumns;

/// Most Newton steps before a step is left to the solver of single paths.
const MAX_PLAIN_STEPS: usize = 20;

/// Outcome by lanes.
pub type PathOutcomes = [Option<PathOutcome>; MOST_LANES];

/// A step of a path: commands of all tendons in `load.tensions`, displacements (m) of those with
/// `by_displacement` and tensions (N) of the others.
#[derive(Clone, Copy)]
pub struct LaneStep<'a> {
    pub by_displacement: &'a [bool],
    pub load: Load<'a>,
}

/// Paths in SIMD lanes.
pub trait PathsSideBySide {
    /// Number of paths that fit side by side.
    fn width(&self) -> usize;
    /// Replaces the paths by others of the same topology, one for each lane, at their last states;
    /// the last one also in the lanes beyond.
    fn set_paths(&mut self, paths: &[LanePath]);
    /// Returns to the states of `set_paths`.
    fn restart(&mut self);
    /// One step of each path from its last state; `None` for those left to the solver of single
    /// paths, whose later steps are left to it as well.
    fn step(&mut self, steps: &[LaneStep]) -> PathOutcomes;
    /// Last state of a lane.
    fn last(&self, lane: usize) -> LaneState;
    /// Pose of a disk after the last step.
    fn disk(&self, k: usize, lane: usize) -> Pose;
    /// Length of a tendon after the last step (m).
    fn tendon_length(&self, i: usize, lane: usize) -> f64;
    /// Tension (N) of a tendon after the last step.
    fn tension(&self, i: usize, lane: usize) -> f64;
    /// Tension (N) of a span after the last step.
    fn span_tension(&self, k: usize, i: usize, lane: usize) -> f64;
    /// Slack length (m) of a tendon after the last step.
    fn slack(&self, i: usize, lane: usize) -> f64;
    /// Displacement (m) of a tendon after the last step.
    fn displacement(&self, i: usize, lane: usize) -> f64;
}

/// State of a path in a lane.
pub struct LaneState {
    pub strain: Vec<Vec3>,
    /// Tensions (N) and displacements (m).
    pub tensions: Vec<f64>,
    pub displacements: Vec<f64>,
}

/// A path as lanes take it over.
pub struct LanePath<'a> {
    pub robot: &'a Robot,
    /// Whether elements are chosen: a solution that needs more than one is rejected.
    pub automatic: bool,
    /// Unstretched home lengths (m), and compliances of whole tendons (m/N).
    pub home: &'a [f64],
    pub compliance: Vec<f64>,
    /// Last state: strain by arcs, tensions (N) and displacements (m).
    pub strain: &'a [Vec3],
    pub tensions: &'a [f64],
    pub displacements: &'a [f64],
}

/// Lanes for paths of robots with the topology of this one and one element in a module, where the
/// processor has them.
pub fn paths_side_by_side(robot: &Robot, model: Model) -> Option<Box<dyn PathsSideBySide>> {
    if let Some(simd) = Avx512::detect() {
        return Some(Box::new(PathLanes::new(simd, robot, model)));
    }
    Some(Box::new(PathLanes::new(Avx2::detect()?, robot, model)))
}

/// Strain by modules, tensions and displacements by tendons.
#[derive(Clone)]
struct States<T> {
    strain: Vec<[Vec3<T>; 2]>,
    tensions: Vec<T>,
    displacements: Vec<T>,
}

impl<T: Real> States<T> {
    fn copy_from(&mut self, other: &Self) {
        self.strain.copy_from_slice(&other.strain);
        self.tensions.copy_from_slice(&other.tensions);
        self.displacements.copy_from_slice(&other.displacements);
    }
}

struct PathLanes<S: Simd> {
    rod: Rod<Robots<S>, 2>,
    model: Model,
    settings: [Settings; MOST_LANES],
    /// Whether elements are chosen: a solution that needs more than one is rejected.
    automatic: [bool; MOST_LANES],
    /// Unstretched home lengths (m), and compliances of whole tendons (m/N).
    home: Vec<S::Vector>,
    compliance: Vec<S::Vector>,
    /// Least tensions (N), at which tendons are slack; -infinity of those that push too.
    least: Vec<f64>,
    start: States<S::Vector>,
    last: States<S::Vector>,
    columns: TensionColumns<S::Vector, 2>,
    /// Tensions of all tendons (N), and changes of those of the columns.
    tensions: Vec<S::Vector>,
    changes: Vec<S::Vector>,
    /// Slack lengths (m); negative where a tendon is too short.
    slack: Vec<S::Vector>,
    problems: Vec<Complementarity>,
    /// Lanes that have been left to the solver of single paths.
    left: [bool; MOST_LANES],
}

impl<S: Simd> PathLanes<S> {
    fn new(simd: S, robot: &Robot, model: Model) -> Self {
        let zero = S::Vector::zero();
        let of_tendons = copies(zero, robot.tendon_count());
        let states = States {
            strain: copies([Vec3::zero(); 2], robot.module_count()),
            tensions: of_tendons.clone(),
            displacements: of_tendons.clone(),
        };
        PathLanes {
            rod: Rod::new(Robots(simd), robot, model),
            model,
            settings: [Settings::new(robot, 1); MOST_LANES],
            automatic: [true; MOST_LANES],
            home: of_tendons.clone(),
            compliance: of_tendons.clone(),
            least: robot
                .spec()
                .tendons
                .iter()
                .map(Tendon::least_tension)
                .collect(),
            start: states.clone(),
            last: states,
            columns: TensionColumns::new(),
            tensions: of_tendons.clone(),
            changes: vec![],
            slack: of_tendons,
            problems: vec![Complementarity::default(); S::Vector::LANES],
            left: [false; MOST_LANES],
        }
    }
}

impl<S: Simd> PathsSideBySide for PathLanes<S> {
    fn width(&self) -> usize {
        S::Vector::LANES
    }

    fn set_paths(&mut self, paths: &[LanePath]) {
        let robots: Vec<Robot> = paths.iter().map(|path| path.robot.clone()).collect();
        self.rod.set_robots(&robots, self.model);
        for lane in 0..MOST_LANES {
            let path = &paths[lane.min(paths.len() - 1)];
            self.settings[lane] = Settings::new(path.robot, 1);
            self.automatic[lane] = path.automatic;
            if lane >= S::Vector::LANES {
                continue;
            }
            for i in 0..self.home.len() {
                self.home[i].set_lane(lane, path.home[i]);
                self.compliance[i].set_lane(lane, path.compliance[i]);
                self.start.tensions[i].set_lane(lane, path.tensions[i]);
                self.start.displacements[i].set_lane(lane, path.displacements[i]);
            }
            for (w, strain) in self
                .start
                .strain
                .as_flattened_mut()
                .iter_mut()
                .zip(path.strain)
            {
                for q in 0..3 {
                    w.0[q].set_lane(lane, strain[q]);
                }
            }
        }
        self.restart();
    }

    fn restart(&mut self) {
        self.last.copy_from(&self.start);
        self.left = [false; MOST_LANES];
    }

    fn step(&mut self, steps: &[LaneStep]) -> PathOutcomes {
        let tendons = self.home.len();
        let unknown = |i: &usize| steps.iter().any(|step| step.by_displacement[*i]);
        let unknowns = (0..tendons).filter(unknown);
        if !unknowns.clone().eq(self.columns.tendons.iter().copied()) {
            self.columns.resize(unknowns, self.rod.module_count());
            let count = self.columns.tendons.len();
            self.changes.resize(count, S::Vector::zero());
            for problem in &mut self.problems {
                problem.resize(count);
            }
        }
        self.rod.layout.vectorize(
            #[inline(always)]
            || self.step_in_lanes(steps),
        )
    }

    fn last(&self, lane: usize) -> LaneState {
        let numbers = |v: &[S::Vector]| v.iter().map(|x| x.lane(lane)).collect();
        LaneState {
            strain: of_lane(self.last.strain.as_flattened(), lane),
            tensions: numbers(&self.last.tensions),
            displacements: numbers(&self.last.displacements),
        }
    }

    fn disk(&self, k: usize, lane: usize) -> Pose {
        self.rod.disk(k, lane)
    }

    fn tendon_length(&self, i: usize, lane: usize) -> f64 {
        self.rod.placed.lengths[i].lane(lane)
    }

    fn tension(&self, i: usize, lane: usize) -> f64 {
        self.tensions[i].lane(lane)
    }

    fn span_tension(&self, k: usize, i: usize, lane: usize) -> f64 {
        match k <= self.rod.tendons.end_disks[i] {
            true => self.tension(i, lane),
            false => 0.0,
        }
    }

    fn slack(&self, i: usize, lane: usize) -> f64 {
        let taut = self.tensions[i].lane(lane) > 0.0;
        if taut {
            0.0
        } else {
            self.slack[i].lane(lane)
        }
    }

    fn displacement(&self, i: usize, lane: usize) -> f64 {
        self.last.displacements[i].lane(lane)
    }
}

/// Convergence of the lanes.
struct Progress<T> {
    /// Lanes that take plain Newton steps.
    plain: [bool; MOST_LANES],
    /// Largest moment imbalance over (bending stiffness / length), and largest length error over
    /// the length, of this iteration and of the last.
    moment: T,
    length: T,
    last_moment: T,
    last_length: T,
    /// Least pivot of the last elimination, and since then the rotation added by an arc (rad) and
    /// the change of all tensions (N).
    pivot: T,
    moved: T,
    pulled: T,
    minimum_nearby: [bool; MOST_LANES],
    iterations: [usize; MOST_LANES],
}

impl<T: Real> Progress<T> {
    fn is_settled(&self, lane: usize) -> bool {
        let (now, last) = (self.length.lane(lane), self.last_length.lane(lane));
        self.moment.lane(lane) <= TOLERANCE && is_length_settled(now, last, LOOSE)
    }

    fn is_ready(&self, lane: usize) -> bool {
        self.minimum_nearby[lane] && self.is_settled(lane)
    }

    /// Whether the last tangent is kept: by quadratic convergence a residual r after residual s
    /// falls with it to about 2 r^2 / s.
    fn keeps_tangent(&self, lane: usize) -> bool {
        let (moment, length) = (self.moment.lane(lane), self.length.lane(lane));
        self.minimum_nearby[lane]
            && 2.0 * moment * moment <= NEGLIGIBLE * self.last_moment.lane(lane)
            && 2.0 * length * length <= LENGTH_TOLERANCE * self.last_length.lane(lane)
    }
}

impl<S: Simd> PathLanes<S> {
    #[inline(always)]
    fn step_in_lanes(&mut self, steps: &[LaneStep]) -> PathOutcomes {
        // idle lanes repeat the last step
        let of = |lane: usize| &steps[lane.min(steps.len() - 1)];
        self.start_step(steps);
        let mut progress = Progress {
            plain: [false; MOST_LANES],
            moment: S::Vector::zero(),
            length: S::Vector::zero(),
            last_moment: S::Vector::zero(),
            last_length: S::Vector::splat(f64::INFINITY),
            pivot: S::Vector::zero(),
            moved: S::Vector::zero(),
            pulled: S::Vector::zero(),
            minimum_nearby: [false; MOST_LANES],
            iterations: [0; MOST_LANES],
        };
        let fits = self.rod.fixed.payloads.is_empty();
        for lane in 0..S::Vector::LANES {
            // a moment has no energy to minimise; the weight of a payload is a point load
            progress.plain[lane] = !self.left[lane] && of(lane).load.fits_lanes() && fits;
        }
        let per_scale = S::Vector::from_fn(|lane| 1.0 / self.settings[lane].moment_scale);
        self.rod.evaluate();
        for round in 0..=MAX_PLAIN_STEPS {
            let work = self.settings[0].work * (2 + self.columns.tendons.len());
            if interrupt::work(S::Vector::LANES * work) {
                break;
            }
            self.rod.measure_tendons(&mut self.columns);
            progress.length = self.measure_slack(steps);
            progress.moment = self.rod.gradient() * per_scale;
            let busy = |lane: usize| progress.plain[lane] && !progress.is_ready(lane);
            if round == MAX_PLAIN_STEPS || !(0..S::Vector::LANES).any(busy) {
                return self.finish(steps, &progress);
            }
            self.newton_step(steps, &mut progress);
        }
        [const { None }; MOST_LANES]
    }

    /// Sets loads, strain and tensions of the last state.
    #[inline(always)]
    fn start_step(&mut self, steps: &[LaneStep]) {
        let of = |lane: usize| &steps[lane.min(steps.len() - 1)];
        for (i, tension) in self.tensions.iter_mut().enumerate() {
            *tension = S::Vector::from_fn(|lane| match of(lane).by_displacement[i] {
                true => self.last.tensions[i].lane(lane),
                false => of(lane).load.tensions[i],
            });
        }
        let vector = |pick: fn(&Load) -> [f64; 3]| {
            let mut v = Vec3::zero();
            for (q, x) in v.0.iter_mut().enumerate() {
                *x = S::Vector::from_fn(|lane| pick(&of(lane).load)[q]);
            }
            v
        };
        let tensions = &self.tensions;
        self.rod.set_load(
            |i| tensions[i],
            vector(|l| l.gravity),
            vector(|l| l.tip_force),
            disk_forces(|lane| &of(lane).load),
        );
        self.rod.make_unloaded();
        for (state, w) in self.rod.states.iter_mut().zip(&self.last.strain) {
            state.w = *w;
        }
        for problem in &mut self.problems {
            problem.side.fill(Default::default());
        }
    }

    /// Slack lengths (theory Eq. 4.1); returns the largest length error over the length.
    #[inline(always)]
    fn measure_slack(&mut self, steps: &[LaneStep]) -> S::Vector {
        let mut most = S::Vector::zero();
        for lane in 0..S::Vector::LANES {
            let step = &steps[lane.min(steps.len() - 1)];
            let mut largest: f64 = 0.0;
            for (i, slack) in self.slack.iter_mut().enumerate() {
                if !step.by_displacement[i] {
                    slack.set_lane(lane, 0.0);
                    continue;
                }
                let tension = self.tensions[i].lane(lane);
                let length = self.columns.lengths[i].lane(lane);
                let elongation = length - self.home[i].lane(lane) + step.load.tensions[i];
                let loose = self.compliance[i].lane(lane) * tension - elongation;
                slack.set_lane(lane, loose);
                // a NaN is kept
                let miss = if tension > self.least[i] {
                    loose.abs()
                } else {
                    -loose
                };
                largest = Real::max(largest, miss);
            }
            most.set_lane(lane, largest / self.settings[lane].length);
        }
        most
    }

    #[inline(always)]
    fn newton_step(&mut self, steps: &[LaneStep], progress: &mut Progress<S::Vector>) {
        let keeps = |lane: usize| progress.keeps_tangent(lane) || !progress.plain[lane];
        let kept = (0..S::Vector::LANES).all(keeps);
        if !kept {
            progress.pivot = self.rod.eliminate_with_tensions(&mut self.columns);
            progress.moved = S::Vector::zero();
            progress.pulled = S::Vector::zero();
        }
        self.rod.backward_with_tensions(&mut self.columns);
        for lane in 0..S::Vector::LANES {
            progress.plain[lane] = progress.plain[lane] && self.solve_tensions(lane, steps, kept);
            if !progress.plain[lane] {
                self.changes
                    .iter_mut()
                    .for_each(|change| change.set_lane(lane, 0.0));
            }
        }
        let largest = self.rod.forward_with_tensions(&self.columns, &self.changes);
        self.rod.step_to_strain();
        let mut fraction = S::Vector::zero();
        for lane in 0..S::Vector::LANES {
            let (pivot, largest) = (progress.pivot.lane(lane), largest.lane(lane));
            progress.plain[lane] &= pivot > 0.0 && largest.is_finite();
            // a lane that is left does not move
            if progress.plain[lane] {
                fraction.set_lane(lane, (MAX_STEP / largest).min(1.0));
                if !progress.is_settled(lane) {
                    progress.iterations[lane] += 1;
                }
            }
        }
        self.rod.save();
        self.rod.advance(fraction);
        self.take_tensions(fraction, progress);
        progress.moved += largest * fraction;
        for change in &self.changes {
            progress.pulled += change.abs() * fraction;
        }
        self.rod.evaluate();
        (progress.last_moment, progress.last_length) = (progress.moment, progress.length);
        for lane in 0..S::Vector::LANES {
            let settings = &self.settings[lane];
            let scale = self.rod.energy_scale(settings.length, lane);
            let (modules, pivot) = (self.rod.module_count() as f64, progress.pivot.lane(lane));
            let moved = progress.moved.lane(lane);
            // tensions change the second derivatives also where nothing moves
            let stiffening = progress.pulled.lane(lane) * settings.length / modules;
            progress.minimum_nearby[lane] = stiffening < 0.1 * pivot
                && is_minimum_nearby(moved, pivot, settings.shift_unit, scale / modules);
        }
    }

    /// Changes of the unknown tensions in a lane (theory Eq. 4.2); false where there are none.
    #[inline(always)]
    fn solve_tensions(&mut self, lane: usize, steps: &[LaneStep], kept: bool) -> bool {
        let by_displacement = steps[lane.min(steps.len() - 1)].by_displacement;
        let (columns, problem) = (&self.columns, &mut self.problems[lane]);
        let size = columns.tendons.len();
        for (r, &i) in columns.tendons.iter().enumerate() {
            if !by_displacement[i] {
                // a given tension does not change
                problem.matrix[r * size..][..size].fill(0.0);
                problem.matrix[r * size + r] = 1.0;
                let tension = self.tensions[i].lane(lane);
                (problem.q[r], problem.lower[r]) = (-tension, f64::NEG_INFINITY);
                continue;
            }
            problem.lower[r] = self.least[i];
            let mut q = self.slack[i].lane(lane) + columns.shortened[r].lane(lane);
            for (c, &j) in columns.tendons.iter().enumerate() {
                let entry = &mut problem.matrix[r * size + c];
                if !kept {
                    *entry = columns.flexibility_of(r, c).lane(lane);
                    if r == c {
                        *entry += self.compliance[i].lane(lane);
                    }
                }
                q -= *entry * self.tensions[j].lane(lane);
            }
            problem.q[r] = q;
        }
        if !problem.solve() {
            return false;
        }
        for (c, &j) in columns.tendons.iter().enumerate() {
            let change = problem.z[c] - self.tensions[j].lane(lane);
            self.changes[c].set_lane(lane, change);
        }
        true
    }

    /// Moves the unknown tensions by a fraction of the step.
    #[inline(always)]
    fn take_tensions(&mut self, fraction: S::Vector, progress: &Progress<S::Vector>) {
        for (c, &i) in self.columns.tendons.iter().enumerate() {
            for lane in 0..S::Vector::LANES {
                if !progress.plain[lane] {
                    continue;
                }
                let (now, share) = (self.tensions[i].lane(lane), fraction.lane(lane));
                // a slack tendon has exactly zero tension
                let next = match share == 1.0 {
                    true => self.problems[lane].z[c],
                    false => now + share * self.changes[c].lane(lane),
                };
                self.tensions[i].set_lane(lane, next);
            }
        }
        let tensions = &self.tensions;
        self.rod.set_tensions(|i| tensions[i]);
    }

    /// Outcomes of the lanes that converged, whose states become the last ones.
    #[inline(always)]
    fn finish(&mut self, steps: &[LaneStep], progress: &Progress<S::Vector>) -> PathOutcomes {
        self.rod.finish();
        let mut found = self.rod.estimate();
        let changes = self.tension_errors(steps);
        // the same right-hand side again, with the changes of tension
        self.rod.backward_step::<true>(
            #[inline(always)]
            |_, _| (),
        );
        self.rod.forward_with_tensions(&self.columns, &self.changes);
        found.motion = self.rod.correction();
        let mut outcomes = [const { None }; MOST_LANES];
        for lane in 0..S::Vector::LANES {
            let (found, settings) = (found.of_lane(lane), &self.settings[lane]);
            let tautest = self.tensions.iter().map(|t| t.lane(lane).abs());
            let tautest = tautest.fold(0.0, f64::max);
            let tension = [changes[lane], tautest];
            let verdict = Verdict::new(&found, tension, Some(true), settings.length, 1);
            // finer elements are left to the path's own solver
            let fine = verdict.error.is_bound() && (!self.automatic[lane] || verdict.needed == 1);
            let converged = progress.plain[lane] && progress.is_ready(lane);
            if lane < steps.len() && converged && fine && self.rod.collision(lane).is_none() {
                outcomes[lane] = Some(PathOutcome {
                    status: Status::Converged,
                    stable: verdict.stable,
                    iterations: progress.iterations[lane],
                    residual: progress.moment.lane(lane),
                    length_residual: progress.length.lane(lane) * settings.length,
                    error: Some(verdict.error),
                    ..PathOutcome::pending()
                });
            }
        }
        self.remember(steps, &outcomes);
        outcomes
    }

    /// Changes of tension that compensate the estimated errors of the held lengths, in `changes`;
    /// returns the largest of each lane (N).
    #[inline(always)]
    fn tension_errors(&mut self, steps: &[LaneStep]) -> [f64; MOST_LANES] {
        let mut largest = [0.0; MOST_LANES];
        for lane in 0..S::Vector::LANES {
            let by_displacement = steps[lane.min(steps.len() - 1)].by_displacement;
            let (columns, tensions) = (&self.columns, &self.tensions);
            let held: Vec<usize> = (0..columns.tendons.len())
                .filter(|&c| {
                    let i = columns.tendons[c];
                    by_displacement[i] && tensions[i].lane(lane) > self.least[i]
                })
                .collect();
            let mut matrix = Vec::with_capacity(held.len() * held.len());
            for &r in &held {
                for &c in &held {
                    let own = if r == c {
                        self.compliance[columns.tendons[r]].lane(lane)
                    } else {
                        0.0
                    };
                    matrix.push(columns.flexibility_of(r, c).lane(lane) + own);
                }
            }
            let errors = &self.rod.errors.lengths;
            let lacks = held.iter().map(|&c| errors[columns.tendons[c]].lane(lane));
            let found = solve_regularised(&mut matrix, lacks.collect());
            for change in &mut self.changes {
                change.set_lane(lane, 0.0);
            }
            for (&c, change) in held.iter().zip(found) {
                self.changes[c].set_lane(lane, change);
                largest[lane] = Real::max(largest[lane], change.abs());
            }
        }
        largest
    }

    /// Keeps the states of the lanes that converged; the others keep their last ones.
    #[inline(always)]
    fn remember(&mut self, steps: &[LaneStep], outcomes: &PathOutcomes) {
        for lane in 0..S::Vector::LANES {
            if outcomes[lane].is_none() {
                self.left[lane] = true;
                continue;
            }
            for (to, state) in self.last.strain.iter_mut().zip(&self.rod.states) {
                for (to, from) in to.iter_mut().zip(&state.w) {
                    for q in 0..3 {
                        to.0[q].set_lane(lane, from[q].lane(lane));
                    }
                }
            }
            for i in 0..self.tensions.len() {
                let tension = self.tensions[i].lane(lane);
                self.last.tensions[i].set_lane(lane, tension);
                let displacement = match steps[lane].by_displacement[i] {
                    true => steps[lane].load.tensions[i],
                    false => {
                        let length = self.columns.lengths[i].lane(lane);
                        self.home[i].lane(lane) - length + self.compliance[i].lane(lane) * tension
                    }
                };
                self.last.displacements[i].set_lane(lane, displacement);
            }
        }
    }
}

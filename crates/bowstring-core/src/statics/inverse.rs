//! Inverse kinematics: tensions within limits for a position, and a direction, of the tip.
//!
//! Theory: docs/theory/inverse-kinematics.md.
//!
//! Each iteration solves the equilibrium of the present tensions from the previous strain,
//! linearises the tip with respect to the tensions, and solves the linear problem within the limits
//! and a trust region. Of the tensions that bring the tip equally near, it takes the least.

use crate::dispatch::{self, Plain};
use crate::interrupt;
use crate::math::bounded::{BoundedLeastSquares, Problem};
use crate::math::linalg::Vec3;
use crate::model::error::InputError;
use crate::model::load::{Load, OwnedLoad, RodModel, TendonPath};
use crate::model::robot::Robot;
use crate::rod::estimate::LEVELS;
use crate::statics::adaptive::refine_to;
use crate::statics::batch::{for_each, thread_count, Loads};
use crate::statics::outcome::{Outcome, Status};
use crate::statics::solver::{Pose, Solver, MAX_EXTRAPOLATION};

/// Distance of a reached tip, over the robot's length.
pub const REACHED: f64 = 1e-6;

/// Distance at which the iteration ends, over the robot's length.
const DISTANCE_TOLERANCE: f64 = 1e-8;
/// Change of tension over the unit of tension below which tensions are not made smaller: of tendons
/// that are at most as many as the equations, and of more. And that below which the iteration ends.
const LAST_REDUCTIONS: [f64; 2] = [0.2, 1e-3];
/// Sum of changes of tension over the unit of tension up to which derivatives are kept.
const LARGEST_DRIFT: f64 = 1e-4;
const LEAST_STEP: f64 = 1e-6;
/// Most iterations from one start.
const MAX_ITERATIONS: usize = 100;
/// First radius of the trust region, over the unit of tension.
const FIRST_RADIUS: f64 = 1.5;
/// Radius at which the iteration ends.
const LEAST_RADIUS: f64 = 1e-8;
/// Factors of the radius after a good step at its limit and after a rejected one.
const LARGER: f64 = 2.5;
const SMALLER: f64 = 0.3;
/// Required decrease of the distance, over the predicted one.
const SUFFICIENT_DECREASE: f64 = 0.1;
/// First permitted increase of the distance by a step to smaller tensions, over the length; after
/// some iterations it is halved by each use.
const FIRST_SLACK: f64 = 1e-3;
const FULL_SLACK: usize = 25;
/// Weight of the tensions beside the distance: the first of a cold start, its factor in each
/// iteration, and the last.
const FIRST_WEIGHT: f64 = 1e-3;
const WEIGHT_FACTOR: f64 = 0.03;
const LEAST_WEIGHT: f64 = 1e-7;
/// Distance over length below which steps to smaller tensions may increase it, and their length is
/// chosen.
const NEAR: f64 = 1e-2;
/// Range of that length.
const SHARES: [f64; 2] = [0.1, 4.0];
/// Iterations after which tensions are not made smaller.
const MAX_REDUCTIONS: usize = 60;
/// Starts that are tried until the tip is reached.
const STARTS: usize = 20;
/// Difference of distances over the length within which two starts lead to the same tip, and number
/// of such starts after the first from which it is the nearest.
const SAME: f64 = 1e-7;
const AGREEMENTS: usize = 3;
/// Largest rotation of the arc of the first start (rad).
const LARGEST_BEND: f64 = 4.5;
/// Range of the bend of a segment in the further starts (rad).
const FURTHER_BENDS: [f64; 2] = [0.4, 2.0];
/// Gradient of the distance below which a limit does not bind, over that of the tip's motion.
const LEAST_GRADIENT: f64 = 1e-6;

/// Where the tip should be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Target {
    /// Position (m).
    pub position: [f64; 3],
    /// Direction of the tangent at the tip, of length one.
    pub direction: Option<[f64; 3]>,
}

/// Limits of the tensions, one of each for each tendon (N).
#[derive(Clone, Copy, Debug)]
pub struct Limits<'a> {
    /// Least tensions.
    pub least: &'a [f64],
    /// Largest tensions.
    pub most: &'a [f64],
}

impl Limits<'_> {
    /// Checks that there is one of each for each tendon, not negative and in order.
    pub fn check(&self, robot: &Robot) -> Result<(), InputError> {
        let count = robot.tendon_count();
        if self.least.len() != count || self.most.len() != count {
            return Err(InputError::other(format!(
                "{} least and {} largest tensions were given, a robot with {count} tendons needs {count} of each",
                self.least.len(),
                self.most.len()
            )));
        }
        for (i, (least, most)) in self.least.iter().zip(self.most).enumerate() {
            if !(0.0 <= *least && least <= most && most.is_finite()) {
                return Err(InputError::other(format!(
                    "tension {} is limited to {least} N to {most} N; limits must be finite, >= 0 N and in order",
                    i + 1
                )));
            }
        }
        Ok(())
    }
}

/// How an inverse ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum InverseStatus {
    /// The tip is within [`REACHED`] of the target.
    Reached,
    /// The tip is as near to the target as any small change of tension brings it.
    Unreachable,
    /// The iteration ended before it was.
    MaxIterations,
    /// No start has an equilibrium.
    NoEquilibrium,
}

impl InverseStatus {
    /// The word of the status in the outputs.
    pub fn word(self) -> &'static str {
        match self {
            InverseStatus::Reached => "reached",
            InverseStatus::Unreachable => "unreachable",
            InverseStatus::MaxIterations => "max_iterations",
            InverseStatus::NoEquilibrium => "no_equilibrium",
        }
    }
}

/// Status of an inverse.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct InverseOutcome {
    /// How it ended.
    pub status: InverseStatus,
    /// Distance from the tip to the target (m).
    pub distance: f64,
    /// Angle between the tangent at the tip and its target (rad); NaN without one.
    pub direction_error: f64,
    /// Iterations of all starts.
    pub iterations: usize,
    /// Whether a row of a path was found from another start than the previous row.
    pub restarted: bool,
    /// Elements in a module.
    pub elements: usize,
    /// Outcome of the equilibrium.
    pub equilibrium: Outcome,
}

/// Inverses as flat arrays, row by row; SI units, base frame. Rows without equilibrium hold NaN.
#[derive(Clone, Debug, Default)]
pub struct Inverses {
    /// Outcome of each row.
    pub outcomes: Vec<InverseOutcome>,
    /// Tensions (N), n x tendons.
    pub tensions: Vec<f64>,
    /// Limit that keeps the tip from the target, n x tendons: -1 for the least tension, 1 for the
    /// largest, otherwise 0.
    pub binding: Vec<i8>,
    /// Positions of the tip (m), n x 3.
    pub tip_position: Vec<f64>,
    /// Rotations of the tip, n x 9.
    pub tip_rotation: Vec<f64>,
    /// Lengths of the tendons (m), n x tendons.
    pub tendon_length: Vec<f64>,
}

/// Inverses of many rows: in order, each from the previous one (`warm`), or each from its own start
/// over `threads` cores (0: all). The tensions of the loads are not used.
pub fn inverses(
    robot: &Robot,
    model: &RodModel,
    loads: &Loads,
    targets: &[Target],
    limits: &Limits,
    order: Order,
) -> Result<Inverses, InputError> {
    limits.check(robot)?;
    loads.check(robot)?;
    loads.check_elements(robot, model.elements)?;
    let threads = match order {
        Order::Path => 1,
        Order::Independent { threads } => threads,
    };
    let elements = model.elements.unwrap_or(1);
    dispatch::check_solvers(robot, elements, 2 * thread_count(threads))?;
    InverseSolver::new(robot, *model)?;
    let tendons = robot.tendon_count();
    let mut rows: Vec<(usize, Option<Row>)> = (0..targets.len()).map(|i| (i, None)).collect();
    let scratch = || InverseSolver::new(robot, *model).expect("checked above");
    for_each(&mut rows, threads, scratch, |solver, (i, row)| {
        if interrupt::interrupted() {
            return;
        }
        let warm = order == Order::Path;
        let outcome = solver.solve(&loads.row(*i, tendons), &targets[*i], limits, warm);
        *row = Some(solver.row(outcome));
    });
    let mut found = Inverses::default();
    for (_, row) in rows {
        let row = row.unwrap_or_else(|| Row::pending(tendons));
        found.outcomes.push(row.outcome);
        found.tensions.extend(row.tensions);
        found.binding.extend(row.binding);
        found.tip_position.extend(row.tip.position.0);
        found.tip_rotation.extend(row.tip.rotation.0.as_flattened());
        found.tendon_length.extend(row.lengths);
    }
    Ok(found)
}

/// Order of many rows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Order {
    /// Each starts from the previous one.
    Path,
    /// Each has its own start.
    Independent {
        /// Number of threads; 0 means all cores.
        threads: usize,
    },
}

struct Row {
    outcome: InverseOutcome,
    tensions: Vec<f64>,
    binding: Vec<i8>,
    tip: Pose,
    lengths: Vec<f64>,
}

impl Row {
    fn pending(tendons: usize) -> Self {
        let nan = Vec3::splat([f64::NAN; 3]);
        let mut rotation = crate::math::linalg::Mat3::zero();
        rotation.0 = [[f64::NAN; 3]; 3];
        Row {
            outcome: InverseOutcome::pending(),
            tensions: vec![f64::NAN; tendons],
            binding: vec![0; tendons],
            tip: Pose {
                position: nan,
                rotation,
            },
            lengths: vec![f64::NAN; tendons],
        }
    }
}

impl InverseOutcome {
    fn pending() -> Self {
        InverseOutcome {
            status: InverseStatus::NoEquilibrium,
            distance: f64::NAN,
            direction_error: f64::NAN,
            iterations: 0,
            restarted: false,
            elements: 1,
            equilibrium: Outcome::pending(),
        }
    }
}

/// How the iteration from one start ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum End {
    Converged,
    Stuck,
}

/// A solver with the rod that differentiates its tip.
struct Level {
    solver: Solver,
    plain: Box<dyn Plain>,
}

/// Tensions with their equilibrium. Lengths are over that of the robot, tensions over the unit of
/// tension.
#[derive(Clone)]
struct Point {
    tensions: Vec<f64>,
    strain: Vec<Vec3>,
    residual: [f64; 6],
    /// Norm of the residual.
    size: f64,
    level: usize,
    outcome: Outcome,
}

/// The problem of a row; numbers without unit as in [`Point`].
struct Task {
    target: Target,
    rows: usize,
    lower: Vec<f64>,
    upper: Vec<f64>,
}

/// Scratch memory of the linear problem.
#[derive(Default)]
struct Linear {
    solver: BoundedLeastSquares,
    a: Vec<f64>,
    b: Vec<f64>,
    centre: Vec<f64>,
    lower: Vec<f64>,
    upper: Vec<f64>,
}

/// Inverse kinematics of a robot, with scratch memory for one target after another.
pub struct InverseSolver {
    robot: Robot,
    model: RodModel,
    levels: [Option<Box<Level>>; 4],
    /// Dead loads of the present row, with the tensions of the last trial (N).
    load: OwnedLoad,
    /// Length of the robot (m).
    length: f64,
    /// Unit of tension: by the linear law it bends the robot by one radian (N).
    unit: f64,
    point: Point,
    /// Whether the point is an equilibrium of the loads, and whether the columns are its
    /// derivatives.
    known: bool,
    linearised: bool,
    /// Sum of the changes of tension since the derivatives, over the unit of tension.
    drift: f64,
    /// Derivatives of position and rotation of the tip by each tension (m/N, rad/N).
    columns: Vec<[Vec3; 2]>,
    linear: Linear,
    /// Tensions of the present trial, and the last two steps.
    trial: Vec<f64>,
    step: Vec<f64>,
    last_step: Vec<f64>,
    /// The step (N), and the strain that it leads to.
    changes: Vec<f64>,
    strain: Vec<Vec3>,
    /// Limits that keep the tip of the last solution from its target.
    binding: Vec<i8>,
}

impl InverseSolver {
    /// A solver for a robot and a model.
    ///
    /// # Errors
    /// For continuous tendons, which have no derivatives, and for robots without tendons.
    pub fn new(robot: &Robot, model: RodModel) -> Result<Self, InputError> {
        let tendons = robot.tendon_count();
        if model.model.tendon == TendonPath::Continuous {
            return Err(InputError::other(
                "inverse kinematics needs derivatives, which continuous and embedded tendons do not have",
            ));
        }
        if tendons == 0 {
            return Err(InputError::other(
                "inverse kinematics needs tendons, and the robot has none",
            ));
        }
        let arms = robot.spec().tendons.iter().map(|t| {
            let [x, y] = t.hole(0);
            x.hypot(y)
        });
        let arm = arms.fold(0.0, f64::max).max(1e-3 * robot.length());
        let mut made = InverseSolver {
            robot: robot.clone(),
            model,
            levels: [const { None }; 4],
            load: OwnedLoad::default(),
            length: robot.length(),
            unit: robot.moment_scale() / arm,
            point: Point {
                tensions: vec![0.0; tendons],
                strain: vec![],
                residual: [0.0; 6],
                size: f64::INFINITY,
                level: 0,
                outcome: Outcome::pending(),
            },
            known: false,
            linearised: false,
            drift: 0.0,
            columns: vec![[Vec3::zero(); 2]; tendons],
            linear: Linear::default(),
            trial: vec![0.0; tendons],
            step: vec![0.0; tendons],
            last_step: vec![0.0; tendons],
            changes: vec![0.0; tendons],
            strain: vec![],
            binding: vec![0; tendons],
        };
        made.at(LEVELS[made.first_level(&Load::default())])?;
        Ok(made)
    }

    /// Tensions for a target. `warm` starts from the last solution, for targets in a fine sequence.
    ///
    /// Loads, target and limits must have been checked.
    pub fn solve(
        &mut self,
        load: &Load,
        target: &Target,
        limits: &Limits,
        warm: bool,
    ) -> InverseOutcome {
        let task = self.task(target, limits);
        let mut outcome = InverseOutcome::pending();
        let mut best: Option<(Point, End)> = None;
        let (mut restarted, mut agreements, mut last_is_best) = (false, 0, true);
        if warm && self.known && self.resume(load, &task) {
            let end = self.descend(&task, LEAST_WEIGHT, &mut outcome.iterations);
            if self.point.size > REACHED {
                best = Some((self.point.clone(), end));
            }
        } else {
            self.load.set_dead(load);
            self.known = false;
        }
        let continued = best.is_some();
        if !self.known || continued {
            self.load.set_dead(load);
            for start in 0..STARTS {
                if interrupt::interrupted() || agreements >= AGREEMENTS {
                    break;
                }
                if !self.start(&task, start) {
                    last_is_best = false;
                    continue;
                }
                let end = self.descend(&task, FIRST_WEIGHT, &mut outcome.iterations);
                let size = self.point.size;
                last_is_best = false;
                let best_size = best.as_ref().map_or(f64::INFINITY, |(b, _)| b.size);
                if size < best_size - SAME {
                    last_is_best = true;
                    restarted = continued;
                    agreements = 0;
                    best = Some((self.point.clone(), end));
                } else if size <= best_size + SAME && end == End::Converged {
                    agreements += 1;
                }
                if size <= REACHED {
                    break;
                }
            }
            let Some((point, _)) = &best else {
                self.known = false;
                return outcome;
            };
            if !last_is_best {
                self.point.clone_from(point);
                self.linearised = false;
            }
        }
        let mut end = best.map_or(End::Converged, |(_, end)| end);
        if !self.settle(last_is_best) {
            self.known = false;
            return outcome;
        }
        while self.refine(&task) {
            end = self.descend(&task, LEAST_WEIGHT, &mut outcome.iterations);
            if !self.settle(true) {
                self.known = false;
                return outcome;
            }
        }
        self.known = true;
        self.mark_binding(&task);
        self.describe(&task, end, &mut outcome);
        outcome.restarted = restarted;
        outcome
    }

    fn task(&self, target: &Target, limits: &Limits) -> Task {
        let over = |v: &[f64]| v.iter().map(|t| t / self.unit).collect();
        Task {
            target: *target,
            rows: if target.direction.is_some() { 6 } else { 3 },
            lower: over(limits.least),
            upper: over(limits.most),
        }
    }

    fn first_level(&self, load: &Load) -> usize {
        let least = match self.model.elements {
            Some(elements) => elements,
            None => load.least_elements(&self.robot),
        };
        LEVELS.iter().position(|e| *e >= least).unwrap_or(3)
    }

    /// # Errors
    /// If the solver does not fit into memory.
    fn at(&mut self, elements: usize) -> Result<usize, InputError> {
        let Some(level) = LEVELS.iter().position(|e| *e == elements) else {
            return Err(InputError::elements(elements));
        };
        if self.levels[level].is_none() {
            let solver = Solver::new(&self.robot, self.model.model, elements)?;
            let plain = solver.empty_plain();
            self.levels[level] = Some(Box::new(Level { solver, plain }));
        }
        Ok(level)
    }

    fn level(&mut self) -> &mut Level {
        let level = self.levels[self.point.level].as_mut();
        level.expect("the level of a point was made")
    }

    /// Takes the last solution to other loads, limits and another target.
    fn resume(&mut self, load: &Load, task: &Task) -> bool {
        let now = self.load.borrow();
        let mut same = Load {
            tensions: now.tensions,
            ..*load
        } == now;
        self.load.set_dead(load);
        let bounds = task.lower.iter().zip(&task.upper);
        for (tension, (lower, upper)) in self.point.tensions.iter_mut().zip(bounds) {
            let within = tension.max(*lower).min(*upper);
            same &= within == *tension;
            *tension = within;
        }
        if !same {
            self.linearised = false;
            if !self.settle(false) {
                return false;
            }
        }
        self.measure(task)
    }

    /// Sets the residual of the point to that of the solver's equilibrium.
    fn measure(&mut self, task: &Task) -> bool {
        let Some(tip) = self.level().solver.tip() else {
            return false;
        };
        self.point.residual = residual(&tip, &task.target, self.length);
        self.point.size = norm(&self.point.residual[..task.rows]);
        true
    }

    /// A start, with its equilibrium from the straight backbone; false if it has none.
    fn start(&mut self, task: &Task, number: usize) -> bool {
        self.linearised = false;
        let load = self.load.borrow();
        let level = self.first_level(&load);
        let Ok(level) = self.at(LEVELS[level]) else {
            return false;
        };
        self.point.level = level;
        self.start_tensions(task, number);
        self.load.tensions.clear();
        let unit = self.unit;
        self.load
            .tensions
            .extend(self.point.tensions.iter().map(|t| t * unit));
        let load = std::mem::take(&mut self.load);
        let found = self.level().solver.solve(&load.borrow());
        self.load = load;
        let Ok(found) = found else { return false };
        if !self.measure(task) {
            return false;
        }
        self.point.outcome = found;
        self.keep_strain();
        true
    }

    /// Least tensions within the limits whose moments bend each segment to an arc by the linear
    /// law.
    fn start_tensions(&mut self, task: &Task, number: usize) {
        let tendons = self.robot.tendon_count();
        let spec = self.robot.spec();
        let segments = spec.backbone.len();
        let [x, y, z] = task.target.position;
        let (distance, phi) = (x.hypot(y), y.atan2(x));
        // the chord of an arc makes half the bend with the tangent at the base
        let bend = (2.0 * distance.atan2(z)).min(LARGEST_BEND);
        let Linear {
            solver,
            a,
            b,
            centre,
            lower,
            upper,
        } = &mut self.linear;
        let (rows, sharp) = (2 * segments, 1.0 / FIRST_WEIGHT);
        a.clear();
        a.resize(rows * tendons, 0.0);
        b.clear();
        let mut from = 0.0;
        for s in 0..segments {
            let last = spec.disks.iter().rposition(|d| d.segment == s);
            let first = spec.disks.iter().position(|d| d.segment == s);
            let (Some(first), Some(last)) = (first, last) else {
                b.extend([0.0; 2]);
                continue;
            };
            let length = spec.disks[last].station - from;
            from = spec.disks[last].station;
            let stiffness = self.robot.section(first, 0.5).bending;
            let stiffness = 0.5 * (stiffness[0] + stiffness[1]);
            let (theta, phi) = match number {
                0 => (bend * length / self.length, phi),
                1 => (0.0, 0.0),
                _ => {
                    // quasi-random directions, opposite from segment to segment
                    let turn = 0.618_033_988_749_895 * number as f64 + 0.414_213_562 * s as f64;
                    let flip = if (number + s).is_multiple_of(2) {
                        0.0
                    } else {
                        0.5
                    };
                    let at = phi + std::f64::consts::TAU * (turn + flip).fract();
                    let [least, most] = FURTHER_BENDS;
                    let size = (0.754_877_666 * number as f64 + 0.569_840_29 * s as f64).fract();
                    (least + (most - least) * size, at)
                }
            };
            let moment = stiffness * theta / length / self.unit;
            for (i, tendon) in spec.tendons.iter().enumerate() {
                if tendon.end_disk >= last {
                    let hole = tendon.hole(first + 1);
                    for q in 0..2 {
                        a[i * rows + 2 * s + q] = sharp * hole[q] / self.length;
                    }
                }
            }
            let m = sharp * moment / self.length;
            b.extend([m * phi.cos(), m * phi.sin()]);
        }
        centre.clear();
        centre.resize(tendons, 0.0);
        lower.clear();
        lower.extend_from_slice(&task.lower);
        upper.clear();
        upper.extend_from_slice(&task.upper);
        let problem = Problem {
            a,
            b,
            centre,
            lower,
            upper,
        };
        self.point.tensions.fill(0.0);
        solver.solve(&problem, &mut self.point.tensions);
    }

    fn keep_strain(&mut self) {
        let Point { strain, level, .. } = &mut self.point;
        let of = self.levels[*level].as_ref().expect("it has solved");
        let arcs = 2 * LEVELS[*level] * self.robot.module_count();
        strain.resize(arcs, Vec3::zero());
        of.solver.engine.strains(&mut |i, w| strain[i] = w);
    }

    /// Equilibrium of the point's tensions from its strain.
    fn equilibrium(&mut self) -> Outcome {
        let Self {
            load, point, unit, ..
        } = self;
        load.tensions.clear();
        load.tensions
            .extend(point.tensions.iter().map(|t| t * *unit));
        let level = self.levels[point.level].as_mut();
        let solver = &mut level.expect("the level of a point was made").solver;
        solver.solve_from(Some(&point.strain), &load.borrow())
    }

    /// Equilibrium of the trial's tensions, from the strain of the point and its change to first
    /// order by the step.
    fn trial_equilibrium(&mut self) -> Outcome {
        let Self {
            load,
            point,
            unit,
            trial,
            step,
            changes,
            strain,
            ..
        } = self;
        load.tensions.clear();
        load.tensions.extend(trial.iter().map(|t| t * *unit));
        changes.clear();
        changes.extend(step.iter().map(|t| t * *unit));
        let level = self.levels[point.level].as_mut();
        let Level { solver, plain } = &mut **level.expect("the level of a point was made");
        strain.clone_from(&point.strain);
        plain.add_strain_by_tensions(changes, strain);
        let moved = strain.iter().zip(&point.strain);
        let moved = moved.fold(0.0, |most: f64, (to, from)| {
            most.max((*to - *from).max_abs())
        });
        // a NaN is not small
        let start = if moved < MAX_EXTRAPOLATION {
            &*strain
        } else {
            &point.strain
        };
        solver.solve_from(Some(start), &load.borrow())
    }

    /// Makes the solver hold the equilibrium of the point; unless `holds`, it may hold another one of
    /// the same tensions.
    fn settle(&mut self, holds: bool) -> bool {
        let unit = self.unit;
        let here = self.load.tensions.iter().zip(&self.point.tensions);
        let same = self.load.tensions.len() == self.point.tensions.len()
            && here.into_iter().all(|(load, t)| *load == t * unit);
        if holds && same && self.level().solver.tip().is_some() {
            return true;
        }
        let outcome = self.equilibrium();
        self.point.outcome = outcome;
        let converged = outcome.status == Status::Converged;
        if converged {
            self.keep_strain();
        }
        converged
    }

    /// Solves the point with more elements if its error needs them; false if it does not.
    fn refine(&mut self, task: &Task) -> bool {
        let mut outcome = self.point.outcome;
        let needed = self.level().solver.estimate_error(&mut outcome);
        self.point.outcome = outcome;
        let elements = LEVELS[self.point.level];
        let Some(needed) = needed else { return false };
        if self.model.elements.is_some() || needed <= elements || interrupt::interrupted() {
            return false;
        }
        let Ok(level) = self.at(needed) else {
            // the coarse solution states its error, and is better than none
            return false;
        };
        let coarse = self.point.clone();
        self.point.strain = refine_to(coarse.strain.clone(), needed / elements);
        self.point.level = level;
        self.linearised = false;
        let outcome = self.equilibrium();
        if outcome.status != Status::Converged || !self.measure(task) {
            self.point = coarse;
            self.equilibrium();
            return false;
        }
        self.point.outcome = outcome;
        self.keep_strain();
        true
    }

    /// Gauss-Newton iteration with a trust region from the point, whose equilibrium the solver
    /// holds.
    fn descend(&mut self, task: &Task, first_weight: f64, iterations: &mut usize) -> End {
        let mut radius = FIRST_RADIUS;
        let mut slack = FIRST_SLACK;
        let mut weight = first_weight;
        // share of the way to the least tensions that the last step went
        let mut last_share: Option<f64> = None;
        let mut reduces = true;
        let redundant = self.point.tensions.len() > task.rows;
        let last_reduction = LAST_REDUCTIONS[usize::from(redundant)];
        for round in 0..MAX_ITERATIONS {
            if interrupt::interrupted() {
                return End::Stuck;
            }
            if !self.linearised && !self.linearise(task) {
                return End::Stuck;
            }
            *iterations += 1;
            let mut share = if reduces { 1.0 } else { 0.0 };
            self.linear_step(task, weight, radius, share);
            if let (Some(of), true) = (last_share, self.point.size < NEAR && share > 0.0) {
                let tensions = &self.point.tensions;
                let chosen = step_share(&self.last_step, of, &self.trial, tensions);
                if let Some(chosen) = chosen {
                    share = chosen;
                    self.linear_step(task, weight, radius, share);
                }
            }
            let tensions = &self.point.tensions;
            let changes = self.trial.iter().zip(tensions).map(|(a, b)| a - b);
            let largest = changes.clone().fold(0.0, |most: f64, d| most.max(d.abs()));
            self.step.clear();
            self.step.extend(changes);
            let gain = self.point.size - self.predicted(task);
            if largest <= LEAST_STEP && largest < 0.9 * radius && weight == LEAST_WEIGHT {
                return End::Converged;
            }
            let found = self.trial_equilibrium();
            let tip = self.level().solver.tip();
            let mut accepted = false;
            if let (Status::Converged, Some(tip)) = (found.status, tip) {
                let there = residual(&tip, &task.target, self.length);
                let size = norm(&there[..task.rows]);
                let most = self.point.size - SUFFICIENT_DECREASE * gain;
                // the curved set of equal tips is of interest near the target only
                let near = self.point.size < NEAR;
                if size <= most + if near { slack } else { 0.0 } {
                    accepted = true;
                    if near && size > most && round >= FULL_SLACK {
                        slack *= 0.5;
                    }
                    let good = self.point.size - size >= 0.5 * gain;
                    if largest > 0.8 * radius && good {
                        radius *= LARGER;
                    }
                    self.point.tensions.clone_from(&self.trial);
                    self.point.residual = there;
                    self.point.size = size;
                    self.point.outcome = found;
                    self.keep_strain();
                    self.drift += largest;
                    self.linearised = self.drift <= LARGEST_DRIFT;
                    let near = size <= NEAR && largest <= last_reduction;
                    reduces &= round < MAX_REDUCTIONS && !(near && weight == LEAST_WEIGHT);
                    if size <= DISTANCE_TOLERANCE && !reduces && weight == LEAST_WEIGHT {
                        return End::Converged;
                    }
                    weight = (WEIGHT_FACTOR * weight).max(LEAST_WEIGHT);
                    last_share = (share > 0.0).then_some(share);
                    std::mem::swap(&mut self.step, &mut self.last_step);
                }
            }
            if !accepted {
                radius = SMALLER * largest;
                last_share = None;
                if radius < LEAST_RADIUS {
                    return if gain < 1e-9 {
                        End::Converged
                    } else {
                        End::Stuck
                    };
                }
            }
        }
        End::Stuck
    }

    /// Derivatives at the point, whose equilibrium the solver holds or is solved again.
    fn linearise(&mut self, task: &Task) -> bool {
        let unit = self.unit;
        let here = self.load.tensions.iter().zip(&self.point.tensions);
        let same = here.into_iter().all(|(load, t)| *load == t * unit);
        if !same || self.level().solver.tip().is_none() {
            let outcome = self.equilibrium();
            if outcome.status != Status::Converged {
                return false;
            }
        }
        let level = self.levels[self.point.level].as_mut();
        let Level { solver, plain } = &mut **level.expect("the level of a point was made");
        let rotation = task.target.direction.is_some();
        self.drift = 0.0;
        self.linearised = solver.tip_by_tensions(&mut **plain, rotation, &mut self.columns);
        self.linearised
    }

    /// Column of the residual's derivative by a tension, without unit.
    fn column(&self, i: usize, target: &Target) -> [f64; 6] {
        let [position, rotation] = &self.columns[i];
        let p = *position * (self.unit / self.length);
        let mut column = [p[0], p[1], p[2], 0.0, 0.0, 0.0];
        if let Some(direction) = target.direction {
            let r = &self.point.residual;
            let tangent = Vec3([0, 1, 2].map(|q| r[3 + q] + direction[q]));
            let turned = rotation.cross(tangent) * self.unit;
            column[3..].copy_from_slice(&turned.0);
        }
        column
    }

    /// Solves the linear problem within the limits and the trust region, into `trial`: the nearest
    /// tip, and of the tensions that lead to it those nearest to `1 - share` times the present
    /// ones.
    fn linear_step(&mut self, task: &Task, weight: f64, radius: f64, share: f64) {
        let m = task.rows;
        let mut linear = std::mem::take(&mut self.linear);
        let Linear {
            solver,
            a,
            b,
            centre,
            lower,
            upper,
        } = &mut linear;
        let sharp = 1.0 / weight;
        a.clear();
        b.clear();
        b.extend(self.point.residual[..m].iter().map(|r| -r * sharp));
        for (i, t) in self.point.tensions.iter().enumerate() {
            let column = self.column(i, &task.target);
            for (b, c) in b.iter_mut().zip(&column[..m]) {
                let entry = c * sharp;
                a.push(entry);
                *b += entry * t;
            }
        }
        centre.clear();
        lower.clear();
        upper.clear();
        for (i, t) in self.point.tensions.iter().enumerate() {
            centre.push((1.0 - share) * t);
            lower.push(task.lower[i].max(t - radius));
            upper.push(task.upper[i].min(t + radius));
        }
        self.trial.clone_from(&self.point.tensions);
        let problem = Problem {
            a,
            b,
            centre,
            lower,
            upper,
        };
        solver.solve(&problem, &mut self.trial);
        self.linear = linear;
    }

    /// Predicted norm of the residual at the trial.
    fn predicted(&self, task: &Task) -> f64 {
        let mut r = self.point.residual;
        for (i, (to, from)) in self.trial.iter().zip(&self.point.tensions).enumerate() {
            let column = self.column(i, &task.target);
            for (r, c) in r.iter_mut().zip(column) {
                *r += c * (to - from);
            }
        }
        norm(&r[..task.rows])
    }

    fn describe(&self, task: &Task, end: End, outcome: &mut InverseOutcome) {
        let r = &self.point.residual;
        outcome.distance = norm(&r[..3]) * self.length;
        if task.target.direction.is_some() {
            // the chord between two unit vectors
            outcome.direction_error = 2.0 * (0.5 * norm(&r[3..])).min(1.0).asin();
        }
        outcome.status = match end {
            _ if self.point.size <= REACHED => InverseStatus::Reached,
            End::Converged => InverseStatus::Unreachable,
            End::Stuck => InverseStatus::MaxIterations,
        };
        outcome.elements = LEVELS[self.point.level];
        outcome.equilibrium = self.point.outcome;
    }

    /// The last solution.
    fn row(&mut self, outcome: InverseOutcome) -> Row {
        let mut row = Row::pending(self.robot.tendon_count());
        row.outcome = outcome;
        if outcome.status == InverseStatus::NoEquilibrium {
            return row;
        }
        let unit = self.unit;
        for (out, t) in row.tensions.iter_mut().zip(&self.point.tensions) {
            *out = t * unit;
        }
        row.binding.clone_from(&self.binding);
        let solver = &self.level().solver;
        if let Some(tip) = solver.tip() {
            row.tip = tip;
        }
        for (i, length) in row.lengths.iter_mut().enumerate() {
            *length = solver.tendon_length(i).unwrap_or(f64::NAN);
        }
        row
    }

    /// Marks the limits that keep the tip from the target.
    fn mark_binding(&mut self, task: &Task) {
        self.binding.fill(0);
        if self.point.size <= REACHED {
            return;
        }
        let r = &self.point.residual[..task.rows];
        for i in 0..self.binding.len() {
            let (t, column) = (self.point.tensions[i], self.column(i, &task.target));
            let column = &column[..task.rows];
            // increase of the distance with the tension
            let along: f64 = column.iter().zip(r).map(|(c, r)| c * r).sum();
            let least = LEAST_GRADIENT * norm(column) * norm(r);
            if t == task.lower[i] && along > least {
                self.binding[i] = -1;
            } else if t == task.upper[i] && along < -least {
                self.binding[i] = 1;
            }
        }
    }
}

fn norm(v: &[f64]) -> f64 {
    v.iter().map(|x| x * x).sum::<f64>().sqrt()
}

/// Position over the length, and direction, less those of the target.
fn residual(tip: &Pose, target: &Target, length: f64) -> [f64; 6] {
    let tangent = tip.rotation.column(2);
    let mut r = [0.0; 6];
    for q in 0..3 {
        r[q] = (tip.position[q] - target.position[q]) / length;
        r[3 + q] = target.direction.map_or(0.0, |d| tangent[q] - d[q]);
    }
    r
}

/// Share of the next step to the least tensions, from the change of the projected gradient along
/// the last step (Barzilai and Borwein): the derivatives of the tip by the tensions change along
/// it.
fn step_share(step: &[f64], share: f64, next: &[f64], from: &[f64]) -> Option<f64> {
    let (mut square, mut along) = (0.0, 0.0);
    for ((s, to), from) in step.iter().zip(next).zip(from) {
        square += s * s;
        along += s * (s / share - (to - from));
    }
    (along > 0.0 && square > 0.0).then(|| (square / along).clamp(SHARES[0], SHARES[1]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::robot::{Disk, RobotSpec, Section, Tendon};

    /// Two segments with five tendons.
    fn robot() -> Robot {
        let section = Section {
            bending: [1.0; 2],
            principal_angle: 0.0,
            torsion: 0.8,
            axial: 7e5,
            shear: 2.6e5,
            mass_per_length: 0.035,
            rotary_inertia: 5.5e-8,
            rest_curvature: [0.0; 3],
        };
        let disks = (0..10).map(|k| Disk {
            hole_length: 0.0,
            station: 0.06 * (k + 1) as f64,
            clamped_length: 0.002,
            mass: 0.02,
            inertia: [5.1e-6, 1.0e-5],
            segment: usize::from(k > 4),
        });
        let tendons = (0..5).map(|i| {
            let angle = 1.3 * i as f64;
            Tendon::parallel(
                [0.02 * angle.cos(), 0.02 * angle.sin()],
                if i < 2 { 4 } else { 9 },
            )
        });
        Robot::new(RobotSpec {
            payloads: vec![],
            backbone: vec![section.into(), section.into()],
            disks: disks.collect(),
            tendons: tendons.collect(),
            gravity: [0.0, 0.0, -9.81],
        })
        .unwrap()
    }

    const TENSIONS: [f64; 5] = [5.0, 12.0, 14.0, 3.0, 9.0];

    /// The derivatives of the tip alone are those of all derivatives, with and without a potential.
    #[test]
    fn derivatives_of_the_tip_are_those_of_all() {
        let robot = robot();
        for tip_moment in [[0.0; 3], [0.05, 0.02, 0.01]] {
            for elements in [1, 2] {
                let mut solver = Solver::new(&robot, Default::default(), elements).unwrap();
                let load = Load {
                    tensions: &TENSIONS,
                    gravity: [0.0, 2.0, -9.81],
                    tip_force: [0.3, -0.2, 0.1],
                    tip_moment,
                    ..Load::default()
                };
                let outcome = solver.solve(&load).unwrap();
                assert_eq!(outcome.status, Status::Converged);
                let all = solver.jacobians().unwrap().tensions;
                let mut plain = solver.empty_plain();
                for rotation in [false, true] {
                    let mut columns = vec![[Vec3::zero(); 2]; 5];
                    assert!(solver.tip_by_tensions(&mut *plain, rotation, &mut columns));
                    for (column, exact) in columns.iter().zip(&all) {
                        assert!((column[0] - exact.position).max_abs() < 1e-12);
                        if rotation {
                            assert!((column[1] - exact.rotation).max_abs() < 1e-11);
                        }
                    }
                }
                // strain to first order against central differences
                let changes = [1e-3, -2e-3, 5e-4, 1e-3, -1e-3];
                let mut strain_at = |side: f64| {
                    let mut tensions = TENSIONS;
                    for (t, d) in tensions.iter_mut().zip(changes) {
                        *t += side * d;
                    }
                    let load = Load {
                        tensions: &tensions,
                        ..load
                    };
                    solver.solve(&load).unwrap();
                    solver.last_strain().unwrap()
                };
                let (less, more) = (strain_at(-1.0), strain_at(1.0));
                let mut change = vec![Vec3::zero(); more.len()];
                plain.add_strain_by_tensions(&changes, &mut change);
                for ((less, more), change) in less.iter().zip(&more).zip(&change) {
                    assert!(((*more - *less) * 0.5 - *change).max_abs() < 1e-9);
                }
            }
        }
    }

    /// Tips of forward solves are reached; along a path with fewer iterations.
    #[test]
    fn tips_are_reached() {
        let robot = robot();
        let limits = Limits {
            least: &[0.0; 5],
            most: &[30.0; 5],
        };
        let mut forward = Solver::new(&robot, Default::default(), 2).unwrap();
        let model = RodModel {
            elements: Some(2),
            ..RodModel::default()
        };
        let mut inverse = InverseSolver::new(&robot, model).unwrap();
        let none = Load {
            gravity: [0.0, 0.0, -9.81],
            ..Load::default()
        };
        let mut iterations = [0, 0];
        for step in 0..40 {
            let share = 0.5 + 0.01 * step as f64;
            let tensions = TENSIONS.map(|t| t * share);
            let load = Load {
                tensions: &tensions,
                ..none
            };
            forward.solve(&load).unwrap();
            let target = Target {
                position: forward.tip().unwrap().position.0,
                direction: None,
            };
            let warm = step % 4 > 0;
            let found = inverse.solve(&none, &target, &limits, warm);
            assert_eq!(found.status, InverseStatus::Reached, "{step}");
            assert!(found.distance < 1e-8);
            iterations[usize::from(warm)] += found.iterations;
            let row = inverse.row(found);
            let size = |t: &[f64]| t.iter().map(|t| t * t).sum::<f64>();
            assert!(size(&row.tensions) < size(&tensions) * (1.0 + 1e-6));
            assert!(row.tensions.iter().all(|t| (0.0..=30.0).contains(t)));
        }
        assert!(iterations[1] < 2 * iterations[0], "{iterations:?}");
    }

    #[test]
    fn wrong_limits_are_refused() {
        let robot = robot();
        for (least, most) in [
            ([1.0; 5], [0.5; 5]),
            ([-1.0; 5], [1.0; 5]),
            ([0.0; 5], [f64::NAN; 5]),
            ([0.0; 5], [f64::INFINITY; 5]),
        ] {
            let limits = Limits {
                least: &least,
                most: &most,
            };
            assert!(limits.check(&robot).is_err());
        }
        let limits = Limits {
            least: &[0.0; 4],
            most: &[1.0; 5],
        };
        assert!(limits.check(&robot).is_err());
    }
}

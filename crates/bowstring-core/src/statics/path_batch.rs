//! Many steps of a path in one call: in sequence along a path, or independent over all cores.
//!
//! Theory: docs/theory/actuation.md (History).

use crate::dispatch;
use crate::interrupt;
#[cfg(target_arch = "x86_64")]
use crate::lanes::paths::{LaneStep, PathsSideBySide};
#[cfg(target_arch = "x86_64")]
use crate::lanes::MOST_LANES;
use crate::memory::{filled, unknown};
use crate::model::error::InputError;
use crate::model::load::{Load, RodModel, LEVELS};
use crate::model::robot::Robot;
use crate::statics::batch::{for_each, pieces, thread_count, too_many, Chunk, Solutions};
use crate::statics::designs::{rows_each, ROBOTS};
use crate::statics::loads::Loads;
use crate::statics::path::{Command, Line, PathOutcome, PathSolver};
use crate::statics::solver::{Outcome, Status};
use crate::tendon::{History, Transmission};

/// Commands of all tendons: the displacement (m) of those with `by_displacement`, the tension (N)
/// of the others.
pub fn commands(by_displacement: &[bool], values: &[f64]) -> Vec<Command> {
    let both = by_displacement.iter().zip(values);
    both.map(|(by_displacement, value)| match by_displacement {
        true => Command::Displacement(*value),
        false => Command::Tension(*value),
    })
    .collect()
}

/// Tensions of the commands (N); NaN for tendons under displacement control.
pub fn commanded_tensions(commands: &[Command]) -> Vec<f64> {
    let tension = |c: &Command| {
        if c.is_displacement() {
            f64::NAN
        } else {
            c.value()
        }
    };
    commands.iter().map(tension).collect()
}

impl PathSolver {
    /// Tensions of all spans by modules and tendons (N).
    pub fn span_tensions(&self) -> Vec<f64> {
        let (n, m) = (self.robot().module_count(), self.robot().tendon_count());
        (0..n * m)
            .map(|at| self.span_tension(at / m, at % m))
            .collect()
    }
}

/// Steps as flat arrays, row by row.
#[derive(Clone, Copy, Debug)]
pub struct Steps<'a> {
    /// Loads, with a displacement (m) in place of the tension of a tendon under displacement
    /// control.
    pub loads: Loads<'a>,
    /// Whether each tendon is under displacement control, by rows and tendons.
    pub by_displacement: &'a [bool],
    /// Time from the row before to each row (s), for relaxation and creep; empty for zero.
    pub durations: &'a [f64],
    /// Initial guesses of the states after the rows, where known: those of a path with slightly
    /// other numbers. With any, even none known, a path in sequence keeps its own states.
    pub guesses: Option<&'a [Option<History>]>,
}

impl<'a> Steps<'a> {
    /// Commands and load of a row, for a robot with this many tendons.
    fn row(&self, i: usize, tendons: usize) -> (Vec<Command>, Load<'a>) {
        let load = self.loads.row(i, tendons);
        let by_displacement = &self.by_displacement[i * tendons..][..tendons];
        (commands(by_displacement, load.tensions), load)
    }

    /// Time from the row before to a row (s).
    fn duration(&self, i: usize) -> f64 {
        self.durations.get(i).copied().unwrap_or(0.0)
    }

    /// Initial guess of the state after a row, where known.
    fn guess(&self, i: usize) -> Option<History> {
        self.guesses?.get(i)?.clone()
    }

    /// Checks every row; the error names the first invalid one, counted from 0.
    fn check(&self, path: &mut PathSolver) -> Result<(), InputError> {
        let tendons = path.robot().tendon_count();
        for i in 0..self.loads.count {
            if interrupt::work(10 + tendons) {
                break;
            }
            let (commands, load) = self.row(i, tendons);
            path.check(&commands, &load)
                .and_then(|()| path.set_duration(self.duration(i)))
                .map_err(|e| e.in_row(i))?;
        }
        Ok(())
    }
}

/// Tendons with conflicting displacements, and the nearest displacements with an equilibrium (m).
pub type Conflict = (Vec<usize>, Option<Vec<f64>>);

/// Result of a step beside its arrays.
#[derive(Clone, Debug)]
pub struct Detail {
    /// Whether the tensions are the smallest of many that hold the same pose.
    pub undetermined: bool,
    /// Largest length error of a tendon under displacement control (m).
    pub length_residual: f64,
    /// Opposing tendons, where they are the reason that there is no equilibrium.
    pub conflict: Option<Box<Conflict>>,
}

/// Solutions as flat arrays, row by row; NaN where a row did not converge.
#[derive(Clone, Debug)]
pub struct PathSolutions {
    /// Outcomes, poses and tendon lengths.
    pub poses: Solutions,
    /// Tensions before the base hole (N), n x tendons; as commanded where a row did not converge.
    pub tensions: Vec<f64>,
    /// Tendon displacements (m), n x tendons.
    pub displacements: Vec<f64>,
    /// Slack lengths (m), n x tendons.
    pub slack: Vec<f64>,
    /// Tensions of spans (N), n x modules x tendons.
    pub span_tensions: Vec<f64>,
    /// Further results of each row.
    pub details: Vec<Detail>,
    /// States after the rows of a path, their guesses where a row did not converge; empty without
    /// [`Steps::guesses`].
    pub states: Vec<Option<History>>,
}

/// Solves steps in sequence, each from the state after the one before.
///
/// # Errors
/// If a row does not fit the robot, or the solutions do not fit into memory.
pub fn follow(
    path: &mut PathSolver,
    steps: &Steps,
    disks: bool,
) -> Result<PathSolutions, InputError> {
    steps.check(path)?;
    let count = steps.loads.count;
    let mut solutions = PathSolutions::pending(path.robot(), count, disks)?;
    solutions.keep_states(steps);
    for part in &mut solutions.parts(path.robot(), count.max(1)) {
        part.fill(steps, path, |_| ());
    }
    Ok(solutions)
}

/// Solves independent steps, each from the present state of the path, over `threads` cores (0:
/// all).
///
/// # Errors
/// As [`follow`], or if the copies of the path do not fit into memory.
pub fn solve_each(
    path: &mut PathSolver,
    steps: &Steps,
    threads: usize,
    disks: bool,
) -> Result<PathSolutions, InputError> {
    steps.check(path)?;
    let count = steps.loads.count;
    let mut solutions = PathSolutions::pending(path.robot(), count, disks)?;
    path.check_copies(2 * thread_count(threads).min(count))?;
    let path = &*path;
    let mut parts = solutions.parts(path.robot(), PART);
    let scratch = || Scratch {
        path: path.clone(),
        #[cfg(target_arch = "x86_64")]
        lanes: path.side_by_side().filter(|_| path.suits_lanes()),
    };
    for_each(&mut parts, threads, scratch, |scratch, part| {
        #[cfg(target_arch = "x86_64")]
        if let Some(lanes) = &mut scratch.lanes {
            return part.fill_side_by_side(steps, &mut **lanes, &mut scratch.path, path);
        }
        part.fill(steps, &mut scratch.path, |copy| copy.clone_from(path));
    });
    Ok(solutions)
}

/// Follows a path, and perturbed ones beside it along their own rows, each from its present state;
/// returns the solutions of the path and those of the perturbed ones, which have none where the
/// path has none.
///
/// # Errors
/// As [`follow`], or if the paths do not fit into memory.
pub fn follow_perturbed(
    path: &mut PathSolver,
    rows: &Steps,
    perturbed: &mut [(PathSolver, Steps)],
    disks: bool,
) -> Result<Vec<PathSolutions>, InputError> {
    rows.check(path)?;
    path.check_copies(1 + perturbed.len())?;
    let count = rows.loads.count;
    let mut solutions = vec![PathSolutions::pending(path.robot(), count, disks)?];
    solutions[0].keep_states(rows);
    for (own, steps) in perturbed.iter_mut() {
        steps.check(own)?;
        solutions.push(PathSolutions::pending(own.robot(), count, disks)?);
    }
    let mut parts = solutions
        .iter_mut()
        .flat_map(|each| each.parts(path.robot(), count.max(1)));
    let Some(mut nominal) = parts.next() else {
        return Ok(solutions); // no rows
    };
    let mut parts: Vec<_> = parts.collect();
    for i in 0..count {
        if interrupt::interrupted() {
            break;
        }
        let old = path.history().clone();
        let mut increments = 1;
        let status = nominal.step_by(i, rows, path, |path, commands, load| {
            let found = path.step(commands, load)?;
            increments = found.increments;
            Ok(found)
        });
        if status == Status::Converged {
            path.last.linearise(&old);
        }
        for ((own, steps), part) in perturbed.iter_mut().zip(&mut parts) {
            if status != Status::Converged {
                own.wait(steps.duration(i));
            } else if increments > 1 {
                // the tangent is that of the last increment
                part.step(i, steps, own);
            } else {
                part.step_by(i, steps, own, |own, commands, load| {
                    own.step_perturbed(path, commands, load)
                });
            }
        }
    }
    Ok(solutions)
}

/// Solvers of a thread.
struct Scratch {
    path: PathSolver,
    #[cfg(target_arch = "x86_64")]
    lanes: Option<Box<dyn PathsSideBySide>>,
}

/// Paths of robots that differ in their numbers only.
#[derive(Clone, Copy, Debug)]
pub struct Designs<'a> {
    /// The robots.
    pub robots: &'a [Robot],
    /// Lines of all tendons, by robots and tendons.
    pub lines: &'a [Line],
}

/// Follows a path of every robot from its home pose, over `threads` cores (0: all). The solutions
/// do not depend on the number of threads.
///
/// The rows of `steps` are those of the first robot, then those of the second, and so on, as many
/// for each. A path ends at its first step without a solution: the rows after it, and those of a
/// robot without a home pose, are not solved.
///
/// # Errors
/// If the robots differ in disks or in the end disks of their tendons, or a number is invalid.
pub fn follow_designs(
    designs: &Designs,
    model: &RodModel,
    steps: &Steps,
    threads: usize,
) -> Result<PathSolutions, InputError> {
    let Designs { robots, lines } = *designs;
    let each = rows_each(robots, steps.loads.count)?;
    let tendons = robots[0].tendon_count();
    let of = |i: usize| &lines[i * tendons..][..tendons];
    let (mut home, mut unknowns) = (None, 0);
    for (i, robot) in robots.iter().enumerate() {
        if interrupt::work(100) {
            break;
        }
        let transmission = Transmission::new(robot, model.model, of(i)).map_err(|e| e.in_row(i))?;
        for row in i * each..(i + 1) * each {
            let (commands, load) = steps.row(row, tendons);
            let checked = transmission.tendons.check(robot, &commands, &load);
            let elements = model.elements.unwrap_or(LEVELS[LEVELS.len() - 1]);
            let checked = checked.and_then(|()| load.check_elements(robot, elements));
            checked.map_err(|e| {
                InputError::other(format!("robot {i}, load {}: {e}", row - i * each))
            })?;
        }
        unknowns = unknowns.max(tendons + transmission.most_holes());
        home = home.or_else(|| PathSolver::new(robot, model.model, model.elements, of(i)).ok());
    }
    let mut solutions = PathSolutions::pending(&robots[0], steps.loads.count, false)?;
    let Some(home) = home else {
        return Ok(solutions);
    };
    let copies = usize::min(2 * ROBOTS * thread_count(threads), 2 * robots.len());
    dispatch::check_path(home.robot(), home.solver().elements(), unknowns, copies)?;
    let mut parts = solutions.parts(&robots[0], (ROBOTS * each).max(1));
    let scratch = || GroupScratch {
        #[cfg(target_arch = "x86_64")]
        lanes: home.side_by_side(),
    };
    for_each(&mut parts, threads, scratch, |scratch, part| {
        let first = part.poses.first / each;
        let group = (first..robots.len().min(first + ROBOTS)).filter_map(|i| {
            let path = PathSolver::new(&robots[i], model.model, model.elements, of(i)).ok()?;
            Some(((i - first) * each, path))
        });
        part.follow(steps, scratch, group.collect(), each);
    });
    Ok(solutions)
}

/// Solvers of a thread.
struct GroupScratch {
    #[cfg(target_arch = "x86_64")]
    lanes: Option<Box<dyn PathsSideBySide>>,
}

/// Rows that one thread takes at a time.
const PART: usize = 16;

impl PathSolutions {
    /// Solutions for `n` rows, all NaN.
    fn pending(robot: &Robot, n: usize, disks: bool) -> Result<Self, InputError> {
        let refused = || too_many(n);
        let m = robot.tendon_count();
        let nan = |columns: usize| unknown(n.checked_mul(columns), &refused);
        let detail = Detail {
            undetermined: false,
            length_residual: f64::NAN,
            conflict: None,
        };
        Ok(PathSolutions {
            poses: Solutions::pending(robot, n, disks)?,
            tensions: nan(m)?,
            displacements: nan(m)?,
            slack: nan(m)?,
            span_tensions: nan(robot.module_count() * m)?,
            details: filled(detail, Some(n), &refused)?,
            states: vec![],
        })
    }

    fn keep_states(&mut self, steps: &Steps) {
        if steps.guesses.is_some() {
            self.states = vec![None; steps.loads.count];
        }
    }

    /// Disjoint parts of `rows` rows, the last one possibly shorter.
    fn parts(&mut self, robot: &Robot, rows: usize) -> Vec<Part<'_>> {
        let m = robot.tendon_count();
        let mut tensions = pieces(&mut self.tensions, rows * m);
        let mut displacements = pieces(&mut self.displacements, rows * m);
        let mut slack = pieces(&mut self.slack, rows * m);
        let of_spans = rows * robot.module_count() * m;
        let mut span_tensions = pieces(&mut self.span_tensions, of_spans);
        let mut details = pieces(&mut self.details, rows);
        let mut states = pieces(&mut self.states, rows);
        let part = |poses| Part {
            poses,
            tensions: tensions.next().unwrap_or_default(),
            displacements: displacements.next().unwrap_or_default(),
            slack: slack.next().unwrap_or_default(),
            span_tensions: span_tensions.next().unwrap_or_default(),
            details: details.next().unwrap_or_default(),
            states: states.next().unwrap_or_default(),
        };
        self.poses.chunks(robot, rows).map(part).collect()
    }
}

/// Consecutive rows and the storage of their solutions.
struct Part<'a> {
    poses: Chunk<'a>,
    tensions: &'a mut [f64],
    displacements: &'a mut [f64],
    slack: &'a mut [f64],
    span_tensions: &'a mut [f64],
    details: &'a mut [Detail],
    states: &'a mut [Option<History>],
}

impl Part<'_> {
    /// Solves all rows; `before` prepares the path for each.
    fn fill(&mut self, steps: &Steps, path: &mut PathSolver, before: impl Fn(&mut PathSolver)) {
        for i in 0..self.details.len() {
            if interrupt::interrupted() {
                return;
            }
            before(path);
            self.step(i, steps, path);
        }
    }

    /// Solves all rows in lanes, each from the state of `path`; `copy` takes those that are left.
    #[cfg(target_arch = "x86_64")]
    fn fill_side_by_side(
        &mut self,
        steps: &Steps,
        lanes: &mut dyn PathsSideBySide,
        copy: &mut PathSolver,
        path: &PathSolver,
    ) {
        let rows: Vec<usize> = (0..self.details.len()).collect();
        for rows in rows.chunks(lanes.width()) {
            if interrupt::interrupted() {
                return;
            }
            lanes.restart();
            let outcomes = lanes.step(&self.lane_steps(steps, rows, path.robot()));
            for (lane, (&row, outcome)) in rows.iter().zip(outcomes).enumerate() {
                if let Some(outcome) = outcome {
                    self.write_lane(row, lanes, lane, outcome);
                    continue;
                }
                copy.clone_from(path);
                self.step(row, steps, copy);
            }
        }
    }

    /// Follows some paths from their first rows on, `each` rows of every path.
    #[cfg_attr(not(target_arch = "x86_64"), allow(unused_variables))]
    fn follow(
        &mut self,
        steps: &Steps,
        scratch: &mut GroupScratch,
        mut paths: Vec<(usize, PathSolver)>,
        each: usize,
    ) {
        #[cfg(target_arch = "x86_64")]
        if let Some(lanes) = &mut scratch.lanes {
            if paths.iter().all(|(_, path)| path.suits_lanes()) {
                for paths in paths.chunks_mut(lanes.width()) {
                    self.follow_side_by_side(steps, &mut **lanes, paths, each);
                }
                return;
            }
        }
        for (first, path) in &mut paths {
            for row in *first..*first + each {
                if interrupt::interrupted() {
                    return;
                }
                if self.step(row, steps, path) != Status::Converged {
                    self.end(row, *first + each);
                    break;
                }
            }
        }
    }

    #[cfg(target_arch = "x86_64")]
    fn follow_side_by_side(
        &mut self,
        steps: &Steps,
        lanes: &mut dyn PathsSideBySide,
        paths: &mut [(usize, PathSolver)],
        each: usize,
    ) {
        let starts: Vec<_> = paths.iter().map(|(_, path)| path.in_lane()).collect();
        lanes.set_paths(&starts);
        let mut left = [false; MOST_LANES];
        let mut ended = [false; MOST_LANES];
        for at in 0..each {
            if interrupt::interrupted() {
                return;
            }
            let rows: Vec<usize> = paths.iter().map(|(first, _)| first + at).collect();
            let outcomes = lanes.step(&self.lane_steps(steps, &rows, paths[0].1.robot()));
            for (lane, ((_, path), outcome)) in paths.iter_mut().zip(outcomes).enumerate() {
                if ended[lane] {
                    continue;
                }
                if let Some(outcome) = outcome {
                    self.write_lane(rows[lane], lanes, lane, outcome);
                    continue;
                }
                if at > 0 && !left[lane] {
                    let before = self.poses.first + rows[lane] - 1;
                    let (commands, load) = steps.row(before, path.robot().tendon_count());
                    path.continue_from(&lanes.last(lane), &commands, &load);
                }
                left[lane] = true;
                if self.step(rows[lane], steps, path) != Status::Converged {
                    ended[lane] = true;
                    self.end(rows[lane], rows[lane] - at + each);
                }
            }
            if ended[..paths.len()].iter().all(|ended| *ended) {
                return;
            }
        }
    }

    /// Steps of some rows of this part.
    #[cfg(target_arch = "x86_64")]
    fn lane_steps<'s>(
        &self,
        steps: &Steps<'s>,
        rows: &[usize],
        robot: &Robot,
    ) -> Vec<LaneStep<'s>> {
        let tendons = robot.tendon_count();
        let step = |row: &usize| {
            let i = self.poses.first + row;
            LaneStep {
                by_displacement: &steps.by_displacement[i * tendons..][..tendons],
                load: steps.loads.row(i, tendons),
            }
        };
        rows.iter().map(step).collect()
    }

    /// Writes the step of a lane, which converged.
    #[cfg(target_arch = "x86_64")]
    fn write_lane(
        &mut self,
        i: usize,
        lanes: &dyn PathsSideBySide,
        lane: usize,
        found: PathOutcome,
    ) {
        let m = self.tensions.len() / self.details.len();
        let of_spans = self.span_tensions.len() / self.details.len();
        self.poses
            .write(i, |k| lanes.disk(k, lane), |j| lanes.tendon_length(j, lane));
        for j in 0..m {
            self.tensions[i * m + j] = lanes.tension(j, lane);
            self.displacements[i * m + j] = lanes.displacement(j, lane);
            self.slack[i * m + j] = lanes.slack(j, lane);
        }
        let spans = &mut self.span_tensions[i * of_spans..][..of_spans];
        for (at, tension) in spans.iter_mut().enumerate() {
            *tension = lanes.span_tension(at / m, at % m, lane);
        }
        self.set_outcome(i, found);
    }

    /// Ends a path at a row without a solution: the rows after it have its status.
    fn end(&mut self, row: usize, end: usize) {
        let status = self.poses.outcomes[row].status;
        for outcome in &mut self.poses.outcomes[row + 1..end] {
            outcome.status = status;
        }
    }

    /// Takes a step, and returns its status.
    fn step(&mut self, i: usize, steps: &Steps, path: &mut PathSolver) -> Status {
        self.step_by(i, steps, path, PathSolver::step)
    }

    /// The same by another solution of the step.
    fn step_by(
        &mut self,
        i: usize,
        steps: &Steps,
        path: &mut PathSolver,
        solve: impl FnOnce(&mut PathSolver, &[Command], &Load) -> Result<PathOutcome, InputError>,
    ) -> Status {
        let m = path.robot().tendon_count();
        let row = self.poses.first + i;
        let (commands, load) = steps.row(row, m);
        path.last.guess = steps.guess(row);
        let step = path
            .set_duration(steps.duration(row))
            .and_then(|()| solve(path, &commands, &load));
        let found = step.expect("all rows were checked");
        let put = |to: &mut [f64], from: &[f64]| {
            to[i * from.len()..][..from.len()].copy_from_slice(from);
        };
        if found.status == Status::Converged {
            self.poses.write_answer(i, path.solver());
            put(self.tensions, &path.history().tensions);
            let displacements: Vec<f64> = (0..m).map(|j| path.displacement(j)).collect();
            put(self.displacements, &displacements);
            put(self.slack, path.slack());
            put(self.span_tensions, &path.span_tensions());
        } else {
            put(self.tensions, &commanded_tensions(&commands));
        }
        if let Some(state) = self.states.get_mut(i) {
            *state = match found.status {
                Status::Converged => Some(path.history().clone()),
                _ => steps.guess(row),
            };
        }
        let status = found.status;
        self.set_outcome(i, found);
        status
    }

    fn set_outcome(&mut self, i: usize, found: PathOutcome) {
        self.poses.outcomes[i] = Outcome::from(&found);
        let in_conflict = !found.opposing.is_empty() || found.nearest.is_some();
        self.details[i] = Detail {
            undetermined: found.undetermined,
            length_residual: found.length_residual,
            conflict: in_conflict.then(|| Box::new((found.opposing, found.nearest))),
        };
    }
}

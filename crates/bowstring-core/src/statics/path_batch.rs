//! Many steps of a path in one call: in sequence along a path, or independent over all cores.
//!
//! Theory: docs/theory/actuation.md (History).

use crate::interrupt;
use crate::memory::{filled, unknown};
use crate::model::error::InputError;
use crate::model::load::Load;
use crate::model::robot::Robot;
use crate::statics::batch::{for_each, pieces, thread_count, too_many, Chunk, Loads, Solutions};
use crate::statics::path::{Command, PathOutcome, PathSolver};
use crate::statics::solver::{Outcome, Status};

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

impl From<&PathOutcome> for Outcome {
    fn from(found: &PathOutcome) -> Self {
        Outcome {
            status: found.status,
            stable: match found.status {
                Status::NoEquilibrium => None,
                _ => found.stable,
            },
            iterations: found.iterations,
            residual: found.residual,
            error: found.error,
            ..Outcome::pending()
        }
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
}

impl<'a> Steps<'a> {
    /// Commands and load of a row, for a robot with this many tendons.
    fn row(&self, i: usize, tendons: usize) -> (Vec<Command>, Load<'a>) {
        let load = self.loads.row(i, tendons);
        let by_displacement = &self.by_displacement[i * tendons..][..tendons];
        (commands(by_displacement, load.tensions), load)
    }

    /// Checks every row; the error names the first invalid one, counted from 0.
    fn check(&self, path: &mut PathSolver) -> Result<(), InputError> {
        let tendons = path.robot().tendon_count();
        for i in 0..self.loads.count {
            if interrupt::work(10 + tendons) {
                break;
            }
            let (commands, load) = self.row(i, tendons);
            path.check(&commands, &load).map_err(|e| e.in_row(i))?;
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
    for_each(
        &mut parts,
        threads,
        || path.clone(),
        |copy, part| part.fill(steps, copy, |copy| copy.clone_from(path)),
    );
    Ok(solutions)
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
        })
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
        let part = |poses| Part {
            poses,
            tensions: tensions.next().unwrap_or_default(),
            displacements: displacements.next().unwrap_or_default(),
            slack: slack.next().unwrap_or_default(),
            span_tensions: span_tensions.next().unwrap_or_default(),
            details: details.next().unwrap_or_default(),
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

    fn step(&mut self, i: usize, steps: &Steps, path: &mut PathSolver) {
        let m = path.robot().tendon_count();
        let (commands, load) = steps.row(self.poses.first + i, m);
        let found = path.step(&commands, &load).expect("all rows were checked");
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
        self.poses.outcomes[i] = Outcome::from(&found);
        let in_conflict = !found.opposing.is_empty() || found.nearest.is_some();
        self.details[i] = Detail {
            undetermined: found.undetermined,
            length_residual: found.length_residual,
            conflict: in_conflict.then(|| Box::new((found.opposing, found.nearest))),
        };
    }
}

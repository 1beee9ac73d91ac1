//! Inverses of many rows: a path, or rows that are independent of each other.

use super::{InverseOutcome, InverseSolver, InverseStatus, Limits, Target};
use crate::dispatch;
use crate::interrupt;
use crate::math::linalg::{Mat3, Vec3};
use crate::model::error::InputError;
use crate::model::load::RodModel;
use crate::model::robot::Robot;
use crate::statics::batch::{for_each, thread_count};
use crate::statics::loads::Loads;
use crate::statics::solver::Pose;

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

/// Inverses of many rows, with the margin of [`InverseSolver::new`]. The tensions of the loads are
/// not used.
///
/// # Errors
/// If an argument is wrong, or the solvers do not fit into memory.
pub fn inverses(
    robot: &Robot,
    model: &RodModel,
    loads: &Loads,
    targets: &[Target],
    limits: &Limits,
    margin: f64,
    order: Order,
) -> Result<Inverses, InputError> {
    limits.check(robot)?;
    for target in targets {
        target.check()?;
    }
    loads.check(robot)?;
    loads.check_elements(robot, model.elements)?;
    let threads = match order {
        Order::Path => 1,
        Order::Independent { threads } => threads,
    };
    let elements = model.elements.unwrap_or(1);
    dispatch::check_inverses(robot, elements, thread_count(threads))?;
    InverseSolver::new(robot, *model, margin)?;
    let tendons = robot.tendon_count();
    let mut rows: Vec<(usize, Option<Row>)> = (0..targets.len()).map(|i| (i, None)).collect();
    let scratch = || InverseSolver::new(robot, *model, margin).expect("checked above");
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

pub(super) struct Row {
    outcome: InverseOutcome,
    tensions: Vec<f64>,
    binding: Vec<i8>,
    tip: Pose,
    lengths: Vec<f64>,
}

impl Row {
    fn pending(tendons: usize) -> Self {
        let nan = Vec3::splat([f64::NAN; 3]);
        let mut rotation = Mat3::zero();
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

impl InverseSolver {
    /// The last solution.
    pub(super) fn row(&mut self, outcome: InverseOutcome) -> Row {
        let mut row = Row::pending(self.robot.tendon_count());
        row.outcome = outcome;
        if outcome.status == InverseStatus::NoEquilibrium {
            return row;
        }
        row.tensions.clone_from(&self.tensions);
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
}

//! Linearisation about the equilibrium under a load, or at the present state of a path.
//!
//! Theory: docs/theory/dynamics.md (Modal analysis).

use crate::dispatch;
use crate::memory;
use crate::model::error::InputError;
use crate::model::load::{Load, Model};
use crate::model::robot::Robot;
use crate::statics::path::PathSolver;
use crate::statics::solver::{Outcome, Solver, Status};
use crate::step::oscillation::linearised;
pub use crate::step::oscillation::Flexibility;

/// Flexibility about the equilibrium under a load; `None` where there is no stable one, or where a
/// moment leaves no potential.
pub fn flexibility(
    robot: &Robot,
    model: Model,
    elements: usize,
    load: &Load,
) -> Result<(Outcome, Option<Flexibility>), InputError> {
    let mut solver = Solver::new(robot, model, elements)?;
    dispatch::check_moving(robot, elements)?;
    let mut outcome = solver.solve(load)?;
    let has_potential = load.has_potential();
    if outcome.status != Status::Converged || outcome.stable != Some(true) || !has_potential {
        return Ok((outcome, None));
    }
    let found = linearised(&solver.at_rest(), load, None, &[]);
    if found.is_none() {
        outcome.status = Status::MaxIterations;
    }
    Ok((outcome, found))
}

/// Flexibility at the present state of a path of equilibria: displacement-controlled tendons keep
/// their displacement, and with friction all holes stick. `None` where the path has not reached a
/// stable equilibrium.
///
/// # Errors
/// If the constraints of the tendons do not fit into memory.
pub fn flexibility_at(path: &PathSolver) -> Result<Option<Flexibility>, InputError> {
    let (solver, history) = (path.solver(), path.history());
    dispatch::check_moving(solver.robot(), solver.elements())?;
    let load = Load {
        tensions: &history.tensions,
        ..history.load.borrow()
    };
    if solver.tip().is_none() || !load.has_potential() {
        return Ok(None); // no potential
    }
    let (modules, tendons) = (solver.robot().module_count(), history.tensions.len());
    let freedoms = (modules * (6 * solver.elements() + 4)) as f64;
    let locks = path.transmission().lock_count() as f64;
    memory::check(
        8.0 * locks * (freedoms + 3.0 * locks),
        || format!("a robot with {modules} disks and {locks} spans of tendons that are held"),
        "use fewer disks",
    )?;
    let spans = (0..modules * tendons).map(|at| path.span_tension(at / tendons, at % tendons));
    let spans: Vec<_> = spans.collect();
    let locks = path.transmission().locks();
    Ok(linearised(&solver.at_rest(), &load, Some(&spans), &locks))
}

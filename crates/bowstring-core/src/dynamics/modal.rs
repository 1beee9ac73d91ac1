//! The linearised robot about the equilibrium under a load, or where a path has come to.

use crate::dispatch;
use crate::memory;
use crate::model::error::InputError;
use crate::model::load::{Load, Model};
use crate::model::robot::Robot;
pub use crate::motion::oscillation::Flexibility;
use crate::motion::oscillation::{found, still};
use crate::statics::path::Drive;
use crate::statics::solver::{Outcome, Solver, Status};

/// Flexibility about the equilibrium under a load; none where there is no stable one, or where
/// a tip moment leaves no potential.
pub fn flexibility(
    robot: &Robot,
    model: Model,
    elements: usize,
    load: &Load,
) -> Result<(Outcome, Option<Flexibility>), InputError> {
    match elements {
        1 => about::<2>(robot, model, load),
        2 => about::<4>(robot, model, load),
        4 => about::<8>(robot, model, load),
        8 => about::<16>(robot, model, load),
        n => Err(InputError::elements(n)),
    }
}

/// The same where a path of equilibria has come to: tendons that are pulled by a length keep it,
/// and with friction none slips. None where the path has not come to a stable one.
///
/// # Errors
/// If what holds the tendons does not fit into memory.
pub fn flexibility_at(drive: &Drive) -> Result<Option<Flexibility>, InputError> {
    let solver = drive.solver();
    dispatch::check_moving(solver.robot(), solver.elements())?;
    match solver.elements() {
        1 => held::<2>(drive),
        2 => held::<4>(drive),
        4 => held::<8>(drive),
        _ => held::<16>(drive),
    }
}

fn held<const A: usize>(drive: &Drive) -> Result<Option<Flexibility>, InputError> {
    let (solver, history) = (drive.solver(), drive.history());
    let [gravity, tip_force, tip_moment] = history.load;
    if solver.tip().is_none() || tip_moment != [0.0; 3] {
        return Ok(None); // no potential
    }
    let locks = drive.transmission().lock_count() as f64;
    let modules = solver.robot().module_count() as f64;
    memory::check(
        8.0 * locks * (modules * (3 * A + 4) as f64 + 3.0 * locks),
        || format!("a robot with {modules} disks and {locks} spans of tendons that are held"),
        "use fewer disks",
    )?;
    let mut motion = still::<A>(
        &solver.at_rest(),
        &Load {
            tensions: &history.tensions,
            gravity,
            tip_force,
            tip_moment,
        },
    );
    motion.set_span_tensions(|k, i| drive.span_tension(k, i));
    Ok(found(motion, &drive.transmission().locks()))
}

fn about<const A: usize>(
    robot: &Robot,
    model: Model,
    load: &Load,
) -> Result<(Outcome, Option<Flexibility>), InputError> {
    dispatch::check_moving(robot, A / 2)?;
    let mut solver = Solver::new(robot, model, A / 2)?;
    let mut outcome = solver.solve(load)?;
    let has_potential = load.tip_moment == [0.0; 3];
    if outcome.status != Status::Converged || outcome.stable != Some(true) || !has_potential {
        return Ok((outcome, None));
    }
    let found = found(still::<A>(&solver.at_rest(), load), &[]);
    if found.is_none() {
        outcome.status = Status::MaxIterations;
    }
    Ok((outcome, found))
}

//! Small oscillations about an equilibrium: how all mass answers forces, and how heavy it is.
//!
//! With flexibility `F` and masses `M`, the eigenvalues of `sqrt(M) F sqrt(M)` are `1/omega^2`.

use crate::drive::Drive;
use crate::linalg::Vec3;
use crate::load::{Load, Model};
use crate::motion::{Damping, Lock, Motion};
use crate::real::Scalar;
use crate::robot::{InputError, Robot};
use crate::statics::{Outcome, Solver, Status};

/// The linearised robot about an equilibrium.
///
/// Freedoms, module by module: translation of every mass point from base to tip, the disk
/// last, in the base frame; then rotation of the disk, in its own frame.
#[derive(Clone, Debug)]
pub struct Flexibility {
    /// Displacement (row) by unit force (column), m/N, rad/N, m/(N m), rad/(N m); by rows.
    pub matrix: Vec<f64>,
    /// kg and kg m^2.
    pub masses: Vec<f64>,
    /// Mass points of a module, the disk among them.
    pub points: usize,
}

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
        n => Err(InputError(format!(
            "elements is {n}, it must be 1, 2, 4 or 8"
        ))),
    }
}

/// The same where a path of equilibria has come to: tendons that are pulled by a length keep it,
/// and with friction none slips. None where the path has not come to a stable one.
pub fn flexibility_at(drive: &Drive) -> Option<Flexibility> {
    let solver = drive.solver();
    match solver.elements() {
        1 => held::<2>(drive),
        2 => held::<4>(drive),
        4 => held::<8>(drive),
        _ => held::<16>(drive),
    }
}

fn held<const A: usize>(drive: &Drive) -> Option<Flexibility> {
    let (solver, history) = (drive.solver(), drive.history());
    solver.tip()?;
    let [gravity, tip_force, tip_moment] = history.load;
    if tip_moment != [0.0; 3] {
        return None; // no potential
    }
    let mut motion = still::<A>(
        solver,
        &Load {
            tensions: &history.tensions,
            gravity,
            tip_force,
            tip_moment,
        },
    );
    motion.set_span_tensions(|k, i| drive.span_tension(k, i));
    found(motion, &drive.transmission().locks())
}

/// At rest in the pose of a solver.
fn still<const A: usize>(solver: &Solver, load: &Load) -> Motion<Scalar, A> {
    let n = solver.robot().module_count();
    let (mut strain, mut force) = (vec![Vec3::zero(); A * n], vec![Vec3::zero(); n]);
    solver.strain_and_force(&mut strain, &mut force);
    let undamped = Damping {
        mass: 0.0,
        material: 0.0,
    };
    let mut motion = Motion::new(solver.robot(), solver.model(), load.gravity, undamped);
    motion.take_strain(|i| strain[i], |k| force[k]);
    motion.set_load(load);
    motion
}

fn found<const A: usize>(mut motion: Motion<Scalar, A>, locks: &[Lock]) -> Option<Flexibility> {
    if !motion.settle() {
        return None;
    }
    let (matrix, masses) = motion.flexibility(locks)?;
    Some(Flexibility {
        matrix,
        masses,
        points: A,
    })
}

fn about<const A: usize>(
    robot: &Robot,
    model: Model,
    load: &Load,
) -> Result<(Outcome, Option<Flexibility>), InputError> {
    let mut solver = Solver::new(robot, model, A / 2)?;
    let mut outcome = solver.solve(load)?;
    if outcome.status != Status::Converged || outcome.stable != Some(true) {
        return Ok((outcome, None));
    }
    let found = found(still::<A>(&solver, load), &[]);
    if found.is_none() {
        outcome.status = Status::MaxIterations;
    }
    Ok((outcome, found))
}

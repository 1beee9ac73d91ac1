//! Small oscillations about an equilibrium: how all mass answers forces, and how heavy it is.
//!
//! With flexibility `F` and masses `M`, the eigenvalues of `sqrt(M) F sqrt(M)` are `1/omega^2`.

use crate::linalg::Vec3;
use crate::load::{Load, Model};
use crate::motion::{Damping, Motion};
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
    let n = robot.module_count();
    let (mut strain, mut force) = (vec![Vec3::zero(); A * n], vec![Vec3::zero(); n]);
    solver.strain_and_force(&mut strain, &mut force);
    let undamped = Damping {
        mass: 0.0,
        material: 0.0,
    };
    let mut motion = Motion::<Scalar, A>::new(robot, model, load.gravity, undamped);
    motion.take_strain(|i| strain[i], |k| force[k]);
    motion.set_load(load);
    if !motion.settle() {
        outcome.status = Status::MaxIterations;
        return Ok((outcome, None));
    }
    let (matrix, masses) = motion.flexibility();
    let found = Flexibility {
        matrix,
        masses,
        points: A,
    };
    Ok((outcome, Some(found)))
}

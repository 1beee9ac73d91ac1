//! Small oscillations about an equilibrium: how all mass answers forces, and how heavy it is.
//!
//! With flexibility `F` and masses `M`, the eigenvalues of `sqrt(M) F sqrt(M)` are `1/omega^2`.

use crate::batch::unknown;
use crate::drive::Drive;
use crate::eigenvalues;
use crate::engine;
use crate::interrupt;
use crate::linalg::Vec3;
use crate::load::{Load, Model};
use crate::memory;
use crate::motion::{Damping, Lock, Motion, Rest};
use crate::real::Scalar;
use crate::robot::{InputError, Robot};
use crate::statics::{Outcome, Solver, Status};

/// The linearised robot about an equilibrium.
///
/// Freedoms, module by module: translation of every mass point from base to tip, the disk
/// last, in the base frame; then rotation of the disk, in its own frame.
pub struct Flexibility {
    rest: Box<dyn AnswersForces>,
    /// kg and kg m^2.
    pub masses: Vec<f64>,
    /// Mass points of a module, the disk among them.
    pub points: usize,
    /// Of a column, in units of `interrupt::work`.
    work: usize,
}

impl Flexibility {
    /// Displacement of all freedoms by forces on all of them, m and rad by N and N m: the
    /// product of the flexibility matrix and the forces, in a time that grows in proportion to the
    /// robot.
    ///
    /// # Panics
    /// If there are not as many forces as masses.
    pub fn apply(&mut self, forces: &[f64]) -> Vec<f64> {
        assert_eq!(forces.len(), self.masses.len());
        interrupt::work(self.work);
        self.rest.answer(forces)
    }

    /// Displacement (row) by unit force (column), m/N, rad/N, m/(N m), rad/(N m); by rows.
    ///
    /// # Errors
    /// If it does not fit into memory.
    pub fn matrix(&mut self) -> Result<Vec<f64>, InputError> {
        let size = self.masses.len();
        let refused = || {
            InputError(format!(
                "a flexibility matrix of {size} rows does not fit into memory; apply it to forces"
            ))
        };
        let mut matrix = unknown(size.checked_mul(size), &refused)?;
        let mut unit = vec![0.0; size];
        for column in 0..size {
            if interrupt::interrupted() {
                break;
            }
            unit[column] = 1.0;
            for (row, v) in self.apply(&unit).iter().enumerate() {
                matrix[row * size + column] = *v;
            }
            unit[column] = 0.0;
        }
        Ok(matrix)
    }
}

trait AnswersForces: Send + Sync {
    fn answer(&mut self, forces: &[f64]) -> Vec<f64>;
}

struct AtRest<const A: usize> {
    motion: Motion<Scalar, A>,
    rest: Rest<A>,
}

impl<const A: usize> AnswersForces for AtRest<A> {
    fn answer(&mut self, forces: &[f64]) -> Vec<f64> {
        self.motion.answer_forces(forces, &self.rest)
    }
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
///
/// # Errors
/// If what holds the tendons does not fit into memory.
pub fn flexibility_at(drive: &Drive) -> Result<Option<Flexibility>, InputError> {
    let solver = drive.solver();
    engine::check_moving(solver.robot(), solver.elements())?;
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
        solver,
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
    let rest = motion.linearise_at_rest(locks)?;
    Some(Flexibility {
        masses: motion.masses_of_freedoms(),
        points: A,
        work: motion.work() + locks.len() * (2 * A * motion.module_count() + locks.len()) / 4,
        rest: Box::new(AtRest { motion, rest }),
    })
}

/// Frequencies beyond this many times the slowest are not looked at for growth.
const SLOW: f64 = 30.0;
/// Oscillations that are found at most, the slowest.
const MOST_OSCILLATIONS: usize = 40;
/// The same where motions may leave without an oscillation, which fast ones do as well.
const MOST_MOTIONS: usize = 80;
/// Smallest answer to forces that is not lost in rounding, over the largest.
const LEAST_ANSWER: f64 = 1e-9;

/// How fast small oscillations about an equilibrium grow without damping, as a share of their
/// angular frequency, the slow ones: 1 for one that leaves without an oscillation, 0 where there
/// is a potential and the equilibrium a minimum. A damping ratio as large keeps them from it.
/// `oscillates`: the symmetric part of the tangent is positive definite, so that nothing leaves
/// otherwise. None where there is no mass, and where mass in points leaves no equilibrium.
pub(crate) fn growth(solver: &Solver, load: &Load, oscillates: bool) -> Option<f64> {
    match solver.elements() {
        1 => grows::<2>(solver, load, oscillates),
        2 => grows::<4>(solver, load, oscillates),
        4 => grows::<8>(solver, load, oscillates),
        _ => grows::<16>(solver, load, oscillates),
    }
}

fn grows<const A: usize>(solver: &Solver, load: &Load, oscillates: bool) -> Option<f64> {
    engine::check_moving(solver.robot(), A / 2).ok()?;
    let mut flexibility = found(still::<A>(solver, load), &[])?;
    let roots: Vec<_> = flexibility.masses.iter().map(|m| m.sqrt()).collect();
    let mut forces = vec![0.0; roots.len()];
    let apply = |x: &[f64], out: &mut [f64]| {
        for ((force, x), root) in forces.iter_mut().zip(x).zip(&roots) {
            *force = root * x;
        }
        let moved = flexibility.apply(&forces);
        for ((out, moved), root) in out.iter_mut().zip(moved).zip(&roots) {
            *out = root * moved;
        }
    };
    // 1 / omega^2
    let most = if oscillates {
        MOST_OSCILLATIONS
    } else {
        MOST_MOTIONS
    };
    let squares = eigenvalues::largest(roots.len(), most, apply)?;
    let size_of = |[re, im]: &[f64; 2]| f64::hypot(*re, *im);
    let largest = squares.iter().map(size_of).fold(0.0, f64::max);
    if !(largest > 0.0) {
        return None;
    }
    let seen = squares.iter().filter(|s| {
        let leaves = s[0] < -s[1].abs();
        let least = if leaves {
            LEAST_ANSWER
        } else {
            1.0 / (SLOW * SLOW)
        };
        size_of(s) >= least * largest
    });
    let share = |[re, im]: &[f64; 2]| (0.5 * im.atan2(*re)).sin().abs();
    Some(seen.map(share).fold(0.0, f64::max))
}

fn about<const A: usize>(
    robot: &Robot,
    model: Model,
    load: &Load,
) -> Result<(Outcome, Option<Flexibility>), InputError> {
    engine::check_moving(robot, A / 2)?;
    let mut solver = Solver::new(robot, model, A / 2)?;
    let mut outcome = solver.solve(load)?;
    let has_potential = load.tip_moment == [0.0; 3];
    if outcome.status != Status::Converged || outcome.stable != Some(true) || !has_potential {
        return Ok((outcome, None));
    }
    let found = found(still::<A>(&solver, load), &[]);
    if found.is_none() {
        outcome.status = Status::MaxIterations;
    }
    Ok((outcome, found))
}

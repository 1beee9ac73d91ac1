//! Small oscillations about an equilibrium: response of all mass to forces, and masses.
//!
//! Theory: docs/theory/dynamics.md (Modal analysis).
//!
//! With flexibility `F` and masses `M`, the eigenvalues of `sqrt(M) F sqrt(M)` are `1/omega^2`.

use super::flexibility::Lock;
use super::motion::Motion;
use super::moving::Moving;
use super::scheme::Damping;
use crate::interrupt;
use crate::math::eigenvalues;
use crate::math::linalg::Vec3;
use crate::math::real::Scalar;
use crate::memory::unknown;
use crate::model::error::InputError;
use crate::model::load::{Load, Model};
use crate::model::robot::Robot;
use crate::rod::routed::RoutedRod;

/// Equilibrium to linearise about, as found by a solver.
pub struct Equilibrium<'a> {
    pub robot: &'a Robot,
    pub model: Model,
    pub elements: usize,
    /// Strain of every arc, from base to tip.
    pub strain: Vec<Vec3>,
    /// Contact force at the end of every module (N).
    pub force: Vec<Vec3>,
}

/// Displacement of all degrees of freedom by forces on all of them.
type ForceResponse = dyn FnMut(&[f64]) -> Vec<f64> + Send + Sync;

/// The robot, linearised about an equilibrium.
///
/// Degrees of freedom, module by module: translation of every mass point from base to tip in the
/// base frame, the disk last; then rotation of the disk, in its own frame. The point of a disk with a
/// payload is their common centre of mass, and it rotates about principal axes, so that each degree
/// of freedom has a mass of its own.
pub struct Flexibility {
    response: Box<ForceResponse>,
    /// Mass or inertia of every degree of freedom (kg or kg m^2).
    pub masses: Vec<f64>,
    /// Mass points of a module, the disk included.
    pub points: usize,
    /// Disks with payloads, and their motion by their degrees of freedom: displacement in the base
    /// frame (m) and rotation in the frame of the disk (rad).
    pub loaded_disks: Vec<(usize, [[f64; 6]; 6])>,
    /// Work of a column, in units of `interrupt::work`.
    work: usize,
}

impl Flexibility {
    /// Displacement of all degrees of freedom by forces on all of them (m and rad for N and N m):
    /// the product of the flexibility matrix and the forces, in linear time.
    ///
    /// # Panics
    /// If the number of forces differs from that of masses.
    pub fn apply(&mut self, forces: &[f64]) -> Vec<f64> {
        assert_eq!(forces.len(), self.masses.len());
        interrupt::work(self.work);
        (self.response)(forces)
    }

    /// Flexibility matrix, row by row: displacement (row) by unit force (column), in m/N, rad/N,
    /// m/(N m), rad/(N m).
    ///
    /// # Errors
    /// If it does not fit into memory.
    /// If it does not fit into memory.
    pub fn matrix(&mut self) -> Result<Vec<f64>, InputError> {
        let size = self.masses.len();
        let refused = || {
            InputError::other(format!(
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

/// Linearises at an equilibrium. Span tensions other than those of the load are given by modules
/// and tendons (N). `None` where the robot with lumped mass has no equilibrium.
pub fn linearised(
    at: &Equilibrium,
    load: &Load,
    span_tensions: Option<&[f64]>,
    locks: &[Lock],
) -> Option<Flexibility> {
    match at.elements {
        1 => with_arcs::<2>(at, load, span_tensions, locks),
        2 => with_arcs::<4>(at, load, span_tensions, locks),
        4 => with_arcs::<8>(at, load, span_tensions, locks),
        _ => with_arcs::<16>(at, load, span_tensions, locks),
    }
}

fn with_arcs<const A: usize>(
    at: &Equilibrium,
    load: &Load,
    span_tensions: Option<&[f64]>,
    locks: &[Lock],
) -> Option<Flexibility> {
    let undamped = Damping {
        mass: 0.0,
        material: 0.0,
    };
    let mut motion = Motion::<_, A>::new(Scalar, at.robot, at.model, load.gravity, undamped);
    motion.take_strain(&at.strain, &at.force);
    motion.set_load(load);
    if let Some(tensions) = span_tensions {
        motion.set_span_tensions(tensions);
    }
    if !motion.settle() {
        return None;
    }
    let rest = motion.linearise_at_rest(locks)?;
    let of_locks = locks.len() * (2 * A * at.robot.module_count() + locks.len()) / 4;
    Some(Flexibility {
        masses: motion.masses_of_freedoms(),
        points: A,
        loaded_disks: motion.motion_of_loaded_disks(),
        work: motion.work() + of_locks,
        response: Box::new(move |forces| motion.respond_to_forces(forces, &rest)),
    })
}

/// Ratio to the lowest frequency above which growth is not examined.
const SLOW: f64 = 30.0;

/// Most oscillations computed, the lowest frequencies first.
const MOST_OSCILLATIONS: usize = 40;

/// Most motions computed where divergence is possible: fast ones can diverge too.
const MOST_MOTIONS: usize = 80;

/// Smallest eigenvalue of the flexibility above rounding, over the largest.
const LEAST_ANSWER: f64 = 1e-9;

/// Growth rate of slow small oscillations about an equilibrium without damping, over their angular
/// frequency: 1 for divergence without oscillation, 0 at a minimum of a potential. A damping ratio
/// as large as the result prevents growth. `oscillates`: the symmetric part of the tangent is
/// positive definite, so that divergence is excluded. `None` without mass, and where the robot with
/// lumped mass has no equilibrium.
pub fn growth(at: &Equilibrium, load: &Load, oscillates: bool) -> Option<f64> {
    let mut flexibility = linearised(at, load, None, &[])?;
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

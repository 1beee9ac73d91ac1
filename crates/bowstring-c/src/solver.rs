//! The solver: forward solves, inverses along a path, and queries about the last solution.

use crate::robot::BowstringRobot;
use crate::status::{fail, guarded, BowstringStatus};
use bowstring_core::model::load::{Load, Model, RodModel, Theory};
use bowstring_core::statics::adaptive::Adaptive;
use bowstring_core::statics::inverse::{InverseSolver, InverseStatus, Limits, Target};
use bowstring_core::statics::solver::{Outcome, Status};
use std::ptr::null_mut;
use BowstringStatus::BadInput;

/// Distance between the tip of an inverse and that of the forward solve under its tensions, over the
/// length, from which they are different equilibria. Discretisation errors are below 1e-5.
const OTHER: f64 = 1e-4;

/// Settings of a solver; start from `bowstring_options_default`.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct BowstringOptions {
    /// Backbone with shear and extension (0, Cosserat) or without (1, Kirchhoff).
    pub theory: i32,
    /// Fourth-order elements between two disks: 1, 2, 4 or 8; 0 chooses the fewest whose estimated
    /// error of the tip is within 1e-5 of the length.
    pub elements: i32,
    /// Inverse, target out of reach: how much farther from it than the nearest tip the tip may be
    /// for smaller tensions, over the length. 0: the nearest tip.
    pub distance_margin: f64,
}

/// Dead loads in the base frame.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct BowstringLoad {
    /// Gravity in m/s^2.
    pub gravity_m_per_s2: [f64; 3],
    /// Force on the tip in N.
    pub tip_force_N: [f64; 3],
    /// Moment on the tip in N m.
    pub tip_moment_Nm: [f64; 3],
}

/// An equilibrium. Without one its numbers are NaN, but for `residual` and `iterations`.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct BowstringSolution {
    /// Position of the tip in the base frame, m.
    pub position_m: [f64; 3],
    /// Rotation of the tip, row by row; it maps tip axes to base axes.
    pub rotation: [f64; 9],
    /// Largest moment imbalance over (bending stiffness / length); a solution is below 1e-10.
    pub residual: f64,
    /// Estimated discretisation error of the tip in m.
    pub error_estimate_m: f64,
    /// Newton steps.
    pub iterations: i32,
    /// Elements between two disks.
    pub elements: i32,
    /// 1: stable; 0: unstable, which a moment on the tip can lead to; -1: unknown.
    pub stable: i32,
}

/// Result of an inverse.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct BowstringInverse {
    /// Equilibrium under the tensions, by a forward solve.
    pub solution: BowstringSolution,
    /// Distance from the tip of `solution` to the target in m.
    pub distance_m: f64,
    /// Distance from the nearest tip that was found to the target in m: smaller where the margin
    /// was used.
    pub nearest_distance_m: f64,
    /// Angle between the tangent at the tip and the direction in rad; NaN without a direction.
    pub direction_error_rad: f64,
    /// Iterations of all starts.
    pub iterations: i32,
    /// 1 where the target was not found from the last one but from another start, so that the robot
    /// may jump to another shape. Otherwise 0.
    pub restarted: i32,
}

/// A robot with its physics, limits of tension, last solution and scratch memory.
pub struct BowstringSolver {
    forward: Adaptive,
    /// Solver of the inverse, or the sentence with the reason where it has none.
    inverse: Result<InverseSolver, String>,
    gravity: [f64; 3],
    length: f64,
    /// Limits of the inverse (N).
    least: Vec<f64>,
    most: Vec<f64>,
    /// Unstretched length of each tendon in the home pose (m), if there is one.
    home: Option<Vec<f64>>,
    /// Compliance of each tendon (m/N).
    compliance: Vec<f64>,
    /// Tensions of the last call (N), and zeros.
    tensions: Vec<f64>,
    zeros: Vec<f64>,
    /// Whether the forward solver holds a solution, and whether the next inverse continues a path.
    solved: bool,
    warm: bool,
    /// Whether a panic has left it in an unknown state.
    broken: bool,
}

/// Options that a solver has by default: Cosserat, chosen elements, margin 1e-3.
#[no_mangle]
pub extern "C" fn bowstring_options_default() -> BowstringOptions {
    BowstringOptions {
        theory: 0,
        elements: 0,
        distance_margin: 1e-3,
    }
}

/// Makes a solver; `options` may be `NULL` for the default.
///
/// Returns `NULL` where an option is wrong. The limits of tension are 0 N and, as in the Python
/// package, what bends the segment of the tendon by half a turn by the linear law; see
/// `bowstring_set_limits`. Free the solver with `bowstring_solver_free`. It keeps what it needs of
/// the robot, which may be freed before it.
///
/// # Safety
/// `robot` must be `NULL` or a robot of this library, `options` `NULL` or readable.
#[no_mangle]
pub unsafe extern "C" fn bowstring_solver_new(
    robot: *const BowstringRobot,
    options: *const BowstringOptions,
) -> *mut BowstringSolver {
    let mut solver = null_mut();
    guarded(|| {
        // SAFETY: the caller gives a robot
        let Some(robot) = (unsafe { robot.as_ref() }) else {
            return fail(BadInput, "robot is NULL");
        };
        // SAFETY: the caller gives readable options
        let options = unsafe { options.as_ref() }.copied();
        match BowstringSolver::new(robot, options.unwrap_or(bowstring_options_default())) {
            Ok(made) => {
                solver = Box::into_raw(Box::new(made));
                BowstringStatus::Ok
            }
            Err(sentence) => fail(BadInput, sentence),
        }
    });
    solver
}

/// Frees a solver; `NULL` is allowed.
///
/// # Safety
/// `solver` must be `NULL`, or come from this library and not have been freed.
#[no_mangle]
pub unsafe extern "C" fn bowstring_solver_free(solver: *mut BowstringSolver) {
    if !solver.is_null() {
        guarded(|| {
            // SAFETY: it is from `Box::into_raw`, and the caller frees it once
            drop(unsafe { Box::from_raw(solver) });
            BowstringStatus::Ok
        });
    }
}

/// Sets the limits of tension of the inverse in N, `tendon_count` numbers each. `NULL` keeps the
/// present ones.
///
/// # Safety
/// The arrays must be `NULL` or have `tendon_count` numbers.
#[no_mangle]
pub unsafe extern "C" fn bowstring_set_limits(
    solver: *mut BowstringSolver,
    min_tensions: *const f64,
    max_tensions: *const f64,
    tendon_count: usize,
) -> BowstringStatus {
    // SAFETY: the caller gives a solver, and arrays of `tendon_count` numbers
    let (least, most) = unsafe {
        (
            array(min_tensions, tendon_count),
            array(max_tensions, tendon_count),
        )
    };
    with(solver, |solver| {
        solver.check_count(tendon_count)?;
        let least = least.unwrap_or(&solver.least).to_vec();
        let most = most.unwrap_or(&solver.most).to_vec();
        let limits = Limits {
            least: &least,
            most: &most,
        };
        limits.check(solver.forward.solver().robot()).map_err(bad)?;
        (solver.least, solver.most) = (least, most);
        Ok(BowstringStatus::Ok)
    })
}

/// Forgets the last solution: the next solve starts from the straight robot, the next inverse from
/// starts of its own.
///
/// # Safety
/// `solver` must be `NULL` or a solver of this library that no other thread uses.
#[no_mangle]
pub unsafe extern "C" fn bowstring_reset(solver: *mut BowstringSolver) -> BowstringStatus {
    with(solver, |solver| {
        (solver.solved, solver.warm) = (false, false);
        Ok(BowstringStatus::Ok)
    })
}

/// Solves the equilibrium under tensions and dead loads, from the last solution if there is one.
///
/// `tensions` has `tendon_count` numbers in N, none negative. `load` may be `NULL`: the gravity of
/// the robot file and no wrench. `solution` may be `NULL`.
///
/// A solve from the last solution takes few Newton steps and no memory from the heap, unless more
/// elements become necessary than before: fix `elements`, or call it once with the largest load
/// before the loop.
///
/// # Safety
/// Pointers must be `NULL` or point to what is said here.
#[no_mangle]
pub unsafe extern "C" fn bowstring_solve(
    solver: *mut BowstringSolver,
    tensions: *const f64,
    tendon_count: usize,
    load: *const BowstringLoad,
    solution: *mut BowstringSolution,
) -> BowstringStatus {
    // SAFETY: the caller gives an array of `tendon_count` numbers, a load, and room for a solution
    let (tensions, load, solution) = unsafe {
        (
            array(tensions, tendon_count),
            load.as_ref(),
            solution.as_mut(),
        )
    };
    let mut found = BowstringSolution::none();
    let status = with(solver, |solver| {
        solver.check_count(tendon_count)?;
        let tensions = tensions.ok_or_else(|| bad("tensions is NULL"))?;
        let all = dead(load, solver.gravity, tensions);
        all.check(solver.forward.solver().robot()).map_err(bad)?;
        solver.tensions.copy_from_slice(tensions);
        solver.solve(load, &mut found)
    });
    if let Some(solution) = solution {
        *solution = found;
    }
    status
}

/// Finds tensions within the limits that bring the tip to a position, from the last target if there
/// is one: for targets along a path.
///
/// `position` has three numbers in m, base frame. `direction` has three numbers, the wanted tangent
/// at the tip (its length does not matter), or is `NULL`. `load` may be `NULL` as for
/// `bowstring_solve`. `tensions`, of `tendon_count` numbers, takes the result in N; where several
/// lead to the target, the least sum of squares near the last ones. With the statuses
/// `UNREACHABLE` and `MAX_ITERATIONS` they lead to a nearest tip; without an equilibrium, and after
/// a wrong call, they are NaN. `result` may be `NULL`.
///
/// Where a robot has more tendons than the target needs, the least tensions can change from one set
/// to another between neighbouring targets, also without `restarted`: limit the rate of the commands
/// where a motor must not jump. The inverse takes memory from the heap in each call, and a target
/// that is not found from the last one takes many times as long.
///
/// # Safety
/// Pointers must be `NULL` or point to what is said here.
#[no_mangle]
pub unsafe extern "C" fn bowstring_inverse(
    solver: *mut BowstringSolver,
    position: *const f64,
    direction: *const f64,
    load: *const BowstringLoad,
    tensions: *mut f64,
    tendon_count: usize,
    result: *mut BowstringInverse,
) -> BowstringStatus {
    // SAFETY: the caller gives vectors, a load, and room for the tensions and a result
    let (position, direction, load, tensions, result) = unsafe {
        (
            array(position, 3),
            array(direction, 3),
            load.as_ref(),
            array_mut(tensions, tendon_count),
            result.as_mut(),
        )
    };
    let mut found = BowstringInverse::none();
    let mut known = false;
    let status = with(solver, |solver| {
        solver.check_count(tendon_count)?;
        let position = position.ok_or_else(|| bad("position is NULL"))?;
        if tensions.is_none() {
            return Err(bad("tensions is NULL"));
        }
        let target = target(position, direction)?;
        let status = solver.inverse(&target, load, &mut found)?;
        known = true;
        Ok(status)
    });
    if let Some(tensions) = tensions {
        // SAFETY: `with` has found a solver where the inverse has a result
        match unsafe { solver.as_ref() } {
            Some(solver) if known => tensions.copy_from_slice(&solver.tensions),
            _ => tensions.fill(f64::NAN),
        }
    }
    if let Some(result) = result {
        *result = found;
    }
    status
}

/// Lengths of the tendons in the last solution, from the base hole to the hole of the end disk, in
/// m: `tendon_count` numbers. NaN, and `BOWSTRING_STATUS_BAD_INPUT`, without one.
///
/// # Safety
/// `lengths` must be `NULL` or have room for `tendon_count` numbers.
#[no_mangle]
pub unsafe extern "C" fn bowstring_tendon_lengths(
    solver: *mut BowstringSolver,
    lengths: *mut f64,
    tendon_count: usize,
) -> BowstringStatus {
    // SAFETY: the caller gives room for `tendon_count` numbers
    let out = unsafe { array_mut(lengths, tendon_count) };
    query(solver, "lengths", out, tendon_count, |solver, out| {
        for (i, length) in out.iter_mut().enumerate() {
            *length = solver.length_of(i);
        }
        Ok(BowstringStatus::Ok)
    })
}

/// Tendon displacements of the last solution in m, counted from the home pose and positive where
/// the tendon is shortened: `tendon_count` numbers. They include the compliance of the tendons.
///
/// The home pose is that under the pretensions of the robot file without gravity. Without one the
/// status is `BOWSTRING_STATUS_NO_EQUILIBRIUM`.
///
/// # Safety
/// `displacements` must be `NULL` or have room for `tendon_count` numbers.
#[no_mangle]
pub unsafe extern "C" fn bowstring_displacements(
    solver: *mut BowstringSolver,
    displacements: *mut f64,
    tendon_count: usize,
) -> BowstringStatus {
    // SAFETY: the caller gives room for `tendon_count` numbers
    let out = unsafe { array_mut(displacements, tendon_count) };
    query(solver, "displacements", out, tendon_count, |solver, out| {
        let Some(home) = &solver.home else {
            return Ok(fail(
                BowstringStatus::NoEquilibrium,
                "the pretensions of the robot have no stable equilibrium, hence no home pose",
            ));
        };
        for (i, out) in out.iter_mut().enumerate() {
            *out = home[i] - solver.length_of(i) + solver.compliance[i] * solver.tensions[i];
        }
        Ok(BowstringStatus::Ok)
    })
}

/// Derivatives of the tip by each tension in the last solution: 6 `tendon_count` numbers, row by
/// row. Rows 0 to 2: position along x, y, z in m/N; rows 3 to 5: rotation vector in the base frame
/// in rad/N. Takes memory from the heap.
///
/// # Safety
/// `derivatives` must be `NULL` or have room for 6 `tendon_count` numbers.
#[no_mangle]
pub unsafe extern "C" fn bowstring_tip_derivatives(
    solver: *mut BowstringSolver,
    derivatives: *mut f64,
    tendon_count: usize,
) -> BowstringStatus {
    // SAFETY: the caller gives room for six rows of `tendon_count` numbers
    let out = unsafe { array_mut(derivatives, tendon_count.saturating_mul(6)) };
    query(solver, "derivatives", out, tendon_count, |solver, out| {
        let Some(found) = solver.forward.solver().jacobians(false) else {
            return Ok(fail(
                BowstringStatus::NoDerivatives,
                "the equilibrium has no finite derivatives, or the tendons touch the body everywhere",
            ));
        };
        for (i, by) in found.tensions.iter().enumerate() {
            for q in 0..3 {
                out[q * tendon_count + i] = by.position[q];
                out[(3 + q) * tendon_count + i] = by.rotation[q];
            }
        }
        Ok(BowstringStatus::Ok)
    })
}

/// A wrong call, with its sentence.
struct Bad(String);

fn bad(sentence: impl ToString) -> Bad {
    Bad(sentence.to_string())
}

/// The numbers of the caller; `None` for `NULL`.
///
/// # Safety
/// `at` must be `NULL` or point to `count` numbers that nobody writes during the call.
unsafe fn array<'a>(at: *const f64, count: usize) -> Option<&'a [f64]> {
    // SAFETY: see above; a count that no memory can have is refused
    (!at.is_null() && count < MOST).then(|| unsafe { std::slice::from_raw_parts(at, count) })
}

/// Room of the caller; `None` for `NULL`.
///
/// # Safety
/// `at` must be `NULL` or point to `count` numbers that nobody else uses during the call.
unsafe fn array_mut<'a>(at: *mut f64, count: usize) -> Option<&'a mut [f64]> {
    // SAFETY: see above; a count that no memory can have is refused
    (!at.is_null() && count < MOST).then(|| unsafe { std::slice::from_raw_parts_mut(at, count) })
}

/// Numbers that no array has.
const MOST: usize = isize::MAX as usize / 8;

/// Runs the work of a call on a solver.
fn with(
    solver: *mut BowstringSolver,
    work: impl FnOnce(&mut BowstringSolver) -> Result<BowstringStatus, Bad>,
) -> BowstringStatus {
    guarded(|| {
        // SAFETY: the caller gives a solver that no other thread uses
        let Some(solver) = (unsafe { solver.as_mut() }) else {
            return fail(BadInput, "solver is NULL");
        };
        if solver.broken {
            let sentence = "an error in the library has ended an earlier call; make another solver";
            return fail(BowstringStatus::Internal, sentence);
        }
        solver.broken = true;
        let status = work(solver);
        solver.broken = false;
        status.unwrap_or_else(|Bad(sentence)| fail(BadInput, sentence))
    })
}

/// Answers a query about the last solution; fills `out` with NaN where there is no answer.
fn query(
    solver: *mut BowstringSolver,
    name: &str,
    mut out: Option<&mut [f64]>,
    tendon_count: usize,
    answer: impl FnOnce(&BowstringSolver, &mut [f64]) -> Result<BowstringStatus, Bad>,
) -> BowstringStatus {
    let status = with(solver, |solver| {
        solver.check_count(tendon_count)?;
        let Some(out) = out.as_deref_mut() else {
            return Err(bad(format!("{name} is NULL")));
        };
        if !solver.solved {
            return Err(bad(
                "there is no solution: the last solve has not succeeded",
            ));
        }
        answer(solver, out)
    });
    match out {
        Some(out) if status != BowstringStatus::Ok => out.fill(f64::NAN),
        _ => {}
    }
    status
}

fn target(position: &[f64], direction: Option<&[f64]>) -> Result<Target, Bad> {
    let three = |v: &[f64]| [v[0], v[1], v[2]];
    let direction = match direction.map(three) {
        None => None,
        Some(v) => {
            let size = v[0].hypot(v[1]).hypot(v[2]);
            if !(size > 0.0 && size.is_finite()) {
                return Err(bad(format!(
                    "direction is {v:?}; it must be finite and not zero"
                )));
            }
            Some(v.map(|x| x / size))
        }
    };
    let target = Target {
        position: three(position),
        direction,
    };
    target.check().map_err(bad)?;
    Ok(target)
}

impl BowstringSolution {
    fn none() -> Self {
        BowstringSolution {
            position_m: [f64::NAN; 3],
            rotation: [f64::NAN; 9],
            residual: f64::NAN,
            error_estimate_m: f64::NAN,
            iterations: 0,
            elements: 0,
            stable: -1,
        }
    }
}

impl BowstringInverse {
    fn none() -> Self {
        BowstringInverse {
            solution: BowstringSolution::none(),
            distance_m: f64::NAN,
            nearest_distance_m: f64::NAN,
            direction_error_rad: f64::NAN,
            iterations: 0,
            restarted: 0,
        }
    }
}

fn small(number: usize) -> i32 {
    i32::try_from(number).unwrap_or(i32::MAX)
}

impl BowstringSolver {
    fn new(robot: &BowstringRobot, options: BowstringOptions) -> Result<Self, String> {
        let compiled = &robot.0;
        let theory = match options.theory {
            0 => Theory::Cosserat,
            1 => Theory::Kirchhoff,
            other => {
                return Err(format!(
                    "theory is {other}, it must be 0 (Cosserat) or 1 (Kirchhoff)"
                ))
            }
        };
        let elements = match options.elements {
            0 => None,
            n @ (1 | 2 | 4 | 8) => Some(n as usize),
            other => {
                return Err(format!(
                    "elements is {other}, it must be 1, 2, 4, 8, or 0 to choose"
                ))
            }
        };
        let margin = options.distance_margin;
        if !(0.0..1.0).contains(&margin) {
            return Err(format!(
                "distance_margin is {margin}, it must be 0 or more and below 1"
            ));
        }
        let model = Model {
            theory,
            tendon: compiled.path,
            ..Model::default()
        };
        let (robot, said) = (&compiled.robot, |error: &dyn ToString| error.to_string());
        let mut forward = Adaptive::new(robot, model, elements).map_err(|e| said(&e))?;
        let home =
            home(&mut forward, &compiled.pretension, &compiled.compliance).map_err(|e| said(&e))?;
        let count = robot.tendon_count();
        Ok(BowstringSolver {
            inverse: InverseSolver::new(robot, RodModel { model, elements }, margin)
                .map_err(|e| said(&e)),
            // the home pose is no solution to start from
            forward: Adaptive::new(robot, model, elements).map_err(|e| said(&e))?,
            gravity: robot.spec().gravity,
            length: robot.length(),
            least: vec![0.0; count],
            most: compiled.max_tension.clone(),
            home,
            compliance: compiled.compliance.clone(),
            tensions: vec![f64::NAN; count],
            zeros: vec![0.0; count],
            solved: false,
            warm: false,
            broken: false,
        })
    }

    fn check_count(&self, count: usize) -> Result<(), Bad> {
        let own = self.tensions.len();
        match count == own {
            true => Ok(()),
            false => Err(bad(format!(
                "tendon_count is {count}, and the robot has {own} tendons"
            ))),
        }
    }

    /// Length of a tendon in the last solution (m).
    fn length_of(&self, i: usize) -> f64 {
        let length = self.forward.solver().tendon_length(i);
        length.unwrap_or(f64::NAN)
    }

    /// Solves the equilibrium of `self.tensions`; they and the load have been checked.
    fn solve(
        &mut self,
        load: Option<&BowstringLoad>,
        found: &mut BowstringSolution,
    ) -> Result<BowstringStatus, Bad> {
        let follows = self.solved;
        self.solved = false;
        let load = dead(load, self.gravity, &self.tensions);
        let outcome = match follows {
            true => self.forward.solve_next(&load),
            false => self.forward.solve(&load),
        };
        let outcome = outcome.map_err(bad)?;
        let solver = self.forward.solver();
        found.residual = outcome.residual;
        found.iterations = small(outcome.iterations);
        found.elements = small(solver.elements());
        found.stable = outcome.stable.map_or(-1, i32::from);
        found.error_estimate_m = outcome.error.map_or(f64::NAN, |error| error.tip);
        let Some(tip) = solver.tip() else {
            return Ok(refused(&outcome));
        };
        found.position_m = tip.position.0;
        found
            .rotation
            .copy_from_slice(tip.rotation.0.as_flattened());
        self.solved = true;
        Ok(BowstringStatus::Ok)
    }

    fn inverse(
        &mut self,
        target: &Target,
        load: Option<&BowstringLoad>,
        found: &mut BowstringInverse,
    ) -> Result<BowstringStatus, Bad> {
        let inverse = match &mut self.inverse {
            Ok(inverse) => inverse,
            Err(sentence) => return Err(bad(sentence)),
        };
        let dead = dead(load, self.gravity, &self.zeros);
        dead.check(self.forward.solver().robot()).map_err(bad)?;
        let limits = Limits {
            least: &self.least,
            most: &self.most,
        };
        let outcome = inverse.solve(&dead, target, &limits, self.warm);
        self.warm = true;
        self.tensions.copy_from_slice(inverse.tensions());
        found.iterations = small(outcome.iterations);
        found.restarted = i32::from(outcome.restarted);
        found.nearest_distance_m = outcome.nearest;
        found.direction_error_rad = outcome.direction_error;
        let status = match outcome.status {
            InverseStatus::Reached => BowstringStatus::Ok,
            InverseStatus::Unreachable => fail(
                BowstringStatus::Unreachable,
                "limits of tension or the robot do not allow the target",
            ),
            InverseStatus::MaxIterations => fail(
                BowstringStatus::MaxIterations,
                "the inverse did not converge; a nearer tip may exist",
            ),
            InverseStatus::NoEquilibrium => {
                self.solved = false;
                return Ok(fail(
                    BowstringStatus::NoEquilibrium,
                    "the robot has no stable equilibrium under the loads from which to start",
                ));
            }
        };
        let by_forward = self.solve(load, &mut found.solution)?;
        if by_forward != BowstringStatus::Ok {
            return Ok(by_forward);
        }
        let away = |q: usize| found.solution.position_m[q] - target.position[q];
        found.distance_m = away(0).hypot(away(1)).hypot(away(2));
        if (found.distance_m - outcome.distance).abs() > OTHER * self.length {
            return Ok(fail(
                BowstringStatus::OtherEquilibrium,
                "the tensions have several equilibria, and the one that follows from the last \
                 solution is not at the target; call bowstring_reset",
            ));
        }
        Ok(status)
    }
}

/// Load of a call.
fn dead<'a>(load: Option<&BowstringLoad>, gravity: [f64; 3], tensions: &'a [f64]) -> Load<'a> {
    let given = load.copied().unwrap_or(BowstringLoad {
        gravity_m_per_s2: gravity,
        tip_force_N: [0.0; 3],
        tip_moment_Nm: [0.0; 3],
    });
    Load {
        tensions,
        gravity: given.gravity_m_per_s2,
        tip_force: given.tip_force_N,
        tip_moment: given.tip_moment_Nm,
        ..Load::default()
    }
}

/// Status of a forward solve without a solution.
fn refused(outcome: &Outcome) -> BowstringStatus {
    let (status, sentence) = match outcome.status {
        Status::Unstable => (
            BowstringStatus::Unstable,
            "an equilibrium was found, but no stable one",
        ),
        Status::NoEquilibrium => (
            BowstringStatus::NoEquilibrium,
            "an equilibrium was found only with two disks that collide",
        ),
        Status::MaxIterations | Status::Converged => (
            BowstringStatus::MaxIterations,
            "the solve did not converge; the load may be beyond what the robot holds",
        ),
    };
    fail(status, sentence)
}

/// Unstretched lengths in the home pose (m), if it exists.
fn home(
    forward: &mut Adaptive,
    pretension: &[f64],
    compliance: &[f64],
) -> Result<Option<Vec<f64>>, bowstring_core::model::error::InputError> {
    let load = Load {
        tensions: pretension,
        ..Load::default()
    };
    let outcome = forward.solve(&load)?;
    let lengths = |i: usize| forward.solver().tendon_length(i);
    Ok((outcome.status == Status::Converged).then(|| {
        let each = pretension.iter().zip(compliance).enumerate();
        each.map(|(i, (t, c))| lengths(i).unwrap_or(f64::NAN) - c * t)
            .collect()
    }))
}

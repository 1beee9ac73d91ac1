//! Inverse kinematics: tensions within limits for a position, and a direction, of the tip.
//!
//! Theory: docs/theory/inverse-kinematics.md.
//!
//! Each iteration solves the equilibrium of the present tensions from the previous strain,
//! linearises the tip with respect to the tensions, and solves the linear problem within the limits
//! and a trust region. Of the tensions that bring the tip equally near, it takes the least.

mod arcs;
mod curvature;
mod descent;
mod equilibrium;
mod outcome;
mod path;
mod relax;
mod rows;
mod saddle;
mod search;
mod start;
mod step;
mod task;
mod trust_region;

pub use outcome::{InverseOutcome, InverseStatus};
pub use rows::{inverses, Inverses, Order};
pub use task::{Limits, Target};

use crate::math::linalg::Vec3;
use crate::model::error::InputError;
use crate::model::load::{Load, OwnedLoad, RodModel, LEVELS};
use crate::model::robot::Robot;
use crate::outcome::Outcome;
use arcs::Arcs;
use curvature::Curvature;
use descent::{Effort, End};
use equilibrium::{Level, Point};
use path::Past;
use step::Linear;
use task::{norm, Task};

/// Distance of a reached tip, over the robot's length.
pub const REACHED: f64 = 1e-6;

/// Gradient of the distance below which a limit does not bind, over that of the tip's motion.
const LEAST_GRADIENT: f64 = 1e-6;

/// Inverse kinematics of a robot, with scratch memory for one target after another.
pub struct InverseSolver {
    robot: Robot,
    model: RodModel,
    levels: [Option<Box<Level>>; 4],
    /// Dead loads of the present row, with the tensions of the last trial (N).
    load: OwnedLoad,
    /// Length of the robot (m).
    length: f64,
    /// Unit of tension: by the linear law it bends the robot by one radian (N).
    unit: f64,
    /// Permitted distance beyond that of the nearest tip, over the length.
    margin: f64,
    /// Present point of the iteration; after it the solution, or that of the row before.
    point: Point,
    /// Whether there was a row before, and whether it has a solution.
    has_rows: bool,
    known: bool,
    /// Point with the nearest tip, if the solution is another one.
    nearest: Option<Point>,
    /// The last unreached row that was searched from several starts, and its least distance over the
    /// length.
    searched: Option<(Task, f64)>,
    /// Tensions of the last point of a path whose second-order condition was checked.
    checked: Vec<f64>,
    /// Solutions of the rows before on a path, latest last.
    past: Vec<Past>,
    /// Rows since the elements were refined; the largest number after they were made coarser. And
    /// rows after which they may be made coarser.
    rows_refined: usize,
    rows_to_hold: usize,
    /// Whether the columns are derivatives at or near the point.
    linearised: bool,
    /// Sum of the changes of tension since the derivatives, over the unit of tension.
    drift: f64,
    /// Derivatives of position and rotation of the tip by each tension (m/N, rad/N), whether those
    /// of the rotation are known, and the level of elements whose rod has eliminated them.
    columns: Vec<[Vec3; 2]>,
    has_rotations: bool,
    plain_level: usize,
    linear: Linear,
    arcs: Option<Arcs>,
    curvature: Curvature,
    /// Tensions of the present trial, and the step to them.
    trial: Vec<f64>,
    step: Vec<f64>,
    /// The step (N), and the strain that it leads to.
    changes: Vec<f64>,
    strain: Vec<Vec3>,
    /// Tensions of the last row (N).
    tensions: Vec<f64>,
    /// Limits that keep the nearest tip of the last row from its target.
    binding: Vec<i8>,
}

impl InverseSolver {
    /// A solver for a robot and a model. Where a target cannot be reached, its tip may be farther
    /// from the target than the nearest one by `margin` of the robot's length, for smaller tensions.
    ///
    /// # Errors
    /// For continuous tendons, which have no derivatives, for robots without tendons, and for a
    /// margin that is negative or not finite.
    pub fn new(robot: &Robot, model: RodModel, margin: f64) -> Result<Self, InputError> {
        let tendons = robot.tendon_count();
        if !(margin >= 0.0 && margin.is_finite()) {
            return Err(InputError::other(format!(
                "the margin of the distance is {margin}; it must be finite and >= 0"
            )));
        }
        if model.model.tendon.is_continuous() {
            return Err(InputError::other(
                "inverse kinematics needs derivatives, which continuous and embedded tendons do not have",
            ));
        }
        if tendons == 0 {
            return Err(InputError::other(
                "inverse kinematics needs tendons, and the robot has none",
            ));
        }
        let arms = robot.spec().tendons.iter().map(|t| {
            let [x, y] = t.hole(0);
            x.hypot(y)
        });
        let arm = arms.fold(0.0, f64::max).max(1e-3 * robot.length());
        let mut made = InverseSolver {
            robot: robot.clone(),
            model,
            levels: [const { None }; 4],
            load: OwnedLoad::default(),
            length: robot.length(),
            unit: robot.moment_scale() / arm,
            point: Point {
                tensions: vec![0.0; tendons],
                strain: vec![],
                residual: [0.0; 6],
                size: f64::INFINITY,
                level: 0,
                outcome: Outcome::pending(),
            },
            margin,
            has_rows: false,
            known: false,
            nearest: None,
            searched: None,
            checked: vec![],
            past: vec![],
            rows_refined: 0,
            rows_to_hold: 0,
            linearised: false,
            drift: 0.0,
            columns: vec![[Vec3::zero(); 2]; tendons],
            has_rotations: false,
            plain_level: 0,
            linear: Linear::default(),
            arcs: None,
            curvature: Curvature::default(),
            trial: vec![0.0; tendons],
            step: vec![0.0; tendons],
            changes: vec![0.0; tendons],
            strain: vec![],
            tensions: vec![f64::NAN; tendons],
            binding: vec![0; tendons],
        };
        made.arcs = Some(Arcs::new(robot, made.unit));
        made.at(LEVELS[made.first_level(&Load::default())])?;
        Ok(made)
    }

    /// Tensions for a target. `warm` starts from the last solution, for targets in a fine sequence.
    ///
    /// Load, target and limits must have been checked.
    pub fn solve(
        &mut self,
        load: &Load,
        target: &Target,
        limits: &Limits,
        warm: bool,
    ) -> InverseOutcome {
        let task = self.task(target, limits);
        let mut outcome = InverseOutcome::pending();
        let iterations = &mut outcome.iterations;
        let follows = warm && self.has_rows;
        self.has_rows = true;
        let relaxed = self.return_to_nearest();
        let mut end = None;
        if follows && self.known && self.resume(load, &task) {
            let descended = self.descend(&task, Effort::WHOLE, iterations);
            end = self.polish(&task, descended, iterations);
        } else {
            self.load.set_dead(load);
            self.searched = None;
        }
        let mut new = end.is_none();
        let proven = self.point.size <= REACHED || self.remains_nearest(&task);
        if end.is_none() || !proven {
            let last = end.map(|end| (self.point.clone(), end));
            let Some((found, other)) = self.search(&task, last, iterations) else {
                self.known = false;
                self.past.clear();
                self.tensions.fill(f64::NAN);
                return outcome;
            };
            end = Some(found);
            new |= other;
        }
        if self.point.size <= REACHED && (new || !self.is_checked()) {
            new |= self.leave_saddles(&task, iterations);
        }
        self.known = true;
        self.remember(&task, new);
        self.mark_binding(&task);
        outcome.nearest = norm(&self.point.residual[..3]) * self.length;
        let status = match end {
            _ if self.point.size <= REACHED => InverseStatus::Reached,
            Some(End::Converged) => InverseStatus::Unreachable,
            _ => InverseStatus::MaxIterations,
        };
        if status != InverseStatus::Reached {
            self.relax(&task, relaxed, iterations);
        }
        self.describe(&task, limits, &mut outcome);
        outcome.status = status;
        outcome.restarted = follows && new;
        outcome
    }

    /// Goes back to the nearest tip of the last row, if its solution is another one, which is
    /// returned.
    fn return_to_nearest(&mut self) -> Option<Point> {
        let nearest = self.nearest.take()?;
        self.linearised = false;
        // the solver holds the equilibrium of the solution
        self.load.tensions.clear();
        Some(std::mem::replace(&mut self.point, nearest))
    }

    /// Tensions of the last row (N); NaN without an equilibrium.
    pub fn tensions(&self) -> &[f64] {
        &self.tensions
    }

    fn task(&self, target: &Target, limits: &Limits) -> Task {
        let over = |v: &[f64]| v.iter().map(|t| t / self.unit).collect();
        Task {
            target: *target,
            rows: if target.direction.is_some() { 6 } else { 3 },
            lower: over(limits.least),
            upper: over(limits.most),
            margin: self.margin,
        }
    }

    fn describe(&mut self, task: &Task, limits: &Limits, outcome: &mut InverseOutcome) {
        let r = &self.point.residual;
        outcome.distance = norm(&r[..3]) * self.length;
        if task.target.direction.is_some() {
            // the chord between two unit vectors
            outcome.direction_error = 2.0 * (0.5 * norm(&r[3..])).min(1.0).asin();
        }
        outcome.elements = LEVELS[self.point.level];
        outcome.equilibrium = self.point.outcome;
        for (i, tension) in self.tensions.iter_mut().enumerate() {
            let t = self.point.tensions[i];
            // the unit of tension rounds
            *tension = if t == task.lower[i] {
                limits.least[i]
            } else if t == task.upper[i] {
                limits.most[i]
            } else {
                (t * self.unit).max(limits.least[i]).min(limits.most[i])
            };
        }
    }

    /// Marks the limits that keep the nearest tip from the target.
    fn mark_binding(&mut self, task: &Task) {
        self.binding.fill(0);
        if self.point.size <= REACHED || !(self.linearised || self.linearise(task)) {
            return;
        }
        let r = &self.point.residual[..task.rows];
        for i in 0..self.binding.len() {
            let (t, column) = (self.point.tensions[i], self.column(i, &task.target));
            let column = &column[..task.rows];
            // increase of the distance with the tension
            let along: f64 = column.iter().zip(r).map(|(c, r)| c * r).sum();
            let least = LEAST_GRADIENT * norm(column) * norm(r);
            if t == task.lower[i] && along > least {
                self.binding[i] = -1;
            } else if t == task.upper[i] && along < -least {
                self.binding[i] = 1;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::trust_region::half_square;
    use super::*;
    use crate::model::robot::Tendon;
    use crate::parts;
    use crate::random::Draw;
    use crate::rod::estimate::TIP_TOLERANCE;
    use crate::statics::solver::{Solver, Status};

    /// Two segments with five tendons.
    fn robot() -> Robot {
        let sections = [parts::section(1.0); 2];
        let spec = parts::robot(&sections, &[5, 5], [0.06, 0.002], 1.3, &[4, 4, 9, 9, 9]);
        Robot::new(spec).unwrap()
    }

    const TENSIONS: [f64; 5] = [5.0, 12.0, 14.0, 3.0, 9.0];

    /// The derivatives of the tip alone are those of all derivatives, with and without a potential.
    #[test]
    fn derivatives_of_the_tip_are_those_of_all() {
        let robot = robot();
        for tip_moment in [[0.0; 3], [0.05, 0.02, 0.01]] {
            for elements in [1, 2] {
                let mut level = Level::new(&robot, Default::default(), elements).unwrap();
                let load = Load {
                    tensions: &TENSIONS,
                    gravity: [0.0, 2.0, -9.81],
                    tip_force: [0.3, -0.2, 0.1],
                    tip_moment,
                    ..Load::default()
                };
                let outcome = level.solver.solve(&load).unwrap();
                assert_eq!(outcome.status, Status::Converged);
                let all = level.solver.jacobians(false).unwrap().tensions;
                for rotation in [false, true] {
                    let mut columns = vec![[Vec3::zero(); 2]; 5];
                    assert!(level.tip_by_tensions(rotation, &mut columns));
                    for (column, exact) in columns.iter().zip(&all) {
                        assert!((column[0] - exact.position).max_abs() < 1e-12);
                        if rotation {
                            assert!((column[1] - exact.rotation).max_abs() < 1e-11);
                        }
                    }
                }
                // strain to first order against central differences
                let changes = [1e-3, -2e-3, 5e-4, 1e-3, -1e-3];
                let mut strain_at = |side: f64| {
                    let mut tensions = TENSIONS;
                    for (t, d) in tensions.iter_mut().zip(changes) {
                        *t += side * d;
                    }
                    let load = Load {
                        tensions: &tensions,
                        ..load
                    };
                    level.solver.solve(&load).unwrap();
                    level.solver.last_strain().unwrap()
                };
                let (less, more) = (strain_at(-1.0), strain_at(1.0));
                let mut change = vec![Vec3::zero(); more.len()];
                level.add_strain_by_tensions(&changes, &mut change);
                for ((less, more), change) in less.iter().zip(&more).zip(&change) {
                    assert!(((*more - *less) * 0.5 - *change).max_abs() < 1e-9);
                }
            }
        }
    }

    /// Tips of forward solves are reached; along a path with fewer iterations.
    #[test]
    fn tips_are_reached() {
        let robot = robot();
        let limits = Limits {
            least: &[0.0; 5],
            most: &[30.0; 5],
        };
        let mut forward = Solver::new(&robot, Default::default(), 2).unwrap();
        let model = RodModel {
            elements: Some(2),
            ..RodModel::default()
        };
        let mut inverse = InverseSolver::new(&robot, model, 0.0).unwrap();
        let none = Load {
            gravity: [0.0, 0.0, -9.81],
            ..Load::default()
        };
        let mut iterations = [0, 0];
        for step in 0..40 {
            let share = 0.5 + 0.01 * step as f64;
            let tensions = TENSIONS.map(|t| t * share);
            let load = Load {
                tensions: &tensions,
                ..none
            };
            forward.solve(&load).unwrap();
            let target = Target {
                position: forward.tip().unwrap().position.0,
                direction: None,
            };
            let warm = step % 4 > 0;
            let found = inverse.solve(&none, &target, &limits, warm);
            assert_eq!(found.status, InverseStatus::Reached, "{step}");
            assert!(found.distance < 1e-8 && found.elements == 2);
            iterations[usize::from(warm)] += found.iterations;
            let found = inverse.tensions();
            let size = |t: &[f64]| t.iter().map(|t| t * t).sum::<f64>();
            assert!(size(found) < size(&tensions) * (1.0 + 1e-6));
            assert!(found.iter().all(|t| (0.0..=30.0).contains(t)));
            if step % 4 == 3 {
                // the stated distance is that of the new load
                let mut load = Load {
                    gravity: [2.0, 0.0, -9.81],
                    ..none
                };
                let found = inverse.solve(&load, &target, &limits, true);
                load.tensions = inverse.tensions();
                forward.solve(&load).unwrap();
                let off = forward.tip().unwrap().position - Vec3(target.position);
                assert!((off.norm() - found.distance).abs() < 1e-8);
            }
        }
        assert!(iterations[1] < 2 * iterations[0], "{iterations:?}");
    }

    /// On a path of far targets each tip is as near as from a start of its own.
    #[test]
    fn far_targets_are_as_near_on_a_path_as_alone() {
        let robot = robot();
        let limits = Limits {
            least: &[0.0; 5],
            most: &[60.0; 5],
        };
        let solver = || InverseSolver::new(&robot, RodModel::default(), 0.0).unwrap();
        let (mut path, mut draw) = (solver(), Draw::new(5, 0));
        for row in 0..20 {
            let target = Target {
                position: [0; 3].map(|_| draw.within(-0.5, 0.5)),
                direction: None,
            };
            let [own, least] = [(&mut path, true), (&mut solver(), false)]
                .map(|(solver, warm)| solver.solve(&Load::default(), &target, &limits, warm));
            assert!(own.distance < least.distance + 1e-6, "{row}");
        }
    }

    /// In the mirror plane of a robot the symmetric tensions are a saddle: those of a target beside
    /// the plane are smaller, and the first row of a path has them too.
    #[test]
    fn a_target_in_a_mirror_plane_has_the_least_tensions() {
        let mut spec = robot().spec().clone();
        spec.gravity = [0.0, 0.0, 9.81];
        let hole = |i: usize| {
            let angle = i as f64 * std::f64::consts::FRAC_PI_3;
            [0.02 * angle.cos(), 0.02 * angle.sin()]
        };
        let ends = [(0, 4), (2, 4), (4, 4), (1, 9), (3, 9), (5, 9)];
        spec.tendons = ends.map(|(i, end)| Tendon::parallel(hole(i), end)).into();
        let robot = Robot::new(spec).unwrap();
        let limits = Limits {
            least: &[0.0; 6],
            most: &[200.0; 6],
        };
        let load = Load {
            gravity: robot.spec().gravity,
            ..Load::default()
        };
        let mut inverse = InverseSolver::new(&robot, RodModel::default(), 0.0).unwrap();
        let mut squares = |warm: bool, y: f64| {
            let target = Target {
                position: [0.12, y, 0.57],
                direction: None,
            };
            let found = inverse.solve(&load, &target, &limits, warm);
            assert_eq!(found.status, InverseStatus::Reached);
            assert!(!found.restarted);
            let error = found.equilibrium.error.unwrap().tip;
            assert!(error < TIP_TOLERANCE * robot.length());
            2.0 * half_square(inverse.tensions())
        };
        let beside = squares(false, 1e-3);
        let within = squares(false, 0.0);
        assert!((within / beside - 1.0).abs() < 0.1, "{within} {beside}");
        let near = squares(true, 1e-5);
        assert!((near / within - 1.0).abs() < 1e-3, "{near} {within}");
    }

    /// With a margin the tensions of an unreachable target are smaller, its tip is within the margin,
    /// and the distance of the nearest tip is the same.
    #[test]
    fn margin_reduces_tensions_of_unreachable_targets() {
        let robot = robot();
        let limits = Limits {
            least: &[0.0; 5],
            most: &[20.0; 5],
        };
        let target = Target {
            position: [0.2, 0.1, 0.55],
            direction: None,
        };
        let solved = |margin: f64| {
            let mut inverse = InverseSolver::new(&robot, RodModel::default(), margin).unwrap();
            let found = inverse.solve(&Load::default(), &target, &limits, false);
            let size = inverse.tensions().iter().map(|t| t * t).sum::<f64>();
            (found, size)
        };
        let [(nearest, most), (near, less)] = [0.0, 1e-3].map(solved);
        assert_eq!(nearest.status, InverseStatus::Unreachable);
        assert_eq!(near.status, InverseStatus::Unreachable);
        assert_eq!(nearest.nearest, nearest.distance);
        assert_eq!(near.nearest, nearest.distance);
        assert!(near.distance <= nearest.distance + 1e-3 * robot.length());
        assert!(less < most);
    }

    #[test]
    fn wrong_targets_and_margins_are_refused() {
        let robot = robot();
        for margin in [-1.0, f64::NAN, f64::INFINITY] {
            assert!(InverseSolver::new(&robot, RodModel::default(), margin).is_err());
        }
        let position = [0.1, 0.0, 0.5];
        for (position, direction) in [
            ([f64::NAN, 0.0, 0.5], None),
            (position, Some([0.0; 3])),
            (position, Some([0.0, 0.0, 2.0])),
            (position, Some([f64::NAN, 0.0, 1.0])),
        ] {
            let target = Target {
                position,
                direction,
            };
            assert!(target.check().is_err());
        }
    }

    #[test]
    fn wrong_limits_are_refused() {
        let robot = robot();
        for (least, most) in [
            ([1.0; 5], [0.5; 5]),
            ([-1.0; 5], [1.0; 5]),
            ([0.0; 5], [f64::NAN; 5]),
            ([0.0; 5], [f64::INFINITY; 5]),
        ] {
            let limits = Limits {
                least: &least,
                most: &most,
            };
            assert!(limits.check(&robot).is_err());
        }
        let limits = Limits {
            least: &[0.0; 4],
            most: &[1.0; 5],
        };
        assert!(limits.check(&robot).is_err());
    }
}

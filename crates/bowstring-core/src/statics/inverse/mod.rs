//! Inverse kinematics: tensions within limits for a position, and a direction, of the tip.
//!
//! Theory: docs/theory/inverse-kinematics.md.
//!
//! Each iteration solves the equilibrium of the present tensions from the previous strain,
//! linearises the tip with respect to the tensions, and solves the linear problem within the limits
//! and a trust region. Of the tensions that bring the tip equally near, it takes the least.

mod descent;
mod equilibrium;
mod outcome;
mod rows;
mod start;
mod step;
mod task;

pub use outcome::{InverseOutcome, InverseStatus};
pub use rows::{inverses, Inverses, Order};
pub use task::{Limits, Target};

use crate::interrupt;
use crate::math::linalg::Vec3;
use crate::model::error::InputError;
use crate::model::load::{Load, OwnedLoad, RodModel, TendonPath};
use crate::model::robot::Robot;
use crate::rod::estimate::LEVELS;
use crate::statics::outcome::Outcome;
use descent::{End, FIRST_WEIGHT, LEAST_WEIGHT};
use equilibrium::{Level, Point};
use step::Linear;
use task::{norm, Task};

/// Distance of a reached tip, over the robot's length.
pub const REACHED: f64 = 1e-6;

/// Starts that are tried until the tip is reached.
const STARTS: usize = 20;
/// Difference of distances over the length within which two starts lead to the same tip, and number
/// of such starts after the first from which it is the nearest.
const SAME: f64 = 1e-7;
const AGREEMENTS: usize = 3;
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
    point: Point,
    /// Whether the point is an equilibrium of the loads, and whether the columns are its
    /// derivatives.
    known: bool,
    linearised: bool,
    /// Sum of the changes of tension since the derivatives, over the unit of tension.
    drift: f64,
    /// Derivatives of position and rotation of the tip by each tension (m/N, rad/N).
    columns: Vec<[Vec3; 2]>,
    linear: Linear,
    /// Tensions of the present trial, and the last two steps.
    trial: Vec<f64>,
    step: Vec<f64>,
    last_step: Vec<f64>,
    /// The step (N), and the strain that it leads to.
    changes: Vec<f64>,
    strain: Vec<Vec3>,
    /// Limits that keep the tip of the last solution from its target.
    binding: Vec<i8>,
}

impl InverseSolver {
    /// A solver for a robot and a model.
    ///
    /// # Errors
    /// For continuous tendons, which have no derivatives, and for robots without tendons.
    pub fn new(robot: &Robot, model: RodModel) -> Result<Self, InputError> {
        let tendons = robot.tendon_count();
        if model.model.tendon == TendonPath::Continuous {
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
            known: false,
            linearised: false,
            drift: 0.0,
            columns: vec![[Vec3::zero(); 2]; tendons],
            linear: Linear::default(),
            trial: vec![0.0; tendons],
            step: vec![0.0; tendons],
            last_step: vec![0.0; tendons],
            changes: vec![0.0; tendons],
            strain: vec![],
            binding: vec![0; tendons],
        };
        made.at(LEVELS[made.first_level(&Load::default())])?;
        Ok(made)
    }

    /// Tensions for a target. `warm` starts from the last solution, for targets in a fine sequence.
    ///
    /// Loads, target and limits must have been checked.
    pub fn solve(
        &mut self,
        load: &Load,
        target: &Target,
        limits: &Limits,
        warm: bool,
    ) -> InverseOutcome {
        let task = self.task(target, limits);
        let mut outcome = InverseOutcome::pending();
        let mut best: Option<(Point, End)> = None;
        let (mut restarted, mut agreements, mut last_is_best) = (false, 0, true);
        if warm && self.known && self.resume(load, &task) {
            let end = self.descend(&task, LEAST_WEIGHT, &mut outcome.iterations);
            if self.point.size > REACHED {
                best = Some((self.point.clone(), end));
            }
        } else {
            self.load.set_dead(load);
            self.known = false;
        }
        let continued = best.is_some();
        if !self.known || continued {
            self.load.set_dead(load);
            for start in 0..STARTS {
                if interrupt::interrupted() || agreements >= AGREEMENTS {
                    break;
                }
                if !self.start(&task, start) {
                    last_is_best = false;
                    continue;
                }
                let end = self.descend(&task, FIRST_WEIGHT, &mut outcome.iterations);
                let size = self.point.size;
                last_is_best = false;
                let best_size = best.as_ref().map_or(f64::INFINITY, |(b, _)| b.size);
                if size < best_size - SAME {
                    last_is_best = true;
                    restarted = continued;
                    agreements = 0;
                    best = Some((self.point.clone(), end));
                } else if size <= best_size + SAME && end == End::Converged {
                    agreements += 1;
                }
                if size <= REACHED {
                    break;
                }
            }
            let Some((point, _)) = &best else {
                self.known = false;
                return outcome;
            };
            if !last_is_best {
                self.point.clone_from(point);
                self.linearised = false;
            }
        }
        let mut end = best.map_or(End::Converged, |(_, end)| end);
        if !self.settle(last_is_best) {
            self.known = false;
            return outcome;
        }
        while self.refine(&task) {
            end = self.descend(&task, LEAST_WEIGHT, &mut outcome.iterations);
            if !self.settle(true) {
                self.known = false;
                return outcome;
            }
        }
        self.known = true;
        self.mark_binding(&task);
        self.describe(&task, end, &mut outcome);
        outcome.restarted = restarted;
        outcome
    }

    /// Tensions of the last solution (N).
    pub fn tensions(&self) -> Vec<f64> {
        self.point.tensions.iter().map(|t| t * self.unit).collect()
    }

    fn task(&self, target: &Target, limits: &Limits) -> Task {
        let over = |v: &[f64]| v.iter().map(|t| t / self.unit).collect();
        Task {
            target: *target,
            rows: if target.direction.is_some() { 6 } else { 3 },
            lower: over(limits.least),
            upper: over(limits.most),
        }
    }

    fn describe(&self, task: &Task, end: End, outcome: &mut InverseOutcome) {
        let r = &self.point.residual;
        outcome.distance = norm(&r[..3]) * self.length;
        if task.target.direction.is_some() {
            // the chord between two unit vectors
            outcome.direction_error = 2.0 * (0.5 * norm(&r[3..])).min(1.0).asin();
        }
        outcome.status = match end {
            _ if self.point.size <= REACHED => InverseStatus::Reached,
            End::Converged => InverseStatus::Unreachable,
            End::Stuck => InverseStatus::MaxIterations,
        };
        outcome.elements = LEVELS[self.point.level];
        outcome.equilibrium = self.point.outcome;
    }

    /// Marks the limits that keep the tip from the target.
    fn mark_binding(&mut self, task: &Task) {
        self.binding.fill(0);
        if self.point.size <= REACHED {
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
    use super::*;
    use crate::model::robot::{Disk, RobotSpec, Section, Tendon};
    use crate::statics::solver::{Solver, Status};

    /// Two segments with five tendons.
    fn robot() -> Robot {
        let section = Section {
            bending: [1.0; 2],
            principal_angle: 0.0,
            torsion: 0.8,
            axial: 7e5,
            shear: 2.6e5,
            mass_per_length: 0.035,
            rotary_inertia: 5.5e-8,
            rest_curvature: [0.0; 3],
        };
        let disks = (0..10).map(|k| Disk {
            hole_length: 0.0,
            station: 0.06 * (k + 1) as f64,
            clamped_length: 0.002,
            mass: 0.02,
            inertia: [5.1e-6, 1.0e-5],
            segment: usize::from(k > 4),
        });
        let tendons = (0..5).map(|i| {
            let angle = 1.3 * i as f64;
            Tendon::parallel(
                [0.02 * angle.cos(), 0.02 * angle.sin()],
                if i < 2 { 4 } else { 9 },
            )
        });
        Robot::new(RobotSpec {
            payloads: vec![],
            backbone: vec![section.into(), section.into()],
            disks: disks.collect(),
            tendons: tendons.collect(),
            gravity: [0.0, 0.0, -9.81],
        })
        .unwrap()
    }

    const TENSIONS: [f64; 5] = [5.0, 12.0, 14.0, 3.0, 9.0];

    /// The derivatives of the tip alone are those of all derivatives, with and without a potential.
    #[test]
    fn derivatives_of_the_tip_are_those_of_all() {
        let robot = robot();
        for tip_moment in [[0.0; 3], [0.05, 0.02, 0.01]] {
            for elements in [1, 2] {
                let mut solver = Solver::new(&robot, Default::default(), elements).unwrap();
                let load = Load {
                    tensions: &TENSIONS,
                    gravity: [0.0, 2.0, -9.81],
                    tip_force: [0.3, -0.2, 0.1],
                    tip_moment,
                    ..Load::default()
                };
                let outcome = solver.solve(&load).unwrap();
                assert_eq!(outcome.status, Status::Converged);
                let all = solver.jacobians().unwrap().tensions;
                let mut plain = solver.empty_plain();
                for rotation in [false, true] {
                    let mut columns = vec![[Vec3::zero(); 2]; 5];
                    assert!(solver.tip_by_tensions(&mut *plain, rotation, &mut columns));
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
                    solver.solve(&load).unwrap();
                    solver.last_strain().unwrap()
                };
                let (less, more) = (strain_at(-1.0), strain_at(1.0));
                let mut change = vec![Vec3::zero(); more.len()];
                plain.add_strain_by_tensions(&changes, &mut change);
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
        let mut inverse = InverseSolver::new(&robot, model).unwrap();
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
            assert!(found.distance < 1e-8);
            iterations[usize::from(warm)] += found.iterations;
            let row = inverse.row(found);
            let size = |t: &[f64]| t.iter().map(|t| t * t).sum::<f64>();
            assert!(size(&row.tensions) < size(&tensions) * (1.0 + 1e-6));
            assert!(row.tensions.iter().all(|t| (0.0..=30.0).contains(t)));
        }
        assert!(iterations[1] < 2 * iterations[0], "{iterations:?}");
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

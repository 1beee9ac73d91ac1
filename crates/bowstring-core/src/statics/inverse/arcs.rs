//! Start by constant curvature: tensions that bring the tip of arcs near the target.
//!
//! Theory: docs/theory/inverse-kinematics.md (Iteration).

use super::task::{norm, residual, Task};
use super::trust_region::{half_square, FIRST_RADIUS, LARGER, SMALLER};
use super::InverseSolver;
use crate::math::lie::ArcMap;
use crate::math::linalg::{Mat3, Vec3};
use crate::model::robot::Robot;
use crate::robot_arcs::{Law, RobotArcs};
use crate::statics::solver::Pose;

/// Weight of the tensions beside the distance.
const WEIGHT: f64 = 1e-2;
/// Most steps, the change of tension over the unit of tension at which they end, and the radius.
const STEPS: usize = 20;
const LEAST_CHANGE: f64 = 0.05;
const LEAST_RADIUS: f64 = 1e-2;

/// Arcs of the segments by the linear law, for tensions over their unit.
pub(super) struct Arcs {
    segments: Vec<Segment>,
}

struct Segment {
    length: f64,
    /// Rotation vector without tensions, and by each tension (rad).
    rest: Vec3,
    turns: Vec<Vec3>,
}

impl Arcs {
    pub fn new(robot: &Robot, unit: f64) -> Self {
        let arcs = RobotArcs::new(robot, Law::Linear);
        let turn = |[x, y]: [f64; 2]| Vec3([-y, x, 0.0]);
        let segments = arcs.linear_bends().into_iter();
        let segments = segments.map(|(length, rest, bends)| Segment {
            length,
            rest: turn(rest),
            turns: bends.into_iter().map(|b| turn(b) * unit).collect(),
        });
        Arcs {
            segments: segments.collect(),
        }
    }

    /// Tip under tensions, and its derivatives of position and rotation by each.
    fn tip(&self, tensions: &[f64], columns: &mut [[Vec3; 2]]) -> Pose {
        columns.fill([Vec3::zero(); 2]);
        let arcs = self.segments.iter().map(|segment| {
            let terms = segment.turns.iter().zip(tensions);
            let turn = terms.fold(segment.rest, |sum, (by, t)| sum + *by * *t);
            ArcMap::new(turn, segment.length)
        });
        let arcs: Vec<_> = arcs.collect();
        // from the tip inwards, in the frame of each start
        let (mut position, mut rotation) = (Vec3::zero(), Mat3::identity());
        for (arc, segment) in arcs.iter().zip(&self.segments).rev() {
            let turned = arc.rotation();
            let beyond = turned * position;
            let ahead = arc.left_jacobian();
            let by_turn = arc.end_jacobian();
            for [at, turn] in columns.iter_mut() {
                *at = turned * *at;
                *turn = turned * *turn;
            }
            for ([at, turn], by) in columns.iter_mut().zip(&segment.turns) {
                let spin = ahead * *by;
                *at += by_turn * *by + spin.cross(beyond);
                *turn += spin;
            }
            position = arc.end() + beyond;
            rotation = turned * rotation;
        }
        Pose { position, rotation }
    }
}

impl InverseSolver {
    /// Takes the point's tensions to those of least squares whose arcs end near the target.
    pub(super) fn start_by_arcs(&mut self, task: &Task) {
        let Some(arcs) = self.arcs.take() else {
            return;
        };
        self.curvature.is_used = false;
        let mut columns = std::mem::take(&mut self.columns);
        let mut tip = arcs.tip(&self.point.tensions, &mut columns);
        let mut radius = FIRST_RADIUS;
        let value = |r: &[f64; 6], tensions: &[f64]| {
            0.5 * (norm(&r[..task.rows]) / WEIGHT).powi(2) + half_square(tensions)
        };
        for _ in 0..STEPS {
            self.point.residual = residual(&tip, &task.target, self.length);
            let here = value(&self.point.residual, &self.point.tensions);
            self.columns = columns;
            self.linear_step(task, WEIGHT, radius, true);
            columns = std::mem::take(&mut self.columns);
            let largest = self.set_step();
            if largest < LEAST_CHANGE {
                break;
            }
            let trial = arcs.tip(&self.trial, &mut columns);
            if value(&residual(&trial, &task.target, self.length), &self.trial) < here {
                tip = trial;
                self.point.tensions.clone_from(&self.trial);
                if largest > 0.8 * radius {
                    radius *= LARGER;
                }
            } else {
                arcs.tip(&self.point.tensions, &mut columns);
                radius = SMALLER * largest;
                if radius < LEAST_RADIUS {
                    break;
                }
            }
        }
        self.columns = columns;
        self.arcs = Some(arcs);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::robot::Section;
    use crate::parts;

    fn robot() -> Robot {
        let section = Section {
            bending: [1.0, 1.3],
            principal_angle: 0.2,
            rest_curvature: [0.4, -0.2, 0.0],
            ..parts::section(1.0)
        };
        let spec = parts::robot(&[section; 2], &[4, 4], [0.06, 0.0], 1.3, &[3, 3, 7, 7, 7]);
        Robot::new(spec).unwrap()
    }

    /// The tip is that of constant curvature, its derivatives are central differences.
    #[test]
    fn tip_and_derivatives_are_those_of_constant_curvature() {
        let (robot, unit) = (robot(), 30.0);
        let arcs = Arcs::new(&robot, unit);
        let reference = RobotArcs::new(&robot, Law::Linear);
        let tensions = [0.4, 0.1, 0.9, 0.2, 0.6];
        let mut columns = vec![[Vec3::zero(); 2]; 5];
        let mut unused = columns.clone();
        let tip = arcs.tip(&tensions, &mut columns);
        let newtons = tensions.map(|t| unit * t);
        let expected = Vec3(reference.tip(&newtons).unwrap());
        assert!((tip.position - expected).max_abs() < 1e-14);
        let h = 1e-5;
        for (i, [position, rotation]) in columns.iter().enumerate() {
            let mut at = |side: f64| {
                let mut moved = tensions;
                moved[i] += side * h;
                arcs.tip(&moved, &mut unused)
            };
            let (less, more) = (at(-1.0), at(1.0));
            let central = (more.position - less.position) * (0.5 / h);
            assert!((central - *position).max_abs() < 1e-9);
            let tangent = tip.rotation.column(2);
            let central = (more.rotation.column(2) - less.rotation.column(2)) * (0.5 / h);
            assert!((central - rotation.cross(tangent)).max_abs() < 1e-9);
        }
    }
}

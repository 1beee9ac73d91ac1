//! What the inverse is asked for: the target of the tip, the limits of the tensions, and both
//! without units.
//!
//! Theory: docs/theory/inverse-kinematics.md (Eq. 10.1).

use crate::model::error::InputError;
use crate::model::robot::Robot;
use crate::statics::solver::Pose;

/// Tolerance of the length of a unit vector.
const UNIT_TOLERANCE: f64 = 1e-9;

/// Where the tip should be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Target {
    /// Position (m).
    pub position: [f64; 3],
    /// Direction of the tangent at the tip, of length one.
    pub direction: Option<[f64; 3]>,
}

/// Limits of the tensions, one of each for each tendon (N).
#[derive(Clone, Copy, Debug)]
pub struct Limits<'a> {
    /// Least tensions.
    pub least: &'a [f64],
    /// Largest tensions.
    pub most: &'a [f64],
}

impl Target {
    /// Checks that the numbers are finite and the direction has length one.
    pub fn check(&self) -> Result<(), InputError> {
        if !self.position.iter().all(|x| x.is_finite()) {
            return Err(InputError::other(format!(
                "target position is {:?} m; its numbers must be finite",
                self.position
            )));
        }
        if let Some(direction) = self.direction {
            let length = norm(&direction);
            // a NaN is no length
            if !((length - 1.0).abs() <= UNIT_TOLERANCE) {
                return Err(InputError::other(format!(
                    "target direction is {direction:?}, of length {length}; its length must be 1"
                )));
            }
        }
        Ok(())
    }
}

impl Limits<'_> {
    /// Checks that there is one of each for each tendon, in order, and not negative where it only pulls.
    pub fn check(&self, robot: &Robot) -> Result<(), InputError> {
        let count = robot.tendon_count();
        if self.least.len() != count || self.most.len() != count {
            return Err(InputError::other(format!(
                "{} least and {} largest tensions were given, a robot with {count} tendons needs {count} of each",
                self.least.len(),
                self.most.len()
            )));
        }
        for (i, (least, most)) in self.least.iter().zip(self.most).enumerate() {
            let lowest = robot.spec().tendons[i].least_tension();
            let ordered = least.is_finite() && least <= most && most.is_finite();
            if !(ordered && lowest <= *least) {
                let sign = if lowest < 0.0 { "" } else { ", >= 0 N" };
                return Err(InputError::other(format!(
                    "limits of tension {} are {least} N and {most} N; they must be finite{sign} and in order",
                    i + 1
                )));
            }
        }
        Ok(())
    }
}

/// The problem of a row: lengths over that of the robot, tensions over the unit of tension.
#[derive(Clone)]
pub(super) struct Task {
    pub target: Target,
    /// Number of equations: three for the position, and three for a direction.
    pub rows: usize,
    /// Limits of the tensions.
    pub lower: Vec<f64>,
    pub upper: Vec<f64>,
    /// Permitted distance beyond that of the nearest tip, if it does not reach the target.
    pub margin: f64,
}

impl Task {
    /// Bound of the change of the least distance between two targets; infinite where the limits
    /// differ, or one has no direction.
    pub fn shift(&self, other: &Task, length: f64) -> f64 {
        if self.rows != other.rows || self.lower != other.lower || self.upper != other.upper {
            return f64::INFINITY;
        }
        let (a, b) = (self.goal(length), other.goal(length));
        norm(&[0, 1, 2, 3, 4, 5].map(|q| a[q] - b[q]))
    }

    /// Position over the length, and direction.
    pub fn goal(&self, length: f64) -> [f64; 6] {
        let p = self.target.position.map(|x| x / length);
        let d = self.target.direction.unwrap_or_default();
        [p[0], p[1], p[2], d[0], d[1], d[2]]
    }

    /// Whether the tensions are within the limits, after they have been moved there.
    pub fn clamp(&self, tensions: &mut [f64]) -> bool {
        let mut were_within = true;
        for (i, tension) in tensions.iter_mut().enumerate() {
            let within = tension.max(self.lower[i]).min(self.upper[i]);
            were_within &= within == *tension;
            *tension = within;
        }
        were_within
    }
}

/// Euclidean norm.
pub(super) fn norm(v: &[f64]) -> f64 {
    v.iter().map(|x| x * x).sum::<f64>().sqrt()
}

/// Position over the length, and direction, less those of the target.
pub(super) fn residual(tip: &Pose, target: &Target, length: f64) -> [f64; 6] {
    let tangent = tip.rotation.column(2);
    let mut r = [0.0; 6];
    for q in 0..3 {
        r[q] = (tip.position[q] - target.position[q]) / length;
        r[3 + q] = target.direction.map_or(0.0, |d| tangent[q] - d[q]);
    }
    r
}

//! What the inverse is asked for: the target of the tip, the limits of the tensions, and both
//! without units.
//!
//! Theory: docs/theory/inverse-kinematics.md (Eq. 10.1).

use crate::model::error::InputError;
use crate::model::robot::Robot;
use crate::statics::solver::Pose;

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

impl Limits<'_> {
    /// Checks that there is one of each for each tendon, not negative and in order.
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
            if !(0.0 <= *least && least <= most && most.is_finite()) {
                return Err(InputError::other(format!(
                    "tension {} is limited to {least} N to {most} N; limits must be finite, >= 0 N and in order",
                    i + 1
                )));
            }
        }
        Ok(())
    }
}

/// The problem of a row; numbers without unit as in [`Point`].
pub(super) struct Task {
    pub target: Target,
    pub rows: usize,
    pub lower: Vec<f64>,
    pub upper: Vec<f64>,
}

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

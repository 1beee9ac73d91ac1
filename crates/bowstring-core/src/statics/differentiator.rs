//! Derivatives of equilibria whose strain is known.
//!
//! Theory: docs/theory/statics.md (Block-tridiagonal elimination).

use crate::dispatch::{self, Plain};
use crate::math::linalg::Vec3;
use crate::model::load::{Load, RodModel, LEVELS};
use crate::model::robot::Robot;
use crate::outcome::Settings;

/// Writes such derivatives, with scratch memory for one after another.
///
/// The derivatives of a load are a matrix, row by row: position of the tip (m), its rotation vector
/// in the base frame (rad) and the tendon lengths (m) by the tensions (N), the tip force (N), the
/// tip moment (N m), the logarithm of the stiffness of each segment and, if there are columns for
/// it, gravity (m/s^2).
pub(super) struct Differentiator {
    robot: Robot,
    model: RodModel,
    /// Segment of each module.
    segments: Vec<usize>,
    /// Rods in plain numbers and their scales, by [`LEVELS`].
    rods: [Option<(Box<dyn Plain>, Settings)>; 4],
}

impl Differentiator {
    pub fn new(robot: &Robot, model: &RodModel) -> Self {
        Differentiator {
            robot: robot.clone(),
            model: *model,
            segments: robot.spec().disks.iter().map(|d| d.segment).collect(),
            rods: [const { None }; 4],
        }
    }

    /// Writes the matrix of a load at its equilibrium; nothing for continuous tendons, and where
    /// the equilibrium is so close to losing stability that the derivatives are not finite.
    pub fn write(&mut self, load: &Load, strain: &[Vec3], out: &mut [f64]) {
        let elements = strain.len() / (2 * self.robot.module_count());
        let Some(level) = LEVELS.iter().position(|e| *e == elements) else {
            return;
        };
        let (rod, settings) = self.rods[level].get_or_insert_with(|| {
            let rod = dispatch::plain(&self.robot, self.model.model, elements);
            (
                rod.expect("it is one of them"),
                Settings::new(&self.robot, elements),
            )
        });
        rod.take_strain(&settings.without_negligible(load), strain);
        let tendons = self.robot.tendon_count();
        let columns = out.len() / (6 + tendons);
        let gravity = columns > tendons + 6 + self.robot.spec().backbone.len();
        let Some(by) = rod.jacobians(&self.segments, gravity) else {
            return;
        };
        let all = by.tensions.iter().chain(&by.tip_force);
        let all = all.chain(&by.tip_moment).chain(&by.stiffness);
        let all = all.chain(&by.gravity);
        for (j, column) in all.enumerate() {
            let numbers = column.position.0.iter().chain(&column.rotation.0);
            for (i, x) in numbers.chain(&column.lengths).enumerate() {
                out[i * columns + j] = *x;
            }
        }
    }
}

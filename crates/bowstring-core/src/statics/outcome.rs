//! What a solve found, its numbers aside, and the measures that it was found by.

use crate::model::load::Model;
use crate::model::robot::Robot;
use crate::rod::constants::Constants;
use crate::rod::estimate::ErrorEstimate;

/// Largest moment imbalance over (bending stiffness / length) that counts as converged.
pub const TOLERANCE: f64 = 1e-10;

/// How a solve ended. Only [`Status::Converged`] comes with a pose.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Status {
    /// The residual is below the tolerance, at a minimum of the energy where there is one.
    Converged,
    /// The residual stayed above the tolerance.
    MaxIterations,
    /// An equilibrium was found, but no stable one.
    Unstable,
    /// An equilibrium was found only with two disks passed through each other: the load closes
    /// the gap between them.
    NoEquilibrium,
}

impl Status {
    /// The word that the outputs use.
    pub fn word(self) -> &'static str {
        match self {
            Status::Converged => "converged",
            Status::MaxIterations => "max_iterations",
            Status::Unstable => "unstable",
            Status::NoEquilibrium => "no_equilibrium",
        }
    }
}

/// What a solve found, its numbers aside.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Outcome {
    /// How the solve ended.
    pub status: Status,
    /// Whether the equilibrium is a minimum of the energy. Under a tip moment, which has no
    /// potential: whether small motions at a damping ratio of 0.01 die out, false with
    /// [`Status::Converged`] where it is the moment that leads from a stable equilibrium to one where
    /// they do not, as it does beyond half a turn; `None` where that takes more damping, or the
    /// masses of a robot that has none, and where the answer is lost in rounding.
    pub stable: Option<bool>,
    /// Newton steps.
    pub iterations: usize,
    /// Largest moment imbalance over (bending stiffness / length).
    pub residual: f64,
    /// The way from straight led to an unstable equilibrium, which was left for a stable one.
    pub left_unstable: bool,
    /// Largest fraction of the load that did converge.
    pub fraction: f64,
    /// Module in which two disks collide.
    pub collision: Option<usize>,
    /// Of a converged answer, where it was asked for.
    pub error: Option<ErrorEstimate>,
}

impl Outcome {
    /// Of a load that is not solved yet.
    pub(crate) fn pending() -> Self {
        Outcome {
            status: Status::MaxIterations,
            stable: None,
            iterations: 0,
            residual: f64::INFINITY,
            left_unstable: false,
            fraction: 1.0,
            collision: None,
            error: None,
        }
    }
}

/// Measures of a robot that Newton's method goes by.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Settings {
    /// Measure of moments: bending stiffness over length (N m).
    pub moment_scale: f64,
    /// Diagonal shift worth a tenth of an arc's bending stiffness (N m).
    pub shift_unit: f64,
    /// Length of the robot (m).
    pub length: f64,
    /// Work of a Newton iteration, in units of `interrupt::work`.
    pub work: usize,
}

impl Settings {
    pub fn new(robot: &Robot, model: Model, elements: usize) -> Self {
        let stiffness = (0..robot.module_count())
            .map(|k| Constants::new(robot, k, model, elements).stiffness[0])
            .fold(0.0, f64::max);
        Settings {
            moment_scale: robot.moment_scale(),
            shift_unit: 0.1 * stiffness,
            length: robot.length(),
            work: robot.module_count() * elements * (8 + 2 * robot.tendon_count()),
        }
    }

    /// Tip moment that the tolerance of the residual does not tell from none, N m.
    pub fn least_moment(&self) -> f64 {
        TOLERANCE * self.moment_scale
    }
}

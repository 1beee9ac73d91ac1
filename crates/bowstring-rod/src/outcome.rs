//! Status of a solve or a step of a path, and the scales of its tolerances.
//!
//! Theory: docs/theory/statics.md (Globalisation, Stability).
#![warn(missing_docs)]

use crate::criteria::TOLERANCE;
use crate::model::load::Load;
use crate::model::robot::Robot;
use crate::rod::estimate::ErrorEstimate;

/// Eigenvalue of the tangent that counts as zero, over the smallest bending stiffness of an arc: a
/// flat section buckles in its soft direction.
const ZERO_EIGENVALUE: f64 = 1e-8;
/// Rounding of an eigenvalue, over the largest bending stiffness of an arc.
const EIGENVALUE_NOISE: f64 = 1e-14;

/// How a solve ended. Only [`Status::Converged`] comes with a pose.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Status {
    /// The residual is below the tolerance, at a minimum of the energy where it exists.
    Converged,
    /// The residual stayed above the tolerance within the bounds of iterations and work, or the
    /// largest number of elements bounds no error.
    MaxIterations,
    /// An equilibrium was found, but no stable one.
    Unstable,
    /// An equilibrium was found only with two disks that penetrate each other: the load closes the
    /// gap between them.
    NoEquilibrium,
}

impl Status {
    /// The word of the status in the outputs.
    pub fn word(self) -> &'static str {
        match self {
            Status::Converged => "converged",
            Status::MaxIterations => "max_iterations",
            Status::Unstable => "unstable",
            Status::NoEquilibrium => "no_equilibrium",
        }
    }
}

/// Status of a solve, without poses.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Outcome {
    /// How the solve ended.
    pub status: Status,
    /// Whether the equilibrium is a minimum of the energy. Under a moment, which has no
    /// potential: whether small motions with a damping ratio of 0.01 decay. It is false with
    /// [`Status::Converged`] where the moment leads from a stable equilibrium to one where they do
    /// not decay, as it does beyond a rotation of pi. `None` where decay needs more damping, where
    /// the robot has no mass, and where the result is lost in rounding.
    pub stable: Option<bool>,
    /// Newton steps.
    pub iterations: usize,
    /// Largest moment imbalance over (bending stiffness / length).
    pub residual: f64,
    /// The iteration reached an unstable equilibrium, and left it for a stable one.
    pub left_unstable: bool,
    /// Largest fraction of the load that converged.
    pub fraction: f64,
    /// Module in which two disks collide.
    pub collision: Option<usize>,
    /// Error estimate of a converged solution, where it was requested.
    pub error: Option<ErrorEstimate>,
}

impl Outcome {
    /// Outcome of a load that is not solved yet.
    pub fn pending() -> Self {
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

/// Result of a step.
#[derive(Clone, Debug, PartialEq)]
pub struct PathOutcome {
    /// How the step ended.
    pub status: Status,
    /// Whether the equilibrium is a minimum of the energy under the given displacements and
    /// tensions; `None` under a moment or friction, which have no potential.
    pub stable: Option<bool>,
    /// Newton steps.
    pub iterations: usize,
    /// Increments between the last step of the path and this one.
    pub increments: usize,
    /// Largest moment imbalance over (bending stiffness / length).
    pub residual: f64,
    /// Largest length error of a tendon under displacement control (m).
    pub length_residual: f64,
    /// Whether the tensions are the smallest of many that hold the same pose.
    pub undetermined: bool,
    /// Tendons with conflicting displacements, where there is no equilibrium.
    pub opposing: Vec<usize>,
    /// Nearest feasible displacements (m), where there is no equilibrium.
    pub nearest: Option<Vec<f64>>,
    /// Estimated discretisation error of a converged solution.
    pub error: Option<ErrorEstimate>,
}

impl PathOutcome {
    /// Result of a step that is not solved yet.
    pub fn pending() -> Self {
        PathOutcome {
            status: Status::MaxIterations,
            stable: None,
            iterations: 0,
            increments: 1,
            residual: f64::INFINITY,
            length_residual: f64::INFINITY,
            undetermined: false,
            opposing: vec![],
            nearest: None,
            error: None,
        }
    }
}

impl From<&PathOutcome> for Outcome {
    fn from(found: &PathOutcome) -> Self {
        Outcome {
            status: found.status,
            stable: match found.status {
                Status::NoEquilibrium => None,
                _ => found.stable,
            },
            iterations: found.iterations,
            residual: found.residual,
            error: found.error,
            ..Outcome::pending()
        }
    }
}

/// Scales of a robot for the tolerances of Newton's method.
#[derive(Clone, Copy, Debug)]
pub struct Settings {
    /// Scale of moments: bending stiffness over length (N m).
    pub moment_scale: f64,
    /// Unit of the diagonal shift: a tenth of an arc's bending stiffness (N m).
    pub shift_unit: f64,
    /// Magnitude up to which an eigenvalue of the tangent counts as zero (N m).
    pub zero_eigenvalue: f64,
    /// Length of the robot (m).
    pub length: f64,
    /// Work of a Newton iteration, in units of `interrupt::work`.
    pub work: usize,
}

impl Settings {
    /// Scales of a robot with `elements` in a module.
    pub fn new(robot: &Robot, elements: usize) -> Self {
        let stiffnesses = (0..robot.module_count()).flat_map(|k| {
            let arc = robot.modules[k].flexible / elements as f64;
            let ends = [0.0, 1.0].map(|x| robot.section(k, x).bending.map(|b| b / arc));
            ends.into_iter().flatten()
        });
        let largest = stiffnesses.clone().fold(0.0, f64::max);
        let least = stiffnesses.fold(f64::INFINITY, f64::min);
        Settings {
            moment_scale: robot.moment_scale(),
            shift_unit: 0.1 * largest,
            zero_eigenvalue: f64::max(ZERO_EIGENVALUE * least, EIGENVALUE_NOISE * largest),
            length: robot.length(),
            work: robot.module_count() * elements * (8 + 2 * robot.tendon_count()),
        }
    }

    /// The load without the moments that the tolerance of the residual does not resolve.
    pub fn without_negligible<'a>(&self, load: &Load<'a>) -> Load<'a> {
        load.without_negligible(TOLERANCE * self.moment_scale)
    }
}

//! Settings of the integrator, and counts of an interval.
//!
//! Theory: docs/theory/dynamics.md.

pub use crate::step::Damping;

/// Choice of the time step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Step {
    /// Constant step, at most this long (s).
    Fixed(f64),
    /// Adaptive step with about this error of a disk's position in a step. After a jump of the
    /// load, where no error estimate exists, the step is a twentieth of the longest.
    Adaptive {
        /// Error of a disk's position in a step (m).
        tolerance: f64,
        /// Longest step (s).
        longest: f64,
    },
}

/// Ratio of the longest step to the first one after a jump of the load.
const FIRST_PART: f64 = 20.0;

impl Step {
    /// The longest step (s).
    pub(super) fn longest(&self) -> f64 {
        match *self {
            Step::Fixed(step) => step,
            Step::Adaptive { longest, .. } => longest,
        }
    }

    /// The first step after a jump of the load (s).
    pub(super) fn first(&self) -> f64 {
        match *self {
            Step::Fixed(step) => step,
            Step::Adaptive { longest, .. } => longest / FIRST_PART,
        }
    }
}

/// Settings that are constant during a run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Integrator {
    /// Gravity (m/s^2).
    pub gravity: [f64; 3],
    /// Physical damping.
    pub damping: Damping,
    /// Numerical damping: spectral radius at infinite frequency, from 0 (strongest) to 1 (none).
    pub spectral_radius: f64,
    /// Length of the time steps.
    pub step: Step,
}

/// Reason for an early stop.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stop {
    /// The shortest step did not converge.
    StepFailed,
    /// Two disks collided.
    Collision,
}

/// Counts of an interval.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Count {
    /// Time steps.
    pub steps: usize,
    /// Newton iterations.
    pub iterations: usize,
    /// Repeated steps: shorter, or without numerical damping.
    pub repeated: usize,
    /// Estimated error of the tip's position from these steps (m): the sum of the errors of the
    /// steps, times a safety factor. Zero after a single step, whose error is unknown.
    pub error: f64,
}

//! Integrator of a run, and what a stretch of time took.

pub use crate::motion::Damping;

/// How long a step is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Step {
    /// At most this long (s).
    Fixed(f64),
    /// Such that a disk's position errs by about this much in a step, m; a step after a jump of
    /// the load is a twentieth of the longest, for nothing is known of it.
    Adaptive {
        /// Error of a disk's position in a step (m).
        tolerance: f64,
        /// Longest step (s).
        longest: f64,
    },
}

/// Part of the longest step that one after a jump of the load takes.
const FIRST_PART: f64 = 20.0;

impl Step {
    /// The longest step, s.
    pub(super) fn longest(&self) -> f64 {
        match *self {
            Step::Fixed(step) => step,
            Step::Adaptive { longest, .. } => longest,
        }
    }

    /// The step after a jump of the load, s.
    pub(super) fn first(&self) -> f64 {
        match *self {
            Step::Fixed(step) => step,
            Step::Adaptive { longest, .. } => longest / FIRST_PART,
        }
    }
}

/// What stays the same over a run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Integrator {
    /// Gravity (m/s^2).
    pub gravity: [f64; 3],
    /// Physical damping.
    pub damping: Damping,
    /// Numerical damping: spectral radius at infinite frequency, 0 to 1 (none).
    pub spectral_radius: f64,
    /// Length of the time steps.
    pub step: Step,
}

/// Why a run stopped before its time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stop {
    /// The shortest step did not converge.
    StepFailed,
    /// Two disks met.
    Collision,
}

/// What a stretch of time took.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Count {
    /// Time steps.
    pub steps: usize,
    /// Newton steps.
    pub iterations: usize,
    /// Steps done again: shorter, or without numerical damping.
    pub repeated: usize,
    /// Estimated error of the tip's position that these steps add, m: the sum of their own, with a
    /// margin. Zero after a single step, of which nothing is known.
    pub error: f64,
}

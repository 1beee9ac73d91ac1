//! Status of an inverse.

use crate::outcome::Outcome;

/// How an inverse ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum InverseStatus {
    /// The tip is within [`REACHED`](super::REACHED) of the target.
    Reached,
    /// The nearest tip is as near to the target as any small change of tension brings it.
    Unreachable,
    /// The nearest tip that was found may not be: the iteration did not converge.
    MaxIterations,
    /// No start has an equilibrium.
    NoEquilibrium,
}

impl InverseStatus {
    /// The word of the status in the outputs.
    pub fn word(self) -> &'static str {
        match self {
            InverseStatus::Reached => "reached",
            InverseStatus::Unreachable => "unreachable",
            InverseStatus::MaxIterations => "max_iterations",
            InverseStatus::NoEquilibrium => "no_equilibrium",
        }
    }
}

/// Status of an inverse.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct InverseOutcome {
    /// How it ended.
    pub status: InverseStatus,
    /// Distance from the tip to the target (m).
    pub distance: f64,
    /// Distance from the nearest tip that was found to the target (m): smaller than that of the tip
    /// where a margin permits a larger one.
    pub nearest: f64,
    /// Angle between the tangent at the tip and its target (rad); NaN without one.
    pub direction_error: f64,
    /// Iterations of all starts.
    pub iterations: usize,
    /// Whether a row of a path was not found from the previous row, but from another start.
    pub restarted: bool,
    /// Elements in a module.
    pub elements: usize,
    /// Outcome of the equilibrium.
    pub equilibrium: Outcome,
}

impl InverseOutcome {
    pub(super) fn pending() -> Self {
        InverseOutcome {
            status: InverseStatus::NoEquilibrium,
            distance: f64::NAN,
            nearest: f64::NAN,
            direction_error: f64::NAN,
            iterations: 0,
            restarted: false,
            elements: 1,
            equilibrium: Outcome::pending(),
        }
    }
}

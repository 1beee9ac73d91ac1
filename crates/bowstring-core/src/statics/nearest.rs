//! Displacements without an equilibrium: the opposing tendons, and the nearest feasible
//! displacements.
//!
//! Theory: docs/theory/actuation.md.

use crate::model::load::Load;
use crate::statics::path_step::PathStep;
use crate::statics::solver::Status;
use crate::tendon::{Command, History};

/// Decreasing compliances added to all tendons, over the bending compliance.
const COMPLIANCES: [f64; 4] = [1.0, 0.1, 1e-2, 1e-3];
/// Ratio of successive length errors above which tendons oppose each other: an error that only
/// elongation can remove falls with the compliance.
const PERSISTENT_RATIO: f64 = 0.3;
/// Negligible length error, over the robot's length.
const NEGLIGIBLE_LENGTH: f64 = 1e-6;
/// Fraction of the largest length error above which a tendon counts as opposing.
const OPPOSING_FRACTION: f64 = 0.1;

/// Nearest displacements that have an equilibrium.
pub(crate) struct Nearest {
    /// Tendons with conflicting displacements.
    pub opposing: Vec<usize>,
    /// Displacements by tendons (m); NaN under tension control.
    pub displacements: Vec<f64>,
}

impl PathStep {
    /// Nearest feasible displacements in the least-squares sense, without friction, from the home
    /// pose; `None` where no displacements conflict.
    pub fn nearest(
        &mut self,
        home: &History,
        commands: &[Command],
        load: &Load,
    ) -> Option<Nearest> {
        let before = self.transmission.tendons.compliance.before.clone();
        let now = self.transmission.tendons.now.clone();
        let friction = std::mem::replace(&mut self.transmission.friction.enabled, false);
        let mut best = None;
        let mut last_error = f64::INFINITY;
        for share in COMPLIANCES {
            let tendons = &mut self.transmission.tendons;
            let more = share * tendons.compliance.scale;
            for (to, from) in tendons.compliance.before.iter_mut().zip(&before) {
                *to = from + more;
            }
            if self.solve(home, commands, load).status != Status::Converged {
                break;
            }
            let length_errors: Vec<f64> = self.length_errors(commands, more);
            let most = length_errors.iter().copied().fold(0.0, f64::max);
            let persists = last_error.is_finite() && most > PERSISTENT_RATIO * last_error;
            let length = self.solver.robot().length();
            best = (persists && most > NEGLIGIBLE_LENGTH * length).then(|| Nearest {
                opposing: (0..commands.len())
                    .filter(|&i| length_errors[i] > OPPOSING_FRACTION * most)
                    .collect(),
                displacements: commands
                    .iter()
                    .zip(&length_errors)
                    .map(|(command, length_error)| match command {
                        Command::Displacement(p) => p - length_error,
                        Command::Tension(_) => f64::NAN,
                    })
                    .collect(),
            });
            last_error = most;
        }
        self.transmission.tendons.compliance.before = before;
        self.transmission.tendons.now = now;
        self.transmission.friction.enabled = friction;
        best
    }

    /// Length error of every tendon with an added compliance (m); zero under tension control.
    fn length_errors(&self, commands: &[Command], compliance: f64) -> Vec<f64> {
        let tensions = &self.transmission.tendons.now.tensions;
        let length_error = |(command, tension): (&Command, &f64)| match command {
            Command::Displacement(_) => compliance * tension,
            Command::Tension(_) => 0.0,
        };
        commands.iter().zip(tensions).map(length_error).collect()
    }
}

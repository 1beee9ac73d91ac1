//! Tendons of a robot in motion under tension and displacement control.
//!
//! Theory: docs/theory/dynamics.md (Tendons in motion).

use crate::statics::path::{Command, History, PathSolver};
use crate::step::Moving;
use crate::tendon::{Tendons, Transmission};

// Tuned constants. Lengths are fractions of the robot's length.

/// Length error to which displacements are met; and the same where rounding allows no better.
const LENGTH: f64 = 1e-13;
const NEAR_LENGTH: f64 = 1e-11;
/// Negligible slip: somewhat more than either tolerance of a length.
pub(super) const NEGLIGIBLE_SLIP: f64 = 1e-11;
/// Negligible change of the logarithm of a tension: far below what is recorded.
const NEGLIGIBLE_DROP: f64 = 1e-9;
/// Ratio of length errors of two iterations up to which the iteration counts as converging.
const CONTRACTION: f64 = 0.1;

/// Actuation of a robot through its tendons.
pub(super) struct Actuation {
    transmission: Transmission,
    /// State of the tendons at the start of the step.
    old: History,
    /// Slack length of each tendon at the start of the step (m).
    pub slack: Vec<f64>,
    /// Commands of the step.
    pub commands: Vec<Command>,
    /// Length error of the iteration before, over the robot's length.
    last_error: f64,
    /// Length of the robot (m).
    length: f64,
}

/// Result of a check of the tendons in an iteration.
#[derive(Clone, Copy)]
pub(super) struct TendonCheck {
    /// Whether friction and lengths are within their tolerances.
    pub settled: bool,
    /// Whether the length error decreases.
    pub better: bool,
}

impl Actuation {
    pub fn new(path: &PathSolver, length: f64) -> Self {
        let mut transmission = path.transmission().clone();
        transmission.friction.tolerance.drop = NEGLIGIBLE_DROP;
        transmission.friction.tolerance.slip = NEGLIGIBLE_SLIP * length;
        Actuation {
            slack: transmission.tendons.slack.clone(),
            transmission,
            old: path.history().clone(),
            commands: path.history().commands.clone(),
            last_error: f64::INFINITY,
            length,
        }
    }

    pub fn tendons(&self) -> &Tendons {
        &self.transmission.tendons
    }

    /// Tensions before the base holes at the last balance of forces (N).
    pub fn last_tensions(&self) -> &[f64] {
        &self.old.tensions
    }

    /// Present tension of a tendon (N): from its elongation where friction leaves it uniform,
    /// otherwise that of the last balance of forces.
    pub fn tension(&self, i: usize) -> f64 {
        match self.tendons().tension_from_elongation(i) {
            Some(tension) if !self.transmission.friction.enabled => tension,
            _ => self.old.tensions[i],
        }
    }

    /// Present displacement of a tendon (m).
    pub fn displacement(&self, i: usize) -> f64 {
        self.tendons().displacement_now(i, &self.old)
    }

    /// Tension of a tendon's spans from base to tip at the last balance of forces (N); not what a
    /// failed step left in the rod.
    pub fn spans(&self, i: usize) -> impl Iterator<Item = f64> + '_ {
        let (m, friction) = (self.commands.len(), self.transmission.friction.enabled);
        let mut drop = 0.0;
        (0..).map(move |k| {
            if friction {
                drop += self.old.drops[k * m + i];
            }
            self.old.tensions[i] * (-drop).exp()
        })
    }

    /// Whether a tendon is under displacement control and inextensible.
    pub fn is_stiff(&self, i: usize) -> bool {
        self.commands[i].is_displacement() && self.tendons().tension_from_elongation(i).is_none()
    }

    /// Factor by which a Newton iteration of a step takes more work.
    pub fn work_factor(&self) -> usize {
        2 + self.transmission.unknowns.problem.size
    }

    /// Sets the commands of a step: tensions where forces balance, displacements at its end.
    pub fn begin(
        &mut self,
        motion: &mut dyn Moving,
        tensions: &[f64],
        displacements: &[f64],
        share: f64,
    ) {
        for (i, command) in self.commands.iter_mut().enumerate() {
            match command {
                Command::Tension(t) => *t = tensions[i],
                Command::Displacement(p) => *p = displacements[i],
            }
        }
        self.transmission.start(&self.old, &self.commands);
        self.transmission.tendons.step.share = share;
        self.transmission.tendons.apply(motion);
        self.last_error = f64::INFINITY;
    }

    /// Updates friction and lengths at the present pose; recomputes the moment imbalance where
    /// friction changed it.
    pub fn update(&mut self, motion: &mut dyn Moving, residual: &mut f64) -> TendonCheck {
        let friction = self.transmission.friction.enabled;
        motion.measure_spans(friction);
        let mut settled = true;
        if friction {
            settled = self.transmission.update_friction(motion, &self.old, false);
            *residual = motion.imbalance();
        }
        let tendons = &mut self.transmission.tendons;
        tendons.measure(motion);
        let error = tendons.length_residual() / self.length;
        let better = error <= CONTRACTION * self.last_error;
        let stalls = error <= NEAR_LENGTH && !better;
        self.last_error = error;
        TendonCheck {
            settled: settled && (error <= LENGTH || stalls),
            better,
        }
    }

    /// Computes a Newton step on tensions and strain; false if its equations are singular. `made`:
    /// the tangent is new.
    pub fn newton_step(&mut self, motion: &mut dyn Moving, made: bool) -> bool {
        let transmission = &mut self.transmission;
        transmission.gather(motion, &self.old, 0.0, !made);
        if !transmission.unknowns.problem.solve() {
            return false;
        }
        if transmission.unknowns.is_empty() {
            motion.substitute();
            motion.combine(&[1.0]);
            return true;
        }
        motion.combine(transmission.coefficients());
        transmission.take(motion, 1.0);
        true
    }

    /// Number of directions without a minimum of the energy that displacement control holds.
    pub fn held_directions(&mut self) -> usize {
        self.transmission.unknowns.problem.negative_eigenvalues()
    }

    /// Takes a pose at rest as one of the path; see [`Tendons::adopt`].
    pub fn adopt(&mut self, motion: &mut dyn Moving) {
        motion.measure_spans(false);
        self.transmission.tendons.adopt(motion);
    }

    /// Adds energy, work and loss of the tendons in the finished step to its energies.
    pub fn account(&self, motion: &mut dyn Moving) {
        let energies = self
            .tendons()
            .energies(motion, motion.energies().tendon_work);
        motion.energies_mut().account(&energies);
    }

    /// Accepts the present pose as the start of the next step; returns the energy of tendons under
    /// displacement control (J).
    pub fn arrive(&mut self, motion: &dyn Moving) -> f64 {
        let tendons = &mut self.transmission.tendons;
        let energy = tendons.arrive(motion);
        self.old.copy_from(&tendons.now);
        self.slack.clone_from(&tendons.slack);
        energy
    }

    /// Sets displacements at once; returns the work of the motors in the jump (J).
    pub fn jump(&mut self, values: &[f64]) -> f64 {
        self.transmission.tendons.jump(values, &mut self.slack)
    }
}

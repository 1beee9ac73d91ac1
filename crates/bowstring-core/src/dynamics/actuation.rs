//! Tendons of a robot in motion under tension and displacement control.

use crate::motion::Moving;
use crate::statics::path::{Command, History, PathSolver};
use crate::tendon::{Tendons, Transmission};

// Tuned constants. Lengths are shares of the robot's.

/// Length to which displacements are met; and where rounding allows no better.
const LENGTH: f64 = 1e-13;
const NEAR_LENGTH: f64 = 1e-11;
/// Slip that is none: somewhat more than either.
pub(super) const NO_SLIP: f64 = 1e-11;
/// Change of the logarithm of a tension that is none: far below what is recorded.
const NO_DROP: f64 = 1e-9;
/// Share of the length lacked before, up to which an iteration gets better.
const CONTRACTION: f64 = 0.1;

/// Actuation of a robot through its lines.
pub(super) struct Actuation {
    transmission: Transmission,
    /// At the start of the step.
    old: History,
    /// Slack length of each tendon there, m.
    pub slack: Vec<f64>,
    /// Of the step.
    pub commands: Vec<Command>,
    /// Length that a tendon lacked or had too much in the iteration before, over the robot's.
    lacked: f64,
    /// Of the robot, m.
    length: f64,
}

/// What an iteration finds of the tendons.
#[derive(Clone, Copy)]
pub(super) struct TendonCheck {
    /// Whether friction and lengths are as they must be.
    pub settled: bool,
    /// Whether lengths get better.
    pub better: bool,
}

impl Actuation {
    pub fn new(path: &PathSolver, length: f64) -> Self {
        let mut transmission = path.transmission().clone();
        transmission.friction.tolerance.drop = NO_DROP;
        transmission.friction.tolerance.slip = NO_SLIP * length;
        Actuation {
            slack: transmission.tendons.slack.clone(),
            transmission,
            old: path.history().clone(),
            commands: path.history().commands.clone(),
            lacked: f64::INFINITY,
            length,
        }
    }

    pub fn tendons(&self) -> &Tendons {
        &self.transmission.tendons
    }

    /// Tensions before the base holes at the last balance of forces, N.
    pub fn last_tensions(&self) -> &[f64] {
        &self.old.tensions
    }

    /// Tension of a tendon now: of its stretch where friction leaves it the same all along, else
    /// that of the last balance of forces, N.
    pub fn tension(&self, i: usize) -> f64 {
        match self.tendons().tension_of_stretch(i) {
            Some(tension) if !self.transmission.friction.enabled => tension,
            _ => self.old.tensions[i],
        }
    }

    /// Displacement of a tendon now, m.
    pub fn displacement(&self, i: usize) -> f64 {
        self.tendons().displacement_now(i, &self.old)
    }

    /// Tension of a tendon's spans from base to tip at the last balance of forces, N; what a step
    /// that failed has left in the rod is not looked at.
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

    /// Whether a tendon is under displacement control and does not stretch.
    pub fn is_stiff(&self, i: usize) -> bool {
        self.commands[i].is_displacement() && self.tendons().tension_of_stretch(i).is_none()
    }

    /// Whether Newton's method on a step takes more work by this factor.
    pub fn work_factor(&self) -> usize {
        2 + self.transmission.unknowns.problem.size
    }

    /// Takes on the commands of a step: tensions where forces balance, displacements of its end.
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
        self.lacked = f64::INFINITY;
    }

    /// Friction and lengths at the present pose; the moment imbalance is made anew where friction
    /// changed it.
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
        let lacks = tendons.length_residual() / self.length;
        let better = lacks <= CONTRACTION * self.lacked;
        let stalls = lacks <= NEAR_LENGTH && !better;
        self.lacked = lacks;
        TendonCheck {
            settled: settled && (lacks <= LENGTH || stalls),
            better,
        }
    }

    /// A Newton step on tensions and strain; false if its equations are singular.
    /// `made`: the tangent is new.
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

    /// Directions that displacement control holds though the energy has no minimum there.
    pub fn held_directions(&mut self) -> usize {
        self.transmission.unknowns.problem.negative_eigenvalues()
    }

    /// Takes a pose at rest as one of the path, see [`Tendons::adopt`].
    pub fn adopt(&mut self, motion: &mut dyn Moving) {
        motion.measure_spans(false);
        self.transmission.tendons.adopt(motion);
    }

    /// Adds what the tendons did in the step that was finished to its energies.
    pub fn account(&self, motion: &mut dyn Moving) {
        let energies = self
            .tendons()
            .energies(motion, motion.energies().tendon_work);
        motion.energies_mut().account(&energies);
    }

    /// Takes the pose that was found as the start of the next step; returns the energy of tendons
    /// under displacement control, J.
    pub fn arrive(&mut self, motion: &dyn Moving) -> f64 {
        let tendons = &mut self.transmission.tendons;
        let energy = tendons.arrive(motion);
        self.old.copy_from(&tendons.now);
        self.slack.clone_from(&tendons.slack);
        energy
    }

    /// Lets displacements jump; returns the energy that motors put into the tendons at once, J.
    pub fn jump(&mut self, values: &[f64]) -> f64 {
        self.transmission.tendons.jump(values, &mut self.slack)
    }
}

//! Energies of a motion and their balance.

/// Energies and work, J.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Energies {
    /// Kinetic energy (J).
    pub kinetic: f64,
    /// Elastic energy of the backbone, and of displacement-controlled tendons (J).
    pub elastic: f64,
    /// Energy of weight (J): zero with all mass at the base.
    pub gravity: f64,
    /// Work of motors, tip load and forces on disks since the start (J).
    pub work: f64,
    /// Energy that physical damping, friction and tendons that become taut took since the start
    /// (J).
    pub dissipated: f64,
}

impl Energies {
    /// Stored energy less work, plus dissipation: constant but for numerical damping and error.
    pub fn left(&self) -> f64 {
        self.kinetic + self.elastic + self.gravity - self.work + self.dissipated
    }

    /// Scale that the balance is compared with, J.
    pub(crate) fn size(&self) -> f64 {
        self.kinetic + self.elastic + self.gravity.abs()
    }
}

/// Energies at both ends of a step, and what the step did.
#[derive(Default)]
pub(crate) struct EnergyBalance {
    pub now: Energies,
    pub next: Energies,
    /// Work of the tendons on the disks in the step, J.
    pub tendon_work: f64,
    /// Energy that a mass damping of 1/s would take in the step, J s.
    pub loss_by_rate: f64,
}

impl EnergyBalance {
    /// Puts energy in at once, J.
    pub fn put_in(&mut self, energy: f64) {
        self.now.elastic += energy;
        self.now.work += energy;
    }

    /// Adds what the tendons did in the step that was finished beside their work on the disks: their
    /// own energy, and work and loss since the start.
    pub fn account(&mut self, tendons: &Energies) {
        self.next.elastic += tendons.elastic;
        self.next.work += tendons.work;
        self.next.dissipated += tendons.dissipated;
    }
}

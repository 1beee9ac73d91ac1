//! Energies of a motion and their balance.
//!
//! Theory: docs/theory/dynamics.md (Energy).

/// Energies and work (J).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Energies {
    /// Kinetic energy (J).
    pub kinetic: f64,
    /// Elastic energy of the backbone and of displacement-controlled tendons (J).
    pub elastic: f64,
    /// Gravitational energy (J): zero with all mass at the base.
    pub gravity: f64,
    /// Work of motors, tip load and disk forces since the start (J).
    pub work: f64,
    /// Energy dissipated since the start (J) by physical damping, friction, and tendons that become
    /// taut.
    pub dissipated: f64,
}

impl Energies {
    /// Energy balance, theory Eq. 5.3: stored energy less work, plus dissipation. Constant except
    /// for numerical damping and error.
    pub fn left(&self) -> f64 {
        self.kinetic + self.elastic + self.gravity - self.work + self.dissipated
    }

    /// Scale of the energy balance (J).
    pub fn size(&self) -> f64 {
        self.kinetic + self.elastic + self.gravity.abs()
    }
}

/// Energies at both ends of a step, with work and loss in it.
#[derive(Default)]
pub struct EnergyBalance {
    pub now: Energies,
    pub next: Energies,
    /// Work of the tendons on the disks in the step (J).
    pub tendon_work: f64,
    /// Energy that a mass-proportional damping of 1/s would dissipate in the step (J s).
    pub loss_by_rate: f64,
}

impl EnergyBalance {
    /// Adds energy at once (J).
    pub fn put_in(&mut self, energy: f64) {
        self.now.elastic += energy;
        self.now.work += energy;
    }

    /// Adds the contribution of the tendons in the finished step, beyond their work on the disks:
    /// their elastic energy, and work and loss since the start.
    pub fn account(&mut self, tendons: &Energies) {
        self.next.elastic += tendons.elastic;
        self.next.work += tendons.work;
        self.next.dissipated += tendons.dissipated;
    }
}

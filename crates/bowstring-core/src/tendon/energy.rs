//! Elongation and energy of the tendons over a time step.
//!
//! Theory: docs/theory/dynamics.md (Tendons in motion).

use super::history::History;
use super::line::Command;
use super::tendons::Tendons;
use crate::rod::routed::RoutedRod;
use crate::step::Energies;

impl Tendons {
    /// Energies of the tendons in the time step that leads to the present pose (J): elastic energy
    /// of those under displacement control, and work of motors and loss in addition to the tendons'
    /// `work` on the robot.
    pub fn energies(&self, rod: &dyn RoutedRod, work: f64) -> Energies {
        let (mut before, mut after, mut motors) = (0.0, 0.0, 0.0);
        // numerical damping is not counted as dissipation
        let mut numerical = 0.0;
        let step = &self.step;
        for (i, command) in self.now.commands.iter().enumerate() {
            let lengths = rod.span_lengths();
            match *command {
                Command::Tension(t) => motors += t * (step.routed[i] - self.length_of(lengths, i)),
                Command::Displacement(p) => {
                    let elongation = self.elongation_at(lengths, i, p);
                    motors += self.now.tensions[i] * (p - step.counted[i]);
                    before += self.energy(i, step.elongation[i]);
                    after += self.energy(i, elongation);
                    if self.is_taut(i) && self.lines[i].friction == 0.0 {
                        let more = elongation - step.elongation[i];
                        numerical += (2.0 * step.share - 1.0) * self.energy(i, more.abs());
                    }
                }
            }
        }
        Energies {
            elastic: after,
            work: motors - work,
            dissipated: motors - work - (after - before) - numerical,
            ..Energies::default()
        }
    }

    /// Part of an elongation (m) that the tendon takes: slack takes the rest.
    fn taken(&self, i: usize, elongation: f64) -> f64 {
        f64::max(elongation, self.routing.least[i])
    }

    /// Elastic energy of a tendon at an elongation (J).
    fn energy(&self, i: usize, elongation: f64) -> f64 {
        let compliance = self.whole_compliance(i);
        if compliance > 0.0 && elongation > self.routing.least[i] {
            0.5 * elongation * elongation / compliance
        } else {
            0.0
        }
    }

    /// Tension from the elongation of a tendon at the end of the last step (N); `None` if it is
    /// inextensible.
    pub fn tension_from_elongation(&self, i: usize) -> Option<f64> {
        let compliance = self.whole_compliance(i);
        (compliance > 0.0).then(|| self.step.elongation[i] / compliance)
    }

    /// Sets displacements at once; returns the work of the motors in the jump (J).
    pub fn jump(&mut self, values: &[f64], slack: &mut [f64]) -> f64 {
        let mut energy = 0.0;
        for (i, to) in values.iter().enumerate() {
            if self.now.commands[i].is_displacement() {
                let elongation = self.step.routed[i] - self.home[i] + to - self.lost[i];
                let now = self.taken(i, elongation);
                energy += self.energy(i, now) - self.energy(i, self.step.elongation[i]);
                self.step.elongation[i] = now;
                if self.whole_compliance(i) > 0.0 {
                    slack[i] = now - elongation;
                }
                self.step.counted[i] = *to;
            }
        }
        energy
    }

    /// Present displacement of a tendon (m).
    pub fn displacement_now(&self, i: usize, old: &History) -> f64 {
        match self.now.commands[i] {
            Command::Displacement(_) => self.step.counted[i],
            Command::Tension(_) => old.displacements[i],
        }
    }

    /// Accepts a pose at rest, computed with another rod that is nearly identical, as one of this
    /// path: home lengths are shifted by the difference, so that no tendon jumps.
    pub fn adopt(&mut self, rod: &dyn RoutedRod) {
        self.measure(rod);
        for (i, slack) in self.slack.iter().enumerate() {
            if self.is_taut(i) {
                self.home[i] -= slack;
            }
        }
    }

    /// Ends a time step at the present pose; returns the energy of tendons under displacement
    /// control.
    pub fn arrive(&mut self, rod: &dyn RoutedRod) -> f64 {
        let mut energy = 0.0;
        for i in 0..self.lines.len() {
            let lengths = rod.span_lengths();
            let (elongation, slack) = match self.now.commands[i] {
                Command::Tension(_) => (0.0, 0.0),
                Command::Displacement(p) => {
                    let elongation = self.elongation_at(lengths, i, p);
                    self.step.counted[i] = p;
                    // the slack of a taut inextensible tendon is rounding
                    let stiff = self.whole_compliance(i) == 0.0;
                    let taken = self.taken(i, elongation);
                    let slack = if stiff && self.is_taut(i) {
                        0.0
                    } else {
                        taken - elongation
                    };
                    (taken, slack)
                }
            };
            self.step.routed[i] = self.length_of(lengths, i);
            (self.step.elongation[i], self.slack[i]) = (elongation, slack);
            energy += self.energy(i, elongation);
        }
        self.note_displacements();
        energy
    }
}

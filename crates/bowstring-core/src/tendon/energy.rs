//! Stretch and energy of the tendons over a step of time.

use super::history::History;
use super::line::Command;
use super::tendons::Tendons;
use crate::motion::Energies;
use crate::rod::routed::RoutedRod;

impl Tendons {
    /// What a step of time does to the tendons, the one that leads to the present pose: energy of
    /// those under displacement control, and what motors did and was lost beside the tendons' `work`
    /// on the robot, J.
    pub fn energies(&self, rod: &dyn RoutedRod, work: f64) -> Energies {
        let (mut before, mut after, mut motors) = (0.0, 0.0, 0.0);
        // what numerical damping takes is no loss
        let mut numerical = 0.0;
        let step = &self.step;
        for (i, command) in self.now.commands.iter().enumerate() {
            let lengths = rod.span_lengths();
            match *command {
                Command::Tension(t) => motors += t * (step.routed[i] - self.length_of(lengths, i)),
                Command::Displacement(p) => {
                    let stretched = self.stretch_at(lengths, i, p);
                    motors += self.now.tensions[i] * (p - step.counted[i]);
                    before += self.energy(i, step.stretched[i]);
                    after += self.energy(i, stretched);
                    if self.now.tensions[i] > 0.0 && self.lines[i].friction == 0.0 {
                        let more = stretched - step.stretched[i];
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

    /// Energy of a tendon that is stretched by a length.
    fn energy(&self, i: usize, stretched: f64) -> f64 {
        let compliance = self.whole_compliance(i);
        if compliance > 0.0 && stretched > 0.0 {
            0.5 * stretched * stretched / compliance
        } else {
            0.0
        }
    }

    /// Tension by the stretch of a tendon at the end of the last step, N; none where it does not
    /// stretch.
    pub fn tension_of_stretch(&self, i: usize) -> Option<f64> {
        let compliance = self.whole_compliance(i);
        (compliance > 0.0).then(|| self.step.stretched[i] / compliance)
    }

    /// Lets displacements jump; returns the energy that motors put into the tendons at once, J.
    pub fn jump(&mut self, values: &[f64], slack: &mut [f64]) -> f64 {
        let mut energy = 0.0;
        for (i, to) in values.iter().enumerate() {
            if self.now.commands[i].is_displacement() {
                let stretched = self.step.routed[i] - self.home[i] + to;
                let now = f64::max(stretched, 0.0);
                energy += self.energy(i, now) - self.energy(i, self.step.stretched[i]);
                self.step.stretched[i] = now;
                if self.whole_compliance(i) > 0.0 {
                    slack[i] = f64::max(-stretched, 0.0);
                }
                self.step.counted[i] = *to;
            }
        }
        energy
    }

    /// Displacement of a tendon now, m.
    pub fn displacement_now(&self, i: usize, old: &History) -> f64 {
        match self.now.commands[i] {
            Command::Displacement(_) => self.step.counted[i],
            Command::Tension(_) => old.displacements[i],
        }
    }

    /// Takes a pose at rest as one of this path, though it was found with another rod, which is all
    /// but the same: home shifts by the difference, so that no tendon jerks.
    pub fn adopt(&mut self, rod: &dyn RoutedRod) {
        self.measure(rod);
        for (i, slack) in self.slack.iter().enumerate() {
            if self.now.tensions[i] > 0.0 {
                self.home[i] -= slack;
            }
        }
    }

    /// Ends a step of time at the present pose; returns the energy of tendons under displacement
    /// control.
    pub fn arrive(&mut self, rod: &dyn RoutedRod) -> f64 {
        let mut energy = 0.0;
        for i in 0..self.lines.len() {
            let lengths = rod.span_lengths();
            let (stretched, slack) = match self.now.commands[i] {
                Command::Tension(_) => (0.0, 0.0),
                Command::Displacement(p) => {
                    let stretched = self.stretch_at(lengths, i, p);
                    self.step.counted[i] = p;
                    // the slack of a taut tendon that does not stretch is rounding
                    let stiff = self.whole_compliance(i) == 0.0;
                    let slack = if stiff && self.now.tensions[i] > 0.0 {
                        0.0
                    } else {
                        f64::max(-stretched, 0.0)
                    };
                    (f64::max(stretched, 0.0), slack)
                }
            };
            self.step.routed[i] = self.length_of(lengths, i);
            (self.step.stretched[i], self.slack[i]) = (stretched, slack);
            energy += self.energy(i, stretched);
        }
        self.note_displacements();
        energy
    }
}

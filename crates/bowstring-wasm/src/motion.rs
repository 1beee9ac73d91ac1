//! Motion on release.

use crate::loads::Loads;
use bowstring_core::dynamics::integrator::{Fields, Simulator, Stop};

/// Points of the backbone in a module.
pub const POINTS: usize = 5;

/// A motion whose commands and loads change linearly and then stay.
pub struct Motion {
    simulator: Simulator,
    from: (Vec<f64>, Loads),
    to: (Vec<f64>, Loads),
    rise: f64,
    fields: Fields,
}

impl Motion {
    /// From rest under commands and loads to others, which they reach after the rise time (s).
    pub fn new(
        mut simulator: Simulator,
        from: (Vec<f64>, Loads),
        to: (Vec<f64>, Loads),
        rise: f64,
    ) -> Result<Self, String> {
        if rise == 0.0 {
            let (commands, loads) = &to;
            let jumped = simulator.jump(&loads.with(commands));
            jumped.map_err(|error| error.to_string())?;
        }
        let mut fields = Fields::default();
        simulator.record(POINTS, &mut fields);
        Ok(Motion {
            simulator,
            from,
            to,
            rise,
            fields,
        })
    }

    pub fn fields(&self) -> &Fields {
        &self.fields
    }

    /// Commands and loads at a time (s) since the release.
    fn at(&self, time: f64) -> (Vec<f64>, Loads) {
        let share = match self.rise > 0.0 {
            true => (time / self.rise).min(1.0),
            false => 1.0,
        };
        let between = |a: f64, b: f64| a + (b - a) * share;
        let three = |a: [f64; 3], b: [f64; 3]| std::array::from_fn(|q| between(a[q], b[q]));
        let ((commands, loads), (last, end)) = (&self.from, &self.to);
        let commands = commands.iter().zip(last).map(|(a, b)| between(*a, *b));
        let loads = Loads {
            gravity: loads.gravity,
            force: three(loads.force, end.force),
            moment: three(loads.moment, end.moment),
        };
        (commands.collect(), loads)
    }

    /// Advances the motion; the sentence says why it stopped, and is empty where it did not.
    pub fn advance(&mut self, duration: f64) -> Result<String, String> {
        if !(duration >= 0.0 && duration.is_finite()) {
            return Err(format!(
                "the duration is {duration} s; it must be zero or more seconds"
            ));
        }
        let end = self.simulator.time() + duration;
        // the load is linear in time only before and after the end of the rise
        let bend = self.rise.clamp(self.simulator.time(), end);
        for time in [bend, end] {
            let duration = time - self.simulator.time();
            if duration <= 0.0 {
                continue;
            }
            let (commands, loads) = self.at(time);
            let moved = self.simulator.advance(duration, &loads.with(&commands));
            let (stop, _) = moved.map_err(|error| error.to_string())?;
            if let Some(stop) = stop {
                return Ok(match stop {
                    Stop::StepFailed => "the motion stopped: a time step did not converge",
                    Stop::Collision => "the motion stopped: two disks collided",
                }
                .into());
            }
        }
        self.fields.clear();
        self.simulator.record(POINTS, &mut self.fields);
        Ok(String::new())
    }

    pub fn kinetic_energy(&self) -> f64 {
        self.simulator.energies().kinetic
    }
}

//! Motion on release.

use crate::bench::{Bench, Loads, POINTS};
use bowstring_core::dynamics::integrator::{Fields, Simulator, Stop};
use bowstring_core::statics::path::Command;

/// A motion whose commands and loads change linearly and then stay.
pub struct Motion {
    simulator: Simulator,
    from: (Vec<f64>, Loads),
    to: (Vec<f64>, Loads),
    rise: f64,
    fields: Fields,
}

impl Motion {
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
}

impl Bench {
    /// Starts a motion from the last equilibrium towards other commands and loads; gravity stays.
    pub fn release(
        &mut self,
        commands: &[f64],
        loads: &Loads,
        rise: f64,
        damping: f64,
    ) -> Result<(), String> {
        self.motion = None;
        if !(rise >= 0.0 && rise.is_finite()) {
            return Err(format!("the rise time is {rise} s; it must be 0 or more"));
        }
        let history = self.path().history();
        let load = &history.load;
        let before = Loads {
            gravity: load.gravity,
            force: load.tip_force,
            moment: load.tip_moment,
        };
        let values: Vec<_> = history.commands.iter().map(Command::value).collect();
        if commands.len() != values.len() {
            return Err(format!(
                "{} commands, and the robot has {} tendons",
                commands.len(),
                values.len()
            ));
        }
        let mut simulator = self.at_rest(before.gravity, damping)?;
        if rise == 0.0 {
            let jumped = simulator.jump(&loads.with(commands));
            jumped.map_err(|error| error.to_string())?;
        }
        let mut fields = Fields::default();
        simulator.record(POINTS, &mut fields);
        self.motion = Some(Motion {
            simulator,
            from: (values, before),
            to: (commands.to_vec(), *loads),
            rise,
            fields,
        });
        Ok(())
    }

    /// Advances the motion; the sentence says why it stopped, and is empty where it did not.
    pub fn advance(&mut self, duration: f64) -> Result<String, String> {
        let Some(motion) = &mut self.motion else {
            return Err("nothing moves: release the robot first".into());
        };
        if !(duration >= 0.0 && duration.is_finite()) {
            return Err(format!(
                "the duration is {duration} s; it must be zero or more seconds"
            ));
        }
        let end = motion.simulator.time() + duration;
        // the load is linear in time only before and after the end of the rise
        let bend = motion.rise.clamp(motion.simulator.time(), end);
        for time in [bend, end] {
            let duration = time - motion.simulator.time();
            if duration <= 0.0 {
                continue;
            }
            let (commands, loads) = motion.at(time);
            let moved = motion.simulator.advance(duration, &loads.with(&commands));
            let (stop, _) = moved.map_err(|error| error.to_string())?;
            if let Some(stop) = stop {
                return Ok(match stop {
                    Stop::StepFailed => "the motion stopped: a time step did not converge",
                    Stop::Collision => "the motion stopped: two disks collided",
                }
                .into());
            }
        }
        motion.fields.clear();
        motion.simulator.record(POINTS, &mut motion.fields);
        Ok(String::new())
    }

    pub fn kinetic_energy(&self) -> f64 {
        let motion = self.motion.as_ref();
        motion.map_or(0.0, |motion| motion.simulator.energies().kinetic)
    }
}

//! Linear viscoelasticity along a path: relaxation of the backbone and creep of the tendons, each a
//! standard linear solid with up to two time constants.
//!
//! Theory: docs/theory/actuation.md (Relaxation and creep).

use crate::model::error::InputError;
pub use crate::tendon::TERMS;
use crate::tendon::{History, Tendons};

/// Relaxation of the backbone of one segment at constant curvature, by one time constant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Relaxation {
    /// Share of the bending stiffness that relaxes; zero if elastic.
    pub share: f64,
    /// Time constant (s).
    pub time: f64,
}

impl Default for Relaxation {
    fn default() -> Self {
        Relaxation {
            share: 0.0,
            time: 1.0,
        }
    }
}

impl Relaxation {
    pub(crate) fn check(&self) -> Result<(), InputError> {
        if (0.0..1.0).contains(&self.share) && is_time(self.time) {
            return Ok(());
        }
        Err(InputError::other(format!(
            "relaxation has share {} and time {} s; the share must be >= 0 and < 1, the time finite and > 0 s",
            self.share, self.time
        )))
    }
}

/// Creep of one tendon at constant tension, by one time constant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Creep {
    /// Compliance that comes with time (m/N); zero if elastic.
    pub compliance: f64,
    /// Time constant (s).
    pub time: f64,
}

impl Default for Creep {
    fn default() -> Self {
        Creep {
            compliance: 0.0,
            time: 1.0,
        }
    }
}

impl Creep {
    pub(crate) fn check(&self) -> Result<(), InputError> {
        let compliance = self.compliance >= 0.0 && self.compliance.is_finite();
        if compliance && is_time(self.time) {
            return Ok(());
        }
        Err(InputError::other(format!(
            "creep has compliance {} m/N and time {} s; the compliance must be finite and >= 0 m/N, the time finite and > 0 s",
            self.compliance, self.time
        )))
    }
}

fn is_time(time: f64) -> bool {
    time > 0.0 && time.is_finite()
}

/// First-order lag over a step: weights of its state before the step and of the followed value at
/// the start and at the end, exact for a value that is linear in time.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Lag {
    pub kept: f64,
    pub start: f64,
    pub end: f64,
}

impl Lag {
    pub fn over(duration: f64, time: f64) -> Self {
        let x = duration / time;
        let kept = (-x).exp();
        let mean = if x == 0.0 { 1.0 } else { -(-x).exp_m1() / x };
        Lag {
            kept,
            start: mean - kept,
            end: 1.0 - mean,
        }
    }

    /// State at the end of the step, without the part of the followed value there.
    pub fn carried(&self, state: f64, start: f64) -> f64 {
        self.kept * state + self.start * start
    }
}

/// Tendons that creep.
#[derive(Clone)]
pub(crate) struct CreepingTendons {
    laws: Vec<[Creep; TERMS]>,
    /// Unstretched lengths (m) and compliances before the base hole (m/N) without creep.
    home: Vec<f64>,
    before: Vec<f64>,
    /// Elongation by creep at the end of the step (m), without the part of the tension there, and
    /// the compliance of that part (m/N), by terms.
    carried: Vec<[f64; TERMS]>,
    now: Vec<[f64; TERMS]>,
}

impl CreepingTendons {
    /// The terms of each tendon; `None` if all are elastic.
    pub fn new(tendons: &Tendons, laws: &[[Creep; TERMS]]) -> Result<Option<Self>, InputError> {
        laws.as_flattened().iter().try_for_each(Creep::check)?;
        if laws.as_flattened().iter().all(|law| law.compliance == 0.0) {
            return Ok(None);
        }
        let count = tendons.lines.len();
        if laws.len() != count {
            return Err(InputError::other(format!(
                "{} laws of creep were given, a robot with {count} tendons needs one for each",
                laws.len(),
            )));
        }
        Ok(Some(CreepingTendons {
            laws: laws.to_vec(),
            home: tendons.home.clone(),
            before: tendons.compliance.before.clone(),
            carried: vec![[0.0; TERMS]; count],
            now: vec![[0.0; TERMS]; count],
        }))
    }

    /// Sets lengths and compliances for a step from `old`.
    pub fn begin(&mut self, tendons: &mut Tendons, old: &History, duration: f64) {
        for (i, laws) in self.laws.iter().enumerate() {
            for (term, law) in laws.iter().enumerate() {
                let lag = Lag::over(duration, law.time);
                let at_start = law.compliance * old.tensions[i];
                self.now[i][term] = lag.end * law.compliance;
                self.carried[i][term] = lag.carried(old.crept[i][term], at_start);
            }
            tendons.home[i] = self.home[i] + self.carried[i].iter().sum::<f64>();
            tendons.compliance.before[i] = self.before[i] + self.now[i].iter().sum::<f64>();
        }
    }

    /// Stores the elongations at the end of a step.
    pub fn finish(&self, now: &mut History) {
        for (i, crept) in now.crept.iter_mut().enumerate() {
            for (term, crept) in crept.iter_mut().enumerate() {
                *crept = self.carried[i][term] + self.now[i][term] * now.tensions[i];
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_lag_is_exact_for_a_value_linear_in_time() {
        // v' = (u - v) / tau with u = 2 + 3 t and v(0) = 5
        let (tau, t) = (0.7_f64, 1.3_f64);
        let particular = |t: f64| 2.0 + 3.0 * (t - tau);
        let exact = particular(t) + (5.0 - particular(0.0)) * (-t / tau).exp();
        let lag = Lag::over(t, tau);
        let found = lag.kept * 5.0 + lag.start * 2.0 + lag.end * (2.0 + 3.0 * t);
        assert!((found - exact).abs() < 1e-14);
        // in halves it is the same
        let half = Lag::over(0.5 * t, tau);
        let middle = half.kept * 5.0 + half.start * 2.0 + half.end * (2.0 + 1.5 * t);
        let twice = half.kept * middle + half.start * (2.0 + 1.5 * t) + half.end * (2.0 + 3.0 * t);
        assert!((twice - exact).abs() < 1e-14);
    }

    #[test]
    fn a_lag_over_no_time_keeps_its_state_and_over_all_time_follows() {
        let none = Lag::over(0.0, 1.0);
        assert_eq!((none.kept, none.start, none.end), (1.0, 0.0, 0.0));
        let long = Lag::over(1e12, 1.0);
        assert!(long.kept == 0.0 && (long.start + long.end - 1.0).abs() < 1e-15);
        assert!(long.end > 1.0 - 1e-11);
    }

    #[test]
    fn a_law_out_of_range_is_refused() {
        for (share, time) in [(1.0, 1.0), (-0.1, 1.0), (0.1, 0.0), (0.1, f64::NAN)] {
            assert!(Relaxation { share, time }.check().is_err());
        }
        for (compliance, time) in [(-1e-6, 1.0), (f64::INFINITY, 1.0), (1e-6, -1.0)] {
            assert!(Creep { compliance, time }.check().is_err());
        }
    }
}

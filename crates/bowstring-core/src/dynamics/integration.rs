//! Time integration over one interval: predictor, Newton's method, step control and balance of
//! energy.
//!
//! Theory: docs/theory/dynamics.md.

use super::actuation::Actuation;
use super::newton::{self, Problem, Tolerances};
use super::settings::{Count, Integrator, Step, Stop};
use crate::interrupt;
use crate::model::load::{BaseMotion, Load, OwnedLoad, PointLoad};
use crate::model::robot::Robot;
use crate::statics::solver;
use crate::step::{Energies, Moving, StepError};

// Tuned constants of a step. Moments are over (bending stiffness / length).

/// Largest moment imbalance of a converged step: with numerical damping, and without it, where
/// errors of energy accumulate.
const TOLERANCE: f64 = 1e-6;
const UNDAMPED_TOLERANCE: f64 = 1e-7;
/// Fraction of a step's estimated error that an imbalance may add to it, and the largest such
/// imbalance: a step need not be solved more accurately than the time integration is. Used only
/// with numerical damping and under tension control.
const SHARE_OF_ERROR: f64 = 5e-3;
const LOOSEST: f64 = 1e-4;
/// Shortest step after cuts, over the longest step.
const MOST_CUTS: f64 = 1e-6;
/// Largest relative rounding error of a step's forces at which integration goes on.
const MAX_NOISE: f64 = 1e-4;
/// Negligible fraction of the interval, and fraction by which a step may be longer to reach the
/// end.
const NEGLIGIBLE_TIME: f64 = 1e-12;
const LONGER: f64 = 1e-4;
/// Most steps in one interval, repeated steps included: enough for minutes of a stiff robot.
const MOST_STEPS: usize = 2_000_000;

// Balance of energy. Energies are over the largest so far.

/// Energy gain above which a step is repeated without numerical damping, whose scheme conserves
/// energy; and gain above which it is cut.
const UNDAMPED_GROWTH: f64 = 1e-3;
const MOST_GROWTH: f64 = 5e-2;
/// Without numerical damping: tolerance of the energy balance, and how often a step is solved again
/// to meet it.
const ENERGY_TOLERANCE: f64 = 1e-5;
const MAX_RESTORATIONS: usize = 3;

// Step control by the estimated error, which is of third order in the step.

/// Safety factor of the estimated error of a run: errors of steps add up, but each also leaves an
/// error in the velocity, which shows a quarter of an oscillation later.
const ERROR_MARGIN: f64 = 3.0;
/// Safety factor of a new step; ratio of error to tolerance above which a step is repeated; bounds
/// of the factor to the next step, and of the factor to a repeated step.
const SAFETY: f64 = 0.9;
const REPEATED: f64 = 2.0;
const FACTORS: [f64; 2] = [0.5, 2.0];
const LEAST_REPEATED_FACTOR: f64 = 0.2;
/// Range of factors at which the step stays the same: steps of one length share the tangent.
const SAME_STEP: std::ops::Range<f64> = 0.85..1.4;

/// Limits of a step for a robot.
struct Limits {
    /// Tolerances of the moment imbalance of a step and of an equilibrium, and the largest that the
    /// error of a step permits (N m).
    step: f64,
    at_rest: f64,
    loosest: f64,
    /// Step below which rounding would hide the motion (s).
    shortest: f64,
}

/// Load over the interval, with displacements in place of the tensions of displacement-controlled
/// tendons.
struct LoadRamp {
    from: OwnedLoad,
    to: OwnedLoad,
    /// Motion of the base at one and two thirds of the interval; `None` where it is linear.
    base: Option<[BaseMotion; 2]>,
    /// Load where forces balance, and load at the end of the step.
    between: OwnedLoad,
    end: OwnedLoad,
}

impl LoadRamp {
    /// Computes the load where forces balance, at a fraction of the interval.
    fn balance_at(&mut self, fraction: f64) {
        self.between.between(&self.from, &self.to, fraction);
        if let Some([first, second]) = self.base {
            let points = [self.from.base, first, second, self.to.base];
            self.between.base = through(&points, fraction);
        }
    }
}

/// Motion of the base by the cubic through four points that are equally far apart, at a fraction of
/// the way from the first to the last.
fn through(points: &[BaseMotion; 4], fraction: f64) -> BaseMotion {
    let [a, b, c] = [3.0 * fraction - 1.0, 3.0 * fraction - 2.0, fraction - 1.0];
    let weights = [
        -a * b * c / 2.0,
        4.5 * fraction * b * c,
        -4.5 * fraction * a * c,
        fraction * a * b / 2.0,
    ];
    let sum = |part: fn(&BaseMotion) -> [f64; 3]| {
        [0, 1, 2].map(|q| (0..4).map(|i| weights[i] * part(&points[i])[q]).sum())
    };
    BaseMotion {
        acceleration: sum(|base| base.acceleration),
        angular_velocity: sum(|base| base.angular_velocity),
        angular_acceleration: sum(|base| base.angular_acceleration),
    }
}

/// Energy since the last jump of the load (J).
#[derive(Default)]
struct EnergyMonitor {
    /// Energy balance at the jump, and its minimum since.
    start: f64,
    least: f64,
    /// Largest energy so far.
    largest: f64,
}

/// Integration of one interval.
pub(super) struct Integration {
    step: Step,
    spectral_radius: f64,
    limits: Limits,
    ramp: LoadRamp,
    /// Actuation through tendon lines; `None` where tensions act directly.
    pub actuation: Option<Actuation>,
    /// Step to try next (s).
    pub next: f64,
    /// Estimated error of the last step.
    error: Option<StepError>,
    /// Number of directly preceding steps whose error is not known.
    unknown: usize,
    energy: EnergyMonitor,
    pub count: Count,
    /// Completed part of the interval (s).
    elapsed: f64,
}

/// Kind of equilibrium to find.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum Equilibrium {
    /// Under the present tensions, which are already in equilibrium.
    Given,
    /// Under the load.
    Loaded,
}

/// Decision on a step.
enum Verdict {
    Accept(Option<StepError>),
    /// Repeat without numerical damping.
    Undamped,
    /// Repeat with half the length.
    Cut,
    /// Repeat with this length (s).
    Shorten(f64),
    Collide,
}

impl EnergyMonitor {
    fn of(energies: &Energies) -> Self {
        EnergyMonitor {
            start: energies.left(),
            least: energies.left(),
            largest: energies.size(),
        }
    }

    fn take(&mut self, energies: &Energies) {
        self.least = f64::min(self.least, energies.left());
        self.largest = f64::max(self.largest, energies.size());
    }
}

/// Shortest step of a robot (s): 2 / h^2 times mass times length is the largest force that is
/// resolved in rounding.
pub(super) fn shortest_step(robot: &Robot) -> f64 {
    let size = 8.0 * f64::EPSILON * robot.mass() * robot.length().powi(2);
    (size / (MAX_NOISE * robot.moment_scale())).sqrt()
}

impl Integration {
    pub fn new(robot: &Robot, settings: &Integrator) -> Self {
        let scale = robot.moment_scale();
        let (tolerance, loosest) = match settings.spectral_radius {
            1.0 => (UNDAMPED_TOLERANCE, 0.0),
            _ => (TOLERANCE, LOOSEST),
        };
        let forces = OwnedLoad {
            tensions: vec![0.0; robot.tendon_count()],
            ..OwnedLoad::default()
        };
        Integration {
            step: settings.step,
            spectral_radius: settings.spectral_radius,
            limits: Limits {
                step: tolerance * scale,
                at_rest: solver::TOLERANCE * scale,
                loosest: loosest * scale,
                shortest: shortest_step(robot),
            },
            ramp: LoadRamp {
                from: forces.clone(),
                to: forces.clone(),
                base: None,
                between: forces.clone(),
                end: forces,
            },
            actuation: None,
            next: 0.0,
            error: None,
            unknown: 0,
            energy: EnergyMonitor::default(),
            count: Count::default(),
            elapsed: 0.0,
        }
    }

    /// Sets the load at once.
    pub fn set_load(&mut self, load: &Load) {
        self.ramp.to.set(load);
    }

    /// Present tensions and displacements.
    pub fn values(&self) -> &[f64] {
        &self.ramp.to.tensions
    }

    /// Present point loads.
    pub fn point_loads(&self) -> &[PointLoad] {
        &self.ramp.to.point_loads
    }

    /// Discards the steps so far: after a jump, or at rest.
    pub fn restart(&mut self, energies: &Energies) {
        self.energy = EnergyMonitor::of(energies);
        self.error = None;
        self.next = self.step.first();
    }

    /// Finds an equilibrium; `None` if there is none, otherwise whether it is a minimum of the
    /// energy.
    pub fn settle(&mut self, motion: &mut dyn Moving, which: Equilibrium) -> Option<bool> {
        self.ramp.from = self.ramp.to.clone();
        self.ramp.base = None;
        motion.begin_at_rest();
        self.set_loads(motion, 1.0, 1.0, 1.0);
        let tolerances = self.tolerances(motion, self.limits.at_rest, self.limits.at_rest);
        let actuation = self.actuation.as_mut();
        let actuation = actuation.filter(|_| which == Equilibrium::Loaded);
        let (problem, iterations) = (Problem::Equilibrium, &mut 0);
        let found = newton::solve(motion, actuation, tolerances, problem, iterations);
        if interrupt::interrupted() {
            return None;
        }
        let (mut tendons, mut held) = (0.0, 0);
        if let Some(actuation) = &mut self.actuation {
            match which {
                Equilibrium::Given => actuation.adopt(motion),
                Equilibrium::Loaded => held = actuation.held_directions(),
            }
            tendons = actuation.arrive(motion);
        }
        motion.commit_at_rest(tendons);
        found.then(|| motion.is_stable(held))
    }

    /// Advances by `duration` while the load changes linearly to the given one, and the motion of the
    /// base through `base` at one and two thirds; returns the time advanced (s) and the reason for an
    /// early stop.
    pub fn advance(
        &mut self,
        motion: &mut dyn Moving,
        duration: f64,
        load: &Load,
        base: Option<[BaseMotion; 2]>,
    ) -> (f64, Option<Stop>) {
        std::mem::swap(&mut self.ramp.from, &mut self.ramp.to);
        self.ramp.to.set(load);
        self.ramp.base = base;
        self.count = Count::default();
        self.elapsed = 0.0;
        let stop = self.integrate(motion, duration);
        if stop.is_none() {
            return (duration, None);
        }
        // zero duration: there is no step to fail
        let ramp = &mut self.ramp;
        ramp.end
            .between(&ramp.from, &ramp.to, self.elapsed / duration);
        std::mem::swap(&mut ramp.to, &mut ramp.end);
        (self.elapsed, stop)
    }

    /// Steps to the end of the interval.
    fn integrate(&mut self, motion: &mut dyn Moving, duration: f64) -> Option<Stop> {
        let mut problem = Problem::Step;
        while self.elapsed < duration * (1.0 - NEGLIGIBLE_TIME) {
            if self.count.steps + self.count.repeated > MOST_STEPS {
                return Some(Stop::StepFailed);
            }
            let step = self.begin(motion, duration);
            let tolerances = self.step_tolerances(motion);
            let solved = self.solve(motion, tolerances, problem);
            if interrupt::interrupted() {
                return Some(Stop::StepFailed);
            }
            self.error = None;
            let verdict = self.judge(motion, step, solved, tolerances);
            let cut = matches!(verdict, Verdict::Cut);
            match verdict {
                Verdict::Accept(error) => {
                    self.accept(motion, step, error);
                    problem = Problem::Step;
                    continue;
                }
                Verdict::Undamped => motion.restart(),
                Verdict::Shorten(next) => self.next = next,
                Verdict::Cut => {
                    motion.reset_predictor();
                    problem = Problem::CutStep;
                    self.next = step / 2.0;
                }
                Verdict::Collide => return Some(Stop::Collision),
            }
            self.count.repeated += 1;
            let least = f64::max(self.step.longest() * MOST_CUTS, self.limits.shortest);
            if cut && self.next < least {
                return Some(Stop::StepFailed);
            }
        }
        None
    }

    /// Starts a step: predictor and loads. Returns its length, chosen so that equal steps reach the
    /// end.
    fn begin(&mut self, motion: &mut dyn Moving, duration: f64) -> f64 {
        let remaining = duration - self.elapsed;
        let step = remaining / (remaining / self.next - LONGER).ceil().max(1.0);
        motion.begin(step, self.spectral_radius);
        let share = motion.balance_time();
        let fraction = (self.elapsed + share * step) / duration;
        let end = (self.elapsed + step) / duration;
        self.set_loads(motion, fraction, end, share);
        step
    }

    /// Sets the loads where forces balance and at the end of the step, as fractions of the ramp.
    fn set_loads(&mut self, motion: &mut dyn Moving, fraction: f64, end: f64, share: f64) {
        let ramp = &mut self.ramp;
        ramp.balance_at(fraction);
        motion.set_load(&ramp.between.borrow());
        if let Some(actuation) = &mut self.actuation {
            ramp.end.between(&ramp.from, &ramp.to, end);
            actuation.begin(motion, &ramp.between.tensions, &ramp.end.tensions, share);
        }
    }

    fn solve(&mut self, motion: &mut dyn Moving, to: Tolerances, problem: Problem) -> bool {
        let actuation = self.actuation.as_mut();
        newton::solve(motion, actuation, to, problem, &mut self.count.iterations)
    }

    /// Tolerances of the present step, from the error of the step before.
    fn step_tolerances(&self, motion: &dyn Moving) -> Tolerances {
        let tight = self.limits.step;
        let loose = match &self.error {
            Some(error) if self.actuation.is_none() => {
                let left = motion.effort(SHARE_OF_ERROR * error.largest);
                f64::max(tight, f64::min(left, self.limits.loosest))
            }
            _ => tight,
        };
        self.tolerances(motion, tight, loose)
    }

    /// Tolerances no tighter than rounding allows.
    fn tolerances(&self, motion: &dyn Moving, predicted: f64, corrected: f64) -> Tolerances {
        let noise = motion.noise(match &self.actuation {
            Some(actuation) => actuation.last_tensions(),
            None => &self.ramp.between.tensions,
        });
        Tolerances {
            predicted: f64::max(predicted, noise),
            corrected: f64::max(corrected, noise),
        }
    }

    /// Decides by energy and error whether a step is accepted, and how it is repeated if not.
    fn judge(
        &mut self,
        motion: &mut dyn Moving,
        step: f64,
        solved: bool,
        tolerances: Tolerances,
    ) -> Verdict {
        if !solved {
            return Verdict::Cut;
        }
        self.finish(motion);
        let restored = self.spectral_radius < 1.0 || self.restore_energy(motion, tolerances);
        let grown = motion.energies().next.left() - self.energy.least;
        let size = self.size(motion);
        if !motion.is_fresh() && self.spectral_radius < 1.0 && grown > UNDAMPED_GROWTH * size {
            return Verdict::Undamped;
        }
        // a NaN fails this test
        if !(restored && grown <= MOST_GROWTH * size) {
            return Verdict::Cut;
        }
        let error = motion.local_error().filter(|e| e.largest.is_finite());
        if let (Step::Adaptive { tolerance, .. }, Some(error)) = (self.step, &error) {
            if error.largest > REPEATED * tolerance && step > self.limits.shortest {
                let factor = SAFETY * (tolerance / error.largest).cbrt();
                let shorter = step * f64::max(factor, LEAST_REPEATED_FACTOR);
                return Verdict::Shorten(f64::max(shorter, self.limits.shortest));
            }
        }
        if !motion.is_apart() {
            return Verdict::Collide;
        }
        Verdict::Accept(error)
    }

    /// Computes the energies at the end of a converged step.
    fn finish(&self, motion: &mut dyn Moving) {
        motion.finish(&self.ramp.between.borrow());
        if let Some(actuation) = &self.actuation {
            actuation.account(motion);
        }
    }

    /// Largest energy so far, the end of the step included (J).
    fn size(&self, motion: &dyn Moving) -> f64 {
        f64::max(self.energy.largest, motion.energies().next.size())
    }

    /// Solves a step without numerical damping again until its energy is conserved
    /// (theory Eq. 5.3); false where that fails.
    fn restore_energy(&mut self, motion: &mut dyn Moving, tolerances: Tolerances) -> bool {
        // at least one iteration: the restoring force may be below the tolerance
        let again = Tolerances {
            predicted: 0.0,
            ..tolerances
        };
        for _ in 0..MAX_RESTORATIONS {
            let excess = motion.energies().next.left() - self.energy.start;
            if excess.abs() <= ENERGY_TOLERANCE * self.size(motion) || !motion.restore(excess) {
                break;
            }
            if !self.solve(motion, again, Problem::Step) {
                return false;
            }
            self.finish(motion);
        }
        true
    }

    /// Takes the end of a step as the start of the next.
    fn accept(&mut self, motion: &mut dyn Moving, step: f64, error: Option<StepError>) {
        if let Some(actuation) = &mut self.actuation {
            actuation.arrive(motion);
        }
        motion.commit();
        self.error = error;
        // steps with unknown error are attributed the next one's
        self.unknown += 1;
        if let Some(error) = &error {
            self.count.error += ERROR_MARGIN * error.tip * self.unknown as f64;
            self.unknown = 0;
        }
        self.energy.take(&motion.energies().now);
        self.elapsed += step;
        self.count.steps += 1;
        self.next = self.next_step(step);
    }

    /// Length of the step after an accepted one.
    fn next_step(&self, step: f64) -> f64 {
        match self.step {
            // cut steps grow back
            Step::Fixed(longest) => f64::min(2.0 * self.next, longest),
            Step::Adaptive { tolerance, longest } => {
                let factor = self.error.as_ref().map_or(1.0, |error| {
                    (SAFETY * (tolerance / error.largest).cbrt()).clamp(FACTORS[0], FACTORS[1])
                });
                let keep = SAME_STEP.contains(&factor);
                f64::min(if keep { step } else { step * factor }, longest)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cubic_motion_of_the_base_is_met() {
        let at = |s: f64| BaseMotion {
            acceleration: [1.0 - 3.0 * s + 2.0 * s.powi(3), s, 2.0],
            angular_velocity: [s * s, 0.0, -s],
            angular_acceleration: [4.0, s.powi(3), 1.0 - s * s],
        };
        let parts = |base: BaseMotion| {
            let BaseMotion {
                acceleration,
                angular_velocity,
                angular_acceleration,
            } = base;
            [acceleration, angular_velocity, angular_acceleration]
        };
        let points = [0.0, 1.0 / 3.0, 2.0 / 3.0, 1.0].map(at);
        for s in [0.0, 0.1, 1.0 / 3.0, 0.77, 1.0] {
            let (found, exact) = (parts(through(&points, s)), parts(at(s)));
            for (a, b) in found.iter().flatten().zip(exact.iter().flatten()) {
                assert!((a - b).abs() < 1e-14, "{a} {b} at {s}");
            }
        }
    }
}

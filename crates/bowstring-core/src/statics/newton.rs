//! Newton's method on the strain: on the energy where it exists, otherwise on the residual.
//!
//! Theory: docs/theory/statics.md (Globalisation).

use crate::criteria::{
    is_minimum_nearby, keeps_tangent, ENERGY_NOISE, MAX_STEP, SUFFICIENT_DECREASE, TOLERANCE,
};
use crate::dispatch::Passes;
use crate::interrupt;
use crate::math::linalg::Vec3;
use crate::outcome::{Outcome, Settings};
use crate::rod::newton_step::Step;

/// Most Newton steps for a load.
pub(super) const MAX_ITERATIONS: usize = 200;
/// Most Newton steps on the residual for one load.
const MAX_RESIDUAL_STEPS: usize = 40;
/// Most step halvings: a decrease at a millionth of the step is lost in rounding.
const MAX_HALVINGS: usize = 20;
/// Required relative decrease of the residual in a shortened step, over its fraction; and the least
/// fraction.
const RESIDUAL_DECREASE: f64 = 1e-3;
/// Factor by which the residual may grow in a full step.
const RESIDUAL_GROWTH: f64 = 2.0;
/// Most times that the shift is quadrupled in search of a minimum.
const MAX_SHIFTS: usize = 40;
/// Most attempts to leave unstable equilibria.
const MAX_ESCAPES: usize = 4;
/// Least pivot of a minimum over the unit of the shift; a smaller one is lost in rounding.
pub(super) const LEAST_PIVOT: f64 = 1e-12;

/// Result of one attempt at a load.
pub(super) enum Attempt {
    Converged {
        stable: Option<bool>,
        collision: Option<usize>,
    },
    Saddle,
    Stuck,
}

impl Attempt {
    pub fn is_sound(&self) -> bool {
        matches!(
            self,
            Attempt::Converged {
                collision: None,
                ..
            }
        )
    }
}

fn converged(rod: &mut dyn Passes, stable: Option<bool>) -> Attempt {
    rod.finish();
    Attempt::Converged {
        stable,
        collision: rod.collision(),
    }
}

/// Newton's method from the present strain of the rod.
pub(super) fn newton(rod: &mut dyn Passes, settings: &Settings, outcome: &mut Outcome) -> Attempt {
    if rod.has_potential() {
        newton_on_energy(rod, settings, outcome)
    } else {
        newton_on_residual(rod, settings, outcome)
    }
}

/// Minimises the energy: a diagonal shift until all pivots are positive, and a backtracking line
/// search.
fn newton_on_energy(rod: &mut dyn Passes, settings: &Settings, outcome: &mut Outcome) -> Attempt {
    let unit = settings.shift_unit;
    let mut energy = rod.evaluate();
    if !energy.is_finite() {
        return Attempt::Stuck;
    }
    let mut shift = 0.0;
    let mut escapes = 0;
    // large terms nearly cancel in the energy
    let noise = ENERGY_NOISE * (rod.energy_scale(settings.length) + energy.abs());
    let stiffening = rod.energy_scale(settings.length) / rod.module_count() as f64;
    // the last elimination still determines the inertia if the steps after it were short
    let mut minimum_nearby = false;
    // least pivot of the last elimination, and rotation added by an arc since then (rad)
    let (mut pivot, mut moved) = (0.0, 0.0);
    let mut last_residual = 0.0;
    loop {
        if interrupt::work(settings.work) {
            return Attempt::Stuck;
        }
        outcome.residual = rod.gradient() / settings.moment_scale;
        if outcome.residual <= TOLERANCE {
            if minimum_nearby {
                return converged(rod, Some(true));
            }
            rod.linearise();
            let pivot = rod.eliminate(true, 0.0);
            if pivot.is_nan() {
                return Attempt::Stuck;
            }
            // a pivot at the level of rounding does not prove a minimum
            if pivot > LEAST_PIVOT * unit {
                return converged(rod, Some(true));
            }
            if escapes == MAX_ESCAPES {
                return Attempt::Saddle;
            }
            escapes += 1;
            outcome.left_unstable = true;
            energy = leave_saddle(rod, settings, escapes, energy);
            continue;
        }
        if outcome.iterations == MAX_ITERATIONS || !outcome.residual.is_finite() {
            return Attempt::Stuck;
        }
        outcome.iterations += 1;
        if !keeps_tangent(minimum_nearby, outcome.residual, last_residual) {
            rod.linearise();
            let Some(least) = eliminate_shifted(rod, settings, &mut shift) else {
                return Attempt::Stuck;
            };
            (pivot, moved) = (least, 0.0);
        }
        last_residual = outcome.residual;
        let step = rod.newton_step(true);
        moved += step.largest;
        if !step.largest.is_finite() {
            return Attempt::Stuck;
        }
        minimum_nearby = shift == 0.0 && is_minimum_nearby(moved, pivot, unit, stiffening);
        let Some(fraction) = backtrack(rod, settings, &step, noise, &mut energy) else {
            return Attempt::Stuck;
        };
        shift = if fraction == 1.0 && shift <= unit {
            0.0
        } else {
            shift * 0.25
        };
    }
}

/// Eliminates with the shift, raised until all pivots are positive; returns the least pivot.
fn eliminate_shifted(rod: &mut dyn Passes, settings: &Settings, shift: &mut f64) -> Option<f64> {
    let mut pivot = rod.eliminate(true, *shift);
    for _ in 0..MAX_SHIFTS {
        if pivot > 0.0 || interrupt::work(settings.work) {
            break;
        }
        *shift = if *shift == 0.0 {
            settings.shift_unit
        } else {
            *shift * 4.0
        };
        pivot = rod.eliminate(true, *shift);
    }
    (pivot > 0.0).then_some(pivot)
}

/// Takes a fraction of the step that lowers the energy sufficiently, and returns it.
fn backtrack(
    rod: &mut dyn Passes,
    settings: &Settings,
    step: &Step<f64>,
    noise: f64,
    energy: &mut f64,
) -> Option<f64> {
    rod.save();
    let mut fraction = (MAX_STEP / step.largest).min(1.0);
    for halvings in 0.. {
        rod.advance(fraction);
        let trial = rod.evaluate();
        if trial <= *energy + SUFFICIENT_DECREASE * fraction * step.slope + noise {
            *energy = trial;
            return Some(fraction);
        }
        fraction *= 0.5;
        if halvings == MAX_HALVINGS || interrupt::work(settings.work) {
            break;
        }
    }
    None
}

/// Newton's method where there is no energy: a step is accepted if the residual decreases.
fn newton_on_residual(rod: &mut dyn Passes, settings: &Settings, outcome: &mut Outcome) -> Attempt {
    rod.evaluate();
    let mut residual = rod.gradient() / settings.moment_scale;
    for step in 0..=MAX_RESIDUAL_STEPS {
        outcome.residual = residual;
        if interrupt::work(settings.work) {
            break;
        }
        if residual <= TOLERANCE {
            return converged(rod, None);
        }
        if !residual.is_finite() || step == MAX_RESIDUAL_STEPS {
            break;
        }
        outcome.iterations += 1;
        rod.linearise();
        rod.eliminate(false, 0.0);
        let largest = rod.newton_step(false).largest;
        if !largest.is_finite() {
            break;
        }
        match shorten(rod, settings, largest, residual) {
            Some(trial) => residual = trial,
            None => break,
        }
    }
    Attempt::Stuck
}

/// Takes a fraction of the step that lowers the residual, and returns the new residual.
fn shorten(rod: &mut dyn Passes, settings: &Settings, largest: f64, residual: f64) -> Option<f64> {
    rod.save();
    let mut fraction = (MAX_STEP / largest).min(1.0);
    loop {
        rod.advance(fraction);
        rod.evaluate();
        let trial = rod.gradient() / settings.moment_scale;
        // a full step may rotate the whole chain: allow a small growth of the residual
        let most = if fraction == 1.0 {
            RESIDUAL_GROWTH
        } else {
            1.0 - RESIDUAL_DECREASE * fraction
        };
        if trial <= residual * most {
            return Some(trial);
        }
        fraction *= 0.5;
        if !(fraction > RESIDUAL_DECREASE) || interrupt::work(settings.work) {
            return None;
        }
    }
}

/// Leaves an unstable equilibrium, to the side with the lower energy, and returns that energy.
///
/// Inverse iteration on the shifted Hessian from a fixed, unsymmetric start approximates the lowest
/// mode, so that the same load always takes the same branch.
#[cold]
fn leave_saddle(rod: &mut dyn Passes, settings: &Settings, attempt: usize, energy: f64) -> f64 {
    let mut shift = 1e-6 * settings.shift_unit;
    for _ in 0..MAX_SHIFTS {
        if rod.eliminate(true, shift) > 0.0 || interrupt::work(settings.work) {
            break;
        }
        shift *= 2.0;
    }
    rod.set_gradient(&|i| {
        let phase = i as f64;
        Vec3([0.3 + 0.01 * phase.cos(), -1.0, 0.02 * phase.sin()])
    });
    let mut largest = 1.0;
    for round in 0..9 {
        if interrupt::work(settings.work) {
            break;
        }
        if round > 0 {
            rod.step_to_gradient(1.0 / largest);
        }
        largest = rod.newton_step(true).largest;
    }
    rod.save();
    let modules = rod.module_count() as f64;
    let mut amount = 0.2 * attempt as f64 / (largest * modules.sqrt());
    let mut least = energy;
    for _ in 0..2 {
        rod.advance(amount);
        least = rod.evaluate();
        if least < energy {
            break;
        }
        amount = -amount;
    }
    least
}

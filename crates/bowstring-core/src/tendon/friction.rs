//! Coulomb friction of the tendons at their holes: stick and slip.
//!
//! Theory: docs/theory/actuation.md (Friction, Eq. 4.4 and 4.5).

use super::history::{History, Slip};
use super::line::Command;
use super::tendons::Tendons;
use crate::rod::routed::RoutedRod;
use crate::step::Lock;

/// Largest drop of the logarithm of a tension below which a hole has no friction: the tendon is
/// straight there.
const NEGLIGIBLE_DROP: f64 = 1e-6;
/// Iterations with changes between stick and slip after which all holes become unknowns together,
/// because local changes have not settled.
const LOCAL_STEPS: usize = 8;

/// Negligible changes.
#[derive(Clone, Copy)]
pub(crate) struct FrictionTolerance {
    /// Change of a drop.
    pub drop: f64,
    /// Slip (m).
    pub slip: f64,
}

/// Friction at all holes in a step.
#[derive(Clone)]
pub(crate) struct Friction {
    /// Whether any tendon has friction.
    pub enabled: bool,
    pub tolerance: FrictionTolerance,
    /// Displacements at the start of the step (m).
    from: Vec<f64>,
    /// Slip by holes of one tendon (m), v of theory Eq. 4.5.
    slipped: Vec<f64>,
    /// Largest drop mu beta (theory Eq. 4.4), by modules and tendons.
    pub bounds: Vec<f64>,
    /// Number of iterations in which a hole changed between stick and slip.
    changes: usize,
    /// Whether no hole did in the last `update`.
    pub unchanged: bool,
}

impl Friction {
    pub fn new(tendons: &Tendons) -> Self {
        let (n, m) = (tendons.routing.modules, tendons.lines.len());
        Friction {
            enabled: tendons.lines.iter().any(|line| line.friction > 0.0),
            tolerance: FrictionTolerance {
                drop: 1e-13,
                slip: 1e-12 * tendons.routing.length,
            },
            from: vec![0.0; m],
            slipped: vec![0.0; n],
            bounds: vec![0.0; n * m],
            changes: 0,
            unchanged: false,
        }
    }

    /// Prepares a step from `old`.
    pub fn start(&mut self, tendons: &Tendons, old: &History) {
        if self.enabled {
            for i in 0..tendons.lines.len() {
                self.from[i] = if old.tensions[i] > 0.0 {
                    old.displacements[i]
                } else {
                    tendons.displacement_of(old, i)
                };
            }
        }
        self.restart();
    }

    /// Makes the drops of holes that slip known again, after local changes have not settled.
    pub fn restart(&mut self) {
        self.changes = 0;
    }

    /// Whether every hole is an unknown, not only those that stick.
    pub fn is_global(&self) -> bool {
        self.changes > LOCAL_STEPS
    }

    /// Friction at the present bend (theory Eq. 4.5): which holes slip, which stick, and the drops
    /// of those that slip. False while that still changes.
    ///
    /// On a `fresh` path, without a hole that has stuck, the direction of slip may reverse at once.
    pub fn update(
        &mut self,
        tendons: &mut Tendons,
        rod: &dyn RoutedRod,
        old: &History,
        fresh: bool,
    ) -> bool {
        let mut settled = true;
        self.unchanged = true;
        for i in 0..tendons.lines.len() {
            if tendons.lines[i].friction > 0.0 {
                self.set_slip(tendons, rod.span_lengths(), old, i);
                settled &= self.update_tendon(tendons, rod.angles(), old, i, fresh);
                tendons.carry(i);
            }
        }
        if !self.unchanged && !fresh {
            self.changes += 1;
        }
        settled && self.unchanged
    }

    /// Friction at the present bend of a perturbed path, where the same holes slip as in the last
    /// `update` of the nominal one, which ended with these drops.
    pub fn keep(
        &mut self,
        tendons: &mut Tendons,
        rod: &dyn RoutedRod,
        old: &History,
        nominal: &Friction,
        drops: &[f64],
    ) {
        let m = tendons.lines.len();
        for i in 0..m {
            if tendons.lines[i].friction == 0.0 {
                continue;
            }
            for k in 0..=tendons.routing.ends[i] {
                let at = k * m + i;
                self.bounds[at] = tendons.lines[i].friction_bound(k, rod.angles()[at]);
                let bound = self.bounds[at];
                tendons.now.drops[at] = match tendons.now.slip[at] {
                    Slip::Sticks => continue,
                    Slip::Away => -bound,
                    _ if drops[at] == nominal.bounds[at] => bound,
                    _ if drops[at] == -nominal.bounds[at] => -bound,
                    // the motor does not move
                    _ => old.drops[at],
                };
            }
            tendons.carry(i);
        }
    }

    /// Slip of a tendon at its holes in this step, positive towards the base.
    fn set_slip(&mut self, tendons: &Tendons, lengths: &[f64], old: &History, i: usize) {
        let m = tendons.lines.len();
        let mut slipped = 0.0;
        for k in (0..=tendons.routing.ends[i]).rev() {
            let at = k * m + i;
            let friction_spans = tendons.compliance.friction_spans[at];
            slipped -= lengths[at] - friction_spans * tendons.tensions[at] - old.spans[at];
            self.slipped[k] = slipped;
        }
    }

    /// Updates the friction of one tendon; returns whether its drops are settled.
    fn update_tendon(
        &mut self,
        tendons: &mut Tendons,
        angles: &[f64],
        old: &History,
        i: usize,
        fresh: bool,
    ) -> bool {
        let m = tendons.lines.len();
        let slack = tendons.now.tensions[i] == 0.0;
        let at_base = self.base_slip(tendons, i);
        let mut settled = true;
        for k in 0..=tendons.routing.ends[i] {
            let at = k * m + i;
            let bound = tendons.lines[i].friction_bound(k, angles[at]);
            let (drop, slip) = (tendons.now.drops[at], tendons.now.slip[at]);
            self.bounds[at] = bound;
            let (next, to) = match at_base {
                _ if slack => (Slip::Towards, bound),
                Some(change) if k == 0 => match self.direction(change) {
                    Slip::Sticks => (Slip::Towards, old.drops[at].clamp(-bound, bound)),
                    slip => (slip, sliding_drop(slip, bound, 0.0)),
                },
                _ => {
                    let next = self.next_slip(slip, self.slipped[k], fresh);
                    (next, sliding_drop(next, bound, drop))
                }
            };
            // the bend still changes, or the hole changed between stick and slip
            settled &= (to - drop).abs() <= self.tolerance.drop;
            self.unchanged &= next == slip;
            (tendons.now.slip[at], tendons.now.drops[at]) = (next, to);
        }
        settled
    }

    /// Slip at the base hole, where an inextensible line prescribes it. While the motor does not
    /// move, the drop is constant.
    fn base_slip(&self, tendons: &Tendons, i: usize) -> Option<f64> {
        match tendons.now.commands[i] {
            Command::Displacement(to) if tendons.is_rigid_to_base(i) => Some(to - self.from[i]),
            _ => None,
        }
    }

    fn direction(&self, slipped: f64) -> Slip {
        if slipped > self.tolerance.slip {
            Slip::Towards
        } else if slipped < -self.tolerance.slip {
            Slip::Away
        } else {
            Slip::Sticks
        }
    }

    /// Next slip state, from the present one and the slip length.
    fn next_slip(&self, slip: Slip, slipped: f64, fresh: bool) -> Slip {
        let direction = self.direction(slipped);
        match slip {
            _ if fresh && direction == Slip::Away => Slip::Away,
            _ if fresh => Slip::Towards,
            Slip::Towards if direction == Slip::Away => Slip::Sticks,
            Slip::Away if direction == Slip::Towards => Slip::Sticks,
            _ => slip,
        }
    }

    /// Constraints of small oscillations: taut tendons under displacement control keep their
    /// length; with friction, so does every group of spans between two holes with friction, because
    /// a small motion does not make them slip. A hole without bend has no friction.
    pub fn locks(&self, tendons: &Tendons) -> Vec<Lock> {
        let (n, m) = (tendons.routing.modules, tendons.lines.len());
        let compliance = &tendons.compliance;
        let mut locks = vec![];
        for i in 0..m {
            if !tendons.is_taut(i) {
                continue;
            }
            let friction = tendons.lines[i].friction > 0.0;
            let has_friction = |k: usize| friction && self.bounds[k * m + i] > NEGLIGIBLE_DROP;
            let mut start = 0;
            for k in 0..=tendons.routing.ends[i] {
                let last = k == tendons.routing.ends[i];
                if !last && !has_friction(k + 1) {
                    continue;
                }
                let free = start == 0 && !has_friction(0);
                let from = std::mem::replace(&mut start, k + 1);
                if free && !tendons.now.commands[i].is_displacement() {
                    continue;
                }
                let own = if friction {
                    &compliance.friction_spans
                } else {
                    &compliance.spans
                };
                let mut give: f64 = (from..=k).map(|k| own[k * m + i]).sum();
                if free {
                    give += compliance.before[i] + compliance.regularisation[i];
                }
                locks.push(Lock {
                    tendon: i,
                    spans: (0..n)
                        .map(|at| f64::from(u8::from((from..=k).contains(&at))))
                        .collect(),
                    compliance: give,
                });
            }
        }
        locks
    }
}

/// Drop of a hole that slips; that of a sticking hole stays within the bound.
fn sliding_drop(slip: Slip, bound: f64, drop: f64) -> f64 {
    match slip {
        Slip::Towards => bound,
        Slip::Away => -bound,
        Slip::Sticks => drop.clamp(-bound, bound),
    }
}

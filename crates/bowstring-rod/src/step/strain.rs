//! Strain of the earlier steps: predictor, and strain rate for the material damping.
//!
//! Theory: docs/theory/dynamics.md (Time integration, Damping, Step size).

use super::scheme::Scheme;
use crate::math::copies;
use crate::math::linalg::Vec3;
use crate::math::real::{Layout, Real};
use crate::rod::state::State;

/// Number of earlier steps that the predictor extrapolates.
const HISTORY: usize = 4;

/// Unknowns of a module: strain of its arcs and contact force at its end.
#[derive(Clone, Copy)]
pub(super) struct Strain<T, const A: usize> {
    pub w: [Vec3<T>; A],
    pub n: Vec3<T>,
}

impl<T: Real, const A: usize> Strain<T, A> {
    pub fn zero() -> Self {
        Strain {
            w: [Vec3::zero(); A],
            n: Vec3::zero(),
        }
    }

    #[inline(always)]
    pub fn of(state: &State<T, A>) -> Self {
        Strain {
            w: state.w,
            n: state.n,
        }
    }

    /// Copies the numbers of a lane.
    pub fn take_lane(&mut self, o: &Self, lane: usize) {
        for (own, other) in self.w.iter_mut().zip(&o.w) {
            own.take_lane(other, lane);
        }
        self.n.take_lane(&o.n, lane);
    }

    /// `self * s + o * t`
    #[inline(always)]
    pub fn combined(&self, s: f64, o: &Self, t: f64) -> Self {
        let (s, t) = (T::splat(s), T::splat(t));
        let mut out = *o;
        for a in 0..A {
            out.w[a] = self.w[a].scaled_add(s, o.w[a] * t);
        }
        out.n = self.n.scaled_add(s, o.n * t);
        out
    }
}

/// Strain and its rate at the ends of the earlier steps, by groups of modules.
pub(super) struct StrainHistory<L: Layout, const A: usize> {
    /// Strain, latest first, and the lengths of the steps between (s).
    past: [Vec<Strain<L::Module, A>>; HISTORY],
    durations: [f64; HISTORY - 1],
    /// Number of valid entries.
    known: usize,
    /// Rate of the strain in the memory of the scheme (1/s).
    pub rate: Vec<Strain<L::Module, A>>,
    /// Part of the strain of this step that the material damping subtracts.
    pub offset: Vec<Strain<L::Module, A>>,
}

impl<L: Layout, const A: usize> StrainHistory<L, A> {
    pub fn new(groups: usize) -> Self {
        let strain = copies(Strain::zero(), groups);
        StrainHistory {
            past: std::array::from_fn(|_| strain.clone()),
            durations: [1.0; HISTORY - 1],
            known: 0,
            rate: strain.clone(),
            offset: strain,
        }
    }

    /// Strain at the start of the step.
    #[inline(always)]
    pub fn start(&self) -> &[Strain<L::Module, A>] {
        &self.past[0]
    }

    /// Replaces the contact force of a group at the start of the step.
    pub fn set_start_force(&mut self, g: usize, force: Vec3<L::Module>) {
        self.past[0][g].n = force;
    }

    /// Length of the step before (s); `None` before the second step.
    #[inline(always)]
    pub fn last_duration(&self) -> Option<f64> {
        (self.known >= 2).then_some(self.durations[0])
    }

    /// Keeps only the present strain and its rate for the predictor, after a jump. For constraint
    /// forces even the rate is discarded.
    pub fn reset_predictor(&mut self, scheme: &Scheme) {
        let again = scheme.rigid && self.known <= 2;
        self.known = self.known.min(if again { 1 } else { 2 });
    }

    /// Appends a strain.
    #[inline(always)]
    pub fn push(&mut self, next: &[State<L::Module, A>]) {
        self.past.rotate_right(1);
        for (past, state) in self.past[0].iter_mut().zip(next) {
            *past = Strain::of(state);
        }
    }

    /// Appends a strain at rest, and discards the earlier ones.
    pub fn push_at_rest(&mut self, next: &[State<L::Module, A>]) {
        self.push(next);
        self.known = 1;
        self.rate.fill(Strain::zero());
    }

    /// Appends the strain at the end of a step, and updates its rate.
    #[inline(always)]
    pub fn commit(&mut self, scheme: &Scheme, next: &[State<L::Module, A>]) {
        if scheme.damping.material != 0.0 {
            // a scheme without memory does not damp an old rate, so it must be discarded
            let forgets = scheme.fresh || scheme.am == scheme.gamma;
            let gamma = if forgets { 1.0 } else { scheme.gamma };
            let (per, keep) = (1.0 / (gamma * scheme.duration), 1.0 - 1.0 / gamma);
            for (g, next) in next.iter().enumerate() {
                let change = Strain::of(next).combined(1.0, &self.past[0][g], -1.0);
                self.rate[g] = change.combined(per, &self.rate[g], keep);
            }
        }
        self.push(next);
        self.known = (self.known + 1).min(HISTORY);
        self.durations.rotate_right(1);
        self.durations[0] = scheme.duration;
    }

    /// Appends a strain at rest, also in place of all earlier ones.
    pub fn fill_at_rest(&mut self, next: &[State<L::Module, A>]) {
        for past in &mut self.past {
            for (past, state) in past.iter_mut().zip(next) {
                *past = Strain::of(state);
            }
        }
        self.rate.fill(Strain::zero());
        self.known = HISTORY;
    }

    /// Sets the length of the steps between all known strains (s).
    pub fn set_durations(&mut self, duration: f64) {
        self.durations.fill(duration);
    }

    /// Copies strains and rates, without allocation, from another of the same size.
    pub fn copy_from(&mut self, o: &Self) {
        for (own, other) in self.past.iter_mut().zip(&o.past) {
            own.copy_from_slice(other);
        }
        self.rate.copy_from_slice(&o.rate);
        (self.durations, self.known) = (o.durations, o.known);
    }

    /// Copies strains and rates of a lane. Those before the last one are taken `spread` times as far
    /// from it, as of steps that are longer by this factor.
    pub fn take_lane(&mut self, o: &Self, lane: usize, spread: f64) {
        for q in 0..HISTORY {
            for g in 0..self.rate.len() {
                let last = &o.past[0][g];
                let earlier = last.combined(1.0 - spread, &o.past[q][g], spread);
                self.past[q][g].take_lane(if q == 0 { last } else { &earlier }, lane);
            }
        }
        for (own, other) in self.rate.iter_mut().zip(&o.rate) {
            own.take_lane(other, lane);
        }
    }

    /// Sets the offset of the damped strain: the stress is that of `w + tau rate`, with `rate = am
    /// per (w - w_n) / af + memory rate_n`.
    #[inline(always)]
    pub fn set_offset(&mut self, scheme: &Scheme) {
        let tau = scheme.damping.material;
        let by_start = tau * scheme.am * scheme.rate_by_change() / scheme.af;
        let by_rate = -tau * scheme.memory();
        for g in 0..self.offset.len() {
            self.offset[g] = self.rate[g].combined(by_rate, &self.past[0][g], by_start);
            if scheme.rigid {
                self.offset[g].n = Vec3::zero();
            }
        }
    }

    /// Extrapolates the strain of the earlier steps to the end of this one.
    #[inline(always)]
    pub fn predict(&self, scheme: &Scheme, next: &mut [State<L::Module, A>]) {
        let weight = self.extrapolation(scheme.duration);
        for g in 0..next.len() {
            let mut strain = Strain::zero();
            for q in 0..self.known {
                strain = self.past[q][g].combined(weight[q], &strain, 1.0);
            }
            next[g].w = strain.w;
            // constraint forces may jump with the load
            let jumps = scheme.rigid && self.known <= 2;
            next[g].n = if jumps { self.past[0][g].n } else { strain.n };
        }
    }

    /// Weights of Lagrange's polynomial through the earlier steps.
    #[inline(always)]
    fn extrapolation(&self, duration: f64) -> [f64; HISTORY] {
        let mut at = [0.0; HISTORY];
        for q in 1..HISTORY {
            at[q] = at[q - 1] - self.durations[q - 1];
        }
        let mut weight = [0.0; HISTORY];
        for q in 0..self.known {
            weight[q] = 1.0;
            for r in 0..self.known {
                if r != q {
                    weight[q] *= (duration - at[r]) / (at[q] - at[r]);
                }
            }
        }
        weight
    }
}

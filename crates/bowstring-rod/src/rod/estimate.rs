//! Error of a converged solution with respect to the rod's differential equations.
//!
//! Theory: docs/theory/statics.md (Discretisation error).
//!
//! The elements of each module have a defect (`defect`). One substitution by the last Newton step's
//! elimination gives the correction of the whole rod that removes all defects, and so the error of
//! tip and lengths, also where a load near buckling amplifies it (defect correction: Stetter 1978).
#![warn(missing_docs)]

use crate::math::linalg::Vec3;
use crate::math::real::{Layout, Real};
use crate::model::load::LEVELS;
use crate::rod::chain::Rod;
use crate::rod::constants::Constants;
use crate::rod::defect::Weight;
use crate::rod::groups::{get, get_mat, put};
use crate::rod::routes::in_group;
use crate::rod::span::Span;

/// Estimated discretisation error of an equilibrium.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ErrorEstimate {
    /// Largest error of a disk's position, the tip's among them (m).
    pub tip: f64,
    /// Largest error of the tension of a displacement-controlled tendon (N).
    pub tension: f64,
}

impl ErrorEstimate {
    /// Whether it bounds the error: the elements of a module that is bent too sharply have none.
    pub fn is_bound(&self) -> bool {
        self.tip.is_finite() && self.tension.is_finite()
    }

    /// At least this share of another error.
    pub fn at_least(self, share: f64, other: &Self) -> Self {
        ErrorEstimate {
            tip: self.tip.max(share * other.tip),
            tension: self.tension.max(share * other.tension),
        }
    }
}

/// Tolerance of the estimated error of the tip, over the robot's length, when elements are chosen.
pub const TIP_TOLERANCE: f64 = 1e-5;
/// Tolerance of the estimated error of tensions, over the largest tension.
const TENSION_TOLERANCE: f64 = 1e-4;
/// Compression number of a module (force times squared length over bending stiffness; pi^2 at
/// buckling between two disks) above which stability depends on the elements.
pub const NEAR_BUCKLING: f64 = 5.0;
/// Largest compression number of one element at which the critical force is accurate to 1e-3.
const FINE_COMPRESSION: f64 = 0.65;
/// Safety factor of the estimate, which is first order in the defects.
const SAFETY: f64 = 3.0;
/// Safety factor where a module has folded: defects of its elements cancel there, and the estimate
/// can be too low by a factor of 12.
const SAFETY_FOLDED: f64 = 12.0;

/// Conclusions about a converged solution from its estimate.
pub struct Verdict {
    /// Estimated error.
    pub error: ErrorEstimate,
    /// Stability; `None` where the elements are too coarse to confirm a stable equilibrium.
    pub stable: Option<bool>,
    /// Elements that bring the error below the tolerances, or the largest available number.
    pub needed: usize,
}

impl Verdict {
    /// Verdict on a solution with `elements` elements in a module of a robot of some `length`;
    /// `tension`: estimated change of a tension, and the largest tension (N).
    pub fn new(
        found: &Correction<f64>,
        tension: [f64; 2],
        stable: Option<bool>,
        length: f64,
        elements: usize,
    ) -> Self {
        let safety = if found.folded > 0.0 {
            SAFETY_FOLDED
        } else {
            SAFETY
        };
        // an estimate that is not finite gives no bound
        let sound = |x: f64| {
            if x.is_finite() {
                safety * x
            } else {
                f64::INFINITY
            }
        };
        let error = ErrorEstimate {
            tip: sound(found.motion),
            tension: sound(tension[0]),
        };
        let ratio = error.tip / (TIP_TOLERANCE * length);
        let of_tension = if error.tension > 0.0 {
            error.tension / (TENSION_TOLERANCE * tension[1])
        } else {
            0.0
        };
        let decides = decides_stability(found.compression, elements);
        Verdict {
            error,
            stable: stable.filter(|stable| !stable || decides),
            needed: needed(elements, f64::max(ratio, of_tension), found.compression),
        }
    }
}

/// Whether the elements are fine enough to decide stability at this largest compression number of a
/// module.
fn decides_stability(compression: f64, elements: usize) -> bool {
    let own = compression / (elements * elements) as f64;
    // a NaN decides nothing
    compression <= NEAR_BUCKLING || own <= FINE_COMPRESSION
}

/// Number of elements that reduces an error to its tolerance, `ratio` being error over tolerance;
/// `elements` itself where it is already below, or where there is no larger number.
fn needed(elements: usize, ratio: f64, compression: f64) -> usize {
    let enough = |e: usize| {
        let finer = (e / elements) as f64;
        // a NaN fails every test
        (ratio <= 1.0 || ratio / finer.powi(4) <= 1.0) && decides_stability(compression, e)
    };
    let mut finer = LEVELS.into_iter().filter(|e| *e >= elements);
    finer.find(|e| enough(*e)).unwrap_or(LEVELS[3])
}

/// Correction that removes the defects and the remaining residual of a solution.
#[derive(Clone, Copy)]
pub struct Correction<T> {
    /// Sum over modules of the motion of the end relative to the start (m): no disk moves further,
    /// and errors of modules do not cancel by chance.
    pub motion: T,
    /// Largest compression number of a module (compressive force times squared length over bending
    /// stiffness; pi^2 at buckling between two disks).
    pub compression: T,
    /// Positive where a module has folded.
    pub folded: T,
}

impl<T: Real> Correction<T> {
    /// Correction of one lane.
    #[inline(always)]
    pub fn of_lane(&self, lane: usize) -> Correction<f64> {
        Correction {
            motion: self.motion.lane(lane),
            compression: self.compression.lane(lane),
            folded: self.folded.lane(lane),
        }
    }
}

impl<L: Layout, const A: usize> Rod<L, A> {
    /// Error of the last equilibrium at constant tensions; length errors are in `length_errors`.
    #[inline(never)]
    pub fn estimate(&mut self) -> Correction<L::Chain> {
        self.layout.vectorize(
            #[inline(always)]
            || self.estimate_in_lanes(),
        )
    }

    #[inline(always)]
    fn estimate_in_lanes(&mut self) -> Correction<L::Chain> {
        let n = self.module_count();
        let mut compression = L::Chain::zero();
        let mut folded = L::Chain::splat(-1.0);
        for g in 0..self.states.len() {
            let c = &self.constants[g];
            let (mut weight, mut gravity) = (Vec3::zero(), Vec3::zero());
            for i in 0..L::WIDTH.min(n - g * L::WIDTH) {
                let k = g * L::WIDTH + i;
                put::<L>(
                    &mut weight,
                    i,
                    self.rotations[k].tr_mul(self.dead.modules[k][3]),
                );
                if !self.tapers.is_empty() {
                    let here = self.rotations[k].tr_mul(self.dead.gravity);
                    put::<L>(&mut gravity, i, here);
                }
            }
            let weight = weight * (c.per_flexible * L::Module::splat((A / 2) as f64));
            let mut t = in_group(&self.tendons, &self.tensions, self.path, g);
            t.on_nodes = self.on_nodes(g);
            let mut rhs = [Vec3::zero(); A];
            let mut load = Weight::new(weight, gravity, self.tapers.get(g));
            let mut on_nodes = None;
            if Self::BETWEEN && self.attached.has_between() {
                on_nodes = Some(self.loads_on_nodes(g));
            }
            load.on_nodes = on_nodes.as_ref();
            let (state, gradient) = (&self.states[g], &self.gradients[g]);
            let varied =
                self.fixed.keeps_curvature || !self.tapers.is_empty() || c.coupling().is_some();
            let defect = if Constants::<L::Module, A>::FINE || varied {
                state.defect::<true>(c, &t, gradient, &load, &mut rhs)
            } else {
                state.defect::<false>(c, &t, gradient, &load, &mut rhs)
            };
            self.gradients[g].g = rhs;
            for i in 0..L::WIDTH.min(n - g * L::WIDTH) {
                compression = compression.max(L::get(&defect.compression, i));
                folded = folded.max(L::get(&defect.folded, i));
            }
            self.errors.defects[g] = defect;
        }
        let mut missing = Vec3::<L::Chain>::zero();
        for k in (0..n).rev() {
            let (g, i) = (k / L::WIDTH, k % L::WIDTH);
            missing = get_mat::<L>(&self.states[g].s, i) * missing;
            for rhs in &mut self.gradients[g].g {
                let sum = get::<L>(rhs, i) + missing;
                put::<L>(rhs, i, sum);
            }
            missing -= get::<L>(&self.errors.defects[g].moment, i);
        }
        self.rotations_of_last_elimination();
        Correction {
            motion: self.correction(),
            compression,
            folded,
        }
    }

    /// Motion due to the rotations in `step` and the defects (see [`Correction`]); measures the
    /// change of the lengths.
    #[inline(never)]
    pub fn correction(&mut self) -> L::Chain {
        self.layout.vectorize(
            #[inline(always)]
            || self.correction_in_lanes(),
        )
    }

    #[inline(always)]
    fn correction_in_lanes(&mut self) -> L::Chain {
        let n = self.module_count();
        for length in &mut self.errors.lengths {
            *length = L::Chain::zero();
        }
        let mut motion = L::Chain::zero();
        let mut x = Vec3::<L::Chain>::zero();
        for g in 0..self.states.len() {
            let (c, state, gradient) = (&self.constants[g], &self.states[g], &self.gradients[g]);
            let (mut turn, mut moved) = (Vec3::zero(), self.errors.defects[g].place);
            for a in 0..A {
                turn += self.newton.step[g][a];
                moved += gradient.r[a] * self.newton.step[g][a];
            }
            let here = L::WIDTH.min(n - g * L::WIDTH);
            for (j, holes) in self.tendons.in_group(g).iter().enumerate() {
                let span = Span::new(c, holes, &state.s, state.rho);
                let longer = span.direction.dot(moved + turn.cross(span.arm));
                for i in 0..here {
                    if g * L::WIDTH + i <= self.tendons.end_disks[j] {
                        self.errors.lengths[j] += L::get(&longer, i);
                    }
                }
            }
            let offset = state.offset(c);
            let end = moved + turn.cross(state.s.column(2) * c.clamp[1]);
            for i in 0..here {
                let own = x.cross(get::<L>(&offset, i)) + get::<L>(&end, i);
                motion += own.norm();
                x = get_mat::<L>(&state.s, i).tr_mul(x + get::<L>(&turn, i));
            }
        }
        motion
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn needed_elements_follow_error_and_compression() {
        assert_eq!(needed(1, 0.9, 0.5), 1);
        assert_eq!(needed(1, 1.1, 0.5), 2);
        assert_eq!(needed(1, 17.0, 0.5), 4);
        assert_eq!(needed(2, 17.0, 0.5), 8);
        assert_eq!(needed(8, 17.0, 0.5), 8);
        assert_eq!(needed(1, 0.1, 9.0), 4);
        assert_eq!(needed(1, f64::NAN, 0.5), 8);
        assert_eq!(needed(1, 0.1, f64::NAN), 8);
    }
}

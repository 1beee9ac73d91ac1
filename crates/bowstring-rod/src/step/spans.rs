//! Lengths of the tendon spans over a step.
//!
//! Theory: docs/theory/rod.md (Tendons).

use crate::math::linalg::Vec3;
use crate::math::real::{Layout, Real};
use crate::rod::chain::Rod;
use crate::rod::continuous_module::PulledModule;
use crate::rod::routes::in_group;
use crate::rod::span::Span;
use crate::rod::state::State;

/// Length of a span, over that of its module, below which its disks have collided.
pub(super) const CONTACT: f64 = 0.01;

/// Lengths of spans at both ends of a step (m), by modules and tendons; zero where a tendon does
/// not pass.
pub(super) struct SpanLengths {
    pub now: Vec<f64>,
    pub next: Vec<f64>,
    /// Smallest forward component of chords and loaded spans at the end of the step.
    pub forward: f64,
}

impl SpanLengths {
    pub fn new(spans: usize) -> Self {
        SpanLengths {
            now: vec![0.0; spans],
            next: vec![0.0; spans],
            forward: 1.0,
        }
    }

    /// Measures the spans at the end of the step.
    #[inline(always)]
    pub fn measure<L: Layout, const A: usize>(
        &mut self,
        rod: &Rod<L, A>,
        next: &[State<L::Module, A>],
    ) {
        let n = rod.module_count();
        self.forward = f64::INFINITY;
        for (g, state) in next.iter().enumerate() {
            let t = in_group(&rod.tendons, &rod.tensions, rod.path, g);
            let c = &rod.constants[g];
            let here = L::WIDTH.min(n - g * L::WIDTH);
            let mean = state.s.column(2) + Vec3::ez();
            let chord = state.rho.dot(mean);
            for i in 0..here {
                self.lower_forward(L::get(&chord, i).lane(0));
            }
            let pulled = PulledModule::of(state, c, &t);
            for (j, holes) in t.holes.iter().enumerate() {
                let (length, forward) = match &pulled {
                    None => {
                        let span = Span::new(c, holes, &state.s, state.rho);
                        let gap = span.length * c.per_flexible - L::Module::splat(CONTACT);
                        let forward = span.direction.dot(mean);
                        (span.length, -(-gap).max(-forward))
                    }
                    Some(pulled) => (pulled.length(c, holes), c.stretch(&t)),
                };
                for i in 0..here {
                    if g * L::WIDTH + i > rod.tendons.end_disks[j] {
                        break;
                    }
                    let at = (g * L::WIDTH + i) * t.holes.len() + j;
                    self.next[at] = L::get(&length, i).lane(0);
                    if L::get(&t.tensions[j], i).lane(0) > 0.0 {
                        self.lower_forward(L::get(&forward, i).lane(0));
                    }
                }
            }
        }
    }

    #[inline(always)]
    fn lower_forward(&mut self, forward: f64) {
        // a NaN counts as backward
        self.forward = -Real::max(-self.forward, -forward);
    }
}

//! Curvature that the backbone keeps without load, at the Gauss points of its elements.
//!
//! Theory: docs/theory/actuation.md (Hysteresis of the backbone).
//!
//! The points are those of equal elements, also where loads between two disks divide a module
//! otherwise: their curvature is then interpolated linearly in each element.

use crate::math::linalg::Vec3;
use crate::math::real::{Layout, Real};
use crate::rod::chain::Rod;
use crate::rod::gauss::{fraction, GAUSS};
use crate::rod::groups::{get, put};

impl<L: Layout, const A: usize> Rod<L, A> {
    /// Curvature and twist (1/m) at the Gauss points of equal elements, from base to tip.
    pub fn curvatures(&self, mut visit: impl FnMut(usize, Vec3)) {
        for (k, c) in self.fixed.modules.iter().enumerate() {
            let end = |arcs: usize| c.fraction(arcs).lane(0);
            let strain = &self.states[k / L::WIDTH].w;
            let w = |arc: usize| get::<L>(&strain[arc], k % L::WIDTH).of_lane(0);
            let mut e = 0;
            for i in 0..A {
                let at = ((i / 2) as f64 + fraction(i)) / (A / 2) as f64;
                while e + 1 < A / 2 && end(2 * e + 2) < at {
                    e += 1;
                }
                let size = end(2 * e + 2) - end(2 * e);
                let side = (at - end(2 * e)) / size - 0.5;
                let (a, b) = (w(2 * e), w(2 * e + 1));
                let rotation = (b - a).scaled_add(3.0 * side, a + b);
                visit(k * A + i, rotation * (1.0 / (size * c.flexible.lane(0))));
            }
        }
    }

    /// Sets the unloaded curvature and twist (1/m) at the Gauss points of equal elements, from base
    /// to tip, whose sections have no coupled strains.
    pub fn set_unloaded_curvatures(&mut self, of: impl Fn(usize) -> Vec3) {
        self.fixed.keeps_curvature = true;
        for k in 0..self.module_count() {
            let module = &mut self.fixed.modules[k];
            // in the elements of the points, linear through both
            let at = |fraction: f64| {
                let place = fraction * (A / 2) as f64;
                let e = (place as usize).min(A / 2 - 1);
                let (a, b) = (of(k * A + 2 * e), of(k * A + 2 * e + 1));
                let side = (place - e as f64 - 0.5) / GAUSS;
                (b - a).scaled_add(0.5 * side, (a + b) * 0.5)
            };
            for e in 0..A / 2 {
                let [from, to] = [2 * e, 2 * e + 2].map(|arcs| module.fraction(arcs).lane(0));
                let size = to - from;
                let [a, b] = [-GAUSS, GAUSS].map(|side| at(from + size * (0.5 + side)));
                let (mean, change) = ((a + b) * 0.5, (b - a) * (1.0 / (6.0 * GAUSS)));
                let half = 0.5 * size * module.flexible.lane(0);
                for (arc, rest) in [(2 * e, mean - change), (2 * e + 1, mean + change)] {
                    module.rest[arc] = Vec3::splat((rest * half).0);
                    let own = &mut self.constants[k / L::WIDTH].rest[arc];
                    put::<L>(own, k % L::WIDTH, module.rest[arc]);
                }
            }
        }
    }
}

//! Derivatives of tip and strain with respect to tensions, with right-hand sides side by side in
//! SIMD lanes.
//!
//! Theory: docs/theory/statics.md (Block-tridiagonal elimination).

use crate::interrupt;
use crate::math::linalg::Vec3;
use crate::math::real::{Layout, Real};
use crate::model::load::TendonPath;
use crate::rod::chain::Rod;
use crate::rod::responses::{same, same_mat, widen, Sources};

impl<L: Layout, const A: usize> Rod<L, A> {
    /// Derivatives of the tip's position (m/N) and rotation (rad/N) with respect to each tension at
    /// the equilibrium held and evaluated by the rod; keeps those of the strain in its responses.
    /// False, without derivatives, for a rod without lanes, for loads without a potential and for
    /// continuous tendons.
    #[inline(always)]
    pub fn respond_to_tensions(&mut self, columns: &mut [[Vec3; 2]]) -> bool {
        let (n, count) = (self.module_count(), self.tendons.len());
        let suits = L::WIDTH > 1 && self.has_potential() && self.path == TendonPath::Straight;
        let total = 1 + count;
        if !suits || interrupt::work(total * n * (16 + 2 * count)) {
            return false;
        }
        self.gradient();
        self.linearise();
        self.eliminate::<true>(L::Chain::zero());
        self.measure_spans(false);
        let tendons: Vec<_> = (0..count).collect();
        let mut tensions = vec![0.0; n * count];
        for (i, end_disk) in self.tendons.end_disks.iter().enumerate() {
            tensions[i * n..=i * n + end_disk].fill(1.0);
        }
        let sources = Sources {
            tendons: &tendons,
            tensions: &tensions,
        };
        self.reserve_responses(total);
        for part in 0..total.div_ceil(L::WIDTH) {
            let first = part * L::WIDTH;
            self.substitute_backward(part, first..total.min(first + L::WIDTH), &sources);
            let tip = self.tip_of_responses(part);
            for (lane, column) in (first..total).take(L::WIDTH).enumerate() {
                // the first is the response to the own imbalance
                if column > 0 {
                    columns[column - 1] = tip.map(|v| v.of_lane(lane));
                }
            }
        }
        true
    }

    /// Motion of the tip by the responses in the lanes (m, rad), whose own solutions become strain.
    #[inline(always)]
    fn tip_of_responses(&mut self, part: usize) -> [Vec3<L::Module>; 2] {
        let mut out = self.take_responses(part);
        let (mut position, mut rotation) = (Vec3::zero(), Vec3::zero());
        self.substitute_forward(
            &mut out,
            #[inline(always)]
            |_, k, [start, rho, turn]| {
                let (g, i) = (k / L::WIDTH, k % L::WIDTH);
                let (state, c) = (&self.states[g], &self.constants[g]);
                let (offset, clamp) = (state.offset(c), state.s.column(2) * c.clamp[1]);
                let moved = start.cross(same::<L>(&offset, i)) + rho;
                let moved = moved + turn.cross(same::<L>(&clamp, i));
                position += widen::<L>(&self.rotations[k]) * moved;
                rotation = widen::<L>(&self.rotations[k]) * (start + turn);
            },
        );
        for (k, arcs) in out.u.iter_mut().enumerate() {
            let to_strain = &self.gradients[k / L::WIDTH].to_strain;
            for (u, matrix) in arcs.iter_mut().zip(to_strain) {
                *u = same_mat::<L>(matrix, k % L::WIDTH) * *u;
            }
        }
        self.put_responses(part, out);
        [position, rotation]
    }

    /// Adds the change of every arc's strain by changes of tension (N) to first order, after
    /// `respond_to_tensions`.
    #[inline(always)]
    pub fn add_strain_of_responses(&self, changes: &[f64], strain: &mut [Vec3]) {
        for (part, responses) in self.responses().iter().enumerate() {
            // the first is the response to the own imbalance
            let change = L::Module::from_fn(|lane| match part * L::WIDTH + lane {
                0 => 0.0,
                column => changes.get(column - 1).copied().unwrap_or(0.0),
            });
            for (strain, u) in strain.iter_mut().zip(responses.u.as_flattened()) {
                for q in 0..3 {
                    let moved = u.0[q] * change;
                    strain[q] += (0..L::WIDTH).map(|lane| moved.lane(lane)).sum::<f64>();
                }
            }
        }
    }
}

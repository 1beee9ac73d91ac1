//! Newton steps with unknown tensions, for robots side by side in lanes.
//!
//! Theory: docs/theory/actuation.md (Eq. 4.8).
//!
//! A change of tension `T_j` adds `b_j T_j` to the gradient, where `b_j` is also the derivative of
//! the tendon's length: the potential holds `T_j` times the length. With the tangent `A` and the
//! gradient `g`, the lengths change by
//!
//! `d length_i = -b_i' A^-1 g - (b_i' A^-1 b_j + local compliance) d T_j`
//!
//! The eliminated modules give `b_i' A^-1 b_j` as a sum over modules of right-hand side times own
//! solution, so that only the step itself is substituted forward.

use crate::math::linalg::{Mat3, Vec3};
use crate::math::real::{Layout, Real};
use crate::rod::chain::Rod;
use crate::rod::newton_step::blocks;
use crate::rod::routes::in_group;
use crate::rod::span::Span;
use crate::rod::state::Hessian;

/// Unit tensions as right-hand sides of the rod's tangent: one column for each unknown tension.
#[derive(Clone)]
pub struct TensionColumns<T, const A: usize> {
    /// Tendon of each column.
    pub tendons: Vec<usize>,
    /// Own solution of the arcs, by modules and columns.
    own: Vec<[Vec3<T>; A]>,
    /// Decrease of length for a unit tension, lower triangle by columns (m/N).
    pub flexibility: Vec<T>,
    /// Decrease of length by the step at constant tensions, by columns (m).
    pub shortened: Vec<T>,
    /// Spans, by modules and tendons, and lengths of the tendons (m), as measured last.
    spans: Vec<Span<T>>,
    pub lengths: Vec<T>,
    /// Scratch, by columns.
    scratch: Vec<Column<T, A>>,
}

/// A column in a module.
#[derive(Clone, Copy)]
struct Column<T, const A: usize> {
    /// Linear term of the state at the module's start.
    p: Vec3<T>,
    rhs: [Vec3<T>; A],
}

impl<T: Real, const A: usize> TensionColumns<T, A> {
    pub fn new() -> Self {
        TensionColumns {
            tendons: vec![],
            own: vec![],
            flexibility: vec![],
            shortened: vec![],
            spans: vec![],
            lengths: vec![],
            scratch: vec![],
        }
    }

    /// Entry of the flexibility, which is symmetric.
    #[inline(always)]
    pub fn flexibility_of(&self, r: usize, c: usize) -> &T {
        let (r, c) = (r.max(c), r.min(c));
        &self.flexibility[r * (r + 1) / 2 + c]
    }

    /// Replaces the columns by those of some tendons.
    pub fn resize(&mut self, tendons: impl Iterator<Item = usize>, modules: usize) {
        self.tendons.clear();
        self.tendons.extend(tendons);
        let count = self.tendons.len();
        // beyond the end disks of the tendons they stay zero
        self.own.clear();
        self.own.resize(modules * count, [Vec3::zero(); A]);
        self.flexibility.resize(count * (count + 1) / 2, T::zero());
        self.shortened.resize(count, T::zero());
        let zero = Vec3::zero();
        self.scratch.resize(
            count,
            Column {
                p: zero,
                rhs: [zero; A],
            },
        );
    }
}

impl<T: Real, L: Layout<Module = T, Chain = T>, const A: usize> Rod<L, A> {
    /// Measures all spans and tendons.
    #[inline(always)]
    pub fn measure_tendons(&self, columns: &mut TensionColumns<T, A>) {
        columns.spans.clear();
        columns.lengths.clear();
        let path = self.path;
        let of = |i| self.tendons.length_in_holes::<T>(i, path);
        let in_holes = (0..self.tendons.len()).map(of);
        columns.lengths.extend(in_holes);
        for (k, (state, c)) in self.states.iter().zip(&self.constants).enumerate() {
            for (j, holes) in self.tendons.in_group(k).iter().enumerate() {
                let span = Span::new(c, holes, &state.s, state.rho);
                if k <= self.tendons.end_disks[j] {
                    columns.lengths[j] += span.length;
                }
                columns.spans.push(span);
            }
        }
    }

    /// `linearise_and_eliminate`, with the columns, after `measure_tendons`.
    #[inline(always)]
    pub fn eliminate_with_tensions(&mut self, columns: &mut TensionColumns<T, A>) -> T {
        self.newton.symmetric = true;
        let count = columns.tendons.len();
        columns.flexibility.fill(T::zero());
        for column in &mut columns.scratch {
            column.p = Vec3::zero();
        }
        let mut value = Mat3::zero();
        let mut least_pivot = T::splat(f64::INFINITY);
        for k in (0..self.states.len()).rev() {
            let t = in_group(&self.tendons, &self.tensions, self.path, k);
            let (state, gradient) = (&self.states[k], &self.gradients[k]);
            let constants = &self.constants[k];
            let mut hessian = Hessian::empty();
            let end = state.hessian::<true>(constants, &t, gradient, &mut hessian);
            let blocks = blocks::<L, A, true>(&hessian, 0, &state.s, value, T::zero());
            let eliminated = &mut self.newton.eliminated[k];
            [[value]] = eliminated.eliminate::<true>(blocks, &mut least_pivot);
            let spans = &columns.spans[k * self.tendons.len()..];
            let passes = |tendon: usize| k <= self.tendons.end_disks[tendon];
            for c in 0..count {
                let tendon = columns.tendons[c];
                if !passes(tendon) {
                    continue;
                }
                let span = &spans[tendon];
                let moved = -(end.d_hat * span.direction);
                let on_end = end.m.tr_mul(span.direction);
                let p = state.s * columns.scratch[c].p;
                let turned = end.k * moved + span.arm.cross(span.direction) + p;
                let mut rhs = [turned; A];
                for a in 0..A {
                    rhs[a] += end.j[a].tr_mul(on_end);
                }
                let (mut solution, mut start) = (rhs, [p]);
                eliminated.backward::<true>(&mut solution, &mut start);
                columns.scratch[c].rhs = rhs;
                columns.scratch[c].p =
                    start[0] + state.stretching_load(constants, &[]).cross(moved);
                columns.own[k * count + c] = solution;
                for b in 0..=c {
                    if !passes(columns.tendons[b]) {
                        continue;
                    }
                    let mut sum = -spans[columns.tendons[b]].direction.dot(moved);
                    for a in 0..A {
                        sum += columns.scratch[b].rhs[a].dot(solution[a]);
                    }
                    columns.flexibility[c * (c + 1) / 2 + b] += sum;
                }
            }
        }
        least_pivot
    }

    /// Own solutions of the step at constant tensions, and how much it shortens the tendons of the
    /// columns.
    #[inline(always)]
    pub fn backward_with_tensions(&mut self, columns: &mut TensionColumns<T, A>) {
        let TensionColumns {
            tendons,
            own,
            shortened,
            ..
        } = columns;
        shortened.fill(T::zero());
        let count = tendons.len();
        self.backward_step::<true>(
            #[inline(always)]
            |k, rhs| {
                for (c, sum) in shortened.iter_mut().enumerate() {
                    for a in 0..A {
                        *sum += rhs[a].dot(own[k * count + c][a]);
                    }
                }
            },
        );
    }

    /// Rotations of the arcs by the step at constant tensions and the changes of tension of the
    /// columns (N), after `backward_with_tensions`; returns the largest (rad).
    #[inline(always)]
    pub fn forward_with_tensions(&mut self, columns: &TensionColumns<T, A>, changes: &[T]) -> T {
        let count = columns.tendons.len();
        for (k, step) in self.newton.step.iter_mut().enumerate() {
            for (c, change) in changes.iter().enumerate() {
                for a in 0..A {
                    step[a] = columns.own[k * count + c][a].scaled_add(*change, step[a]);
                }
            }
        }
        self.forward_step().largest
    }
}

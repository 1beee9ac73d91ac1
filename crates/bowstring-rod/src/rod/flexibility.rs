//! Rotation of every disk by a moment on it, from the last elimination.
//!
//! Theory: docs/theory/statics.md (Stability).

use crate::math::linalg::Mat3;
use crate::math::real::Layout;
use crate::rod::chain::Rod;
use crate::rod::groups::get_mat;

impl<L: Layout, const A: usize> Rod<L, A> {
    /// Visits the flexibility of every disk from base to tip: its rotation by a unit moment on it
    /// alone (rad/(N m)), in its own frame.
    ///
    /// For the last elimination, which must be symmetric and positive definite. Then the energy is
    /// `sum v . U v / 2` with `v = u + gain x` of all arcs, where `v` of one module does not depend
    /// on that of another, and the end of a module turns by the motion of its start, `x - sum(gain
    /// x)`, and the sum of `v`. A moment on a disk leaves `v` beyond it at zero, and the flexibility
    /// of the start adds to that of the module. One forward pass gives all disks.
    #[inline(always)]
    pub fn flexibilities(&self, mut visit: impl FnMut(usize, Mat3<L::Chain>)) {
        debug_assert!(self.newton.symmetric);
        let mut flexibility = Mat3::<L::Chain>::zero();
        for (k, module) in self.newton.eliminated.iter().enumerate() {
            let s = get_mat::<L>(&self.states[k / L::WIDTH].s, k % L::WIDTH);
            let carried = Mat3::identity() - module.turn_by_start();
            let end = carried * flexibility * carried.transpose() + module.flexibility();
            flexibility = (s.tr_mat(end) * s).mirrored();
            visit(k, flexibility);
        }
    }
}

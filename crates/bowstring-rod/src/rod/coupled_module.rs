//! A module whose section has coupled strains: what differs from plain sections.
//!
//! Theory: docs/theory/rod.md (Coupled sections).
//!
//! With the strain `u` of an arc, its points move along `e3 + B (u - rest)` instead of `e3`. Shear
//! and extension by the contact force, `R D R'` of every section, are integrated over each element by
//! Simpson's rule. Rotations are those of `rod::module`.
//!
//! Functions are not inlined, so that they do not slow the passes of plain sections.

use crate::math::lie::ArcMap;
use crate::math::linalg::{Mat3, Vec3};
use crate::math::real::Real;
use crate::rod::constants::Constants;
use crate::rod::coupling::{Coupling, Sway};
use crate::rod::state::State;

/// Passes of a module whose arcs depend on its section.
impl<T: Real, const A: usize> Constants<T, A> {
    /// End point of an arc (m).
    #[inline(always)]
    pub fn arc_end(&self, map: &ArcMap<T>) -> Vec3<T> {
        if T::PLAIN {
            if let Some(coupling) = self.coupling() {
                return coupling.end(map);
            }
        }
        map.end()
    }

    /// Derivative of the end point of an arc with respect to its rotation vector (m).
    #[inline(always)]
    pub fn arc_end_jacobian<const COUPLED: bool>(&self, map: &ArcMap<T>) -> Mat3<T> {
        if COUPLED {
            if let Some(coupling) = self.coupling() {
                return coupling.end_jacobian(map);
            }
        }
        map.end_jacobian()
    }

    /// Hessian of an arc; see [`ArcMap::hessian`].
    #[inline(always)]
    pub fn arc_hessian<const COUPLED: bool>(
        &self,
        map: &ArcMap<T>,
        n: Vec3<T>,
        m: Vec3<T>,
    ) -> Mat3<T> {
        if COUPLED {
            if let Some(coupling) = self.coupling() {
                return coupling.hessian(map, n, m);
            }
        }
        map.hessian(n, m)
    }

    /// Sum of a matrix and the elastic stiffness of an arc (N m).
    #[inline(always)]
    pub fn plus_own<const COUPLED: bool>(&self, i: usize, m: Mat3<T>) -> Mat3<T> {
        if COUPLED {
            if let Some(coupling) = self.coupling() {
                return m + coupling.own(self.part(i / 2));
            }
        }
        self.own[i].plus_mat(m)
    }

    /// Product of the elastic stiffness between the arcs of an element and a matrix (N m).
    #[inline(always)]
    pub fn mutual_times<const COUPLED: bool>(&self, e: usize, m: Mat3<T>) -> Mat3<T> {
        if COUPLED {
            if let Some(coupling) = self.coupling() {
                return coupling.mutual(self.part(e)) * m;
            }
        }
        self.mutual(e).times_mat(m)
    }
}

/// Fraction of the module that the section after this many arcs stands for.
#[inline(always)]
fn share<T: Real, const A: usize>(c: &Constants<T, A>, arcs: usize) -> T {
    c.simpson(arcs) * T::splat(1.0 / (3 * A) as f64)
}

impl<T: Real, const A: usize> State<T, A> {
    /// Rotation from the start to the end of an arc.
    fn turned(&self, arc: usize) -> &Mat3<T> {
        match self.arcs.get(arc + 1) {
            Some(next) => &next.prefix,
            None => &self.s,
        }
    }

    /// Displacement of the end by a unit contact force, by shear and extension (m/N).
    #[cold]
    #[inline(never)]
    pub fn coupled_compliance(&self, c: &Constants<T, A>, coupling: &Coupling<T>) -> Mat3<T> {
        let mut sum = coupling.compliance * share(c, 0);
        for i in 0..A {
            let r = self.turned(i);
            sum += (*r * coupling.compliance * r.transpose()) * share(c, i + 1);
        }
        (sum * c.flexible).mirrored()
    }

    /// Moment of each arc by shear and extension at constant contact force (N m).
    #[cold]
    #[inline(never)]
    pub fn sway_torques(&self, c: &Constants<T, A>, coupling: &Coupling<T>) -> [Vec3<T>; A] {
        let mut torques = [Vec3::zero(); A];
        let mut sum = Vec3::zero();
        for i in (0..A).rev() {
            let r = self.turned(i);
            let strain = *r * (coupling.compliance * r.tr_mul(self.n));
            sum += self.n.cross(strain) * (share(c, i + 1) * c.flexible);
            torques[i] = sum;
        }
        torques
    }

    /// All derivatives of shear and extension at constant contact force.
    #[cold]
    #[inline(never)]
    pub fn sway(&self, c: &Constants<T, A>, coupling: &Coupling<T>) -> Sway<T, A> {
        let (zero, n) = (Mat3::zero(), self.n);
        let mut sway = Sway {
            torque: self.sway_torques(c, coupling),
            motion: [zero; A],
            stiffness: [zero; A],
        };
        let (mut motion, mut stiffness) = (zero, zero);
        let turn = n.skew();
        for i in (0..A).rev() {
            let r = self.turned(i);
            let compliance = *r * coupling.compliance * r.transpose();
            let strain = compliance * n;
            let length = share(c, i + 1) * c.flexible;
            let moved = compliance * turn;
            motion += (moved - strain.skew()) * length;
            let second = turn.tr_mat(moved)
                + n.outer(strain)
                    .symmetric_part()
                    .add_diagonal([-n.dot(strain); 3]);
            stiffness -= second * length;
            sway.motion[i] = motion;
            sway.stiffness[i] = stiffness.mirrored();
        }
        sway
    }
}

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
use crate::math::real::{Maybe, Real};
use crate::model::coupled::{CoupledSection, Mixed};
use crate::model::load::{Model, Theory};
use crate::rod::constants::{Constants, FAR, NEAR, RIGID_IN_TORSION};
use crate::rod::module::{Gradient, Hessian, Response, State, Tendons};

/// Coupled section of a module.
#[derive(Clone, Copy, Debug)]
pub struct Coupling<T> {
    /// Moment by curvature and twist, at constant force (N m^2).
    pub moment: Mat3<T>,
    /// Curvature and twist by moment, at constant force (1/(N m^2)).
    pub flexibility: Mat3<T>,
    /// Shear and extension by curvature and twist, at constant force (m).
    pub shift: Mat3<T>,
    /// Shear and extension by force (1/N).
    pub compliance: Mat3<T>,
    /// Direction of points without curvature and force: `e3` less the shift at rest.
    pub along: Vec3<T>,
    /// Second derivative of the elastic energy with respect to the rotation vector of an arc, in an
    /// element of mean length (N m).
    own: Mat3<T>,
}

/// Shear and extension at constant contact force: derivatives of their work and of the motion that
/// they cause, with respect to the rotation added by each arc.
pub struct Sway<T, const A: usize> {
    /// Moment (N m).
    pub torque: [Vec3<T>; A],
    /// Motion of the end (m).
    pub motion: [Mat3<T>; A],
    /// Second derivative of the work by the rotation of this arc and of every arc before it (N m).
    pub stiffness: [Mat3<T>; A],
}

impl Coupling<f64> {
    /// In elements of mean length `h`, with the unloaded curvature `rest`.
    pub fn new(section: &CoupledSection, model: Model, rest: Vec3, h: f64) -> Self {
        let Mixed {
            mut moment,
            shift,
            compliance,
        } = section.mixed(model.theory == Theory::Cosserat);
        if !model.twist {
            moment.0[2][2] *= RIGID_IN_TORSION;
        }
        Coupling {
            moment,
            flexibility: moment.inverse().symmetric_part(),
            shift,
            compliance,
            along: Vec3::ez() - shift * rest,
            own: moment * (0.5 * (NEAR * NEAR + FAR * FAR) / h),
        }
    }

    /// The same in every lane.
    pub fn splat<T: Real>(&self) -> Coupling<T> {
        Coupling {
            moment: Mat3::splat(&self.moment),
            flexibility: Mat3::splat(&self.flexibility),
            shift: Mat3::splat(&self.shift),
            compliance: Mat3::splat(&self.compliance),
            along: Vec3::splat(self.along.0),
            own: Mat3::splat(&self.own),
        }
    }
}

impl<T: Real> Coupling<T> {
    /// Scales the stiffness of the arcs.
    pub fn stiffen(&mut self, elastic: &Self, factor: f64) {
        self.own = elastic.own * T::splat(factor);
    }

    /// Moment on a section with this curvature beyond that without load, times the length of an
    /// element, and the force on it in its own axes (N m).
    pub fn moment_at(&self, curved: Vec3<T>, per_element: T, force: Vec3<T>) -> Vec3<T> {
        self.moment * curved * per_element - self.shift.tr_mul(force)
    }

    /// What the vector from start to end of an arc becomes without its rotation (m).
    #[inline(always)]
    fn chord(&self, map: &ArcMap<T>) -> Vec3<T> {
        self.along
            .scaled_add(map.length(), self.shift * map.rotation_vector())
    }

    /// Hessian of `n . end(w) + m . eta(w)` of an arc; see [`ArcMap::hessian`].
    #[cold]
    #[inline(never)]
    fn hessian(&self, map: &ArcMap<T>, n: Vec3<T>, m: Vec3<T>) -> Mat3<T> {
        let mixed = self.shift.tr_mat(map.transposed_jacobian(n));
        map.hessian_along(self.chord(map), n, m) + mixed + mixed.transpose()
    }

    #[cold]
    #[inline(never)]
    fn end(&self, map: &ArcMap<T>) -> Vec3<T> {
        map.end_along(self.chord(map))
    }

    #[cold]
    #[inline(never)]
    fn end_jacobian(&self, map: &ArcMap<T>) -> Mat3<T> {
        map.end_along_jacobian(self.chord(map)) + map.left_jacobian() * self.shift
    }

    /// Second derivative of the elastic energy with respect to the rotation vector of an arc, where
    /// `part` is the length of its element over the mean (N m).
    #[cold]
    #[inline(never)]
    fn own(&self, part: T) -> Mat3<T> {
        self.own * (T::splat(1.0) / part)
    }

    /// The same with respect to both arcs of the element (N m).
    #[cold]
    #[inline(never)]
    fn mutual(&self, part: T) -> Mat3<T> {
        self.own * (T::splat(2.0 * NEAR * FAR / (NEAR * NEAR + FAR * FAR)) / part)
    }

    /// Moments of an element by the elastic rotation vectors of its arcs.
    #[cold]
    #[inline(never)]
    pub fn moments_of_element(&self, part: T, [a, b]: [Vec3<T>; 2]) -> [Vec3<T>; 2] {
        let (own, mutual) = (self.own(part), self.mutual(part));
        [own * a + mutual * b, own * b + mutual * a]
    }
}

/// Passes of a module whose arcs depend on its section.
impl<T: Real, const A: usize> Constants<T, A> {
    /// Coupled section of the module.
    #[inline(always)]
    pub fn coupling(&self) -> Option<&Coupling<T>> {
        self.coupled.get()
    }

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

    /// Gradient of a section that may be coupled; see [`State::gradient`].
    #[inline(never)]
    pub fn coupled_gradient(&self, c: &Constants<T, A>, t: &Tendons<T>, out: &mut Gradient<T, A>) {
        self.gradient_of::<true>(c, t, out);
    }

    /// Second derivatives of a section that may be coupled; see [`State::hessian`].
    #[inline(never)]
    pub fn coupled_hessian<const CONDENSED: bool>(
        &self,
        c: &Constants<T, A>,
        t: &Tendons<T>,
        grad: &Gradient<T, A>,
        out: &mut Hessian<T, A>,
    ) -> Response<T, A> {
        self.hessian_of::<CONDENSED, true>(c, t, grad, out)
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

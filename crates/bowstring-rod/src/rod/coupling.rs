//! Coupled section of a module: its stiffness and the maps of its arcs.
//!
//! Theory: docs/theory/rod.md (Coupled sections).

use crate::math::lie::ArcMap;
use crate::math::linalg::{Mat3, Vec3};
use crate::math::real::Real;
use crate::model::coupled::{CoupledSection, Mixed};
use crate::model::load::{Model, Theory, RIGID_IN_TORSION};
use crate::rod::gauss::{FAR, NEAR};

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
    pub fn hessian(&self, map: &ArcMap<T>, n: Vec3<T>, m: Vec3<T>) -> Mat3<T> {
        let mixed = self.shift.tr_mat(map.transposed_jacobian(n));
        map.hessian_along(self.chord(map), n, m) + mixed + mixed.transpose()
    }

    #[cold]
    #[inline(never)]
    pub fn end(&self, map: &ArcMap<T>) -> Vec3<T> {
        map.end_along(self.chord(map))
    }

    #[cold]
    #[inline(never)]
    pub fn end_jacobian(&self, map: &ArcMap<T>) -> Mat3<T> {
        map.end_along_jacobian(self.chord(map)) + map.left_jacobian() * self.shift
    }

    /// Second derivative of the elastic energy with respect to the rotation vector of an arc, where
    /// `part` is the length of its element over the mean (N m).
    #[cold]
    #[inline(never)]
    pub fn own(&self, part: T) -> Mat3<T> {
        self.own * (T::splat(1.0) / part)
    }

    /// The same with respect to both arcs of the element (N m).
    #[cold]
    #[inline(never)]
    pub fn mutual(&self, part: T) -> Mat3<T> {
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

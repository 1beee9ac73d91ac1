//! Constants of a module that do not depend on its load: lengths, stiffness and compliance.
//!
//! Theory: docs/theory/rod.md (Energy).

use crate::math::linalg::Vec3;
use crate::math::real::Real;
use crate::model::load::{Model, Theory};
use crate::model::robot::Robot;

/// Constants of a module that do not depend on its load.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Constants<T> {
    /// Flexible length (m).
    pub flexible: T,
    /// Inverse of the flexible length (1/m).
    pub per_flexible: T,
    /// Rigid lengths at start and end (m).
    pub clamp: [T; 2],
    /// Mass per length rho A (kg/m).
    pub mass_per_length: T,
    /// Bending and torsional stiffness over the length of an element (N m).
    pub stiffness: [T; 2],
    /// Axial compliance 1 / EA where the theory has extension (1/N).
    pub axial_compliance: T,
    /// Rotation of an unloaded element (rad).
    pub rest: Vec3<T>,
    /// Coefficients d0 to d3 (m/N) of the compliance D, theory Eq. 2.5.
    pub d: [T; 4],
}

impl Constants<f64> {
    pub fn new(robot: &Robot, k: usize, model: Model, elements: usize) -> Self {
        let m = robot.modules[k];
        let s = robot.section(k);
        let h = m.flexible / elements as f64;
        let (shear, axial) = match model.theory {
            Theory::Cosserat => (1.0 / s.shear, 1.0 / s.axial),
            Theory::Kirchhoff => (0.0, 0.0),
        };
        let torsion = s.torsion * if model.twist { 1.0 } else { 1e6 };
        // d3 of theory Eq. 2.5: a force N bends an element by a quadratic strain that the two arcs
        // lack; its energy is h^3 |s x N|^2 / (1440 EI), s the element's share of the change of
        // tangent
        let bubble = h.powi(3) / (720.0 * s.bending * elements as f64);
        let length = m.flexible;
        Constants {
            flexible: length,
            per_flexible: 1.0 / length,
            clamp: m.clamp,
            mass_per_length: s.mass_per_length,
            stiffness: [s.bending / h, torsion / h],
            axial_compliance: axial,
            rest: Vec3(s.rest_curvature) * h,
            d: [
                length * shear,
                length * (axial - shear),
                length * (axial - shear) / 12.0 - bubble,
                bubble,
            ],
        }
    }
}

impl<T: Real> Constants<T> {
    /// Constants of one lane.
    pub fn of_lane(&self, lane: usize) -> Constants<f64> {
        Constants {
            flexible: self.flexible.lane(lane),
            per_flexible: self.per_flexible.lane(lane),
            clamp: self.clamp.map(|x| x.lane(lane)),
            mass_per_length: self.mass_per_length.lane(lane),
            stiffness: self.stiffness.map(|x| x.lane(lane)),
            axial_compliance: self.axial_compliance.lane(lane),
            rest: self.rest.of_lane(lane),
            d: self.d.map(|x| x.lane(lane)),
        }
    }

    /// Constants of modules in SIMD lanes.
    pub fn gather(of: impl Fn(usize) -> Constants<f64>) -> Self {
        let pick = |f: &dyn Fn(&Constants<f64>) -> f64| T::from_fn(|i| f(&of(i)));
        Constants {
            flexible: pick(&|c| c.flexible),
            per_flexible: pick(&|c| c.per_flexible),
            clamp: [pick(&|c| c.clamp[0]), pick(&|c| c.clamp[1])],
            mass_per_length: pick(&|c| c.mass_per_length),
            stiffness: [pick(&|c| c.stiffness[0]), pick(&|c| c.stiffness[1])],
            axial_compliance: pick(&|c| c.axial_compliance),
            rest: Vec3([0, 1, 2].map(|q| pick(&|c| c.rest[q]))),
            d: [0, 1, 2, 3].map(|q| pick(&|c| c.d[q])),
        }
    }

    /// Fraction of an element's stiffness about the axes (N m).
    #[inline(always)]
    pub fn share_of_stiffness(&self, share: f64) -> [T; 3] {
        let [bending, torsion] = self.stiffness;
        let (b, t) = (bending * T::splat(share), torsion * T::splat(share));
        [b, b, t]
    }

    /// Stiffness of an element times a rotation vector (N m).
    #[inline(always)]
    pub fn moment(&self, w: Vec3<T>) -> Vec3<T> {
        let [bending, torsion] = self.stiffness;
        Vec3([w[0] * bending, w[1] * bending, w[2] * torsion])
    }
}

//! The rod in motion: data of the passes of a time step.
//!
//! Theory: docs/theory/dynamics.md.

use super::mass::LumpedMass;
use super::scheme::{Damping, Scheme};
use crate::math::real::{Layout, Real};
use crate::model::load::{Model, Theory};
use crate::model::robot::Robot;
use crate::rod::chain::Rod;
use crate::rod::constants::Constants;

/// Compliance of a Kirchhoff rod's module relative to its bending compliance: small enough not to
/// affect the motion, large enough to divide by.
const NEARLY_RIGID: f64 = 1e-5;

/// A rod with its mass and its time-integration scheme.
pub(super) struct Body<L: Layout, const A: usize> {
    /// Rod at the strain where forces balance.
    pub rod: Rod<L, A>,
    /// Constants with the stiffness of this step, material damping included.
    pub constants: Vec<Constants<L::Module, A>>,
    pub mass: LumpedMass<L, A>,
    pub scheme: Scheme,
}

impl<L: Layout, const A: usize> Body<L, A> {
    pub fn new(layout: L, robot: &Robot, model: Model, damping: Damping) -> Self {
        let mut rod = Rod::new(layout, robot, model);
        let rigid = model.theory == Theory::Kirchhoff;
        if rigid {
            rod.add_compliance(NEARLY_RIGID);
        }
        Body {
            constants: rod.constants.clone(),
            mass: LumpedMass::new(robot, &rod.fixed.modules),
            scheme: Scheme::new(damping, rigid),
            rod,
        }
    }

    /// Takes over modules that a load between their disks has divided.
    #[cold]
    pub fn divide(&mut self) {
        for (own, c) in self.constants.iter_mut().zip(&mut self.rod.constants) {
            if !own.divided_as(c) {
                if self.scheme.rigid {
                    c.d[0] += c.d[3] * L::Module::splat(NEARLY_RIGID);
                }
                own.clone_from(c);
            }
        }
        if let Some(source) = &self.rod.fixed.source {
            self.mass = LumpedMass::new(&source.0, &self.rod.fixed.modules);
        }
        self.stiffen();
    }

    /// Scales the stiffness by the material damping of this step.
    #[inline(always)]
    pub fn stiffen(&mut self) {
        for (c, elastic) in self.constants.iter_mut().zip(&self.rod.constants) {
            c.stiffen(elastic, self.scheme.strain_factor());
        }
    }
}

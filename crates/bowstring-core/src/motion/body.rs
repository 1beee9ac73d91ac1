//! The rod in motion as the passes of a step take it.

use super::mass::LumpedMass;
use super::scheme::{Damping, Scheme};
use crate::math::real::{Layout, Real};
use crate::model::load::{Model, Theory};
use crate::model::robot::Robot;
use crate::rod::chain::Rod;
use crate::rod::constants::Constants;

/// Compliance of a Kirchhoff rod's module over that of its bending: small enough not to show,
/// large enough to divide by.
const NEARLY_RIGID: f64 = 1e-5;

/// A rod with its mass, and the scheme that moves it.
pub(super) struct Body<L: Layout, const A: usize> {
    /// At the strain where forces balance.
    pub rod: Rod<L, A>,
    /// Stiffness with the material damping of this step.
    pub constants: Vec<Constants<L::Module>>,
    pub mass: LumpedMass<L, A>,
    pub scheme: Scheme,
}

impl<L: Layout, const A: usize> Body<L, A> {
    pub fn new(layout: L, robot: &Robot, model: Model, damping: Damping) -> Self {
        let mut rod = Rod::new(layout, robot, model);
        let rigid = model.theory == Theory::Kirchhoff;
        if rigid {
            rod.make_yielding(NEARLY_RIGID);
        }
        Body {
            constants: rod.constants.clone(),
            mass: LumpedMass::new(robot),
            scheme: Scheme::new(damping, rigid),
            rod,
        }
    }

    /// Scales the stiffness by what material damping adds to it in this step.
    #[inline(always)]
    pub fn stiffen(&mut self) {
        let factor = L::Module::splat(self.scheme.strain_factor());
        for (c, elastic) in self.constants.iter_mut().zip(&self.rod.constants) {
            c.stiffness = [elastic.stiffness[0] * factor, elastic.stiffness[1] * factor];
        }
    }
}

//! State of the tendons after a step, on which friction depends.
//!
//! Theory: docs/theory/actuation.md (History).

use super::line::Command;
use crate::math::linalg::Vec3;
use crate::model::load::OwnedLoad;

/// Largest number of time constants of a viscoelastic backbone or tendon.
pub const TERMS: usize = 2;

/// State of the tendons and of the backbone at the last step of a path.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct History {
    /// Tensions before the base holes (N).
    pub tensions: Vec<f64>,
    /// Drops of the logarithm of tension at the holes where spans begin, by modules and tendons.
    pub drops: Vec<f64>,
    /// Lengths of the spans less their elongation with friction (m), by modules and tendons.
    pub spans: Vec<f64>,
    /// Tendon displacements from the home pose (m).
    pub displacements: Vec<f64>,
    /// Strain of the backbone, from which the next step starts.
    pub(crate) strain: Vec<Vec3>,
    pub(crate) slip: Vec<Slip>,
    /// Curvature that the hysteresis has followed at both Gauss points of each element, from base to
    /// tip (1/m); empty without hysteresis and relaxation.
    pub plays: Vec<[f64; 2]>,
    /// Curvature that each term of the relaxation has followed at these points (1/m); empty without
    /// hysteresis and relaxation.
    pub lags: Vec<[[f64; 2]; TERMS]>,
    /// Elongation of each tendon by each term of its creep (m); empty without it.
    pub crept: Vec<[f64; TERMS]>,
    /// Commands of the last step.
    pub commands: Vec<Command>,
    /// Dead loads of the last step, without tensions.
    pub load: OwnedLoad,
}

impl History {
    /// Whether another history has the same modules, elements and tendons.
    pub(crate) fn is_alike(&self, other: &Self) -> bool {
        let sizes = |of: &Self| (of.strain.len(), of.drops.len(), of.tensions.len());
        sizes(self) == sizes(other)
    }

    /// Copies another history of the same robot; allocates nothing.
    pub(crate) fn copy_from(&mut self, other: &Self) {
        self.tensions.clone_from(&other.tensions);
        self.drops.clone_from(&other.drops);
        self.spans.clone_from(&other.spans);
        self.displacements.clone_from(&other.displacements);
        self.strain.clone_from(&other.strain);
        self.slip.clone_from(&other.slip);
        self.plays.clone_from(&other.plays);
        self.lags.clone_from(&other.lags);
        self.crept.clone_from(&other.crept);
        self.commands.clone_from(&other.commands);
        self.load.clone_from(&other.load);
    }
}

/// State of a tendon at a hole.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) enum Slip {
    /// Slips towards the base.
    Towards = 1,
    Away = -1,
    #[default]
    Sticks = 0,
}

//! State of the tendons after a step: all that friction remembers.

use super::line::Command;
use crate::math::linalg::Vec3;

/// State of the tendons and of the backbone at the last step of a path.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct History {
    /// Before the base hole, N.
    pub tensions: Vec<f64>,
    /// By modules and tendons: drop of the logarithm of tension at the hole where the span
    /// begins, and length of the span less its creep, m.
    pub drops: Vec<f64>,
    pub spans: Vec<f64>,
    /// Tendon displacements since home, m.
    pub pulls: Vec<f64>,
    /// Strain of the backbone, where the next step starts from.
    pub(crate) strain: Vec<Vec3>,
    pub(crate) slip: Vec<Slip>,
    /// Of the last step; the load is gravity, tip force and tip moment.
    pub commands: Vec<Command>,
    pub load: [[f64; 3]; 3],
}

impl History {
    /// Takes on another of the same robot; allocates nothing.
    pub(crate) fn copy_from(&mut self, other: &Self) {
        self.tensions.clone_from(&other.tensions);
        self.drops.clone_from(&other.drops);
        self.spans.clone_from(&other.spans);
        self.pulls.clone_from(&other.pulls);
        self.strain.clone_from(&other.strain);
        self.slip.clone_from(&other.slip);
        self.commands.clone_from(&other.commands);
        self.load = other.load;
    }
}

/// What a tendon does at a hole.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) enum Slip {
    /// Towards the base.
    Towards,
    Away,
    #[default]
    Sticks,
}

//! Tendon lines and their commands.
//!
//! Theory: docs/theory/actuation.md.

/// Transmission between a motor and the base hole of a tendon, and the tendon's elasticity and
/// friction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Line {
    /// Axial stiffness E A of the tendon (N); infinite if it is inextensible.
    pub stiffness: f64,
    /// Free length of tendon between motor and base hole (m).
    pub free_length: f64,
    /// Compliance of the transmission (m/N).
    pub compliance: f64,
    /// Coefficient of Coulomb friction at every hole except the anchor.
    pub friction: f64,
    /// Angle by which the tendon turns between motor and base hole, with the friction of the holes
    /// (rad).
    pub wrap: f64,
    /// Tension in the home pose, where the displacement is zero (N).
    pub pretension: f64,
    /// Half the free travel of the drive when it reverses (m).
    pub backlash: f64,
    /// Difference of the radii of hole and tendon (m): the tendon loses displacement where the
    /// backbone bends (theory Eq. 4.10).
    pub hole_clearance: f64,
    /// Displacement that the mount of the drives takes from this tendon for each newton of the sum
    /// of all tensions (m/N, theory Eq. 4.10).
    pub mount_compliance: f64,
}

impl Default for Line {
    /// An inextensible tendon without friction.
    fn default() -> Self {
        Line {
            stiffness: f64::INFINITY,
            free_length: 0.0,
            compliance: 0.0,
            friction: 0.0,
            wrap: 0.0,
            pretension: 0.0,
            backlash: 0.0,
            hole_clearance: 0.0,
            mount_compliance: 0.0,
        }
    }
}

impl Line {
    /// Whether displacement is lost in holes or mount.
    pub(crate) fn loses(&self) -> bool {
        self.hole_clearance > 0.0 || self.mount_compliance > 0.0
    }

    /// Largest drop of the logarithm of the tension at a hole where the tendon turns by `angle`
    /// (rad), which at the base hole includes friction between it and the motor (theory Eq. 4.4).
    pub(crate) fn friction_bound(&self, hole: usize, angle: f64) -> f64 {
        self.friction * (angle + if hole == 0 { self.wrap } else { 0.0 })
    }
}

/// Command of a motor to its tendon.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Command {
    /// Tension before the base hole (N).
    Tension(f64),
    /// Tendon displacement from the home pose (m); negative where the tendon is lengthened.
    Displacement(f64),
}

impl Command {
    /// Whether it is a displacement.
    pub fn is_displacement(&self) -> bool {
        matches!(self, Command::Displacement(_))
    }

    /// The tension (N) or the displacement (m).
    pub fn value(&self) -> f64 {
        match *self {
            Command::Tension(value) | Command::Displacement(value) => value,
        }
    }

    /// Command that reaches the tendon through a drive with this backlash (m), after a displacement
    /// (theory Eq. 4.9).
    pub(crate) fn through(&self, backlash: f64, before: f64) -> Self {
        match *self {
            Command::Displacement(p) => {
                Command::Displacement(before.clamp(p - backlash, p + backlash))
            }
            Command::Tension(_) => *self,
        }
    }

    /// The same kind of command with another value.
    pub(crate) fn with(&self, value: f64) -> Self {
        match self {
            Command::Tension(_) => Command::Tension(value),
            Command::Displacement(_) => Command::Displacement(value),
        }
    }
}

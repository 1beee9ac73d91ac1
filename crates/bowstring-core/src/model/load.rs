//! Loads and the physics to solve.
//!
//! Theory: docs/theory/rod.md (Loads).

use crate::math::linalg::Vec3;
use crate::model::error::{Argument, InputError, Rule};
use crate::model::robot::Robot;

/// Rod theory of the backbone.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Theory {
    /// With shear and extension.
    Cosserat,
    /// Inextensible and unshearable.
    Kirchhoff,
}

/// Path of a tendon between two disks.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum TendonPath {
    /// Straight spans from hole to hole, as in a real robot.
    Straight,
    /// A curve parallel to the backbone: the model of most published codes, for comparison. Shear
    /// under tension is neglected, which is exact where the backbone does not twist.
    Continuous,
}

/// The physics to solve.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Model {
    /// Rod theory of the backbone.
    pub theory: Theory,
    /// Path of the tendons between disks.
    pub tendon: TendonPath,
    /// Whether the backbone can twist; if not, its torsional stiffness is multiplied by a million.
    pub twist: bool,
}

impl Default for Model {
    fn default() -> Self {
        Model {
            theory: Theory::Cosserat,
            tendon: TendonPath::Straight,
            twist: true,
        }
    }
}

/// Model of the rod: its physics and its elements.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct RodModel {
    /// Physics.
    pub model: Model,
    /// Fourth-order elements in a module: 1, 2, 4 or 8; `None` chooses them for each load.
    pub elements: Option<usize>,
}

/// Dead loads in the base frame and the tension of each tendon; SI units.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Load<'a> {
    /// Tensions (N), one for each tendon, none negative.
    pub tensions: &'a [f64],
    /// Gravity (m/s^2).
    pub gravity: [f64; 3],
    /// Force on the tip (N).
    pub tip_force: [f64; 3],
    /// Moment on the tip (N m).
    pub tip_moment: [f64; 3],
}

/// A [`Load`] that owns its tensions.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct OwnedLoad {
    /// Tensions (N), one for each tendon.
    pub tensions: Vec<f64>,
    /// Gravity (m/s^2).
    pub gravity: [f64; 3],
    /// Force on the tip (N).
    pub tip_force: [f64; 3],
    /// Moment on the tip (N m).
    pub tip_moment: [f64; 3],
}

impl OwnedLoad {
    /// Copies a load; allocates nothing if the number of tensions is the same.
    pub fn set(&mut self, load: &Load) {
        self.tensions.clear();
        self.tensions.extend_from_slice(load.tensions);
        (self.gravity, self.tip_force, self.tip_moment) =
            (load.gravity, load.tip_force, load.tip_moment);
    }

    /// Borrows it as a [`Load`].
    pub fn borrow(&self) -> Load<'_> {
        Load {
            tensions: &self.tensions,
            gravity: self.gravity,
            tip_force: self.tip_force,
            tip_moment: self.tip_moment,
        }
    }

    /// Interpolates linearly between two loads, gravity excepted.
    pub(crate) fn between(&mut self, from: &Self, to: &Self, share: f64) {
        // the end is met exactly
        let whole = (share - 1.0).abs() < 1e-12;
        let mix = |a: f64, b: f64| if whole { b } else { a + share * (b - a) };
        for i in 0..self.tensions.len() {
            self.tensions[i] = mix(from.tensions[i], to.tensions[i]);
        }
        for i in 0..3 {
            self.tip_force[i] = mix(from.tip_force[i], to.tip_force[i]);
            self.tip_moment[i] = mix(from.tip_moment[i], to.tip_moment[i]);
        }
    }
}

impl Load<'_> {
    /// The same load with a tip moment below `least` (N m) removed: it is below the residual, but
    /// as it has no potential it would change how stability is determined.
    pub(crate) fn without_moment_below(&self, least: f64) -> Self {
        let mut load = *self;
        if Vec3(self.tip_moment).norm() <= least {
            load.tip_moment = [0.0; 3];
        }
        load
    }

    /// Checks numbers and their count against the robot.
    pub fn check(&self, robot: &Robot) -> Result<(), InputError> {
        let tendons = robot.tendon_count();
        if self.tensions.len() != tendons {
            let given = self.tensions.len();
            return Err(InputError::count(
                Argument::Tension,
                given,
                tendons,
                "tendon",
            ));
        }
        for (i, t) in self.tensions.iter().enumerate() {
            if !(t.is_finite() && *t >= 0.0) {
                let rule = match t.is_finite() {
                    true => Rule::TendonsPull,
                    false => Rule::Finite,
                };
                return Err(InputError::number(Argument::Tension, i, *t, rule));
            }
        }
        for (argument, v) in [
            (Argument::Gravity, &self.gravity),
            (Argument::TipForce, &self.tip_force),
            (Argument::TipMoment, &self.tip_moment),
        ] {
            InputError::check_finite(argument, None, v)?;
        }
        Ok(())
    }
}

//! Hysteresis of the backbone: a play operator on the curvature of every module.
//!
//! Theory: docs/theory/actuation.md (Hysteresis of the backbone).

use crate::dispatch::Passes;
use crate::math::linalg::Vec3;
use crate::model::error::InputError;
use crate::model::robot::{Profile, Robot};

/// Rate-independent hysteresis of the backbone of one segment.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Hysteresis {
    /// Unloaded curvature over the curvature that the play has followed; zero if elastic.
    pub share: f64,
    /// Half-width of the play (1/m): change of curvature that leaves no set.
    pub play: f64,
}

impl Hysteresis {
    fn check(&self) -> Result<(), InputError> {
        let share = (0.0..1.0).contains(&self.share);
        if !(share && self.play >= 0.0 && self.play.is_finite()) {
            return Err(InputError::other(format!(
                "hysteresis has share {} and play {} 1/m; the share must be >= 0 and < 1, the play finite and >= 0 1/m",
                self.share, self.play
            )));
        }
        Ok(())
    }
}

/// Plays of the modules at the present strain.
#[derive(Clone)]
pub(crate) struct Plays {
    modules: Vec<Module>,
    /// Curvature beyond `rest` that each module's play has followed (1/m).
    pub now: Vec<[f64; 2]>,
}

#[derive(Clone)]
struct Module {
    law: Hysteresis,
    /// Curvature without load and history (1/m).
    rest: Vec3,
    per_length: f64,
}

impl Plays {
    /// Plays of a robot, with one law for each segment; `None` if all are elastic.
    ///
    /// # Errors
    /// If a number is out of range, or a section has coupled strains.
    pub fn new(robot: &Robot, laws: &[Hysteresis]) -> Result<Option<Self>, InputError> {
        laws.iter().try_for_each(Hysteresis::check)?;
        if laws.iter().all(|law| law.share == 0.0) {
            return Ok(None);
        }
        let backbone = &robot.spec().backbone;
        if laws.len() != backbone.len() {
            return Err(InputError::other(format!(
                "{} laws of hysteresis were given, a robot with {} segments needs one for each",
                laws.len(),
                backbone.len()
            )));
        }
        if backbone.iter().any(|p| matches!(p, Profile::Coupled(_))) {
            return Err(InputError::other(
                "hysteresis needs sections without coupled strains",
            ));
        }
        let module = |k: usize| {
            let segment = robot.spec().disks[k].segment;
            Module {
                law: laws[segment],
                rest: Vec3(robot.profile(k).sections()[0].rest_curvature),
                per_length: 1.0 / robot.modules[k].flexible,
            }
        };
        let modules: Vec<_> = (0..robot.module_count()).map(module).collect();
        Ok(Some(Plays {
            now: vec![[0.0; 2]; modules.len()],
            modules,
        }))
    }

    /// Moves the plays from those at the last step, `old`, to the present strain of `arcs` in each
    /// module, and sets the unloaded curvature of the modules.
    pub fn follow(&mut self, engine: &mut dyn Passes, arcs: usize, old: &[[f64; 2]]) {
        let (now, modules) = (&mut self.now, &self.modules);
        for (now, Module { rest, .. }) in now.iter_mut().zip(modules) {
            *now = [-rest[0], -rest[1]];
        }
        engine.strains(&mut |i, w| {
            let k = i / arcs;
            now[k][0] += w[0] * modules[k].per_length;
            now[k][1] += w[1] * modules[k].per_length;
        });
        for ((now, old), module) in now.iter_mut().zip(old).zip(modules) {
            *now = followed(*old, *now, module.law.play);
        }
        engine.set_rest(&|k| {
            let (share, [x, y]) = (modules[k].law.share, now[k]);
            modules[k].rest + Vec3([x, y, 0.0]) * share
        });
    }
}

/// Play in the plane: the point of the disk of radius `play` about `to` that is nearest to `from`.
fn followed(from: [f64; 2], to: [f64; 2], play: f64) -> [f64; 2] {
    let apart = [from[0] - to[0], from[1] - to[1]];
    let distance = apart[0].hypot(apart[1]);
    if distance <= play {
        return from;
    }
    let share = play / distance;
    [to[0] + share * apart[0], to[1] + share * apart[1]]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_play_follows_at_its_half_width() {
        let mut at = [0.0; 2];
        for (to, expected) in [(0.9, 0.0), (3.0, 2.0), (2.5, 2.0), (1.5, 2.0), (-3.0, -2.0)] {
            at = followed(at, [to, 0.0], 1.0);
            assert_eq!(at, [expected, 0.0]);
        }
        // across, the play is the same in every direction
        let turned = followed([0.0; 2], [3.0, 4.0], 1.0);
        assert!((turned[0] - 2.4).abs() < 1e-15 && (turned[1] - 3.2).abs() < 1e-15);
    }

    #[test]
    fn a_law_out_of_range_is_refused() {
        for (share, play) in [(1.0, 1.0), (-0.1, 1.0), (f64::NAN, 1.0), (0.2, f64::NAN)] {
            assert!(Hysteresis { share, play }.check().is_err());
        }
    }
}

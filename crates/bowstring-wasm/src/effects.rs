//! Effects that constant curvature leaves out, removed from the rod one at a time: the definitions of
//! the package's `bowstring.validity.effects`.

use crate::bench::Bench;
use crate::loads::Loads;
use bowstring_core::model::error::InputError;
use bowstring_core::model::load::{TendonPath, Theory};
use bowstring_core::model::robot::{Profile, Robot};
use bowstring_core::statics::adaptive::Adaptive;
use bowstring_core::statics::path::{Command, PathSolver};
use bowstring_core::statics::solver::{Solver, Status};
use wasm_bindgen::prelude::wasm_bindgen;

/// Effects of the rod and its tendons that constant curvature leaves out.
#[wasm_bindgen]
#[derive(Clone, Copy, Debug)]
pub enum Effect {
    /// Tendons straight between the disks; without it a continuous tendon. Under displacements it is
    /// not removed.
    StraightSpans,
    /// Clamped lengths at the disks.
    Clamps,
    /// Entry and exit planes of the holes; without it points in the mid-plane.
    HolePlanes,
    /// Shear and extension of the backbone.
    ShearExtension,
    /// Torsion of the backbone.
    Torsion,
}

/// Sets lengths to zero; returns whether one was not.
fn removed<'a>(lengths: impl Iterator<Item = &'a mut f64>) -> bool {
    let mut any = false;
    for length in lengths {
        any |= std::mem::take(length) != 0.0;
    }
    any
}

impl Bench {
    /// Tip (m) of the rod without an effect, from the home pose; `None` where the effect does not
    /// act and where there is no equilibrium.
    pub fn tip_without(
        &self,
        effect: Effect,
        displacements: bool,
        commands: &[f64],
        loads: &Loads,
    ) -> Result<Option<[f64; 3]>, String> {
        let mut spec = self.robot().spec().clone();
        let mut model = self.model();
        let acts = match effect {
            Effect::StraightSpans => {
                // a continuous tendon has no displacements, and none is beside coupled strains
                let coupled = |profile: &Profile| matches!(profile, Profile::Coupled(_));
                let straight = model.tendon == TendonPath::Straight;
                model.tendon = TendonPath::Continuous;
                straight && !displacements && !spec.backbone.iter().any(coupled)
            }
            Effect::Clamps => removed(spec.disks.iter_mut().map(|d| &mut d.clamped_length)),
            Effect::HolePlanes => removed(spec.disks.iter_mut().map(|d| &mut d.hole_length)),
            Effect::ShearExtension => {
                std::mem::replace(&mut model.theory, Theory::Kirchhoff) != Theory::Kirchhoff
            }
            Effect::Torsion => std::mem::take(&mut model.twist),
        };
        if !acts {
            return Ok(None);
        }
        let said = |error: InputError| error.to_string();
        let robot = Robot::new(spec).map_err(said)?;
        let tip = |solver: &Solver, status| match status {
            Status::Converged => solver.tip().map(|pose| pose.position.0),
            _ => None,
        };
        if displacements {
            let mut path = PathSolver::new(&robot, model, None, self.lines()).map_err(said)?;
            let commands: Vec<_> = commands.iter().map(|c| Command::Displacement(*c)).collect();
            let outcome = path.step(&commands, &loads.with(&[])).map_err(said)?;
            return Ok(tip(path.solver(), outcome.status));
        }
        let mut rod = Adaptive::new(&robot, model, None).map_err(said)?;
        let outcome = rod.solve(&loads.with(commands)).map_err(said)?;
        Ok(tip(rod.solver(), outcome.status))
    }
}

//! Inverse kinematics: tensions that bring the tip to a point.

use crate::bench::Bench;
use crate::loads::Loads;
use bowstring_core::model::load::RodModel;
use bowstring_core::statics::inverse::{InverseSolver, InverseStatus, Limits, Target};

/// Distance beyond that of the nearest tip, over the length, that smaller tensions may cost: less
/// than the error of a pointer and of one element a module.
const MARGIN: f64 = 1e-3;

impl Bench {
    /// Tensions (N) from zero to `most` whose tip is nearest to a point (m) under dead loads; `None`
    /// without an equilibrium. `warm` starts from the tensions found last.
    pub fn reach(
        &mut self,
        position: [f64; 3],
        most: &[f64],
        loads: &Loads,
        warm: bool,
    ) -> Result<Option<&[f64]>, String> {
        let target = Target {
            position,
            direction: None,
        };
        let least = vec![0.0; most.len()];
        let limits = Limits {
            least: &least,
            most,
        };
        let load = loads.with(&least);
        target.check().map_err(|e| e.to_string())?;
        limits.check(self.robot()).map_err(|e| e.to_string())?;
        load.check(self.robot()).map_err(|e| e.to_string())?;
        let solver = match self.inverse.take() {
            Some(solver) => solver,
            None => {
                let model = RodModel {
                    model: self.model(),
                    elements: Some(1),
                };
                let made = InverseSolver::new(self.robot(), model, MARGIN);
                Box::new(made.map_err(|e| e.to_string())?)
            }
        };
        let solver = self.inverse.insert(solver);
        let found = solver.solve(&load, &target, &limits, warm);
        Ok((found.status != InverseStatus::NoEquilibrium).then(|| solver.tensions()))
    }
}

//! Discretisation error of a step of a path.
//!
//! Theory: docs/theory/statics.md (Discretisation error).

use crate::criteria::solve_regularised;
use crate::outcome::PathOutcome;
use crate::rod::estimate::{Correction, ErrorEstimate, Verdict};
use crate::rod::responses::Sources;
use crate::statics::path_step::PathStep;

/// Safety factors of the error estimates of tip and tension with a memory and without a companion: the
/// estimate keeps span tensions and unloaded curvatures constant, which change with the bends.
/// Measured against finer elements.
const MEMORY_SAFETY: [f64; 2] = [1.5, 8.0];

impl PathStep {
    /// Estimates the discretisation error of the converged step: from the defects of its
    /// elements, and from its differences to another path, of tip (m) and tensions (N), if given. Returns
    /// the elements that the tolerances need.
    ///
    /// `carried` is the error of the state before the step that is in neither; with a memory the
    /// estimate is at least that. At the lengths held by displacement control, changes
    /// of tension compensate the length errors.
    pub fn estimate_error(
        &mut self,
        outcome: &mut PathOutcome,
        differences: Option<[f64; 2]>,
        carried: &ErrorEstimate,
    ) -> usize {
        let mut found = self.solver.engine.estimate();
        let memory = self.has_memory();
        let mut largest = self.correct_tensions(&mut found);
        if let Some([motion, tension]) = differences {
            // more elements do not reduce all errors: averages of shear and extension remain
            let larger = |own: f64, x: f64| if own.is_finite() { own.max(x) } else { x };
            found.motion = larger(found.motion, motion);
            largest = larger(largest, tension);
        } else if memory {
            found.motion *= MEMORY_SAFETY[0];
            largest *= MEMORY_SAFETY[1];
        }
        let tensions = &self.transmission.tendons.now.tensions;
        let tautest = tensions.iter().fold(0.0, |a: f64, t| a.max(t.abs()));
        let verdict = Verdict::new(
            &found,
            [largest, tautest],
            outcome.stable,
            self.solver.robot().length(),
            self.solver.elements(),
        );
        outcome.stable = verdict.stable;
        let mut error = verdict.error;
        if memory {
            error = error.at_least(1.0, carried);
        }
        outcome.error = Some(error);
        verdict.needed
    }

    /// Adds the motion by the changes of tension that compensate the errors of the held lengths;
    /// returns the largest of these changes (N).
    fn correct_tensions(&mut self, found: &mut Correction<f64>) -> f64 {
        let tendons = &self.transmission.tendons;
        let commands = &tendons.now.commands;
        let held: Vec<usize> = (0..commands.len())
            .filter(|&i| commands[i].is_displacement() && tendons.is_taut(i))
            .collect();
        if held.is_empty() {
            return 0.0;
        }
        let changes = self.tension_errors(&held);
        let mut largest = changes.iter().fold(0.0, |a: f64, t| a.max(t.abs()));
        if changes.iter().any(|t| !t.is_finite()) {
            largest = f64::NAN;
        }
        let coefficients: Vec<f64> = std::iter::once(1.0).chain(changes).collect();
        found.motion = self.solver.engine.correct(&coefficients);
        largest
    }

    /// Changes of tension that compensate the errors of the held lengths (N).
    fn tension_errors(&mut self, held: &[usize]) -> Vec<f64> {
        let (engine, tendons) = (&mut *self.solver.engine, &self.transmission.tendons);
        let n = engine.module_count();
        let lacks: Vec<f64> = held.iter().map(|&i| engine.length_error(i)).collect();
        let mut spans = vec![0.0; held.len() * n];
        for (c, &i) in held.iter().enumerate() {
            for k in 0..n {
                spans[c * n + k] = tendons.carried[k * tendons.lines.len() + i];
            }
        }
        engine.measure_spans(false);
        engine.respond(Sources {
            tendons: held,
            tensions: &spans,
        });
        let size = held.len();
        let (mut matrix, mut row) = (vec![0.0; size * size], vec![0.0; 1 + size]);
        for (r, &i) in held.iter().enumerate() {
            engine.beyond(0, i, &mut row);
            tendons.take_clearance(engine, i, &mut row);
            for c in 0..size {
                matrix[r * size + c] = tendons.lines[i].mount_compliance - row[1 + c];
            }
            matrix[r * size + r] += tendons.whole_compliance(i);
        }
        solve_regularised(&mut matrix, lacks)
    }
}

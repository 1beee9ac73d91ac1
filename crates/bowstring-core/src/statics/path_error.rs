//! Discretisation error of a step of a path.
//!
//! Theory: docs/theory/statics.md (Discretisation error).

use crate::criteria::solve_regularised;
use crate::outcome::PathOutcome;
use crate::rod::estimate::{ErrorEstimate, Verdict};
use crate::rod::responses::Sources;
use crate::statics::path_step::PathStep;

/// Safety factors of the error estimates of tip and tension with a memory: the estimate keeps span tensions and unloaded curvatures constant, which change with the bends. Measured
/// against finer elements.
const MEMORY_SAFETY: [f64; 2] = [1.5, 8.0];

impl PathStep {
    /// Estimates the discretisation error of the converged step, at least `remembered` with
    /// memory: at the lengths held by displacement control, changes of tension compensate the
    /// length errors. Returns the elements that the tolerances need.
    pub fn estimate_error(
        &mut self,
        outcome: &mut PathOutcome,
        remembered: &ErrorEstimate,
    ) -> usize {
        let mut found = self.solver.engine.estimate();
        let tendons = &self.transmission.tendons;
        let (commands, tensions) = (&tendons.now.commands, &tendons.now.tensions);
        let held: Vec<usize> = (0..commands.len())
            .filter(|&i| commands[i].is_displacement() && tensions[i] > 0.0)
            .collect();
        let tautest = tensions.iter().fold(0.0, |a: f64, t| a.max(*t));
        let mut largest = 0.0;
        if !held.is_empty() {
            let changes = self.tension_errors(&held);
            largest = changes.iter().fold(0.0, |a: f64, t| a.max(t.abs()));
            if changes.iter().any(|t| !t.is_finite()) {
                largest = f64::NAN;
            }
            let coefficients: Vec<f64> = std::iter::once(1.0).chain(changes).collect();
            found.motion = self.solver.engine.correct(&coefficients);
        }
        let memory = self.has_memory();
        let safety = if memory { MEMORY_SAFETY } else { [1.0; 2] };
        found.motion *= safety[0];
        let verdict = Verdict::new(
            &found,
            [largest * safety[1], tautest],
            outcome.stable,
            self.solver.robot().length(),
            self.solver.elements(),
        );
        outcome.stable = verdict.stable;
        let mut error = verdict.error;
        if let Some(unloaded) = &self.unloaded {
            let arcs = 2 * self.solver.elements();
            let engine = &mut *self.solver.engine;
            error.tip += unloaded.neglected_motion(engine, arcs, found.compression);
        }
        if memory {
            error.tip = error.tip.max(remembered.tip);
            error.tension = error.tension.max(remembered.tension);
        }
        outcome.error = Some(error);
        verdict.needed
    }

    /// Changes of tension that compensate the errors of the held lengths (N).
    fn tension_errors(&mut self, held: &[usize]) -> Vec<f64> {
        let (engine, tendons) = (&mut *self.solver.engine, &self.transmission.tendons);
        let n = engine.module_count();
        let lacks: Vec<f64> = held.iter().map(|&i| engine.length_error(i)).collect();
        let mut spans = vec![0.0; held.len() * n];
        for (c, &i) in held.iter().enumerate() {
            for k in 0..n {
                spans[c * n + k] = engine.span_tension(k, i) / tendons.now.tensions[i];
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
            for c in 0..size {
                matrix[r * size + c] = -row[1 + c];
            }
            matrix[r * size + r] += tendons.whole_compliance(i);
        }
        solve_regularised(&mut matrix, lacks)
    }
}

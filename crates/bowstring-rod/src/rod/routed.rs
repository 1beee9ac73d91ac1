//! Interface of a rod, at rest or in motion, for the laws of its tendons.
//!
//! Theory: docs/theory/actuation.md.

use crate::rod::responses::Sources;

/// A rod with tendons routed along it.
pub trait RoutedRod {
    /// Measures all spans where forces balance and at the end of the step.
    fn measure_spans(&mut self, angles: bool);
    /// Span lengths by modules and tendons, at the end of the step (m).
    fn span_lengths(&self) -> &[f64];
    /// Angles of the tendons at the holes, where forces balance (rad).
    fn angles(&self) -> &[f64];
    /// Solves for right-hand sides with the present elimination: its own imbalance in the first
    /// column, changes of tension in the others.
    fn respond(&mut self, sources: Sources);
    /// Length change of a tendon from a hole on, for each of the solutions.
    fn beyond(&self, hole: usize, tendon: usize, out: &mut [f64]);
    /// Bend of the backbone from the base to the end of a module (rad).
    fn bend(&self, module: usize) -> f64;
    /// Adds a multiple of the change of that bend for each of the solutions.
    fn add_bending(&self, module: usize, factor: f64, out: &mut [f64]);
    /// Sets span tensions by modules and tendons (N).
    fn set_span_tensions(&mut self, tensions: &[f64]);
}

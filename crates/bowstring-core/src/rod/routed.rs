//! What the laws of the tendons need of a rod, at rest or in motion.

use crate::rod::chain::Sources;

/// A rod with tendons routed along it.
pub(crate) trait RoutedRod {
    /// Measures all spans where forces balance and at the end of the step.
    fn measure_spans(&mut self, angles: bool);
    /// By modules and tendons, at the end of the step, m.
    fn span_lengths(&self) -> &[f64];
    /// Of the tendons at the holes, where forces balance, rad.
    fn angles(&self) -> &[f64];
    /// Solves for right-hand sides by the present elimination: in the first column its own
    /// imbalance, in the next more tension.
    fn respond(&mut self, sources: Sources);
    /// Change of a tendon's length from a hole on, by each of the solutions.
    fn beyond(&self, hole: usize, tendon: usize, out: &mut [f64]);
    /// By modules and tendons, N.
    fn set_span_tensions(&mut self, tensions: &[f64]);
}

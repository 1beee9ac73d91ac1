//! Trust region of descent and relaxation: its radii, and what decides on a step.

/// First radius of the trust region, over the unit of tension.
pub(super) const FIRST_RADIUS: f64 = 1.5;
/// Radius at which the iteration ends.
pub(super) const LEAST_RADIUS: f64 = 1e-8;
/// Factors of the radius after a good step at its limit and after a rejected one.
pub(super) const LARGER: f64 = 2.5;
pub(super) const SMALLER: f64 = 0.3;
/// Required decrease of the distance, over the predicted one.
pub(super) const SUFFICIENT_DECREASE: f64 = 0.1;
/// Distance over length below which steps to smaller tensions may increase it.
pub(super) const NEAR: f64 = 1e-2;

/// Half the sum of squares.
pub(super) fn half_square(tensions: &[f64]) -> f64 {
    0.5 * tensions.iter().map(|t| t * t).sum::<f64>()
}

//! Elastic section of the backbone.

/// Elastic section of the backbone; SI units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Section {
    /// Bending stiffness E I about the first and the second principal axis (N m^2).
    pub bending: [f64; 2],
    /// Angle of the first principal axis from x, counter-clockwise about z (rad).
    pub principal_angle: f64,
    /// Torsional stiffness G J (N m^2).
    pub torsion: f64,
    /// Axial stiffness E A (N).
    pub axial: f64,
    /// Shear stiffness G A times the shear factor (N).
    pub shear: f64,
    /// Mass per length rho A (kg/m).
    pub mass_per_length: f64,
    /// Rotary inertia per length rho I (kg m): the mean about the principal axes, which is half of
    /// that about the axis of the backbone. Used in dynamics only.
    pub rotary_inertia: f64,
    /// Curvature about x and y and twist about z of the unloaded backbone, in its own frame (1/m).
    pub rest_curvature: [f64; 3],
}

//! Mechanics and constant-curvature kinematics of tendon-driven continuum robots.

pub mod arc;

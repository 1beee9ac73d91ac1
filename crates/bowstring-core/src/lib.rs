//! Mechanics and constant-curvature kinematics of tendon-driven continuum robots.

pub mod lie;
pub mod linalg;
pub mod real;

//! Mechanics and constant-curvature kinematics of tendon-driven continuum robots.

pub mod arc;
pub mod batch;
#[cfg(target_arch = "x86_64")]
mod lanes;
pub mod lie;
pub mod linalg;
pub mod load;
mod module;
pub mod real;
pub mod robot;
mod rod;
pub mod sensitivity;
#[cfg(target_arch = "x86_64")]
mod simd;
pub mod statics;
mod sweep;

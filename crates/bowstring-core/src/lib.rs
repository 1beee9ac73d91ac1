//! Mechanics and constant-curvature kinematics of tendon-driven continuum robots.

pub mod adaptive;
pub mod arc;
pub mod batch;
mod complementarity;
pub mod drive;
pub mod dynamics;
mod eigenvalues;
mod engine;
pub mod estimate;
pub mod interrupt;
#[cfg(target_arch = "x86_64")]
mod lanes;
pub mod lie;
pub mod linalg;
pub mod load;
pub mod memory;
mod mixing;
pub mod modes;
mod module;
mod motion;
#[cfg(test)]
#[path = "../tests/common/random.rs"]
mod random;
pub mod real;
pub mod robot;
mod rod;
pub mod sensitivity;
#[cfg(target_arch = "x86_64")]
mod simd;
pub mod statics;
pub mod stress;
mod sweep;
#[cfg(test)]
mod tangent_tests;
mod transmission;

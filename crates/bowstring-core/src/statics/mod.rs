//! Equilibria: Newton iteration, load stepping, paths, choice of elements, many loads at once and
//! their derivatives; inverse kinematics.
//!
//! Theory: docs/theory/statics.md and docs/theory/actuation.md.

pub mod adaptive;
pub mod batch;
pub mod branches;
mod companion;
mod continuation;
mod deflation;
pub mod designs;
mod differentiator;
pub mod directional;
pub mod equilibria;
mod events;
mod family;
pub mod hysteresis;
pub mod inelastic;
pub mod inverse;
pub mod loads;
mod nearest;
mod newton;
pub mod path;
pub mod path_batch;
mod path_error;
mod path_perturbed;
mod path_step;
pub mod relaxation;
mod response;
pub mod solver;
mod stability;
#[cfg(target_arch = "x86_64")]
mod start;

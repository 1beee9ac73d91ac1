//! Equilibria: Newton iteration, paths, as many elements as needed, many loads at once.

pub mod adaptive;
pub mod batch;
#[cfg(target_arch = "x86_64")]
pub(crate) mod lanes;
mod nearest;
mod newton;
mod outcome;
pub mod path;
pub mod path_batch;
mod path_error;
mod path_step;
pub mod solver;
mod stability;

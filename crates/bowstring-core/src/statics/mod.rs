//! Equilibria: Newton iteration, paths, as many elements as needed, many loads at once.

pub mod adaptive;
pub mod batch;
#[cfg(target_arch = "x86_64")]
pub(crate) mod lanes;
mod newton;
pub mod path;
pub mod path_batch;
pub mod solver;
mod stability;

//! Real numbers and lanes, small linear algebra, rotations, the MLCP, Anderson acceleration.

pub(crate) mod anderson;
pub(crate) mod eigenvalues;
pub mod lie;
pub mod linalg;
pub(crate) mod mlcp;
pub mod real;
#[cfg(target_arch = "x86_64")]
pub(crate) mod simd;

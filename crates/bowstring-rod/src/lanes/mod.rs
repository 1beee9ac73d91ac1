//! Several loads, robots or paths side by side in SIMD lanes.

pub mod loads;
pub mod paths;
pub mod polynomial;

pub use crate::math::real::MOST_LANES;

//! Several loads, robots or paths side by side in SIMD lanes.

pub mod loads;
pub mod paths;
pub mod polynomial;

/// Most lanes.
pub const MOST_LANES: usize = 8;

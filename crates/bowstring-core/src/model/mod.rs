//! What a robot is and what loads it: checked input.

pub mod error;
pub mod load;
pub mod robot;

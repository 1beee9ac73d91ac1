//! Robot, loads and errors: checked input.

pub mod coupled;
pub mod error;
pub mod load;
pub mod robot;

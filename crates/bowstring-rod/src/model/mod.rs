//! Robot, loads and errors: checked input.
#![warn(missing_docs)]

pub mod coupled;
pub mod error;
pub mod load;
pub mod robot;
pub mod section;

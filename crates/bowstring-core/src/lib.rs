#![doc = include_str!("../README.md")]
#![warn(missing_docs)]

// each folder uses only those above it in this list

pub mod interrupt;
pub mod math;
pub mod model;

pub mod arc;
pub mod memory;
pub mod stress;

pub mod robot_arcs;
pub mod rod;

mod motion;

mod tendon;

mod dispatch;

pub mod statics;

pub mod dynamics;

#[cfg(test)]
#[path = "../tests/common/random.rs"]
mod random;

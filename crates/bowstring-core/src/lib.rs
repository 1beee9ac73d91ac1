#![doc = include_str!("../README.md")]
#![warn(missing_docs)]
// rods side by side are for x86-64
#![cfg_attr(not(target_arch = "x86_64"), allow(dead_code))]

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

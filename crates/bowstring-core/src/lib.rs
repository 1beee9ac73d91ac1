#![doc = include_str!("../README.md")]
#![warn(missing_docs)]
// rods side by side are for x86-64
#![cfg_attr(not(target_arch = "x86_64"), allow(dead_code))]

// each folder uses only those above it in this list

#[cfg(target_arch = "x86_64")]
use bowstring_rod::lanes;
use bowstring_rod::{criteria, dispatch, outcome, step};
pub use bowstring_rod::{interrupt, math, memory, model, rod};

pub mod arc;
pub mod stress;

pub mod robot_arcs;

mod tendon;

pub mod statics;

pub mod dynamics;

#[cfg(test)]
#[path = "../tests/common/random.rs"]
mod random;

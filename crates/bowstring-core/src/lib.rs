#![doc = include_str!("../README.md")]
#![warn(missing_docs)]
// rods side by side are for x86-64
#![cfg_attr(not(target_arch = "x86_64"), allow(dead_code))]

// each folder uses only those above it in this list

#[cfg(target_arch = "x86_64")]
use bowstring_rod::lanes;
use bowstring_rod::{criteria, dispatch, outcome, step};
pub use bowstring_rod::{interrupt, memory, model};

/// Real numbers, small linear algebra, rotations, and the choice of instructions.
pub mod math {
    pub(crate) use bowstring_rod::math::{anderson, bounded, mlcp, series, symmetric, vectorize};
    pub use bowstring_rod::math::{instructions, lie, linalg, real, widest_instructions};
}

/// Error estimates and derivatives of an equilibrium.
pub mod rod {
    pub use bowstring_rod::rod::{estimate, sensitivity};
    pub(crate) use bowstring_rod::rod::{newton_step, responses, routed};
}

pub mod arc;
mod arc_modules;
pub mod stress;

pub mod robot_arcs;

mod tendon;

pub mod statics;

pub mod dynamics;

#[cfg(test)]
#[path = "../tests/common/random.rs"]
mod random;

#[cfg(test)]
#[path = "../tests/common/parts.rs"]
mod parts;

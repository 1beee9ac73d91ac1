//! The rod of `bowstring-core` at rest and in one time step, generic over the numbers of the
//! processor: plain ones, modules of one robot in SIMD lanes, or several robots in lanes.
//!
//! It is compiled for each of them, which takes minutes. The algorithms see it through the traits of
//! `dispatch`, `step` and, on x86-64, `lanes`, and are compiled once, in `bowstring-core`.
#![cfg_attr(not(target_arch = "x86_64"), allow(dead_code))]

// each folder uses only those above it in this list

pub mod interrupt;
pub mod math;
pub mod model;

pub mod memory;

pub mod rod;

pub mod criteria;
pub mod outcome;

#[cfg(target_arch = "x86_64")]
pub mod lanes;
pub mod step;

pub mod dispatch;

#[cfg(test)]
#[path = "../../bowstring-core/tests/common/random.rs"]
mod random;

#[cfg(test)]
#[path = "../../bowstring-core/tests/common/parts.rs"]
mod parts;

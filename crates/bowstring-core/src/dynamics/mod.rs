//! Motion over time, and small oscillations.
//!
//! Theory: docs/theory/dynamics.md.
//!
//! Each file uses those above it in this list only.

mod actuation;
mod settings;

mod newton;

mod integration;

pub mod integrator;

pub mod batch;

pub mod modal;
pub mod records;

//! Motion over time, and small oscillations.

pub mod integrator;
pub mod modal;
pub mod records;

//! The chain of modules at rest: mechanics, block-tridiagonal elimination, derivatives,
//! discretisation error.
//!
//! Theory: docs/theory/rod.md and docs/theory/statics.md.

pub mod attached;
pub mod between;
pub mod chain;
pub mod constants;
pub mod coupling;
pub mod defect;
pub mod elimination;
pub mod estimate;
pub mod flexibility;
pub mod module;
pub mod routed;
pub mod routes;
pub mod sensitivity;
pub mod span;
pub mod tension_columns;
pub mod tension_responses;

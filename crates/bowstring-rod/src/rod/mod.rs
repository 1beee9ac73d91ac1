//! The chain of modules at rest: mechanics, block-tridiagonal elimination, derivatives,
//! discretisation error.
//!
//! Theory: docs/theory/rod.md and docs/theory/statics.md.

pub(crate) mod attached;
pub(crate) mod between;
pub mod chain;
pub(crate) mod constants;
pub(crate) mod continuous;
pub(crate) mod continuous_module;
pub(crate) mod coupled_module;
pub(crate) mod coupling;
pub(crate) mod defect;
pub(crate) mod elimination;
pub mod estimate;
pub(crate) mod evaluation;
pub(crate) mod flexibility;
pub(crate) mod gauss;
pub(crate) mod groups;
pub(crate) mod kept;
pub(crate) mod module;
pub mod newton_step;
pub(crate) mod point_loads;
pub mod responses;
pub mod routed;
pub(crate) mod routes;
pub mod sensitivity;
pub(crate) mod span;
pub(crate) mod state;
pub(crate) mod tension_columns;
pub(crate) mod tension_responses;

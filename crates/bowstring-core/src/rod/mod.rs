//! The chain of modules at rest: mechanics, block elimination, derivatives, discretisation error.

pub(crate) mod chain;
pub(crate) mod constants;
pub(crate) mod defect;
pub(crate) mod elimination;
pub mod estimate;
pub(crate) mod module;
pub(crate) mod routed;
pub mod sensitivity;
pub(crate) mod span;

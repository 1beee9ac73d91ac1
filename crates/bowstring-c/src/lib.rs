//! C interface of `bowstring-core` for control loops; `include/bowstring.h` is made from it.
//!
//! Guide: docs/guide/cpp.md. No call unwinds into its caller: each checks its pointers and numbers,
//! catches panics, and answers with a status and a sentence.

#![warn(missing_docs)]
// units end the names, as in the outputs of the package: N is newton
#![allow(non_snake_case)]

mod robot;
mod solver;
mod status;

pub use robot::*;
pub use solver::*;
pub use status::*;

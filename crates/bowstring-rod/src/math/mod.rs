//! Real numbers and lanes, small linear algebra, rotations, the MLCP, bounded least squares,
//! Anderson acceleration.

pub mod anderson;
pub mod bounded;
pub mod eigenvalues;
pub mod instructions;
pub mod lie;
pub mod linalg;
pub mod mlcp;
pub mod real;
pub mod series;
#[cfg(target_arch = "x86_64")]
pub(crate) mod simd;
pub mod symmetric;

use instructions::Instructions;

/// Copies of a value. `vec!` would clone it field by field, which compiles to much more code.
pub fn copies<P: Copy>(value: P, count: usize) -> Vec<P> {
    let mut all = Vec::with_capacity(count);
    for _ in 0..count {
        all.push(value);
    }
    all
}

/// The widest instruction set in use: that of the processor, up to the limit.
pub fn widest_instructions() -> Instructions {
    #[cfg(target_arch = "x86_64")]
    {
        use crate::math::simd::{Avx2, Avx512, Simd};
        if Avx512::detect().is_some() {
            return Instructions::Avx512;
        }
        if Avx2::detect().is_some() {
            return Instructions::Avx2;
        }
    }
    Instructions::Plain
}

/// Runs `f` compiled for the widest instructions of this processor; see `Layout::vectorize`.
#[inline(always)]
pub fn vectorize<R>(f: impl FnOnce() -> R) -> R {
    #[cfg(target_arch = "x86_64")]
    {
        use crate::math::simd::{Avx2, Avx512, Simd};
        if let Some(simd) = Avx512::detect() {
            return simd.vectorize(f);
        }
        if let Some(simd) = Avx2::detect() {
            return simd.vectorize(f);
        }
    }
    f()
}

//! Processor instruction sets for which the passes are compiled, and the choice among them.
#![warn(missing_docs)]

use std::sync::atomic::{AtomicU8, Ordering::Relaxed};

/// A set of processor instructions.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Instructions {
    /// Baseline of the platform.
    Plain,
    /// AVX2 and FMA of x86-64: four numbers at once.
    Avx2,
    /// AVX-512 F, VL and DQ of x86-64: eight numbers at once.
    Avx512,
}

impl Instructions {
    /// All sets, narrowest first.
    pub const ALL: [Self; 3] = [Self::Plain, Self::Avx2, Self::Avx512];

    /// Name, as in `BOWSTRING_INSTRUCTIONS`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Plain => "plain",
            Self::Avx2 => "avx2",
            Self::Avx512 => "avx512",
        }
    }

    /// Whether the limit allows this set.
    #[cfg(target_arch = "x86_64")]
    pub fn is_allowed(self) -> bool {
        self as u8 <= LIMIT.load(Relaxed)
    }

    /// Limits all later solvers to this set, to compare results or to reproduce those of another
    /// processor.
    pub fn limit(self) {
        LIMIT.store(self as u8, Relaxed);
    }
}

static LIMIT: AtomicU8 = AtomicU8::new(Instructions::Avx512 as u8);

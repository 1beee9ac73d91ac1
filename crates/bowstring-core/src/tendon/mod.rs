//! Laws of the tendons: slack, axial compliance, and Coulomb friction with stick and slip.
//!
//! Unknown beside the strain are the tension of each tendon before its base hole, `T`, and at
//! each hole `h` the drop `y` of its logarithm, so that span `k` carries
//!
//! `T_k = T exp(-(y_0 + ... + y_k))`
//!
//! For a displacement-controlled tendon with displacement `p` since home, `l` the length of a span,
//! `a` its own compliance and `c` that of all before the base hole,
//!
//! `slack = home - p - sum (l_k - a_k T_k) + c T >= 0,  T >= 0,  slack T = 0`
//!
//! At a hole the tendon slips by `v`, positive towards the base, which is the loss of
//! `sum (l_k - a_k T_k)` beyond it since the step before. Coulomb's law by the capstan equation
//! (Euler, Eytelwein) for a bend `beta` is `|y| <= mu beta`, with `y = mu beta` where `v > 0`,
//! `y = -mu beta` where `v < 0`, and `v = 0` between. A step of the path is implicit.
//!
//! In a step of time that balances forces at a share `a` of the way, tensions are those of the
//! balance and lengths those of the end. With `e_0`, `e_1` what a tendon is stretched by at the
//! start, where slack counts as zero, and at the end, where slack counts as negative,
//!
//! `a slack = sum a_k T_k + c T - (1 - a) e_0 - a e_1`
//!
//! so that stretch gives back all its energy without numerical damping (`a = 1/2`: the work
//! `T (e_1 - e_0)` is the gain of `e^2 / (2 c)`), a tendon that becomes taut or slack never adds
//! any, and one that does not stretch is as long as it must be at the end of every step. With
//! `a = 1` it is the law of statics.
//!
//! The rod's own elimination solves for each unknown tension and each hole that sticks, and a small
//! mixed linear complementarity problem is left. How the bend changes the friction is not in the
//! tangent, which stays symmetric; friction is taken from the present bend, and converges with a
//! factor of about `mu` times the bend. [Anderson acceleration](crate::math::anderson) makes that
//! factor smaller in statics.
//!
//! Each file uses those above it in this list only.

mod history;
mod line;

mod compliance;

mod tendons;

mod energy;
mod friction;

mod unknowns;

mod transmission;

pub use history::History;
pub(crate) use history::Slip;
pub use line::{Command, Line};
pub(crate) use tendons::Tendons;
pub(crate) use transmission::Transmission;

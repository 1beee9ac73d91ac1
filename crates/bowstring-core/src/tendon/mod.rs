//! Laws of the tendons: slack, axial compliance, and Coulomb friction with stick and slip.
//!
//! Theory: docs/theory/actuation.md; in motion docs/theory/dynamics.md.
//!
//! The unknowns beside the strain are the tension of each tendon before its base hole, `T`, and at
//! each hole `h` the drop `y` of its logarithm, so that span `k` carries
//!
//! `T_k = T exp(-(y_0 + ... + y_k))`
//!
//! For a displacement-controlled tendon with displacement `p` from the home pose, `l` the length of
//! a span, `a` its compliance and `c` that of the line before the base hole, the slack length is
//! (theory Eq. 4.1 and 4.3)
//!
//! `slack = home - p - sum (l_k - a_k T_k) + c T >= 0,  T >= 0,  slack T = 0`
//!
//! At a hole the tendon slips by `v`, positive towards the base: the decrease since the step before
//! of `sum (l_k - a_k T_k)` beyond the hole. Coulomb's law with the capstan equation (Euler,
//! Eytelwein; theory Eq. 4.4 and 4.5) for a bend `beta` is `|y| <= mu beta`, with `y = mu beta`
//! where `v > 0`, `y = -mu beta` where `v < 0`, and `v = 0` between. A step of the path is
//! implicit.
//!
//! In a time step that balances forces at a fraction `a` of the step, tensions are those of the
//! balance and lengths those of the end. With the elongations `e_0` at the start, where slack
//! counts as zero, and `e_1` at the end, where slack counts as negative (theory Eq. 5.4),
//!
//! `a slack = sum a_k T_k + c T - (1 - a) e_0 - a e_1`
//!
//! so that without numerical damping the elongation returns all its energy (`a = 1/2`: the work `T
//! (e_1 - e_0)` is the gain of `e^2 / (2 c)`), a tendon that becomes taut or slack never adds
//! energy, and an inextensible one has the commanded length at the end of every step. With `a = 1`
//! it is the law of statics.
//!
//! The elimination of the rod solves for each unknown tension and each sticking hole, and a small
//! mixed linear complementarity problem remains (theory Eq. 4.2). The change of friction with the
//! bend is not in the tangent, which stays symmetric; friction is evaluated at the present bend,
//! and converges with a factor of about `mu` times the bend. [Anderson
//! acceleration](crate::math::anderson) reduces that factor in statics.
//!
//! Each file uses only those above it in this list.

mod history;
mod line;

mod compliance;

mod tendons;

mod energy;
mod friction;

mod unknowns;

mod transmission;

pub(crate) use history::Slip;
pub use history::{History, TERMS};
pub use line::{Command, Line};
pub(crate) use tendons::Tendons;
pub(crate) use transmission::Transmission;

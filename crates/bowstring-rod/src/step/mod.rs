//! One implicit time step of the rod.
//!
//! Theory: docs/theory/dynamics.md.
//!
//! All mass is lumped into points: disks, and the nodes between arcs, which carry the backbone by
//! Simpson's rule. A disk rotates with its three directors, so that kinetic energy is quadratic in
//! the velocities of points and directors `y`, with a constant mass matrix `M`. The strain `q` is
//! the only unknown: `y = y(q)`, `J = dy/dq`. The scheme is the first-order generalised-alpha
//! method (theory Eq. 5.2; Jansen, Whiting and Hulbert 2000) for `y` and its velocity, with the
//! balance of forces at the strain between the ends of the step (theory Eq. 5.1):
//!
//! `J(q_a)' (M acceleration_a - forces_a) + dV/dq(q_a) = 0`,  `q_a = (1 - a) q_n + a q_(n+1)`
//!
//! Acceleration and velocity at `a` are linear in `y(q_(n+1))`. Without numerical damping this is
//! the energy-momentum form of the midpoint rule for a constrained system (Betsch and Steinmann
//! 2001): energy is conserved to third order in the strain increment of a step, however stiff the
//! rod and long the step. The remainder is returned within the step by a force against the velocity
//! of all mass, of either sign ([`Moving::restore`]): a discrete gradient (Gonzalez 1996) in the
//! metric of the mass.
//!
//! The tangent uses `J` at `q_a` on both sides, which keeps it symmetric: inertia adds to the
//! blocks of statics, and the state of the elimination is rotation and translation of a disk. The
//! contact force of a module is an unknown beside its arcs, because shear and extension have
//! inertia.
//!
//! Each file uses only those above it in this list.

mod energy;
mod mass;
mod scheme;
mod spans;
mod strain;

mod body;
mod kinematics;

mod residual;

mod tangent;

mod response;

mod motion;

mod record;

mod moving;

mod flexibility;

mod side_by_side;

pub mod oscillation;

#[cfg(test)]
mod tangent_tests;
#[cfg(test)]
mod tests;

pub use energy::Energies;
pub use flexibility::Lock;
pub use kinematics::StepError;
pub use motion::Motion;
pub use moving::Moving;
pub use record::{DiskFields, Fields, SectionFields, TendonFields};
pub use scheme::Damping;
pub use side_by_side::{Advanced, Flags, MotionsSideBySide, Period, SideBySide};

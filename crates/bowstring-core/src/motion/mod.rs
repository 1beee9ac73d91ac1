//! One implicit time step of the rod.
//!
//! All mass sits in points: disks, and the nodes between arcs, which carry the backbone by
//! Simpson's rule. A disk turns as its three directors do, so that kinetic energy is
//! quadratic in the velocities of points and directors `y`, with a constant mass matrix `M`,
//! and only strain `q` is unknown: `y = y(q)`, `J = dy/dq`. The scheme is the first-order
//! generalised-alpha method (Jansen, Whiting and Hulbert 2000) for `y` and its velocity, with
//! the balance of forces taken at the strain between the ends of the step:
//!
//! `J(q_a)' (M acceleration_a - forces_a) + dV/dq(q_a) = 0`,  `q_a = (1 - a) q_n + a q_(n+1)`
//!
//! Acceleration and velocity at `a` are linear in `y(q_(n+1))`. Without numerical damping this
//! is the energy-momentum form of the midpoint rule for a constrained system (Betsch and
//! Steinmann 2001): energy holds to third order in the strain of one step, however stiff the
//! rod and long the step. What this leaves is given back within the step by a force against the
//! velocity of all mass, of either sign ([`Moving::restore`]): a discrete gradient (Gonzalez 1996)
//! in the metric of the mass.
//!
//! The tangent takes `J` at `q_a` on both sides, which keeps it symmetric: inertia adds to
//! the blocks of statics, and the state of the elimination is rotation and translation of a disk.
//! The contact force of a module is unknown beside its arcs, as shear and extension have inertia.
//!
//! Each file uses those above it in this list only.

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

mod step;

mod record;

mod moving;

mod flexibility;

pub(crate) mod oscillation;

#[cfg(test)]
mod tangent_tests;
#[cfg(test)]
mod tests;

pub use energy::Energies;
pub(crate) use flexibility::Lock;
pub(crate) use kinematics::StepError;
pub(crate) use moving::Moving;
pub use record::{DiskFields, Fields, SectionFields, TendonFields};
pub use scheme::Damping;
pub(crate) use step::Motion;

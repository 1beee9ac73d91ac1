//! Sums over the point loads on a disk, or on a section of the backbone between two.
//!
//! Theory: docs/theory/rod.md (Loads) and docs/theory/statics.md (Followers).

use crate::math::linalg::{Mat3, Vec3};
use crate::math::real::Real;
use crate::model::load::PointLoad;

/// Sum of forces at some rotation, in the base frame (N); of dead forces alone without one.
pub fn sum_of_forces<C: Real>(loads: &[PointLoad], rotation: Option<&Mat3<C>>) -> Vec3<C> {
    let mut sum = Vec3::zero();
    for load in loads {
        let force = Vec3::splat(load.force);
        sum += match (load.follower, rotation) {
            (true, Some(rotation)) => *rotation * force,
            (true, None) => continue,
            (false, _) => force,
        };
    }
    sum
}

/// Sum of moments at some rotation about the centre, in its frame (N m).
#[inline(always)]
pub fn sum_of_moments<C: Real>(loads: &[PointLoad], rotation: &Mat3<C>) -> Vec3<C> {
    let mut sum = Vec3::zero();
    for load in loads {
        sum += match load.follower {
            true => Vec3::splat(load.own_moment().0),
            false => {
                let force = rotation.tr_mul(Vec3::splat(load.force));
                let moment = rotation.tr_mul(Vec3::splat(load.moment));
                Vec3::splat(load.point).cross(force) + moment
            }
        };
    }
    sum
}

/// Potential of dead forces by the rotation (J).
#[inline(always)]
pub fn potential_of<C: Real>(loads: &[PointLoad], rotation: &Mat3<C>) -> C {
    let mut sum = C::zero();
    for load in loads.iter().filter(|load| !load.follower) {
        let point = *rotation * Vec3::splat(load.point);
        sum -= point.dot(Vec3::splat(load.force));
    }
    sum
}

/// Adds the stiffness of loads against the rotation to a sum; see `Attached::stiffness`.
#[inline(always)]
pub fn sum_of_stiffness<C: Real, const SYMMETRIC: bool>(
    loads: &[PointLoad],
    rotation: &Mat3<C>,
    mut sum: Mat3<C>,
) -> Mat3<C> {
    let half = C::splat(0.5);
    for load in loads {
        let mut skew = Vec3::splat(load.own_moment().0) * half;
        if !load.follower {
            let force = rotation.tr_mul(Vec3::splat(load.force));
            let point = Vec3::splat(load.point);
            sum += (-force.outer(point).symmetric_part()).add_diagonal([force.dot(point); 3]);
            skew = rotation.tr_mul(Vec3::splat(load.moment)) * -half;
        }
        if !SYMMETRIC {
            sum += skew.skew();
        }
    }
    sum
}

/// Change of the forces of followers by their rotation, in their frame (N).
pub fn turning_of<C: Real>(loads: &[PointLoad]) -> Mat3<C> {
    let mut sum = Vec3::zero();
    for load in loads.iter().filter(|load| load.follower) {
        sum += Vec3::splat(load.force);
    }
    (-sum).skew()
}

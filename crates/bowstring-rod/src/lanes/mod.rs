//! Several loads, robots or paths side by side in SIMD lanes.

use crate::model::load::{Model, TendonPath};
use crate::model::robot::Robot;

pub mod loads;
pub mod paths;
pub mod polynomial;

pub use crate::math::real::MOST_LANES;

/// Whether lanes take a robot: not with coupled sections or continuous tendons, which are rare.
pub fn fit(robot: &Robot, model: Model) -> bool {
    !robot.is_coupled() && model.tendon == TendonPath::Straight
}

//! Python binding of `bowstring-core`: arrays in, arrays out, errors as exceptions.

use bowstring_core::math::{instructions::Instructions, widest_instructions};
use pyo3::exceptions::PyImportError;
use pyo3::prelude::*;

mod arc;
mod branches;
mod directional;
mod dynamics;
mod equilibria;
mod fields;
mod input;
mod interrupt;
mod inverse;
mod model;
mod motions;
mod path;
mod robot_arcs;
mod rod;
mod xla;

#[pymodule]
mod _core {
    use super::*;

    #[pymodule_export]
    use crate::arc::{
        arc_bend, arc_bend_jacobian, arc_curvature, arc_curvature_jacobian, arc_fit,
        arc_fit_jacobian, arc_from_tensions, arc_lengths, arc_lengths_jacobian, arc_nearest,
        arc_part, arc_pose, arc_pose_jacobian, arc_through,
    };
    #[pymodule_export]
    use crate::branches::follow_branches;
    #[pymodule_export]
    use crate::directional::Linearised;
    #[pymodule_export]
    use crate::dynamics::{flexibility, flexibility_at, Flexibility, Simulator};
    #[pymodule_export]
    use crate::equilibria::Equilibria;
    #[pymodule_export]
    use crate::fields::{derive, surface_stress, von_mises};
    #[pymodule_export]
    use crate::input::check_memory;
    #[pymodule_export]
    use crate::inverse::inverse_kinematics;
    #[pymodule_export]
    use crate::model::RodModel;
    #[pymodule_export]
    use crate::motions::Motions;
    #[pymodule_export]
    use crate::path::{follow_designs, PathSolver, PathStates};
    #[pymodule_export]
    use crate::robot_arcs::RobotArcs;
    #[pymodule_export]
    use crate::rod::{Robot, Solution};
    #[pymodule_export]
    use crate::xla::xla_targets;

    #[pymodule_init]
    fn init(m: &Bound<'_, PyModule>) -> PyResult<()> {
        limit_instructions()?;
        m.add("__version__", env!("CARGO_PKG_VERSION"))
    }

    /// Name of the processor instructions in use.
    #[pyfunction]
    fn instructions() -> &'static str {
        widest_instructions().name()
    }
}

/// Limits the instructions to those named in the environment variable BOWSTRING_INSTRUCTIONS.
fn limit_instructions() -> PyResult<()> {
    let requested = std::env::var_os("BOWSTRING_INSTRUCTIONS").unwrap_or_default();
    if requested.is_empty() {
        return Ok(());
    }
    let requested = requested.to_string_lossy();
    let known = Instructions::ALL.iter().find(|i| i.name() == requested);
    let known = known.ok_or_else(|| {
        PyImportError::new_err(format!(
            "BOWSTRING_INSTRUCTIONS is {requested:?}; it must be plain, avx2 or avx512"
        ))
    })?;
    known.limit();
    Ok(())
}

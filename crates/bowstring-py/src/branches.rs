//! Branches of equilibria along a load path, as arrays.

use crate::input::{array, input_error, numbers};
use crate::interrupt::interruptible;
use crate::model::{DeadLoad, RodModel};
use crate::rod::{column, Robot};
use bowstring_core::model::load::OwnedLoad;
use bowstring_core::statics::batch::write_pose;
use bowstring_core::statics::branches::{self, Branch, LoadPath, Search};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};

/// How far and how finely branches are followed; attributes of Python's `Search`.
#[derive(FromPyObject)]
pub struct Settings {
    max_factor: f64,
    step: f64,
    max_points: usize,
    max_branches: usize,
    deflation: bool,
    first_loss: bool,
}

/// Follows the branches between two loads, each of tensions and dead loads; a dictionary of each
/// branch, and how the search went.
#[pyfunction]
pub fn follow_branches<'py>(
    py: Python<'py>,
    robot: &Robot,
    start: (Bound<'py, PyAny>, DeadLoad<'py>),
    end: (Bound<'py, PyAny>, DeadLoad<'py>),
    model: &RodModel,
    search: Settings,
) -> PyResult<Bound<'py, PyDict>> {
    let load = |(tensions, dead): (Bound<'py, PyAny>, DeadLoad<'py>)| -> PyResult<OwnedLoad> {
        let count = robot.inner.tendon_count();
        dead.with(&robot.inner, numbers(&tensions, "tensions", "N", count)?)
    };
    let path = LoadPath {
        from: load(start)?,
        to: load(end)?,
    };
    let search = Search {
        most: search.max_factor,
        step: search.step,
        points: search.max_points,
        branches: search.max_branches,
        deflation: search.deflation,
        first_loss: search.first_loss,
    };
    let found = interruptible(py, || {
        branches::diagram(&robot.inner, &robot.settings(model), &path, &search)
    })?
    .map_err(input_error)?;
    let out = PyDict::new(py);
    out.set_item("status", found.start.status.word())?;
    out.set_item("complete", found.complete)?;
    out.set_item("deflated", found.deflated)?;
    out.set_item("elements", found.elements)?;
    let all: PyResult<Vec<_>> = found.branches.iter().map(|b| arrays(py, b)).collect();
    out.set_item("branches", all?)?;
    Ok(out)
}

/// One branch, named as in `bowstring.Branch`.
fn arrays<'py>(py: Python<'py>, branch: &Branch) -> PyResult<Bound<'py, PyDict>> {
    let points = &branch.points;
    let n = points.len();
    let disks = points.first().map_or(0, |p| p.disks.len());
    let (mut position, mut rotation) = (vec![0.0; 3 * n * disks], vec![0.0; 9 * n * disks]);
    for (i, point) in points.iter().enumerate() {
        for (k, pose) in point.disks.iter().enumerate() {
            write_pose(pose, i * disks + k, &mut position, &mut rotation);
        }
    }
    let out = PyDict::new(py);
    out.set_item("factor", column(py, points, |p| p.factor))?;
    out.set_item("arclength", column(py, points, |p| p.arclength))?;
    out.set_item("residual", column(py, points, |p| p.residual))?;
    out.set_item("stable", PyList::new(py, points.iter().map(|p| p.stable))?)?;
    let unstable = points.iter().map(|p| p.unstable_modes);
    out.set_item("unstable_modes", PyList::new(py, unstable)?)?;
    let neutral = column(py, points, |p| p.neutral_modes as i64);
    out.set_item("neutral_modes", neutral)?;
    out.set_item("disk_positions", array(py, position, &[n, disks, 3]))?;
    out.set_item("disk_rotations", array(py, rotation, &[n, disks, 3, 3]))?;
    let events = branch.events.iter();
    let events = events.map(|e| (e.kind.word(), e.point, e.multiplicity));
    out.set_item("events", PyList::new(py, events)?)?;
    out.set_item("origin", branch.origin)?;
    out.set_item("end", branch.end.word())?;
    Ok(out)
}

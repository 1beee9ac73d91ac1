//! Inverse kinematics of many rows, as arrays.

use crate::input::{array, input_error, refused, Rows};
use crate::interrupt::interruptible;
use crate::model::{DeadLoad, OwnLoads, RodModel};
use crate::rod::{check_rows, column, Robot};
use bowstring_core::statics::inverse::{self, InverseOutcome, Limits, Order, Target};
use numpy::{PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};

/// Targets of the tip: positions (n, 3) in m, directions (n, 3) of length one, if given, and the
/// permitted distance beyond that of the nearest tip, over the length.
#[derive(FromPyObject)]
pub struct Targets {
    positions: Rows<3>,
    directions: Option<Rows<3>>,
    margin: f64,
}

/// Tensions within limits (T,) for targets of the tip; in order if `threads` is `None`, otherwise
/// independent of each other on so many cores (0: all). `limits` are the least and the largest.
#[pyfunction]
pub fn inverse_kinematics<'py>(
    py: Python<'py>,
    robot: &Robot,
    targets: Targets,
    limits: (PyReadonlyArray1<'py, f64>, PyReadonlyArray1<'py, f64>),
    load: DeadLoad<'py>,
    model: &RodModel,
    threads: Option<usize>,
) -> PyResult<Bound<'py, PyDict>> {
    let (n, tendons) = (targets.positions.len(), robot.inner.tendon_count());
    check_rows(n, 60 + 8 * tendons, false)?;
    let directions = targets.directions.as_ref();
    if directions.is_some_and(|d| d.len() != n) {
        return Err(refused("directions must be as many as positions"));
    }
    let target = |i: usize| Target {
        position: targets.positions[i],
        direction: directions.map(|d| d[i]),
    };
    let all: Vec<_> = (0..n).map(target).collect();
    // tensions are unknown
    let zeros = numpy::PyArray2::<f64>::zeros(py, [n, tendons], false);
    let zeros: PyReadonlyArray2<f64> = zeros.readonly();
    let loads = OwnLoads::new(&robot.inner, zeros, &load)?;
    let [least, most] = [&limits.0, &limits.1].map(|v| v.as_array().to_vec());
    let order = match threads {
        None => Order::Path,
        Some(threads) => Order::Independent { threads },
    };
    let found = interruptible(py, || {
        let limits = Limits {
            least: &least,
            most: &most,
        };
        inverse::inverses(
            &robot.inner,
            &robot.settings(model),
            &loads.borrow(),
            &all,
            &limits,
            targets.margin,
            order,
        )
    })?
    .map_err(input_error)?;
    let rows = &found.outcomes;
    let out = PyDict::new(py);
    out.set_item(
        "status",
        PyList::new(py, rows.iter().map(|o| o.status.word()))?,
    )?;
    out.set_item(
        "stable",
        PyList::new(py, rows.iter().map(|o| o.equilibrium.stable))?,
    )?;
    let tip_error = |o: &InverseOutcome| o.equilibrium.error.map_or(f64::NAN, |e| e.tip);
    for (name, values) in [
        ("distance", column(py, rows, |o| o.distance)),
        ("nearest_distance", column(py, rows, |o| o.nearest)),
        ("direction_error", column(py, rows, |o| o.direction_error)),
        ("iterations", column(py, rows, |o| o.iterations as i64)),
        ("restarted", column(py, rows, |o| o.restarted)),
        ("elements", column(py, rows, |o| o.elements as i64)),
        ("tip_error", column(py, rows, tip_error)),
    ] {
        out.set_item(name, values)?;
    }
    out.set_item("tensions", array(py, found.tensions, &[n, tendons]))?;
    out.set_item("binding", array(py, found.binding, &[n, tendons]))?;
    out.set_item("tip_position", array(py, found.tip_position, &[n, 3]))?;
    out.set_item("tip_rotation", array(py, found.tip_rotation, &[n, 3, 3]))?;
    out.set_item(
        "tendon_lengths",
        array(py, found.tendon_length, &[n, tendons]),
    )?;
    Ok(out)
}

//! Constant curvature on arrays: one arc in a row. An arc is a row (bend x, bend y, length).

use crate::input::{array, Array, Rows};
use crate::interrupt::interruptible;
use bowstring_core::arc::{bend_jacobian, linear_law, Arc, Error, TendonFit};
use bowstring_core::interrupt;
use numpy::{PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;

pyo3::import_exception!(bowstring.errors, InputError);
pyo3::import_exception!(bowstring.errors, NoSolutionError);

type Column<'py> = PyReadonlyArray1<'py, f64>;

pub(crate) fn raise(error: Error) -> PyErr {
    match error {
        Error::Input(text) => InputError::new_err(text),
        Error::NoSolution(text) => NoSolutionError::new_err(text),
    }
}

/// Runs `f` for every row without the interpreter lock; an error names the row if there are
/// several.
pub(crate) fn each<T: Send>(
    py: Python<'_>,
    rows: usize,
    f: impl Fn(usize) -> Result<T, Error> + Send + Sync,
) -> PyResult<Vec<T>> {
    let place = |row: usize, text: String| {
        if rows > 1 {
            format!("row {}: {text}", row + 1)
        } else {
            text
        }
    };
    interruptible(py, || {
        (0..rows)
            .map(|row| {
                if interrupt::work(10) {
                    return Err(Error::Input("the work was interrupted".into()));
                }
                f(row).map_err(|e| match e {
                    Error::Input(text) => Error::Input(place(row, text)),
                    Error::NoSolution(text) => Error::NoSolution(place(row, text)),
                })
            })
            .collect::<Result<Vec<T>, Error>>()
    })?
    .map_err(raise)
}

/// The numbers returned by `f` for every row, as an array with one entry of the given shape for
/// each.
fn table<'py, T: IntoIterator<Item = f64> + Send>(
    py: Python<'py>,
    rows: usize,
    shape: &[usize],
    f: impl Fn(usize) -> Result<T, Error> + Send + Sync,
) -> PyResult<Array<'py>> {
    let data = each(py, rows, f)?.into_iter().flatten().collect();
    Ok(array(py, data, &[&[rows], shape].concat()))
}

/// Arcs, and one further number for each.
fn arcs_and_numbers<'py>(
    py: Python<'py>,
    rows: usize,
    f: impl Fn(usize) -> Result<(Arc, f64), Error> + Send + Sync,
) -> PyResult<(Array<'py>, Array<'py>)> {
    let (arcs, numbers): (Vec<_>, Vec<_>) = each(py, rows, f)?.into_iter().unzip();
    let arcs = arcs.into_iter().flat_map(row).collect();
    Ok((array(py, arcs, &[rows, 3]), array(py, numbers, &[rows])))
}

pub(crate) fn arc([x, y, length]: [f64; 3]) -> Arc {
    Arc {
        bend: [x, y],
        length,
    }
}

pub(crate) fn row(arc: Arc) -> [f64; 3] {
    [arc.bend[0], arc.bend[1], arc.length]
}

#[pyfunction]
pub fn arc_bend<'py>(
    py: Python<'py>,
    kappa: Column<'py>,
    phi: Column<'py>,
    length: Column<'py>,
) -> PyResult<Array<'py>> {
    let (kappa, phi, length) = (kappa.as_array(), phi.as_array(), length.as_array());
    table(py, kappa.len(), &[3], |i| {
        Arc::from_curvature(kappa[i], phi[i], length[i]).map(row)
    })
}

#[pyfunction]
pub fn arc_bend_jacobian<'py>(
    py: Python<'py>,
    kappa: Column<'py>,
    phi: Column<'py>,
    length: Column<'py>,
) -> PyResult<Array<'py>> {
    let (kappa, phi, length) = (kappa.as_array(), phi.as_array(), length.as_array());
    table(py, kappa.len(), &[3, 3], |i| {
        Ok(bend_jacobian(kappa[i], phi[i], length[i])
            .into_iter()
            .flatten())
    })
}

#[pyfunction]
pub fn arc_curvature(py: Python<'_>, arcs: Rows<3>) -> PyResult<Array<'_>> {
    table(py, arcs.len(), &[2], |i| {
        let (kappa, phi) = arc(arcs[i]).curvature();
        Ok([kappa, phi])
    })
}

#[pyfunction]
pub fn arc_curvature_jacobian(py: Python<'_>, arcs: Rows<3>) -> PyResult<Array<'_>> {
    const NONE: &str = "the direction of bending has no derivative at a straight arc; use the coordinates \"bend\"";
    table(py, arcs.len(), &[3, 3], |i| {
        let jacobian = arc(arcs[i]).curvature_jacobian();
        Ok(jacobian
            .ok_or(Error::Input(NONE.into()))?
            .into_iter()
            .flatten())
    })
}

#[pyfunction]
pub fn arc_part<'py>(py: Python<'py>, arcs: Rows<3>, s: Column<'py>) -> PyResult<Array<'py>> {
    let s = s.as_array();
    table(py, arcs.len(), &[3], |i| arc(arcs[i]).part(s[i]).map(row))
}

#[pyfunction]
pub fn arc_pose(py: Python<'_>, arcs: Rows<3>) -> PyResult<(Array<'_>, Array<'_>)> {
    let n = arcs.len();
    let poses = each(py, n, |i| Ok(arc(arcs[i]).pose()))?;
    let positions = poses.iter().flat_map(|p| p.position).collect();
    let rotations = poses.iter().flat_map(|p| p.rotation.concat()).collect();
    Ok((
        array(py, positions, &[n, 3]),
        array(py, rotations, &[n, 3, 3]),
    ))
}

#[pyfunction]
pub fn arc_pose_jacobian(py: Python<'_>, arcs: Rows<3>) -> PyResult<Array<'_>> {
    table(py, arcs.len(), &[6, 3], |i| {
        Ok(arc(arcs[i]).pose_jacobian().into_iter().flatten())
    })
}

#[pyfunction]
pub fn arc_lengths<'py>(py: Python<'py>, arcs: Rows<3>, hole: Rows<2>) -> PyResult<Array<'py>> {
    table(py, arcs.len(), &[hole.len()], |i| {
        let lengths = hole.iter().map(|h| arc(arcs[i]).tendon_length(*h));
        lengths.collect::<Result<Vec<f64>, Error>>()
    })
}

#[pyfunction]
pub fn arc_lengths_jacobian<'py>(
    py: Python<'py>,
    arcs: Rows<3>,
    hole: Rows<2>,
) -> PyResult<Array<'py>> {
    table(py, arcs.len(), &[hole.len(), 3], |i| {
        let by_hole = |h: &[f64; 2]| arc(arcs[i]).tendon_length_jacobian(*h);
        Ok(hole.iter().flat_map(by_hole).collect::<Vec<f64>>())
    })
}

/// Arcs and misfits; `length` holds the given lengths of the arcs.
#[pyfunction]
pub fn arc_fit<'py>(
    py: Python<'py>,
    lengths: PyReadonlyArray2<'py, f64>,
    hole: Rows<2>,
    length: Option<Column<'py>>,
) -> PyResult<(Array<'py>, Array<'py>)> {
    let fit = TendonFit::new(&hole, length.is_some()).map_err(raise)?;
    let held = length.as_ref().map(|l| l.as_array());
    let lengths = lengths.as_array();
    arcs_and_numbers(py, lengths.nrows(), |i| {
        let (arc, misfit) = fit.fit(&lengths.row(i).to_vec(), held.map(|l| l[i]))?;
        fit.check(&arc)?;
        Ok((arc, misfit))
    })
}

/// Derivative (3, T) of the fitted arcs with respect to the tendon lengths.
#[pyfunction]
pub fn arc_fit_jacobian<'py>(
    py: Python<'py>,
    hole: Rows<2>,
    hold_length: bool,
) -> PyResult<Array<'py>> {
    let fit = TendonFit::new(&hole, hold_length).map_err(raise)?;
    Ok(array(py, fit.jacobian().concat(), &[3, hole.len()]))
}

/// Arcs by the linear law.
#[pyfunction]
pub fn arc_from_tensions<'py>(
    py: Python<'py>,
    tensions: PyReadonlyArray2<'py, f64>,
    hole: Rows<2>,
    length: Column<'py>,
    bending_stiffness: Column<'py>,
) -> PyResult<Array<'py>> {
    let (tensions, length) = (tensions.as_array(), length.as_array());
    let stiffness = bending_stiffness.as_array();
    table(py, tensions.nrows(), &[3], |i| {
        linear_law(&tensions.row(i).to_vec(), &hole, length[i], stiffness[i]).map(row)
    })
}

#[pyfunction]
pub fn arc_through(py: Python<'_>, positions: Rows<3>) -> PyResult<Array<'_>> {
    table(py, positions.len(), &[3], |i| {
        Arc::through(positions[i]).map(row)
    })
}

#[pyfunction]
pub fn arc_nearest<'py>(
    py: Python<'py>,
    positions: Rows<3>,
    length: Column<'py>,
) -> PyResult<(Array<'py>, Array<'py>)> {
    let length = length.as_array();
    arcs_and_numbers(py, positions.len(), |i| {
        Arc::nearest(positions[i], length[i])
    })
}

//! Constant curvature on arrays: one arc a row. An arc is a row (bend x, bend y, length).

use crate::interrupt::interruptible;
use bowstring_core::arc::{
    bend_jacobian, lever_arm_law, linear_law, Arc, Error, Hole, Spans, TendonFit,
};
use bowstring_core::interrupt;
use numpy::ndarray::{ArrayD, ArrayView1, IxDyn};
use numpy::{IntoPyArray, PyArrayDyn, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;

pyo3::import_exception!(bowstring.errors, InputError);
pyo3::import_exception!(bowstring.errors, NoSolutionError);

type Array<'py> = Bound<'py, PyArrayDyn<f64>>;

fn raise(error: Error) -> PyErr {
    match error {
        Error::Input(text) => InputError::new_err(text),
        Error::NoSolution(text) => NoSolutionError::new_err(text),
    }
}

/// Runs `f` for every row without the interpreter lock; an error names the row if there are more.
fn each<T: Send>(
    py: Python<'_>,
    rows: usize,
    f: impl Fn(usize) -> Result<T, Error> + Send + Sync,
) -> PyResult<Vec<T>> {
    let place = |row: usize, text: String| {
        if rows > 1 {
            format!("row {row}: {text}")
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

fn array<'py>(py: Python<'py>, shape: &[usize], data: Vec<f64>) -> Array<'py> {
    ArrayD::from_shape_vec(IxDyn(shape), data)
        .expect("the data fill the shape")
        .into_pyarray(py)
}

fn arc(row: ArrayView1<f64>) -> Arc {
    Arc {
        bend: [row[0], row[1]],
        length: row[2],
    }
}

fn point(row: ArrayView1<f64>) -> [f64; 3] {
    [row[0], row[1], row[2]]
}

fn holes(array: &PyReadonlyArray2<f64>) -> Vec<Hole> {
    array
        .as_array()
        .rows()
        .into_iter()
        .map(|row| [row[0], row[1]])
        .collect()
}

/// No shares mean curved spans.
fn spans(shares: &PyReadonlyArray1<f64>) -> PyResult<Spans> {
    let shares = shares.as_array().to_vec();
    if shares.is_empty() {
        return Ok(Spans::curved());
    }
    Spans::straight(shares).map_err(raise)
}

fn flat(arcs: &[Arc]) -> Vec<f64> {
    arcs.iter()
        .flat_map(|a| [a.bend[0], a.bend[1], a.length])
        .collect()
}

#[pyfunction]
pub fn arc_bend<'py>(
    py: Python<'py>,
    kappa: PyReadonlyArray1<'py, f64>,
    phi: PyReadonlyArray1<'py, f64>,
    length: PyReadonlyArray1<'py, f64>,
) -> PyResult<Array<'py>> {
    let (kappa, phi, length) = (kappa.as_array(), phi.as_array(), length.as_array());
    let n = kappa.len();
    let arcs = each(py, n, |i| Arc::from_curvature(kappa[i], phi[i], length[i]))?;
    Ok(array(py, &[n, 3], flat(&arcs)))
}

#[pyfunction]
pub fn arc_bend_jacobian<'py>(
    py: Python<'py>,
    kappa: PyReadonlyArray1<'py, f64>,
    phi: PyReadonlyArray1<'py, f64>,
    length: PyReadonlyArray1<'py, f64>,
) -> PyResult<Array<'py>> {
    let (kappa, phi, length) = (kappa.as_array(), phi.as_array(), length.as_array());
    let n = kappa.len();
    let all = each(py, n, |i| Ok(bend_jacobian(kappa[i], phi[i], length[i])))?;
    Ok(array(py, &[n, 3, 3], all.concat().concat()))
}

#[pyfunction]
pub fn arc_curvature<'py>(
    py: Python<'py>,
    arcs: PyReadonlyArray2<'py, f64>,
) -> PyResult<Array<'py>> {
    let arcs = arcs.as_array();
    let n = arcs.nrows();
    let all = each(py, n, |i| {
        let (kappa, phi) = arc(arcs.row(i)).curvature();
        Ok([kappa, phi])
    })?;
    Ok(array(py, &[n, 2], all.concat()))
}

#[pyfunction]
pub fn arc_curvature_jacobian<'py>(
    py: Python<'py>,
    arcs: PyReadonlyArray2<'py, f64>,
) -> PyResult<Array<'py>> {
    let arcs = arcs.as_array();
    let n = arcs.nrows();
    let all = each(py, n, |i| {
        arc(arcs.row(i)).curvature_jacobian().ok_or_else(|| {
            Error::Input(
                "the direction of bending has no derivative at a straight arc; use the coordinates \"bend\"".into(),
            )
        })
    })?;
    Ok(array(py, &[n, 3, 3], all.concat().concat()))
}

#[pyfunction]
pub fn arc_part<'py>(
    py: Python<'py>,
    arcs: PyReadonlyArray2<'py, f64>,
    s: PyReadonlyArray1<'py, f64>,
) -> PyResult<Array<'py>> {
    let (arcs, s) = (arcs.as_array(), s.as_array());
    let n = arcs.nrows();
    let parts = each(py, n, |i| arc(arcs.row(i)).part(s[i]))?;
    Ok(array(py, &[n, 3], flat(&parts)))
}

#[pyfunction]
pub fn arc_pose<'py>(
    py: Python<'py>,
    arcs: PyReadonlyArray2<'py, f64>,
) -> PyResult<(Array<'py>, Array<'py>)> {
    let arcs = arcs.as_array();
    let n = arcs.nrows();
    let poses = each(py, n, |i| Ok(arc(arcs.row(i)).pose()))?;
    let positions = poses.iter().flat_map(|p| p.position).collect();
    let rotations = poses.iter().flat_map(|p| p.rotation.concat()).collect();
    Ok((
        array(py, &[n, 3], positions),
        array(py, &[n, 3, 3], rotations),
    ))
}

#[pyfunction]
pub fn arc_pose_jacobian<'py>(
    py: Python<'py>,
    arcs: PyReadonlyArray2<'py, f64>,
) -> PyResult<Array<'py>> {
    let arcs = arcs.as_array();
    let n = arcs.nrows();
    let all = each(py, n, |i| Ok(arc(arcs.row(i)).pose_jacobian()))?;
    Ok(array(py, &[n, 6, 3], all.concat().concat()))
}

#[pyfunction]
pub fn arc_lengths<'py>(
    py: Python<'py>,
    arcs: PyReadonlyArray2<'py, f64>,
    hole: PyReadonlyArray2<'py, f64>,
    shares: PyReadonlyArray1<'py, f64>,
) -> PyResult<Array<'py>> {
    let (hole, spans) = (holes(&hole), spans(&shares)?);
    let arcs = arcs.as_array();
    let n = arcs.nrows();
    let all = each(py, n, |i| {
        let arc = arc(arcs.row(i));
        hole.iter()
            .map(|h| arc.tendon_length(*h, &spans))
            .collect::<Result<Vec<f64>, Error>>()
    })?;
    Ok(array(py, &[n, hole.len()], all.concat()))
}

#[pyfunction]
pub fn arc_lengths_jacobian<'py>(
    py: Python<'py>,
    arcs: PyReadonlyArray2<'py, f64>,
    hole: PyReadonlyArray2<'py, f64>,
    shares: PyReadonlyArray1<'py, f64>,
) -> PyResult<Array<'py>> {
    let (hole, spans) = (holes(&hole), spans(&shares)?);
    let arcs = arcs.as_array();
    let n = arcs.nrows();
    let all = each(py, n, |i| {
        let arc = arc(arcs.row(i));
        Ok(hole
            .iter()
            .flat_map(|h| arc.tendon_length_jacobian(*h, &spans))
            .collect::<Vec<f64>>())
    })?;
    Ok(array(py, &[n, hole.len(), 3], all.concat()))
}

/// Arcs and misfits; `length` holds the arcs' lengths.
#[pyfunction]
pub fn arc_fit<'py>(
    py: Python<'py>,
    lengths: PyReadonlyArray2<'py, f64>,
    hole: PyReadonlyArray2<'py, f64>,
    shares: PyReadonlyArray1<'py, f64>,
    length: Option<PyReadonlyArray1<'py, f64>>,
) -> PyResult<(Array<'py>, Array<'py>)> {
    let fit = TendonFit::new(&holes(&hole), spans(&shares)?, length.is_some()).map_err(raise)?;
    let held = length.as_ref().map(|l| l.as_array());
    let lengths = lengths.as_array();
    let n = lengths.nrows();
    let all = each(py, n, |i| {
        fit.fit(&lengths.row(i).to_vec(), held.map(|l| l[i]))
    })?;
    let (arcs, misfits): (Vec<Arc>, Vec<f64>) = all.into_iter().unzip();
    Ok((array(py, &[n, 3], flat(&arcs)), array(py, &[n], misfits)))
}

/// Derivative of the fitted arcs by the tendon lengths, at arcs that [`arc_fit`] gave.
#[pyfunction]
pub fn arc_fit_jacobian<'py>(
    py: Python<'py>,
    arcs: PyReadonlyArray2<'py, f64>,
    hole: PyReadonlyArray2<'py, f64>,
    shares: PyReadonlyArray1<'py, f64>,
    hold_length: bool,
) -> PyResult<Array<'py>> {
    let hole = holes(&hole);
    let fit = TendonFit::new(&hole, spans(&shares)?, hold_length).map_err(raise)?;
    let arcs = arcs.as_array();
    let n = arcs.nrows();
    let all = each(py, n, |i| Ok(fit.jacobian(&arc(arcs.row(i))).concat()))?;
    Ok(array(py, &[n, 3, hole.len()], all.concat()))
}

/// Arcs by the linear law, or with the mean lever arm where `modules` is given.
#[pyfunction]
pub fn arc_from_tensions<'py>(
    py: Python<'py>,
    tensions: PyReadonlyArray2<'py, f64>,
    hole: PyReadonlyArray2<'py, f64>,
    length: PyReadonlyArray1<'py, f64>,
    bending_stiffness: PyReadonlyArray1<'py, f64>,
    modules: Option<usize>,
) -> PyResult<Array<'py>> {
    let hole = holes(&hole);
    let (tensions, length) = (tensions.as_array(), length.as_array());
    let stiffness = bending_stiffness.as_array();
    let n = tensions.nrows();
    let arcs = each(py, n, |i| {
        let t = tensions.row(i).to_vec();
        match modules {
            None => linear_law(&t, &hole, length[i], stiffness[i]),
            Some(m) => lever_arm_law(&t, &hole, length[i], stiffness[i], m),
        }
    })?;
    Ok(array(py, &[n, 3], flat(&arcs)))
}

#[pyfunction]
pub fn arc_through<'py>(
    py: Python<'py>,
    positions: PyReadonlyArray2<'py, f64>,
) -> PyResult<Array<'py>> {
    let positions = positions.as_array();
    let n = positions.nrows();
    let arcs = each(py, n, |i| Arc::through(point(positions.row(i))))?;
    Ok(array(py, &[n, 3], flat(&arcs)))
}

#[pyfunction]
pub fn arc_nearest<'py>(
    py: Python<'py>,
    positions: PyReadonlyArray2<'py, f64>,
    length: PyReadonlyArray1<'py, f64>,
) -> PyResult<(Array<'py>, Array<'py>)> {
    let (positions, length) = (positions.as_array(), length.as_array());
    let n = positions.nrows();
    let all = each(py, n, |i| Arc::nearest(point(positions.row(i)), length[i]))?;
    let (arcs, misses): (Vec<Arc>, Vec<f64>) = all.into_iter().unzip();
    Ok((array(py, &[n, 3], flat(&arcs)), array(py, &[n], misses)))
}

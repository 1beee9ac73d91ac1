//! Checked arguments from Python, each rejected with a sentence; and arrays to Python.

use bowstring_core::memory;
use bowstring_core::model::error::InputError;
use numpy::ndarray::{ArrayD, ArrayView1, ArrayViewD};
use numpy::{
    Element, IntoPyArray, PyArrayDescrMethods, PyArrayDyn, PyReadonlyArray1, PyReadonlyArray2,
    PyUntypedArray, PyUntypedArrayMethods, ToPyArray,
};
use pyo3::prelude::*;
use pyo3::types::{IntoPyDict, PyBool, PyList, PyTuple};

mod raised {
    pyo3::import_exception!(bowstring.errors, InputError);
}

pub(crate) fn refused(sentence: impl Into<String>) -> PyErr {
    raised::InputError::new_err(sentence.into())
}

/// The Python error for an error of the core, with its argument, index, value and rule.
pub(crate) fn input_error(e: InputError) -> PyErr {
    let sentence = e.to_string();
    let Some((argument, index, value, rule)) = e.parts() else {
        return refused(sentence);
    };
    let raised = Python::attach(|py| {
        let parts = [("argument", argument), ("value", &value), ("rule", &rule)];
        let parts = parts.into_py_dict(py)?;
        parts.set_item("index", index)?;
        let error = py.get_type::<raised::InputError>();
        let made = error.call((sentence,), Some(&parts))?;
        PyResult::Ok(PyErr::from_value(made))
    });
    raised.unwrap_or_else(|other| other)
}

/// A sequence of `count` numbers: an array, a list, a tuple or anything that NumPy converts to an
/// array. Its size is checked before any number is read.
pub(crate) fn numbers(
    value: &Bound<'_, PyAny>,
    name: &str,
    unit: &str,
    count: usize,
) -> PyResult<Vec<f64>> {
    /// Length up to which an invalid sequence is read for the message.
    const SHORT: usize = 1000;
    let wrong_count = |len: usize| {
        refused(format!(
            "{name} has {len} numbers, it must have {count}, in {unit}"
        ))
    };
    let is_array = value.cast::<PyUntypedArray>().is_ok();
    let listed = value.is_instance_of::<PyList>() || value.is_instance_of::<PyTuple>();
    let found = if listed {
        let len = value.len()?;
        if len != count && len > SHORT {
            return Err(wrong_count(len));
        }
        match has_truth(value)? {
            true => None,
            false => value.extract::<Vec<f64>>().ok(),
        }
    } else if is_array || value.hasattr("__array__")? {
        let array = match is_array {
            true => value.clone(),
            false => value.call_method0("__array__")?,
        };
        let shape = array.cast::<PyUntypedArray>().map(|a| a.shape().to_vec());
        match shape.as_deref() {
            Ok([len]) if *len != count && *len > SHORT => return Err(wrong_count(*len)),
            Ok([_]) => match array.extract::<PyReadonlyArray1<f64>>() {
                Ok(array) => Some(array.as_array().iter().copied().collect()),
                // truth values and complex numbers are rejected
                Err(_) => match array.cast::<PyUntypedArray>()?.dtype().kind() {
                    b'i' | b'u' | b'f' | b'O' => array.extract::<Vec<f64>>().ok(),
                    _ => None,
                },
            },
            Ok(shape) if !shape.is_empty() => {
                let shape: Vec<_> = shape.iter().map(usize::to_string).collect();
                return Err(refused(format!(
                    "{name} has shape ({}), it must be {count} numbers, in {unit}",
                    shape.join(", ")
                )));
            }
            _ => None,
        }
    } else {
        None
    };
    match found {
        Some(v) if v.len() == count => Ok(v),
        Some(v) => Err(wrong_count(v.len())),
        None => Err(refused(format!(
            "{name} is {}, it must be {count} numbers, in {unit}",
            brief(value)
        ))),
    }
}

/// Raises `InputError` if so many bytes cannot be allocated, with what needs them and what to do.
#[pyfunction]
pub fn check_memory(bytes: f64, what: &str, cure: &str) -> PyResult<()> {
    memory::check(bytes, || what.into(), cure).map_err(input_error)
}

pub(crate) type Array<'py, T = f64> = Bound<'py, PyArrayDyn<T>>;

/// Array of a shape that the values fill. A small one is copied, which is faster than transferring
/// ownership.
pub(crate) fn array<'py, T: Element + Copy>(
    py: Python<'py>,
    values: Vec<T>,
    shape: &[usize],
) -> Array<'py, T> {
    const SMALL: usize = 4096;
    if values.len() <= SMALL {
        return copied(py, &values, shape);
    }
    let owned = ArrayD::from_shape_vec(shape, values);
    owned.expect("the values fill the shape").into_pyarray(py)
}

/// A copy of values as an array of a shape that they fill.
pub(crate) fn copied<'py, T: Element + Copy>(
    py: Python<'py>,
    values: &[T],
    shape: &[usize],
) -> Array<'py, T> {
    let view = ArrayViewD::from_shape(shape, values);
    view.expect("the values fill the shape").to_pyarray(py)
}

/// Rows of `N` numbers, from an array of two dimensions.
pub(crate) struct Rows<const N: usize>(Vec<[f64; N]>);

impl<const N: usize> FromPyObject<'_, '_> for Rows<N> {
    type Error = PyErr;

    fn extract(value: Borrowed<'_, '_, PyAny>) -> PyResult<Self> {
        let array = value.extract::<PyReadonlyArray2<f64>>()?;
        let array = array.as_array();
        if array.ncols() != N {
            return Err(refused(format!("rows must have {N} numbers")));
        }
        let row = |row: ArrayView1<f64>| std::array::from_fn(|q| row[q]);
        Ok(Rows(array.rows().into_iter().map(row).collect()))
    }
}

impl<const N: usize> std::ops::Deref for Rows<N> {
    type Target = [[f64; N]];

    fn deref(&self) -> &Self::Target {
        &self.0
    }
}

/// Whether a list or a tuple contains True or False.
fn has_truth(values: &Bound<'_, PyAny>) -> PyResult<bool> {
    for item in values.try_iter()? {
        if item?.is_instance_of::<PyBool>() {
            return Ok(true);
        }
    }
    Ok(false)
}

pub(crate) fn three(value: &Bound<'_, PyAny>, name: &str, unit: &str) -> PyResult<[f64; 3]> {
    let v = numbers(value, name, unit, 3)?;
    Ok([v[0], v[1], v[2]])
}

/// Short form of an invalid value for an error.
pub(crate) fn brief(value: &Bound<'_, PyAny>) -> String {
    let text = value.repr().map_or_else(
        |_| value.get_type().to_string(),
        |r| {
            r.to_string_lossy()
                .split_whitespace()
                .collect::<Vec<_>>()
                .join(" ")
        },
    );
    match text.char_indices().nth(60) {
        Some((end, _)) => format!("{}...", &text[..end]),
        None => text,
    }
}

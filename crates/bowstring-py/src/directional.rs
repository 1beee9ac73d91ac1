//! Derivatives of an equilibrium along a direction of its load and its robot.

use crate::input::{array, input_error, refused, Array};
use crate::interrupt::interruptible;
use crate::model::{DeadLoad, OwnLoads};
use crate::rod::{Robot, Solution};
use bowstring_core::statics::directional::{self, Stencil};
use numpy::{PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;
use std::sync::{Mutex, PoisonError};

/// An equilibrium with its eliminated tangent.
#[pyclass(frozen, module = "bowstring._core")]
pub struct Linearised {
    robot: Py<Robot>,
    inner: Mutex<directional::Linearised>,
}

#[pymethods]
impl Linearised {
    /// Linearises a solution; `None` where it has no derivatives.
    #[staticmethod]
    fn at(py: Python<'_>, solution: &Solution) -> PyResult<Option<Self>> {
        if solution.answer.is_none() {
            return Ok(None);
        }
        let found = interruptible(py, || solution.ask(|solver| solver.linearised()))?;
        Ok(found.map_err(input_error)?.map(|inner| Linearised {
            robot: solution.robot.clone_ref(py),
            inner: Mutex::new(inner),
        }))
    }

    /// First derivatives, those of a lower order of accuracy, and second derivatives along a line,
    /// each as a row of tip position, tip rotation vector, elastic energy, tendon lengths and disk
    /// positions.
    ///
    /// `robots` are those at the offsets, if they differ; `tensions` (n, T) and `load` are the loads
    /// there. `weights` (3, n) give the derivatives in the order of the results.
    fn along<'py>(
        &self,
        py: Python<'py>,
        robots: Option<Vec<PyRef<'py, Robot>>>,
        tensions: PyReadonlyArray2<'py, f64>,
        load: DeadLoad<'py>,
        offsets: PyReadonlyArray1<'py, f64>,
        weights: PyReadonlyArray2<'py, f64>,
    ) -> PyResult<[Array<'py>; 3]> {
        let robot = &self.robot.get().inner;
        let loads = OwnLoads::new(robot, tensions, &load)?;
        let robots: Option<Vec<_>> =
            robots.map(|robots| robots.iter().map(|robot| robot.inner.clone()).collect());
        let rows: Vec<Vec<f64>> = weights
            .as_array()
            .outer_iter()
            .map(|w| w.to_vec())
            .collect();
        let [first, coarse, second] = <[Vec<f64>; 3]>::try_from(rows)
            .map_err(|rows| refused(format!("{} rows of weights, it must be 3", rows.len())))?;
        let stencil = Stencil {
            offsets: offsets.as_array().to_vec(),
            first,
            coarse,
            second,
        };
        let found = interruptible(py, || {
            let mut inner = self.inner.lock().unwrap_or_else(PoisonError::into_inner);
            inner.along(robots.as_deref(), &loads.borrow(), &stencil)
        })?;
        let found = found.map_err(input_error)?;
        Ok([found.first, found.coarse, found.second].map(|row| {
            let size = row.len();
            array(py, row, &[size])
        }))
    }
}

//! Equilibria as a function with derivatives, for automatic differentiation.

use crate::input::{array, input_error};
use crate::interrupt::interruptible;
use crate::model::{DeadLoad, RodModel};
use crate::rod::{column, Robot};
use bowstring_core::statics::equilibria::{self, Derivatives, Inputs};
use bowstring_core::statics::solver::{Outcome, Status};
use numpy::PyReadonlyArray2;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::collections::HashMap;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::sync::{Arc, LazyLock, Mutex, PoisonError};

/// Functions of this process by their keys. A compiled program has only the key, and may outlive
/// every Python object, so that they are kept.
static REGISTERED: LazyLock<Mutex<HashMap<String, Arc<equilibria::Equilibria>>>> =
    LazyLock::new(Mutex::default);

/// The function of a key.
pub fn registered(key: &str) -> Option<Arc<equilibria::Equilibria>> {
    let all = REGISTERED.lock().unwrap_or_else(PoisonError::into_inner);
    all.get(key).cloned()
}

/// Derivatives that are wanted, and whether those by gravity are.
pub fn wanted(jacobians: bool, gravity: bool) -> Derivatives {
    match (jacobians, gravity) {
        (false, _) => Derivatives::None,
        (true, false) => Derivatives::Most,
        (true, true) => Derivatives::All,
    }
}

/// Equilibria of a robot under constant loads, as a function of tensions, gravity, tip load and
/// stiffness.
#[pyclass(frozen, module = "bowstring._core")]
pub struct Equilibria {
    key: String,
    function: Arc<equilibria::Equilibria>,
}

#[pymethods]
impl Equilibria {
    /// Of the load, those on disks and backbone act in all rows.
    #[new]
    fn new(robot: &Robot, load: DeadLoad<'_>, model: &RodModel) -> PyResult<Self> {
        let of = &robot.inner;
        let load = load.with(of, vec![0.0; of.tendon_count()])?;
        let function = equilibria::Equilibria::new(of, robot.settings(model), load);
        let function = function.map_err(input_error)?;
        // a key is the same for the same function only, also in other processes: JAX may keep
        // compiled programs on disk
        let description = function.description();
        let mut all = REGISTERED.lock().unwrap_or_else(PoisonError::into_inner);
        for salt in 0u64.. {
            let mut hasher = DefaultHasher::new();
            (salt, &description).hash(&mut hasher);
            let key = format!("{:016x}", hasher.finish());
            match all.get(&key) {
                Some(known) if known.description() != description => continue,
                Some(known) => {
                    let function = known.clone();
                    return Ok(Equilibria { key, function });
                }
                None => {
                    let function = Arc::new(function);
                    all.insert(key.clone(), function.clone());
                    return Ok(Equilibria { key, function });
                }
            }
        }
        unreachable!("one of so many keys is free")
    }

    /// Key of the function in compiled programs.
    #[getter]
    fn key(&self) -> &str {
        &self.key
    }

    /// Equilibria of n rows as arrays, and their derivatives (n, 6 + T, T + 6 + S) if `jacobians`:
    /// tip position, rotation vector and tendon lengths by tensions, tip force, tip moment and
    /// factors of stiffness; with `gravity` also by gravity, in three more columns.
    ///
    /// `inputs` are tensions (n, T), gravity, tip force, tip moment (n, 3), and factors (n, S).
    fn evaluate<'py>(
        &self,
        py: Python<'py>,
        inputs: [PyReadonlyArray2<'py, f64>; 5],
        threads: usize,
        jacobians: bool,
        gravity: bool,
    ) -> PyResult<Bound<'py, PyDict>> {
        let own = inputs.map(|v| v.as_array().iter().copied().collect::<Vec<f64>>());
        let [tensions, gravities, tip_force, tip_moment, stiffness] = &own;
        let n = gravities.len() / 3;
        let inputs = Inputs {
            count: n,
            tensions,
            gravity: gravities,
            tip_force,
            tip_moment,
            stiffness,
        };
        let derivatives = wanted(jacobians, gravity);
        let work = || self.function.evaluate(&inputs, threads, derivatives);
        let found = interruptible(py, work)?;
        let found = found.map_err(input_error)?;
        let [rows, columns] = self.function.jacobian_shape(derivatives);
        let solutions = found.solutions;
        let outcomes = &solutions.outcomes;
        let converged = |o: &Outcome| o.status == Status::Converged;
        let stable = |o: &Outcome| o.status == Status::Converged && o.stable == Some(true);
        let out = PyDict::new(py);
        out.set_item("converged", column(py, outcomes, converged))?;
        out.set_item("stable", column(py, outcomes, stable))?;
        for (name, values, shape) in [
            ("tip_position", solutions.tip_position, &[n, 3][..]),
            ("tip_rotation", solutions.tip_rotation, &[n, 3, 3]),
            ("tendon_lengths", solutions.tendon_length, &[n, rows - 6]),
        ] {
            out.set_item(name, array(py, values, shape))?;
        }
        let by = jacobians.then(|| array(py, found.jacobians, &[n, rows, columns]));
        out.set_item("jacobians", by)?;
        Ok(out)
    }
}

//! Robots driven by pulls, and tendons that rub: `Drive`, one step of a path after another.

use crate::input::{input_error, numbers, refused, three};
use crate::interrupt::interruptible;
use crate::model::{DeadLoad, Lines, OwnLoads, RodModel};
use crate::rod::{array, check_rows, Answer, Driven, Robot, Solution, State};
use bowstring_core::model::load::Load;
use bowstring_core::model::load::RodModel as Settings;
use bowstring_core::statics::path::{self, Command};
use bowstring_core::statics::path_batch::{self, PathSolutions, Steps};
use bowstring_core::statics::solver::{Outcome, Status};
use numpy::{IntoPyArray, PyArray1, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2};
use numpy::{PyReadonlyArray, PyUntypedArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyDict;

/// A robot that is driven through its tendons, along a path.
#[pyclass(module = "bowstring._core")]
pub struct Drive {
    robot: Py<Robot>,
    settings: Settings,
    inner: path::Drive,
}

impl Drive {
    pub(crate) fn inner(&self) -> &path::Drive {
        &self.inner
    }
}

#[pymethods]
impl Drive {
    /// From the arrays of a robot's tendons; without friction if it is left out.
    #[new]
    fn new(
        robot: &Bound<'_, Robot>,
        model: &RodModel,
        tendons: Lines<'_>,
        friction: bool,
    ) -> PyResult<Self> {
        let settings = model.settings();
        let inner = &robot.get().inner;
        let lines = tendons.lines(inner.tendon_count(), friction)?;
        let drive = interruptible(robot.py(), || {
            path::Drive::new(inner, settings.model, settings.elements, &lines)
        })?;
        Ok(Drive {
            robot: robot.clone().unbind(),
            settings,
            inner: drive.map_err(input_error)?,
        })
    }

    /// Back to the home pose.
    fn reset(&mut self) {
        self.inner.reset();
    }

    /// One step of the path: which tendons are pulled by a length, and lengths or tensions.
    fn step(
        &mut self,
        py: Python<'_>,
        pulled: PyReadonlyArray1<bool>,
        commands: &Bound<'_, PyAny>,
        load: DeadLoad<'_>,
    ) -> PyResult<Solution> {
        let count = self.inner.robot().tendon_count();
        let commands = numbers(commands, "commands", "m or N", count)?;
        let pulled: Vec<bool> = pulled.as_array().iter().copied().collect();
        if pulled.len() != count {
            return Err(refused(format!("pulled must have {count} entries")));
        }
        let mut load = load.with(self.inner.robot(), vec![])?;
        let given = path_batch::commands(&pulled, &commands);
        let drive = &mut self.inner;
        let found =
            interruptible(py, || drive.step(&given, &load.borrow()))?.map_err(input_error)?;
        let converged = found.status == Status::Converged;
        load.tensions = if converged {
            self.inner.history().tensions.clone()
        } else {
            path_batch::commanded_tensions(&given)
        };
        let answer = converged.then(|| Answer::read(self.inner.robot(), self.inner.solver()));
        let state = converged.then(|| State {
            solver: self.inner.solver().clone(),
            pulls: (0..count).map(|i| self.inner.pull(i)).collect(),
            slack: self.inner.slack().to_vec(),
            spans: self.inner.span_tensions(),
        });
        Ok(Solution::driven_one(
            self.robot.clone_ref(py),
            Settings {
                elements: Some(self.inner.solver().elements()),
                ..self.settings
            },
            load,
            Outcome::from(&found),
            answer,
            Driven {
                pulled,
                commands,
                found,
                state,
            },
        ))
    }

    /// Many steps: each from the one before or, with `threads` (0: one for each core), each from
    /// where the drive stands. Arrays of n rows; the load may have one row.
    fn follow<'py>(
        &mut self,
        py: Python<'py>,
        pulled: PyReadonlyArray2<'py, bool>,
        commands: PyReadonlyArray2<'py, f64>,
        load: DeadLoad<'py>,
        disks: bool,
        threads: Option<usize>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let robot = self.robot.clone_ref(py);
        let core = &robot.get().inner;
        if pulled.shape() != commands.shape() {
            return Err(refused("pulled and commands must have the same shape"));
        }
        let (count, n, m) = (
            commands.shape()[0],
            core.module_count(),
            core.tendon_count(),
        );
        let numbers = 12 + (n + 7) * m + if disks { 12 * n } else { 0 } + 40;
        check_rows(count, numbers, disks)?;
        let loads = OwnLoads::new(core, commands, &load)?;
        let pulled: Vec<bool> = pulled.as_array().iter().copied().collect();
        let steps = Steps {
            loads: loads.borrow(),
            displaced: &pulled,
        };
        let drive = &mut self.inner;
        let found = interruptible(py, || match threads {
            None => path_batch::follow(drive, &steps, disks),
            Some(threads) => path_batch::solve_each(drive, &steps, threads, disks),
        })?
        .map_err(input_error)?;
        arrays(py, robot.get(), found, disks)
    }

    /// What friction remembers of the path, and where it has come to.
    fn history<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let now = self.inner.history();
        let (n, m) = (self.inner.robot().module_count(), now.tensions.len());
        let out = PyDict::new(py);
        out.set_item("tensions", PyArray1::from_slice(py, &now.tensions))?;
        let table = |v: &[f64]| PyArray1::from_slice(py, v).reshape([n, m]);
        out.set_item("drops", table(&now.drops)?)?;
        out.set_item("spans", table(&now.spans)?)?;
        let (pulled, commands): (Vec<bool>, Vec<f64>) = now
            .commands
            .iter()
            .map(|c| match *c {
                Command::Pull(p) => (true, p),
                Command::Tension(t) => (false, t),
            })
            .unzip();
        out.set_item("pulled", PyArray1::from_slice(py, &pulled))?;
        out.set_item("commands", PyArray1::from_slice(py, &commands))?;
        for (name, v) in ["gravity", "tip_force", "tip_moment"].iter().zip(&now.load) {
            out.set_item(name, PyArray1::from_slice(py, v))?;
        }
        let strain = self.inner.strain();
        let flat: Vec<f64> = strain.iter().flatten().copied().collect();
        let slips = self.inner.slips().into_pyarray(py).reshape([n, m])?;
        out.set_item("slips", slips)?;
        out.set_item("strain", flat.into_pyarray(py).reshape([strain.len(), 3])?)?;
        Ok(out)
    }

    /// Goes on from a history.
    fn resume(&mut self, history: History<'_>) -> PyResult<()> {
        let pulled: Vec<bool> = flat(&history.pulled);
        let commands: Vec<f64> = flat(&history.commands);
        if pulled.len() != commands.len() || history.strain.shape()[1] != 3 {
            return Err(refused("the history does not belong to this robot"));
        }
        let load = Load {
            tensions: &[],
            gravity: three(&history.gravity, "gravity", "m/s^2")?,
            tip_force: three(&history.tip_force, "tip_force", "N")?,
            tip_moment: three(&history.tip_moment, "tip_moment", "N m")?,
        };
        let given = path_batch::commands(&pulled, &commands);
        let rows: Vec<[f64; 3]> = history
            .strain
            .as_array()
            .rows()
            .into_iter()
            .map(|r| [r[0], r[1], r[2]])
            .collect();
        self.inner
            .resume(
                &flat(&history.tensions),
                &flat(&history.drops),
                &flat(&history.spans),
                &given,
                &load,
            )
            .and_then(|()| self.inner.start_from(&rows, &flat(&history.slips)))
            .map_err(input_error)
    }
}

/// What `Drive::history` gave, as items of a mapping.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
struct History<'py> {
    tensions: PyReadonlyArray1<'py, f64>,
    drops: PyReadonlyArray2<'py, f64>,
    spans: PyReadonlyArray2<'py, f64>,
    pulled: PyReadonlyArray1<'py, bool>,
    commands: PyReadonlyArray1<'py, f64>,
    gravity: Bound<'py, PyAny>,
    tip_force: Bound<'py, PyAny>,
    tip_moment: Bound<'py, PyAny>,
    strain: PyReadonlyArray2<'py, f64>,
    slips: PyReadonlyArray2<'py, i8>,
}

fn flat<T: numpy::Element + Copy, D: numpy::ndarray::Dimension>(
    array: &PyReadonlyArray<'_, T, D>,
) -> Vec<T> {
    array.as_array().iter().copied().collect()
}

/// Answers as NumPy arrays, named as in `bowstring.Sweep`.
fn arrays<'py>(
    py: Python<'py>,
    robot: &Robot,
    found: PathSolutions,
    disks: bool,
) -> PyResult<Bound<'py, PyDict>> {
    let (count, m) = (found.details.len(), robot.inner.tendon_count());
    let n = robot.inner.module_count();
    let out = robot.arrays(py, found.poses, disks)?;
    out.set_item("tensions", array(py, found.tensions, [count, m])?)?;
    out.set_item("pulls", array(py, found.displacements, [count, m])?)?;
    out.set_item("slack_lengths", array(py, found.slack, [count, m])?)?;
    out.set_item(
        "span_tensions",
        array(py, found.span_tensions, [count, n, m])?,
    )?;
    let undetermined = found.details.iter().map(|row| row.undetermined).collect();
    out.set_item("undetermined", array(py, undetermined, [count])?)?;
    let lacks = found
        .details
        .iter()
        .map(|row| row.length_residual)
        .collect();
    out.set_item("length_residual", array(py, lacks, [count])?)?;
    // of the rows that have one
    let conflicts = PyDict::new(py);
    for (i, row) in found.details.into_iter().enumerate() {
        if let Some(conflict) = row.conflict {
            conflicts.set_item(i, *conflict)?;
        }
    }
    out.set_item("conflicts", conflicts)?;
    Ok(out)
}

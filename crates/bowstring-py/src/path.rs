//! Displacement control and friction: `PathSolver`, one step of a path after another.

use crate::input::{array, copied, input_error, numbers, refused, three, Rows};
use crate::interrupt::interruptible;
use crate::model::{lines_of, DeadLoad, DesignArrays, OwnLoads, RodModel};
use crate::model::{numbers_of_points, point_loads, POINT_LOAD};
use crate::rod::{check_rows, column, Answer, PathResult, Robot, Solution, State};
use bowstring_core::model::load::Load;
use bowstring_core::model::load::RodModel as Settings;
use bowstring_core::model::robot::Robot as Inner;
use bowstring_core::rod::estimate::ErrorEstimate;
use bowstring_core::statics::hysteresis::Hysteresis;
use bowstring_core::statics::inelastic::Inelasticity;
use bowstring_core::statics::path::{self, Command, Memory};
use bowstring_core::statics::path_batch::{self, Designs, PathSolutions, Steps};
use bowstring_core::statics::relaxation::{Creep, Relaxation, TERMS};
use bowstring_core::statics::solver::{Outcome, Status};
use numpy::ndarray::ArrayView2;
use numpy::{PyReadonlyArray, PyUntypedArrayMethods};
use numpy::{PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray3};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::array::from_fn;

/// States of a path after its rows: initial guesses of those of a path with slightly other numbers.
/// A new object has no guess.
#[pyclass(module = "bowstring._core", frozen)]
#[derive(Default)]
pub struct PathStates(Vec<Option<path::History>>);

#[pymethods]
impl PathStates {
    #[new]
    fn new() -> Self {
        PathStates::default()
    }
}

/// A robot that is actuated through its tendons, along a path.
#[pyclass(module = "bowstring._core")]
pub struct PathSolver {
    robot: Py<Robot>,
    settings: Settings,
    inner: path::PathSolver,
}

impl PathSolver {
    pub(crate) fn inner(&self) -> &path::PathSolver {
        &self.inner
    }
}

#[pymethods]
impl PathSolver {
    /// From the lines of a robot's tendons (T, 9), and its inelasticity: share and play (1/m) of the
    /// hysteresis of each segment (S, 2), share and time (s) of the two terms of its relaxation
    /// (S, 2, 2), compliance (m/N) and time (s) of those of the creep of each tendon (T, 2, 2).
    /// Elastic, without friction and backlash, unless it `has_memory`; `alone` without the companion
    /// that states errors of a memory.
    #[new]
    #[pyo3(signature = (robot, model, lines, inelasticity, has_memory, alone=false))]
    fn new(
        robot: &Bound<'_, Robot>,
        model: &RodModel,
        lines: PyReadonlyArray2<'_, f64>,
        inelasticity: Laws<'_>,
        has_memory: bool,
        alone: bool,
    ) -> PyResult<Self> {
        let settings = robot.get().settings(model);
        let inner = &robot.get().inner;
        let mut lines = lines_of(&lines);
        if !has_memory {
            lines
                .iter_mut()
                .for_each(|line| (line.friction, line.backlash) = (0.0, 0.0));
        }
        let laws = if has_memory {
            laws(&inelasticity)
        } else {
            Inelasticity::default()
        };
        let path = interruptible(robot.py(), || {
            path::PathSolver::new(inner, settings.model, settings.elements, &lines)
                .and_then(|path| path.with_inelasticity(&laws))
                .map(|path| if alone { path.alone() } else { path })
        })?;
        Ok(PathSolver {
            robot: robot.clone().unbind(),
            settings,
            inner: path.map_err(input_error)?,
        })
    }

    /// Returns to the home pose.
    fn reset(&mut self) {
        self.inner.reset();
    }

    /// One step of the path: which tendons are displacement-controlled, displacements or tensions,
    /// and the time since the last step (s).
    #[pyo3(signature = (by_displacement, commands, load, duration=0.0))]
    fn step(
        &mut self,
        py: Python<'_>,
        by_displacement: PyReadonlyArray1<bool>,
        commands: &Bound<'_, PyAny>,
        load: DeadLoad<'_>,
        duration: f64,
    ) -> PyResult<Solution> {
        self.inner.set_duration(duration).map_err(input_error)?;
        let count = self.inner.robot().tendon_count();
        let commands = numbers(commands, "commands", "m or N", count)?;
        let by_displacement: Vec<bool> = by_displacement.as_array().iter().copied().collect();
        if by_displacement.len() != count {
            return Err(refused(format!(
                "by_displacement must have {count} entries"
            )));
        }
        let mut load = load.with(self.inner.robot(), vec![])?;
        let given = path_batch::commands(&by_displacement, &commands);
        let path = &mut self.inner;
        let found =
            interruptible(py, || path.step(&given, &load.borrow()))?.map_err(input_error)?;
        let converged = found.status == Status::Converged;
        load.tensions = if converged {
            self.inner.history().tensions.clone()
        } else {
            path_batch::commanded_tensions(&given)
        };
        let answer = converged.then(|| Answer::read(self.inner.robot(), self.inner.solver()));
        let state = converged.then(|| State {
            solver: self.inner.solver().clone(),
            displacements: (0..count).map(|i| self.inner.displacement(i)).collect(),
            slack: self.inner.slack().to_vec(),
            spans: self.inner.span_tensions(),
        });
        Ok(Solution {
            robot: self.robot.clone_ref(py),
            settings: Settings {
                elements: Some(self.inner.solver().elements()),
                ..self.settings
            },
            load,
            outcome: Outcome::from(&found),
            answer,
            path: Some(Box::new(PathResult {
                by_displacement,
                commands,
                found,
                state,
            })),
        })
    }

    /// Many steps: each from the one before or, with `threads` (0: one for each core), each from
    /// the present state of the path. Arrays of n rows; the load may have one row. Durations are the
    /// times from the row before to each row (s), zero by default.
    /// With `guesses` a path in sequence starts each row from a guess, and returns its own states.
    #[allow(clippy::too_many_arguments)]
    #[pyo3(signature = (by_displacement, commands, load, disks, threads, durations=None, guesses=None))]
    fn follow<'py>(
        &mut self,
        py: Python<'py>,
        by_displacement: PyReadonlyArray2<'py, bool>,
        commands: PyReadonlyArray2<'py, f64>,
        load: DeadLoad<'py>,
        disks: bool,
        threads: Option<usize>,
        durations: Option<PyReadonlyArray1<'py, f64>>,
        guesses: Option<&PathStates>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let robot = self.robot.clone_ref(py);
        let core = &robot.get().inner;
        if by_displacement.shape() != commands.shape() {
            return Err(refused(SHAPES));
        }
        let count = commands.shape()[0];
        check_path_rows(core, count, disks)?;
        let loads = OwnLoads::new(core, commands, &load)?;
        let by_displacement = flat(&by_displacement);
        let durations = durations_of(durations, count)?;
        let steps = Steps {
            loads: loads.borrow(),
            by_displacement: &by_displacement,
            durations: &durations,
            guesses: guesses.map(|each| &each.0[..]),
        };
        let path = &mut self.inner;
        let found = interruptible(py, || match threads {
            None => path_batch::follow(path, &steps, disks),
            Some(threads) => path_batch::solve_each(path, &steps, threads, disks),
        })?
        .map_err(input_error)?;
        arrays(py, robot.get(), found, disks)
    }

    /// Many steps of this path, and of perturbed ones beside it with their own commands; returns
    /// the former and then the latter, whose solvers stay as they are. The rest as for `follow`.
    #[allow(clippy::too_many_arguments)]
    #[pyo3(signature = (by_displacement, commands, load, disks, perturbed, durations=None, guesses=None))]
    fn follow_perturbed<'py>(
        &mut self,
        py: Python<'py>,
        by_displacement: PyReadonlyArray2<'py, bool>,
        commands: PyReadonlyArray2<'py, f64>,
        load: DeadLoad<'py>,
        disks: bool,
        perturbed: Vec<(PyRef<'py, PathSolver>, PyReadonlyArray2<'py, f64>)>,
        durations: Option<PyReadonlyArray1<'py, f64>>,
        guesses: Option<&PathStates>,
    ) -> PyResult<Vec<Bound<'py, PyDict>>> {
        let robot = self.robot.clone_ref(py);
        let core = &robot.get().inner;
        let shape = by_displacement.shape();
        let differs = |rows: &PyReadonlyArray2<'_, f64>| rows.shape() != shape;
        if differs(&commands) || perturbed.iter().any(|(_, rows)| differs(rows)) {
            return Err(refused(SHAPES));
        }
        check_path_rows(core, shape[0] * (1 + perturbed.len()), disks)?;
        let durations = durations_of(durations, shape[0])?;
        let by_displacement = flat(&by_displacement);
        let steps = |loads| Steps {
            loads,
            by_displacement: &by_displacement,
            durations: &durations,
            guesses: None,
        };
        let own = OwnLoads::new(core, commands, &load)?;
        let (paths, loads): (Vec<_>, Vec<_>) = perturbed
            .into_iter()
            .map(|(path, commands)| {
                let own = path.inner.clone();
                let loads = OwnLoads::new(own.robot(), commands, &load)?;
                Ok((own, loads))
            })
            .collect::<PyResult<_>>()?;
        let rows = loads.iter().map(|loads| steps(loads.borrow()));
        let mut perturbed: Vec<_> = paths.into_iter().zip(rows).collect();
        let nominal = Steps {
            guesses: guesses.map(|each| &each.0[..]),
            ..steps(own.borrow())
        };
        let path = &mut self.inner;
        let found = interruptible(py, || {
            path_batch::follow_perturbed(path, &nominal, &mut perturbed, disks)
        })?
        .map_err(input_error)?;
        found
            .into_iter()
            .map(|found| arrays(py, robot.get(), found, disks))
            .collect()
    }

    /// State of the path after its last step.
    fn history<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let now = self.inner.history();
        let (n, m) = (self.inner.robot().module_count(), now.tensions.len());
        let out = PyDict::new(py);
        let by_displacement: Vec<_> = now.commands.iter().map(Command::is_displacement).collect();
        let commands: Vec<_> = now.commands.iter().map(Command::value).collect();
        let load = &now.load;
        let strain = self.inner.strain();
        let error = self.inner.remembered();
        let carried = [error.tip, error.tension, self.inner.waited()];
        let floats = |values: &[f64], shape: &[usize]| copied(py, values, shape).into_any();
        let on_disks = |v: &[[f64; 3]]| floats(v.as_flattened(), &[v.len(), 3]);
        for (name, values) in [
            ("tensions", floats(&now.tensions, &[m])),
            ("drops", floats(&now.drops, &[n, m])),
            ("spans", floats(&now.spans, &[n, m])),
            (
                "by_displacement",
                copied(py, &by_displacement, &[m]).into_any(),
            ),
            ("commands", floats(&commands, &[m])),
            ("gravity", floats(&load.gravity, &[3])),
            ("tip_force", floats(&load.tip_force, &[3])),
            ("tip_moment", floats(&load.tip_moment, &[3])),
            ("disk_forces", on_disks(&load.disk_forces)),
            ("disk_moments", on_disks(&load.disk_moments)),
            ("point_loads", {
                let shape = [load.point_loads.len(), POINT_LOAD];
                array(py, numbers_of_points(&load.point_loads), &shape).into_any()
            }),
            ("line_forces", on_disks(&load.line_forces)),
            ("slips", array(py, self.inner.slips(), &[n, m]).into_any()),
            (
                "plays",
                floats(now.plays.as_flattened(), &[now.plays.len(), 2]),
            ),
            (
                "lags",
                floats(
                    now.lags.as_flattened().as_flattened(),
                    &[now.lags.len(), 2 * TERMS],
                ),
            ),
            (
                "crept",
                floats(now.crept.as_flattened(), &[now.crept.len(), TERMS]),
            ),
            ("carried", floats(&carried, &[3])),
            ("strain", floats(strain.as_flattened(), &[strain.len(), 3])),
        ] {
            out.set_item(name, values)?;
        }
        Ok(out)
    }

    /// Continues from a history.
    fn resume(&mut self, history: History<'_>) -> PyResult<()> {
        let by_displacement: Vec<bool> = flat(&history.by_displacement);
        let commands: Vec<f64> = flat(&history.commands);
        let (true, Ok(strain)) = (
            by_displacement.len() == commands.len(),
            history.strain.extract::<Rows<3>>(),
        ) else {
            return Err(refused("the history does not belong to this robot"));
        };
        let plays = history.plays.extract::<Rows<2>>()?;
        let lags = history.lags.extract::<Rows<{ 2 * TERMS }>>()?;
        let of_terms = |row: &[f64; 2 * TERMS]| from_fn(|i| [row[2 * i], row[2 * i + 1]]);
        let lags: Vec<_> = lags.iter().map(of_terms).collect();
        let crept = history.crept.extract::<Rows<{ TERMS }>>()?;
        let [tip, tension, waited] = three(&history.carried, "carried", "m, N, s")?;
        let disk_forces = history.disk_forces.extract::<Rows<3>>()?;
        let disk_moments = history.disk_moments.extract::<Rows<3>>()?;
        let line_forces = history.line_forces.extract::<Rows<3>>()?;
        let disks = self.inner.robot().module_count();
        let point_loads = point_loads(&flat(&history.point_loads), disks);
        let load = Load {
            tensions: &[],
            gravity: three(&history.gravity, "gravity", "m/s^2")?,
            tip_force: three(&history.tip_force, "tip_force", "N")?,
            tip_moment: three(&history.tip_moment, "tip_moment", "N m")?,
            disk_forces: &disk_forces,
            disk_moments: &disk_moments,
            point_loads: &point_loads,
            line_forces: &line_forces,
            ..Load::default()
        };
        let given = path_batch::commands(&by_displacement, &commands);
        self.inner
            .resume(
                &flat(&history.tensions),
                &flat(&history.drops),
                &flat(&history.spans),
                &given,
                &load,
            )
            .and_then(|()| {
                let memory = Memory {
                    plays: &plays,
                    lags: &lags,
                    crept: &crept,
                    error: ErrorEstimate { tip, tension },
                    waited,
                };
                self.inner
                    .start_from(&strain, &flat(&history.slips), memory)
            })
            .map_err(input_error)
    }
}

const SHAPES: &str = "by_displacement and commands must have the same shape";

/// Checks that the solutions of so many rows fit into memory.
fn check_path_rows(robot: &Inner, rows: usize, disks: bool) -> PyResult<()> {
    let (n, m) = (robot.module_count(), robot.tendon_count());
    let numbers = 12 + (n + 7) * m + if disks { 12 * n } else { 0 } + 40;
    check_rows(rows, numbers, disks)
}

/// Times from row to row (s), one for each of `count` rows; empty for zero.
fn durations_of(given: Option<PyReadonlyArray1<'_, f64>>, count: usize) -> PyResult<Vec<f64>> {
    match given.map(|given| flat(&given)) {
        Some(durations) if durations.len() != count => {
            Err(refused(format!("durations must have {count} entries")))
        }
        given => Ok(given.unwrap_or_default()),
    }
}

/// Paths of many robots like `robot`, each from its home pose along its own rows, on `threads`
/// cores (0: all). Commands are which tendons are displacement-controlled, and the values.
#[pyfunction]
pub fn follow_designs<'py>(
    py: Python<'py>,
    robot: &Robot,
    designs: DesignArrays<'py>,
    commands: (PyReadonlyArray2<'py, bool>, PyReadonlyArray2<'py, f64>),
    load: DeadLoad<'py>,
    model: &RodModel,
    threads: usize,
) -> PyResult<Bound<'py, PyDict>> {
    let (by_displacement, commands) = commands;
    if by_displacement.shape() != commands.shape() {
        return Err(refused(SHAPES));
    }
    let core = &robot.inner;
    check_path_rows(core, commands.shape()[0], false)?;
    let robots = designs.robots(core)?;
    let lines = designs.lines();
    let loads = OwnLoads::new(core, commands, &load)?;
    let by_displacement: Vec<bool> = by_displacement.as_array().iter().copied().collect();
    let steps = Steps {
        loads: loads.borrow(),
        by_displacement: &by_displacement,
        durations: &[],
        guesses: None,
    };
    let designs = Designs {
        robots: &robots,
        lines: &lines,
    };
    let found = interruptible(py, || {
        path_batch::follow_designs(&designs, &robot.settings(model), &steps, threads)
    })?;
    arrays(py, robot, found.map_err(input_error)?, false)
}

/// Items of a mapping from `PathSolver::history`.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
struct History<'py> {
    tensions: PyReadonlyArray1<'py, f64>,
    drops: PyReadonlyArray2<'py, f64>,
    spans: PyReadonlyArray2<'py, f64>,
    by_displacement: PyReadonlyArray1<'py, bool>,
    commands: PyReadonlyArray1<'py, f64>,
    gravity: Bound<'py, PyAny>,
    tip_force: Bound<'py, PyAny>,
    tip_moment: Bound<'py, PyAny>,
    disk_forces: PyReadonlyArray2<'py, f64>,
    disk_moments: PyReadonlyArray2<'py, f64>,
    point_loads: PyReadonlyArray2<'py, f64>,
    line_forces: PyReadonlyArray2<'py, f64>,
    strain: Bound<'py, PyAny>,
    slips: PyReadonlyArray2<'py, i8>,
    plays: Bound<'py, PyAny>,
    lags: Bound<'py, PyAny>,
    crept: Bound<'py, PyAny>,
    carried: Bound<'py, PyAny>,
}

/// Hysteresis (S, 2), relaxation (S, 2, 2) and creep (T, 2, 2).
type Laws<'py> = (
    PyReadonlyArray2<'py, f64>,
    PyReadonlyArray3<'py, f64>,
    PyReadonlyArray3<'py, f64>,
);

/// Laws from shares and plays, shares and times, compliances and times.
fn laws((hysteresis, relaxation, creep): &Laws<'_>) -> Inelasticity {
    let rows = hysteresis.as_array();
    Inelasticity {
        hysteresis: rows
            .outer_iter()
            .map(|row| Hysteresis {
                share: row[0],
                play: row[1],
            })
            .collect(),
        relaxation: terms(relaxation, |[share, time]| Relaxation { share, time }),
        creep: terms(creep, |[compliance, time]| Creep { compliance, time }),
    }
}

/// Terms of each segment or tendon from pairs of numbers (n, TERMS, 2).
fn terms<L>(array: &PyReadonlyArray3<'_, f64>, law: impl Fn([f64; 2]) -> L) -> Vec<[L; TERMS]> {
    let array = array.as_array();
    let of = |pairs: ArrayView2<'_, f64>| from_fn(|i| law([pairs[[i, 0]], pairs[[i, 1]]]));
    array.outer_iter().map(of).collect()
}

fn flat<T: numpy::Element + Copy, D: numpy::ndarray::Dimension>(
    array: &PyReadonlyArray<'_, T, D>,
) -> Vec<T> {
    array.as_array().iter().copied().collect()
}

/// Solutions as NumPy arrays, named as in `bowstring.Sweep`.
fn arrays<'py>(
    py: Python<'py>,
    robot: &Robot,
    found: PathSolutions,
    disks: bool,
) -> PyResult<Bound<'py, PyDict>> {
    let (count, m) = (found.details.len(), robot.inner.tendon_count());
    let n = robot.inner.module_count();
    let out = robot.arrays(py, found.poses, disks)?;
    for (name, values, shape) in [
        ("tensions", found.tensions, &[count, m][..]),
        ("displacements", found.displacements, &[count, m]),
        ("slack_lengths", found.slack, &[count, m]),
        ("span_tensions", found.span_tensions, &[count, n, m]),
    ] {
        out.set_item(name, array(py, values, shape))?;
    }
    let undetermined = column(py, &found.details, |row| row.undetermined);
    out.set_item("undetermined", undetermined)?;
    let residuals = column(py, &found.details, |row| row.length_residual);
    out.set_item("length_residual", residuals)?;
    // of the rows that have one
    let conflicts = PyDict::new(py);
    for (i, row) in found.details.into_iter().enumerate() {
        if let Some(conflict) = row.conflict {
            conflicts.set_item(i, *conflict)?;
        }
    }
    out.set_item("conflicts", conflicts)?;
    if !found.states.is_empty() {
        out.set_item("states", PathStates(found.states))?;
    }
    Ok(out)
}

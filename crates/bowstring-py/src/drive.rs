//! Robots driven by pulls, and tendons that rub: `Drive`, one step of a path after another.

use crate::input::{input_error, numbers, refused, three, OwnLoads};
use crate::interrupt::interruptible;
use crate::model::{DeadLoad, Lines, RodModel};
use crate::rod::{array, check_rows, Answer, Driven, Robot, Solution, State};
use bowstring_core::interrupt::{self, interrupted};
use bowstring_core::memory;
use bowstring_core::model::load::Load;
use bowstring_core::model::robot::InputError;
use bowstring_core::statics::batch::{self, Settings, Solutions};
use bowstring_core::statics::path::{self, Command, DriveOutcome};
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
        let given = orders(&pulled, &commands);
        let drive = &mut self.inner;
        let found =
            interruptible(py, || drive.step(&given, &load.borrow()))?.map_err(input_error)?;
        let converged = found.status == Status::Converged;
        load.tensions = if converged {
            self.inner.history().tensions.clone()
        } else {
            tensions_of(&given)
        };
        let answer = converged.then(|| Answer::read(self.inner.robot(), self.inner.solver()));
        let state = converged.then(|| State {
            solver: self.inner.solver().clone(),
            pulls: (0..count).map(|i| self.inner.pull(i)).collect(),
            slack: self.inner.slack().to_vec(),
            spans: span_tensions(&self.inner),
        });
        Ok(Solution::driven_one(
            self.robot.clone_ref(py),
            Settings {
                elements: Some(self.inner.solver().elements()),
                ..self.settings
            },
            load,
            outcome(&found),
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
        let drive = &mut self.inner;
        let rows = interruptible(py, || {
            for row in 0..count {
                if interrupt::work(10 + m) {
                    break;
                }
                let load = loads.borrow().row(row, m);
                let given = orders(&pulled[row * m..][..m], load.tensions);
                drive
                    .check(&given, &load)
                    .map_err(|e| InputError(format!("row {row}: {e}")))?;
            }
            let mut rows = Rows::new(core, count, disks)?;
            match threads {
                None => rows.follow(drive, &pulled, &loads),
                Some(threads) => {
                    drive.check_copies(2 * batch::thread_count(threads).min(count))?;
                    rows.solve(drive, &pulled, &loads, threads);
                }
            }
            Ok(rows)
        })?
        .map_err(input_error)?;
        rows.arrays(py, robot.get(), disks)
    }

    /// What friction remembers of the path, and where it has come to.
    fn history<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let now = self.inner.history();
        let (n, m) = (core_modules(&self.inner), now.tensions.len());
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
        let given = orders(&pulled, &commands);
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

fn core_modules(drive: &path::Drive) -> usize {
    drive.robot().module_count()
}

fn orders(pulled: &[bool], values: &[f64]) -> Vec<Command> {
    let both = pulled.iter().zip(values);
    both.map(|(pulled, value)| match pulled {
        true => Command::Pull(*value),
        false => Command::Tension(*value),
    })
    .collect()
}

/// Tensions that are known without an answer.
fn tensions_of(commands: &[Command]) -> Vec<f64> {
    let tension = |c: &Command| match *c {
        Command::Tension(t) => t,
        Command::Pull(_) => f64::NAN,
    };
    commands.iter().map(tension).collect()
}

fn span_tensions(drive: &path::Drive) -> Vec<f64> {
    let m = drive.robot().tendon_count();
    (0..core_modules(drive) * m)
        .map(|k| drive.span_tension(k / m, k % m))
        .collect()
}

fn outcome(found: &DriveOutcome) -> Outcome {
    Outcome {
        status: found.status,
        stable: match found.status {
            Status::NoEquilibrium => None,
            _ => found.stable,
        },
        iterations: found.iterations,
        residual: found.residual,
        left_unstable: false,
        fraction: 1.0,
        collision: None,
        error: found.error,
    }
}

/// What there is to say of a row beside its numbers.
struct Row {
    outcome: Outcome,
    undetermined: bool,
    length_residual: f64,
    /// Tendons that fight, and the nearest pulls with an equilibrium.
    conflict: Option<Box<Conflict>>,
}

type Conflict = (Vec<usize>, Option<Vec<f64>>);

/// Answers row by row; NaN where a row did not converge.
struct Rows {
    rows: Vec<Row>,
    /// Flat arrays, see `Columns`.
    columns: Columns<Vec<f64>>,
}

/// Numbers of rows, one array for each kind.
#[derive(Default)]
struct Columns<T> {
    tip_position: T,
    tip_rotation: T,
    tendon_length: T,
    disk_position: T,
    disk_rotation: T,
    tensions: T,
    pulls: T,
    slack: T,
    spans: T,
}

impl<T> Columns<T> {
    fn each(self) -> [T; 9] {
        [
            self.tip_position,
            self.tip_rotation,
            self.tendon_length,
            self.disk_position,
            self.disk_rotation,
            self.tensions,
            self.pulls,
            self.slack,
            self.spans,
        ]
    }

    fn of(values: [T; 9]) -> Self {
        let [tip_position, tip_rotation, tendon_length, disk_position, disk_rotation, tensions, pulls, slack, spans] =
            values;
        Columns {
            tip_position,
            tip_rotation,
            tendon_length,
            disk_position,
            disk_rotation,
            tensions,
            pulls,
            slack,
            spans,
        }
    }
}

/// Consecutive rows and the place for their answers.
struct Part<'a> {
    first: usize,
    rows: &'a mut [Row],
    columns: Columns<&'a mut [f64]>,
}

/// Rows that one thread takes at a time.
const PART: usize = 16;

impl Rows {
    /// Room for so many rows.
    fn new(
        robot: &bowstring_core::model::robot::Robot,
        count: usize,
        disks: bool,
    ) -> Result<Self, InputError> {
        let refused = || {
            InputError(format!(
                "the answers of {count} loads do not fit into memory; give fewer at a time"
            ))
        };
        let mut rows = Vec::new();
        rows.try_reserve_exact(count).map_err(|_| refused())?;
        rows.resize_with(count, || Row {
            outcome: outcome(&DriveOutcome::pending()),
            undetermined: false,
            length_residual: f64::NAN,
            conflict: None,
        });
        let mut columns = Columns::default().each();
        for (column, width) in columns.iter_mut().zip(widths(robot, disks)) {
            *column = memory::unknown(count.checked_mul(width), &refused)?;
        }
        Ok(Rows {
            rows,
            columns: Columns::of(columns),
        })
    }

    /// Disjoint pieces of `size` rows, the last one perhaps shorter.
    fn parts(&mut self, widths: [usize; 9], size: usize) -> Vec<Part<'_>> {
        let Columns {
            tip_position,
            tip_rotation,
            tendon_length,
            disk_position,
            disk_rotation,
            tensions,
            pulls,
            slack,
            spans,
        } = &mut self.columns;
        let mut rest: [&mut [f64]; 9] = [
            tip_position,
            tip_rotation,
            tendon_length,
            disk_position,
            disk_rotation,
            tensions,
            pulls,
            slack,
            spans,
        ];
        let mut parts = Vec::new();
        for (i, rows) in self.rows.chunks_mut(size.max(1)).enumerate() {
            let mut here: [&mut [f64]; 9] = Default::default();
            for ((here, rest), width) in here.iter_mut().zip(&mut rest).zip(widths) {
                (*here, *rest) = std::mem::take(rest).split_at_mut(width * rows.len());
            }
            parts.push(Part {
                first: i * size,
                rows,
                columns: Columns::of(here),
            });
        }
        parts
    }

    /// Rows in order, each from where the drive has come to.
    fn follow(&mut self, drive: &mut path::Drive, pulled: &[bool], loads: &OwnLoads) {
        let widths = widths(drive.robot(), !self.columns.disk_position.is_empty());
        for mut part in self.parts(widths, loads.count) {
            for row in 0..part.rows.len() {
                if interrupted() {
                    return;
                }
                part.fill(row, drive, pulled, loads);
            }
        }
    }

    /// Independent rows, each from where the drive stands.
    fn solve(&mut self, drive: &path::Drive, pulled: &[bool], loads: &OwnLoads, threads: usize) {
        let widths = widths(drive.robot(), !self.columns.disk_position.is_empty());
        let mut parts = self.parts(widths, PART);
        let copy = || drive.clone();
        batch::for_each(&mut parts, threads, copy, |copy, part| {
            for row in 0..part.rows.len() {
                if interrupted() {
                    return;
                }
                copy.clone_from(drive);
                part.fill(row, copy, pulled, loads);
            }
        });
    }

    fn arrays<'py>(
        self,
        py: Python<'py>,
        robot: &Robot,
        disks: bool,
    ) -> PyResult<Bound<'py, PyDict>> {
        let (count, m) = (self.rows.len(), robot.inner.tendon_count());
        let n = robot.inner.module_count();
        let Columns {
            tip_position,
            tip_rotation,
            tendon_length,
            disk_position,
            disk_rotation,
            tensions,
            pulls,
            slack,
            spans,
        } = self.columns;
        let solutions = Solutions {
            outcomes: self.rows.iter().map(|row| row.outcome).collect(),
            tip_position,
            tip_rotation,
            tendon_length,
            disk_position,
            disk_rotation,
        };
        let out = robot.arrays(py, solutions, disks)?;
        out.set_item("tensions", array(py, tensions, [count, m])?)?;
        out.set_item("pulls", array(py, pulls, [count, m])?)?;
        out.set_item("slack_lengths", array(py, slack, [count, m])?)?;
        out.set_item("span_tensions", array(py, spans, [count, n, m])?)?;
        let undetermined = self.rows.iter().map(|row| row.undetermined).collect();
        out.set_item("undetermined", array(py, undetermined, [count])?)?;
        let lacks = self.rows.iter().map(|row| row.length_residual).collect();
        out.set_item("length_residual", array(py, lacks, [count])?)?;
        // of the rows that have one
        let conflicts = PyDict::new(py);
        for (i, row) in self.rows.into_iter().enumerate() {
            if let Some(conflict) = row.conflict {
                conflicts.set_item(i, *conflict)?;
            }
        }
        out.set_item("conflicts", conflicts)?;
        Ok(out)
    }
}

/// Numbers of a row in each column.
fn widths(robot: &bowstring_core::model::robot::Robot, disks: bool) -> [usize; 9] {
    let (n, m) = (robot.module_count(), robot.tendon_count());
    let shown = if disks { n } else { 0 };
    Columns {
        tip_position: 3,
        tip_rotation: 9,
        tendon_length: m,
        disk_position: 3 * shown,
        disk_rotation: 9 * shown,
        tensions: m,
        pulls: m,
        slack: m,
        spans: n * m,
    }
    .each()
}

impl Part<'_> {
    /// A step of the drive to the load of a row.
    fn fill(&mut self, row: usize, drive: &mut path::Drive, pulled: &[bool], loads: &OwnLoads) {
        let (n, m) = (core_modules(drive), drive.robot().tendon_count());
        let i = self.first + row;
        let load = loads.borrow().row(i, m);
        let given = orders(&pulled[i * m..][..m], load.tensions);
        let found = drive.step(&given, &load).expect("all rows were checked");
        let to = &mut self.columns;
        let put = |to: &mut [f64], from: &[f64]| {
            if !to.is_empty() {
                to[row * from.len()..][..from.len()].copy_from_slice(from);
            }
        };
        if found.status == Status::Converged {
            let answer = Answer::read(drive.robot(), drive.solver());
            put(to.tip_position, &answer.disk_position[3 * (n - 1)..]);
            put(to.tip_rotation, &answer.disk_rotation[9 * (n - 1)..]);
            put(to.tendon_length, &answer.tendon_length);
            put(to.disk_position, &answer.disk_position);
            put(to.disk_rotation, &answer.disk_rotation);
            put(to.tensions, &drive.history().tensions);
            let pulls: Vec<f64> = (0..m).map(|j| drive.pull(j)).collect();
            put(to.pulls, &pulls);
            put(to.slack, drive.slack());
            put(to.spans, &span_tensions(drive));
        } else {
            put(to.tensions, &tensions_of(&given));
        }
        let tells = !found.fighting.is_empty() || found.nearest.is_some();
        self.rows[row] = Row {
            outcome: outcome(&found),
            undetermined: found.undetermined,
            length_residual: found.length_residual,
            conflict: tells.then(|| Box::new((found.fighting, found.nearest))),
        };
    }
}

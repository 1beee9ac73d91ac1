//! Robots driven by pulls, and tendons that rub: `Drive`, one step of a path after another.

use crate::input::{input_error, numbers, refused, settings, three, OwnLoads};
use crate::rod::{Answer, Driven, Robot, Solution, State};
use bowstring_core::batch::{Settings, Solutions};
use bowstring_core::drive::{self, Command, DriveOutcome, Line};
use bowstring_core::load::{Load, OwnedLoad};
use bowstring_core::robot::InputError;
use bowstring_core::statics::{Outcome, Status};
use numpy::{IntoPyArray, PyArray1, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2};
use numpy::{PyReadonlyArray, PyUntypedArrayMethods};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};

/// A robot that is driven through its tendons, along a path.
#[pyclass(module = "bowstring._core")]
pub struct Drive {
    robot: Py<Robot>,
    settings: Settings,
    inner: drive::Drive,
}

impl Drive {
    pub(crate) fn inner(&self) -> &drive::Drive {
        &self.inner
    }
}

#[pymethods]
impl Drive {
    #[new]
    #[pyo3(signature = (robot, theory, tendon, twist, elements, stiffness, free_length, compliance,
        friction, pretension))]
    #[allow(clippy::too_many_arguments)]
    fn new(
        robot: &Bound<'_, Robot>,
        theory: &str,
        tendon: &str,
        twist: bool,
        elements: Option<usize>,
        stiffness: &Bound<'_, PyAny>,
        free_length: &Bound<'_, PyAny>,
        compliance: &Bound<'_, PyAny>,
        friction: &Bound<'_, PyAny>,
        pretension: &Bound<'_, PyAny>,
    ) -> PyResult<Self> {
        let settings = settings(theory, tendon, twist, elements)?;
        let inner = &robot.get().inner;
        let count = inner.tendon_count();
        let stiffness = numbers(stiffness, "stiffness", "N", count)?;
        let free_length = numbers(free_length, "free_length", "m", count)?;
        let compliance = numbers(compliance, "compliance", "m/N", count)?;
        let friction = numbers(friction, "friction", "1", count)?;
        let pretension = numbers(pretension, "pretension", "N", count)?;
        let lines: Vec<_> = (0..count)
            .map(|i| Line {
                stiffness: stiffness[i],
                free_length: free_length[i],
                compliance: compliance[i],
                friction: friction[i],
                pretension: pretension[i],
            })
            .collect();
        let drive = robot
            .py()
            .detach(|| drive::Drive::new(inner, settings.model, settings.elements, &lines));
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
        gravity: Option<&Bound<'_, PyAny>>,
        tip_force: &Bound<'_, PyAny>,
        tip_moment: &Bound<'_, PyAny>,
    ) -> PyResult<Solution> {
        let spec = self.inner.robot().spec();
        let count = spec.tendons.len();
        let commands = numbers(commands, "commands", "m or N", count)?;
        let pulled: Vec<bool> = pulled.as_array().iter().copied().collect();
        if pulled.len() != count {
            return Err(refused(format!("pulled must have {count} entries")));
        }
        let mut load = OwnedLoad {
            tensions: vec![],
            gravity: match gravity {
                Some(g) => three(g, "gravity", "m/s^2")?,
                None => spec.gravity,
            },
            tip_force: three(tip_force, "tip_force", "N")?,
            tip_moment: three(tip_moment, "tip_moment", "N m")?,
        };
        let given = orders(&pulled, &commands);
        let drive = &mut self.inner;
        let found = py
            .detach(|| drive.step(&given, &load.borrow()))
            .map_err(input_error)?;
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

    /// Many steps: each from the one before, or (`path` false) each from where the drive stands,
    /// on `threads` cores (0: all). Arrays of n rows, the last three may be one row.
    #[allow(clippy::too_many_arguments)]
    fn follow<'py>(
        &mut self,
        py: Python<'py>,
        pulled: PyReadonlyArray2<'py, bool>,
        commands: PyReadonlyArray2<'py, f64>,
        gravity: Option<&Bound<'py, PyAny>>,
        tip_force: &Bound<'py, PyAny>,
        tip_moment: &Bound<'py, PyAny>,
        disks: bool,
        path: bool,
        threads: usize,
    ) -> PyResult<Bound<'py, PyDict>> {
        let robot = self.robot.clone_ref(py);
        let core = &robot.get().inner;
        if pulled.shape() != commands.shape() {
            return Err(refused("pulled and commands must have the same shape"));
        }
        let loads = OwnLoads::new(core, commands, gravity, tip_force, tip_moment)?;
        let pulled: Vec<bool> = pulled.as_array().iter().copied().collect();
        let count = loads.count;
        let mut rows = Rows::new(core, count, disks);
        let drive = &mut self.inner;
        py.detach(|| {
            if path {
                return rows.fill(drive, &pulled, &loads, 0, false);
            }
            let cores = std::thread::available_parallelism().map_or(1, |n| n.get());
            let wanted = if threads == 0 { cores } else { threads };
            rows.fill_side_by_side(drive, &pulled, &loads, wanted)
        })
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
    #[allow(clippy::too_many_arguments)]
    fn resume(
        &mut self,
        tensions: PyReadonlyArray1<f64>,
        drops: PyReadonlyArray2<f64>,
        spans: PyReadonlyArray2<f64>,
        pulled: PyReadonlyArray1<bool>,
        commands: PyReadonlyArray1<f64>,
        gravity: &Bound<'_, PyAny>,
        tip_force: &Bound<'_, PyAny>,
        tip_moment: &Bound<'_, PyAny>,
        strain: PyReadonlyArray2<f64>,
        slips: PyReadonlyArray2<i8>,
    ) -> PyResult<()> {
        let pulled: Vec<bool> = flat(&pulled);
        let commands: Vec<f64> = flat(&commands);
        if pulled.len() != commands.len() || strain.shape()[1] != 3 {
            return Err(refused("the history does not belong to this robot"));
        }
        let load = Load {
            tensions: &[],
            gravity: three(gravity, "gravity", "m/s^2")?,
            tip_force: three(tip_force, "tip_force", "N")?,
            tip_moment: three(tip_moment, "tip_moment", "N m")?,
        };
        let given = orders(&pulled, &commands);
        let rows: Vec<[f64; 3]> = strain
            .as_array()
            .rows()
            .into_iter()
            .map(|r| [r[0], r[1], r[2]])
            .collect();
        self.inner
            .resume(
                &flat(&tensions),
                &flat(&drops),
                &flat(&spans),
                &given,
                &load,
            )
            .and_then(|()| self.inner.start_from(&rows, &flat(&slips)))
            .map_err(input_error)
    }
}

fn flat<T: numpy::Element + Copy, D: numpy::ndarray::Dimension>(
    array: &PyReadonlyArray<'_, T, D>,
) -> Vec<T> {
    array.as_array().iter().copied().collect()
}

fn core_modules(drive: &drive::Drive) -> usize {
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

fn span_tensions(drive: &drive::Drive) -> Vec<f64> {
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

/// Answers row by row; NaN where a row did not converge.
struct Rows {
    found: Vec<DriveOutcome>,
    solutions: Solutions,
    tensions: Vec<f64>,
    pulls: Vec<f64>,
    slack: Vec<f64>,
    spans: Vec<f64>,
}

impl Rows {
    fn new(robot: &bowstring_core::robot::Robot, count: usize, disks: bool) -> Self {
        let (n, m) = (robot.module_count(), robot.tendon_count());
        let none = |width: usize| vec![f64::NAN; width * count];
        let shown = if disks { n } else { 0 };
        Rows {
            found: Vec::with_capacity(count),
            solutions: Solutions {
                outcomes: Vec::with_capacity(count),
                tip_position: none(3),
                tip_rotation: none(9),
                tendon_length: none(m),
                disk_position: none(3 * shown),
                disk_rotation: none(9 * shown),
            },
            tensions: none(m),
            pulls: none(m),
            slack: none(m),
            spans: none(n * m),
        }
    }

    /// Rows from `first` on, as many as there is place for.
    fn fill(
        &mut self,
        drive: &mut drive::Drive,
        pulled: &[bool],
        loads: &OwnLoads,
        first: usize,
        apart: bool,
    ) -> Result<(), InputError> {
        let m = drive.robot().tendon_count();
        let n = core_modules(drive);
        let start = apart.then(|| drive.clone());
        for row in 0..self.tensions.len() / m {
            if let (Some(start), true) = (&start, row > 0) {
                drive.clone_from(start);
            }
            let i = first + row;
            let load = loads.borrow().row(i, m);
            let given = orders(&pulled[i * m..][..m], load.tensions);
            let found = drive
                .step(&given, &load)
                .map_err(|e| InputError(format!("row {i}: {e}")))?;
            self.solutions.outcomes.push(outcome(&found));
            let tensions = &mut self.tensions[row * m..][..m];
            if found.status == Status::Converged {
                let answer = Answer::read(drive.robot(), drive.solver());
                let s = &mut self.solutions;
                let put = |to: &mut [f64], width: usize, from: &[f64]| {
                    if !to.is_empty() {
                        to[row * width..][..width].copy_from_slice(from);
                    }
                };
                put(&mut s.tip_position, 3, &answer.disk_position[3 * (n - 1)..]);
                put(&mut s.tip_rotation, 9, &answer.disk_rotation[9 * (n - 1)..]);
                put(&mut s.tendon_length, m, &answer.tendon_length);
                put(&mut s.disk_position, 3 * n, &answer.disk_position);
                put(&mut s.disk_rotation, 9 * n, &answer.disk_rotation);
                tensions.copy_from_slice(&drive.history().tensions);
                let pulls: Vec<f64> = (0..m).map(|j| drive.pull(j)).collect();
                put(&mut self.pulls, m, &pulls);
                put(&mut self.slack, m, drive.slack());
                put(&mut self.spans, n * m, &span_tensions(drive));
            } else {
                tensions.copy_from_slice(&tensions_of(&given));
            }
            self.found.push(found);
        }
        Ok(())
    }

    /// Independent rows, each from where the drive stands.
    fn fill_side_by_side(
        &mut self,
        drive: &drive::Drive,
        pulled: &[bool],
        loads: &OwnLoads,
        threads: usize,
    ) -> Result<(), InputError> {
        let robot = drive.robot();
        let disks = !self.solutions.disk_position.is_empty();
        let size = loads.count.div_ceil(threads.max(1)).max(1);
        let firsts: Vec<usize> = (0..loads.count).step_by(size).collect();
        let parts: Vec<Result<Rows, InputError>> = std::thread::scope(|scope| {
            let workers: Vec<_> = firsts
                .iter()
                .map(|first| {
                    scope.spawn(move || {
                        let count = size.min(loads.count - first);
                        let mut part = Rows::new(robot, count, disks);
                        let mut drive = drive.clone();
                        part.fill(&mut drive, pulled, loads, *first, true)?;
                        Ok(part)
                    })
                })
                .collect();
            let joined = workers.into_iter().map(|w| w.join());
            joined
                .map(|part| part.unwrap_or_else(|panic| std::panic::resume_unwind(panic)))
                .collect()
        });
        *self = Rows::new(robot, 0, disks);
        for part in parts {
            let part = part?;
            self.found.extend(part.found);
            let (s, t) = (&mut self.solutions, part.solutions);
            s.outcomes.extend(t.outcomes);
            s.tip_position.extend(t.tip_position);
            s.tip_rotation.extend(t.tip_rotation);
            s.tendon_length.extend(t.tendon_length);
            s.disk_position.extend(t.disk_position);
            s.disk_rotation.extend(t.disk_rotation);
            self.tensions.extend(part.tensions);
            self.pulls.extend(part.pulls);
            self.slack.extend(part.slack);
            self.spans.extend(part.spans);
        }
        Ok(())
    }

    fn arrays<'py>(
        self,
        py: Python<'py>,
        robot: &Robot,
        disks: bool,
    ) -> PyResult<Bound<'py, PyDict>> {
        let (count, m) = (self.found.len(), robot.inner.tendon_count());
        let n = robot.inner.module_count();
        let out = robot.arrays(py, self.solutions, disks)?;
        let table = |v: Vec<f64>| v.into_pyarray(py).reshape([count, m]);
        out.set_item("tensions", table(self.tensions)?)?;
        out.set_item("pulls", table(self.pulls)?)?;
        out.set_item("slack_lengths", table(self.slack)?)?;
        let spans = self.spans.into_pyarray(py).reshape([count, n, m])?;
        out.set_item("span_tensions", spans)?;
        let undetermined = self.found.iter().map(|f| f.undetermined);
        out.set_item("undetermined", PyArray1::from_iter(py, undetermined))?;
        let lacks = self.found.iter().map(|f| f.length_residual);
        out.set_item("length_residual", PyArray1::from_iter(py, lacks))?;
        let fighting = self.found.iter().map(|f| f.fighting.clone());
        let nearest = self.found.iter().map(|f| f.nearest.clone());
        let why = fighting.zip(nearest).collect::<Vec<_>>();
        out.set_item("conflicts", PyList::new(py, why)?)?;
        Ok(out)
    }
}

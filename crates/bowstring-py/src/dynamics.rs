//! Dynamics of the rod: `Simulator`, a robot that moves, and `flexibility` for its modes.

use crate::drive::Drive;
use crate::rod::{input_error, model, numbers, refused, three, Robot};
use bowstring_core::dynamics::{self, Damping, Energies, Fields, Settings, Step, Stop};
use bowstring_core::load::Load;
use bowstring_core::modes::{self, Flexibility};
use numpy::{
    IntoPyArray, PyArray1, PyArrayDyn, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2,
    PyUntypedArrayMethods,
};
use pyo3::prelude::*;
use pyo3::types::PyDict;

/// A robot that moves.
#[pyclass(module = "bowstring._core")]
pub struct Simulator {
    inner: dynamics::Simulator,
}

#[pymethods]
impl Simulator {
    #[new]
    #[pyo3(signature = (robot, theory, tendon, twist, elements, gravity, mass_damping,
        material_damping, spectral_radius, step, tolerance, longest_step))]
    #[allow(clippy::too_many_arguments)]
    fn new(
        robot: &Robot,
        theory: &str,
        tendon: &str,
        twist: bool,
        elements: usize,
        gravity: Option<&Bound<'_, PyAny>>,
        mass_damping: f64,
        material_damping: f64,
        spectral_radius: f64,
        step: Option<f64>,
        tolerance: f64,
        longest_step: f64,
    ) -> PyResult<Self> {
        let robot = &robot.inner;
        let settings = Settings {
            gravity: match gravity {
                Some(g) => three(g, "gravity", "m/s^2")?,
                None => robot.spec().gravity,
            },
            damping: Damping {
                mass: mass_damping,
                material: material_damping,
            },
            spectral_radius,
            step: match step {
                Some(step) => Step::Fixed(step),
                None => Step::Adaptive {
                    tolerance,
                    longest: longest_step,
                },
            },
        };
        let model = model(theory, tendon, twist)?;
        dynamics::Simulator::new(robot, model, elements, settings)
            .map(|inner| Simulator { inner })
            .map_err(input_error)
    }

    /// Goes to rest in the equilibrium of a load; returns the status of its search.
    fn rest(
        &mut self,
        tensions: &Bound<'_, PyAny>,
        tip_force: &Bound<'_, PyAny>,
        tip_moment: &Bound<'_, PyAny>,
    ) -> PyResult<&'static str> {
        let load = Load {
            tensions: &self.tensions(tensions)?,
            gravity: [0.0; 3],
            tip_force: three(tip_force, "tip_force", "N")?,
            tip_moment: three(tip_moment, "tip_moment", "N m")?,
        };
        let outcome = self.inner.rest(&load).map_err(input_error)?;
        Ok(outcome.status.word())
    }

    /// Goes to rest where a drive of the same robot and settings has come to, and is driven on as in
    /// its last step; returns whether that worked.
    fn rest_at(&mut self, drive: PyRef<'_, Drive>) -> PyResult<bool> {
        let stop = self.inner.rest_at(drive.inner()).map_err(input_error)?;
        Ok(stop.is_none())
    }

    /// Adds dead forces on all disks, (N, 3) in N, and goes to rest under them; they stay until
    /// `release`. Returns whether that worked.
    fn hold(&mut self, forces: PyReadonlyArray2<'_, f64>, increments: usize) -> PyResult<bool> {
        if forces.shape()[1] != 3 {
            return Err(refused("disk forces must have three columns"));
        }
        let rows: Vec<_> = forces
            .as_array()
            .rows()
            .into_iter()
            .map(|r| [r[0], r[1], r[2]])
            .collect();
        let stop = self.inner.rest_with_disk_forces(&rows, increments);
        Ok(stop.map_err(input_error)?.is_none())
    }

    /// Takes the forces of `hold` off at once.
    fn release(&mut self) {
        self.inner.release_disk_forces();
    }

    /// Changes the load at once.
    fn jump(
        &mut self,
        tensions: &Bound<'_, PyAny>,
        tip_force: &Bound<'_, PyAny>,
        tip_moment: &Bound<'_, PyAny>,
    ) -> PyResult<()> {
        let load = Load {
            tensions: &self.tensions(tensions)?,
            gravity: [0.0; 3],
            tip_force: three(tip_force, "tip_force", "N")?,
            tip_moment: three(tip_moment, "tip_moment", "N m")?,
        };
        self.inner.jump(&load).map_err(input_error)
    }

    /// Through stretches of time, one a row, in which the load goes in a straight line to that
    /// of the row; appends the fields after every row where `record` is set. Stops early where
    /// a step fails or disks meet: `stop` says which.
    #[allow(clippy::too_many_arguments)]
    fn run<'py>(
        &mut self,
        py: Python<'py>,
        duration: PyReadonlyArray1<'py, f64>,
        tensions: PyReadonlyArray2<'py, f64>,
        tip_force: PyReadonlyArray2<'py, f64>,
        tip_moment: PyReadonlyArray2<'py, f64>,
        record: PyReadonlyArray1<'py, bool>,
        points: usize,
    ) -> PyResult<Bound<'py, PyDict>> {
        let rows = duration.len();
        let robot = self.inner.robot();
        let (n, m) = (robot.module_count(), robot.tendon_count());
        for (name, shape, expected) in [
            ("tensions", tensions.shape(), [rows, m]),
            ("tip_force", tip_force.shape(), [rows, 3]),
            ("tip_moment", tip_moment.shape(), [rows, 3]),
        ] {
            if shape != expected {
                return Err(refused(format!(
                    "{name} has shape {shape:?}, it must have {expected:?}"
                )));
            }
        }
        if record.len() != rows {
            return Err(refused(format!(
                "record has {} entries, it must have {rows}",
                record.len()
            )));
        }
        if points == 1 {
            return Err(refused(
                "points is 1, it must be 2 or more, or 0 for no fields",
            ));
        }
        let (duration, record) = (duration.as_array(), record.as_array());
        let (force, moment) = (tip_force.as_array(), tip_moment.as_array());
        let tensions = tensions.as_array();
        let mut own = vec![0.0; m];
        let times = record.iter().filter(|wanted| **wanted).count();
        let mut fields = Fields::with_room(times, n, m, points);
        let mut total = dynamics::Count::default();
        let mut stop = None;
        let simulator = &mut self.inner;
        py.detach(|| {
            for row in 0..rows {
                for (to, from) in own.iter_mut().zip(tensions.row(row)) {
                    *to = *from;
                }
                let load = Load {
                    tensions: &own,
                    gravity: [0.0; 3],
                    tip_force: [0, 1, 2].map(|i| force[[row, i]]),
                    tip_moment: [0, 1, 2].map(|i| moment[[row, i]]),
                };
                let count;
                (stop, count) = simulator.advance(duration[row], &load)?;
                total.steps += count.steps;
                total.iterations += count.iterations;
                total.repeated += count.repeated;
                if stop.is_some() || record[row] {
                    simulator.record(points, &mut fields);
                }
                if stop.is_some() {
                    break;
                }
            }
            Ok(())
        })
        .map_err(input_error)?;
        let out = PyDict::new(py);
        let word = stop.map(|s| match s {
            Stop::StepFailed => "step_failed",
            Stop::Collision => "collision",
        });
        out.set_item("stop", word)?;
        out.set_item("steps", total.steps)?;
        out.set_item("iterations", total.iterations)?;
        out.set_item("repeated", total.repeated)?;
        let times = fields.time.len();
        let shaped = |v: Vec<f64>, shape: &[usize]| -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
            v.into_pyarray(py).reshape(shape)
        };
        let each = |value: &dyn Fn(&Energies) -> f64| {
            PyArray1::from_iter(py, fields.energies.iter().map(value))
        };
        out.set_item("kinetic_energy", each(&|e| e.kinetic))?;
        out.set_item("elastic_energy", each(&|e| e.elastic))?;
        out.set_item("gravity_energy", each(&|e| e.gravity))?;
        out.set_item("work", each(&|e| e.work))?;
        out.set_item("dissipated_energy", each(&|e| e.dissipated))?;
        let p = n * points;
        out.set_item("time", shaped(fields.time, &[times])?)?;
        out.set_item("position", shaped(fields.position, &[times, p, 3])?)?;
        out.set_item("rotation", shaped(fields.rotation, &[times, p, 3, 3])?)?;
        out.set_item("force", shaped(fields.force, &[times, p, 3])?)?;
        out.set_item("moment", shaped(fields.moment, &[times, p, 3])?)?;
        let disk = |v, shape: &[usize]| shaped(v, shape);
        out.set_item("disk_position", disk(fields.disk_position, &[times, n, 3])?)?;
        out.set_item(
            "disk_rotation",
            disk(fields.disk_rotation, &[times, n, 3, 3])?,
        )?;
        out.set_item("disk_velocity", disk(fields.disk_velocity, &[times, n, 3])?)?;
        out.set_item(
            "disk_angular_velocity",
            disk(fields.disk_angular_velocity, &[times, n, 3])?,
        )?;
        out.set_item("tension", shaped(fields.tension, &[times, m])?)?;
        out.set_item("tendon_length", shaped(fields.tendon_length, &[times, m])?)?;
        if points > 0 {
            out.set_item("span_length", shaped(fields.span_length, &[times, n, m])?)?;
        }
        if !fields.pull.is_empty() {
            out.set_item("pull", shaped(fields.pull, &[times, m])?)?;
            out.set_item("slack", shaped(fields.slack, &[times, m])?)?;
            out.set_item("span_tension", shaped(fields.span_tension, &[times, n, m])?)?;
        }
        Ok(out)
    }

    /// Step to come, s.
    #[getter]
    fn next_step(&self) -> f64 {
        self.inner.next_step()
    }

    /// Time since the start, s.
    #[getter]
    fn time(&self) -> f64 {
        self.inner.time()
    }
}

impl Simulator {
    fn tensions(&self, given: &Bound<'_, PyAny>) -> PyResult<Vec<f64>> {
        numbers(given, "tensions", "N", self.inner.robot().tendon_count())
    }
}

/// Flexibility (K, K), masses (K,), mass points a module.
type Arrays<'py> = (
    Bound<'py, PyArrayDyn<f64>>,
    Bound<'py, PyArray1<f64>>,
    usize,
);

fn arrays<'py>(py: Python<'py>, found: Flexibility) -> PyResult<Arrays<'py>> {
    let size = found.masses.len();
    let matrix = found.matrix.into_pyarray(py).reshape([size, size])?;
    Ok((
        matrix.to_dyn().clone(),
        found.masses.into_pyarray(py),
        found.points,
    ))
}

/// The same where a drive has come to: None where that is no stable equilibrium.
#[pyfunction]
pub fn flexibility_at<'py>(
    py: Python<'py>,
    drive: PyRef<'py, Drive>,
) -> PyResult<Option<Arrays<'py>>> {
    let drive = drive.inner();
    let found = py.detach(|| modes::flexibility_at(drive));
    found.map(|f| arrays(py, f)).transpose()
}

/// Status, and flexibility (K, K), masses (K,) and mass points a module about the equilibrium of
/// a load: None where there is no stable equilibrium.
#[pyfunction]
#[allow(clippy::too_many_arguments)]
pub fn flexibility<'py>(
    py: Python<'py>,
    robot: &Robot,
    tensions: &Bound<'py, PyAny>,
    theory: &str,
    gravity: Option<&Bound<'py, PyAny>>,
    tip_force: &Bound<'py, PyAny>,
    tendon: &str,
    twist: bool,
    elements: usize,
) -> PyResult<(&'static str, Option<Arrays<'py>>)> {
    let robot = &robot.inner;
    let tensions = numbers(tensions, "tensions", "N", robot.tendon_count())?;
    let load = Load {
        tensions: &tensions,
        gravity: match gravity {
            Some(g) => three(g, "gravity", "m/s^2")?,
            None => robot.spec().gravity,
        },
        tip_force: three(tip_force, "tip_force", "N")?,
        tip_moment: [0.0; 3],
    };
    let model = model(theory, tendon, twist)?;
    let (outcome, found) = py
        .detach(|| modes::flexibility(robot, model, elements, &load))
        .map_err(input_error)?;
    let found = found.map(|f| arrays(py, f)).transpose()?;
    Ok((outcome.status.word(), found))
}

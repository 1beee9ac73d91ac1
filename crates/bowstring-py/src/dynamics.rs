//! Dynamics of the rod: `Simulator`, a robot in motion, and `flexibility` for its modes.

use crate::fields::Records;
use crate::input::{array, copied, input_error, numbers, refused, three, Array, Rows};
use crate::interrupt::interruptible;
use crate::model::{self, point_loads, vectors, DeadLoad, RodModel, POINT_LOAD};
use crate::path::PathSolver;
use crate::rod::Robot;
use bowstring_core::dynamics::integrator::{
    self, Count, Damping, Energies, Fields, Integrator, Step, Stop,
};
use bowstring_core::dynamics::modal;
use bowstring_core::model::load::{BaseMotion, Load, OwnedLoad};
use bowstring_core::statics::solver::Status;
use numpy::ndarray::ArrayView2;
use numpy::{PyArray1, PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::time::{Duration, Instant};

/// Numbers of the motion of the base at one time, and of that in an interval.
const BASE: usize = 9;
const BASE_ROW: usize = 3 * BASE;

/// Loads at one time, a tuple: actuation of each tendon; force and moment on the tip; forces and
/// moments on the disks, (3 N,), numbers of P point loads, (12 P,), and forces per length before each
/// disk, (3 N,), or empty if there are none; acceleration, angular velocity and angular acceleration
/// of the base, (9,), or empty where it does not move.
#[derive(FromPyObject)]
struct InstantLoad<'py>(
    Bound<'py, PyAny>,
    Bound<'py, PyAny>,
    Bound<'py, PyAny>,
    Bound<'py, PyAny>,
    Bound<'py, PyAny>,
    Bound<'py, PyAny>,
    Bound<'py, PyAny>,
    Bound<'py, PyAny>,
);

/// The same at several times, row by row; the motion of the base as `run` has it.
#[derive(FromPyObject)]
struct LoadRows<'py>(
    PyReadonlyArray2<'py, f64>,
    PyReadonlyArray2<'py, f64>,
    PyReadonlyArray2<'py, f64>,
    PyReadonlyArray2<'py, f64>,
    PyReadonlyArray2<'py, f64>,
    PyReadonlyArray2<'py, f64>,
    PyReadonlyArray2<'py, f64>,
    PyReadonlyArray2<'py, f64>,
);

/// A robot in motion, and the records of its run.
#[pyclass(module = "bowstring._core")]
pub struct Simulator {
    inner: integrator::Simulator,
    count: Count,
    /// Stations in each module; 0 records the motion of the tip only.
    points: usize,
    /// Length in the home pose (m) and compliance (m/N) of each tendon, from which the displacement
    /// of tension-controlled tendons is computed.
    home: Vec<f64>,
    compliance: Vec<f64>,
    /// Output times (s).
    times: Vec<f64>,
    tip_position: Vec<f64>,
    tip_velocity: Vec<f64>,
    /// Fields at the output times that have not been written to a file.
    fields: Fields,
    records: Option<Records>,
    /// Time spent on the file.
    output: Duration,
}

#[pymethods]
impl Simulator {
    /// Stations in each module (0 records the motion of the tip only); for the displacement of
    /// tension-controlled tendons, their length in the home pose (m) and compliance (m/N).
    #[new]
    fn new(
        robot: &Robot,
        model: &RodModel,
        gravity: Option<&Bound<'_, PyAny>>,
        scheme: Scheme,
        points: usize,
        home: &Bound<'_, PyAny>,
        compliance: &Bound<'_, PyAny>,
    ) -> PyResult<Self> {
        let (robot, chosen) = (&robot.inner, robot.settings(model));
        if points == 1 {
            return Err(refused(
                "points is 1, it must be 2 or more, or 0 for no fields",
            ));
        }
        let settings = Integrator {
            gravity: model::gravity(robot, gravity)?,
            damping: Damping {
                mass: scheme.mass_damping,
                material: scheme.material_damping,
            },
            spectral_radius: scheme.spectral_radius,
            step: match scheme.step {
                Some(step) => Step::Fixed(step),
                None => Step::Adaptive {
                    tolerance: scheme.tolerance,
                    longest: scheme.longest_step,
                },
            },
        };
        let (model, elements) = (chosen.model, model.elements_or_one());
        let tendons = robot.tendon_count();
        let inner =
            integrator::Simulator::new(robot, model, elements, settings).map_err(input_error)?;
        Ok(Simulator {
            inner,
            count: Count::default(),
            points,
            home: numbers(home, "home", "m", tendons)?,
            compliance: numbers(compliance, "compliance", "m/N", tendons)?,
            times: Vec::new(),
            tip_position: Vec::new(),
            tip_velocity: Vec::new(),
            fields: Fields::default(),
            records: None,
            output: Duration::ZERO,
        })
    }

    /// Writes all later fields to a file: packed into `room`, a whole number of records, which is
    /// passed to `append` whenever it is full and at the end of `run`. Columns of the sections (P,
    /// 10): those of `stress::Section`.
    fn write_to(
        &mut self,
        sections: PyReadonlyArray2<'_, f64>,
        station: PyReadonlyArray1<'_, f64>,
        room: Bound<'_, PyArray1<u8>>,
        append: Py<PyAny>,
    ) -> PyResult<()> {
        let robot = self.inner.robot();
        if station.len() != robot.module_count() * self.points {
            return Err(refused("there must be as many stations as points"));
        }
        if !self.times.is_empty() {
            return Err(refused("a run file must be set before the motion starts"));
        }
        let records = Records::new(robot, &sections, &station, room, append)?;
        self.records = Some(records);
        Ok(())
    }

    /// Starts at rest in the equilibrium of a load; returns the status of its search, `unsettled`
    /// where statics converge but the robot with lumped mass does not rest there.
    fn rest(&mut self, py: Python<'_>, load: InstantLoad<'_>) -> PyResult<&'static str> {
        let load = self.load(&load)?;
        let outcome =
            interruptible(py, || self.inner.rest(&load.borrow()))?.map_err(input_error)?;
        if outcome.status == Status::Converged && !self.inner.is_ready() {
            return Ok("unsettled");
        }
        Ok(outcome.status.word())
    }

    /// Starts at rest at the present state of a path of the same robot and settings, with the kinds
    /// of command of its last step; returns whether that succeeded.
    fn rest_at(&mut self, path: PyRef<'_, PathSolver>) -> PyResult<bool> {
        let py = path.py();
        let path = path.inner();
        let stop = interruptible(py, || self.inner.rest_at(path))?.map_err(input_error)?;
        Ok(stop.is_none())
    }

    /// Adds dead forces on all disks, (N, 3) in N, and finds the rest under them; they stay until
    /// `release`. Returns whether that succeeded.
    fn hold(&mut self, forces: PyReadonlyArray2<'_, f64>, increments: usize) -> PyResult<bool> {
        if forces.shape()[1] != 3 {
            return Err(refused("disk forces must have three columns"));
        }
        let rows = forces.extract::<Rows<3>>()?;
        let stop = interruptible(forces.py(), || {
            self.inner.rest_with_disk_forces(&rows, increments)
        })?;
        Ok(stop.map_err(input_error)?.is_none())
    }

    /// Removes the forces of `hold` at once.
    fn release(&mut self) {
        self.inner.release_disk_forces();
    }

    /// Changes the load at once.
    fn jump(&mut self, load: InstantLoad<'_>) -> PyResult<()> {
        let load = self.load(&load)?;
        self.inner.jump(&load.borrow()).map_err(input_error)
    }

    /// Advances through intervals, one in a row, in each of which the load changes linearly to that
    /// of the row, and the motion of the base by a cubic: its row has that at one and two thirds of the
    /// interval and at the end. Records the fields after every row where `record` is set. Returns the reason of
    /// an early stop: a step failed, or disks collided.
    fn run(
        &mut self,
        py: Python<'_>,
        duration: PyReadonlyArray1<'_, f64>,
        loads: LoadRows<'_>,
        record: PyReadonlyArray1<'_, bool>,
    ) -> PyResult<Option<&'static str>> {
        let rows = duration.len();
        let tendons = self.inner.robot().tendon_count();
        let LoadRows(
            tensions,
            tip_force,
            tip_moment,
            disk_forces,
            disk_moments,
            points,
            lines,
            base,
        ) = loads;
        let on_disks = 3 * self.inner.robot().module_count();
        for (name, shape, expected) in [
            ("tensions", tensions.shape(), [rows, tendons]),
            ("tip_force", tip_force.shape(), [rows, 3]),
            ("tip_moment", tip_moment.shape(), [rows, 3]),
            ("disk_forces", disk_forces.shape(), [rows, on_disks]),
            ("disk_moments", disk_moments.shape(), [rows, on_disks]),
            ("line_forces", lines.shape(), [rows, on_disks]),
            ("base", base.shape(), [rows, BASE_ROW]),
        ] {
            let none = !name.starts_with("t") && shape[1] == 0;
            if shape != expected && !(none && shape[0] == rows) {
                return Err(refused(format!(
                    "{name} has shape {shape:?}, it must have {expected:?}"
                )));
            }
        }
        if points.shape()[0] != rows || points.shape()[1] % POINT_LOAD != 0 {
            return Err(refused(format!(
                "point_loads has shape {:?}, it must have {rows} rows of {POINT_LOAD} numbers each",
                points.shape()
            )));
        }
        if record.len() != rows {
            return Err(refused(format!(
                "record has {} entries, it must have {rows}",
                record.len()
            )));
        }
        let (duration, record) = (duration.as_array(), record.as_array());
        let (force, moment) = (tip_force.as_array(), tip_moment.as_array());
        let tensions = tensions.as_array();
        let (disk_forces, disk_moments) = (disk_forces.as_array(), disk_moments.as_array());
        let (points, lines, base) = (points.as_array(), lines.as_array(), base.as_array());
        let disks = self.inner.robot().module_count();
        let mut own = vec![0.0; tendons];
        let mut stop = None;
        let done = interruptible(py, || {
            for row in 0..rows {
                for (to, from) in own.iter_mut().zip(tensions.row(row)) {
                    *to = *from;
                }
                let on_disks = |all: ArrayView2<f64>| vectors(&all.row(row).to_vec());
                let motions: Vec<_> = base
                    .row(row)
                    .to_vec()
                    .chunks(BASE)
                    .map(base_motion)
                    .collect();
                let load = Load {
                    tensions: &own,
                    gravity: [0.0; 3],
                    tip_force: [0, 1, 2].map(|i| force[[row, i]]),
                    tip_moment: [0, 1, 2].map(|i| moment[[row, i]]),
                    disk_forces: &on_disks(disk_forces),
                    disk_moments: &on_disks(disk_moments),
                    point_loads: &point_loads(&points.row(row).to_vec(), disks),
                    line_forces: &on_disks(lines),
                    base: motions.last().copied().unwrap_or_default(),
                };
                let inside = match motions[..] {
                    [first, second, _] => Some([first, second]),
                    _ => None,
                };
                let count;
                (stop, count) = self
                    .inner
                    .advance_through(duration[row], &load, inside)
                    .map_err(input_error)?;
                self.count.steps += count.steps;
                self.count.iterations += count.iterations;
                self.count.repeated += count.repeated;
                self.count.error += count.error;
                if stop.is_some() || record[row] {
                    self.record()?;
                }
                if stop.is_some() {
                    break;
                }
            }
            PyResult::Ok(())
        });
        let mut written = Ok(());
        if let Some(records) = &mut self.records {
            let begun = Instant::now();
            written = records.flush(py);
            self.output += begun.elapsed();
        }
        done??;
        written?;
        Ok(stop.map(|s| match s {
            Stop::StepFailed => "step_failed",
            Stop::Collision => "collision",
        }))
    }

    /// Output times (K,) and position and velocity (K, 3) of the tip.
    fn tip<'py>(&self, py: Python<'py>) -> (Array<'py>, Array<'py>, Array<'py>) {
        let count = self.times.len();
        (
            copied(py, &self.times, &[count]),
            copied(py, &self.tip_position, &[count, 3]),
            copied(py, &self.tip_velocity, &[count, 3]),
        )
    }

    /// Returns and clears the fields of all output times that have not been written to a file.
    fn fields<'py>(&mut self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let fields = std::mem::take(&mut self.fields);
        let robot = self.inner.robot();
        let (n, m) = (robot.module_count(), robot.tendon_count());
        let (times, p) = (fields.time.len(), n * self.points);
        let out = PyDict::new(py);
        let energy = |value: &dyn Fn(&Energies) -> f64| {
            PyArray1::from_iter(py, fields.energies.iter().map(value))
        };
        for (name, values) in [
            ("kinetic_energy", energy(&|e| e.kinetic)),
            ("elastic_energy", energy(&|e| e.elastic)),
            ("gravity_energy", energy(&|e| e.gravity)),
            ("work", energy(&|e| e.work)),
            ("dissipated_energy", energy(&|e| e.dissipated)),
        ] {
            out.set_item(name, values)?;
        }
        let (sections, disks, tendons) = (fields.sections, fields.disks, fields.tendons);
        for (name, values, shape) in [
            ("time", fields.time, &[][..]),
            ("position", sections.position, &[p, 3]),
            ("rotation", sections.rotation, &[p, 3, 3]),
            ("force", sections.force, &[p, 3]),
            ("moment", sections.moment, &[p, 3]),
            ("disk_position", disks.position, &[n, 3]),
            ("disk_rotation", disks.rotation, &[n, 3, 3]),
            ("disk_velocity", disks.velocity, &[n, 3]),
            ("disk_angular_velocity", disks.angular_velocity, &[n, 3]),
            ("tension", tendons.tension, &[m]),
            ("tendon_length", tendons.length, &[m]),
            ("tendon_displacement", tendons.displacement, &[m]),
            ("slack", tendons.slack, &[m]),
            ("span_length", tendons.span_length, &[n, m]),
            ("span_tension", tendons.span_tension, &[n, m]),
        ] {
            let shape = [&[times], shape].concat();
            out.set_item(name, array(py, values, &shape))?;
        }
        Ok(out)
    }

    #[getter]
    fn steps(&self) -> usize {
        self.count.steps
    }

    #[getter]
    fn iterations(&self) -> usize {
        self.count.iterations
    }

    #[getter]
    fn repeated(&self) -> usize {
        self.count.repeated
    }

    /// Estimated error of the tip's position from all steps (m); None where it is unknown.
    #[getter]
    fn error(&self) -> Option<f64> {
        let unknown = self.count.error == 0.0 && (1..3).contains(&self.count.steps);
        (!unknown).then_some(self.count.error)
    }

    /// Time spent on the file (s).
    #[getter]
    fn output_s(&self) -> f64 {
        self.output.as_secs_f64()
    }

    /// Next step (s).
    #[getter]
    fn next_step(&self) -> f64 {
        self.inner.next_step()
    }

    /// Time since the start (s).
    #[getter]
    fn time(&self) -> f64 {
        self.inner.time()
    }
}

/// Motion of the base from its numbers; none where there are no numbers.
fn base_motion(numbers: &[f64]) -> BaseMotion {
    match vectors(numbers)[..] {
        [acceleration, angular_velocity, angular_acceleration] => BaseMotion {
            acceleration,
            angular_velocity,
            angular_acceleration,
        },
        _ => BaseMotion::default(),
    }
}

impl Simulator {
    fn load(&self, load: &InstantLoad<'_>) -> PyResult<OwnedLoad> {
        let InstantLoad(
            tensions,
            tip_force,
            tip_moment,
            disk_forces,
            disk_moments,
            points,
            lines,
            base,
        ) = load;
        let count = self.inner.robot().tendon_count();
        let disks = self.inner.robot().module_count();
        let on_disks = |given: &Bound<'_, PyAny>, name, unit| match given.len()? {
            0 => Ok(vec![]),
            _ => numbers(given, name, unit, 3 * disks).map(|numbers| vectors(&numbers)),
        };
        let of_points = points.len()? / POINT_LOAD * POINT_LOAD;
        let of_points = numbers(points, "point_loads", "SI", of_points)?;
        Ok(OwnedLoad {
            tensions: numbers(tensions, "tensions", "N", count)?,
            gravity: [0.0; 3],
            tip_force: three(tip_force, "tip_force", "N")?,
            tip_moment: three(tip_moment, "tip_moment", "N m")?,
            disk_forces: on_disks(disk_forces, "disk_forces", "N")?,
            disk_moments: on_disks(disk_moments, "disk_moments", "N m")?,
            point_loads: point_loads(&of_points, disks),
            line_forces: on_disks(lines, "line_forces", "N/m")?,
            base: match base.len()? {
                0 => BaseMotion::default(),
                _ => base_motion(&numbers(base, "base", "SI", BASE)?),
            },
        })
    }

    /// Records the present state, or writes it to the file; once for each time, so that a run that
    /// stops at an output time does not repeat it.
    fn record(&mut self) -> PyResult<()> {
        let now = self.inner.time();
        if self.times.last().is_some_and(|last| now <= *last) {
            return Ok(());
        }
        self.inner.record(self.points, &mut self.fields);
        let fields = &mut self.fields;
        let disks = &fields.disks;
        let tip = disks.position.len() - 3;
        self.times.push(now);
        self.tip_position.extend_from_slice(&disks.position[tip..]);
        self.tip_velocity.extend_from_slice(&disks.velocity[tip..]);
        if self.points == 0 {
            fields.clear();
            return Ok(());
        }
        let tendons = &mut fields.tendons;
        if tendons.displacement.len() < tendons.tension.len() {
            let first = tendons.displacement.len();
            for j in 0..self.home.len() {
                let (tension, length) = (tendons.tension[first + j], tendons.length[first + j]);
                let displacement = self.home[j] - length + self.compliance[j] * tension;
                tendons.displacement.push(displacement);
                tendons.slack.push(0.0);
            }
            // NaN where there is none
            let spans = &tendons.span_length[tendons.span_tension.len()..];
            let tension = tendons.tension[first..].iter().cycle();
            let along = spans.iter().zip(tension).map(|(span, t)| t + 0.0 * span);
            tendons.span_tension.extend(along);
        }
        if let Some(records) = &mut self.records {
            let begun = Instant::now();
            let full = records.add(fields);
            fields.clear();
            // waits while other threads of Python are busy
            let written = if full {
                Python::attach(|py| records.flush(py))
            } else {
                Ok(())
            };
            self.output += begun.elapsed();
            return written;
        }
        Ok(())
    }
}

/// Displacement response of all mass of a robot to forces, about an equilibrium.
#[pyclass(module = "bowstring._core")]
pub struct Flexibility {
    inner: modal::Flexibility,
}

#[pymethods]
impl Flexibility {
    /// Mass of every degree of freedom (K,), in kg and kg m^2.
    #[getter]
    fn masses<'py>(&self, py: Python<'py>) -> Array<'py> {
        copied(py, &self.inner.masses, &[self.inner.masses.len()])
    }

    /// Mass points of a module.
    #[getter]
    fn points(&self) -> usize {
        self.inner.points
    }

    /// Disks with payloads, and their motion by their degrees of freedom (6, 6): displacement in the
    /// base frame and rotation in the frame of the disk.
    #[getter]
    fn loaded_disks<'py>(&self, py: Python<'py>) -> Vec<(usize, Array<'py>)> {
        let of = |(k, m): &(usize, [[f64; 6]; 6])| (*k, copied(py, m.as_flattened(), &[6, 6]));
        self.inner.loaded_disks.iter().map(of).collect()
    }

    /// Displacement (K,) of all degrees of freedom by forces (K,).
    fn apply<'py>(
        &mut self,
        py: Python<'py>,
        forces: PyReadonlyArray1<'py, f64>,
    ) -> PyResult<Array<'py>> {
        if forces.len() != self.inner.masses.len() {
            return Err(refused(format!(
                "there are {} forces, there must be {}, one for each mass",
                forces.len(),
                self.inner.masses.len()
            )));
        }
        let forces: Vec<_> = forces.as_array().iter().copied().collect();
        let moved = interruptible(py, || self.inner.apply(&forces))?;
        Ok(array(py, moved, &[forces.len()]))
    }

    /// Displacement (row) by unit force (column), (K, K).
    fn matrix<'py>(&mut self, py: Python<'py>) -> PyResult<Array<'py>> {
        let size = self.inner.masses.len();
        let matrix = interruptible(py, || self.inner.matrix())?.map_err(input_error)?;
        Ok(array(py, matrix, &[size, size]))
    }
}

/// Flexibility at the present state of a path; None where that is no stable equilibrium.
#[pyfunction]
pub fn flexibility_at(
    py: Python<'_>,
    path: PyRef<'_, PathSolver>,
) -> PyResult<Option<Flexibility>> {
    let path = path.inner();
    let found = interruptible(py, || modal::flexibility_at(path))?.map_err(input_error)?;
    Ok(found.map(|inner| Flexibility { inner }))
}

/// Status, and flexibility about the equilibrium of a load; None where there is no stable one.
#[pyfunction]
pub fn flexibility<'py>(
    py: Python<'py>,
    robot: &Robot,
    tensions: &Bound<'py, PyAny>,
    load: DeadLoad<'py>,
    model: &RodModel,
) -> PyResult<(&'static str, Option<Flexibility>)> {
    let (robot, chosen) = (&robot.inner, robot.settings(model));
    let tensions = numbers(tensions, "tensions", "N", robot.tendon_count())?;
    let load = load.with(robot, tensions)?;
    let least = load.borrow().least_elements(robot);
    let (model, elements) = (chosen.model, chosen.elements.unwrap_or(least));
    let (outcome, found) = interruptible(py, || {
        modal::flexibility(robot, model, elements, &load.borrow())
    })?
    .map_err(input_error)?;
    Ok((
        outcome.status.word(),
        found.map(|inner| Flexibility { inner }),
    ))
}

/// Time integration and damping, as attributes.
#[derive(FromPyObject)]
pub(crate) struct Scheme {
    /// Fixed step (s); `None` for an adaptive step.
    pub step: Option<f64>,
    /// Error of a disk's position in an adaptive step (m), and the longest step (s).
    pub tolerance: f64,
    pub longest_step: f64,
    pub spectral_radius: f64,
    /// Mass-proportional damping (1/s), and Kelvin-Voigt damping (s).
    pub mass_damping: f64,
    pub material_damping: f64,
}

//! Statics of the rod: `Robot`, which solves, and `Solution`, which holds one answer.

use crate::input::{input_error, numbers, refused, settings, three, OwnLoads};
use bowstring_core::batch::{self, write_pose, Settings, Solutions};
use bowstring_core::drive::DriveOutcome;
use bowstring_core::load::{OwnedLoad, TendonPath, Theory};
use bowstring_core::robot::{Disk, InputError, RobotSpec, Section, Tendon};
use bowstring_core::sensitivity::Derivative;
use bowstring_core::statics::Solver;
use bowstring_core::statics::{Outcome, Status};
use numpy::{
    IntoPyArray, PyArray1, PyArray2, PyArray3, PyArrayDyn, PyArrayMethods, PyReadonlyArray1,
    PyReadonlyArray2, PyUntypedArrayMethods,
};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};

/// A robot in the core, checked and immutable.
#[pyclass(frozen, module = "bowstring._core")]
pub struct Robot {
    pub(crate) inner: bowstring_core::robot::Robot,
}

#[pymethods]
impl Robot {
    #[new]
    #[pyo3(signature = (station_m, clamped_length_m, disk_mass_kg, disk_inertia,
        disk_segment, bending_stiffness, torsion_stiffness, axial_stiffness, shear_stiffness,
        mass_per_length, rotary_inertia, hole_m, end_disk, gravity))]
    #[allow(clippy::too_many_arguments)]
    fn new(
        station_m: PyReadonlyArray1<f64>,
        clamped_length_m: PyReadonlyArray1<f64>,
        disk_mass_kg: PyReadonlyArray1<f64>,
        disk_inertia: PyReadonlyArray2<f64>,
        disk_segment: PyReadonlyArray1<i64>,
        bending_stiffness: PyReadonlyArray1<f64>,
        torsion_stiffness: PyReadonlyArray1<f64>,
        axial_stiffness: PyReadonlyArray1<f64>,
        shear_stiffness: PyReadonlyArray1<f64>,
        mass_per_length: PyReadonlyArray1<f64>,
        rotary_inertia: PyReadonlyArray1<f64>,
        hole_m: PyReadonlyArray2<f64>,
        end_disk: PyReadonlyArray1<i64>,
        gravity: PyReadonlyArray1<f64>,
    ) -> PyResult<Self> {
        let (disks, segments) = (station_m.len(), bending_stiffness.len());
        let tendons = end_disk.len();
        for (name, len, expected) in [
            ("clamped_length_m", clamped_length_m.len(), disks),
            ("disk_mass_kg", disk_mass_kg.len(), disks),
            ("disk_segment", disk_segment.len(), disks),
            ("torsion_stiffness", torsion_stiffness.len(), segments),
            ("axial_stiffness", axial_stiffness.len(), segments),
            ("shear_stiffness", shear_stiffness.len(), segments),
            ("mass_per_length", mass_per_length.len(), segments),
            ("rotary_inertia", rotary_inertia.len(), segments),
            ("gravity", gravity.len(), 3),
        ] {
            if len != expected {
                return Err(refused(format!(
                    "{name} has {len} entries, it must have {expected}"
                )));
            }
        }
        for (name, shape, rows) in [
            ("hole_m", hole_m.shape(), tendons),
            ("disk_inertia", disk_inertia.shape(), disks),
        ] {
            if shape != [rows, 2] {
                return Err(refused(format!(
                    "{name} has shape {shape:?}, it must have [{rows}, 2]"
                )));
            }
        }
        // an index below zero becomes a huge one, which the core refuses
        let index = |i: i64| usize::try_from(i).unwrap_or(usize::MAX);
        let (clamped, mass) = (clamped_length_m.as_array(), disk_mass_kg.as_array());
        let (station, segment) = (station_m.as_array(), disk_segment.as_array());
        let (bending, torsion) = (bending_stiffness.as_array(), torsion_stiffness.as_array());
        let (axial, shear) = (axial_stiffness.as_array(), shear_stiffness.as_array());
        let (line, rotary) = (mass_per_length.as_array(), rotary_inertia.as_array());
        let (hole, inertia) = (hole_m.as_array(), disk_inertia.as_array());
        let (end, g) = (end_disk.as_array(), gravity.as_array());
        let spec = RobotSpec {
            sections: (0..segments)
                .map(|i| Section {
                    bending: bending[i],
                    torsion: torsion[i],
                    axial: axial[i],
                    shear: shear[i],
                    mass_per_length: line[i],
                    rotary_inertia: rotary[i],
                })
                .collect(),
            disks: (0..disks)
                .map(|i| Disk {
                    station: station[i],
                    clamped_length: clamped[i],
                    mass: mass[i],
                    inertia: [inertia[[i, 0]], inertia[[i, 1]]],
                    segment: index(segment[i]),
                })
                .collect(),
            tendons: (0..tendons)
                .map(|i| Tendon {
                    hole: [hole[[i, 0]], hole[[i, 1]]],
                    end_disk: index(end[i]),
                })
                .collect(),
            gravity: [g[0], g[1], g[2]],
        };
        Ok(Robot {
            inner: bowstring_core::robot::Robot::new(spec).map_err(input_error)?,
        })
    }

    /// Number of tendons.
    #[getter]
    fn tendon_count(&self) -> usize {
        self.inner.tendon_count()
    }

    /// Number of disks.
    #[getter]
    fn disk_count(&self) -> usize {
        self.inner.module_count()
    }

    /// One equilibrium from straight.
    #[allow(clippy::too_many_arguments)]
    fn solve(
        slf: &Bound<'_, Self>,
        tensions: &Bound<'_, PyAny>,
        theory: &str,
        gravity: Option<&Bound<'_, PyAny>>,
        tip_force: &Bound<'_, PyAny>,
        tip_moment: &Bound<'_, PyAny>,
        tendon: &str,
        twist: bool,
        elements: Option<usize>,
    ) -> PyResult<Solution> {
        let robot = &slf.get().inner;
        let settings = settings(theory, tendon, twist, elements)?;
        let load = OwnedLoad {
            tensions: numbers(tensions, "tensions", "N", robot.tendon_count())?,
            gravity: match gravity {
                Some(g) => three(g, "gravity", "m/s^2")?,
                None => robot.spec().gravity,
            },
            tip_force: three(tip_force, "tip_force", "N")?,
            tip_moment: three(tip_moment, "tip_moment", "N m")?,
        };
        slf.py()
            .detach(|| {
                let mut solver = settings.solver(robot)?;
                let outcome = solver.solve(&load.borrow())?;
                let solver = solver.solver();
                let answer =
                    (outcome.status == Status::Converged).then(|| Answer::read(robot, solver));
                Ok((outcome, answer, solver.elements()))
            })
            .map(|(outcome, answer, elements)| Solution {
                robot: slf.clone().unbind(),
                settings: Settings {
                    elements: Some(elements),
                    ..settings
                },
                load,
                outcome,
                answer,
                driven: None,
            })
            .map_err(input_error)
    }

    /// Many loads in order; arrays of n rows, the last three may be one row.
    #[allow(clippy::too_many_arguments)]
    fn sweep<'py>(
        &self,
        py: Python<'py>,
        tensions: PyReadonlyArray2<'py, f64>,
        theory: &str,
        gravity: Option<&Bound<'py, PyAny>>,
        tip_force: &Bound<'py, PyAny>,
        tip_moment: &Bound<'py, PyAny>,
        tendon: &str,
        twist: bool,
        elements: Option<usize>,
        warm: bool,
        disks: bool,
    ) -> PyResult<Bound<'py, PyDict>> {
        let settings = settings(theory, tendon, twist, elements)?;
        let loads = OwnLoads::new(&self.inner, tensions, gravity, tip_force, tip_moment)?;
        let found =
            py.detach(|| batch::sweep(&self.inner, &settings, &loads.borrow(), warm, disks));
        self.arrays(py, found.map_err(input_error)?, disks)
    }

    /// Many loads, each from straight, on `threads` cores (0: all).
    #[allow(clippy::too_many_arguments)]
    fn solve_batch<'py>(
        &self,
        py: Python<'py>,
        tensions: PyReadonlyArray2<'py, f64>,
        theory: &str,
        gravity: Option<&Bound<'py, PyAny>>,
        tip_force: &Bound<'py, PyAny>,
        tip_moment: &Bound<'py, PyAny>,
        tendon: &str,
        twist: bool,
        elements: Option<usize>,
        threads: usize,
        disks: bool,
    ) -> PyResult<Bound<'py, PyDict>> {
        let settings = settings(theory, tendon, twist, elements)?;
        let loads = OwnLoads::new(&self.inner, tensions, gravity, tip_force, tip_moment)?;
        let found = py
            .detach(|| batch::solve_batch(&self.inner, &settings, &loads.borrow(), threads, disks));
        self.arrays(py, found.map_err(input_error)?, disks)
    }
}

impl Robot {
    /// The answers as NumPy arrays, named as in `bowstring.rod.Sweep`.
    pub(crate) fn arrays<'py>(
        &self,
        py: Python<'py>,
        found: Solutions,
        disks: bool,
    ) -> PyResult<Bound<'py, PyDict>> {
        let n = found.outcomes.len();
        let modules = self.inner.module_count();
        let outcomes = &found.outcomes;
        let column =
            |value: &dyn Fn(&Outcome) -> f64| PyArray1::from_iter(py, outcomes.iter().map(value));
        let out = PyDict::new(py);
        let words = outcomes.iter().map(|o| o.status.word());
        out.set_item("status", PyList::new(py, words.collect::<Vec<_>>())?)?;
        let stable = outcomes.iter().map(|o| o.stable);
        out.set_item("stable", PyList::new(py, stable.collect::<Vec<_>>())?)?;
        let converged = outcomes.iter().map(|o| o.status == Status::Converged);
        out.set_item("converged", PyArray1::from_iter(py, converged))?;
        let iterations = outcomes.iter().map(|o| o.iterations as i64);
        out.set_item("iterations", PyArray1::from_iter(py, iterations))?;
        out.set_item("residual", column(&|o| o.residual))?;
        out.set_item("fraction", column(&|o| o.fraction))?;
        let error = |o: &Outcome| o.error.map_or([f64::NAN; 2], |e| [e.tip, e.tension]);
        out.set_item("tip_error", column(&|o| error(o)[0]))?;
        out.set_item("tension_error", column(&|o| error(o)[1]))?;
        let left = outcomes.iter().map(|o| o.left_unstable);
        out.set_item("left_unstable", PyArray1::from_iter(py, left))?;
        let collision = outcomes
            .iter()
            .map(|o| o.collision.map_or(-1, |k| k as i64));
        out.set_item("collision", PyArray1::from_iter(py, collision))?;
        let shaped = |v: Vec<f64>, shape: &[usize]| v.into_pyarray(py).reshape(shape);
        out.set_item("tip_position", shaped(found.tip_position, &[n, 3])?)?;
        out.set_item("tip_rotation", shaped(found.tip_rotation, &[n, 3, 3])?)?;
        let tendons = self.inner.tendon_count();
        out.set_item(
            "tendon_lengths",
            shaped(found.tendon_length, &[n, tendons])?,
        )?;
        let (positions, rotations) = if disks {
            let positions: Bound<'py, PyArrayDyn<f64>> =
                shaped(found.disk_position, &[n, modules, 3])?;
            let rotations = shaped(found.disk_rotation, &[n, modules, 3, 3])?;
            (Some(positions), Some(rotations))
        } else {
            (None, None)
        };
        out.set_item("disk_positions", positions)?;
        out.set_item("disk_rotations", rotations)?;
        Ok(out)
    }
}

/// The answer to one load.
#[pyclass(frozen, module = "bowstring._core")]
pub struct Solution {
    robot: Py<Robot>,
    settings: Settings,
    load: OwnedLoad,
    outcome: Outcome,
    answer: Option<Answer>,
    /// If it was found by a `Drive`, not by tensions alone.
    driven: Option<Box<Driven>>,
}

impl Solution {
    pub(crate) fn driven_one(
        robot: Py<Robot>,
        settings: Settings,
        load: OwnedLoad,
        outcome: Outcome,
        answer: Option<Answer>,
        driven: Driven,
    ) -> Self {
        Solution {
            robot,
            settings,
            load,
            outcome,
            answer,
            driven: Some(Box::new(driven)),
        }
    }

    /// What a converged step of a drive adds.
    fn state(&self) -> Option<&State> {
        self.driven.as_ref()?.state.as_ref()
    }

    /// Something of the solver in the pose of the answer. After tensions alone it is solved anew,
    /// which gives the same numbers.
    fn ask<T>(&self, question: impl FnOnce(&Solver) -> T) -> Result<T, InputError> {
        if let Some(state) = self.state() {
            return Ok(question(&state.solver));
        }
        let mut solver = self.settings.solver(&self.robot.get().inner)?;
        solver.solve(&self.load.borrow())?;
        Ok(question(solver.solver()))
    }
}

/// What a step of a `Drive` adds to a solution by tensions.
pub(crate) struct Driven {
    /// Whether each tendon is pulled by a length, and the length or tension.
    pub pulled: Vec<bool>,
    pub commands: Vec<f64>,
    pub found: DriveOutcome,
    pub state: Option<State>,
}

/// Numbers of a converged step.
pub(crate) struct State {
    /// In the pose of the step: tensions alone do not always lead there again.
    pub solver: Solver,
    pub pulls: Vec<f64>,
    pub slack: Vec<f64>,
    /// By modules and tendons.
    pub spans: Vec<f64>,
}

/// Numbers of a converged solution.
pub(crate) struct Answer {
    pub disk_position: Vec<f64>,
    pub disk_rotation: Vec<f64>,
    pub tendon_length: Vec<f64>,
}

impl Answer {
    pub fn read(robot: &bowstring_core::robot::Robot, solver: &Solver) -> Self {
        let n = robot.module_count();
        let (mut disk_position, mut disk_rotation) = (vec![0.0; 3 * n], vec![0.0; 9 * n]);
        for k in 0..n {
            write_pose(
                &solver.disk(k).expect("it converged"),
                k,
                &mut disk_position,
                &mut disk_rotation,
            );
        }
        Answer {
            disk_position,
            disk_rotation,
            tendon_length: (0..robot.tendon_count())
                .filter_map(|i| solver.tendon_length(i))
                .collect(),
        }
    }
}

#[pymethods]
impl Solution {
    #[getter]
    fn status(&self) -> &'static str {
        self.outcome.status.word()
    }
    #[getter]
    fn converged(&self) -> bool {
        self.answer.is_some()
    }
    #[getter]
    fn stable(&self) -> Option<bool> {
        self.outcome.stable
    }
    #[getter]
    fn iterations(&self) -> usize {
        self.outcome.iterations
    }
    #[getter]
    fn residual(&self) -> f64 {
        self.outcome.residual
    }
    #[getter]
    fn left_unstable(&self) -> bool {
        self.outcome.left_unstable
    }
    #[getter]
    fn fraction(&self) -> f64 {
        self.outcome.fraction
    }
    #[getter]
    fn collision(&self) -> Option<usize> {
        self.outcome.collision
    }
    #[getter]
    fn theory(&self) -> &'static str {
        match self.settings.model.theory {
            Theory::Cosserat => "cosserat",
            Theory::Kirchhoff => "kirchhoff",
        }
    }
    #[getter]
    fn tendon(&self) -> &'static str {
        match self.settings.model.tendon {
            TendonPath::Straight => "straight",
            TendonPath::Continuous => "continuous",
        }
    }
    #[getter]
    fn twist(&self) -> bool {
        self.settings.model.twist
    }
    #[getter]
    fn elements(&self) -> Option<usize> {
        self.settings.elements
    }
    /// Estimated discretisation error of tip, m, and tensions, N; `None` without an answer.
    #[getter]
    fn error_estimate(&self) -> Option<(f64, f64)> {
        self.outcome.error.map(|e| (e.tip, e.tension))
    }
    #[getter]
    fn tensions<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.load.tensions)
    }
    #[getter]
    fn gravity<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.load.gravity)
    }
    #[getter]
    fn tip_force<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.load.tip_force)
    }
    #[getter]
    fn tip_moment<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.load.tip_moment)
    }
    #[getter]
    fn tip_position<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray1<f64>>> {
        let p = &self.answer.as_ref()?.disk_position;
        Some(PyArray1::from_slice(py, &p[p.len() - 3..]))
    }
    #[getter]
    fn tip_rotation<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyArray2<f64>>>> {
        self.answer
            .as_ref()
            .map(|a| {
                let r = &a.disk_rotation;
                PyArray1::from_slice(py, &r[r.len() - 9..]).reshape([3, 3])
            })
            .transpose()
    }
    #[getter]
    fn disk_positions<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyArray2<f64>>>> {
        self.answer
            .as_ref()
            .map(|a| {
                let p = &a.disk_position;
                PyArray1::from_slice(py, p).reshape([p.len() / 3, 3])
            })
            .transpose()
    }
    #[getter]
    fn disk_rotations<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyArray3<f64>>>> {
        self.answer
            .as_ref()
            .map(|a| {
                let r = &a.disk_rotation;
                PyArray1::from_slice(py, r).reshape([r.len() / 9, 3, 3])
            })
            .transpose()
    }
    #[getter]
    fn tendon_lengths<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray1<f64>>> {
        let a = self.answer.as_ref()?;
        Some(PyArray1::from_slice(py, &a.tendon_length))
    }

    /// Whether a `Drive` found it: what follows is `None` otherwise.
    #[getter]
    fn driven(&self) -> bool {
        self.driven.is_some()
    }
    /// Which tendons were pulled by a length.
    #[getter]
    fn pulled<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray1<bool>>> {
        let driven = self.driven.as_ref()?;
        Some(PyArray1::from_slice(py, &driven.pulled))
    }
    /// Lengths and tensions that were asked for.
    #[getter]
    fn commands<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray1<f64>>> {
        let driven = self.driven.as_ref()?;
        Some(PyArray1::from_slice(py, &driven.commands))
    }
    #[getter]
    fn undetermined(&self) -> Option<bool> {
        Some(self.driven.as_ref()?.found.undetermined)
    }
    #[getter]
    fn length_residual(&self) -> Option<f64> {
        Some(self.driven.as_ref()?.found.length_residual)
    }
    /// Tendons that fight, from 0, and the nearest pulls with an equilibrium.
    #[getter]
    fn conflict(&self) -> Option<(Vec<usize>, Option<Vec<f64>>)> {
        let found = &self.driven.as_ref()?.found;
        Some((found.fighting.clone(), found.nearest.clone()))
    }
    #[getter]
    fn pulls<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray1<f64>>> {
        Some(PyArray1::from_slice(py, &self.state()?.pulls))
    }
    #[getter]
    fn slack_lengths<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray1<f64>>> {
        Some(PyArray1::from_slice(py, &self.state()?.slack))
    }
    #[getter]
    fn span_tensions<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyArray2<f64>>>> {
        self.state()
            .map(|state| {
                let m = self.load.tensions.len();
                PyArray1::from_slice(py, &state.spans).reshape([state.spans.len() / m, m])
            })
            .transpose()
    }

    /// Points of the backbone. A solution by tensions keeps what is asked of it often and not the
    /// solver.
    fn centerline<'py>(
        &self,
        py: Python<'py>,
        points_per_module: usize,
    ) -> PyResult<Option<Bound<'py, PyArray2<f64>>>> {
        const MOST: usize = 1_000_000;
        let robot = &self.robot.get().inner;
        if points_per_module == 0 || points_per_module > MOST / robot.module_count().min(MOST) {
            return Err(refused(format!(
                "points_per_module is {points_per_module}, it must be 1 or more, and at most {MOST} points in all"
            )));
        }
        if self.answer.is_none() {
            return Ok(None);
        }
        let points = py
            .detach(|| self.ask(|solver| solver.centerline(points_per_module)))
            .map_err(input_error)?;
        let Some(points) = points else {
            return Ok(None);
        };
        let flat: Vec<f64> = points.iter().flat_map(|p| p.0).collect();
        flat.into_pyarray(py).reshape([points.len(), 3]).map(Some)
    }

    /// Derivatives by tension, tip force, tip moment and stiffness, each as arrays of position,
    /// rotation and lengths with a column for each parameter; `None` if there are none (not
    /// converged, or continuous tendons).
    fn jacobians<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyDict>>> {
        if self.answer.is_none() {
            return Ok(None);
        }
        let robot = &self.robot.get().inner;
        let found = py
            .detach(|| self.ask(Solver::jacobians))
            .map_err(input_error)?;
        let Some(found) = found else {
            return Ok(None);
        };
        let out = PyDict::new(py);
        for (parameter, columns) in [
            ("tension", &found.tensions),
            ("tip_force", &found.tip_force),
            ("tip_moment", &found.tip_moment),
            ("stiffness", &found.stiffness),
        ] {
            let table = |rows: usize, entry: &dyn Fn(&Derivative, usize) -> f64| {
                let entries = (0..rows).flat_map(|i| columns.iter().map(move |d| entry(d, i)));
                PyArray1::from_iter(py, entries).reshape([rows, columns.len()])
            };
            let tendons = robot.tendon_count();
            out.set_item(
                format!("tip_position_by_{parameter}"),
                table(3, &|d, i| d.position[i])?,
            )?;
            out.set_item(
                format!("tip_rotation_by_{parameter}"),
                table(3, &|d, i| d.rotation[i])?,
            )?;
            out.set_item(
                format!("lengths_by_{parameter}"),
                table(tendons, &|d, i| d.lengths[i])?,
            )?;
        }
        Ok(Some(out))
    }
}
